"""What can be done with a novel entity: the answers to (entity, relation, ?) right after insertion (Table 3)."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
import pandas as pd
import torch
from pydantic import Field, model_validator
from torch import Tensor

from isi.config import Study, distinct
from isi.experiment.grid import GridPoints, StackedVectors
from isi.experiment.insert import with_vectors
from isi.tables.rules import at_least
from isi.tables.table import INT, NAME, Table

#: Rank of each answer to (entity, relation, ?) right after insertion.
AFFORDANCES = Table(
    "data/analyses/affordances/{experiment}.parquet",
    {"initializer": NAME, "seed": INT, "entity": INT, "answer": INT, "rank": INT},
    checks=[*at_least(0, "seed", "entity", "answer"), *at_least(1, "rank")],
    entity_ids=["entity", "answer"],
)


class Affordances(Study):
    """``affordances`` in params: of which experiment, by which relation, and whose the table shows."""

    relation: str
    entities: Annotated[list[str], Field(min_length=1)]

    @model_validator(mode="after")
    def _once(self) -> Self:
        if not distinct(self.entities):
            raise ValueError("entities must not repeat")
        return self


def rank_answers(
    points: GridPoints, theta0: StackedVectors, initializer: str, vectors: np.ndarray, relation: int
) -> pd.DataFrame:
    """Rank of every entity of D¹ as an answer for each novel entity of the first session (``AFFORDANCES``).

    Args:
        vectors: of the novel entities, as the initializer inserted them; shape (M, n, d).
        relation: id.
    """
    session, novel = points.session(1), points.novel_in(1)
    embedding = with_vectors(theta0.stack, novel, torch.as_tensor(vectors))
    scores = embedding.score_tails(novel, torch.full_like(novel, relation))
    rank = ranks_of(scores, session.entities[:, None]).cpu().numpy()
    model, place, answer = rank.nonzero()
    columns = {"seed": np.array(points.seeds)[model], "entity": points.novel[model, 0, place], "answer": answer}
    return pd.DataFrame(columns | {"rank": rank[model, place, answer]}).assign(initializer=initializer)


def ranks_of(scores: Tensor, candidates: Tensor) -> Tensor:
    """Rank of each candidate in its row, from 1, ties to the lower id; 0 for who is none; shapes (..., E)."""
    order = scores.masked_fill(~candidates, -torch.inf).sort(dim=-1, descending=True, stable=True).indices
    return (order.argsort(-1) + 1) * candidates
