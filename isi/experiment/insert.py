"""Insertion over an experiment's points: a fold of steps over the sessions, as tasks for workers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd
import torch

from isi.config import Count, Fraction, Name, Option, Section
from isi.errors import InputError
from isi.evaluation.convergence import SCOPES
from isi.experiment.grid import GridPoints, StackedVectors
from isi.experiment.insertion_step import InsertConfig, SessionResult, run_session
from isi.experiment.store import Store
from isi.experiment.tables import RUNS
from isi.experiment.train import measure_columns, model_of, run_rows
from isi.initializers.api import FALLBACKS, NovelEntities, options_of
from isi.training.batches import Negatives
from isi.training.trainer import Optimizer, compile_ahead

if TYPE_CHECKING:
    from isi.params import Params

#: ``initializers`` of an experiment in params.
InitializerList = Literal["all"] | list[Name]


class FullCurves(Section):
    """``full_curves`` of an experiment: what is fine-tuned for all epochs; all else stops at convergence."""

    sizes: list[Count]
    initializers: InitializerList = "all"


class Convergence(Section):
    """When Θ¹ counts as about as good as the joint model."""

    margin: Fraction


@dataclass(frozen=True)
class TaskConfig:
    """How novel entities are inserted, and Θ is trained after that."""

    initializer: str
    options: Mapping[str, Option]
    root: int
    negatives: Negatives
    optimizer: Optimizer
    margin: float
    #: sizes fine-tuned for all epochs; the others stop at convergence
    followed: Sequence[int]


@dataclass(frozen=True)
class TaskInput:
    """What initializers are told, and what convergence is measured against."""

    #: (session, model, place in ``novel``, triple) of the insert triples, in this order; shape: (I, 4)
    insert_triples: np.ndarray
    #: word vectors; shape: (E, w)
    words: np.ndarray
    #: MRR* of the joint models, by session and scope; NaN without queries; shape: (M,)
    joint: Mapping[tuple[int, str], np.ndarray]


@dataclass(frozen=True)
class InsertTask:
    """Insert novel entities into Θ⁰ with one initializer and fine-tune, session by session."""

    points: GridPoints
    theta0: StackedVectors
    told: TaskInput
    how: TaskConfig


@dataclass(frozen=True)
class TaskResult:
    """What became of a task's novel entities."""

    #: as inserted, by session; shape: (M, S · size, d)
    vectors: np.ndarray
    #: in the columns of ``tables.RUNS`` and ``tables.INSERTED`` (entity kinds apart)
    runs: pd.DataFrame
    entities: pd.DataFrame


def task_config(
    params: Params, initializer: str, full_curves: Sequence[int] = (), finetuned: bool = True,
    options: Mapping[str, Any] | None = None,
) -> TaskConfig:  # fmt: skip
    """How one initializer inserts, with its options in params or with others.

    Args:
        full_curves: sizes that are fine-tuned for all epochs; the others stop at convergence.
        finetuned: else without any epoch.
    """
    optimizer = params.finetuning if finetuned else params.finetuning.model_copy(update={"max_epochs": 0})
    options = params.initializers[initializer] if options is None else options
    compile_ahead(model_of(params), optimizer.batch_size)
    return TaskConfig(
        initializer, options_of(initializer, options, f"initializers.{initializer}"), params.seed, params.negatives,
        optimizer, params.convergence.margin, full_curves,
    )  # fmt: skip


def experiment_config(params: Params, experiment: str, initializer: str) -> TaskConfig:
    """How an experiment inserts with one initializer: with full curves, until convergence, or measured immediately."""
    entry = params.experiments[experiment]
    sizes = entry.full_curves.sizes if among(entry.full_curves.initializers, initializer) else []
    return task_config(params, initializer, sizes, initializer not in entry.immediate_only)


def among(listed: InitializerList, initializer: str) -> bool:
    """Whether a list of initializers names one, or all."""
    return listed == "all" or initializer in listed


def insertion_tasks(store: Store, params: Params, how: TaskConfig, grid: Sequence[GridPoints]) -> list[InsertTask]:
    """Insertion with one initializer, and fine-tuning, of points of the store's experiment."""
    insert_triples, words, model = store.insert_triples(), store.words(), model_of(params)
    joint = RUNS.read(experiment=store.experiment, model="joint")

    return [
        InsertTask(
            points,
            store.theta0(points, model),
            TaskInput(store.insert_triples_of(points, insert_triples), words, joint_targets(joint, points)),
            how,
        )
        for points in grid
    ]


def joint_targets(joint: pd.DataFrame, points: GridPoints) -> dict[tuple[int, str], np.ndarray]:
    """What convergence is measured against (see ``TaskTold``), from the runs of the joint models.

    Raises:
        InputError: where one of them was not measured.
    """
    found, at_once = {}, joint[(joint["size"] == points.size) & (joint["epoch"] == 0)]
    for session in range(1, points.sessions + 1):
        for scope in SCOPES:
            own = at_once[(at_once["scope"] == scope) & (at_once["session"] == session)].set_index("seed")["mrr_star"]
            if not set(points.seeds) <= set(own.index):
                expected = f"expected a row of each of seeds {', '.join(map(str, points.seeds))} at epoch 0"
                where = f"size {points.size}, session {session}, scope {scope}"
                raise InputError(RUNS.path(experiment=points.experiment, model="joint"), where, expected)
            found[session, scope] = own.loc[points.seeds].to_numpy(np.float64, copy=True)
    return found


def insert_stack(task: InsertTask) -> TaskResult:
    """A fold of steps over the sessions: each inserts its entities into what the one before has learned."""
    steps = list(fold(task))
    vectors = torch.cat([done.initial.vectors for done in steps], 1).cpu().numpy()
    runs = [frame for number, done in enumerate(steps, 1) for frame in _run_rows(task.points, number, done)]
    entities = pd.concat(_entity_rows(task.points, number, done) for number, done in enumerate(steps, 1))
    return TaskResult(vectors, pd.concat(runs), entities)


def fold(task: InsertTask) -> Iterator[SessionResult]:
    """The steps of a task's sessions, one after the other."""
    theta = task.theta0.stack
    for number in range(1, task.points.sessions + 1):
        before, after = task.points.session(number - 1), task.points.session(number)
        done = run_session(theta, before, after, told_in(task, number), how_in(task, number))
        yield done
        theta = done.theta


def told_in(task: InsertTask, session: int) -> NovelEntities:
    """What is told in one session."""
    table = task.told.insert_triples
    own = torch.as_tensor(table[table[:, 0] == session, 1:])
    return NovelEntities(task.points.novel_in(session), own, torch.as_tensor(task.told.words))


def how_in(task: InsertTask, session: int) -> InsertConfig:
    """How one session inserts and learns."""
    how = task.how
    targets = {scope: torch.as_tensor(task.told.joint[session, scope]) - how.margin for scope in SCOPES}
    to_the_end = task.points.size in how.followed
    keys = task.points.keys(session)
    return InsertConfig(how.initializer, how.options, how.root, keys, how.negatives, how.optimizer, targets, to_the_end)


def _run_rows(points: GridPoints, session: int, done: SessionResult) -> Iterator[pd.DataFrame]:
    yield run_rows(points, session, 0, torch.arange(len(points.seeds)), done.at_once)
    for followed in done.followed:
        yield run_rows(points, session, followed.epoch, followed.models, followed.results)


def _entity_rows(points: GridPoints, session: int, done: SessionResult) -> pd.DataFrame:
    rows = []
    for place, result in enumerate(done.own):
        fell = pd.Series([FALLBACKS[code] for code in done.initial.fallback[:, place].tolist()], dtype="str")
        columns: dict[str, Any] = {
            "size": points.size, "seed": points.seeds, "entity": points.novel[:, session - 1, place], "fallback": fell,
            "session": session,
        }  # fmt: skip
        rows.append(measure_columns(result).assign(**columns))
    return pd.concat(rows)
