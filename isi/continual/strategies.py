"""Strategies: which facts are trained on when a snapshot arrives, which rows move, at what price.

Each one is a function of the ``Arrival`` of a snapshot, whose new entities and relations have been
inserted; it returns the embedding after the training.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from isi.config import Count, NotNegative
from isi.insertion.inverses import both_ways
from isi.models.stack import Embedding, uniform
from isi.random import stream
from isi.training.rows import (
    Earlier,
    Facts,
    Moving,
    Objective,
    OnEpoch,
    Penalty,
    Recipe,
    Tables,
    Task,
    fit,
    silent,
)


@dataclass(frozen=True, eq=False)
class Schedule:
    """How long embeddings are trained, and how those of the first snapshot begin."""

    recipe: Recipe
    base_epochs: int  #: of the first snapshot, and of training everything again
    epochs: int  #: of each later snapshot
    half_range: float  #: of the uniform distribution of first vectors


@dataclass(frozen=True, eq=False)
class Arrival:
    """A snapshot that has arrived: its entities and relations are inserted, and not yet trained.

    Triples are in the unpacked form of ``isi.insertion.inverses``.
    """

    theta: Embedding  #: with the rows of new entities and relations; (1, E, d)
    new: Tensor  #: training triples of the snapshot, (N, 3)
    old: Tensor  #: training triples of earlier snapshots, (K, 3)
    first_new: Moving  #: ids of the first new entity and relation
    schedule: Schedule
    root: int
    key: tuple[int, ...]  #: of random streams
    on_epoch: OnEpoch = silent

    def fit(
        self,
        facts: Facts,
        *,
        epochs: int | None = None,
        moving: Moving | None = None,
        share: float = 0.0,
        penalty: Penalty | None = None,
    ) -> Embedding:
        """Train the ``moving`` rows, by default all, on facts.

        ``share`` is β, the weight of the part of new entities in earlier facts.
        """
        task = Task(facts, moving or Moving(), Earlier(self.old, share), penalty)
        number = self.schedule.epochs if epochs is None else epochs
        return fit(
            self.theta, task, self.schedule.recipe, number, self.root, self.key, self.on_epoch
        )

    @property
    def moves(self) -> bool:
        """Whether the snapshot has new entities or relations."""
        entities, relations = self.theta.entity.shape[1], self.theta.relation.shape[1]
        return self.first_new.entity < entities or self.first_new.relation < relations


Strategy = Callable[..., Embedding]
STRATEGIES: dict[str, Strategy] = {}  #: by name


def strategy(name: str) -> Callable[[Strategy], Strategy]:
    """Register a function of an ``Arrival`` (and of options) as a strategy."""

    def register(function: Strategy) -> Strategy:
        STRATEGIES[name] = function
        return function

    return register


def equally(triples: Tensor) -> Facts:
    """Facts that weigh the same."""
    return Facts(triples, torch.ones(len(triples)))


@strategy("insert")
def insert_only(arrival: Arrival) -> Embedding:
    """No training: the vectors of the initializer stay."""
    return arrival.theta


@strategy("new_rows")
def new_rows(arrival: Arrival, epochs: Count | None = None) -> Embedding:
    """The rows of new entities and relations are trained on the new facts; the others are frozen.

    Nothing keeps a new row from outranking earlier answers.

    Args:
        epochs: None: those of the schedule.
    """
    if not arrival.moves:
        return arrival.theta
    facts = equally(_with_new_rows(arrival))
    return arrival.fit(facts, epochs=epochs, moving=arrival.first_new)


@strategy("new_rows_and_earlier")
def new_rows_and_earlier(
    arrival: Arrival, share: NotNegative = 1.0, epochs: Count | None = None
) -> Embedding:
    """As ``new_rows``, which stand out of the way of earlier facts.

    Args:
        share: β: weight of the part of new entities in earlier facts.
        epochs: None: those of the schedule.
    """
    if not arrival.moves:
        return arrival.theta
    facts = equally(_with_new_rows(arrival))
    return arrival.fit(facts, epochs=epochs, moving=arrival.first_new, share=share)


@strategy("finetune")
def finetune(arrival: Arrival) -> Embedding:
    """All rows are trained on the new facts."""
    return arrival.fit(equally(arrival.new))


@strategy("new_rows_then_all")
def new_rows_then_all(arrival: Arrival, share: NotNegative = 1.0) -> Embedding:
    """Half of the epochs as ``new_rows_and_earlier``, the others as ``finetune`` (IncDE)."""
    half = arrival.schedule.epochs // 2
    theta = arrival.theta
    if arrival.moves:
        facts = equally(_with_new_rows(arrival))
        theta = arrival.fit(facts, epochs=half, moving=arrival.first_new, share=share)
    rest = arrival.schedule.epochs - half
    later = replace(arrival, theta=theta, key=(*arrival.key, 1))
    return later.fit(equally(arrival.new), epochs=rest)


@strategy("replay")
def replay(arrival: Arrival, number: int = 5000, epochs: Count | None = None) -> Embedding:
    """All rows are trained on the new facts and on so many earlier ones at random, which weigh as
    much as all earlier ones, but at most ten times each.

    Args:
        epochs: None: those of the schedule.
    """
    rng = stream(arrival.root, "replay", *arrival.key)
    drawn = rng.permutation(len(arrival.old))[:number]
    weight = min(10.0, len(arrival.old) / max(1, len(drawn)))
    triples = torch.cat([arrival.new, arrival.old[torch.from_numpy(drawn)]])
    weights = torch.ones(len(triples))
    weights[len(arrival.new) :] = weight
    return arrival.fit(Facts(triples, weights), epochs=epochs)


@strategy("full_replay")
def full_replay(arrival: Arrival) -> Embedding:
    """All rows are trained on the facts of all snapshots."""
    return arrival.fit(equally(torch.cat([arrival.new, arrival.old])))


@strategy("l2")
def l2(arrival: Arrival, weight: float = 0.01) -> Embedding:
    """As ``finetune``; earlier rows are drawn to where they were, by the square of the distance."""
    before = arrival.theta
    ones = _Tables(torch.ones_like(before.entity[0]), torch.ones_like(before.relation[0]))
    return arrival.fit(equally(arrival.new), penalty=_drawn_back(arrival, ones, weight))


@strategy("ewc")
def ewc(arrival: Arrival, weight: float = 10.0) -> Embedding:
    """As ``l2``, each coordinate by its importance for earlier facts: the mean square of their
    gradients (Kirkpatrick et al. 2017).
    """
    return arrival.fit(
        equally(arrival.new), penalty=_drawn_back(arrival, importance(arrival), weight)
    )


@strategy("retrain")
def retrain(arrival: Arrival) -> Embedding:
    """Everything again: all rows from random ones, on the facts of all snapshots."""
    facts = equally(torch.cat([arrival.new, arrival.old]))
    theta = started(arrival.theta, arrival.schedule, arrival.root, arrival.key)
    again = replace(arrival, theta=theta)
    return again.fit(facts, epochs=arrival.schedule.base_epochs)


def started(
    theta: Embedding, schedule: Schedule, root: int, key: tuple[int, ...] = ()
) -> Embedding:
    """Random vectors in the form of an embedding in the unpacked form."""
    everyone = torch.ones(theta.entity.shape[:2], dtype=torch.bool)
    return uniform(
        everyone,
        theta.relation.shape[1],
        theta.model,
        theta.entity.shape[2],
        schedule.half_range,
        root,
        torch.tensor([key or (0,)]),
    )


@dataclass(frozen=True)
class _Tables:
    """A number for each coordinate of the rows of entities and of relations."""

    entity: Tensor
    relation: Tensor


def importance(arrival: Arrival) -> _Tables:
    """Mean square of the gradients of batches of earlier facts, by coordinate."""
    recipe = arrival.schedule.recipe.model_copy(update={"n3": 0.0})
    tables = Tables.of(arrival.theta, Moving(), recipe)
    loss = Objective(arrival.theta.model, tables, Task(equally(arrival.old)), recipe)
    rng = stream(arrival.root, "importance", *arrival.key)
    squares = [torch.zeros_like(table) for table in tables.trained]
    batches = torch.split(torch.arange(len(arrival.old)), recipe.batch_size)
    for place in batches if len(arrival.old) else ():
        gradients = torch.autograd.grad(loss.of(place, rng), tables.trained)
        for square, gradient in zip(squares, gradients, strict=True):
            square += gradient.to_dense().square() * (len(place) / len(arrival.old))
    return _Tables(*squares)


def _drawn_back(arrival: Arrival, importance: _Tables, weight: float) -> Penalty:
    """weight · Σ importance · (distance from the earlier row)² over earlier rows."""
    first = arrival.first_new
    before = arrival.theta.entity[0, : first.entity], arrival.theta.relation[0, : first.relation]
    important = importance.entity[: first.entity], importance.relation[: first.relation]

    def penalty(tables: Tables) -> Tensor:
        entity, relation = tables.all_entities(), tables.all_relations()
        moved = (entity[: first.entity] - before[0]).square() * important[0]
        turned = (relation[: first.relation] - before[1]).square() * important[1]
        return weight * (moved.sum() + turned.sum())

    return penalty


def _with_new_rows(arrival: Arrival) -> Tensor:
    """The new facts that have a new entity or relation."""
    head, relation, tail = arrival.new.T
    ends = torch.maximum(head, tail) >= arrival.first_new.entity
    return arrival.new[ends | (relation >= arrival.first_new.relation)]


def unpacked(triples: np.ndarray) -> Tensor:
    """Triples of ids, (N, 3), in both directions, (2N, 3)."""
    return both_ways(torch.from_numpy(triples))
