"""Variants of an experiment: other params, other word vectors, fewer insert triples,
or another graph.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, TypeVar, cast

import numpy as np
import pandas as pd
import torch
from pydantic import Field

from isi.config import Count, Name, Option, Section, check, ensure
from isi.errors import InputError
from isi.evaluation.changes import change_rows
from isi.evaluation.query_sets import with_weighted
from isi.experiment.insert import InsertConfig, insert_stack, joint_targets, with_vectors
from isi.experiment.train import TrainConfig, evaluate_stack, measured_sets, train_stack
from isi.graph.sessions import SessionsOf
from isi.graph.words import Words, load_vectors, look_up
from isi.models.stack import Embedding
from isi.random import stream
from isi.tables.rules import NAME
from stages.breakdown import break_down, breakdown_table
from stages.grid import JOINT_MODEL, GridPoints, known_shares
from stages.runner import Compute, run, stack_height
from stages.store import Store, runs_table

S = TypeVar("S", bound=Section)

#: Runs of the initializers and the joint model of a variant, by experiment, and the query breakdown
#: at epoch 0.
VARIANT_RUNS = runs_table("data/beyond/{variant}.parquet", {"experiment": NAME, "model": NAME})
VARIANT_QUERIES = breakdown_table("data/beyond/{variant}.queries.parquet", {"experiment": NAME})
#: The same for an entry of ``graphs``.
GRAPH_RUNS = replace(VARIANT_RUNS, template="data/beyond/graphs/{graph}/runs.parquet")
GRAPH_QUERIES = replace(VARIANT_QUERIES, template="data/beyond/graphs/{graph}/queries.parquet")

#: Sections on which Θ⁰ and the joint model depend.
LEARNED = ("embedding", "models", "negatives", "training")
#: Sections that a variant may change.
CHANGEABLE = (*LEARNED, "words", "finetuning", "convergence", "initializers")

Changes = Annotated[dict[str, Any], Field(default_factory=dict)]  #: New values by dotted key.


class Variant(Section):
    """An entry of ``variants`` in the params of the second pipeline."""

    title: str  #: in the report
    #: section of the report
    group: Literal["baselines", "embeddings", "insert_triples", "words", "graphs"]
    experiments: Annotated[list[Name], Field(min_length=1)]
    initializers: Annotated[list[Name], Field(min_length=1)]
    size: Count  #: |ξ|
    seeds: Count  #: number of seeds of the sessions, from the first on
    #: replace those of params.yaml
    options: Annotated[dict[Name, dict[str, Option]], Field(default_factory=dict)]
    changes: Changes
    #: of each novel entity; null: all
    max_insert_triples: Annotated[int, Field(ge=0)] | None = None
    finetuned: bool = True  #: whether to fine-tune; else only measure right after insertion
    trained: bool = False  #: whether to train Θ⁰ and the joint model even if no change affects them

    def changes_one_of(self, *sections: str) -> bool:
        """Whether the variant changes one of these sections of params."""
        return any(key.partition(".")[0] in sections for key in self.changes)


class GraphExperiment(Section):
    """An entry of ``graphs`` in the params of the second pipeline:
    an experiment on a graph of its own.
    """

    title: str  #: in the report
    source: dict[str, Any]  #: a reader and its settings, as under ``sources``
    words: Words
    sessions: Annotated[SessionsOf, ensure(lambda sessions: len(sessions.sizes) == 1, "one size")]
    initializers: Annotated[list[Name], Field(min_length=1)]
    changes: Changes

    def variant(self, name: str) -> Variant:
        """This experiment as a variant, which trains Θ⁰ and the joint model itself."""
        return Variant(
            title=self.title,
            group="graphs",
            experiments=[name],
            initializers=self.initializers,
            size=self.sessions.sizes[0],
            seeds=self.sessions.seeds,
            options={},
            changes=self.changes,
            finetuned=False,
            trained=True,
        )


@dataclass(frozen=True)
class VariantConfig:
    """How a variant trains, inserts and fine-tunes, with its changes of params."""

    training: TrainConfig
    initializers: Mapping[str, InsertConfig]
    words: Words | None  #: None: the word vectors of the experiment
    compute: Compute


def changed(params: S, changes: Mapping[str, Any]) -> S:
    """Params with new values at dotted keys; ``InputError`` for a key outside
    ``CHANGEABLE`` or an invalid value.
    """
    for key, value in changes.items():
        name, _, within = key.partition(".")
        if name not in CHANGEABLE or not within:
            raise InputError("", key, f"expected a dotted key below {', '.join(CHANGEABLE)}")
        section = getattr(params, name)
        place = values = (
            section.model_dump() if isinstance(section, Section) else deepcopy(dict(section))
        )
        *parents, last = within.split(".")
        for parent in parents:
            place = place.setdefault(parent, {})
            if not isinstance(place, dict):
                raise InputError("", key, f"expected {parent} to be a mapping, got a value")
        place[last] = value
        new = check(values, cast("type[Any]", type(params).model_fields[name].annotation), name, "")
        params = params.model_copy(update={name: new})
    return params


def results(
    variant: Variant, parts: Sequence[tuple[Store, VariantConfig]], name: str
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Runs of a variant on experiments, each with its config, and its query breakdown right after
    insertion.
    """
    runs_of, answers_of = list[pd.DataFrame](), list[pd.DataFrame]()
    for store, config in parts:
        of_store = tasks(variant, config, store)
        results = run(run_variant, of_store, config.compute, f"{name}, {store.experiment}")
        shares = known_shares(points for points, *_ in of_store)
        measured = with_weighted(pd.concat([runs for runs, _ in results]), shares)
        answered = pd.concat([answers for _, answers in results])
        runs_of.append(measured.assign(experiment=store.experiment))
        answers_of.append(answered.assign(experiment=store.experiment))
    runs, answers = pd.concat(runs_of), pd.concat(answers_of)
    ordered = runs.sort_values(["experiment", "model", "size", "seed", "epoch", "scope"])
    return ordered, answers.sort_values(["experiment", "size", "seed"], kind="stable")


Models = tuple[Embedding, list[Embedding]]  #: Θ⁰ and the joint models.
#: Arguments of ``run_variant``.
VariantTask = tuple[
    GridPoints, Models | TrainConfig, np.ndarray, Mapping[str, InsertConfig], int | None
]


def tasks(variant: Variant, config: VariantConfig, store: Store) -> list[VariantTask]:
    """Arguments of ``run_variant`` for each stack of grid points of one experiment."""
    if config.words is None:
        words = store.words()
    else:
        words = look_up(load_vectors(config.words), list(store.entities()["phrase"])).vectors
    finetuned = variant.seeds if variant.finetuned else 0
    inserted = {
        name: replace(each, finetuned=finetuned) for name, each in config.initializers.items()
    }
    trains = variant.trained or variant.changes_one_of(*LEARNED)
    model, listed = config.training.model, list[VariantTask]()
    for points in store.grid(stack_height(config.compute), variant.size, variant.seeds):
        start: Models | TrainConfig = config.training
        if not trains:
            start = store.theta0(points, model), store.joint(points, model)
        listed.append((points, start, words, inserted, variant.max_insert_triples))
    return listed


def run_variant(*task: *VariantTask) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Runs of all initializers and the joint model at grid points,
    and their query breakdown at epoch 0.
    """
    points, start, words, configs, most = task
    theta0, joint = train_models(points, start) if isinstance(start, TrainConfig) else start
    measured = evaluate_stack(points, joint)
    targets = joint_targets(change_rows(measured), points)
    runs, answers = [measured.assign(model=JOINT_MODEL)], []
    for name, config in configs.items():
        seen = replace(points, insert_triples=limit_insert_triples(points, most, config.root))
        # the queries of all variants of an experiment are the same
        queries = measured_sets(points, with_changes=False)
        result = insert_stack(seen, theta0, words, targets, config, queries)
        runs.append(result.runs.assign(model=name))
        vectors = torch.from_numpy(result.vectors)
        theta = with_vectors(theta0, points.novel_ids, vectors)
        answers.append(break_down(points, theta, name))
    answers.append(break_down(points, joint[0], JOINT_MODEL))
    return pd.concat(runs), pd.concat(answers)


def train_models(points: GridPoints, config: TrainConfig) -> Models:
    """Train Θ⁰ and the joint model at grid points."""
    return train_stack(points, config).theta, [train_stack(points.all_known, config).theta]


def limit_insert_triples(points: GridPoints, most: int | None, root: int) -> np.ndarray:
    """At most ``most`` (None: all) random insert triples per novel entity, (I, 3);
    a lower limit gives a subset.
    """
    triples = points.insert_triples
    if most is None or not len(triples):
        return triples
    slots, number = np.unique(triples[:, :2], axis=0, return_counts=True)
    orders = [
        stream(root, "told", points.size, points.seeds[model], place).permutation(count)
        for (model, place), count in zip(slots.tolist(), number.tolist(), strict=True)
    ]
    return triples[np.concatenate(orders) < most]
