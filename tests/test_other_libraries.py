"""Our models give the scores of TorchKGE's models with the same tables."""

from typing import Any

import numpy as np
import pytest
import torch

import isi

pytest.importorskip("torchkge")

from torchkge.models import ComplExModel, DistMultModel, TransEModel

ENTITIES, RELATIONS, DIMENSION = 9, 3, 6


def tables(model: Any) -> list[np.ndarray]:
    """Entity and relation tables of a model; for complex vectors the real half comes first."""
    parts = [part.detach().numpy() for part in model.get_embeddings()]
    half = len(parts) // 2
    return [np.concatenate(parts[:half], 1), np.concatenate(parts[half:], 1)]


@pytest.mark.parametrize(
    ("trained", "model", "options"),
    [
        (TransEModel(DIMENSION, ENTITIES, RELATIONS, "L1"), "transe_l1", {"margin": 1.0}),
        (
            TransEModel(DIMENSION, ENTITIES, RELATIONS, "L2"),
            "transe",
            {"margin": 1.0, "squared": True},
        ),
        (DistMultModel(DIMENSION, ENTITIES, RELATIONS), "distmult", {}),
        (ComplExModel(DIMENSION, ENTITIES, RELATIONS), "complex", {}),
    ],
)
def test_torchkges_tables_score_by_our_models_what_they_score_there(
    trained: Any, model: str, options: dict[str, Any]
) -> None:
    done = isi.insert(
        *tables(trained), [(0, 0, ENTITIES)], new=1, model=model, model_options=options
    )
    every = [torch.arange(number) for number in (ENTITIES, RELATIONS, ENTITIES)]
    head, relation, tail = torch.cartesian_prod(*every).T
    theirs = trained.scoring_function(head, tail, relation).detach()
    ours = done.details.embedding.score(head[None], relation[None], tail[None])[0] - options.get(
        "margin", 0.0
    )
    torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-5)
