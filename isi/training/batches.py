"""Training data of a stack of embeddings: batches of observations, and their negatives.

On a small graph a batch is two dense tables of counts over all triples, of positives and of
negatives, and its gradient takes a few matrix products. On a large graph a batch is a list of
triples, and its cost grows with its length.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from isi.config import Count, Section
from isi.graph.graph import HEAD, RELATION, TAIL, Graph
from isi.graph.sessions import TRAIN, Session
from isi.models.scoring import TripleList
from isi.random import stream

#: Batches are dense up to this number of possible triples, R · E²: about there both forms are
#: equally fast for one embedding. The tables of a stack then take at most a gigabyte.
DENSE_LIMIT = 2**23


class Negatives(Section):
    """``negatives`` in params: how triples are corrupted."""

    mode: Literal["sampled", "expected"]
    ratio: Count
    head_pool: Literal["unseen", "all"]


@dataclass(frozen=True)
class TrainingData:
    """The training observations of a stack of sessions, and the pools of negatives."""

    session: Session
    #: observations of each triple of the graph, 0 where it is no training triple; shape: (M, T),
    #: int64
    counts: Tensor
    tail_pool: Tensor  #: entities that may be corrupted tails; shape: (M, E), float32 of 0 and 1
    #: entities that may be corrupted heads of a relation; shape: (M, R, E), float32
    head_pool: Tensor
    head_ids: Tensor  #: all entity ids, those of ``head_pool`` first; shape: (M, R, E), int64
    purpose: str  #: prefix of the purposes of its random streams
    #: keys of each embedding's random streams, between purpose and epoch; shape: (M, K)
    keys: Tensor


@dataclass(frozen=True)
class DenseBatch:
    """A batch of each embedding of a stack as tables of counts; shapes: (M, R, E, E)."""

    positives: Tensor
    negatives: Tensor

    def touched(self) -> tuple[Tensor, Tensor]:
        """Whether entities, (M, E), and relations, (M, R), are in a triple of the batch."""
        there = (self.positives + self.negatives) > 0
        by_head, by_tail = there.any(3), there.any(2)
        return by_head.any(1) | by_tail.any(1), by_head.any(2)


@dataclass(frozen=True)
class ListBatch:
    """Batches of a stack's embeddings, joined to one list of N triples;
    in each batch, positives before negatives.
    """

    triples: TripleList
    positive: Tensor  #: 1 for positives, 0 for negatives; shape: (N,), float32

    def touched(self) -> tuple[Tensor, Tensor]:
        """Whether entities, (M, E), and relations, (M, R), are in a triple of the batch."""
        triples = self.triples
        models, relations, entities = triples.shape
        by_entity = torch.zeros(models, entities, dtype=torch.bool)
        by_entity[triples.model, triples.head] = True
        by_entity[triples.model, triples.tail] = True
        by_relation = torch.zeros(models, relations, dtype=torch.bool)
        by_relation[triples.model, triples.relation] = True
        return by_entity, by_relation


@dataclass(frozen=True)
class Corrupted:
    """Observations of an embedding, and the replacements of their tails, heads and,
    if R > 1, relations.
    """

    triples: Tensor  #: shape: (N, 3)
    replacements: list[Tensor]  #: ids; shapes: (N, ratio)

    def at(self, number: int) -> Corrupted:
        """The observation at an index, N = 1; beyond the last one, N = 0."""
        row = slice(number, number + 1)
        return Corrupted(self.triples[row], [ids[row] for ids in self.replacements])

    def negatives(self) -> Tensor:
        """Corrupted triples, by tail, then by head, then (if R > 1) by relation;
        shape (2 or 3 times N · ratio, 3).
        """
        parts = []
        for slot, ids in zip((TAIL, HEAD, RELATION), self.replacements, strict=False):
            part = self.triples.repeat_interleave(ids.shape[1], 0)
            part[:, slot] = ids.flatten()
            parts.append(part)
        return torch.cat(parts)


def training_data(session: Session, purpose: str, keys: Tensor, head_pool: str) -> TrainingData:
    """The training data of a stack.

    ``head_pool``: ``all`` entities, or those ``unseen`` as head of a relation in train, if any. See
    ``TrainingData``.
    """
    graph, train = session.graph, session.members(TRAIN)
    heads = (
        torch.zeros(len(keys), len(graph.relations), len(graph.entities))
        + session.entities[:, None]
    )
    if head_pool == "unseen":
        seen = torch.zeros_like(heads, dtype=torch.bool)
        models, triples = train.nonzero(as_tuple=True)
        seen[models, graph.triples[triples, RELATION], graph.triples[triples, HEAD]] = True
        unseen = heads * ~seen
        heads = torch.where(unseen.sum(-1, keepdim=True) > 0, unseen, heads)
    head_ids = torch.argsort(heads, dim=-1, descending=True, stable=True)
    return TrainingData(
        session, train * graph.counts, session.entities.float(), heads, head_ids, purpose, keys
    )


def scaled_counts(counts: Tensor, most: int) -> Tensor:
    """Counts of triples, (T,), int64, scaled down so that they sum up to about ``most``, each at
    least 1; unchanged if their sum is no more. An epoch lists each observation, so that its time
    and memory grow with their sum.
    """
    total = int(counts.sum())
    if total <= most:
        return counts
    return (counts.double() * (most / total)).long().clamp(min=1)


def shuffle_into_batches(
    data: TrainingData, root: int, epoch: int, size: int
) -> list[list[np.ndarray]]:
    """Triple ids of an epoch's shuffled observations, (N,), by batch, then model; N ≤ ``size``.

    The N of one model differ by at most 1. Embeddings with fewer batches than others have empty
    ones at the end.
    """
    by_model = []
    for counts, key in zip(data.counts.cpu().numpy(), data.keys.tolist(), strict=True):
        observations = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
        stream(root, f"{data.purpose} batches", *key, epoch).shuffle(observations)
        by_model.append(np.array_split(observations, max(1, -(-len(observations) // size))))
    longest, empty = max(map(len, by_model)), np.empty(0, dtype=np.int32)
    return [
        [parts[number] if number < len(parts) else empty for parts in by_model]
        for number in range(longest)
    ]


def batches(
    data: TrainingData, negatives: Negatives, batch_size: int, root: int, epoch: int
) -> Iterator[tuple[DenseBatch | ListBatch, Tensor]]:
    """The batches of an epoch, dense or as lists, with their numbers of positives, (M,)."""
    graph, ratio, sampled = (
        data.session.graph,
        negatives.ratio,
        is_sampled(negatives, data.session.graph),
    )
    singles = sample_epoch(data, ratio, root, epoch) if sampled and batch_size == 1 else None
    for number, observed in enumerate(shuffle_into_batches(data, root, epoch, batch_size)):
        positives = torch.tensor([len(triples) for triples in observed])
        if not sampled:
            counts = count_positives(data, observed)
            yield DenseBatch(counts, expected_negatives(data, counts, ratio)), positives
            continue
        if singles is None:
            corrupted = corrupt(data, observed, ratio, root, "negatives", epoch, number)
        else:
            corrupted = [part.at(number) for part in singles]
        batch, dense = list_batch(data, corrupted), is_dense(graph)
        yield (
            DenseBatch(count_positives(data, observed), count_negatives(data, batch))
            if dense
            else batch,
            positives,
        )


def is_sampled(negatives: Negatives, graph: Graph) -> bool:
    """Whether negatives are sampled: if params say so,
    or if the graph is too large for dense batches.
    """
    return negatives.mode == "sampled" or not is_dense(graph)


def is_dense(graph: Graph) -> bool:
    """Whether batches over a graph are dense tables."""
    return len(graph.relations) * len(graph.entities) ** 2 <= DENSE_LIMIT


def count_positives(data: TrainingData, observed: list[np.ndarray]) -> Tensor:
    """Count the observations of each embedding, triple ids (N,), in a table;
    shape (M, R, E, E), float32.
    """
    graph = data.session.graph
    relations, entities = len(graph.relations), len(graph.entities)
    counts = [np.bincount(triples, minlength=len(graph.triples)) for triples in observed]
    head, relation, tail = graph.triples.T
    table = torch.zeros(len(observed), relations * entities * entities)
    table[:, (relation * entities + head) * entities + tail] = torch.as_tensor(
        np.stack(counts), dtype=torch.float32
    )
    return table.view(-1, relations, entities, entities)


def expected_negatives(data: TrainingData, positives: Tensor, ratio: int) -> Tensor:
    """Expected count of each triple among the corrupted triples of a batch; shape (M, R, E, E).

    Each slot of a positive is corrupted ``ratio`` times, uniformly: tails by the session's
    entities, heads by the relation's pool, relations by those other than the true one.
    """
    by_head, by_tail = positives.sum(-1), positives.sum(-2)  # (M, R, E)
    relations = positives.shape[1]
    tails = data.tail_pool / data.tail_pool.sum(-1, keepdim=True)
    heads = data.head_pool / data.head_pool.sum(-1, keepdim=True)
    negatives = (by_head * ratio)[..., None] * tails[:, None, None]
    negatives.addcmul_(heads[..., None], (by_tail * ratio)[:, :, None])
    if relations > 1:
        share = ratio / (relations - 1)
        negatives.add_(positives.sum(1, keepdim=True), alpha=share).sub_(positives, alpha=share)
    return negatives


def sample_epoch(data: TrainingData, ratio: int, root: int, epoch: int) -> list[Corrupted]:
    """Corrupt an epoch for batches of size 1: one stream per embedding,
    since a new one costs more than an update.
    """
    (observed,) = shuffle_into_batches(data, root, epoch, max(1, int(data.counts.sum(1).max())))
    return corrupt(data, observed, ratio, root, "negatives in turn", epoch)


def corrupt(
    data: TrainingData,
    observed: list[np.ndarray],
    ratio: int,
    root: int,
    purpose: str,
    *number: int,
) -> list[Corrupted]:
    """Corrupt observations of each embedding at random;
    the expected counts are ``expected_negatives``.

    Random streams are keyed by the purpose, the embedding's keys and ``number``: the epoch, and
    perhaps the batch.
    """
    corrupted = []
    for model, (ids, key) in enumerate(zip(observed, data.keys.tolist(), strict=True)):
        rng = stream(root, f"{data.purpose} {purpose}", *key, *number)
        triples = data.session.graph.triples[torch.as_tensor(ids, dtype=torch.int64)]
        corrupted.append(
            Corrupted(triples, _replacements(rng, data, model, triples[:, RELATION], ratio))
        )
    return corrupted


def _replacements(
    rng: np.random.Generator, data: TrainingData, model: int, relation: Tensor, ratio: int
) -> list[Tensor]:
    """``ratio`` random tails, heads and other relations for triples with the relations (N,);
    shapes (N, ratio).
    """
    relations = data.head_pool.shape[1]
    relation = relation[:, None].expand(-1, ratio)

    def below(limit: Tensor | int) -> Tensor:
        return (torch.as_tensor(rng.random(relation.shape)) * limit).long()

    pool = data.tail_pool[model].nonzero()[:, 0]
    tails = pool[below(len(pool))]
    heads = data.head_ids[model, relation, below(data.head_pool[model].sum(-1)[relation])]
    if relations == 1:
        return [tails, heads]
    other = below(relations - 1)
    return [tails, heads, other + (other >= relation)]


def list_batch(data: TrainingData, corrupted: list[Corrupted]) -> ListBatch:
    """Observations of all embeddings, and their corrupted triples, as one list."""
    parts = [(part.triples, part.negatives()) for part in corrupted]
    models = torch.repeat_interleave(torch.tensor([len(p) + len(n) for p, n in parts]))
    positive = torch.cat([torch.cat([torch.ones(len(p)), torch.zeros(len(n))]) for p, n in parts])
    head, relation, tail = torch.cat([torch.cat(pair) for pair in parts]).T
    _, relations, entities = data.head_pool.shape
    return ListBatch(
        TripleList((len(corrupted), relations, entities), models, head, relation, tail), positive
    )


def count_negatives(data: TrainingData, batch: ListBatch) -> Tensor:
    """The corrupted triples of a batch as a table of counts; shape (M, R, E, E), int64."""
    models, relations, entities = data.head_pool.shape
    triples = batch.triples
    place = (
        (triples.model * relations + triples.relation) * entities + triples.head
    ) * entities + triples.tail
    table = torch.bincount(
        place[batch.positive == 0], minlength=models * relations * entities * entities
    )
    return table.view(models, relations, entities, entities)
