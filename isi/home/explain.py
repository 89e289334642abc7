"""Why an inserted entity is where it is: its facts, its words and its indicators."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch

from isi.graph.graph import HEAD, TAIL
from isi.home.answers import Answers, Curve, answer, completed
from isi.home.bundle import Fact
from isi.home.groups import EntityGroups, Member
from isi.home.inserted import InsertedEntity
from isi.home.loaded import LoadedEmbedding, queries_of
from isi.home.phrases import PhraseVector
from isi.initializers import similarity
from isi.insertion.engine import context_for
from isi.insertion.result import Details
from isi.models.stack import usual_torch

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


@dataclass(frozen=True)
class Explanation:
    """What determined the vector of an inserted entity."""

    entity: str
    kind: str
    facts: list[Fact]
    initializer: str
    options: Mapping[str, object]
    why: str  #: the reason for this initializer
    words: str  #: where its word vector is from, or why it has none
    notes: list[str]
    indicators: list[Indicator]  #: the most important first


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
    #: the entity, and those that share facts with it, as they are to be inserted
    members: Mapping[str, Member]
    row: InsertedEntity

    @property
    def facts(self) -> list[Fact]:
        """The facts of the entity by relations of training, sorted."""
        return list(self.members[self.row.entity].facts)

    @property
    def words(self) -> PhraseVector:
        """The word vector of the entity."""
        return self.members[self.row.entity].words

    def again(self) -> tuple[Details, int]:
        """The insertion, computed again, and the place of the entity in it."""
        members = dict(sorted(self.members.items()))
        result = self.groups.result(members, self.known_triples, self.row)
        return result, list(members).index(self.row.entity)


#: From an entity, a relation and the slot of the answer to the curve of its probabilities.
CurveOf = Callable[[int, int, int], Curve | None]


@usual_torch()
def report(snapshot: Snapshot, top: int, curve_of: CurveOf) -> Report:
    """Report on an inserted entity, with the ``top`` best answers to each query and nearest
    entities.
    """
    now, row = snapshot.now, snapshot.row
    entity = now.names.ids[row.entity]
    shown = indicators_of(snapshot)
    weights = {indicator.id: indicator.weight or 1.0 for indicator in shown}
    most = max(top, EXAMINED)
    ranked = [
        (query, answer(now, query, most, curve_of(*query), indicators=weights))
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


@usual_torch()
def explain(snapshot: Snapshot) -> Explanation:
    """Explain an inserted entity."""
    row = snapshot.row
    return Explanation(
        row.entity,
        row.kind,
        snapshot.facts,
        row.initializer,
        row.options,
        row.why,
        snapshot.words.note,
        list(row.notes),
        indicators_of(snapshot),
    )


def indicators_of(snapshot: Snapshot) -> list[Indicator]:
    """The indicators of an inserted entity, by falling weight; without weights,
    the most similar known entities.
    """
    base = snapshot.groups.base
    result, place = snapshot.again()
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
