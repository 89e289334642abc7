"""Rows of new relations: the objective of MAP (docs/method.md) with the relation of
each triple as the unknown.
"""

from dataclasses import replace

import torch
from torch import Tensor

from isi.errors import InputError
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.initializers.evidence import SAMPLE, spread
from isi.initializers.inverses import InverseRelations, both_ways, unpack
from isi.initializers.newton import AnyScore, LinearScore, Problem, newton
from isi.initializers.scale import LOGISTIC, Scale
from isi.models.stack import Embedding

WIDEST = 4096  #: Maximum length of a row; the Hessian has the square of that in elements.
SHRINKAGE = 0.9  #: Weight of an isotropic covariance of equal trace: there are few relations.


def fit_relations(
    theta: Embedding,
    entities: int,
    relations: int,
    triples: Tensor,
    known_triples: Tensor,
    strength: float = 3.0,
    ratio: int = 1,
    known_negatives: float = 1.0,
    scale: Scale = LOGISTIC,
) -> Tensor:
    """The most probable rows of the relations of one embedding after its first ``relations``;
    shape (q, w).

    ``entities``: number of known entities; ``triples``: those of the new relations, ids, (I, 3),
    whose ends have vectors; ``known_triples``: (T, 3), whose relation is replaced by the new one;
    options as of MAP. A relation without triples gets the mean of the known relations. In the
    packed form of ``InverseRelations``, both halves of a row are fitted. ``InputError`` if rows are
    longer than ``WIDEST``.
    """
    if isinstance(theta.model, InverseRelations):
        known_triples, triples = both_ways(known_triples), both_ways(triples)
        options = strength, ratio, known_negatives, scale
        rows = fit_relations(
            unpack(theta), entities, 2 * relations, triples, known_triples, *options
        )
        return rows.view(-1, theta.relation.shape[2])
    width = theta.relation.shape[2]
    if width > WIDEST:
        expected = f"expected relations with rows of at most {WIDEST:,} numbers, got {width:,}"
        raise InputError("argument 'new_relations'", "", expected)
    rows = theta.relation[0, :relations].double()
    mean, precision = rows.mean(0), strength * torch.linalg.inv(covariance(rows))
    fitted = []
    for relation in range(relations, theta.relation.shape[1]):
        observed = triples[triples[:, RELATION] == relation]
        if not len(observed):
            fitted.append(mean)
            continue
        weight = known_negatives * ratio
        problem = _problem(theta, entities, relations, observed, known_triples, ratio, weight)
        prior = {"mean": mean[None], "precision": precision[None]}
        problem = replace(problem, **prior, slope=scale.slope, offset=scale.offset)
        if theta.model.linear:  # in the relation's row, too
            problem = replace(problem, score=LinearScore(problem.slopes(mean[None])))
        fitted.append(newton(problem)[0])
    return torch.stack(fitted).float()


def _problem(
    theta: Embedding,
    entities: int,
    relations: int,
    triples: Tensor,
    known_triples: Tensor,
    ratio: int,
    weight: float,
) -> Problem:
    """One relation's true triples, their corrupted heads and tails,
    and known triples with this relation; no prior.
    """
    head, tail = triples[:, HEAD], triples[:, TAIL]
    ends, share = spread(
        torch.ones(1, entities, dtype=torch.float64), max(1, SAMPLE // max(1, len(triples)))
    )
    number, each = ends.shape[1], ratio * share[0] / entities
    others = known_triples[:: -(-len(known_triples) // SAMPLE) or 1]
    pairs = torch.cat(
        [
            torch.stack([head, tail]),
            torch.stack([head.repeat_interleave(number), ends[0].repeat(len(head))]),
            torch.stack([ends[0].repeat(len(tail)), tail.repeat_interleave(number)]),
            others[:, [HEAD, TAIL]].T,
        ],
        1,
    )
    # s: share of its triples that is given
    complete = min(1.0, len(triples) * relations / max(1, len(known_triples)))
    of_known = complete * weight / relations * len(known_triples) / max(1, len(others))
    negative = torch.cat(
        [
            torch.zeros(len(triples)),
            each.repeat(2 * len(triples)),
            torch.full((len(others),), of_known),
        ]
    ).double()
    positive = torch.zeros_like(negative)
    positive[: len(triples)] = 1
    first, last = theta.entity[0][pairs][:, None]
    none = torch.empty(0)
    score = AnyScore(lambda row: theta.model.score(first, row, last), pairs.shape[1])
    return Problem(positive[None], negative[None], none, none, score)


def covariance(rows: Tensor) -> Tensor:
    """Covariance of relations' rows, (R, w), shrunk to an isotropic one by ``SHRINKAGE``;
    of one row: its square.
    """
    apart = rows - rows.mean(0) if len(rows) > 1 else rows
    full = apart.T @ apart / len(rows)
    isotropic = full.diagonal().mean().clamp(min=1e-12) * torch.eye(rows.shape[1], dtype=rows.dtype)
    return (1 - SHRINKAGE) * full + SHRINKAGE * isotropic
