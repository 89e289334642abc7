"""RS without dead coordinates: what a relation's map no longer tells anything of takes no part (a control)."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.linalg import vector_norm

from isi.base.params import Count
from isi.embeddings.stack import Embedding
from isi.initializers import initializer
from isi.insertion.core import NONE, Initial, Insertion
from isi.insertion.similarity import first_that_can, has_insert_triples, relational_score, resultants, top_k

#: A map that stretches a coordinate by less is dead there: from here on down ``inverse`` would blow up what is left.
DEAD = 1e-3


@initializer("rs_alive", label="RS, alive coordinates", role="control", colour="#7fb8a4")
def relational_similarity_alive(insertion: Insertion, k: Count) -> Initial:
    """RS from α that are zero in the coordinates in which their relation's map is dead."""
    models = torch.arange(len(insertion.novel))[:, None, None]
    alpha = resultants(insertion) * alive(insertion.theta0)[models, insertion.relation]
    chosen = top_k(relational_score(insertion, alpha), insertion.eligible[:, None], k)
    return first_that_can(insertion, (NONE, has_insert_triples(insertion), chosen))


def alive(theta0: Embedding) -> Tensor:
    """Whether the map of each relation stretches each coordinate to at least ``DEAD``; shape (M, R, d), bool."""
    relation, axes = theta0.relation[:, :, None], torch.eye(theta0.entity.shape[-1])
    taken = theta0.family.transform(axes, relation) - theta0.family.transform(torch.zeros_like(axes), relation)
    stretch: Tensor = vector_norm(taken, dim=-1)
    return stretch >= DEAD
