"""Insertion over the grid: each session inserts novel entities into Θ,
measures it and fine-tunes it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated, Literal

import numpy as np
import pandas as pd
import torch
from pydantic import Field
from torch import Tensor

from isi.config import Count, Fraction, Names, Option, Section
from isi.errors import InputError
from isi.evaluation.query_sets import (
    CONVERGING,
    entity_query_sets,
    epoch_query_sets,
    novel_query_set,
)
from isi.evaluation.ranking import evaluate, measure_rows
from isi.experiment.breakdown import QUERY_BREAKDOWN, break_down
from isi.experiment.grid import JOINT_MODEL, GridPoints
from isi.experiment.store import RUNS, Store
from isi.experiment.train import run_rows
from isi.graph.sessions import later_key
from isi.initializers.api import FALLBACKS, INITIALIZERS, InitContext, InitResult
from isi.insertion.engine import context_in_session
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.tables.table import concat
from isi.training import trainer
from isi.training.batches import Negatives, training_data
from isi.training.trainer import ConvergenceWatch, Optimizer, Watch

InitializerList = Annotated[Names, Field(min_length=1)] | Literal["all"]  #: Of an experiment.
#: MRR* by session and scope; NaN without queries; (M,).
JointTargets = Mapping[tuple[int, str], np.ndarray]


def is_listed(listed: InitializerList, initializer: str) -> bool:
    """Whether ``listed`` names the initializer or is "all"."""
    return listed == "all" or initializer in listed


class FullCurves(Section):
    """``full_curves`` of an experiment: the runs that go on to the last epoch;
    others stop at convergence.
    """

    sizes: list[Count]
    initializers: InitializerList = "all"


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
    margin: float  #: how far below the MRR* of the joint model counts as converged
    #: sizes fine-tuned for all epochs; the others stop at convergence
    full_curves: Sequence[int] = ()
    #: whether session 1 is measured by kind of query right after insertion
    breaks_down: bool = False

    def training(self, **changed: float) -> InsertConfig:
        """This config with other settings of the optimizer."""
        return replace(self, optimizer=self.optimizer.model_copy(update=changed))


#: Arguments of ``insert_stack``.
InsertTask = tuple[GridPoints, Embedding, np.ndarray, JointTargets, InsertConfig]


def insert_tasks(
    store: Store, model: Model, grid: Sequence[GridPoints], config: InsertConfig
) -> list[InsertTask]:
    """Tasks of insertion with one initializer, and fine-tuning,
    at grid points of the store's experiment.
    """
    words, joint = store.words(), RUNS.read(experiment=store.experiment, model=JOINT_MODEL)
    return [
        (points, store.theta0(points, model), words, joint_targets(joint, points), config)
        for points in grid
    ]


def joint_targets(joint: pd.DataFrame, points: GridPoints) -> JointTargets:
    """MRR* of the joint models by session and scope,
    or an ``InputError`` where their runs lack one.
    """
    rows = joint[(joint["size"] == points.size) & (joint["epoch"] == 0)]
    mrr_star = rows.set_index(["session", "scope", "seed"])["mrr_star"].to_dict()
    slots = list(product(range(1, points.sessions + 1), CONVERGING))
    for (session, scope), seed in product(slots, points.seeds):
        if (session, scope, seed) not in mrr_star:
            where = f"size {points.size}, session {session}, scope {scope}"
            expected = f"expected a row of seed {seed} at epoch 0"
            raise InputError(
                RUNS.path(experiment=points.experiment, model=JOINT_MODEL), where, expected
            )
    return {slot: np.array([mrr_star[*slot, seed] for seed in points.seeds]) for slot in slots}


@dataclass(frozen=True)
class SessionResult:
    """Results of insertion at a stack of grid points."""

    vectors: np.ndarray  #: as inserted, by session; shape: (M, S · size, d)
    runs: pd.DataFrame  #: in the columns of ``RUNS``
    entities: pd.DataFrame  #: in the columns of ``INSERTED``, without ``kind``
    queries: pd.DataFrame  #: in the columns of ``QUERY_BREAKDOWN``; no rows unless it is asked for


def insert_stack(*task: *InsertTask) -> SessionResult:
    """Insert the novel entities of every session, each into Θ of the session before."""
    results = [result for _, result in insert_sessions(*task)]
    vectors = np.concatenate([result.vectors for result in results], 1)
    runs, entities = (
        pd.concat(getattr(result, name) for result in results) for name in ("runs", "entities")
    )
    return SessionResult(vectors, runs, entities, results[0].queries)


def insert_sessions(
    points: GridPoints,
    theta0: Embedding,
    words: np.ndarray,
    joint: JointTargets,
    config: InsertConfig,
) -> Iterator[tuple[Embedding, SessionResult]]:
    """Insert and fine-tune session by session: yields each Θ and its measures, from epoch 0;
    ``words``: (E, w).
    """
    theta = theta0
    for number in range(1, points.sessions + 1):
        session = points.session(number)
        novel = points.novel_in(number)
        mask = points.insert_mask(number)
        initial, entities = initialize(points, theta, words, config, number), []
        theta = with_vectors(theta, novel, initial.vectors)
        immediate = evaluate(theta, novel_query_set(session, novel, mask))
        asks = config.breaks_down and number == 1
        parts = [break_down(points, theta, config.initializer)] if asks else []
        for place, queries in enumerate(entity_query_sets(session, novel, mask)):
            fallback = pd.Series(
                [FALLBACKS[code] for code in initial.fallback[:, place].tolist()], dtype="str"
            )
            rows = measure_rows(evaluate(theta, {"novel": queries}))
            entities.append(
                rows.assign(entity=points.novel[:, number - 1, place], fallback=fallback)
            )
        targets = {
            scope: torch.as_tensor(joint[number, scope]) - config.margin for scope in CONVERGING
        }
        watch = ConvergenceWatch(
            epoch_query_sets(session, novel), targets, points.size in config.full_curves
        )
        theta = finetune(points, theta, config, watch, number)
        runs = run_rows(points, number, [measure_rows(immediate), *watch.looks])
        of_entities = run_rows(points, number, entities)
        by_kind = concat(parts, QUERY_BREAKDOWN)
        yield theta, SessionResult(initial.vectors.cpu().numpy(), runs, of_entities, by_kind)


def initialize(
    points: GridPoints, theta: Embedding, words: np.ndarray, config: InsertConfig, session: int = 1
) -> InitResult:
    """Vectors of the novel entities of a session by the initializer (equation 8)."""
    initializer = INITIALIZERS.get(config.initializer, f"initializers.{config.initializer}")
    context = init_context(points, theta, words, config.root, session)
    return initializer.initialize(context, config.options)


def init_context(
    points: GridPoints, theta: Embedding, words: np.ndarray, root: int, session: int = 1
) -> InitContext:
    """The input of an initializer in a session that inserts into Θ."""
    rows = torch.as_tensor(points.insert_triples_in(session))
    keys = points.keys(*later_key(session))
    before, novel = points.session(session - 1), points.novel_in(session)
    words_of = torch.as_tensor(words)
    return context_in_session(theta, before, novel, rows, words_of, root, keys)


def finetune(
    points: GridPoints, theta: Embedding, config: InsertConfig, watch: Watch, session: int = 1
) -> Embedding:
    """Fine-tune Θ, with a session's novel entities in it, on the session;
    ``watch`` as in ``train`` (section 5.2).
    """
    keys, pool = points.keys(*later_key(session)), config.negatives.head_pool
    data = training_data(points.session(session), "fine-tuning", keys, pool)
    return trainer.train(theta, data, config.negatives, config.optimizer, config.root, watch)


def with_vectors(theta: Embedding, novel: Tensor, vectors: Tensor) -> Embedding:
    """A copy of Θ with vectors, (M, n, d), in the rows of the novel entities,
    (M, n) (equations 8 and 9).
    """
    return replace(
        theta, entity=theta.entity.scatter(1, novel[..., None].expand_as(vectors), vectors)
    )
