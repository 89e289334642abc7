"""Chances: scores made comparable over queries.

The chance of an answer is the share of known answers among those that score as it does (Platt 1999): a logistic curve
of the score, one for each relation and slot, through all answers about entities that stand in known triples of the
relation, by entities of the kinds that do. What is true but unknown counts as wrong there.

How far answers about an inserted entity are to be trusted: known entities are hidden, inserted as it was, and asked.

Their vectors come from as many triples, and from words where it has some; their other triples are the right answers.
The vectors of the rest were learned beside them, which is all that a rehearsal knows and an insertion does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from isi.bundle.insert_entity import InsertedEntity, without_entities
from isi.bundle.query import OpenBundle
from isi.errors import InputError
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.insertion.api import insert
from isi.random import stream

#: Answers that a curve is drawn through, at most; and entities that are asked about.
ANSWERS, ASKED = 2**19, 256
#: Answers that are not known, at most, in one curve.
OTHERS = 2**14
#: Steps of Newton's method, at most, and the gain at which it stops.
STEPS, GAIN = 50, 1e-10


@dataclass(frozen=True)
class PlattCurve:
    """chance = σ(slope · score + offset)."""

    slope: float
    offset: float

    def __call__(self, scores: Tensor) -> Tensor:
        return torch.sigmoid(self.slope * scores.double() + self.offset)


def fit_curve(model: OpenBundle, relation: int, slot: int) -> PlattCurve | None:
    """The curve of a relation where one slot is asked for; null where nothing is known of the relation."""
    given = model.stands_in(relation, HEAD if slot == TAIL else TAIL)
    if not given:
        return None
    most = max(1, min(ASKED, ANSWERS // len(model.kept.entities)))
    some, candidates = given[:: -(-len(given) // most)], model.candidates(relation, slot)
    scores = model.scores(torch.tensor(some), relation, slot).double()
    known = torch.zeros(scores.shape, dtype=torch.bool)
    for row, entity in enumerate(some):
        known[row, sorted(model.answers[entity, relation, slot])] = True
    return fit_curves(scores[:, candidates].flatten(), known[:, candidates].flatten())


def fit_curves(scores: Tensor, known: Tensor) -> PlattCurve:
    """The most probable logistic curve through answers of which some are known; both of shape (N,).

    Targets are Platt's, (n₊ + 1) / (n₊ + 2) and 1 / (n₋ + 2), which keep the curve finite where scores part the known
    from the others. Of many others, evenly many over their scores stand for all.
    """
    right, others = scores[known].double(), scores[~known].double().sort().values
    number, every = len(others), -(-len(others) // OTHERS) or 1
    others = others[every // 2 :: every]
    inputs, target = torch.cat([right, others]), torch.full((len(right) + len(others),), 1 / (number + 2)).double()
    target[: len(right)] = (len(right) + 1) / (len(right) + 2)
    weight = torch.full_like(target, number / max(1, len(others)))
    weight[: len(right)] = 1.0
    centre, spread = inputs.mean(), inputs.std(correction=0).clamp(min=1e-12)
    at = _most_probable(torch.stack([(inputs - centre) / spread, torch.ones_like(inputs)], 1), target, weight)
    slope = (at[0] / spread).item()
    if slope <= 0:  # what scores higher is never less probable
        return PlattCurve(0.0, torch.logit((weight * target).sum() / weight.sum()).item())
    return PlattCurve(slope, (at[1] - at[0] * centre / spread).item())


def _most_probable(inputs: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """Coefficients of a logistic curve by Newton's method, a step halved until it gains; shapes (N, 2), (N,), (N,)."""
    at = torch.zeros(2, dtype=torch.float64)
    loss = _loss(inputs, target, weight, at)
    for _ in range(STEPS):
        likely = torch.sigmoid(inputs @ at)
        gradient = inputs.T @ (weight * (likely - target))
        bend = (inputs * (weight * likely * (1 - likely))[:, None]).T @ inputs + 1e-9 * torch.eye(2, dtype=at.dtype)
        step, share = torch.linalg.solve(bend, gradient), 1.0
        while (after := _loss(inputs, target, weight, at - share * step)) > loss and share > GAIN:
            share /= 2
        at, gain, loss = at - share * step, loss - after, after
        if gain <= GAIN * abs(loss):
            break
    return at


def _loss(inputs: Tensor, target: Tensor, weight: Tensor, at: Tensor) -> float:
    score = inputs @ at
    return (weight * (torch.nn.functional.softplus(score) - target * score)).sum().item()


#: Entities that are hidden at least, where there are as many; one in so many at once; right answers that make a curve.
LEAST, ONE_IN, RIGHT = 32, 10, 5


@dataclass(frozen=True, eq=False)
class HeldOutEntity:
    """A known entity that was inserted as though it were new."""

    entity: int
    vector: Tensor
    #: (relation, slot of the other end, other end) of what was told
    told: set[tuple[int, int, int]]


@dataclass(frozen=True, eq=False)
class HeldOutCalibration:
    """An insertion, and what it would have made of entities that are known."""

    #: with the inserted entity in it
    model: OpenBundle
    placed: InsertedEntity

    @cached_property
    def known(self) -> OpenBundle:
        """The embedding as it was before."""
        return without_entities(self.model, np.arange(self.placed.entity))

    @cached_property
    def rehearsed(self) -> list[HeldOutEntity]:
        """Known entities as they would have been inserted."""
        known, rng = self.known, stream(0, "rehearsal")
        ends = np.bincount(known.kept.triples[:, [HEAD, TAIL]].flatten(), minlength=len(known.kept.entities))
        able = ends > len(self.placed.done.insert_triples)
        if self._words is not None:
            able &= self._words.any(1)
        chosen = rng.permutation(np.flatnonzero(able))[: max(LEAST, min(ASKED, ANSWERS // len(ends)))]
        parts = -(-len(chosen) // max(1, len(ends) // ONE_IN))
        return [one for part in range(parts) for one in self._inserted(chosen[part::parts], rng)]

    @property
    def _words(self) -> np.ndarray | None:
        """Word vectors of the known, if the inserted entity had one to go by."""
        words = self.placed.model.kept.words
        return None if words is None or not words[self.placed.entity].any() else words[: self.placed.entity]

    def _inserted(self, hidden: np.ndarray, rng: np.random.Generator) -> Iterator[HeldOutEntity]:
        """Entities that are hidden together."""
        kept, done = self.known.kept, self.placed.done
        rest = np.setdiff1d(np.arange(len(kept.entities)), hidden)
        place = np.empty(len(kept.entities), dtype=np.int64)
        order = np.concatenate([rest, hidden])
        place[order] = np.arange(len(order))
        told = {row: self._told(row, hidden, rng) for row in hidden.tolist()}
        triples = np.concatenate([np.zeros((0, 3), np.int64), *told.values()])
        triples[:, [HEAD, TAIL]] = place[triples[:, [HEAD, TAIL]]]
        try:
            again = insert(
                kept.entities[rest], kept.relations, triples, new=len(hidden), model=self.model.family,
                known_triples=without_entities(self.known, rest).kept.triples,
                words=None if self._words is None else self._words[order],
                kinds=[kept.kinds[row] for row in order], initializer=done.initializer, options=done.options,
            )  # fmt: skip
        except InputError:  # too few others are left to insert them among
            return
        for row, vector in zip(hidden.tolist(), again.entities[len(rest) :], strict=True):
            facts = {(r, TAIL, t) if h == row else (r, HEAD, h) for h, r, t in told[row].tolist()}
            yield HeldOutEntity(row, torch.from_numpy(vector.astype(np.float32)), facts)

    def _told(self, entity: int, hidden: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """As many triples of an entity with known ends as the insertion had; shape (I, 3)."""
        triples = self.known.kept.triples
        own = triples[(triples[:, HEAD] == entity) ^ (triples[:, TAIL] == entity)]
        others = np.where(own[:, HEAD] == entity, own[:, TAIL], own[:, HEAD])
        own = own[~np.isin(others, hidden)]
        chosen: np.ndarray = own[np.sort(rng.permutation(len(own))[: len(self.placed.done.insert_triples)])]
        return chosen

    def curve(self, relation: int, slot: int) -> PlattCurve | None:
        """Of answers of a relation; of all relations where too few are right; null where those are too few, too."""
        return self._through([(relation, slot)]) or self._shared

    @cached_property
    def _shared(self) -> PlattCurve | None:
        """Of answers of all relations."""
        relations = sorted(set(self.known.kept.triples[:, RELATION].tolist()))
        return self._through([(relation, slot) for relation in relations for slot in (HEAD, TAIL)])

    def _through(self, asked: Sequence[tuple[int, int]]) -> PlattCurve | None:
        """The curve of some relations and slots together; null where too few answers are right."""
        parts = [part for relation, slot in asked for part in self._answers(relation, slot)]
        if not parts:
            return None
        scores, right = (torch.cat(values) for values in zip(*parts, strict=True))
        return fit_curves(scores, right) if RIGHT <= int(right.sum()) < len(right) else None

    def _answers(self, relation: int, slot: int) -> Iterator[tuple[Tensor, Tensor]]:
        """Scores of answers that were not told, and which are right, of each rehearsed entity that has some."""
        known = self.known
        theta, candidates = known.embedding, known.candidates(relation, slot)
        row = theta.relation[:, relation][:, None]
        for one in self.rehearsed:
            right = known.answers.get((one.entity, relation, slot))
            if right is None:
                continue
            given = one.vector[None, None]
            score = theta.model.score_tails if slot == TAIL else theta.model.score_heads
            scores = score(given, row, theta.entity)[0, 0].double()
            told = {other for of, where, other in one.told if (of, where) == (relation, slot)} | {one.entity}
            asked = candidates[~torch.isin(candidates, torch.tensor(sorted(told)))]
            yield scores[asked], torch.isin(asked, torch.tensor(sorted(right)))
