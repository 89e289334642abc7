"""An initializer of your own: register it, and use it by name. docs/extending.md has more."""

# %%
import numpy as np
import torch

import isi
from isi.config import Positive
from isi.initializers.api import InitResult, initializer, without_weights
from isi.initializers.context import InitContext


# %% A context has one or more models (M)
# Each with n novel entities, E entities, and vectors of d numbers
@initializer("shrunk_mean", label="Shrunk mean", defaults={"scale": 0.5})
def shrunk_mean(context: InitContext, scale: Positive) -> InitResult:
    """Shrunk mean: ``scale`` times the centroid of the known vectors."""
    known = context.known[..., None].float()  # (M, E, 1)
    # (M, 1, d)
    centroid = (known * context.theta0.entity).sum(1, keepdim=True) / known.sum(1, keepdim=True)
    return without_weights(scale * centroid.expand(-1, context.novel.shape[1], -1))  # (M, n, d)


# %% Named checks, on a small random graph
print("passed:", ", ".join(isi.check_initializer("shrunk_mean")))

# %% Trained tables, here made up, and one fact about a new entity with the id 40
rng = np.random.default_rng(0)
entities, relations = rng.standard_normal((40, 8)), rng.standard_normal((2, 8))
done = isi.insert(
    entities, relations, [(40, 0, 3)], new=1, model="complex", initializer="shrunk_mean"
)
print(done)
expected = 0.5 * torch.from_numpy(entities).mean(0)
print("as computed by hand:", np.allclose(done.entities[40], expected, atol=1e-6))

# %% Options replace the defaults
again = isi.insert(
    entities,
    relations,
    [(40, 0, 3)],
    new=1,
    model="complex",
    initializer="shrunk_mean",
    options={"scale": 1.0},
)
print(
    "twice as long:",
    round(float(np.linalg.norm(again.entities[40]) / np.linalg.norm(done.entities[40])), 3),
)
