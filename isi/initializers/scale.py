"""The scale of an embedding's scores: how a score becomes the log odds of its triple.

The objective of MAP (``isi.initializers.newton``) weighs facts against corrupted triples by log
odds. Training decides what these are: with logistic loss a score is the log odds; a margin leaves
the slope and the border open, and both are fitted; with cross-entropy over all entities, the border
of a query (h, r, ?) is log Z, the log of the sum of exp(score) over all answers, since
softplus(log Z - f) is the loss of an answer with score f.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import softplus

from isi.config import LARGEST
from isi.evaluation.platt import fit_platt
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.models.losses import Loss, TrainingLoss, loss_named
from isi.models.stack import Embedding
from isi.random import stream

#: Maximum number of known triples, evenly spaced by row, to which a scale is fitted.
TRIPLES = 2**12
#: Maximum number of queries with known answers.
QUERIES = 2**16
FEW = 2**8  #: Maximum number of queries for the mean of log Z.
BUDGET = 2**24  #: Maximum number of scores in one table.


@dataclass(frozen=True)
class Scale:
    """Log odds of a triple = slope · score + offset; with ``softmax``, score - log Z of its query.

    Example:
        >>> Scale(TrainingLoss("logistic")).offset
        0.0
    """

    training: TrainingLoss = field(default_factory=TrainingLoss)
    slope: float = 1.0
    offset: float = 0.0  #: with ``softmax``: - mean log Z of known queries, which serves as a guess
    #: mean log loss (nats) of known triples and their corruptions, which count alike; log 2 by
    #: chance; None: not fitted
    log_loss: float | None = None

    @property
    def loss(self) -> Loss:
        return self.training.name

    @property
    def by_query(self) -> bool:
        """Whether each query has an offset of its own."""
        return self.loss == "softmax"


LOGISTIC = Scale()  #: The scale of the pipeline's training, and of ``isi train``.


def fit_scale(theta: Embedding, triples: Tensor, loss: Loss | TrainingLoss) -> Scale:
    """The scale of one embedding that was trained with a loss on ``triples``, (T, 3).

    Each triple is corrupted twice, by another head and by another tail. Known triples and
    corruptions weigh the same.
    """
    training = loss_named(loss)
    if training == TrainingLoss("logistic") or len(triples) < 2:
        return Scale(training)  # nothing to fit, or nothing to fit it to
    right, wrong = _known_and_corrupted(theta, triples)
    if training.name == "softmax":
        head, relation, _ = triples[:: -(-len(triples) // FEW)].T[:, None]
        known = torch.ones(theta.entity.shape[:2], dtype=torch.bool)
        is_tail = torch.ones_like(head, dtype=torch.bool)
        offset = -log_partition(theta, known, is_tail, relation, head).mean().item()
        return Scale(training, 1.0, offset, _log_loss(right + offset, wrong + offset))
    scores = torch.cat([right.repeat(2), wrong])  # so that both sides weigh the same
    is_known = torch.arange(len(scores)) < 2 * len(right)
    curve = fit_platt(scores, is_known)
    odds = (curve.slope * part + curve.offset for part in (right, wrong))
    return Scale(training, curve.slope, curve.offset, _log_loss(*odds))


class QueryList(NamedTuple):
    """K queries with known answers."""

    novel_is_tail: Tensor  #: whether the tail is asked for; shape: (K,), bool
    relation: Tensor  #: ids; shape: (K,)
    given: Tensor  #: ids of the given ends; shape: (K,)
    answers: Tensor  #: number of known answers; of a sample, scaled up; shape: (M, K), float64
    #: log Σ exp(score) over the known answers, which have nearly all of Z after training; shape:
    #: (M, K), float64
    log_z: Tensor


@dataclass(frozen=True, eq=False)
class KnownQueries:
    """The queries of training triples, which a novel entity may answer wrongly.

    They are listed on first use. Of more than ``QUERIES``, those at even distances stand for all.
    """

    theta: Embedding
    triples: Tensor = field(metadata={"shared": True})  #: shape: (T, 3)
    trained: Tensor  #: which of them are of training; shape: (M, T), bool
    #: whether training asked for tails alone, as with inverse relations
    tails_only: bool

    @cached_property
    def unique(self) -> QueryList:
        """The K queries, sorted: first (?, relation, given), then (given, relation, ?)."""
        (models, entities, _), relations = self.theta.entity.shape, self.theta.relation.shape[1]
        head, relation, tail = (self.triples[:, slot] for slot in (HEAD, RELATION, TAIL))
        keys = (relations + relation) * entities + head
        if not self.tails_only:
            keys = torch.cat([relation * entities + tail, keys])
        ways = len(keys) // max(1, len(self.triples))
        key, place = torch.unique(keys, return_inverse=True)
        answers = torch.zeros(models, len(key), dtype=torch.float64)
        answers.index_add_(1, place, self.trained.double().repeat(1, ways))
        scores = self._scores().masked_fill(~self.trained, -torch.inf).repeat(1, ways)
        index = place.expand(models, -1)
        low = torch.full(answers.shape, -LARGEST, dtype=torch.float64)
        highest = low.scatter_reduce(1, index, scores, "amax")
        total = torch.zeros_like(answers)
        total.scatter_add_(1, index, (scores - highest.gather(1, index)).exp())
        step = -(-len(key) // QUERIES) or 1
        number, log_z = answers[:, ::step], (highest + total.log())[:, ::step]
        number = number * (answers.sum(1) / number.sum(1).clamp(min=1))[:, None]
        slot, given = key[::step] // entities, key[::step] % entities
        log_z = log_z.clamp(min=-LARGEST)
        return QueryList(slot >= relations, slot % relations, given, number, log_z)

    def _scores(self) -> Tensor:
        """Scores of the triples, (M, T), float64, in parts within ``BUDGET``."""
        models, _, dimension = self.theta.entity.shape
        parts = torch.split(self.triples, max(1, BUDGET // (models * dimension)))
        scores = [self.theta.score(*part.T[:, None].expand(-1, models, -1)) for part in parts]
        return torch.cat([torch.zeros(models, 0), *scores], 1).double()


def log_partition(
    theta: Embedding, known: Tensor, novel_is_tail: Tensor, relation: Tensor, other: Tensor
) -> Tensor:
    """log Z of queries, over the entities of a mask, (M, E), as answers; ids of shape (M, Q), of
    queries as in ``KnownQueries``; result (M, Q), float64.
    """
    log_z = torch.zeros(relation.shape, dtype=torch.float64)
    for part, is_tail in parts_of_sides(novel_is_tail, known.numel()):
        ids = other.gather(1, part), relation.gather(1, part)
        scores = theta.score_tails(*ids) if is_tail else theta.score_heads(*ids[::-1])
        total = scores.masked_fill(~known[:, None], -torch.inf).logsumexp(-1).double()
        of_side = novel_is_tail.gather(1, part) == is_tail
        log_z.scatter_(1, part, torch.where(of_side, total, log_z.gather(1, part)))
    return log_z


def parts_of_sides(is_tail: Tensor, width: int) -> Iterator[tuple[Tensor, bool]]:
    """Places, (M, ≤ Q), of all queries of each side, (M, Q), in parts of which a table with
    ``width`` numbers for each query of a model is within ``BUDGET``; where models differ in their
    number of queries, a part has some of the other side, too.
    """
    for side in (False, True):
        of_side = is_tail == side
        if not of_side.any():
            continue
        first = torch.argsort(~of_side, stable=True)[:, : int(of_side.sum(1).max())]
        for part in torch.split(first, max(1, BUDGET // width), 1):
            yield part, side


def _known_and_corrupted(theta: Embedding, triples: Tensor) -> tuple[Tensor, Tensor]:
    """Scores of known triples, (T,), and of their corruptions, (2T,): with a random head, then
    with a random tail, perhaps the true one, as training and MAP corrupt them.
    """
    entities = theta.entity.shape[1]
    chosen = triples[:: -(-len(triples) // TRIPLES)]
    other = stream(0, "corrupted triples of a scale").integers(entities, size=2 * len(chosen))
    ends = torch.from_numpy(other)
    corrupted = chosen.repeat(2, 1)
    corrupted[: len(chosen), HEAD] = ends[: len(chosen)]
    corrupted[len(chosen) :, TAIL] = ends[len(chosen) :]
    scores = theta.score(*torch.cat([chosen, corrupted]).T[:, None])[0].double()
    return scores[: len(chosen)], scores[len(chosen) :]


def _log_loss(right: Tensor, wrong: Tensor) -> float:
    """Mean log loss of log odds, of which ``right`` and ``wrong`` ones weigh the same."""
    return (softplus(-right).mean() + softplus(wrong).mean()).item() / 2
