"""Run a variant of experiments: other params, other word vectors or fewer insert triples. Train if
its changes require it, insert, fine-tune unless ``finetuned`` is false.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
import torch
from pydantic import Field

from isi.config import Count, Name, Option, Section
from isi.evaluation.changes import change_rows
from isi.evaluation.query_sets import with_weighted
from isi.graph.words import look_up
from isi.models.stack import Embedding
from isi.random import stream
from isi.tables.rules import NAME
from isi.training.fit import TrainConfig
from stages.breakdown import break_down, breakdown_table
from stages.embed_words import Words, load_vectors
from stages.grid import JOINT_MODEL, GridPoints, known_shares
from stages.insert import InsertConfig, insert_config, insert_stack, joint_targets, with_vectors
from stages.params import StageParams
from stages.runner import Compute, run, stack_height
from stages.stage import StageContext, stage
from stages.store import Store, runs_table
from stages.train_joint import evaluate_stack
from stages.train_theta0 import train_config, train_stack

#: Runs of the initializers and the joint model of a variant, by experiment, and the query breakdown
#: at epoch 0.
VARIANT_RUNS = runs_table("data/beyond/{variant}.parquet", {"experiment": NAME, "model": NAME})
VARIANT_QUERIES = breakdown_table("data/beyond/{variant}.queries.parquet", {"experiment": NAME})
#: Sections on which Θ⁰ and the joint model depend.
LEARNED = ("embedding", "models", "negatives", "training")

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


@dataclass(frozen=True)
class VariantConfig:
    """How a variant trains, inserts and fine-tunes, with its changes of params."""

    training: TrainConfig
    initializers: Mapping[str, InsertConfig]
    words: Words | None  #: None: the word vectors of the experiment
    compute: Compute


@stage
def vary(context: StageContext, variant: str) -> None:
    settings: Variant = context.beyond.read(f"variants.{variant}", Variant)
    parts = list[tuple[Store, VariantConfig]]()
    for name in settings.experiments:
        params = context.params.of(name).changed(settings.changes)
        parts.append((Store(name), variant_config(params, settings)))
    runs, answers = results(settings, parts, variant)
    VARIANT_RUNS.write(runs, context.stage, variant=variant)
    VARIANT_QUERIES.write(answers, context.stage, variant=variant)


def variant_config(params: StageParams, variant: Variant) -> VariantConfig:
    """The config of a variant; these params include its changes."""
    options = {**params.read("initializers", dict[str, dict[str, Any]]), **variant.options}
    inserted = {name: insert_config(params, name, options[name]) for name in variant.initializers}
    words = params.read("words", Words) if variant.changes_one_of("words") else None
    return VariantConfig(train_config(params), inserted, words, params.read("compute", Compute))


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
    model, tasks_of_stacks = config.training.model, list[VariantTask]()
    for points in store.grid(stack_height(config.compute), variant.size, variant.seeds):
        start: Models | TrainConfig = config.training
        if not trains:
            start = store.theta0(points, model), store.joint(points, model)
        tasks_of_stacks.append((points, start, words, inserted, variant.max_insert_triples))
    return tasks_of_stacks


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
        queries = points.measured_sets(with_changes=False)
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


if __name__ == "__main__":
    vary()
