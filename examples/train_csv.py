"""Train an embedding of a table of triples, insert an object that it lacks, and ask about it.

Run it in the folder of the project: ``python examples/train_csv.py``. Any file that ``isi train``
reads will do.
"""

# %%
from pathlib import Path

import isi

HERE = Path(__file__).parent

# %% Of two learning rates, the better one for validation triples is taken
home = isi.train(HERE / "home.csv")
print(home)

# %% A new object, from two facts and the words of its name; all other vectors stay as they are
home.tell({"espresso machine": {"atLocation": "kitchen", "hasAffordance": "turn on"}})
for answer in home.ask("espresso machine", "hasAffordance", top=3).answers:
    print(answer)

# %% What one fact more changes, and how to take it back
home.tell([("espresso machine", "atLocation", "counter top")])
print(home.nearest("espresso machine", 3))
home.undo()

# %% How far the new object pushes earlier answers down: mean reciprocal ranks without and with it
print(home.interference())

# %% Save it, for `isi ask` and `isi.open`
home.save("home")
