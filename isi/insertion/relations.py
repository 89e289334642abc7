"""Rows of new relations: the objective of MAP (docs/method.md) with the relation of each triple as the unknown."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from isi.graph.graph import HEAD, RELATION, TAIL
from isi.initializers.evidence import SAMPLE, spread
from isi.initializers.newton import Problem, newton
from isi.models.stack import Embedding

SHRINKAGE = 0.5  #: Weight of an isotropic covariance of equal trace: there are few relations.
#: Options of MAP that a relation's row is fitted with, unless they are given.
DEFAULTS: Mapping[str, Any] = {"strength": 1.0, "ratio": 3, "known_negatives": 1.0}


def fit_relations(
    theta: Embedding, known: int, new: Tensor, triples: Tensor, known_triples: Tensor, options: Mapping[str, Any]
) -> Tensor:
    """The most probable rows of new relations given their triples; shape (q, w).

    ``theta``: one embedding whose first ``known`` relations are trained; ``new``: ids of the others to fit, (q,);
    ``triples``: (I, 3), all ends have vectors; ``known_triples``: (T, 3), whose relation is corrupted by the new one.
    """
    settings = {**DEFAULTS, **options}
    return torch.stack([
        _fit_relation(theta, known, triples[triples[:, RELATION] == relation], known_triples, **settings)
        for relation in new.tolist()
    ])  # fmt: skip


def _fit_relation(
    theta: Embedding, known: int, triples: Tensor, known_triples: Tensor, strength: float, ratio: int,
    known_negatives: float,
) -> Tensor:  # fmt: skip
    """One row, (w,): true triples, corrupted heads and tails, known triples whose relation is replaced; a prior."""
    entity, relations = theta.entity[0], theta.relation[0, :known].double()
    mean, precision = relations.mean(0), torch.linalg.inv(covariance(relations))
    if not len(triples):
        return mean.float()
    head, tail = triples[:, HEAD], triples[:, TAIL]
    ends, share = spread(torch.ones(1, len(entity), dtype=torch.float64), max(1, SAMPLE // len(triples)))
    ends, share = ends[0], share[0] / share.sum()
    number = len(ends)
    corrupted = torch.stack([
        torch.cat([head.repeat_interleave(number), ends.repeat(len(head))]),
        torch.cat([ends.repeat(len(tail)), tail.repeat_interleave(number)]),
    ])  # fmt: skip
    step = -(-len(known_triples) // SAMPLE) or 1
    others = known_triples[::step]
    given = min(1.0, len(triples) * known / max(1, len(known_triples)))  # share of the relation's triples
    weight = known_negatives * ratio * given * len(known_triples) / max(1, len(others)) / known
    pairs = torch.cat([torch.stack([head, tail]), corrupted, others[:, [HEAD, TAIL]].T], 1)
    positive = torch.zeros(pairs.shape[1], dtype=torch.float64)
    positive[: len(triples)] = 1
    negative = torch.cat([
        torch.zeros(len(triples)), ratio * share.repeat(2 * len(triples)), torch.full((len(others),), weight)
    ]).double()  # fmt: skip
    first, last = entity[pairs[0]][None], entity[pairs[1]][None]
    problem = Problem(
        positive[None], negative[None], mean[None], strength * precision[None],
        lambda rows: theta.model.score(first, rows, last), None,
    )  # fmt: skip
    if theta.model.linear:  # in the relation's row, too
        problem = Problem(**{**vars(problem), "alpha": problem.slopes(mean[None])})
    return newton(problem)[0].float()


def covariance(rows: Tensor) -> Tensor:
    """Covariance of relations' rows, (R, w), shrunk to an isotropic one by ``SHRINKAGE``; of one row: its square."""
    apart = rows - rows.mean(0) if len(rows) > 1 else rows
    full = apart.T @ apart / len(rows)
    isotropic = full.diagonal().mean().clamp(min=1e-12) * torch.eye(rows.shape[1], dtype=rows.dtype)
    return (1 - SHRINKAGE) * full + SHRINKAGE * isotropic
