"""Why an inserted entity is where it is: its indicators,
and insertions without one piece of its input (ablations).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from torch.nn.functional import cosine_similarity

from isi.errors import InputError
from isi.graph.graph import HEAD, TAIL
from isi.initializers import similarity
from isi.insertion.engine import context_for
from isi.live.answers import Answers, completed
from isi.live.bundle import Fact, NewEntity
from isi.live.groups import Computed, EntityGroups, EntityInput, InsertedEntity
from isi.live.loaded import LoadedEmbedding, Query, queries_of
from isi.live.phrases import PhraseVector

EXAMINED = 20  #: Best answers per query that are searched for those without support.
#: Maximum number of indicators shown, and least weight, unless the vector is their centroid.
SHOWN, LEAST = 8, 0.01


@dataclass(frozen=True)
class Indicator:
    """A known entity that determined the vector of a new one."""

    id: int
    entity: str
    #: in the vector (MAP: in the mean of the prior); None if there are none or many equal ones:
    #: then similarity decides
    weight: float | None
    words: float | None  #: cosine of the word vectors; None if one is missing
    #: mean of cos(v_e, ᾱ_r) over relations of facts (docs/method.md); None without facts
    relations: float | None


class Lost(NamedTuple):
    """A query whose best answers change."""

    query: Fact
    lost: list[str]
    added: list[str]


@dataclass(frozen=True)
class Ablation:
    """Effect on an inserted entity of leaving out one piece of its input."""

    left_out: str  #: fact, words, indicator
    what: str  #: the fact as text, the name, or the indicator
    cosine: float | None = None  #: between this vector and the real one; None if no input is left
    moved: float | None = None  #: their distance, divided by the length of the real one
    changes: Sequence[Lost] = ()  #: of each query whose best answers change


@dataclass(frozen=True)
class Explanation:
    """What determined the vector of an inserted entity."""

    entity: str
    kind: str
    facts: list[Fact]
    initializer: str
    why: str  #: the reason for this initializer
    notes: list[str]
    indicators: list[Indicator]  #: the most important first
    without: list[Ablation]  #: the largest change first


@dataclass(frozen=True)
class Report:
    """What is known and predicted about an inserted entity."""

    entity: str
    id: int
    kind: str | None
    facts: list[Fact]
    initializer: str
    options: Mapping[str, object]
    why: str  #: the reason for this initializer
    fallback: str | None  #: the rule that replaced it for lack of data
    words: str  #: where its word vector is from, or why it has none
    notes: list[str]  #: sentences
    indicators: list[Indicator]
    answers: list[Answers]  #: to the queries that fit the entity
    #: probable triples that no indicator supports, and probabilities
    unsupported: list[tuple[Fact, float | None]]
    nearest: list[tuple[str, float]]  #: entities with the highest cosines


@dataclass(frozen=True)
class Snapshot:
    """An inserted entity, and the embedding with all inserted ones, as explanations read it."""

    now: LoadedEmbedding  #: with all inserted entities and the facts that hold
    groups: EntityGroups
    known_triples: np.ndarray  #: of training that hold; ids, shape: (T, 3)
    #: what is given about the entity, and about those that share facts with it
    given: Mapping[str, EntityInput]
    row: InsertedEntity

    @property
    def facts(self) -> list[Fact]:
        """The facts of the entity by relations of training, sorted."""
        return list(self.given[self.row.entity].facts)

    @property
    def words(self) -> PhraseVector:
        about = self.given[self.row.entity].about
        return self.groups.words(self.row.entity, about.definition)

    def again(self) -> Computed:
        """The insertion, computed again."""
        groups = self.groups
        choice = groups.choice(self.row.conditions)
        return groups.insert(self.given, self.known_triples, choice)[self.row.entity]


#: The best answers to a query, so many of them, with ``Answer.shared_by`` for the ids of
#: indicators.
Ask = Callable[[Query, int, Collection[int]], Answers]


def report(snapshot: Snapshot, top: int, ask: Ask) -> Report:
    """Report on an inserted entity, with the ``top`` best answers to each
    query and nearest entities.
    """
    now, row = snapshot.now, snapshot.row
    entity = now.names.ids[row.entity]
    shown = indicators_of(snapshot)
    weights = {indicator.id: indicator.weight or 1.0 for indicator in shown}
    ranked = [
        (query, ask(query, max(top, EXAMINED), weights))
        for query in queries_of(now, entity, weights)
    ]
    unsupported = [
        (completed(now, query, now.names.ids[best.entity]), best.probability)
        for query, answers in ranked
        for best in answers.answers
        if best.unsupported
    ]
    nearest = [(now.entity_names[other], cosine) for other, cosine in now.nearest(entity, top)]
    return Report(
        entity=row.entity,
        id=entity,
        kind=row.kind or None,
        facts=snapshot.facts,
        initializer=row.initializer,
        options=row.options,
        why=row.why,
        fallback=row.fallback,
        words=snapshot.words.note,
        notes=list(row.notes),
        indicators=shown,
        answers=[replace(answers, answers=answers.answers[:top]) for _, answers in ranked],
        unsupported=sorted(unsupported, key=lambda triple: -(triple[1] or 0)),
        nearest=nearest,
    )


def explain(snapshot: Snapshot, top: int) -> Explanation:
    """Explain an inserted entity;
    ablations compare the ``top`` best answers to the queries that fit it.
    """
    now, groups, row = snapshot.now, snapshot.groups, snapshot.row
    shown = indicators_of(snapshot)
    weights = {indicator.id: indicator.weight or 1.0 for indicator in shown}
    queries = queries_of(now, now.names.ids[row.entity], weights)

    def without(left_out: str, piece: str, changed: Snapshot) -> Ablation:
        return _ablation(snapshot, left_out, piece, changed, queries, top)

    pieces = list[Ablation]()
    for fact in snapshot.facts:
        fewer = _fewer_facts(snapshot.given, fact.__ne__)
        pieces.append(without("fact", " ".join(fact), replace(snapshot, given=fewer)))
    if snapshot.words.vector is not None:
        no_words = replace(groups, base=replace(groups.base, words=None), phrases=None)
        pieces.append(without("words", row.entity, replace(snapshot, groups=no_words)))
    for indicator in shown:
        if indicator.weight is not None:
            pieces.append(without("indicator", indicator.entity, _lacking(snapshot, indicator)))
    pieces.sort(key=_falling)
    return Explanation(
        row.entity,
        row.kind,
        snapshot.facts,
        row.initializer,
        row.why,
        list(row.notes),
        shown,
        pieces,
    )


def _falling(ablation: Ablation) -> float:
    """Orders ablations by what they move, those that leave no input first."""
    return -float("inf") if ablation.moved is None else -ablation.moved


def _fewer_facts(
    given: Mapping[str, EntityInput], holds: Callable[[Fact], bool]
) -> dict[str, EntityInput]:
    """What is given, with the facts for which a condition holds alone."""
    fewer = dict[str, EntityInput]()
    for name, each in given.items():
        facts = {fact: believed for fact, believed in each.facts.items() if holds(fact)}
        fewer[name] = replace(each, facts=facts)
    return fewer


def _lacking(snapshot: Snapshot, indicator: Indicator) -> Snapshot:
    """A snapshot without a known entity."""
    base = replace(snapshot.groups.base, triples=snapshot.known_triples)
    part = base.part(np.delete(np.arange(len(base.entities)), indicator.id))

    def is_of_others(fact: Fact) -> bool:
        return indicator.entity not in (fact[0], fact[2])

    phrases = snapshot.groups.phrases
    if phrases is not None and part.words is not None:
        phrases = replace(phrases, known=part.words, phrases=part.phrases)
    return replace(
        snapshot,
        groups=replace(snapshot.groups, base=part, phrases=phrases),
        known_triples=part.triples,
        given=_fewer_facts(snapshot.given, is_of_others),
    )


def _ablation(
    snapshot: Snapshot,
    left_out: str,
    piece: str,
    changed: Snapshot,
    queries: Sequence[Query],
    top: int,
) -> Ablation:
    """Insert an entity again from less; compare its best answers."""
    now, row = snapshot.now, snapshot.row
    given = {
        name: replace(each, about=_as_before(each.about, now.kinds[now.names.ids[name]]))
        for name, each in changed.given.items()
    }
    about = given[row.entity].about
    words = left_out != "words" and snapshot.words.vector is not None
    if not given[row.entity].facts and not words and about.initializer is None:
        return Ablation(left_out, piece)
    try:
        choice = snapshot.groups.choice(row.conditions)
        computed = changed.groups.insert(given, changed.known_triples, choice)
    except InputError:  # nor does an initializer of words alone serve every model
        return Ablation(left_out, piece)
    vector = computed[row.entity].entity.vector
    entities = now.entities.copy()
    entities[now.names.ids[row.entity]] = vector
    other, changes = replace(now, entities=entities), list[Lost]()
    for query in queries:
        old, new = _best(now, query, top), _best(other, query, top)
        if set(old) != set(new):
            lost = [name for name in old if name not in new]
            added = [name for name in new if name not in old]
            changes.append(Lost(now.named(query), lost, added))
    here, there = torch.from_numpy(vector).double(), torch.tensor(row.vector).double()
    moved = (here - there).norm() / there.norm().clamp(min=1e-12)
    cosine = cosine_similarity(here, there, dim=0)
    return Ablation(left_out, piece, cosine.item(), moved.item(), changes)


def _as_before(about: NewEntity, kind: str) -> NewEntity:
    """What was told about an entity, with the kind that it has."""
    return about.model_copy(update={"kind": kind or None})


def _best(bundle: LoadedEmbedding, query: Query, top: int) -> list[str]:
    """The names of the best answers to a query."""
    return [bundle.entity_names[each] for each in bundle.ranked(query)[0][:top].tolist()]


def indicators_of(snapshot: Snapshot) -> list[Indicator]:
    """The indicators of an inserted entity, by falling weight; without weights,
    the most similar known entities.
    """
    base = snapshot.groups.base
    _, result, place = snapshot.again()
    novel, entity = result.novel, result.known + place
    touches = (novel.triples[:, [HEAD, TAIL]] == entity).sum(1) == 1
    seen = context_for(novel, torch.tensor([entity]), novel.triples[touches])
    has_words = bool(similarity.has_words(seen))
    # a model without inverse has no relational scores
    has_triples = bool(similarity.has_insert_triples(seen)) and seen.theta0.model.invertible
    known = slice(len(base.entities))
    candidates = seen.candidates[0, 0, known]
    named = similarity.word_eligible(seen)[0, 0, known]
    similar = similarity.word_similarity(seen)[0, 0, known]
    related = torch.zeros_like(similar)
    if has_triples:
        related = similarity.mean_relational_score(seen)[0, 0, known]
    likeness = similar * named * has_words + related * has_triples
    weights = None if result.weights is None else torch.from_numpy(result.weights[place])
    if weights is not None:
        of_candidates = weights[candidates]
        # many equal ones say nothing
        if len(of_candidates) > SHOWN and of_candidates.min() == of_candidates.max():
            weights = None
    rank = likeness.masked_fill(~candidates, -torch.inf)
    if weights is not None:
        rank = weights + 1e-6 * likeness
    best = rank.sort(descending=True, stable=True).indices
    best = best[torch.isfinite(rank[best])]
    if weights is not None and result.indicators is not None:  # the vector is their centroid
        best = best[weights[best] > 0]
    else:
        best = best[:SHOWN]
        if weights is not None:
            best = best[weights[best] >= LEAST]
    indicators = list[Indicator]()
    for other in best.tolist():
        indicator = Indicator(
            id=other,
            entity=base.entity_names[other],
            weight=None if weights is None else float(weights[other]),
            words=float(similar[other]) if has_words and named[other] else None,
            relations=float(related[other]) if has_triples else None,
        )
        indicators.append(indicator)
    return indicators
