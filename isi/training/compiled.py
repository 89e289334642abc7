"""Updates one by one, compiled, for relations of scalars and 2×2 blocks (``embeddings.blocks``).

Importing numba takes a second: import this module where it is used.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Ids = NDArray[np.int32]

#: What the compiler may do: take a sum in any order, fuse products with sums, and take 1 / √ from the processor's
#: estimate by a step of Newton's. It settles that once, whatever the numbers are, so that equal input gives equal bits.
FAST = {"reassoc", "nsz", "contract", "arcp", "afn"}
#: Tables of entities and relations, scalars, rate, decay, triples, tails, heads, others.
SIGNATURE = "void(UniTuple(f4[:, ::1], 2), UniTuple(f4[:, ::1], 2), i8, f4, f4, " + ", ".join(["i4[:, ::1]"] * 4) + ")"

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
def _pullback(vector: Floats, row: Floats, scalars: int, result: Floats) -> None:
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
def _pair(head: Floats, tail: Floats, scalars: int, result: Floats) -> None:
    """Gradient of ⟨hᵀW, t⟩ by W's row."""
    _pullback(head, tail, scalars, result)
    half = (len(head) - scalars) // 2
    for i in range(len(head) - half, len(head)):
        result[i] = -result[i]


@inner
def _add(total: Floats, values: Floats) -> None:
    for i in range(len(total)):
        total[i] += values[i]


@inner
def _meet(what: Floats, table: Floats, one: int, label: np.float32, by_table: Floats, by_what: Floats) -> None:
    """Score ⟨what, row⟩, and add what its slope, σ(f) - label, pulls at both."""
    score = np.float32(0)
    for i in range(len(what)):
        score += what[i] * table[one, i]
    slope = np.float32(1) / (np.float32(1) + np.float32(math.exp(-score))) - label
    for i in range(len(what)):
        old = table[one, i]
        by_table[one, i] += slope * what[i]
        by_what[i] += slope * old


@inner
def _add_gradient(
    tables: tuple[Floats, Floats], gradients: tuple[Floats, Floats], scalars: int,
    triple: Ids, tails: Ids, heads: Ids, others: Ids, parts: Floats,
) -> None:  # fmt: skip
    """Add the gradient of -log σ(f) of a triple and -log σ(-f) of its corruptions.

    f(h, r, t) = ⟨hᵀW, t⟩ = ⟨h, Wt⟩ = ⟨r, pair(h, t)⟩: all corrupted tails meet one mapped head, all corrupted heads
    one mapped tail, and all corrupted relations one pair. What they pull at these, Σ slope · row, goes on to the
    triple's own rows at once.
    """
    (entity, relation), (by_entity, by_relation) = tables, gradients
    head, row, tail = entity[triple[0]], relation[triple[1]], entity[triple[2]]
    by_head, by_row, by_tail = by_entity[triple[0]], by_relation[triple[1]], by_entity[triple[2]]
    mapped, pull, passed = parts[0], parts[1], parts[2]  # in one piece, as unpacked rows would not be
    pull[:] = 0
    _transform(head, row, scalars, mapped)
    _meet(mapped, entity, triple[2], np.float32(1), by_entity, pull)
    for one in tails:
        _meet(mapped, entity, one, np.float32(0), by_entity, pull)
    _pullback(pull, row, scalars, passed)
    _add(by_head, passed)
    _pair(head, pull, scalars, passed)
    _add(by_row, passed)

    pull[:] = 0
    _pullback(tail, row, scalars, mapped)
    for one in heads:
        _meet(mapped, entity, one, np.float32(0), by_entity, pull)
    _transform(pull, row, scalars, passed)
    _add(by_tail, passed)
    _pair(pull, tail, scalars, passed)
    _add(by_row, passed)

    pull[:] = 0
    _pair(head, tail, scalars, mapped)
    for one in others:
        _meet(mapped, relation, one, np.float32(0), by_relation, pull)
    _pullback(tail, pull, scalars, passed)
    _add(by_head, passed)
    _transform(head, pull, scalars, passed)
    _add(by_tail, passed)


@inner
def _adagrad(values: Floats, squares: Floats, gradient: Floats, rate: np.float32, decay: np.float32) -> None:
    """A step of Adagrad with weight decay on a whole table, and its gradient back to zero."""
    for i in range(len(values)):
        step = gradient[i] + decay * values[i]
        squares[i] += step * step
        values[i] -= rate * step * (np.float32(1) / np.sqrt(squares[i]))
        gradient[i] = 0


@njit(SIGNATURE, cache=True, error_model="numpy", fastmath=FAST)
def update(
    tables: tuple[Floats, Floats], squares: tuple[Floats, Floats], scalars: int, rate: np.float32, decay: np.float32,
    triples: Ids, tails: Ids, heads: Ids, others: Ids,
) -> None:  # fmt: skip
    """An update of one model for each observation, one after the other, in place.

    Args:
        tables: vectors of entities and relations; shapes (E, d), (R, d).
        squares: Adagrad's accumulators.
        scalars: how many coordinates come before the blocks.
        triples: the observations; shape (N, 3).
        tails, heads, others: corrupted tails, heads and relations of each; shapes (N, K).
    """
    gradients = np.zeros_like(tables[0]), np.zeros_like(tables[1])
    parts = np.empty((3, tables[0].shape[1]), np.float32)
    for number in range(len(triples)):
        _add_gradient(
            tables, gradients, scalars, triples[number], tails[number], heads[number], others[number], parts
        )  # fmt: skip
        for table in range(2):
            _adagrad(tables[table].ravel(), squares[table].ravel(), gradients[table].ravel(), rate, decay)
