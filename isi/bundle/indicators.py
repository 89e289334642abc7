"""The indicators of an inserted entity: known entities, how similar they are, and their weights in its vector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from isi.bundle.query import OpenBundle
from isi.graph.graph import HEAD, TAIL
from isi.initializers.api import InitContext
from isi.initializers.similarity import (
    has_insert_triples,
    has_words,
    mean_relational_score,
    word_eligible,
    word_similarity,
)
from isi.insertion.arguments import stack_of_one

#: Entities that are shown where an initializer weighs all, at most, and the least weight of one.
SHOWN, LEAST = 8, 0.01


@dataclass(frozen=True)
class Indicator:
    """A known entity that determined the vector of a new one."""

    id: int
    entity: str
    #: in the centroid; null where the initializer has none, and these are the most similar
    weight: float | None
    #: cosine of the word vectors; null where one of them has none
    words: float | None
    #: mean cosine with the resultants of the insert triples (equation 5 over the number of relations)
    relations: float | None


def as_new(opened: OpenBundle, entity: int, told: np.ndarray) -> InitContext:
    """What an initializer sees of an entity: those of lower ids are known, and its insert triples.

    Args:
        told: insert triples; shape (I, 3).
    """
    bundle = opened.bundle
    number = entity + 1
    before = bundle.triples[(bundle.triples[:, [HEAD, TAIL]] < entity).all(1)]
    known = torch.arange(number)[None] < entity
    seen = torch.zeros(1, number, dtype=torch.bool)
    seen[0, torch.from_numpy(before[:, [HEAD, TAIL]].flatten())] = True
    vectors = bundle.entities[:number].copy()
    vectors[entity] = 0
    is_tail = torch.from_numpy(told[:, TAIL] == entity)
    one_row = torch.zeros(number, 1) if bundle.words is None else torch.from_numpy(bundle.words[:number])
    head, relation, tail = torch.from_numpy(told.copy() if len(told) else np.zeros((1, 3), np.int64)).T
    if not len(told):
        is_tail = torch.zeros(1, dtype=torch.bool)
    return InitContext(
        theta0=stack_of_one(vectors, bundle.relations, opened.model), known=known,
        eligible=known & seen if len(before) else known, novel=torch.tensor([[entity]]), words=one_row,
        kinds=torch.zeros(number, dtype=torch.int64), other=torch.where(is_tail, head, tail)[None, None],
        relation=relation[None, None], novel_is_tail=is_tail[None, None],
        observed=torch.full((1, 1, len(is_tail)), len(told) > 0), root=0, keys=torch.zeros(1, 1, dtype=torch.int64),
    )  # fmt: skip


def indicators(
    insertion: InitContext, names: Sequence[str], weights: np.ndarray | None, is_centroid: bool
) -> list[Indicator]:
    """The entities that determined an inserted vector, those of largest weight first.

    Args:
        insertion: of one entity.
        names: of all entities.
        weights: of known entities, where the initializer has them; shape (E,).
        is_centroid: whether the initializer takes the centroid of those that have a weight.
    """
    words, triples = bool(has_words(insertion)), bool(has_insert_triples(insertion))
    similar, related = word_similarity(insertion)[0, 0], mean_relational_score(insertion)[0, 0]
    named = word_eligible(insertion)[0, 0]
    weight = None
    if weights is not None and weights.min() < weights.max():  # else they say nothing
        weight = torch.zeros(len(similar))
        weight[: len(weights)] = torch.from_numpy(weights)
    likeness = similar * named * words + related * triples
    rank = likeness.masked_fill(~insertion.eligible[0], -torch.inf) if weight is None else weight + 1e-6 * likeness
    best = rank.sort(descending=True, stable=True).indices
    best = best[torch.isfinite(rank[best])]
    if weight is None:
        best = best[:SHOWN]
    elif is_centroid:
        best = best[weight[best] > 0]
    else:
        best = best[:SHOWN][weight[best[:SHOWN]] >= LEAST]
    return [
        Indicator(
            row, names[row], None if weight is None else float(weight[row]),
            float(similar[row]) if words and named[row] else None, float(related[row]) if triples else None,
        )
        for row in best.tolist()
    ]  # fmt: skip
