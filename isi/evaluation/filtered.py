"""Filtered ranks of the heads and tails of triples, against any vectors as candidates.

``ranking`` ranks the query sets of the experiments, with relations and MRR*.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from isi.evaluation.ranks import ahead, parts, scores_of
from isi.graph.graph import HEAD, TAIL, Graph
from isi.models.stack import Embedding, rows


@dataclass(frozen=True)
class EndQueries:
    """Triples of a stack whose head and tail are queried;
    a first axis of size 2 is for heads, then tails.
    """

    triples: Tensor  #: ids of head, relation and tail; shape: (M, Q, 3)
    counted: Tensor  #: false for padding; shape: (M, Q), bool
    right: Tensor  #: right answers, which are no competitors; shape: (2, M, Q, E), bool

    @property
    def answers(self) -> Tensor:
        """Ids; shape (2, M, Q)."""
        return self.triples[..., [HEAD, TAIL]].movedim(-1, 0)

    def scores(self, theta: Embedding, candidates: Tensor) -> Tensor:
        """Scores of vectors (M, C, d) as heads, then as tails; shape (2, M, Q, C)."""
        head, relation, tail = self.triples.unbind(-1)
        relations = rows(theta.relation, relation)
        as_heads = theta.model.score_heads(rows(theta.entity, tail), relations, candidates)
        as_tails = theta.model.score_tails(rows(theta.entity, head), relations, candidates)
        return torch.stack([as_heads, as_tails])

    def right_scores(self, theta: Embedding) -> Tensor:
        """Score of each triple, for its head and its tail alike; shape (2, M, Q)."""
        return theta.score(*self.triples.unbind(-1)).expand(2, -1, -1)

    def ranks(self, scores: Tensor) -> Tensor:
        """Filtered ranks of the answers among the first C entities by their scores,
        (2, M, Q, C); shape (2, M, Q).
        """
        wrong = ~self.right[..., : scores.shape[-1]]
        return 1 + ahead(scores, scores_of(self.answers, scores), wrong)


def end_queries(graph: Graph, ids: Tensor) -> EndQueries:
    """The queries of triples, ids (M, Q), padded with -1; every triple of the graph is right."""
    padded = ids.clamp(min=0)
    right = torch.zeros(2, *ids.shape, len(graph.entities), dtype=torch.bool)
    for slot, mask in zip((HEAD, TAIL), right, strict=True):
        alike = graph.same_but(slot, padded)
        alike = torch.where(alike < 0, padded[..., None], alike)
        mask.scatter_(-1, graph.triples[:, slot][alike], True)
    return EndQueries(graph.triples[padded], ids >= 0, right)


def end_ranks(theta: Embedding, graph: Graph, ids: Tensor) -> Tensor:
    """Ranks of the heads, then of the tails, of a graph's triples ``ids``, (Q,), among all entities
    of one embedding; shape (2, Q), float64.

    Filtered by the graph's triples, and realistic: a tie counts ½.
    """
    ranks = [torch.zeros(2, 0, dtype=torch.float64)]
    for part in parts(ids, 2 * theta.entity.shape[1]) if len(ids) else ():
        queries = end_queries(graph, part[None])
        ranks.append(queries.ranks(queries.scores(theta, theta.entity))[:, 0].double())
    return torch.cat(ranks, 1)


def random_ranks(wrong: Tensor, queries: EndQueries) -> Tensor:
    """Expected reciprocal rank of each answer beside C - 1 ``wrong`` candidates:
    (1 + 1/2 + … + 1/C) / C.
    """
    number = (wrong.sum(-1) + 1)[:, queries.counted].double().flatten()
    return (torch.digamma(number + 1) + np.euler_gamma) / number
