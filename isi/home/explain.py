"""Why an inserted entity is where it is: its facts, its words and its indicators."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch

from isi.graph.graph import HEAD, TAIL
from isi.home.bundle import Fact
from isi.home.derived import Derived
from isi.home.loaded import LoadedEmbedding
from isi.initializers import similarity
from isi.initializers.api import InitResult
from isi.insertion.engine import NovelEntities, context_for
from isi.models.stack import usual_torch

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
    fallback: str | None  #: the rule that replaced it for lack of data
    words: str  #: where its word vector is from, or why it has none
    notes: list[str]
    indicators: list[Indicator]  #: the most important first


@usual_torch()
def explain(derived: Derived, name: str) -> Explanation:
    """Explain the inserted entity of a name; its insertion is computed again."""
    row, members = derived.rows[name], dict(sorted(derived.members_of([name]).items()))
    novel, result = derived.groups.again(members, derived.known_triples, row)
    member = members[name]
    return Explanation(
        entity=name,
        kind=row.kind,
        facts=list(member.facts),
        initializer=row.initializer,
        options=row.options,
        why=row.why,
        fallback=row.fallback,
        words=member.words.note,
        notes=list(row.notes),
        indicators=indicators_of(novel, result, list(members).index(name), derived.base),
    )


def indicators_of(
    novel: NovelEntities, result: InitResult, place: int, base: LoadedEmbedding
) -> list[Indicator]:
    """The indicators of an inserted entity, by falling weight; without weights,
    the most similar known entities.

    ``place``: of the entity among those that are inserted together.
    """
    entity, known = novel.known + place, slice(novel.known)
    touches = (novel.triples[:, [HEAD, TAIL]] == entity).sum(1) == 1
    seen = context_for(novel, torch.tensor([entity]), novel.triples[touches])
    has_words = bool(similarity.has_words(seen))
    # a model without inverse has no relational scores
    has_triples = bool(similarity.has_insert_triples(seen)) and seen.theta0.model.invertible
    candidates = seen.candidates[0, 0, known]
    named = similarity.word_eligible(seen)[0, 0, known]
    similar = similarity.word_similarity(seen)[0, 0, known]
    related = torch.zeros_like(similar)
    if has_triples:
        related = similarity.mean_relational_score(seen)[0, 0, known]
    likeness = similar * named * has_words + related * has_triples
    weights = None if result.weights is None else result.weights[0, place, known].float()
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
