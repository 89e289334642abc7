"""Insert novel entities into Θ⁰ with one initializer, measure right after insertion, and fine-tune.

The measures right after insertion are also taken by kind of query. An initializer that the
experiment does not list leaves tables without rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.config import Fraction, Option, Section, Study
from isi.errors import InputError
from isi.evaluation.changes import CHANGES, change_rows, with_weighted_changes
from isi.evaluation.query_sets import with_weighted
from isi.evaluation.ranking import Queries
from isi.evaluation.scopes import SCOPES
from isi.initializers.api import INITIALIZERS, InitResult, options_of
from isi.initializers.context import InitContext, context_in_session
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.tables.table import concat
from isi.training import trainer
from isi.training.batches import Negatives, training_data
from isi.training.trainer import ConvergenceWatch, Optimizer, Target, Watch, compile_ahead
from stages.breakdown import QUERY_BREAKDOWN, break_down, write_queries
from stages.grid import (
    JOINT_MODEL,
    Finetuned,
    FullCurves,
    GridPoints,
    InitializerList,
    is_listed,
    known_shares,
)
from stages.params import StageParams
from stages.runner import Compute, run, stack_height
from stages.stage import StageContext, stage
from stages.store import INITIAL_VECTORS, MEASURE_CHANGES, RUNS, Store, model_of


class Convergence(Section):
    """``convergence`` in params: when a fine-tuned Θ counts as converged to the joint model."""

    margin: Fraction


@dataclass(frozen=True)
class InsertConfig:
    """How novel entities are inserted, and how Θ is fine-tuned after that."""

    initializer: str
    options: Mapping[str, Option]
    root: int  #: seed of all random streams
    negatives: Negatives
    optimizer: Optimizer
    margin: float  #: how far below the joint model counts as converged
    finetuned: int = 0  #: seeds below this number are fine-tuned
    #: sizes fine-tuned for all epochs; the others stop at convergence
    full_curves: Sequence[int] = ()
    breaks_down: bool = False  #: whether it is measured by kind of query right after insertion
    changes: bool = False  #: whether changes of the measure are measured, too


@stage
def insert(context: StageContext, experiment: str, initializer: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    if is_listed(
        params.read(f"experiments.{experiment}.initializers", InitializerList), initializer
    ):
        compute: Compute = params.read("compute", Compute)
        config = config_of_experiment(params, experiment, initializer)
        grid = store.grid(stack_height(compute))
        tasks = insert_tasks(store, model_of(params), grid, config)
        result = insert_over(tasks, compute, f"{experiment}, {initializer}")
    else:
        print(f"{experiment} does not list {initializer}: no insertion, tables without rows")
        tables = RUNS, MEASURE_CHANGES, QUERY_BREAKDOWN
        result = InsertionRuns({}, *(concat(list[pd.DataFrame](), table) for table in tables))
    tensors = {f"size={size:02d}": vectors for size, vectors in result.vectors.items()}
    INITIAL_VECTORS.write(tensors, context.stage, experiment=experiment, initializer=initializer)
    names = {"experiment": experiment, "model": initializer}
    RUNS.write(result.runs, context.stage, **names)
    MEASURE_CHANGES.write(result.changes, context.stage, **names)
    write_queries(result.queries, context.stage, experiment, initializer)


def config_of_experiment(params: StageParams, experiment: str, initializer: str) -> InsertConfig:
    """How an experiment inserts with an initializer, and fine-tunes."""
    key = f"experiments.{experiment}"
    finetuned: Finetuned = params.read(f"{key}.finetuned", Finetuned)
    options = params.read(f"initializers.{initializer}", dict[str, Any])
    return replace(
        insert_config(params, initializer, options),
        finetuned=finetuned.seeds if is_listed(finetuned.initializers, initializer) else 0,
        full_curves=params.read(f"{key}.full_curves", FullCurves),
        breaks_down=True,
        changes=experiment in params.read("measure_changes", Study).experiments,
    )


def insert_config(
    params: StageParams, initializer: str, options: Mapping[str, Any]
) -> InsertConfig:
    """How params insert with an initializer, without fine-tuning; ``InputError`` names an invalid
    option. Where an epoch's updates are compiled, they are compiled here, once, before processes
    start.
    """
    optimizer: Optimizer = params.read("finetuning", Optimizer)
    compile_ahead(model_of(params), optimizer.batch_size)
    return InsertConfig(
        initializer=initializer,
        options=options_of(initializer, options, f"initializers.{initializer}"),
        root=params.seed,
        negatives=params.read("negatives", Negatives),
        optimizer=optimizer,
        margin=params.read("convergence", Convergence).margin,
    )


#: What the joint models reach: for each change of the measure and each of its scopes, (M,).
JointTargets = Mapping[str, Mapping[str, np.ndarray]]
#: Arguments of ``insert_stack``.
InsertTask = tuple[GridPoints, Embedding, np.ndarray, JointTargets, InsertConfig]


def insert_tasks(
    store: Store, model: Model, grid: Sequence[GridPoints], config: InsertConfig
) -> list[InsertTask]:
    """Tasks of insertion with one initializer, and fine-tuning,
    at grid points of the store's experiment.
    """
    words = store.words()
    joint = change_rows(RUNS.read(experiment=store.experiment, model=JOINT_MODEL))
    if config.changes:
        joint = MEASURE_CHANGES.read(experiment=store.experiment, model=JOINT_MODEL)
    return [
        (points, store.theta0(points, model), words, joint_targets(joint, points), config)
        for points in grid
    ]


def joint_targets(joint: pd.DataFrame, points: GridPoints) -> JointTargets:
    """The values of the joint models, from rows of ``MEASURE_CHANGES``;
    or an ``InputError`` where a row is missing.
    """
    rows = joint[(joint["size"] == points.size) & (joint["epoch"] == 0)]
    values = rows.set_index(["change", "scope", "seed"])["value"].sort_index()
    targets = dict[str, dict[str, np.ndarray]]()
    for change in rows["change"].unique() if len(rows) else ["none"]:
        for scope in CHANGES[change].query_sets:
            try:
                of_scope = values.loc[[(change, scope, seed) for seed in points.seeds]]
            except KeyError as error:
                expected = f"expected a row of each seed of size {points.size} at epoch 0"
                file = RUNS.path(experiment=points.experiment, model=JOINT_MODEL)
                raise InputError(file, f"scope {scope}", expected) from error
            targets.setdefault(str(change), {})[scope] = of_scope.to_numpy(copy=True)
    return targets


@dataclass(frozen=True)
class StackResult:
    """Results of insertion at a stack of grid points."""

    vectors: np.ndarray  #: as inserted; shape: (M, size, d)
    fallbacks: int  #: novel entities whose initializer lacked the data that it needs
    runs: pd.DataFrame  #: in the columns of ``RUNS``, without scope ``weighted``
    changes: pd.DataFrame  #: in those of ``MEASURE_CHANGES``, likewise
    queries: pd.DataFrame  #: in those of ``QUERY_BREAKDOWN``


def insert_stack(
    points: GridPoints,
    theta0: Embedding,
    words: np.ndarray,
    joint: JointTargets,
    config: InsertConfig,
    queries: list[dict[str, Queries]] | None = None,
) -> StackResult:
    """Insert the novel entities and fine-tune, measuring from epoch 0; ``words``: (E, w);
    ``queries``: None: those of ``GridPoints.measured_sets``.
    """
    initial = initialize(points, theta0, words, config)
    theta = with_vectors(theta0, points.novel_ids, initial.vectors)
    parts = [break_down(points, theta, config.initializer)] if config.breaks_down else []
    watch = ConvergenceWatch(
        points.measured_sets(config.changes) if queries is None else queries,
        targets_below(joint, config.margin),
        torch.tensor(points.seeds) < config.finetuned,
        points.size in config.full_curves,
    )
    finetune(points, theta, config, watch)
    measured = points.run_rows(watch.looks)
    return StackResult(
        initial.vectors.cpu().numpy(),
        int((initial.fallback > 0).sum()),
        measured[measured["scope"].isin(list(SCOPES))],
        change_rows(measured) if config.changes else concat([], MEASURE_CHANGES),
        concat(parts, QUERY_BREAKDOWN),
    )


def targets_below(joint: JointTargets, margin: float) -> dict[str, list[Target]]:
    """The targets of fine-tuning, by change of the measure."""
    targets = dict[str, list[Target]]()
    for name, scopes in joint.items():
        change = CHANGES[name]
        targets[name] = [
            Target(change.query_sets[scope], change.measure, torch.as_tensor(values) - margin)
            for scope, values in scopes.items()
        ]
    return targets


@dataclass(frozen=True)
class InsertionRuns:
    """Results of insertion with one config over a grid."""

    vectors: dict[int, Tensor]  #: as inserted, by size; shapes: (S, size, d)
    runs: pd.DataFrame  #: in the columns of ``RUNS``
    changes: pd.DataFrame  #: in those of ``MEASURE_CHANGES``
    queries: pd.DataFrame  #: in those of ``QUERY_BREAKDOWN``


def insert_over(tasks: Sequence[InsertTask], compute: Compute, name: str) -> InsertionRuns:
    """Run tasks of one experiment and one config, and join their results."""
    grid = [points for points, *_ in tasks]
    return join(grid, run(insert_stack, tasks, compute, name), name)


def join(grid: Sequence[GridPoints], results: Sequence[StackResult], name: str) -> InsertionRuns:
    """The results of one config at all stacks of grid points, with scope ``weighted``."""
    shares = known_shares(grid)
    vectors = dict[int, list[Tensor]]()
    for points, result in zip(grid, results, strict=True):
        vectors.setdefault(points.size, []).append(torch.from_numpy(result.vectors))
    fallbacks = sum(result.fallbacks for result in results)
    if fallbacks:
        print(f"{name}: {fallbacks} novel entities lacked words or insert triples; they fell back")
    runs = with_weighted(concat([result.runs for result in results], RUNS), shares)
    changes = concat([result.changes for result in results], MEASURE_CHANGES)
    if len(changes):
        changes = with_weighted_changes(changes, shares)
    queries = concat([result.queries for result in results], QUERY_BREAKDOWN)
    return InsertionRuns(
        {n: torch.cat(parts) for n, parts in vectors.items()}, runs, changes, queries
    )


def initialize(
    points: GridPoints, theta: Embedding, words: np.ndarray, config: InsertConfig
) -> InitResult:
    """Vectors of the novel entities by the initializer (equation 8)."""
    initializer = INITIALIZERS.get(config.initializer, f"initializers.{config.initializer}")
    context = init_context(points, theta, words, config.root)
    return initializer.initialize(context, config.options)


def init_context(points: GridPoints, theta: Embedding, words: np.ndarray, root: int) -> InitContext:
    """The input of an initializer that inserts into Θ."""
    rows, words_of = torch.as_tensor(points.insert_triples), torch.as_tensor(words)
    before, novel = points.session(0), points.novel_ids
    return context_in_session(theta, before, novel, rows, words_of, root, points.keys())


def finetune(points: GridPoints, theta: Embedding, config: InsertConfig, watch: Watch) -> Embedding:
    """Fine-tune Θ, with novel entities in it, on D¹; ``watch`` as in ``train`` (section 5.2)."""
    data = training_data(points.session(1), "fine-tuning", points.keys())
    return trainer.train(theta, data, config.negatives, config.optimizer, config.root, watch)


def with_vectors(theta: Embedding, novel: Tensor, vectors: Tensor) -> Embedding:
    """A copy of Θ with vectors, (M, n, d), in the rows of the novel entities,
    (M, n) (equations 8 and 9).
    """
    return replace(
        theta, entity=theta.entity.scatter(1, novel[..., None].expand_as(vectors), vectors)
    )


if __name__ == "__main__":
    insert()
