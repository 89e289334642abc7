"""The indicators of an inserted entity: known entities, how similar they are, and their weights in its vector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from isi.graph.sessions import OUT, TRAIN, Session
from isi.initializers.api import InitContext, NovelEntities, context_of
from isi.initializers.similarity import (
    has_insert_triples,
    has_words,
    mean_relational_score,
    word_eligible,
    word_similarity,
)
from isi.insertion.arguments import graph_of, stack_of_one
from isi.insertion.result import Inserted

#: Entities that are shown where all have a weight, at most, and the least weight of one.
SHOWN, LEAST = 8, 0.01


@dataclass(frozen=True)
class Indicator:
    """A known entity that determined the vector of a new one."""

    id: int
    entity: str
    #: in the vector, or in the mean of MAP's prior; null where the initializer has none: these are the most similar
    weight: float | None
    #: cosine of the word vectors; null where one of them has none
    words: float | None
    #: mean cosine with the resultants of the insert triples (equation 5 over the number of relations)
    relations: float | None


def indicators(result: Inserted, names: Sequence[str], word_vectors: np.ndarray | None) -> list[Indicator]:
    """The indicators of the one new entity of a result, those of largest weight first.

    Args:
        names: of all entities.
        word_vectors: of all entities; shape (E + 1, v).
    """
    context = _context(result, word_vectors)
    words, triples = bool(has_words(context)), bool(has_insert_triples(context))
    similar, related = word_similarity(context)[0, 0], mean_relational_score(context)[0, 0]
    named, weight = word_eligible(context)[0, 0], None
    if result.weights is not None and result.weights[0].min() < result.weights[0].max():  # else they say nothing
        weight = torch.zeros(len(similar))
        weight[: result.known] = torch.from_numpy(result.weights[0])
    likeness = similar * named * words + related * triples
    rank = likeness.masked_fill(~context.eligible[0], -torch.inf) if weight is None else weight + 1e-6 * likeness
    best = rank.sort(descending=True, stable=True).indices
    best = best[torch.isfinite(rank[best])]
    if weight is None:
        best = best[:SHOWN]
    elif result.indicators is not None:  # the vector is their centroid
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


def _context(result: Inserted, word_vectors: np.ndarray | None) -> InitContext:
    """What the initializer saw of the new entity."""
    entities = result.entities.copy()
    entities[result.known :] = 0
    theta0 = stack_of_one(entities, result.relations, result.model)
    number = len(result.insert_triples)
    graph = graph_of(np.concatenate([result.insert_triples, result.known_triples]), theta0)
    splits = torch.full((1, len(graph.triples)), TRAIN, dtype=torch.int8)
    splits[:, :number] = OUT
    session = Session(graph, torch.arange(len(entities))[None] < result.known, splits)
    rows = torch.stack([torch.zeros(number), torch.zeros(number), torch.arange(number)], 1).long()
    words = torch.zeros(len(entities), 1) if word_vectors is None else torch.from_numpy(word_vectors)
    context = context_of(theta0, session, NovelEntities(torch.tensor([result.new]), rows, words), 0, torch.zeros(1, 1))
    return context if len(result.known_triples) else replace(context, eligible=context.known)
