"""Ranked answers to a query, each with its calibrated probability: link prediction."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import torch

from isi.bundle.calibration import HeldOutCalibration, fit_curve
from isi.bundle.query import OpenBundle, Query


@dataclass(frozen=True)
class Answer:
    """A predicted answer."""

    entity: str
    #: from 1, among the candidates
    rank: int
    score: float
    #: calibrated probability (see ``calibration``); null where too little is known
    probability: float | None
    #: share of the other candidates that score lower, from 0 to 1
    percentile: float
    known: bool
    #: the indicators that are known to have this answer; null where there are no indicators
    shared_by: list[str] | None


def answer(
    opened: OpenBundle, query: Query, most: int, held_out: HeldOutCalibration | None = None,
    indicators: Collection[int] | None = None,
) -> list[Answer]:  # fmt: skip
    """The best answers, best first; of equal scores, the entity of lower id goes first.

    Args:
        most: answers, at most.
        held_out: of an inserted entity, which calibrates queries about it.
        indicators: ids of entities whose known answers are compared.
    """
    entities, scores = opened.ranked(query)
    shown, relation, slot = scores[:most], query.relation, query.slot
    below = torch.searchsorted(scores.flip(0), shown).tolist()
    is_inserted = held_out is not None and query.given == held_out.inserted.entity
    curve = held_out.curve(relation, slot) if held_out and is_inserted else fit_curve(opened, relation, slot)
    probabilities = [None] * len(shown) if curve is None else curve(shown).tolist()
    names, known_answers = opened.bundle.entity_names, opened.answers
    known = known_answers.get((query.given, relation, slot), ())
    return [
        Answer(
            names[entity], rank, score, probability, lower / max(1, len(scores) - 1), entity in known,
            None if indicators is None else [
                names[row] for row in indicators if entity in known_answers.get((row, relation, slot), ())
            ],
        )
        for rank, (entity, score, probability, lower)
        in enumerate(zip(entities[:most].tolist(), shown.tolist(), probabilities, below, strict=True), 1)
    ]  # fmt: skip
