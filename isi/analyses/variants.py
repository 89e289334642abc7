"""An experiment again under other conditions: other params, other words, or less that is told of novel entities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, cast

import numpy as np
import pandas as pd
from pydantic import Field

from isi.analyses.query_breakdown import QueryBreakdownTask, break_down, breakdown_table
from isi.config import Count, Name, Option, Section, check
from isi.errors import InputError
from isi.experiment.grid import JOINT_MODEL, GridPoints, StackedVectors
from isi.experiment.insert import InsertConfig, InsertTask, insert_config, insert_stack, joint_targets
from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store
from isi.experiment.tables import runs_table
from isi.experiment.train import (
    EvaluationTask,
    TrainConfig,
    TrainTask,
    evaluate_stack,
    joint_tasks,
    model_of,
    train_config,
    train_stack,
)
from isi.graph.sampling import later_key
from isi.graph.words import load_vectors, look_up
from isi.random import stream
from isi.tables.table import NAME

if TYPE_CHECKING:
    from isi.params import Params

#: Runs of each model of experiments under other conditions, the joint model's among them, and its queries at epoch 0.
VARIANT_RUNS = runs_table("data/beyond/{variant}.parquet", {"experiment": NAME, "model": NAME})
VARIANT_QUERIES = breakdown_table("data/beyond/{variant}.queries.parquet", {"experiment": NAME})

#: Sections of params that decide what Θ⁰ and the joint model are: a variant that changes one trains its own.
LEARNED = ("embedding", "models", "negatives", "training")
#: Sections of params that a variant may change.
CHANGEABLE = (*LEARNED, "words", "finetuning", "convergence", "initializers")


class Variant(Section):
    """An entry of ``variants`` in the params of the second pipeline."""

    renamed: ClassVar = {"told": "max_insert_triples", "followed": "full_curves"}
    #: what people read
    title: str
    #: where the report shows it
    group: Literal["baselines", "embeddings", "insert_triples", "words", "causes", "graphs"]
    experiments: Annotated[list[Name], Field(min_length=1)]
    initializers: Annotated[list[Name], Field(min_length=1)]
    #: |ξ|, and the first so many of the sessions' seeds
    size: Count
    seeds: Count
    #: of initializers, in place of what params.yaml has
    options: Annotated[dict[Name, dict[str, Option]], Field(default_factory=dict)]
    #: values of params.yaml, by dotted key
    changes: Annotated[dict[str, Any], Field(default_factory=dict)]
    #: of each novel entity; null: all
    max_insert_triples: Annotated[int, Field(ge=0)] | None = None
    #: else measured at once alone
    finetuned: bool = True
    #: for all epochs, for learning curves; else until convergence
    full_curves: bool = False
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


def changed(params: Params, changes: Mapping[str, Any]) -> Params:
    """The params with other values at dotted keys.

    Raises:
        InputError: where a key is in none of the sections that may be changed, or its value is none that it takes.
    """
    for key, value in changes.items():
        name, _, within = key.partition(".")
        if name not in CHANGEABLE or not within:
            raise InputError("", key, f"expected keys below {', '.join(CHANGEABLE)}")
        section = getattr(params, name)
        values = section.model_dump() if isinstance(section, Section) else deepcopy(dict(section))
        *parents, last = within.split(".")
        place = values
        for parent in parents:
            place = place.setdefault(parent, {})
            if not isinstance(place, dict):
                raise InputError("", key, f"expected a key, but {parent} is a value")
        place[last] = value
        new = check(values, cast("type[Any]", type(params).model_fields[name].annotation), name, "")
        params = params.model_copy(update={name: new})
    return params


def results(params: Params, study: Variant, stores: Sequence[Store], shown: str) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Runs of a variant, and what its models answer at once (``VARIANT_RUNS`` and ``VARIANT_QUERIES``).

    Args:
        params: with the variant's changes.
        stores: of its experiments.
        shown: beside the progress bar.
    """
    runs, asked = [], []
    for store in stores:
        about = f"{shown}, {store.experiment}" if len(stores) > 1 else shown
        for each, answered in run(repeat, tasks(params, study, store), params.compute, about):
            runs.append(each.assign(experiment=store.experiment))
            asked.append(answered.assign(experiment=store.experiment))
    ordered = pd.concat(runs).sort_values(["experiment", "model", "size", "seed", "session", "epoch", "scope"])
    return ordered, pd.concat(asked).sort_values(["experiment", "size", "seed"], kind="stable")


def tasks(params: Params, study: Variant, store: Store) -> list[VariantTask]:
    """A variant of one experiment, over its grid."""
    model, table, words = model_of(params), store.insert_triples(), words_of(params, study, store)
    configs = {name: config_of(params, study, name) for name in study.initializers}
    variant_tasks = []
    for points in store.grid(stack_height(params.compute), study.size, study.seeds):
        joint = [store.joint(points, model, n) for n in range(1, points.sessions + 1)] if not study.trains else []
        start = train_config(params) if study.trains else (store.theta0(points, model), joint)
        insert_triples = store.insert_triples_of(points, table)
        fewer = at_most(insert_triples, study.max_insert_triples, points, params.seed)
        variant_tasks.append(VariantTask(points, start, insert_triples, fewer, words, configs))
    return variant_tasks


def config_of(params: Params, study: Variant, initializer: str) -> InsertConfig:
    """How a variant inserts with one initializer, with options of its own or those of the main runs."""
    full_curves = [study.size] if study.full_curves else []
    config = insert_config(params, initializer, full_curves, study.options.get(initializer))
    return config if study.finetuned else config.training(max_epochs=0)


def words_of(params: Params, study: Variant, store: Store) -> np.ndarray:
    """Word vectors of the entities: the main runs', or the variant's own."""
    if not study.speaks:
        return store.words()
    return look_up(load_vectors(params.words), list(store.entities()["phrase"])).vectors


@dataclass(frozen=True)
class VariantTask:
    """Insert into embeddings of a stack of grid points with every initializer, beside the joint models."""

    points: GridPoints
    #: Θ⁰ and the joint model of each session, or how to train them
    start: tuple[StackedVectors, list[StackedVectors]] | TrainConfig
    #: the insert triples, and those that initializers see; (session, model, place in ``novel``, triple), in this order
    insert_triples: np.ndarray
    seen: np.ndarray
    #: shape: (E, w)
    words: np.ndarray
    #: by initializer
    configs: Mapping[str, InsertConfig]


def repeat(task: VariantTask) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Runs of every model, and what it answers right after insertion (without the experiment).

    Queries are the same whatever an initializer sees: triples with a novel entity that are no insert triples.
    """
    points = task.points
    theta0, joint = _trained(points, task.start) if isinstance(task.start, TrainConfig) else task.start
    measured = evaluate_stack(EvaluationTask(points, joint, task.insert_triples))
    targets = joint_targets(measured, points)
    results = {
        name: insert_stack(InsertTask(points, theta0, task.seen, task.words, targets, config))
        for name, config in task.configs.items()
    }
    first = {name: result.vectors[:, : points.size] for name, result in results.items()}
    runs = [measured.assign(model=JOINT_MODEL), *(result.runs.assign(model=name) for name, result in results.items())]
    return pd.concat(runs), break_down(QueryBreakdownTask(points, theta0, joint[0], first, task.insert_triples))


def _trained(points: GridPoints, config: TrainConfig) -> tuple[StackedVectors, list[StackedVectors]]:
    last, *earlier = joint_tasks([points], config)
    theta0, *joint = (
        StackedVectors(config.model, result.entity, result.relation)
        for result in map(train_stack, (TrainTask(points, config), *earlier, last))
    )
    return theta0, joint


def at_most(triples: np.ndarray, most: int | None, points: GridPoints, root: int) -> np.ndarray:
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
