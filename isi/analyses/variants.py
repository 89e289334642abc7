"""An experiment again under other conditions: other params, other words, or less that is told of novel entities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from isi.analyses.query_breakdown import JOINT as JOINT_MODEL
from isi.analyses.query_breakdown import QueryBreakdownTask, break_down, breakdown_table
from isi.config import Count, Name, Option, Section
from isi.errors import InputError
from isi.experiment.grid import NO_INSERTION, GridPoints, StackedVectors
from isi.experiment.insert import (  # fmt: skip
    InsertTask,
    TaskConfig,
    TaskInput,
    insert_stack,
    inserting,
    inserting_with,
    joint_targets,
)
from isi.experiment.runner import compute_of, run, stack_height
from isi.experiment.store import Store
from isi.experiment.tables import runs_table
from isi.experiment.train import (
    EvaluationTask,
    TrainConfig,
    TrainTask,
    evaluate_stack,
    model_of,
    train_config,
    train_initial,
    train_joint_model,
)
from isi.graph.sampling import later_key
from isi.graph.words import Words, load_vectors, look_up
from isi.random import stream
from isi.stage import StageContext
from isi.tables import paths
from isi.tables.table import NAME

#: Runs of each model of experiments under other conditions, the joint model's among them, and its queries at epoch 0.
VARIANT_RUNS = runs_table("data/beyond/{variant}.parquet", {"experiment": NAME, "model": NAME})
VARIANT_QUERIES = breakdown_table("data/beyond/{variant}.asked.parquet", {"experiment": NAME})

#: Sections of params that decide what Θ⁰ and the joint model are: a variant that changes one trains its own.
LEARNED = ("embedding", "families", "negatives", "training")


class Variant(Section):
    """An entry of ``variants`` in the params of the second pipeline."""

    #: what people read
    title: str
    #: where the report shows it
    group: Literal["baselines", "embeddings", "told", "words", "causes", "graphs"]
    experiments: Annotated[list[Name], Field(min_length=1)]
    initializers: Annotated[list[Name], Field(min_length=1)]
    #: |ξ|, and the first so many of the sessions' seeds
    size: Count
    seeds: Count
    #: of initializers, in place of what params.yaml has
    options: Annotated[dict[Name, dict[str, Option]], Field(default_factory=dict)]
    #: values of params.yaml, by dotted key
    changes: Annotated[dict[str, Any], Field(default_factory=dict)]
    #: insert triples of each novel entity that are told, at most; null: all
    told: Annotated[int, Field(ge=0)] | None = None
    #: else measured at once alone
    finetuned: bool = True
    #: for all epochs, for learning curves; else until convergence
    followed: bool = False
    #: whether Θ⁰ and the joint model are its own even where no change asks for it
    trained: bool = False

    @property
    def trains(self) -> bool:
        """Whether it has a Θ⁰ and a joint model of its own."""
        return self.trained or any(key.partition(".")[0] in LEARNED for key in self.changes)

    @property
    def speaks(self) -> bool:
        """Whether it has word vectors of its own."""
        return any(key.partition(".")[0] == "words" for key in self.changes)


def changed(given: StageContext, changes: Mapping[str, Any], key: str) -> StageContext:
    """What a stage is given, with other values at dotted keys.

    Raises:
        InputError: where a key is in no section that the stage has; ``key`` is where the changes stand.
    """
    values = deepcopy(dict(given.values))
    sections = [name for name, value in values.items() if isinstance(value, dict) and "." not in name]
    for dotted, value in changes.items():
        *parents, last = dotted.split(".")
        place: Any = {name: values[name] for name in sections}
        for parent in parents:
            place = place.get(parent) if isinstance(place, dict) else None
        if not parents or not isinstance(place, dict):
            raise InputError(paths.BEYOND_PARAMS, key, f"expected keys below {', '.join(sections)}, got {dotted!r}")
        place[last] = value
    return StageContext(values, given.stage)


def results(
    given: StageContext, study: Variant, stores: Sequence[Store], shown: str
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Runs of a variant, and what its models answer at once (``VARIANT_RUNS`` and ``VARIANT_QUERIES``).

    Args:
        given: with the variant's changes.
        stores: of its experiments.
        shown: beside the progress bar.
    """
    compute, runs, asked = compute_of(given), [], []
    for store in stores:
        about = f"{shown}, {store.experiment}" if len(stores) > 1 else shown
        for each, answered in run(repeat, tasks(given, study, store), compute, about):
            runs.append(each.assign(experiment=store.experiment))
            asked.append(answered.assign(experiment=store.experiment))
    ordered = pd.concat(runs).sort_values(["experiment", "model", "size", "seed", "session", "epoch", "scope"])
    return ordered, pd.concat(asked).sort_values(["experiment", "size", "seed"], kind="stable")


def tasks(given: StageContext, study: Variant, store: Store) -> list[VariantTask]:
    """A variant of one experiment, over its points."""
    family, table, words = model_of(given), store.insert_triples(), words_of(given, study, store)
    how = {name: how_of(given, study, name) for name in study.initializers}
    found = []
    for points in store.grid(stack_height(compute_of(given)), study.size, study.seeds):
        start = train_config(given) if study.trains else (store.theta0(points, family), store.joint(points, family))
        told = store.insert_triples_of(points, table)
        found.append(VariantTask(points, start, told, some_of(told, study.told, points, given.seed), words, how))
    return found


def how_of(given: StageContext, study: Variant, initializer: str) -> TaskConfig:
    """How a variant inserts with one initializer, with options of its own or those of the main runs."""
    followed = [study.size] if study.followed else []
    if initializer not in study.options:
        return inserting(given, initializer, followed, study.finetuned)
    options = study.options[initializer]
    return inserting_with(given, initializer, options, f"options.{initializer}", followed, study.finetuned)


def words_of(given: StageContext, study: Variant, store: Store) -> np.ndarray:
    """Word vectors of the entities: the main runs', or the variant's own."""
    if not study.speaks:
        return store.words()
    return look_up(load_vectors(given.section("words", Words)), list(store.entities()["phrase"])).vectors


@dataclass(frozen=True)
class VariantTask:
    """Insert into embeddings of a stack of grid points with every initializer, beside the joint model."""

    points: GridPoints
    #: Θ⁰ and the joint model, or how to train them
    start: tuple[StackedVectors, StackedVectors] | TrainConfig
    #: the insert triples, and those of them that are told; (session, model, place in ``novel``, triple), in this order
    insert_triples: np.ndarray
    told: np.ndarray
    #: shape: (E, w)
    words: np.ndarray
    #: by initializer
    how: Mapping[str, TaskConfig]


def repeat(task: VariantTask) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Runs of every model, and what it answers at once (``VARIANT_RUNS`` and ``VARIANT_QUERIES``, experiment apart).

    The same is asked whatever was told: what touches a novel entity and is no insert triple.
    """
    points = task.points
    theta0, joint = _trained(points, task.start) if isinstance(task.start, TrainConfig) else task.start
    judged = evaluate_stack(EvaluationTask(points, joint, task.insert_triples))
    told = TaskInput(task.told, task.words, joint_targets(judged, points))
    done = {name: insert_stack(InsertTask(points, theta0, told, how)) for name, how in task.how.items()}
    first = {name: one.vectors[:, : points.size] for name, one in done.items()}
    runs = [judged.assign(model=JOINT_MODEL), *(one.runs.assign(model=name) for name, one in done.items())]
    return pd.concat(runs), break_down(QueryBreakdownTask(points, theta0, joint, first, task.insert_triples))


def _trained(points: GridPoints, how: TrainConfig) -> tuple[StackedVectors, StackedVectors]:
    everyone = replace(points, size=NO_INSERTION, novel=points.novel[:, :0])
    learned = train_initial(TrainTask(points, how)), train_joint_model(TrainTask(everyone, how))
    theta0, joint = (StackedVectors(how.model, one.entity, one.relation) for one in learned)
    return theta0, joint


def some_of(triples: np.ndarray, most: int | None, points: GridPoints, root: int) -> np.ndarray:
    """At most so many insert triples of each novel entity, drawn at random; the fewer are part of the more.

    Args:
        triples: (session, model, place in ``novel``, triple), in this order; shape: (I, 4).
    """
    if most is None:
        return triples
    slots, number = np.unique(triples[:, :3], axis=0, return_counts=True)
    orders = [
        stream(root, "told", points.size, points.seeds[model], place, *later_key(session)).permutation(count)
        for (session, model, place), count in zip(slots.tolist(), number.tolist(), strict=True)
    ]
    return triples[np.concatenate([np.empty(0, dtype=np.int64), *orders]) < most]
