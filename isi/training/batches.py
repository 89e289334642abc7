"""What a stack of models learns from: observations dealt into batches, and their corruptions.

A batch has one of two forms. On a small graph it is two tables of counts over all triples,
positives and negatives, and its gradient is a few matrix products. On a large one it is a list of
triples, and costs as much as it has.
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
from isi.graph.sessions import TRAIN, Session, membership
from isi.models.triples import TripleList
from isi.random import stream

#: Possible triples of a graph up to which batches are tables: about where one model is as fast either way.
#: A stack's tables then stay within a gigabyte.
DENSE_LIMIT = 2**23


class Negatives(Section):
    """How triples are corrupted."""

    mode: Literal["sampled", "expected"]
    ratio: Count
    head_pool: Literal["unseen", "all"]


@dataclass(frozen=True)
class TrainingData:
    """What a stack of models learns from: the training observations and the pools of negatives."""

    session: Session
    #: of each training triple, 0 where it is none; shape: (M, T), int64
    counts: Tensor
    #: entities that may be corrupted tails; shape: (M, E), float32 of 0 and 1
    tail_pool: Tensor
    #: entities that may be corrupted heads of a relation; shape: (M, R, E), float32
    head_pool: Tensor
    #: the same as ids, those that may be first; shape: (M, R, E), int64
    head_ids: Tensor
    #: entities that were not in the session before; shape: (M, E), bool
    new: Tensor
    #: what it is for: part of the purpose of its random streams
    purpose: str
    #: what each model's random streams depend on beside root, purpose and epoch; shape: (M, K)
    keys: Tensor


@dataclass(frozen=True)
class DenseBatch:
    """A batch of each model of a stack as tables of counts."""

    #: shape: (M, R, E, E), float32
    positives: Tensor
    #: shape: (M, R, E, E)
    negatives: Tensor


@dataclass(frozen=True)
class ListBatch:
    """A batch of each model of a stack as one list of N triples, positives before negatives."""

    triples: TripleList
    #: 1 for positives, 0 for negatives; shape: (N,), float32
    positive: Tensor


@dataclass(frozen=True)
class Corrupted:
    """Observations of a model, and what takes the place of their tails, heads and (of several) relations."""

    #: shape: (N, 3)
    triples: Tensor
    #: ids; shapes: (N, ratio)
    others: list[Tensor]

    def only(self, number: int) -> Corrupted:
        """One observation; none where there are fewer."""
        return Corrupted(self.triples[number : number + 1], [ids[number : number + 1] for ids in self.others])

    def negatives(self) -> Tensor:
        """Corrupted triples, first of all by tail, then by head, then by relation; shape (2 or 3 · N · ratio, 3)."""
        parts = []
        for slot, ids in zip((TAIL, HEAD, RELATION), self.others, strict=False):
            part = self.triples.repeat_interleave(ids.shape[1], 0)
            part[:, slot] = ids.flatten()
            parts.append(part)
        return torch.cat(parts)


def training_data(
    session: Session, purpose: str, keys: Tensor, head_pool: str, novel: Tensor | None = None
) -> TrainingData:
    """Collect what D (a stack of sessions) teaches.

    Args:
        keys: (size, seed) of each model.
        novel: ids of the entities that were not in the session before, (M, n); all of them where it is null.
    """
    graph = session.graph
    train = session.members(TRAIN)
    heads = torch.zeros(len(keys), len(graph.relations), len(graph.entities))
    heads += session.entities[:, None]
    if head_pool == "unseen":
        seen = torch.zeros_like(heads, dtype=torch.bool)
        models, triples = train.nonzero(as_tuple=True)
        seen[models, graph.triples[triples, 1], graph.triples[triples, 0]] = True
        unseen = heads * ~seen
        heads = torch.where(unseen.sum(-1, keepdim=True) > 0, unseen, heads)
    head_ids = torch.argsort(heads, dim=-1, descending=True, stable=True)
    new = session.entities if novel is None else membership(novel, len(graph.entities))
    return TrainingData(session, train * graph.counts, session.entities.float(), heads, head_ids, new, purpose, keys)


def shuffle_into_batches(data: TrainingData, root: int, epoch: int, size: int) -> list[list[np.ndarray]]:
    """Deal an epoch's observations into batches of even length, at most ``size``.

    Returns:
        The triples of each observation, by batch and model. Models with fewer batches than others
        have empty ones at the end.
    """
    dealt = []
    for counts, key in zip(data.counts.cpu().numpy(), data.keys.tolist(), strict=True):
        observations = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
        stream(root, f"{data.purpose} batches", *key, epoch).shuffle(observations)
        dealt.append(np.array_split(observations, max(1, -(-len(observations) // size))))
    longest = max(len(batches) for batches in dealt)
    nothing = np.empty(0, dtype=np.int32)
    return [[batches[number] if number < len(batches) else nothing for batches in dealt] for number in range(longest)]


def batches(
    data: TrainingData, negatives: Negatives, batch_size: int, root: int, epoch: int
) -> Iterator[tuple[DenseBatch | ListBatch, Tensor]]:
    """The batches of an epoch, in the form that suits the graph, with their numbers of positives, (M,)."""
    graph, ratio = data.session.graph, negatives.ratio
    whole = in_turn(data, ratio, root, epoch) if batch_size == 1 and are_drawn(negatives, graph) else None
    for number, dealt in enumerate(shuffle_into_batches(data, root, epoch, batch_size)):
        positives = torch.tensor([len(observations) for observations in dealt])
        if not are_drawn(negatives, graph):
            counts = count_table(data, dealt)
            yield DenseBatch(counts, expected_negatives(data, counts, ratio)), positives
            continue
        if whole is None:
            lists = as_lists(data, dealt, ratio, root, epoch, number)
        else:
            lists = list_batch(data, [one.only(number) for one in whole])
        tables = fits_tables(graph)
        yield DenseBatch(count_table(data, dealt), count_negatives(data, lists)) if tables else lists, positives


def are_drawn(negatives: Negatives, graph: Graph) -> bool:
    """Whether negatives are drawn: where params say so, and on a graph that is too large for tables."""
    return negatives.mode == "sampled" or not fits_tables(graph)


def fits_tables(graph: Graph) -> bool:
    """Whether batches over a graph are tables."""
    return len(graph.relations) * len(graph.entities) ** 2 <= DENSE_LIMIT


def count_table(data: TrainingData, dealt: list[np.ndarray]) -> Tensor:
    """Observations of each model as a table of counts; shape (M, R, E, E), float32."""
    graph = data.session.graph
    relations, entities = len(graph.relations), len(graph.entities)
    counts = [np.bincount(observations, minlength=len(graph.triples)) for observations in dealt]
    head, relation, tail = graph.triples.T
    table = torch.zeros(len(dealt), relations * entities * entities)
    table[:, (relation * entities + head) * entities + tail] = torch.as_tensor(np.stack(counts), dtype=torch.float32)
    return table.view(-1, relations, entities, entities)


def expected_negatives(data: TrainingData, positives: Tensor, ratio: int) -> Tensor:
    """How often each triple is expected among a batch's corrupted ones; shape (M, R, E, E).

    For each positive, ``ratio`` corrupted tails, heads and relations: tails from the session's
    entities, heads from the relation's pool, relations from all but the true one.
    """
    by_tail, by_head = positives.sum(-1), positives.sum(-2)  # of a head, of a tail: (M, R, E)
    relations = positives.shape[1]
    tails = data.tail_pool / data.tail_pool.sum(-1, keepdim=True)
    heads = data.head_pool / data.head_pool.sum(-1, keepdim=True)
    negatives = (by_tail * ratio)[..., None] * tails[:, None, None]
    negatives.addcmul_(heads[..., None], (by_head * ratio)[:, :, None])
    if relations > 1:
        share = ratio / (relations - 1)
        negatives.add_(positives.sum(1, keepdim=True), alpha=share).sub_(positives, alpha=share)
    return negatives


def as_lists(data: TrainingData, dealt: list[np.ndarray], ratio: int, root: int, epoch: int, number: int) -> ListBatch:
    """A batch's observations and their corruptions, drawn as ``expected_negatives`` expects them.

    The draws of a model are keyed by the model, the epoch and the number of the batch alone.
    """
    return list_batch(data, corrupt(data, dealt, ratio, root, "negatives", epoch, number))


def in_turn(data: TrainingData, ratio: int, root: int, epoch: int) -> list[Corrupted]:
    """An epoch of each model in the order of batches of one, drawn at once: a stream takes longer than an update."""
    (dealt,) = shuffle_into_batches(data, root, epoch, max(1, int(data.counts.sum(1).max())))
    return corrupt(data, dealt, ratio, root, "negatives in turn", epoch)


def corrupt(
    data: TrainingData, dealt: list[np.ndarray], ratio: int, root: int, purpose: str, *number: int
) -> list[Corrupted]:
    """Corrupt observations of each model, with streams keyed by the model, a purpose and numbers."""
    triples = [data.session.graph.triples[torch.as_tensor(observed, dtype=torch.int64)] for observed in dealt]
    streams = (stream(root, f"{data.purpose} {purpose}", *key, *number) for key in data.keys.tolist())
    return [
        Corrupted(own, _others(rng, data, model, own[:, 1], ratio))
        for model, (rng, own) in enumerate(zip(streams, triples, strict=True))
    ]


def _others(rng: np.random.Generator, data: TrainingData, model: int, relation: Tensor, ratio: int) -> list[Tensor]:
    """``ratio`` other tails, heads and relations for triples of relations of shape (N,)."""
    relations = data.head_pool.shape[1]
    relation = relation[:, None].expand(-1, ratio)

    def below(choices: Tensor | int) -> Tensor:
        """A number below each of the choices (or below the one)."""
        return (torch.as_tensor(rng.random(relation.shape)) * choices).long()

    pool = data.tail_pool[model].nonzero()[:, 0]
    tails = pool[below(len(pool))]
    heads = data.head_ids[model, relation, below(data.head_pool[model].sum(-1)[relation])]
    if relations == 1:
        return [tails, heads]
    other = below(relations - 1)
    return [tails, heads, other + (other >= relation)]


def list_batch(data: TrainingData, corrupted: list[Corrupted]) -> ListBatch:
    """Observations and their corruptions as one list."""
    parts = [(model, one.triples, one.negatives()) for model, one in enumerate(corrupted)]
    models = torch.cat([torch.full((len(p) + len(n),), m) for m, p, n in parts])
    positive = torch.cat([torch.cat([torch.ones(len(p)), torch.zeros(len(n))]) for _, p, n in parts])
    head, relation, tail = torch.cat([torch.cat([p, n]) for _, p, n in parts]).T
    _, relations, entities = data.head_pool.shape
    return ListBatch(TripleList((len(corrupted), relations, entities), models, head, relation, tail), positive)


def count_negatives(data: TrainingData, lists: ListBatch) -> Tensor:
    """The corrupted triples of a batch as a table of counts; shape (M, R, E, E), int64."""
    models, relations, entities = data.head_pool.shape
    triples = lists.triples
    cell = ((triples.model * relations + triples.relation) * entities + triples.head) * entities + triples.tail
    table = torch.bincount(cell[lists.positive == 0], minlength=models * relations * entities * entities)
    return table.view(models, relations, entities, entities)
