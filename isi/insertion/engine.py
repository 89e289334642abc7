"""The engine of insertion: rounds and batches of the novel entities of one embedding.

Known entities have the ids 0 to E - 1, novel ones E to E + n - 1; new relations follow the R known
ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from isi.graph.graph import HEAD, RELATION, TAIL
from isi.initializers.api import INITIALIZERS, InitResult, Registered
from isi.initializers.context import (
    InitContext,
    NewRows,
    context_in_session,
    trained_session,
)
from isi.initializers.inverses import unpack_first
from isi.initializers.scale import LOGISTIC, Scale
from isi.insertion.relations import fit_relations
from isi.models.losses import Loss, TrainingLoss
from isi.models.model import Model
from isi.models.stack import Embedding

BUDGET = 2**24  #: Maximum number of elements of one batch of novel entities.
FEW = 32  #: Number of triples up to which all novel entities share batches.
ROUNDS = 3  #: Number of times that novel entities with triples between them are inserted.


@dataclass(frozen=True, eq=False)
class NovelEntities:
    """Novel entities of one embedding, and all that their vectors may depend on."""

    #: entities, (1, E + n, d), and relations, (1, R + q, w): the engine writes the rows of novel
    #: entities and new relations
    theta: Embedding
    known: int  #: E
    number: int  #: n
    known_relations: int  #: R
    triples: np.ndarray  #: each with a novel entity or a new relation; ids, shape: (T, 3)
    known_triples: np.ndarray  #: shape: (K, 3)
    words: np.ndarray | None  #: word vectors of all entities, zero if missing; shape: (E + n, v)
    kinds: np.ndarray | None  #: of all entities, -1 without one; shape: (E + n,)
    seed: int  #: root of the random streams
    scale: Scale = LOGISTIC
    #: a key for each novel entity's own random streams, so that its draws do not depend on the
    #: others; None: entities of a batch draw from one; shape (n,), int64
    entity_keys: np.ndarray | None = None
    #: how far each triple is believed, from 0 to 1; None: fully; shape: (T,)
    confidence: np.ndarray | None = None

    @property
    def ids(self) -> np.ndarray:
        """Ids of the novel entities; shape (n,)."""
        return np.arange(self.known, self.known + self.number)

    @property
    def has_one_novel_end(self) -> np.ndarray:
        """Whether a triple joins a novel entity to a known one; shape (T,), bool."""
        novel = self.triples[:, [HEAD, TAIL]] >= self.known
        has_one: np.ndarray = novel.sum(1) == 1
        return has_one

    @property
    def has_triple(self) -> np.ndarray:
        """Whether a novel entity has a triple with another entity; shape (n,), bool."""
        ends = self.triples[:, [HEAD, TAIL]]
        return np.isin(self.ids, ends[ends[:, 0] != ends[:, 1]])

    @property
    def has_words(self) -> np.ndarray:
        """Whether a novel entity has a word vector; shape (n,), bool."""
        if self.words is None:
            return np.zeros(self.number, bool)
        has_words: np.ndarray = np.array(self.words[self.known :].any(1))
        return has_words

    @property
    def words_serve(self) -> bool:
        """Whether known and novel entities have word vectors."""
        known = self.words is not None and self.words[: self.known].any()
        return bool(known and self.has_words.any())

    @property
    def has_new_relations(self) -> bool:
        return self.theta.relation.shape[1] > self.known_relations


@dataclass(frozen=True)
class Method:
    """An initializer with all its options."""

    initializer: Registered  #: in the form that fits the model (``isi.initializers.inverses``)
    options: Mapping[str, Any]
    why: str  #: the reason for this initializer
    trained_with: Loss | TrainingLoss = "logistic"  #: the loss that the embedding was trained with

    def start(self, model: Model) -> Method:
        """The method of the vectors from which training starts; itself without training."""
        option = self.initializer.starts_from
        if option is None:
            return self
        name = self.options[option] if model.invertible else "mean"
        first = unpack_first(INITIALIZERS.get(name), model)
        return replace(self, initializer=first, options=dict(first.defaults))

    def initialize(self, context: InitContext) -> InitResult:
        """Vectors of the novel entities of a context (equation 8)."""
        return self.initializer.initialize(context, self.options)


def insert(novel: NovelEntities, method: Method) -> InitResult | None:
    """Write the rows of novel entities and new relations into ``novel.theta``;
    the result of the last round, None without novel entities.

    A new relation is fitted before each round to its triples between entities that have vectors.
    Until it has a row, its triples are not used.
    """
    triples, all_entities = novel.triples, novel.known + novel.number
    has_vector = np.arange(all_entities) < novel.known
    is_of_known_relation = triples[:, RELATION] < novel.known_relations
    joins_vectors = has_vector[triples[:, [HEAD, TAIL]]].all(1)
    fit_again = bool((~is_of_known_relation & ~joins_vectors).any())
    result, first = None, method.start(novel.theta.model)
    for ids, seen in schedule(triples, novel.known, novel.number, fit_again):
        usable = _fit_new_relations(novel, has_vector)
        again = bool(has_vector[ids].all())
        result = _in_batches(novel, first, torch.from_numpy(ids), seen & usable, again)
        if result is not None:
            novel.theta.entity[0, ids] = result.vectors[0]
        has_vector[ids] = True
    if fit_again:
        _fit_new_relations(novel, has_vector)
    if result is not None and first is not method:
        result = train_together(novel, method, result)
    return result


def train_together(novel: NovelEntities, method: Method, start: InitResult) -> InitResult:
    """Train all new rows together from their first vectors, write them into ``novel.theta``, and
    return the result with the trained vectors.
    """
    proper = novel.triples[:, HEAD] != novel.triples[:, TAIL]
    is_novel = (novel.triples[:, [HEAD, TAIL]] >= novel.known).any(1)
    triples, ids = novel.triples[proper & is_novel], torch.from_numpy(novel.ids)
    confidence = None if novel.confidence is None else novel.confidence[proper & is_novel]
    training = NewRows(
        start=start.vectors,
        relations=novel.theta.relation.shape[1] - novel.known_relations,
        triples=torch.from_numpy(novel.triples[proper & ~is_novel]),
    )
    context = context_for(novel, ids, triples, confidence=confidence)
    trained = method.initialize(replace(context, training=training))
    novel.theta.entity[0, novel.known :] = trained.vectors[0]
    if trained.relations is not None:
        novel.theta.relation[0, novel.known_relations :] = trained.relations[0]
    return replace(start, vectors=trained.vectors, is_centroid=False)


def _fit_new_relations(novel: NovelEntities, has_vector: np.ndarray) -> np.ndarray:
    """Write the rows of new relations into ``novel.theta``, each fitted to its triples between
    entities of the mask ``has_vector``, (E + n,).

    Returns a mask, (T,), of the triples whose relation has a row: it is known, or has such triples.
    """
    theta, triples = novel.theta, novel.triples
    if not novel.has_new_relations:
        return np.ones(len(triples), bool)
    ready = triples[has_vector[triples[:, [HEAD, TAIL]]].all(1)]
    theta.relation[0, novel.known_relations :] = fit_relations(
        theta,
        novel.known,
        novel.known_relations,
        torch.from_numpy(ready),
        torch.from_numpy(novel.known_triples),
        scale=novel.scale,
    )
    is_known = triples[:, RELATION] < novel.known_relations
    has_row: np.ndarray = is_known | np.isin(triples[:, RELATION], ready[:, RELATION])
    return has_row


def _in_batches(
    novel: NovelEntities, method: Method, ids: Tensor, usable: np.ndarray, again: bool
) -> InitResult | None:
    """Insert the novel entities ``ids``, (m,), from the ``usable`` triples, a mask, (T,), batch by
    batch; ``again``: they have vectors of an earlier round.
    """
    triples = novel.triples[usable]
    confidence = None if novel.confidence is None else novel.confidence[usable]
    _, relations, width = novel.theta.relation.shape
    _, entities, dimension = novel.theta.entity.shape
    most = max(1, BUDGET // max(entities, relations * dimension))
    parts = batches(ids, triples, most, max(relations, width, dimension))
    contexts = (context_for(novel, part, triples, again, confidence) for part in parts)
    results = [method.initialize(context) for context in contexts]
    if len(results) < 2:
        return results[0] if results else None
    order = torch.argsort(torch.cat(parts))
    weights = [result.weights for result in results if result.weights is not None]
    return InitResult(
        vectors=torch.cat([result.vectors for result in results], 1)[:, order],
        fallback=torch.cat([result.fallback for result in results], 1)[:, order],
        weights=torch.cat(weights, 1)[:, order] if len(weights) == len(results) else None,
        is_centroid=results[0].is_centroid,
    )


def batches(novel: Tensor, triples: np.ndarray, most: int, width: int) -> list[Tensor]:
    """Ids of novel entities, (n,), in batches, each padded to its largest number of triples.

    Entities of a batch have at most ``FEW`` triples, or numbers that differ by a factor of two at
    most. A batch has at most ``most`` entities, and vectors of length ``width`` for all its
    triples, padding included, have at most ``BUDGET`` numbers, or it is one entity.
    """
    ends = torch.from_numpy(triples[:, [HEAD, TAIL]].copy(order="C")).flatten()
    number = torch.bincount(ends, minlength=int(novel.max()) + 1)[novel] if len(novel) else novel
    level = (number / FEW).clamp(min=1).log2().ceil().long()
    parts = list[Tensor]()
    for step in sorted(set(level.tolist())):
        affordable = BUDGET // (FEW * 2**step * width)
        parts += torch.split(novel[level == step], max(1, min(most, affordable)))
    return parts


def schedule(
    triples: np.ndarray, known: int, number: int, fit_again: bool
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Ids of novel entities, (m,), and a mask of their triples, (T,), step by step.
    The last step has all novel entities.

    The first round inserts layer by layer, from triples with known entities and with earlier
    layers. In later rounds all are inserted together from all triples, each with the vectors that
    the others had before. There are later rounds if two novel entities have a triple, or if a new
    relation can only be fitted then (``fit_again``).
    """
    everyone, ends = np.arange(known, known + number), triples[:, [HEAD, TAIL]]
    proper = ends[:, 0] != ends[:, 1]
    if fit_again or ((ends >= known).all(1) & proper).any():
        layer = np.concatenate([np.full(known, -1), layers(triples[proper], known, number)])
        of_ends = layer[ends]
        for step in range(int(layer.max()) + 1):
            in_layer = (of_ends.max(1) == step) & (of_ends.min(1) < step)
            yield everyone[layer[known:] == step], in_layer
        for _ in range(ROUNDS - 2):
            yield everyone, proper
    yield everyone, proper


def layers(triples: np.ndarray, known: int, number: int) -> np.ndarray:
    """Fewest triples between each of ``number`` novel entities and a known one, minus 1;
    0 if there is no path; (n,). ``triples``: ids, (T, 3).
    """
    ends = triples[:, [HEAD, TAIL]] - known
    layer = np.full(number, number)
    layer[ends[(ends >= 0).sum(1) == 1].max(1)] = 0
    between = ends[(ends >= 0).all(1)]
    for _ in range(number):
        nearer = layer.copy()
        np.minimum.at(nearer, between, layer[between[:, ::-1]] + 1)
        if (nearer == layer).all():
            break
        layer = nearer
    return np.where(layer < number, layer, 0)


def context_for(
    novel: NovelEntities,
    ids: Tensor,
    triples: np.ndarray,
    again: bool = False,
    confidence: np.ndarray | None = None,
) -> InitContext:
    """What an initializer sees of the novel entities ``ids``, (m,), ascending, and their
    ``triples``, (T, 3), with their ``confidence``, (T,).

    Other novel entities may have vectors; they are no candidates. These have vectors themselves if
    they are inserted ``again``.

    Without known triples, all known entities are eligible.
    """
    session = trained_session(novel.known_triples, novel.theta, novel.kinds)
    session.entities[:, novel.known :] = False
    words = torch.zeros(len(session.graph.entities), 1)
    if novel.words is not None:
        words = torch.from_numpy(novel.words)
    places = ids - novel.known
    keys = places[None, :1]
    entity_keys = None
    if novel.entity_keys is not None:
        keys = torch.zeros_like(keys)
        entity_keys = torch.from_numpy(novel.entity_keys)[places][None]
    context = context_in_session(
        novel.theta,
        session,
        ids[None],
        _insert_triples(ids, triples),
        words,
        novel.seed,
        keys,
        triples=torch.from_numpy(triples),
        confidence=None if confidence is None else torch.from_numpy(confidence),
    )
    return replace(
        context,
        eligible=context.eligible if len(novel.known_triples) else context.known,
        entity_keys=entity_keys,
        by_kind=novel.kinds is not None,
        scale=novel.scale,
        start=novel.theta.entity[:, ids] if again else None,
    )


def _insert_triples(ids: Tensor, triples: np.ndarray) -> Tensor:
    """The triples, (T, 3), of each of the novel entities ``ids``, (m,), ascending: rows of 0 (the
    place in a stack of one), place in ``ids`` and triple, in the order of places; shape (I, 3).
    """
    ends = torch.from_numpy(triples[:, [HEAD, TAIL]].copy(order="C"))
    place = torch.searchsorted(ids, ends).clamp(max=len(ids) - 1)
    triple, end = (ids[place] == ends).nonzero(as_tuple=True)
    order = torch.argsort(place[triple, end], stable=True)
    triple, end = triple[order], end[order]
    return torch.stack([torch.zeros_like(triple), place[triple, end], triple], 1)
