"""Ranked answers to a query, each with a calibrated probability, which is comparable between queries.

The probability estimates the share of known answers among answers of equal score (Platt 1999): a logistic curve of the
score, one per relation and slot. For a known entity, the curve is fitted to the candidate answers to queries about
the entities (or a sample of them) in known triples of the relation. A true but unknown answer counts as wrong.

For an inserted entity the calibration is held out: known entities are hidden, inserted with the same initializer from
at most as many triples (and words, if the entity has some), and queried; their other triples are the right answers.
The other vectors were trained together with the hidden entities, so these probabilities are slightly optimistic.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from isi.bundle.insert import before
from isi.bundle.query import OpenBundle, Query
from isi.errors import InputError
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.insertion.api import insert
from isi.insertion.platt import LEAST_RIGHT, PlattCurve, fit_platt
from isi.insertion.result import Inserted
from isi.random import stream

LIKELY = 0.2  #: Least probability of an unexpected answer.
MOST_ANSWERS, MOST_ENTITIES = 2**19, 256  #: Maximum number of answers and of queried entities per curve.
LEAST_HIDDEN, ONE_IN = 32, 10  #: Hidden entities: least number, if enough suit; at most one in so many at a time.


@dataclass(frozen=True)
class Answer:
    """A predicted answer."""

    entity: str
    rank: int  #: from 1, among the candidates
    score: float
    probability: float | None  #: calibrated; null without a curve
    percentile: float  #: share of the other candidates that score lower, from 0 to 1
    known: bool
    shared_by: list[str] | None  #: indicators with this known answer; null if no indicators were given

    @property
    def unexpected(self) -> bool:
        """Whether it is probable (no curve: rank 1), not ``known``, and ``shared_by`` is an empty list, not null."""
        likely = self.rank == 1 if self.probability is None else self.probability >= LIKELY
        return likely and not self.known and self.shared_by == []


def answer(
    opened: OpenBundle, query: Query, most: int, held_out: HeldOutCalibration | None = None,
    indicators: Collection[int] | None = None,
) -> list[Answer]:  # fmt: skip
    """The ``most`` best answers. ``held_out`` calibrates queries about the entity that it was made for."""
    entities, scores = opened.ranked(query)
    shown, names = scores[:most], opened.entity_names
    lower = torch.searchsorted(scores.flip(0), shown).tolist()
    fit = held_out.curve if held_out and [query.given] == held_out.result.new else partial(fit_curve, opened)
    curve = fit(query.relation, query.slot)
    probabilities = [None] * len(shown) if curve is None else curve(shown).tolist()

    def having(entity: int, given: Iterable[int]) -> list[str]:
        return [names[row] for row in given if entity in opened.answers.get(query._replace(given=row), ())]

    return [
        Answer(
            names[entity], rank, score, probability, below / max(1, len(scores) - 1),
            bool(having(entity, [query.given])), None if indicators is None else having(entity, indicators),
        )
        for rank, (entity, score, probability, below) in enumerate(
            zip(entities[:most].tolist(), shown.tolist(), probabilities, lower, strict=True), 1
        )
    ]  # fmt: skip


def calibrated_on(answers: Iterable[Answer], inserted: bool) -> str | None:
    """The data of the calibration; null if any answer has no probability."""
    all_have = all(best.probability is not None for best in answers)
    return ("held-out entities" if inserted else "known triples") if all_have else None


def fit_curve(opened: OpenBundle, relation: int, slot: int) -> PlattCurve | None:
    """The curve for a relation and the slot of the answer, from known triples; null if the relation has none."""
    given = opened.in_slot(relation, HEAD if slot == TAIL else TAIL)
    if not given:
        return None
    most = max(1, min(MOST_ENTITIES, MOST_ANSWERS // len(opened.entities)))
    sample, candidates = given[:: -(-len(given) // most)], opened.candidates(relation, slot)
    scores = opened.scores(torch.tensor(sample), relation, slot)[:, candidates].double()
    answers = [torch.tensor(sorted(opened.answers[Query(entity, relation, slot)])) for entity in sample]
    return fit_platt(scores.flatten(), torch.cat([torch.isin(candidates, known) for known in answers]))


class HeldOutEntity(NamedTuple):
    """A known entity that was hidden and inserted: id, inserted vector, and insert triples as ids, (I, 3)."""

    entity: int
    vector: Tensor
    insert_triples: np.ndarray


@dataclass(frozen=True, eq=False)
class HeldOutCalibration:
    """Calibrates answers about an inserted entity on known entities, hidden and inserted in the same way."""

    opened: OpenBundle  #: with the inserted entity in its last row
    result: Inserted

    @cached_property
    def known(self) -> OpenBundle:
        """The bundle before the insertion. It has no word vectors if the inserted entity has none."""
        known, new = before(self.opened, self.opened.manifest.inserted[-1])
        return known if new.vector is not None else replace(known, words=None)

    @cached_property
    def held_out(self) -> list[HeldOutEntity]:
        """The known entities that were hidden and inserted."""
        rng, known = stream(0, "rehearsal"), self.known
        degree = np.bincount(known.triples[:, [HEAD, TAIL]].flatten(), minlength=len(known.entities))
        suitable = degree > len(self.result.insert_triples)
        if known.words is not None:
            suitable &= known.words.any(1)
        number = max(LEAST_HIDDEN, min(MOST_ENTITIES, MOST_ANSWERS // len(degree)))
        chosen = rng.permutation(np.flatnonzero(suitable))[:number]
        parts = -(-len(chosen) // max(1, len(degree) // ONE_IN))
        return [entity for part in range(parts) for entity in self._hide(chosen[part::parts], rng)]

    def _hide(self, hidden: np.ndarray, rng: np.random.Generator) -> Iterator[HeldOutEntity]:
        """Hide entities together, and insert each from at most as many triples as the inserted entity has."""
        known, result = self.known, self.result
        rest = np.setdiff1d(np.arange(len(known.entities)), hidden)
        order = np.concatenate([rest, hidden])
        triples, given = known.triples[np.isin(known.triples[:, [HEAD, TAIL]], hidden).sum(1) == 1], []
        for row in hidden:
            touching = triples[(triples[:, [HEAD, TAIL]] == row).any(1)]
            given.append(touching[np.sort(rng.permutation(len(touching))[: len(result.insert_triples)])])
        triples = np.concatenate(given)
        triples[:, [HEAD, TAIL]] = np.argsort(order)[triples[:, [HEAD, TAIL]]]
        try:
            again = insert(
                known.entities[rest], known.relations, triples, new=len(hidden), model=known.model,
                known_triples=known.part(rest).triples, words=None if known.words is None else known.words[order],
                kinds=[known.kinds[row] for row in order], initializer=result.initializer, options=result.options,
            )  # fmt: skip
        except InputError:  # too few entities are left
            return
        for row, insert_triples, vector in zip(hidden.tolist(), given, again.entities[len(rest) :], strict=True):
            yield HeldOutEntity(row, torch.from_numpy(vector.astype(np.float32)), insert_triples)

    def curve(self, relation: int, slot: int) -> PlattCurve | None:
        """The curve of a relation and slot; with too few right answers, the curve of all relations, or null."""
        return self._fit([(relation, slot)]) or self._shared

    @cached_property
    def _shared(self) -> PlattCurve | None:
        """The curve of all relations and slots."""
        relations = sorted(set(self.known.triples[:, RELATION].tolist()))
        return self._fit([(relation, slot) for relation in relations for slot in (HEAD, TAIL)])

    def _fit(self, slots: Sequence[tuple[int, int]]) -> PlattCurve | None:
        """One curve for all ``slots`` (without insert triples); null with too few right answers or no wrong one."""
        theta, scores, right = self.known.embedding, [torch.zeros(0).double()], [torch.zeros(0, dtype=torch.bool)]
        for relation, slot in slots:
            candidates, row = self.known.candidates(relation, slot), theta.relation[:, relation][:, None]
            score = theta.model.score_tails if slot == TAIL else theta.model.score_heads
            for entity, vector, given in self.held_out:
                if known := self.known.answers.get(Query(entity, relation, slot)):
                    shown = given[(given[:, RELATION] == relation) & (given[:, HEAD + TAIL - slot] == entity), slot]
                    answers = candidates[~torch.isin(candidates, torch.tensor([entity, *shown]))]
                    scores.append(score(vector[None, None], row, theta.entity)[0, 0].double()[answers])
                    right.append(torch.isin(answers, torch.tensor(sorted(known))))
        is_right = torch.cat(right)
        few = not LEAST_RIGHT <= int(is_right.sum()) < len(is_right)
        return None if few else fit_platt(torch.cat(scores), is_right)
