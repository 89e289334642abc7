"""How far answers about an inserted entity are to be trusted: known entities are hidden, inserted as it was, and asked.

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

import isi
from isi.asking.chances import ANSWERS, ASKED, Curve, fitted
from isi.asking.model import Model
from isi.asking.placing import Placed, only
from isi.base.errors import InputError
from isi.base.streams import stream
from isi.graph import HEAD, RELATION, TAIL

#: Entities that are hidden at least, where there are as many; one in so many at once; right answers that make a curve.
LEAST, ONE_IN, RIGHT = 32, 10, 5


@dataclass(frozen=True, eq=False)
class Rehearsed:
    """A known entity that was inserted as though it were new."""

    entity: int
    vector: Tensor
    #: (relation, slot of the other end, other end) of what was told
    told: set[tuple[int, int, int]]


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """An insertion, and what it would have made of entities that are known."""

    #: with the inserted entity in it
    model: Model
    placed: Placed

    @cached_property
    def known(self) -> Model:
        """The embedding as it was before."""
        return only(self.model, np.arange(self.placed.entity))

    @cached_property
    def rehearsed(self) -> list[Rehearsed]:
        """Known entities as they would have been inserted."""
        known, rng = self.known, stream(0, "rehearsal")
        ends = np.bincount(known.kept.triples[:, [HEAD, TAIL]].flatten(), minlength=len(known.kept.entities))
        able = ends > len(self.placed.done.told)
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

    def _inserted(self, hidden: np.ndarray, rng: np.random.Generator) -> Iterator[Rehearsed]:
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
            again = isi.insert(
                kept.entities[rest], kept.relations, triples, new=len(hidden), family=self.model.family,
                known_triples=only(self.known, rest).kept.triples,
                words=None if self._words is None else self._words[order],
                kinds=[kept.kinds[row] for row in order], initializer=done.initializer, options=done.options,
            )  # fmt: skip
        except InputError:  # too few others are left to insert them among
            return
        for row, vector in zip(hidden.tolist(), again.entities[len(rest) :], strict=True):
            facts = {(r, TAIL, t) if h == row else (r, HEAD, h) for h, r, t in told[row].tolist()}
            yield Rehearsed(row, torch.from_numpy(vector.astype(np.float32)), facts)

    def _told(self, entity: int, hidden: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """As many triples of an entity with known ends as the insertion had; shape (I, 3)."""
        triples = self.known.kept.triples
        own = triples[(triples[:, HEAD] == entity) ^ (triples[:, TAIL] == entity)]
        others = np.where(own[:, HEAD] == entity, own[:, TAIL], own[:, HEAD])
        own = own[~np.isin(others, hidden)]
        chosen: np.ndarray = own[np.sort(rng.permutation(len(own))[: len(self.placed.done.told)])]
        return chosen

    def curve(self, relation: int, slot: int) -> Curve | None:
        """Of answers of a relation; of all relations where too few are right; null where those are too few, too."""
        return self._through([(relation, slot)]) or self._shared

    @cached_property
    def _shared(self) -> Curve | None:
        """Of answers of all relations."""
        relations = sorted(set(self.known.kept.triples[:, RELATION].tolist()))
        return self._through([(relation, slot) for relation in relations for slot in (HEAD, TAIL)])

    def _through(self, asked: Sequence[tuple[int, int]]) -> Curve | None:
        """The curve of some relations and slots together; null where too few answers are right."""
        parts = [part for relation, slot in asked for part in self._answers(relation, slot)]
        if not parts:
            return None
        scores, right = (torch.cat(values) for values in zip(*parts, strict=True))
        return fitted(scores, right) if RIGHT <= int(right.sum()) < len(right) else None

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
            score = theta.family.score_tails if slot == TAIL else theta.family.score_heads
            scores = score(given, row, theta.entity)[0, 0].double()
            told = {other for of, where, other in one.told if (of, where) == (relation, slot)} | {one.entity}
            asked = candidates[~torch.isin(candidates, torch.tensor(sorted(told)))]
            yield scores[asked], torch.isin(asked, torch.tensor(sorted(right)))
