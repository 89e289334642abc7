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
from isi.insertion.interference import Interference
from isi.live.answers import Answers, completed
from isi.live.groups import EntityGroups, InsertedEntity
from isi.live.journal import Additions, Change, NewEntity
from isi.live.loaded import Fact, LoadedEmbedding, Query, queries_of

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
    interference: Interference | None  #: of this entity alone; None without known triples
    interference_of_all: Interference | None  #: of all inserted entities


@dataclass(frozen=True)
class Snapshot:
    """An embedding with inserted entities, as explanations read it."""

    now: LoadedEmbedding  #: with all inserted entities and the facts that hold
    groups: EntityGroups
    additions: Additions


#: The best answers to a query, so many of them, with ``Answer.shared_by`` for the ids of
#: indicators.
Ask = Callable[[Query, int, Collection[int]], Answers]


def report(
    snapshot: Snapshot,
    row: InsertedEntity,
    top: int,
    ask: Ask,
    *,
    interference: Interference | None,
    interference_of_all: Interference | None,
) -> Report:
    """Report on an inserted entity, with the ``top`` best answers to each
    query and nearest entities.
    """
    now, record = snapshot.now, row.record
    entity = now.entity_ids[record.entity]
    shown = indicators_of(snapshot, row)
    weights = {indicator.id: indicator.weight or 1.0 for indicator in shown}
    ranked = [
        (query, ask(query, max(top, EXAMINED), weights))
        for query in queries_of(now, entity, weights)
    ]
    unsupported = [
        (completed(now, query, now.entity_ids[best.entity]), best.probability)
        for query, answers in ranked
        for best in answers.answers
        if best.unsupported
    ]
    nearest = [(now.entity_names[other], cosine) for other, cosine in now.nearest(entity, top)]
    return Report(
        entity=record.entity,
        id=entity,
        kind=row.kind or None,
        facts=record.insert_triples,
        initializer=record.initializer,
        options=record.options,
        why=record.why,
        fallback=record.fallback,
        words=row.words.note,
        notes=list(row.notes),
        indicators=shown,
        answers=[replace(answers, answers=answers.answers[:top]) for _, answers in ranked],
        unsupported=sorted(unsupported, key=lambda triple: -(triple[1] or 0)),
        nearest=nearest,
        interference=interference,
        interference_of_all=interference_of_all,
    )


def explain(snapshot: Snapshot, row: InsertedEntity, top: int) -> Explanation:
    """Explain an inserted entity;
    ablations compare the ``top`` best answers to the queries that fit it.
    """
    now, groups, record = snapshot.now, snapshot.groups, row.record
    name = record.entity
    shown = indicators_of(snapshot, row)
    weights = {indicator.id: indicator.weight or 1.0 for indicator in shown}
    queries = queries_of(now, now.entity_ids[name], weights)
    every, base = snapshot.additions.facts, groups.base
    without = []
    for fact in record.insert_triples:
        left = [other for other in every if other != fact]
        without.append(_ablation(snapshot, row, "fact", " ".join(fact), groups, left, queries, top))
    if row.words.vector is not None:
        no_words = EntityGroups(replace(base, words=None), None, groups.selected)
        without.append(_ablation(snapshot, row, "words", name, no_words, every, queries, top))
    for indicator in shown:
        if indicator.weight is not None:
            fewer = base.part(np.delete(np.arange(len(base.entities)), indicator.id))
            other = replace(groups, base=fewer, _curves={}, _results={})
            left = [fact for fact in every if indicator.entity not in (fact[0], fact[2])]
            of = indicator.entity
            without.append(_ablation(snapshot, row, "indicator", of, other, left, queries, top))
    without.sort(
        key=lambda ablation: -(ablation.moved if ablation.moved is not None else float("inf"))
    )
    return Explanation(
        name,
        row.kind,
        record.insert_triples,
        record.initializer,
        record.why,
        list(row.notes),
        shown,
        without,
    )


def _ablation(
    snapshot: Snapshot,
    row: InsertedEntity,
    left_out: str,
    piece: str,
    groups: EntityGroups,
    facts: Collection[Fact],
    queries: Sequence[Query],
    top: int,
) -> Ablation:
    """Insert an entity again, with those that share facts with it, from the given facts;
    compare its best answers.
    """
    changed = _inserted_again(snapshot, row, left_out, groups, facts)
    if changed is None:
        return Ablation(left_out, piece)
    now = snapshot.now
    entities = now.entities.copy()
    entities[now.entity_ids[row.record.entity]] = changed
    other, changes = replace(now, entities=entities), list[Lost]()
    for query in queries:
        old, new = _best(now, query, top), _best(other, query, top)
        if set(old) != set(new):
            lost = [name for name in old if name not in new]
            added = [name for name in new if name not in old]
            changes.append(Lost(now.named(query), lost, added))
    vector, stored = torch.from_numpy(changed).double(), torch.from_numpy(row.vector).double()
    moved = (vector - stored).norm() / stored.norm().clamp(min=1e-12)
    cosine = cosine_similarity(vector, stored, dim=0)
    return Ablation(left_out, piece, cosine.item(), moved.item(), changes)


def _best(bundle: LoadedEmbedding, query: Query, top: int) -> list[str]:
    """The names of the best answers to a query."""
    return [bundle.entity_names[each] for each in bundle.ranked(query)[0][:top].tolist()]


def _inserted_again(
    snapshot: Snapshot,
    row: InsertedEntity,
    left_out: str,
    groups: EntityGroups,
    facts: Collection[Fact],
) -> np.ndarray | None:
    """The vector, (d,), of an entity that is inserted by the same initializer from some of its
    ``facts`` and those of entities that share facts with it; None if no input is left.
    """
    record, additions = row.record, snapshot.additions
    members = {}
    for name in snapshot.groups.members_with(record.entity, additions):
        about = additions.entities[name]
        kind = snapshot.now.kinds[snapshot.now.entity_ids[name]]
        members[name] = NewEntity(
            definition=about.definition,
            kind=kind or None,
            initializer=record.initializer,
            options=dict(record.options),
            seed=record.seed,
        )
    there = groups.base.entity_ids.keys() | members.keys()
    of_members = [fact for fact in facts if {fact[0], fact[2]} & members.keys()]
    of_members = [fact for fact in of_members if {fact[0], fact[2]} <= there]
    has_facts = any(record.entity in (fact[0], fact[2]) for fact in of_members)
    has_words = row.words.vector is not None and left_out != "words"
    if not has_facts and not has_words and record.requested_initializer is None:
        return None
    retracted = {fact: None for fact in additions.retracted if {fact[0], fact[2]} <= there}
    alone = Additions(retracted=retracted)
    alone.apply(Change(do="insert", entities=members, facts=of_members))
    try:
        return groups.insert_groups(alone, [record.entity])[record.entity].vector
    except InputError:  # nor does an initializer of words alone serve every model
        return None


def indicators_of(snapshot: Snapshot, row: InsertedEntity) -> list[Indicator]:
    """The indicators of an inserted entity, by falling weight; without weights,
    the most similar known entities.
    """
    base = snapshot.groups.base
    result, place = snapshot.groups.result_of(row, snapshot.additions)
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
