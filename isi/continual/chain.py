"""A chain: one embedding that is carried from snapshot to snapshot of a timeline."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch

from isi.continual.classes import CLASS_MEAN, FOR_RELATIONS, class_means
from isi.continual.matrix import Phase
from isi.continual.strategies import (
    STRATEGIES,
    Arrival,
    Schedule,
    equally,
    started,
    unpacked,
)
from isi.continual.timeline import Timeline
from isi.errors import InputError, suggestion
from isi.insertion.api import choose, insert_request
from isi.insertion.inverses import pack, unpack
from isi.insertion.request import InsertRequest, KnownEmbedding
from isi.insertion.result import Inserted, with_vectors
from isi.models.losses import Loss
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.random import seed_of
from isi.training.rows import Moving, OnEpoch, Task, fit, silent


@dataclass(frozen=True)
class Growth:
    """How an embedding grows: by which initializer, and by which strategy of training."""

    #: a registered one, or ``CLASS_MEAN``; None: the best by the hold-out test
    initializer: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    strategy: str = "insert"
    strategy_options: Mapping[str, Any] = field(default_factory=dict)
    loss: Loss | None = "softmax"  #: that says what the scores mean to the initializer


@dataclass(frozen=True, eq=False)
class Grown:
    """An embedding of the entities of snapshots 0 to i."""

    snapshot: int  #: i
    phase: Phase  #: before or after the training on snapshot i
    theta: Embedding  #: (1, E, d), in the packed form of ``isi.insertion.inverses``
    seconds: float  #: of the processor, for the insertion or the training
    inserted: Inserted | None = None


def first_embedding(
    timeline: Timeline,
    model: Model,
    dimension: int,
    schedule: Schedule,
    root: int,
    key: tuple[int, ...] = (),
    on_epoch: OnEpoch = silent,
) -> Embedding:
    """The embedding of snapshot 0, trained from random vectors; in the packed form.

    Args:
        model: with inverse relations, which are added.
        root, key: of the random streams.
    """
    entities, relations = int(timeline.entities[0]), int(timeline.relations[0])
    width = model.width(dimension)
    empty = torch.zeros(1, entities, dimension), torch.zeros(1, 2 * relations, width)
    theta = started(Embedding(*empty, model), schedule, root, key)
    task = Task(equally(unpacked(timeline.snapshots[0].train)))
    return pack(fit(theta, task, schedule.recipe, schedule.base_epochs, root, key, on_epoch))


def grow(
    timeline: Timeline,
    first: Embedding,
    growth: Growth,
    schedule: Schedule,
    *,
    start: int = 1,
    words: np.ndarray | None = None,
    seed: int = 0,
    on_epoch: OnEpoch = silent,
) -> Iterator[Grown]:
    """Carry an embedding of the snapshots before ``start`` to the end of a timeline.

    For each snapshot, its new entities and relations are inserted from its training triples (phase
    ``inserted``); then the strategy trains (phase ``trained``).

    Args:
        first: in the packed form; its rows are those of the timeline.
        words: of all entities of the timeline, (E, v).
        seed: of the initializer and of training.

    Raises:
        InputError: an unknown name of a strategy or initializer; a divergent training.
    """
    check_classes(timeline, growth.initializer)
    if growth.strategy not in STRATEGIES:
        known = suggestion(growth.strategy, STRATEGIES)
        expected = f"expected one of {', '.join(STRATEGIES)}, got {growth.strategy!r:.80}{known}"
        raise InputError("argument 'strategy'", "", expected)
    theta = first
    for snapshot in range(start, len(timeline.snapshots)):
        begun = time.process_time()
        larger, inserted = extended(timeline, theta, growth, snapshot, words, seed)
        seconds = time.process_time() - begun
        yield Grown(snapshot, "inserted", larger, seconds, inserted)
        begun = time.process_time()
        arrival = arrived(timeline, theta, larger, schedule, snapshot, seed, on_epoch)
        train = STRATEGIES[growth.strategy]
        theta = pack(train(arrival, **growth.strategy_options))
        yield Grown(snapshot, "trained", theta, time.process_time() - begun)


def check_classes(timeline: Timeline, initializer: str | None, key: str = "") -> None:
    """InputError at ``key`` if an initializer needs classes that a timeline lacks."""
    if initializer == CLASS_MEAN and timeline.classes is None:
        expected = f"expected another initializer than {CLASS_MEAN}: the timeline has no classes"
        raise InputError("", key or "argument 'initializer'", expected)


def extended(
    timeline: Timeline,
    theta: Embedding,
    growth: Growth,
    snapshot: int,
    words: np.ndarray | None,
    seed: int,
) -> tuple[Embedding, Inserted | None]:
    """The embedding with the entities and relations of a snapshot, and the result of
    ``isi.insert``, None if there are none.
    """
    asked = insertion(timeline, theta, growth, snapshot, words, seed)
    if asked is None:
        return theta, None
    result = insert_request(*asked)
    if growth.initializer == CLASS_MEAN:
        classes, known = timeline.classes, theta.entity[0].numpy()
        assert classes is not None  # noqa: S101
        result = with_vectors(result, class_means(known, classes, len(result.vectors)))
    entity, relation = (torch.from_numpy(table) for table in (result.entities, result.relations))
    return replace(theta, entity=entity[None], relation=relation[None]), result


def chosen(
    timeline: Timeline, first: Embedding, growth: Growth, words: np.ndarray | None, seed: int
) -> Growth:
    """The growth with the initializer that is best by the hold-out test when the first new entities
    arrive, if it names none: it serves all later ones.
    """
    arrivals = np.flatnonzero(timeline.entities > first.entity.shape[1])
    if growth.initializer is not None or not len(arrivals):
        return growth
    asked = insertion(timeline, first, growth, int(arrivals[0]), words, seed)
    assert asked is not None  # noqa: S101
    method = choose(*asked)
    return replace(growth, initializer=method.initializer.name, options=method.options)


def insertion(
    timeline: Timeline,
    theta: Embedding,
    growth: Growth,
    snapshot: int,
    words: np.ndarray | None,
    seed: int,
) -> tuple[KnownEmbedding, InsertRequest] | None:
    """The insertion of the entities and relations of a snapshot; None if there are none."""
    known, relations = theta.entity.shape[1], theta.relation.shape[1]
    number = int(timeline.entities[snapshot]) - known
    new_relations = int(timeline.relations[snapshot]) - relations
    if not number and not new_relations:
        return None
    initializer = FOR_RELATIONS if growth.initializer == CLASS_MEAN else growth.initializer
    triples = timeline.snapshots[snapshot].train
    has_new = (triples[:, [0, 2]] >= known).any(1) | (triples[:, 1] >= relations)
    request = InsertRequest(
        triples=triples[has_new],
        new=number,
        new_relations=new_relations,
        words=None if words is None else words[: known + number],
        trained_with=growth.loss,
        initializer=initializer,
        options=growth.options,
        seed=seed_of(seed, "insertion of a snapshot", snapshot),
        allow_without_facts=True,
    )
    facts = earlier_facts(timeline, snapshot)
    embedding = KnownEmbedding(theta.entity[0], theta.relation[0], theta.model, triples=facts)
    return embedding, request


def arrived(
    timeline: Timeline,
    before: Embedding,
    larger: Embedding,
    schedule: Schedule,
    snapshot: int,
    seed: int,
    on_epoch: OnEpoch = silent,
) -> Arrival:
    """The arrival of a snapshot whose entities and relations have been inserted."""
    first_new = Moving(before.entity.shape[1], 2 * before.relation.shape[1])
    new, old = timeline.snapshots[snapshot].train, earlier_facts(timeline, snapshot)
    return Arrival(
        unpack(larger),
        unpacked(new),
        unpacked(old),
        first_new,
        schedule,
        seed,
        (snapshot,),
        on_epoch,
    )


def earlier_facts(timeline: Timeline, snapshot: int) -> np.ndarray:
    """Training triples of the snapshots before one, (K, 3)."""
    return np.concatenate([earlier.train for earlier in timeline.snapshots[:snapshot]])
