"""Compiled training with one observation per update: a few hundred times as fast as in PyTorch.

For ANALOGY, DistMult and ComplEx, whose relations are scalars and 2×2 blocks
(``isi.models.bilinear``). Importing numba takes a second: import this module where it is used.
"""

import math
from typing import cast

import numpy as np
from numpy.typing import NDArray

from isi.errors import extra
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
#: Of ``update``: tables, squares, scalars, rate, decay, triples, tails, heads, relations.
SIGNATURE = (
    "void(UniTuple(f4[:, ::1], 2), UniTuple(f4[:, ::1], 2), i8, f4, f4, "
    + ", ".join(["i4[:, ::1]"] * 4)
    + ")"
)

inner = njit(error_model="numpy", fastmath=FAST)


@inner
def _transform(vector: Floats, row: Floats, scalars: int, result: Floats) -> None:
    """vᵀW."""
    half = (len(vector) - scalars) // 2
    for i in range(scalars):
        result[i] = vector[i] * row[i]
    a, x, first = vector[scalars:], row[scalars:], result[scalars:]
    b, y, second = a[half:], x[half:], first[half:]
    for i in range(half):
        first[i] = a[i] * x[i] - b[i] * y[i]
    for i in range(half):
        second[i] = b[i] * x[i] + a[i] * y[i]


@inner
def _transform_tail(vector: Floats, row: Floats, scalars: int, result: Floats) -> None:
    """Wv."""
    half = (len(vector) - scalars) // 2
    for i in range(scalars):
        result[i] = vector[i] * row[i]
    a, x, first = vector[scalars:], row[scalars:], result[scalars:]
    b, y, second = a[half:], x[half:], first[half:]
    for i in range(half):
        first[i] = a[i] * x[i] + b[i] * y[i]
    for i in range(half):
        second[i] = b[i] * x[i] - a[i] * y[i]


@inner
def _relation_gradient(head: Floats, tail: Floats, scalars: int, result: Floats) -> None:
    """Gradient of ⟨hᵀW, t⟩ by the relation's row."""
    _transform_tail(head, tail, scalars, result)
    half = (len(head) - scalars) // 2
    for i in range(len(head) - half, len(head)):
        result[i] = -result[i]


@inner
def _add(total: Floats, values: Floats) -> None:
    for i in range(len(total)):
        total[i] += values[i]


@inner
def _add_gradients(
    vector: Floats, table: Floats, row: int, label: np.float32, by_table: Floats, by_vector: Floats
) -> None:
    """Add the gradients of the loss of f = ⟨vector, row⟩ by row and vector;
    the slope by f is σ(f) - label.
    """
    score = np.float32(0)
    for i in range(len(vector)):
        score += vector[i] * table[row, i]
    slope = np.float32(1) / (np.float32(1) + np.float32(math.exp(-score))) - label
    for i in range(len(vector)):
        value = table[row, i]
        by_table[row, i] += slope * vector[i]
        by_vector[i] += slope * value


@inner
def _add_loss_gradient(
    tables: tuple[Floats, Floats],
    gradients: tuple[Floats, Floats],
    scalars: int,
    triple: Ids,
    tails: Ids,
    heads: Ids,
    relations: Ids,
    memory: Floats,
) -> None:
    """Add the gradient of -log σ(f) of a triple and -log σ(-f) of its corruptions.

    f(h, r, t) = ⟨hᵀW, t⟩ = ⟨h, Wt⟩ = ⟨r, g⟩, where g is the gradient of f by r. So all corrupted
    tails are multiplied by one mapped head, all corrupted heads by one mapped tail, and all
    corrupted relations by one g. The gradient by each of these three, Σ slope · row, is summed
    first and then mapped to the triple's own rows.
    """
    (entity, relation), (by_entity, by_relation) = tables, gradients
    head, row, tail = entity[triple[0]], relation[triple[1]], entity[triple[2]]
    by_head, by_row, by_tail = by_entity[triple[0]], by_relation[triple[1]], by_entity[triple[2]]
    # contiguous, as unpacked rows would not be
    mapped, by_mapped, result = memory[0], memory[1], memory[2]
    by_mapped[:] = 0
    _transform(head, row, scalars, mapped)
    _add_gradients(mapped, entity, triple[2], np.float32(1), by_entity, by_mapped)
    for corrupted in tails:
        _add_gradients(mapped, entity, corrupted, np.float32(0), by_entity, by_mapped)
    _transform_tail(by_mapped, row, scalars, result)
    _add(by_head, result)
    _relation_gradient(head, by_mapped, scalars, result)
    _add(by_row, result)

    by_mapped[:] = 0
    _transform_tail(tail, row, scalars, mapped)
    for corrupted in heads:
        _add_gradients(mapped, entity, corrupted, np.float32(0), by_entity, by_mapped)
    _transform(by_mapped, row, scalars, result)
    _add(by_tail, result)
    _relation_gradient(by_mapped, tail, scalars, result)
    _add(by_row, result)

    by_mapped[:] = 0
    _relation_gradient(head, tail, scalars, mapped)
    for corrupted in relations:
        _add_gradients(mapped, relation, corrupted, np.float32(0), by_relation, by_mapped)
    _transform_tail(tail, by_mapped, scalars, result)
    _add(by_head, result)
    _transform(head, by_mapped, scalars, result)
    _add(by_tail, result)


@inner
def _adagrad(
    values: Floats, squares: Floats, gradient: Floats, rate: np.float32, decay: np.float32
) -> None:
    """One step of Adagrad with weight decay on a whole table; resets its gradient to zero."""
    for i in range(len(values)):
        step = gradient[i] + decay * values[i]
        squares[i] += step * step
        values[i] -= rate * step * (np.float32(1) / np.sqrt(squares[i]))
        gradient[i] = 0


@njit(SIGNATURE, cache=True, error_model="numpy", fastmath=FAST)
def update(
    tables: tuple[Floats, Floats],
    squares: tuple[Floats, Floats],
    scalars: int,
    rate: np.float32,
    decay: np.float32,
    triples: Ids,
    tails: Ids,
    heads: Ids,
    relations: Ids,
) -> None:
    """Update one embedding in place, once for each observation.

    ``tables`` and ``squares``, Adagrad's accumulators: entities (E, d) and relations (R, d); the
    first ``scalars`` coordinates are scalars. ``triples``: (N, 3); replacements of their tails,
    heads and relations: ids, (N, K).
    """
    gradients = np.zeros_like(tables[0]), np.zeros_like(tables[1])
    memory = np.empty((3, tables[0].shape[1]), np.float32)
    for number in range(len(triples)):
        _add_loss_gradient(
            tables,
            gradients,
            scalars,
            triples[number],
            tails[number],
            heads[number],
            relations[number],
            memory,
        )
        for table in range(2):
            _adagrad(
                tables[table].ravel(), squares[table].ravel(), gradients[table].ravel(), rate, decay
            )


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
    """Train each embedding of a stack in place for an epoch by Adagrad
    (sums ``squares``, ``rate``, weight ``decay``).

    Each observation has ``ratio`` corrupted tails, ``ratio`` heads and, if R > 1, ``ratio``
    relations.
    """
    scalars = embedding.entity.shape[-1] * cast(BlockModel, embedding.model).scalars // 100
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
        update(tables, sums, scalars, np.float32(rate), np.float32(decay), *ids)
