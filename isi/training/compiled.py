"""Compiled training with one observation per update: a few hundred times as fast as in PyTorch.

For ANALOGY, DistMult and ComplEx, whose relations are scalars and 2×2 blocks
(``isi.models.bilinear``). An update takes one step of Adagrad on each row that its observation
touches, and on no other, so its time hardly grows with the number of entities. Importing numba
takes a second: import this module where it is used.

One table has all rows, (E + R + ``MEMORY``, d): entities, relations, then what an update computes.
Functions get numbers of rows in place of rows, whose reference counts would cost as much as the
arithmetic, and are inlined for the same reason.
"""

import math
from typing import cast

import numpy as np
from numpy.typing import NDArray

from isi.errors import extra
from isi.graph.graph import RELATION
from isi.models.bilinear import BlockModel
from isi.models.stack import Embedding
from isi.training.batches import TrainingData, sample_epoch

with extra("pipeline"):
    from numba import njit

Floats = NDArray[np.float32]
Ids = NDArray[np.int32]

#: Optimizations that the compiler may use: sum in any order, fuse products with sums, and compute 1
#: / √ from the processor's estimate by a step of Newton's method. The compiled code is fixed: equal
#: input gives equal bits.
FAST = {"reassoc", "nsz", "contract", "arcp", "afn"}
#: Of ``update``: rows, squares, scalars, rate, decay, triples, tails, heads, relations.
SIGNATURE = "void(f4[:, ::1], f4[:, ::1], i8, f4, f4, " + ", ".join(["i4[:, ::1]"] * 4) + ")"
MEMORY = 6  #: Number of rows that an update computes.

inner = njit(error_model="numpy", fastmath=FAST, forceinline=True)


@inner
def _transform(rows: Floats, v: int, w: int, scalars: int, total: Floats, to: int) -> None:
    """Add vᵀW to a row of a table."""
    half = (rows.shape[1] - scalars) // 2
    for i in range(scalars):
        total[to, i] += rows[v, i] * rows[w, i]
    for a in range(scalars, scalars + half):
        total[to, a] += rows[v, a] * rows[w, a] - rows[v, a + half] * rows[w, a + half]
    for a in range(scalars, scalars + half):
        total[to, a + half] += rows[v, a + half] * rows[w, a] + rows[v, a] * rows[w, a + half]


@inner
def _transform_tail(rows: Floats, v: int, w: int, scalars: int, total: Floats, to: int) -> None:
    """Add Wv."""
    half = (rows.shape[1] - scalars) // 2
    for i in range(scalars):
        total[to, i] += rows[v, i] * rows[w, i]
    for a in range(scalars, scalars + half):
        total[to, a] += rows[v, a] * rows[w, a] + rows[v, a + half] * rows[w, a + half]
    for a in range(scalars, scalars + half):
        total[to, a + half] += rows[v, a + half] * rows[w, a] - rows[v, a] * rows[w, a + half]


@inner
def _relation_gradient(
    rows: Floats, head: int, tail: int, scalars: int, total: Floats, to: int
) -> None:
    """Add the gradient of ⟨hᵀW, t⟩ by the relation's row."""
    half = (rows.shape[1] - scalars) // 2
    for i in range(scalars):
        total[to, i] += rows[head, i] * rows[tail, i]
    for a in range(scalars, scalars + half):
        b = a + half
        total[to, a] += rows[head, a] * rows[tail, a] + rows[head, b] * rows[tail, b]
    for a in range(scalars, scalars + half):
        b = a + half
        total[to, b] += rows[head, a] * rows[tail, b] - rows[head, b] * rows[tail, a]


@inner
def _add_gradients(
    rows: Floats,
    gradients: Floats,
    vector: int,
    by_vector: int,
    row: int,
    times: np.float32,
    label: np.float32,
) -> None:
    """Add the gradients of a loss of f = ⟨vector, row⟩ by row and vector, as often as ``times``;
    the slope by f is σ(f) - label.
    """
    score = np.float32(0)
    for i in range(rows.shape[1]):
        score += rows[vector, i] * rows[row, i]
    probability = np.float32(1) / (np.float32(1) + np.float32(math.exp(-score)))
    slope = times * (probability - label)
    for i in range(rows.shape[1]):
        gradients[row, i] += slope * rows[vector, i]
        rows[by_vector, i] += slope * rows[row, i]


@inner
def _add_corrupted(
    rows: Floats,
    gradients: Floats,
    vector: int,
    by_vector: int,
    ids: Ids,
    number: int,
    times: Ids,
) -> None:
    """Add the gradients of an observation's corruptions, each different one once;
    ``times``, (E + R,), is zero before and after.
    """
    for column in range(ids.shape[1]):
        times[ids[number, column]] += 1
    for column in range(ids.shape[1]):
        row = ids[number, column]
        if times[row]:
            often = np.float32(times[row])
            _add_gradients(rows, gradients, vector, by_vector, row, often, np.float32(0))
            times[row] = 0


@inner
def _add_loss_gradient(
    rows: Floats,
    gradients: Floats,
    scalars: int,
    triples: Ids,
    tails: Ids,
    heads: Ids,
    relations: Ids,
    number: int,
    times: Ids,
) -> None:
    """Add the gradient of -log σ(f) of a triple and -log σ(-f) of its corruptions.

    f(h, r, t) = ⟨hᵀW, t⟩ = ⟨h, Wt⟩ = ⟨r, g⟩, where g is the gradient of f by r. So all corrupted
    tails are multiplied by one mapped head, all corrupted heads by one mapped tail, and all
    corrupted relations by one g. The gradient by each of these three, Σ slope · row, is summed
    first and then mapped to the triple's own rows.
    """
    head, relation, tail = triples[number, 0], triples[number, 1], triples[number, 2]
    first = len(rows) - MEMORY
    mapped_head, mapped_tail, of_relation = first, first + 1, first + 2
    by_mapped_head, by_mapped_tail, by_of_relation = first + 3, first + 4, first + 5
    for memory in range(first, len(rows)):
        for i in range(rows.shape[1]):
            rows[memory, i] = 0
    _transform(rows, head, relation, scalars, rows, mapped_head)
    _transform_tail(rows, tail, relation, scalars, rows, mapped_tail)
    _relation_gradient(rows, head, tail, scalars, rows, of_relation)

    single = np.float32(1)
    _add_gradients(rows, gradients, mapped_head, by_mapped_head, tail, single, single)
    _add_corrupted(rows, gradients, mapped_head, by_mapped_head, tails, number, times)
    _add_corrupted(rows, gradients, mapped_tail, by_mapped_tail, heads, number, times)
    _add_corrupted(rows, gradients, of_relation, by_of_relation, relations, number, times)

    _transform_tail(rows, by_mapped_head, relation, scalars, gradients, head)
    _transform_tail(rows, tail, by_of_relation, scalars, gradients, head)
    _transform(rows, by_mapped_tail, relation, scalars, gradients, tail)
    _transform(rows, head, by_of_relation, scalars, gradients, tail)
    _relation_gradient(rows, head, by_mapped_head, scalars, gradients, relation)
    _relation_gradient(rows, by_mapped_tail, tail, scalars, gradients, relation)


@inner
def _adagrad(
    rows: Floats,
    squares: Floats,
    gradients: Floats,
    ids: Ids,
    number: int,
    last: Ids,
    rate: np.float32,
    decay: np.float32,
) -> None:
    """One step of Adagrad with weight decay on the rows of an observation's ids, but those that
    have had it (``last``, (E + R,): the observation of each row's last step); resets their
    gradient to zero.
    """
    for column in range(ids.shape[1]):
        row = ids[number, column]
        if last[row] == number:
            continue
        last[row] = number
        for i in range(rows.shape[1]):
            step = gradients[row, i] + decay * rows[row, i]
            squares[row, i] += step * step
            rows[row, i] -= rate * step * (np.float32(1) / np.sqrt(squares[row, i]))
            gradients[row, i] = 0


@njit(SIGNATURE, cache=True, error_model="numpy", fastmath=FAST)
def update(
    rows: Floats,
    squares: Floats,
    scalars: int,
    rate: np.float32,
    decay: np.float32,
    triples: Ids,
    tails: Ids,
    heads: Ids,
    relations: Ids,
) -> None:
    """Update one embedding in place, once for each observation.

    ``rows``: entities, relations and memory (see above); ``squares``, (E + R, d): Adagrad's
    accumulators; the first ``scalars`` coordinates are scalars. ``triples``: (N, 3); replacements
    of their tails, heads and relations: (N, K). Ids of relations count from E.
    """
    gradients = np.zeros_like(squares)
    times = np.zeros(len(squares), np.int32)
    last = np.full(len(squares), -1, np.int32)
    for number in range(len(triples)):
        _add_loss_gradient(
            rows, gradients, scalars, triples, tails, heads, relations, number, times
        )
        _adagrad(rows, squares, gradients, triples, number, last, rate, decay)
        _adagrad(rows, squares, gradients, tails, number, last, rate, decay)
        _adagrad(rows, squares, gradients, heads, number, last, rate, decay)
        _adagrad(rows, squares, gradients, relations, number, last, rate, decay)


def run_compiled_epoch(
    embedding: Embedding,
    squares: Embedding,
    data: TrainingData,
    ratio: int,
    rate: float,
    decay: float,
    root: int,
    epoch: int,
) -> None:
    """Train each embedding of a stack in place for an epoch by Adagrad (sums ``squares``,
    ``rate``; ``decay``, of the rows that an observation touches).

    Each observation has ``ratio`` corrupted tails, ``ratio`` heads and, if R > 1, ``ratio``
    relations.
    """
    entities, width = embedding.entity.shape[1:]
    scalars = width * cast(BlockModel, embedding.model).scalars // 100
    memory = np.empty((MEMORY, width), np.float32)
    for model, corrupted in enumerate(sample_epoch(data, ratio, root, epoch)):
        tables, sums = (
            (stack.entity[model].numpy(), stack.relation[model].numpy())
            for stack in (embedding, squares)
        )
        ids = [
            part.numpy().astype(np.int32) for part in (corrupted.triples, *corrupted.replacements)
        ]
        if len(ids) < 4:  # with R = 1, relations are not corrupted
            ids.append(ids[1][:, :0].copy())
        ids[0][:, RELATION] += entities
        ids[3] += entities
        rows, summed = np.concatenate([*tables, memory]), np.concatenate(sums)
        update(rows, summed, scalars, np.float32(rate), np.float32(decay), *ids)
        for table, result in ((tables, rows), (sums, summed)):
            table[0][:] = result[:entities]
            table[1][:] = result[entities : entities + len(table[1])]
