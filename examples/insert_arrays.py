"""Insert entities into arrays of vectors that any other program has trained."""

# %%
import numpy as np

import isi

# %% Trained tables, here made up
# 60 entities and 2 relations of DistMult, and the triples that it gives high scores
rng = np.random.default_rng(0)
entities, relations = rng.standard_normal((60, 16)), rng.standard_normal((2, 16))
scores = np.einsum("hd,rd,td->hrt", entities, relations, entities)
known = np.argwhere(scores > np.quantile(scores, 0.95))

# %% One entity is hidden: its row is the last one, its triples are new
is_new = (known[:, [0, 2]] == 59).any(1)
facts, hidden_row = known[is_new][::2], entities[59]

# %% Insert it
# Without a name, the initializer is chosen on other hidden entities of the same tables
done = isi.insert(
    entities[:59], relations, facts, new=1, model="distmult", known_triples=known[~is_new]
)
print(done)
if done.selection:
    print(done.selection.to_frame().head().to_string())

# %% Known rows are the same bytes; the new one resembles the hidden one
print("known rows unchanged:", done.entities[:59].tobytes() == entities[:59].tobytes())
new_row = done.entities[59]
print(
    "cosine to the hidden row:", round(float(new_row @ hidden_row / np.linalg.norm(new_row) / 4), 1)
)

# %% Does it push earlier answers down?
# Mean reciprocal ranks without and with the new entity as a candidate
print(done.interference())

# %% How probable are the other triples of the entity?
others = known[is_new][1::2]
print(done.probability(others).round(2), "others;", done.probability(facts).round(2), "given")
