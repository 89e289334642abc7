"""Ranked answers to a query, each with a calibrated probability,
which is comparable between queries.

The probability estimates the share of known answers among answers of equal score (Platt 1999): a
logistic curve of the score. For a known entity of a home that was trained here, the curves are
fitted to answers that a model has not seen (``isi.home.calibration``); of an imported one, to known
triples, which flatters them. For an inserted entity, they are fitted to hidden known entities that
were inserted in the same way (``isi.insertion.probability``). A true but unknown answer counts as
wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from isi.evaluation.platt import PlattCurve, fit_platt
from isi.graph.graph import HEAD, TAIL
from isi.home.bundle import Fact
from isi.home.loaded import LoadedEmbedding, Query, answers_in, best_first

#: Least probability of an answer that is stated as one. With it, four in five of the best answers
#: about hidden objects of AI2-THOR were right (docs/command.md).
LIKELY = 0.3
#: Fewest facts of an entity that counts as well known.
FEW = 5
#: What is known of a query and of the entity it is about: no answer; answers, but few facts of the
#: entity; and many.
STATES = NO_ANSWER, FEW_FACTS, MANY_FACTS = "0", "1", str(FEW)
#: Maximum number of answers and of queried entities per curve.
MOST_ANSWERS, MOST_ENTITIES = 2**19, 256


@dataclass(frozen=True)
class Answer:
    """A known or predicted answer: an entity, or a relation."""

    entity: str  #: or the relation that is asked for
    rank: int  #: of its score among the candidates, from 1
    score: float
    #: of a known answer: how far its fact is believed; else calibrated, None without a curve
    probability: float | None
    given: bool  #: whether it makes a fact that was added after training
    known: bool  #: whether it makes a known triple, given or trained on
    inserted: bool  #: whether it is an inserted entity


@dataclass(frozen=True)
class Answers:
    """The best answers to a query: first known ones, of these first given ones,
    then predictions by their score.
    """

    query: Fact  #: names, with ``?`` in place of the answer
    answers: list[Answer]
    notes: list[str] = field(default_factory=list)  #: which known name a name was taken for

    @property
    def sure(self) -> bool:
        """Whether an answer is known, or its probability is at least ``LIKELY``;
        true without probabilities.
        """
        return any(
            best.known or best.probability is None or best.probability >= LIKELY
            for best in self.answers
        )


Curve = Callable[[np.ndarray], np.ndarray]  #: From scores, (N,), to probabilities.


def answer(
    opened: LoadedEmbedding,
    query: Query,
    most: int,
    curve: Curve | None,
    *,
    new: bool = False,
    among: Collection[int] | None = None,
) -> Answers:
    """The ``most`` best answers.

    ``new``: without what is known; ``among``: ids of the candidates, if they are named.
    """
    rows, scores = opened.ranked(query, among)
    names = opened.entity_names
    known = np.isin(rows, list(opened.answers(query)))
    added = opened.triples[len(opened.triples) - opened.added :]
    is_added = np.isin(rows, list(answers_in(added, query)))
    usual = opened.candidates(query.relation, HEAD + TAIL - query.slot)
    if query.given not in usual and not known.any():
        curve = np.zeros_like  # no known triple asks this of its kind
    order = np.lexsort([~known, ~is_added])
    order = order[~known[order]][:most] if new else order[:most]
    probabilities = _probabilities(curve, scores[order])
    best_answers = list[Answer]()
    for place, probability in zip(order.tolist(), probabilities, strict=True):
        row = int(rows[place])
        best = Answer(
            entity=names[row],
            rank=place + 1,
            score=scores[place].item(),
            probability=opened.belief(query, row) if known[place] else probability,
            given=bool(is_added[place]),
            known=bool(known[place]),
            inserted=row >= len(names) - opened.inserted,
        )
        best_answers.append(best)
    return Answers(opened.named(query), best_answers)


def answer_relation(
    opened: LoadedEmbedding,
    head: int,
    tail: int,
    most: int,
    curve_of: Callable[[int], Curve | None],
    new: bool = False,
) -> Answers:
    """The relations between two entities: known ones (unless ``new``), then the most probable.
    Kinds that do not fit: probability 0.
    """
    added = opened.triples[len(opened.triples) - opened.added :]
    names, labels = opened.entity_names, opened.relation_names
    scores = opened.scores.relations(head, tail)
    rows = []
    for place, relation in enumerate(best_first(scores).tolist()):
        if tail in answers_in(opened.retracted, Query(head, relation, TAIL)):
            continue
        fits = tail in opened.candidates(relation, TAIL) and head in opened.candidates(
            relation, HEAD
        )
        (probability,) = _probabilities(curve_of(relation), scores[[relation]]) if fits else [0.0]
        query = Query(head, relation, TAIL)
        known = tail in opened.answers(query)
        if known:
            probability = opened.belief(query, tail)
        if known and new:
            continue
        is_added = tail in answers_in(added, query)
        score = scores[relation].item()
        rows.append(Answer(labels[relation], place + 1, score, probability, is_added, known, False))
    rows.sort(key=lambda row: (not row.given, not row.known, -(row.probability or 0.0)))
    return Answers((names[head], "?", names[tail]), rows[:most])


def _probabilities(curve: Curve | None, scores: np.ndarray) -> list[Any]:
    return [None] * len(scores) if curve is None else curve(scores).tolist()


def state_of(facts: int, has_answers: bool) -> str:
    """Which of ``STATES`` a query is in; ``facts``: number of the facts of its entity."""
    if not has_answers:
        return NO_ANSWER
    return MANY_FACTS if facts >= FEW else FEW_FACTS


def fit_curve(opened: LoadedEmbedding, relation: int, slot: int) -> PlattCurve | None:
    """The curve for a relation and the slot of the answer, from known triples;
    None if the relation has none.
    """
    entities = opened.in_slot(relation, HEAD if slot == TAIL else TAIL)
    if not entities:
        return None
    most = max(1, min(MOST_ENTITIES, MOST_ANSWERS // len(opened.entities)))
    sample, candidates = entities[:: -(-len(entities) // most)], opened.candidates(relation, slot)
    score = opened.scores.tails if slot == TAIL else opened.scores.heads
    scores = score(np.array(sample), relation)[:, candidates]
    known = [opened.answers(Query(entity, relation, slot)) for entity in sample]
    is_known = [np.isin(candidates, list(answers)) for answers in known]
    return fit_platt(scores.ravel(), np.concatenate(is_known))
