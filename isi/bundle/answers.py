"""Ranked answers to a question about an entity and a relation."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import partial

import torch
from torch import Tensor

from isi.bundle.calibration import HeldOutCalibration, PlattCurve, fit_curve
from isi.bundle.query import OpenBundle
from isi.graph.graph import HEAD, TAIL

#: Share of the indicators that must stand in a slot for it to be asked of.
ENOUGH = 0.1
#: Questions that are asked at once, at most.
MOST = 24


@dataclass(frozen=True)
class Question:
    """(given, relation, ?) where the slot is ``TAIL``, (?, relation, given) where it is ``HEAD``; ids."""

    given: int
    relation: int
    slot: int


@dataclass(frozen=True)
class Answer:
    """An answer and how good it is."""

    entity: str
    #: among the entities that may answer (``Model.candidates``), but for the given one, unless it is known to
    rank: int
    score: float
    #: see ``chances``, of an inserted entity ``rehearsing``; null where too little is known
    chance: float | None
    #: share of the others that score lower
    beats: float
    known: bool
    #: the indicators that are known to have this answer; null where there are no indicators
    had_by: list[str] | None


def ranked(model: OpenBundle, question: Question) -> tuple[Tensor, Tensor]:
    """The entities that may answer, best first, and their scores."""
    given, relation, slot = question.given, question.relation, question.slot
    scores, candidates = model.scores(torch.tensor([given]), relation, slot)[0], model.candidates(relation, slot)
    if given not in model.answers.get((given, relation, slot), ()):
        candidates = candidates[candidates != given]
    best = scores[candidates].sort(descending=True, stable=True)
    return candidates[best.indices], best.values


@dataclass
class Asker:
    """Asks a model, and keeps the curves of relations that it was asked about."""

    model: OpenBundle
    #: of an inserted entity, which tells how far answers about that are to be trusted
    rehearsal: HeldOutCalibration | None = None
    _curves: dict[tuple[bool, int, int], PlattCurve | None] = field(default_factory=dict)

    def ask(self, question: Question, most: int, indicators: Collection[int] | None = None) -> list[Answer]:
        """The best answers, best first; of equal scores, the entity that stands first goes first.

        Args:
            most: answers, at most.
            indicators: ids of entities whose known answers are looked at, too.
        """
        entities, scores = ranked(self.model, question)
        shown, relation, slot = scores[:most], question.relation, question.slot
        beaten = torch.searchsorted(scores.flip(0), shown).tolist()
        curve = self._curve(question)
        chances = [None] * len(shown) if curve is None else curve(shown).tolist()
        names, answers = self.model.kept.entity_names, self.model.answers
        known = answers.get((question.given, relation, slot), ())
        return [
            Answer(
                names[entity], rank, score, chance, below / max(1, len(scores) - 1), entity in known,
                None if indicators is None else [names[one] for one in indicators
                                                 if entity in answers.get((one, relation, slot), ())],
            )
            for rank, (entity, score, chance, below)
            in enumerate(zip(entities[:most].tolist(), shown.tolist(), chances, beaten, strict=True), 1)
        ]  # fmt: skip

    def _curve(self, question: Question) -> PlattCurve | None:
        rehearsed = self.rehearsal is not None and question.given == self.rehearsal.placed.entity
        key = rehearsed, question.relation, question.slot
        if key not in self._curves:
            curve = self.rehearsal.curve if self.rehearsal and rehearsed else partial(fit_curve, self.model)
            self._curves[key] = curve(question.relation, question.slot)
        return self._curves[key]


def worth_asking(model: OpenBundle, entity: int, indicators: Mapping[int, float], most: int = MOST) -> list[Question]:
    """What to ask of an entity: each relation, by the slots in which it, or enough of its like, stand in known triples.

    Where nothing is known of any of them, all. Of many, those in which it stands, then those in which most of its
    like do.

    Args:
        indicators: by id, what each weighs: its like, where its kind is not known.
        most: questions, at most.
    """
    kinds = model.kept.kinds
    like = {row: 1.0 for row, kind in enumerate(kinds) if kind == kinds[entity]} if kinds[entity] else indicators
    enough = ENOUGH * sum(like.values()) if like is indicators else 0

    def weight(one: Question) -> float:
        if (entity, one.relation, one.slot) in model.answers:
            return float("inf")
        return sum(own for who, own in like.items() if (who, one.relation, one.slot) in model.answers)

    asked = [Question(entity, relation, slot) for relation in range(len(model.kept.relations)) for slot in (TAIL, HEAD)]
    fit = [one for one in asked if weight(one) > enough] or asked
    best = sorted(fit, key=weight, reverse=True)[:most]
    return [one for one in fit if one in best]
