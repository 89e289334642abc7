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
from isi.tables.rules import FROM_0, NAME, SHARE, at_least, one_of
from isi.tables.table import Table, TensorFile
from isi.training.trainer import never_stop

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
#: ended before this reading was decided.
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
#: MRR* by epoch under each reading, -1 without queries: a tensor ``MODEL.size=NN`` for each
#: initializer and each size with curves; shape (seeds, epochs, readings), float32.
READING_CURVES = TensorFile("data/beyond/readings/{case}.curves.safetensors")
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
    )
    title: str  #: in the report
    graph: GraphOf
    sessions: Annotated[SessionsOf, ensure(lambda sessions: sessions.steps == 1, "one step")]
    initializers: Annotated[Names, Field(min_length=1)]
    #: sizes that are fine-tuned; the others only measured at once
    finetuned: Annotated[list[Count], EachOnce]
    #: of these, sizes that are fine-tuned for all epochs, for learning curves
    curves: Annotated[list[Count], EachOnce]
    #: readings by name: a run without curves ends once it has converged under each of them; []:
    #: under every one
    converging: Annotated[
        list[str], ensure(lambda names: set(names) <= set(_names()), "names of readings"), EachOnce
    ]
    #: of a sweep, which has no curves
    indicators: Annotated[dict[Name, Numbers], Field(default_factory=dict)]
    changes: Changes


def _names() -> list[str]:
    return [reading.name for reading in readings.readings()]


@dataclass(frozen=True)
class ReadingTables:
    """The tables of a case."""

    ranks: pd.DataFrame
    readings: pd.DataFrame
    curves: dict[str, Tensor]


#: An initializer with its options, and its number of indicators if that is swept, else 0.
Inserted = tuple[InsertConfig, int]


@dataclass(frozen=True)
class ReadingConfig:
    """How a case trains, inserts and fine-tunes, with its changes of params."""

    training: TrainConfig
    initializers: Sequence[Inserted]  #: those of the case, then those of its sweep
    compute: Compute


#: Arguments of ``measure_stack``.
ReadingTask = tuple[
    GridPoints, Embedding, Embedding, np.ndarray, Inserted | None, Sequence[str], bool
]


def measure(case: ReadingCase, config: ReadingConfig, store: Store) -> ReadingTables:
    """Train, insert, fine-tune and measure a case."""
    grid = store.grid(stack_height(config.compute))
    theta0_tasks = [(points, config.training, 0) for points in grid]
    trained = run(train_stack, theta0_tasks, config.compute, f"{store.experiment}, Θ⁰")
    joint_of = _joint_models(config, grid, store.experiment)
    tasks = list[ReadingTask]()
    for points, result in zip(grid, trained, strict=True):
        joint = joint_of[tuple(points.seeds)]
        sizes = points.size in case.finetuned, points.size in case.curves
        for initializer, k in config.initializers:
            inserted = initializer if sizes[0] else initializer.training(max_epochs=0), k
            has_curves = sizes[1] and not k
            tasks.append(
                (points, result.theta, joint, store.words(), inserted, case.converging, has_curves)
            )
        tasks.append((points, joint, joint, store.words(), None, case.converging, False))
    parts = run(measure_stack, tasks, config.compute, f"{store.experiment}, readings")
    ranks, rows, curved = zip(*parts, strict=True)
    curves = defaultdict[str, list[Tensor]](list)
    for task, seen in zip(tasks, curved, strict=True):
        if seen is not None and task[4] is not None:
            curves[f"{task[4][0].initializer}.size={task[0].size:02d}"].append(seen)
    ranks, rows = (pd.concat(frames).sort_values(ORDER, kind="stable") for frames in (ranks, rows))
    return ReadingTables(ranks, rows, {name: torch.cat(of) for name, of in curves.items()})


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
    inserted: Inserted | None,
    converging: Sequence[str],
    curves: bool,
) -> tuple[pd.DataFrame, pd.DataFrame, Tensor | None]:
    """Ranks, readings and, with ``curves``, MRR* by epoch, (seeds, epochs, readings),
    at a stack of grid points.

    ``inserted``: the initializer; None: the joint model is measured.
    """
    session, novel = points.session(1), points.novel_in(1)
    queries = reading_queries(session, novel)
    model, k = (inserted[0].initializer, inserted[1]) if inserted else (JOINT_MODEL, 0)
    if inserted:
        config, _ = inserted
        context = init_context(points, theta, words, config.root)
        initial = api.INITIALIZERS.get(config.initializer, "").initialize(context, config.options)
        theta = with_vectors(theta, novel, initial.vectors)
    ranks = readings.rank_all(theta, queries)
    measured = readings.values(ranks, queries)
    epochs, seen = None, None
    if inserted and config.optimizer.max_epochs:
        target = readings.values(readings.rank_all(joint, queries), queries) - config.margin
        watch = ReadingWatch(
            queries, target, config.optimizer.max_epochs, readings.places_of(converging), curves
        )
        finetune(points, theta, config, watch)
        epochs = watch.epochs
        seen = torch.stack(watch.seen, 1).float().nan_to_num(-1) if curves else None
    seeds = np.array(points.seeds)
    columns: dict[str, Any] = {"model": model, "k": k, "size": points.size}
    return (
        _rank_rows(session, novel, queries, ranks, seeds).assign(**columns),
        _reading_rows(measured, epochs, seeds).assign(**columns),
        seen,
    )


class ReadingWatch:
    """Watches fine-tuning under every reading:
    ``epochs`` until MRR* reached the target, (M, readings), float64.

    Without ``curves``, an embedding ends once it has converged under each of ``converging``, places
    of readings (none: all of them). Then ``epochs`` is NaN where it had not yet converged under
    another one; ``last``, the maximum, where it never does. ``seen`` has MRR* by epoch with
    ``curves``; shape: (M, readings).
    """

    def __init__(
        self,
        queries: ReadingQueries,
        target: Tensor,
        last: int,
        converging: Sequence[int],
        curves: bool,
    ) -> None:
        self.queries, self.target, self.last = queries, target, last
        self.converging = list(converging) or list(range(target.shape[1]))
        self.first = torch.full(target.shape, -1)
        self.ended = torch.zeros(len(target), dtype=torch.int64)
        self.curves, self.seen = curves, list[Tensor]()

    @property
    def epochs(self) -> np.ndarray:
        never = torch.where(self.ended == self.last, float(self.last), torch.nan)[:, None]
        decided = torch.where(self.first >= 0, self.first.double(), never)
        return decided.masked_fill(self.target.isnan(), torch.nan).cpu().numpy()

    def __call__(self, epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        measured = readings.values(readings.rank_all(embedding, self.queries), self.queries)
        is_reached = readings.reached(measured, self.target[models])
        self.first[models] = torch.where(
            is_reached & (self.first[models] < 0), epoch, self.first[models]
        )
        self.ended[models] = epoch
        if self.curves:
            self.seen.append(measured)
            return never_stop(epoch, embedding, models)
        undecided = (self.first[models] < 0) & ~self.target[models].isnan()
        going_on = undecided[:, self.converging].any(1)
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
