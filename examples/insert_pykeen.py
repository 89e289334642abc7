"""Insert an entity into a model that PyKEEN has trained (extra ``pykeen``)."""

# %%
import numpy as np
from pykeen.models import ComplEx
from pykeen.predict import predict_target
from pykeen.training import SLCWATrainingLoop
from pykeen.triples import TriplesFactory
from torch.optim import Adam

import isi

# %% A small graph, and a model of it
PLACES = {
    "kitchen": "kettle toaster fridge oven",
    "bedroom": "bed cot wardrobe lamp",
    "bathroom": "towel soap tub",
}
WHAT = {"kitchen": "cook", "bedroom": "sleep", "bathroom": "wash"}
known = [
    (thing, "at location", room) for room, things in PLACES.items() for thing in things.split()
]
known += [(thing, "serves to", WHAT[room]) for thing, _, room in known]
factory = TriplesFactory.from_labeled_triples(np.array(known))
model = ComplEx(triples_factory=factory, embedding_dim=16, random_seed=0)
loop = SLCWATrainingLoop(
    model=model, triples_factory=factory, optimizer=Adam(model.parameters(), lr=0.2)
)
loop.train(factory, num_epochs=20, batch_size=22, use_tqdm=False)

# %% A new entity from one triple: how it was inserted, and how far it pushes known answers down
new = isi.pykeen.insert(model, factory, [("microwave", "at location", "kitchen")])
print(new.initializer, new.harm)
print(new.rows.interference())

# %% Copies of the model and of the factory with its row, which PyKEEN uses like any other
larger, more = new

# %% What does it serve to?
answers = predict_target(
    model=larger, head="microwave", relation="serves to", triples_factory=more
).df
print(answers[["tail_label", "score"]].head(3).to_string(index=False))

# %% Train its row alone, then all rows. PyKEEN's own `train` would reset all vectors first
larger, more = new.train(epochs=5)
losses = isi.pykeen.train_on(larger, more, epochs=2)

# %% Or a home, to which a robot adds entities and facts
home = isi.from_pykeen(model, factory)
home.tell([("microwave", "at location", "kitchen")])
print(home.ask("microwave", "serves to", top=1))
