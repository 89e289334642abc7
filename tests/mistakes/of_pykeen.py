"""Mistakes in the arguments of ``isi.pykeen.insert``."""

from typing import Any

import numpy as np
import pandas as pd

from tests.mistakes.calls import Called, called

NEW = [("cup", "r0", "e1"), ("e3", "r1", "cup")]


def factory(entities: int = 6, **how: Any) -> Any:
    """A ``TriplesFactory`` of a ring through the entities, with two relations."""
    import torch
    from pykeen.triples import TriplesFactory

    ring = [(one, one % 2, (one + 1) % entities) for one in range(entities)]
    names = {f"e{row}": row for row in range(entities)}
    return TriplesFactory(torch.tensor(ring), names, {"r0": 0, "r1": 1}, **how)


def model(name: str, **how: Any) -> Any:
    """An untrained model of PyKEEN for ``factory()``."""
    from pykeen.models import model_resolver

    return model_resolver.make(name, triples_factory=factory(**how), embedding_dim=4, random_seed=0)


def sound() -> dict[str, Any]:
    return {"model": model("complex"), "factory": factory(), "triples": NEW}


def unnamed() -> Any:
    """A ``TriplesFactory`` that lacks the label of an entity."""
    changed = factory()
    del changed.entity_to_id["e5"]
    return changed


PYKEEN_CASES = [
    *called("isi.pykeen.insert"),
    Called(
        "vectors that are computed",
        lambda: {"model": model("rgcn")},
        "argument 'model'|RGCN|train_on",
    ),
    Called("another model's factory", lambda: {"factory": factory(7)}, "argument 'factory'"),
    Called("a factory that lacks labels", lambda: {"factory": unnamed()}, "argument 'factory'"),
    Called(
        "neither labels nor a number",
        lambda: {"factory": factory().to_core_triples_factory()},
        "argument 'new'",
    ),
    Called("a frame of two columns", {"triples": pd.DataFrame(NEW)[[0, 2]]}, "argument 'triples'"),
    Called(
        "new relations of a model without tables of them",
        lambda: {"model": model("um"), "new_relations": ["near"]},
        "argument 'new_relations'|UM",
    ),
    Called(
        "an initializer that needs an inverse",
        lambda: {"model": model("rescal"), "initializer": "rs"},
        "argument 'initializer'",
    ),
    Called(
        "no word for an initializer that goes by words",
        lambda: {
            "model": model("rescal"),
            "initializer": "es",
            "words": np.eye(7) * (np.arange(7) < 6),
        },
        "new entity 'cup'",
    ),
]
