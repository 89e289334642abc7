"""Insertion over the grid: in each session novel entities are inserted into Θ, which is measured and fine-tuned."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import pandas as pd
import torch
from pydantic import Field
from torch import Tensor

from isi.config import Count, Fraction, Names, Option, Section
from isi.errors import InputError
from isi.evaluation.convergence import SCOPES
from isi.evaluation.query_sets import entity_query_sets, epoch_query_sets, novel_query_set
from isi.evaluation.ranking import Result, evaluate
from isi.experiment.grid import GridPoints, StackedVectors
from isi.experiment.store import Store
from isi.experiment.tables import RUNS
from isi.experiment.train import measure_columns, model_of, run_rows
from isi.graph.sampling import later_key
from isi.initializers.api import (
    FALLBACKS,
    INITIALIZERS,
    InitContext,
    InitResult,
    NovelEntities,
    context_of,
    options_of,
)
from isi.models.stack import Embedding
from isi.training import trainer
from isi.training.batches import Negatives, training_data
from isi.training.trainer import ConvergenceWatch, EpochMeasures, Optimizer, Watch, compile_ahead

if TYPE_CHECKING:
    from isi.params import Params

#: ``initializers`` of an experiment in params.
InitializerList = Annotated[Names, Field(min_length=1)] | Literal["all"]


def is_listed(listed: InitializerList, initializer: str) -> bool:
    """Whether a list of initializers names one, or all."""
    return listed == "all" or initializer in listed


class FullCurves(Section):
    """``full_curves`` of an experiment: what is fine-tuned for all epochs; all else stops at convergence."""

    sizes: list[Count]
    initializers: InitializerList = "all"

    def sizes_of(self, initializer: str) -> list[int]:
        """The sizes at which an initializer's runs are fine-tuned for all epochs."""
        return self.sizes if is_listed(self.initializers, initializer) else []


class Convergence(Section):
    """When Θ¹ counts as about as good as the joint model."""

    margin: Fraction


@dataclass(frozen=True)
class InsertConfig:
    """How novel entities are inserted, and how Θ is fine-tuned after that."""

    initializer: str
    options: Mapping[str, Option]
    #: root of the random streams
    root: int
    negatives: Negatives
    optimizer: Optimizer
    #: how far below the MRR* of the joint model counts as converged
    margin: float
    #: sizes fine-tuned for all epochs; the others stop at convergence
    full_curves: Sequence[int] = ()

    def training(self, **changed: float) -> InsertConfig:
        """The same with other values of the optimizer."""
        return replace(self, optimizer=self.optimizer.model_copy(update=changed))


def insert_config(
    params: Params, initializer: str, full_curves: Sequence[int] = (), options: Mapping[str, Any] | None = None
) -> InsertConfig:
    """How an initializer inserts, with its options in params or with others.

    Args:
        full_curves: sizes fine-tuned for all epochs; the others stop at convergence.

    Raises:
        InputError: where the initializer does not take the options.
    """
    options = params.initializers[initializer] if options is None else options
    compile_ahead(model_of(params), params.finetuning.batch_size)
    return InsertConfig(
        initializer, options_of(initializer, options, f"initializers.{initializer}"), params.seed, params.negatives,
        params.finetuning, params.convergence.margin, full_curves,
    )  # fmt: skip


@dataclass(frozen=True)
class InsertTask:
    """Insert novel entities into Θ⁰ with one initializer and fine-tune, session by session."""

    points: GridPoints
    theta0: StackedVectors
    #: (session, model, place in ``novel``, triple), in this order; shape: (I, 4)
    insert_triples: np.ndarray
    #: word vectors, zero where there is none; shape: (E, w)
    words: np.ndarray
    #: MRR* of the joint models, by session and scope; NaN without queries; shape: (M,)
    joint: Mapping[tuple[int, str], np.ndarray]
    config: InsertConfig

    def keys(self, session: int) -> Tensor:
        """Keys of the random streams of a session; shape (M, K)."""
        return self.points.keys(*later_key(session))

    def novel_entities(self, session: int) -> NovelEntities:
        """What is given of the novel entities of a session."""
        rows = self.insert_triples[self.insert_triples[:, 0] == session, 1:]
        return NovelEntities(self.points.novel_in(session), torch.as_tensor(rows), torch.as_tensor(self.words))

    def context(self, theta: Embedding, session: int) -> InitContext:
        """What an initializer may see in a session that inserts into Θ."""
        before = self.points.session(session - 1)
        return context_of(theta, before, self.novel_entities(session), self.config.root, self.keys(session))


@dataclass(frozen=True)
class TaskResult:
    """The initial vectors of a task's novel entities, and measures of Θ."""

    #: as inserted, by session; shape: (M, S · size, d)
    vectors: np.ndarray
    #: in the columns of ``RUNS`` and ``INSERTED`` (entity kinds apart)
    runs: pd.DataFrame
    entities: pd.DataFrame


def insertion_tasks(store: Store, params: Params, config: InsertConfig, grid: Sequence[GridPoints]) -> list[InsertTask]:
    """Insertion with one initializer, and fine-tuning, at grid points of the store's experiment."""
    table, words, model = store.insert_triples(), store.words(), model_of(params)
    joint = RUNS.read(experiment=store.experiment, model="joint")
    return [
        InsertTask(
            points, store.theta0(points, model), store.insert_triples_of(points, table), words,
            joint_targets(joint, points), config,
        )
        for points in grid
    ]  # fmt: skip


def joint_targets(joint: pd.DataFrame, points: GridPoints) -> dict[tuple[int, str], np.ndarray]:
    """MRR* of the joint models by session and scope (see ``InsertTask``), from their runs.

    Raises:
        InputError: where one of them was not measured.
    """
    targets, immediate = {}, joint[(joint["size"] == points.size) & (joint["epoch"] == 0)]
    for session in range(1, points.sessions + 1):
        for scope in SCOPES:
            rows = immediate[(immediate["scope"] == scope) & (immediate["session"] == session)]
            by_seed = rows.set_index("seed")["mrr_star"]
            if not set(points.seeds) <= set(by_seed.index):
                expected = f"expected a row of each of seeds {', '.join(map(str, points.seeds))} at epoch 0"
                where = f"size {points.size}, session {session}, scope {scope}"
                raise InputError(RUNS.path(experiment=points.experiment, model="joint"), where, expected)
            targets[session, scope] = by_seed.loc[points.seeds].to_numpy(np.float64, copy=True)
    return targets


def insert_stack(task: InsertTask) -> TaskResult:
    """Insert the novel entities of every session, each into what Θ has learned in the session before."""
    results = list(enumerate(run_sessions(task), 1))
    vectors = torch.cat([result.initial.vectors for _, result in results], 1).cpu().numpy()
    runs = [frame for session, result in results for frame in _run_rows(task.points, session, result)]
    entities = pd.concat(_entity_rows(task.points, session, result) for session, result in results)
    return TaskResult(vectors, pd.concat(runs), entities)


def run_sessions(task: InsertTask) -> Iterator[SessionResult]:
    """The sessions of a task, one after the other."""
    theta = task.theta0.stack
    for session in range(1, task.points.sessions + 1):
        result = run_session(task, theta, session)
        yield result
        theta = result.theta


@dataclass(frozen=True)
class SessionResult:
    """Θ after a session, and its measures on the way."""

    #: Θⁿ of each model when it had converged, or after the last epoch
    theta: Embedding
    initial: InitResult
    #: measures right after insertion: scope ``novel``, and that scope about one novel entity at a time
    immediate: dict[str, Result]
    by_entity: list[Result]
    #: measures before training and after every epoch
    curves: list[EpochMeasures]


def run_session(task: InsertTask, theta: Embedding, session: int) -> SessionResult:
    """Insert the novel entities, measure immediately in every scope, fine-tune, and measure after every epoch.

    Args:
        theta: Θⁿ⁻¹, learned on Dⁿ⁻¹; rows of novel entities are not looked at.
    """
    after, given, initial = task.points.session(session), task.novel_entities(session), initialize(task, theta, session)
    inserted, mask = with_vectors(theta, given.novel, initial.vectors), given.mask(len(after.graph.triples))
    immediate = evaluate(inserted, novel_query_set(after, given.novel, mask))
    by_entity = [
        evaluate(inserted, {"novel": queries})["novel"] for queries in entity_query_sets(after, given.novel, mask)
    ]
    targets = {scope: torch.as_tensor(task.joint[session, scope]) - task.config.margin for scope in SCOPES}
    full_curves = task.points.size in task.config.full_curves
    watch = ConvergenceWatch(epoch_query_sets(after, given.novel), targets, full_curves)
    return SessionResult(finetune(task, inserted, session, watch), initial, immediate, by_entity, watch.epochs)


def initialize(task: InsertTask, theta: Embedding, session: int) -> InitResult:
    """Vectors of the novel entities of a session by the initializer (equation 8)."""
    registered = INITIALIZERS.get(task.config.initializer, f"initializers.{task.config.initializer}")
    return registered.initialize(task.context(theta, session), task.config.options)


def finetune(task: InsertTask, theta: Embedding, session: int, watch: Watch) -> Embedding:
    """Fine-tune Θ on a session that has its novel entities, watched after every epoch (section 5.2)."""
    config, points = task.config, task.points
    data = training_data(
        points.session(session), "fine-tuning", task.keys(session), config.negatives.head_pool,
        points.novel_in(session),
    )  # fmt: skip
    return trainer.train(theta, data, config.negatives, config.optimizer, config.root, watch)


def with_vectors(theta: Embedding, novel: Tensor, vectors: Tensor) -> Embedding:
    """Θ with the vectors of novel entities, (M, n, d), in place (equations 8 and 9)."""
    return replace(theta, entity=theta.entity.scatter(1, novel[..., None].expand_as(vectors), vectors))


def _run_rows(points: GridPoints, session: int, result: SessionResult) -> Iterator[pd.DataFrame]:
    yield run_rows(points, session, 0, torch.arange(len(points.seeds)), result.immediate)
    for measured in result.curves:
        yield run_rows(points, session, measured.epoch, measured.models, measured.results)


def _entity_rows(points: GridPoints, session: int, result: SessionResult) -> pd.DataFrame:
    rows = []
    for place, measures in enumerate(result.by_entity):
        fallback = pd.Series([FALLBACKS[code] for code in result.initial.fallback[:, place].tolist()], dtype="str")
        columns: dict[str, Any] = {
            "size": points.size, "seed": points.seeds, "entity": points.novel[:, session - 1, place],
            "fallback": fallback, "session": session,
        }  # fmt: skip
        rows.append(measure_columns(measures).assign(**columns))
    return pd.concat(rows)
