"""What can be done with a novel entity: the answers to (entity, hasAffordance, ?) right after insertion (Table 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.embeddings import analogy
from isi.experiments.cells import Embedded
from isi.experiments.insertion import put
from isi.tables import HAS_AFFORDANCE


@dataclass(frozen=True)
class RankingTask(Embedded):
    """Rank what can be done with novel entities as they were inserted into Θ⁰."""

    #: shape: (M, n, d)
    vectors: np.ndarray


def ranks(task: RankingTask) -> pd.DataFrame:
    """Rank of every entity of D¹ as an affordance of each novel entity (``tables.AFFORDANCES``)."""
    session, novel = task.joint, torch.as_tensor(task.novel)
    embedding = put(task.theta, novel, torch.as_tensor(task.vectors))
    relation = torch.full_like(novel, task.graph.relations.index(HAS_AFFORDANCE))
    rank = ranks_of(analogy.score_tails(embedding, novel, relation), session.entities[:, None]).cpu().numpy()
    model, place, answer = rank.nonzero()
    columns = {"seed": np.array(task.seeds)[model], "entity": task.novel[model, place], "answer": answer}
    return pd.DataFrame(columns | {"rank": rank[model, place, answer]})


def ranks_of(scores: Tensor, candidates: Tensor) -> Tensor:
    """Rank of each candidate in its row, from 1, ties to the lower id; 0 for who is none; shapes (M, n, E)."""
    order = scores.masked_fill(~candidates, -torch.inf).sort(dim=-1, descending=True, stable=True).indices
    rank = torch.empty_like(order).scatter_(-1, order, torch.arange(1, order.shape[-1] + 1).expand_as(order))
    return rank * candidates
