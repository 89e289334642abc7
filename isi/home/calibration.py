"""Curves from scores to probabilities (Platt 1999) of a home that was trained here, fitted to
answers that a model has not seen.

A probability depends on how much is not known. Some entities lose all but a few of their facts, a
model is trained on what is left, and they are asked for: as they are trained, and inserted with the
same facts. Test triples stand for what is not known of entities with more facts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from isi.evaluation.platt import Curves, PlattCurve, fit_platt
from isi.graph.graph import HEAD, TAIL
from isi.graph.sessions import TEST
from isi.home.answers import FEW, MANY_FACTS, STATES, state_of
from isi.home.bundle import Bundle
from isi.home.choosing import fold_in_options
from isi.home.loaded import LoadedEmbedding, Query
from isi.insertion.api import insert_request
from isi.insertion.request import InsertRequest, KnownEmbedding
from isi.models.stack import Embedding
from isi.random import stream
from isi.training.held_out import with_few_facts
from isi.training.recipe import Trained

NUMBERS = (1, 2, 3, 5)  #: Numbers of facts that entities have left.
#: Entities that lose facts: so many in all, of which a model loses at most a tenth of its entities;
#: and the most models.
LOSING, ONE_IN, MOST_MODELS = 50, 8, 5
LEAST_RIGHT = 5  #: Least number of right answers for a curve.
MOST_SCORES = 2**19  #: Of the candidates of all queries of a state.
Stored = dict[str, dict[str, list[float]]]


@dataclass(frozen=True)
class Sample:
    """Candidates of one query whose answers are not known."""

    state: str
    relation: int
    scores: np.ndarray  #: shape: (C,)
    right: np.ndarray  #: shape: (C,), bool


@dataclass(frozen=True, eq=False)
class Hidden:
    """A home that has lost some triples of another one, and a model trained on the rest."""

    whole: LoadedEmbedding
    known: np.ndarray  #: the triples of ``whole`` that are left; shape: (T,), bool
    theta: Embedding

    @cached_property
    def rest(self) -> LoadedEmbedding:
        return self._with(self.whole, self.theta.entity[0].numpy())

    def _with(self, whole: LoadedEmbedding, entities: np.ndarray) -> LoadedEmbedding:
        relations = self.theta.relation[0].numpy()
        triples = whole.triples[self.known]
        return replace(whole, entities=entities, relations=relations, triples=triples)

    def samples(self, entities: Iterable[int]) -> Iterator[Sample]:
        """The queries about trained entities for which the whole home has answers."""
        return _samples(self.whole, self.rest, entities)

    def samples_inserted(self, entities: np.ndarray) -> Iterator[Sample]:
        """The same, when these have been inserted with what is left of their facts."""
        others = np.setdiff1d(np.arange(len(self.whole.entities)), entities)
        order, known = np.concatenate([others, entities]), len(others)
        whole = in_order(self.whole, order)
        rest = self._with(whole, self.rest.entities[order])
        is_of_known = (rest.triples[:, [HEAD, TAIL]] < known).all(1)
        of_known = KnownEmbedding(
            rest.entities[:known], rest.relations, rest.model, triples=rest.triples[is_of_known]
        )
        has_words = rest.words is not None
        request = InsertRequest(
            triples=rest.triples[~is_of_known],
            new=len(entities),
            words=rest.words,
            kinds=rest.kind_ids,
            initializer="fold_in",
            options=fold_in_options(has_words),
            trained_with="softmax",
        )
        vectors = insert_request(of_known, request).vectors
        inserted = replace(rest, entities=np.concatenate([rest.entities[:known], vectors]))
        return _samples(whole, inserted, range(known, len(order)))


def in_order(whole: LoadedEmbedding, order: np.ndarray) -> LoadedEmbedding:
    """The same with entities, ids (E,), in another order."""
    triples, place = whole.triples.copy(), np.argsort(order)
    triples[:, [HEAD, TAIL]] = place[triples[:, [HEAD, TAIL]]]
    return replace(
        whole,
        entities=whole.entities[order],
        entity_names=[whole.entity_names[row] for row in order],
        kinds=[whole.kinds[row] for row in order],
        phrases=[whole.phrases[row] for row in order],
        triples=triples,
        words=None if whole.words is None else whole.words[order],
    )


def _samples(
    whole: LoadedEmbedding, rest: LoadedEmbedding, entities: Iterable[int]
) -> Iterator[Sample]:
    facts = _numbers(rest)
    for entity in entities:
        for relation in range(len(whole.relations)):
            for slot in (HEAD, TAIL):
                query = Query(entity, relation, slot)
                right, known = whole.answers(query), rest.answers(query)
                if not right:
                    continue
                rows, scores = rest.ranked(query)
                is_open = ~np.isin(rows, list(known))
                is_right = np.isin(rows[is_open], list(right))
                state = state_of(int(facts[entity]), bool(known))
                yield Sample(state, relation, scores[is_open], is_right)


def calibrated(bundle: Bundle, trained: Trained) -> Bundle:
    """A bundle of what was trained, with curves; without, if the graph has too few triples."""
    whole, rng = LoadedEmbedding(**vars(bundle)), stream(trained.seed, "entities that lose facts")
    number = _numbers(whole)
    of_trained, of_inserted = list[Sample](), list[Sample]()
    for entities in losing(number, rng):
        facts = np.resize(NUMBERS, len(entities))
        known = with_few_facts(trained.graph, trained.groups, entities, facts, rng)
        hidden = Hidden(whole, known, trained.on(known))
        of_few = hidden.samples(entities.tolist())
        of_trained += (sample for sample in of_few if sample.state != MANY_FACTS)
        of_inserted += hidden.samples_inserted(entities)
    most = max(1, MOST_SCORES // len(number))
    well_known = rng.permutation(np.flatnonzero(number >= FEW))[:most]
    of_test = Hidden(whole, trained.splits != TEST, trained.tested).samples(well_known.tolist())
    of_trained += (sample for sample in of_test if sample.state == MANY_FACTS)
    curves = {"curves": fitted(of_trained), "inserted_curves": fitted(of_inserted)}
    return replace(bundle, manifest=bundle.manifest.model_copy(update=curves))


def losing(number: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """Entities that lose facts together, ids; ``number``: of the facts of each entity, (E,)."""
    suitable = rng.permutation(np.flatnonzero(number > 1))
    together = max(1, min(len(number) // ONE_IN, LOSING))
    models = min(MOST_MODELS, -(-LOSING // together), len(suitable) // together)
    return list(suitable[: models * together].reshape(models, together))


def fitted(samples: Sequence[Sample]) -> Stored | None:
    """The curves of each state, near that of all samples; None without enough right answers."""
    of_all = _curve(samples)
    if of_all is None:
        return None
    stored = Stored()
    for state in STATES:
        of_state = [sample for sample in samples if sample.state == state]
        common = _curve(of_state, of_all) or of_all
        relations = dict[int, PlattCurve]()
        for relation in sorted({sample.relation for sample in of_state}):
            alike = [sample for sample in of_state if sample.relation == relation]
            relations[relation] = _curve(alike, common) or common
        stored[state] = Curves(relations, common).stored()
    return stored


def _curve(samples: Sequence[Sample], near: PlattCurve | None = None) -> PlattCurve | None:
    """A curve of all candidates; None with too few right ones to fit one without another near."""
    scores = np.concatenate([np.zeros(0), *(sample.scores for sample in samples)])
    right = np.concatenate([np.zeros(0, bool), *(sample.right for sample in samples)])
    least = LEAST_RIGHT if near is None else 1
    return fit_platt(scores, right, near) if least <= right.sum() < len(right) else None


def _numbers(whole: LoadedEmbedding) -> np.ndarray:
    """The number of facts of each entity, (E,)."""
    return np.bincount(whole.triples[:, [HEAD, TAIL]].ravel(), minlength=len(whole.entities))
