"""Ranks of the answers about inserted entities, for Table 3."""

from typing import Annotated

import numpy as np
import pandas as pd
import torch
from pydantic import Field
from torch import Tensor

from isi.config import EachOnce, Name, Study
from isi.experiment.insert import with_vectors
from isi.models.stack import Embedding
from isi.tables.rules import FROM_0, FROM_1, NAME
from isi.tables.table import Table
from stages.grid import GridPoints

#: Rank of each answer to (entity, relation, ?) right after insertion.
AFFORDANCES = Table(
    "data/analyses/affordances/{experiment}.parquet",
    {"initializer": NAME, "seed": FROM_0, "entity": FROM_0, "answer": FROM_0, "rank": FROM_1},
)


class Affordances(Study):
    """``affordances`` in params: the experiments, the relation that is queried,
    and the entities of Table 3, by experiment.
    """

    rules = (
        (
            lambda section: set(section.experiments) <= set(section.entities),
            "entities: expected a list for each of the experiments",
        ),
    )
    relation: str
    entities: dict[Name, Annotated[list[str], Field(min_length=1), EachOnce]]


def rank_answers(
    points: GridPoints, theta0: Embedding, initializer: str, vectors: np.ndarray, relation: int
) -> pd.DataFrame:
    """Rows of ``AFFORDANCES``: entities of D¹ ranked for (novel, relation, ?),
    with novel vectors (M, n, d).
    """
    session, novel = points.session(1), points.novel_ids
    embedding = with_vectors(theta0, novel, torch.as_tensor(vectors))
    scores = embedding.score_tails(novel, torch.full_like(novel, relation))
    rank = ranks_of(scores, session.entities[:, None]).cpu().numpy()
    model, place, answer = rank.nonzero()
    columns = {
        "seed": np.array(points.seeds)[model],
        "entity": points.novel[model, place],
        "answer": answer,
    }
    return pd.DataFrame(columns | {"rank": rank[model, place, answer]}).assign(
        initializer=initializer
    )


def ranks_of(scores: Tensor, candidates: Tensor) -> Tensor:
    """Rank of each candidate in its row, from 1; ties go to the lower id; 0 for other entities;
    shapes (..., E).
    """
    order = (
        scores.masked_fill(~candidates, -torch.inf)
        .sort(dim=-1, descending=True, stable=True)
        .indices
    )
    return (order.argsort(-1) + 1) * candidates
