"""What can be done with a novel entity: the answers to (entity, hasAffordance, ?) right after insertion (Table 3)."""

from __future__ import annotations

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.embeddings import analogy
from isi.embeddings.stack import Embedding
from isi.experiments.cells import Cells
from isi.experiments.insertion import put
from isi.tables import HAS_AFFORDANCE


def ranks(cells: Cells, theta0: tuple[np.ndarray, np.ndarray], vectors: np.ndarray) -> pd.DataFrame:
    """Rank of every entity of D¹ as an affordance of each novel entity (``tables.AFFORDANCES``).

    Args:
        theta0: entity and relation vectors of Θ⁰; shapes (M, E, d), (M, R, d).
        vectors: of the novel entities, as inserted; shape (M, n, d).
    """
    session, novel = cells.joint, torch.as_tensor(cells.novel)
    embedding = put(Embedding(*map(torch.as_tensor, theta0)), novel, torch.as_tensor(vectors))
    relation = torch.full_like(novel, cells.graph.relations.index(HAS_AFFORDANCE))
    rank = ranks_of(analogy.score_tails(embedding, novel, relation), session.entities[:, None])
    model, place, answer = torch.nonzero(rank, as_tuple=True)
    columns = {"seed": np.array(cells.seeds)[model], "entity": novel[model, place], "answer": answer}
    return pd.DataFrame(columns | {"rank": rank[model, place, answer]})


def ranks_of(scores: Tensor, candidates: Tensor) -> Tensor:
    """Rank of each candidate in its row, from 1, ties to the lower id; 0 for who is none; shapes (M, n, E)."""
    order = scores.masked_fill(~candidates, -torch.inf).sort(dim=-1, descending=True, stable=True).indices
    rank = torch.empty_like(order).scatter_(-1, order, torch.arange(1, order.shape[-1] + 1).expand_as(order))
    return rank * candidates
