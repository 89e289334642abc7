"""Experiments measured under every reading of the paper's metric (``isi.evaluation.readings``)."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import pandas as pd
import torch
from pydantic import Field
from torch import Tensor

from isi.analyses.affordances import ranks_of
from isi.analyses.variants import Changes
from isi.config import Count, EachOnce, Name, Names, Section, ensure
from isi.evaluation import readings
from isi.evaluation.readings import (
    ASPECTS,
    FILTERS,
    RANKINGS,
    QueryRanks,
    ReadingQueries,
    reading_queries,
)
from isi.experiment.grid import JOINT_MODEL, GridPoints
from isi.experiment.insert import InsertConfig, finetune, init_context, with_vectors
from isi.experiment.runner import Compute, run, stack_height
from isi.experiment.store import SIZE_AND_SEED, Store
from isi.experiment.train import TrainConfig, joint_tasks, train_stack
from isi.graph.graph import GraphOf
from isi.graph.sessions import SPLIT_NAMES, Session, SessionsOf, membership, touches
from isi.initializers import api
from isi.models.stack import Embedding, select
from isi.tables.rules import FROM_0, FROM_1, NAME, SHARE, at_least, one_of
from isi.tables.table import Table, TensorFile, concat

#: A model's column ``k``: the number of indicators of a sweep; 0: that of params, or none.
MODEL = {"model": NAME, "k": FROM_0}
#: The evidence: every query of D¹ right after insertion. ``triple``: id in D¹'s graph; ``hidden``:
#: the slot to predict; ``closeness_FILTER_TRUTH``: its term of MRR*; ``rank_FILTER``: the plain
#: rank.
RANKS = Table(
    "data/beyond/readings/{case}.ranks.parquet",
    {
        **MODEL,
        **SIZE_AND_SEED,
        "triple": FROM_0,
        "hidden": one_of("head", "relation", "tail"),
        "relation": NAME,
        "split": one_of(*SPLIT_NAMES),
        "novel": FROM_0,
        "count": at_least(1, "int64"),
        **{f"closeness_{filter_name}_{truth}": SHARE for filter_name, truth in RANKINGS},
        **{f"rank_{filter_name}": at_least(1, "float64") for filter_name in FILTERS},
    },
    key=["model", "k", "size", "seed", "triple", "hidden"],
)
#: MRR* right after insertion under each reading, null without queries; ``epochs``: those to
#: convergence, the maximum for a run that never did, null for the joint model and for a run that
#: is not fine-tuned.
READINGS = Table(
    "data/beyond/readings/{case}.parquet",
    {
        **MODEL,
        **SIZE_AND_SEED,
        **dict.fromkeys(ASPECTS, NAME),
        "mrr_star": SHARE.optional,
        "epochs": at_least(0, "float64").optional,
    },
    key=["model", "k", "size", "seed", *ASPECTS],
)
#: MRR* by epoch under each reading: a tensor ``MODEL.size=NN`` for each initializer and each size
#: with curves; shape (2, epochs, readings), float32: the mean over the seeds that are fine-tuned,
#: and their standard deviation, both -1 where no seed has queries.
READING_CURVES = TensorFile("data/beyond/readings/{case}.curves.safetensors")
#: Answers to (novel entity, relation of affordances, ?) among the known entities right after
#: insertion, for the novel entities that a case names (Table 3), in the seeds that insert them.
ANSWERS = Table(
    "data/beyond/readings/{case}.answers.parquet",
    {"model": NAME, "seed": FROM_0, "entity": NAME, "answer": NAME, "kind": NAME, "rank": FROM_1},
    key=["model", "seed", "entity", "answer"],
)
HIDDEN = ("head", "relation", "tail")
ORDER = ["model", "k", "size", "seed"]  #: Rows of a table are in this order, whatever the stacks.

#: Numbers k of indicators of a sweep.
Numbers = Annotated[list[Count], Field(min_length=1), EachOnce]


class ReadingCase(Section):
    """An entry of ``readings`` in the params of the second pipeline:
    a graph and the conditions of its training.
    """

    rules = (
        (
            lambda case: set(case.curves) <= set(case.finetuned) <= set(case.sessions.sizes),
            "expected curves among the sizes in finetuned, and these among sessions.sizes",
        ),
        (
            lambda case: case.finetuned_seeds <= case.sessions.seeds,
            "expected finetuned_seeds to be at most sessions.seeds",
        ),
        (
            lambda case: set(case.initializers).isdisjoint(case.controls),
            "expected controls other than the initializers",
        ),
    )
    title: str  #: in the report
    graph: GraphOf
    sessions: Annotated[SessionsOf, ensure(lambda sessions: sessions.steps == 1, "one step")]
    initializers: Annotated[Names, Field(min_length=1)]
    #: further ones, which are measured right after insertion alone
    controls: Annotated[Names, Field(default_factory=list)]
    #: sizes that are fine-tuned; the others are measured right after insertion alone
    finetuned: Annotated[list[Count], EachOnce]
    #: how many seeds of these sizes are fine-tuned, the first ones
    finetuned_seeds: Count
    #: of these sizes, those whose learning curves are kept
    curves: Annotated[list[Count], EachOnce]
    #: of a sweep, which has no curves
    indicators: Annotated[dict[Name, Numbers], Field(default_factory=dict)]
    #: entities whose affordances are ranked
    affordances: Annotated[list[str], EachOnce, Field(default_factory=list)]
    changes: Changes


@dataclass(frozen=True)
class ReadingTables:
    """The tables of a case."""

    ranks: pd.DataFrame
    readings: pd.DataFrame
    answers: pd.DataFrame
    curves: dict[str, Tensor]


#: An initializer with its options, and its number of indicators if that is swept, else 0.
Inserted = tuple[InsertConfig, int]


@dataclass(frozen=True)
class ReadingConfig:
    """How a case trains, inserts and fine-tunes, with its changes of params."""

    training: TrainConfig
    initializers: Sequence[Inserted]  #: those of the case, then those of its sweep
    affordances: str  #: the relation
    compute: Compute


@dataclass(frozen=True)
class Measurement:
    """What is measured of an initializer at a stack of grid points, besides ranks and readings."""

    #: the initializer; None: the joint model is measured
    inserted: Inserted | None
    finetuned: int = 0  #: seeds below this number are fine-tuned
    curves: bool = False  #: MRR* by epoch of the seeds that are fine-tuned
    relation: str = ""  #: whose answers are ranked
    entities: Sequence[str] = ()  #: about which they are ranked


@dataclass(frozen=True)
class Seen:
    """What ``measure_stack`` gives."""

    ranks: pd.DataFrame
    readings: pd.DataFrame
    answers: pd.DataFrame
    curves: Tensor | None  #: shape: (fine-tuned seeds, epochs, readings)


#: Arguments of ``measure_stack``.
ReadingTask = tuple[GridPoints, Embedding, Embedding, np.ndarray, Measurement]


def measure(case: ReadingCase, config: ReadingConfig, store: Store) -> ReadingTables:
    """Train, insert, fine-tune and measure a case."""
    grid = store.grid(stack_height(config.compute))
    theta0_tasks = [(points, config.training, 0) for points in grid]
    trained = run(train_stack, theta0_tasks, config.compute, f"{store.experiment}, Θ⁰")
    joint_of = _joint_models(config, grid, store.experiment)
    tasks = list[ReadingTask]()
    for points, result in zip(grid, trained, strict=True):
        joint = joint_of[tuple(points.seeds)]
        finetuned = case.finetuned_seeds if points.size in case.finetuned else 0
        for initializer, k in config.initializers:
            goes_on = initializer.initializer not in case.controls
            measurement = Measurement(
                (initializer, k),
                finetuned if goes_on else 0,
                goes_on and points.size in case.curves and not k,
                config.affordances,
                case.affordances,
            )
            tasks.append((points, result.theta, joint, store.words(), measurement))
        tasks.append((points, joint, joint, store.words(), Measurement(None)))
    parts = run(measure_stack, tasks, config.compute, f"{store.experiment}, readings")
    curves = defaultdict[str, list[Tensor]](list)
    for (points, *_, measurement), seen in zip(tasks, parts, strict=True):
        if seen.curves is not None and measurement.inserted:
            name = measurement.inserted[0].initializer
            curves[f"{name}.size={points.size:02d}"].append(seen.curves)
    answers = concat([seen.answers for seen in parts if len(seen.answers)], ANSWERS)
    kinds = store.entities().set_index("entity")["kind"]
    return ReadingTables(
        pd.concat([seen.ranks for seen in parts]).sort_values(ORDER, kind="stable"),
        pd.concat([seen.readings for seen in parts]).sort_values(ORDER, kind="stable"),
        answers.assign(kind=answers["answer"].map(kinds)),
        {name: _over_seeds(torch.cat(of)) for name, of in curves.items()},
    )


def _over_seeds(curves: Tensor) -> Tensor:
    """Mean and standard deviation of curves over the seeds with queries, -1 without any; shapes:
    (seeds, epochs, readings), (2, epochs, readings).
    """
    number, mean = (~curves.isnan()).sum(0), curves.nanmean(0)
    squares = (curves - mean).square().nansum(0)
    deviation = (squares / (number - 1).clamp(min=1)).sqrt()
    return torch.stack([mean, deviation.where(number > 0, torch.nan)]).nan_to_num(-1).float()


def _joint_models(
    config: ReadingConfig, grid: Sequence[GridPoints], name: str
) -> dict[tuple[int, ...], Embedding]:
    """The joint model of each stack of seeds; all sizes share it."""
    tasks = joint_tasks(grid, config.training)
    trained = run(train_stack, tasks, config.compute, f"{name}, joint")
    return {tuple(task[0].seeds): result.theta for task, result in zip(tasks, trained, strict=True)}


def measure_stack(
    points: GridPoints,
    theta: Embedding,
    joint: Embedding,
    words: np.ndarray,
    measurement: Measurement,
) -> Seen:
    """Measure an initializer, or the joint model, at a stack of grid points."""
    session, novel = points.session(1), points.novel_in(1)
    queries, inserted = reading_queries(session, novel), measurement.inserted
    model, k = (inserted[0].initializer, inserted[1]) if inserted else (JOINT_MODEL, 0)
    if inserted:
        config, _ = inserted
        context = init_context(points, theta, words, config.root)
        initial = api.INITIALIZERS.get(config.initializer, "").initialize(context, config.options)
        theta = with_vectors(theta, novel, initial.vectors)
    ranks = readings.rank_all(theta, queries)
    measured = readings.values(ranks, queries)
    epochs, curves = None, None
    is_finetuned = torch.tensor(points.seeds) < measurement.finetuned
    if inserted and is_finetuned.any():
        target = readings.values(readings.rank_all(joint, queries), queries) - config.margin
        last = config.optimizer.max_epochs
        watch = ReadingWatch(queries, target, is_finetuned, last, measurement.curves)
        finetune(points, theta, config, watch)
        epochs = watch.epochs
        curves = torch.stack(watch.seen, 1) if measurement.curves else None
    seeds = np.array(points.seeds)
    columns: dict[str, Any] = {"model": model, "k": k, "size": points.size}
    return Seen(
        _rank_rows(session, novel, queries, ranks, seeds).assign(**columns),
        _reading_rows(measured, epochs, seeds).assign(**columns),
        _answer_rows(points, theta, measurement).assign(model=model),
        curves,
    )


def _answer_rows(points: GridPoints, theta: Embedding, measurement: Measurement) -> pd.DataFrame:
    """Rows of ``ANSWERS`` without the model and kinds."""
    graph, novel, names = points.graph, points.novel[:, 0], np.array(points.graph.entities)
    model, place = np.isin(names[novel], list(measurement.entities)).nonzero()
    relation = graph.relations.index(measurement.relation) if len(model) else 0
    entity = torch.as_tensor(novel[model, place])
    scores = select(theta, torch.as_tensor(model)).score_tails(
        entity[:, None], torch.full((len(model), 1), relation)
    )
    known = points.session(0).entities[model]
    rank = ranks_of(scores[:, 0], known).cpu().numpy()
    row, answer = rank.nonzero()
    return pd.DataFrame(
        {
            "seed": np.array(points.seeds)[model[row]],
            "entity": names[novel[model, place]][row],
            "answer": names[answer],
            "rank": rank[row, answer],
        }
    )


class ReadingWatch:
    """Watches fine-tuning under every reading:
    ``epochs`` until MRR* reached the target, (M, readings), float64; ``last``, the maximum, where
    it never does; NaN without queries, and of an embedding that is not ``finetuned``, (M,), which
    ends at once.

    Without ``curves``, an embedding ends once it has converged under every reading. ``seen`` has
    MRR* by epoch with ``curves``; shape: (fine-tuned M, readings).
    """

    def __init__(
        self, queries: ReadingQueries, target: Tensor, finetuned: Tensor, last: int, curves: bool
    ) -> None:
        self.queries, self.target, self.last = queries, target, last
        self.finetuned, self.curves = finetuned, curves
        self.first = torch.full(target.shape, -1)
        self.seen = list[Tensor]()

    @property
    def epochs(self) -> np.ndarray:
        decided = torch.where(self.first >= 0, self.first, self.last).double()
        open_ones = self.target.isnan() | ~self.finetuned[:, None]
        return decided.masked_fill(open_ones, torch.nan).cpu().numpy()

    def __call__(self, epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        measured = readings.values(readings.rank_all(embedding, self.queries), self.queries)
        is_reached = readings.reached(measured, self.target[models])
        self.first[models] = torch.where(
            is_reached & (self.first[models] < 0), epoch, self.first[models]
        )
        going_on = self.finetuned[models]
        if self.curves:
            self.seen.append(measured[going_on])
        else:
            undecided = (self.first[models] < 0) & ~self.target[models].isnan()
            going_on = going_on & undecided.any(1)
        if not going_on.all():
            self.queries = select(self.queries, going_on)
        return going_on


def _rank_rows(
    session: Session, novel: Tensor, queries: ReadingQueries, ranks: QueryRanks, seeds: np.ndarray
) -> pd.DataFrame:
    """Rows of ``RANKS`` without the model's columns and the size."""
    graph, new = session.graph, touches(session.graph, membership(novel, session.entities.shape[1]))
    model, query = (queries.triples >= 0).nonzero(as_tuple=True)
    triple = queries.triples[model, query]
    numbers: dict[str, Tensor] = {
        "triple": triple,
        "novel": new[model, triple].long(),
        "count": graph.counts[triple],
    }
    names = {
        "relation": np.array(graph.relations)[graph.triples[triple, 1].cpu()],
        "split": np.array(SPLIT_NAMES)[session.splits[model, triple].cpu()],
        "seed": seeds[model.cpu()],
    }
    frames = []
    for slot, hidden in enumerate(HIDDEN):
        for place, (filter_name, truth) in enumerate(RANKINGS):
            numbers[f"closeness_{filter_name}_{truth}"] = ranks.closeness[
                model, place, slot, query
            ].double()
            numbers[f"rank_{filter_name}"] = ranks.rank[model, place, slot, query].double()
        arrays = {name: values.cpu().numpy() for name, values in numbers.items()}
        frames.append(pd.DataFrame({**names, **arrays, "hidden": hidden}))
    return pd.concat(frames)


def _reading_rows(measured: Tensor, epochs: np.ndarray | None, seeds: np.ndarray) -> pd.DataFrame:
    """Rows of ``READINGS`` without the model's columns and the size."""
    every = readings.readings()
    columns: dict[str, Any] = {"seed": np.repeat(seeds, len(every))}
    for aspect in ASPECTS:
        names = [getattr(reading, aspect) for reading in every]
        columns[aspect] = pd.Categorical(names * len(seeds))
    columns["mrr_star"] = measured.flatten().cpu().numpy()
    columns["epochs"] = np.nan if epochs is None else epochs.flatten()
    return pd.DataFrame(columns)
