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
from isi.initializers import similarity
from isi.insertion.api import init_context_of
from isi.insertion.interference import Interference
from isi.live.answers import Answers, completed
from isi.live.groups import EntityGroups, InsertedEntity, Method
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
    """Explain an inserted entity; ablations compare the ``top`` best answers
    to the queries that fit it.
    """
    now, groups, record = snapshot.now, snapshot.groups, row.record
    name = record.entity
    shown = indicators_of(snapshot, row)
    weights = {indicator.id: indicator.weight or 1.0 for indicator in shown}
    queries = queries_of(now, now.entity_ids[name], weights)
    facts, base = record.insert_triples, groups.base
    pieces = [
        ("fact", " ".join(fact), groups, [other for other in facts if other != fact])
        for fact in facts
    ]
    if row.words.vector is not None:
        without_words = EntityGroups(replace(base, words=None), None, groups.chosen)
        pieces.append(("words", name, without_words, facts))
    for indicator in shown:
        if indicator.weight is not None:
            fewer = base.part(np.delete(np.arange(len(base.entities)), indicator.id))
            rest = [fact for fact in facts if indicator.entity not in (fact[0], fact[2])]
            pieces.append(
                ("indicator", indicator.entity, replace(groups, base=fewer, _curves={}), rest)
            )
    without = [_ablation(snapshot, row, *piece, queries, top) for piece in pieces]
    without.sort(
        key=lambda ablation: -(ablation.moved if ablation.moved is not None else float("inf"))
    )
    return Explanation(
        name, row.kind, facts, record.initializer, record.why, list(row.notes), shown, without
    )


def _ablation(
    snapshot: Snapshot,
    row: InsertedEntity,
    left_out: str,
    piece: str,
    groups: EntityGroups,
    facts: list[Fact],
    queries: Sequence[Query],
    top: int,
) -> Ablation:
    """Insert an entity again by the same initializer, alone, with the given facts;
    compare its best answers.
    """
    record, now = row.record, snapshot.now
    same = NewEntity(
        definition=record.definition,
        kind=row.kind or None,
        initializer=record.initializer,
        options=record.options,
        seed=record.seed,
    )
    names = groups.base.entity_ids.keys() | {record.entity}
    known = [fact for fact in facts if {fact[0], fact[2]} <= names]
    try:
        if (
            not known
            and (row.words.vector is None or left_out == "words")
            and record.requested_initializer is None
        ):
            raise InputError("", "", "no input is left")
        alone = Additions(retracted=dict(snapshot.additions.retracted))
        alone.apply(Change(do="insert", entities={record.entity: same}, facts=known))
        changed = groups.insert_groups(alone, [record.entity])[record.entity]
    except InputError:  # nor does an initializer of words alone serve every model
        return Ablation(left_out, piece)
    place = now.entity_ids[record.entity]
    entities = now.entities.copy()
    entities[place] = changed.vector
    vector, stored = (
        torch.from_numpy(changed.vector).double(),
        torch.from_numpy(row.vector).double(),
    )
    other, changes = replace(now, entities=entities), list[Lost]()
    for query in queries:
        old, new = (
            [now.entity_names[each] for each in bundle.ranked(query)[0][:top].tolist()]
            for bundle in (now, other)
        )
        if set(old) != set(new):
            lost, added = (
                [name for name in best if name not in rest]
                for best, rest in ((old, new), (new, old))
            )
            changes.append(Lost(now.named(query), lost, added))
    moved = (vector - stored).norm() / stored.norm().clamp(min=1e-12)
    return Ablation(
        left_out, piece, cosine_similarity(vector, stored, dim=0).item(), moved.item(), changes
    )


def indicators_of(snapshot: Snapshot, row: InsertedEntity) -> list[Indicator]:
    """The indicators of an inserted entity, by falling weight;
    without weights, the most similar known entities.
    """
    groups, name = snapshot.groups, row.record.entity
    known = groups.base.entity_ids.keys() | {name}
    facts = [fact for fact in row.record.insert_triples if {fact[0], fact[2]} <= known]
    method = Method(
        0, False, row.record.initializer, tuple(row.record.options.items()), row.record.seed
    )
    words, known_triples = {name: row.words}, groups.known_triples(snapshot.additions)
    result = groups.insert(method, [name], facts, words, [row.kind], known_triples)
    seen = init_context_of(
        result.embedding,
        torch.tensor(result.new),
        result.known,
        result.insert_triples,
        result.known_triples,
        groups.word_rows([name], words),
        groups.kind_ids([row.kind]),
        0,
    )
    has_words, has_triples = (
        bool(similarity.has_words(seen)),
        bool(similarity.has_insert_triples(seen)),
    )
    candidates, named = seen.candidates[0, 0], similarity.word_eligible(seen)[0, 0]
    similar, related = (
        similarity.word_similarity(seen)[0, 0],
        similarity.mean_relational_score(seen)[0, 0],
    )
    likeness = similar * named * has_words + related * has_triples
    weight, rank = None, likeness.masked_fill(~candidates, -torch.inf)
    if result.weights is not None:
        weights = torch.zeros(len(rank)).index_copy(
            0, torch.arange(result.known), torch.tensor(result.weights[0])
        )
        of_candidates = weights[candidates]
        # many equal ones say nothing
        if len(of_candidates) <= SHOWN or of_candidates.min() < of_candidates.max():
            weight, rank = weights, weights + 1e-6 * likeness
    best = rank.sort(descending=True, stable=True).indices
    best = best[torch.isfinite(rank[best])]
    if weight is None:
        best = best[:SHOWN]
    elif result.indicators is not None:  # the vector is their centroid
        best = best[weight[best] > 0]
    else:
        best = best[:SHOWN][weight[best[:SHOWN]] >= LEAST]
    indicators = list[Indicator]()
    for entity in best.tolist():
        indicator = Indicator(
            id=entity,
            entity=groups.base.entity_names[entity],
            weight=None if weight is None else float(weight[entity]),
            words=float(similar[entity]) if has_words and named[entity] else None,
            relations=float(related[entity]) if has_triples else None,
        )
        indicators.append(indicator)
    return indicators
