"""Inserting novel entities into Θ⁰, and what becomes of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi import convergence, lessons, ranking, training
from isi.embeddings.stack import Embedding
from isi.experiments.judging import JudgingTask, insert_mask, measure_columns, run_rows
from isi.initializers import FALLBACKS, INITIALIZERS, Insertion
from isi.params import Negatives, Optimizer, Option
from isi.ranking import Result


@dataclass(frozen=True)
class FineTuning:
    """How Θ¹ is trained, and when it counts as converged."""

    root: int
    negatives: Negatives
    optimizer: Optimizer
    margin: float
    to_the_end: list[int]


@dataclass(frozen=True)
class InsertTask(JudgingTask):
    """Insert novel entities into Θ⁰ with one initializer and fine-tune."""

    initializer: str
    options: dict[str, Option]
    #: word vectors; shape: (E, w)
    words: np.ndarray
    #: MRR* of the joint models, by scope; shape: (M,)
    joint_mrr_star: dict[str, np.ndarray]
    tuning: FineTuning


@dataclass(frozen=True)
class Inserted:
    """What became of a task's novel entities."""

    #: as inserted; shape: (M, size, d)
    vectors: np.ndarray
    #: in the columns of ``tables.RUNS`` and ``tables.INSERTED`` (entity kinds apart)
    runs: pd.DataFrame
    entities: pd.DataFrame


def insert(task: InsertTask) -> Inserted:
    """Insert, measure at once in every scope, fine-tune, and measure after every epoch."""
    session, novel, how = task.joint, torch.as_tensor(task.novel), task.tuning
    insertion = insertion_of(task)
    initial = INITIALIZERS[task.initializer](insertion, **task.options)
    embedding = put(insertion.theta0, novel, initial.vectors)
    at_once = ranking.evaluate(embedding, ranking.novel_scope(session, novel, insert_mask(task)))
    own = [ranking.evaluate(embedding, {"own": queries})["own"]
           for queries in ranking.entity_scopes(session, novel, insert_mask(task))]  # fmt: skip
    followed = training.fine_tune(
        embedding,
        lessons.lesson(session, "fine-tuning", task.keys, how.negatives.head_pool),
        ranking.epoch_scopes(session, novel),
        {scope: torch.as_tensor(task.joint_mrr_star[scope]) - how.margin for scope in convergence.SCOPES},
        how.negatives,
        how.optimizer,
        how.root,
        task.size in how.to_the_end,
    )
    runs = [run_rows(task, 0, torch.arange(len(task.seeds)), at_once)]
    runs += [run_rows(task, step.epoch, step.models, step.results) for step in followed]
    return Inserted(initial.vectors.cpu().numpy(), pd.concat(runs), _entity_rows(task, initial.fallback, own))


def put(theta0: Embedding, novel: Tensor, vectors: Tensor) -> Embedding:
    """Θ¹ before training: Θ⁰ with the vectors of novel entities, (M, n, d), in place (equations 8 and 9)."""
    index = novel[..., None].expand_as(vectors)
    return Embedding(theta0.entity.scatter(1, index, vectors), theta0.relation)


def insertion_of(task: InsertTask) -> Insertion:
    """What initializers may see: Θ⁰, D⁰'s entities, word vectors, and the insert triples alone."""
    session, novel = task.initial, torch.as_tensor(task.novel)
    model, place, triple = torch.as_tensor(task.insert_triples).T
    slot = model * task.size + place
    number = torch.arange(len(slot)) - torch.searchsorted(slot, slot)  # within its entity; slots ascend
    longest = int(number.max()) + 1 if len(number) else 1
    head, relation, tail = task.graph.triples[triple].T
    is_tail = tail == novel[model, place]

    def padded(values: Tensor) -> Tensor:
        table = torch.zeros(*novel.shape, longest, dtype=values.dtype)
        table[model, place, number] = values
        return table

    return Insertion(
        theta0=task.theta,
        known=session.entities, eligible=session.trained(), novel=novel, words=torch.as_tensor(task.words),
        other=padded(torch.where(is_tail, head, tail)), relation=padded(relation), novel_is_tail=padded(is_tail),
        observed=padded(torch.ones_like(is_tail)),
        root=task.tuning.root, keys=task.keys,
    )  # fmt: skip


def _entity_rows(task: InsertTask, fallback: Tensor, own: Sequence[Result]) -> pd.DataFrame:
    rows = []
    for place, result in enumerate(own):
        fell = pd.Series([FALLBACKS[code] for code in fallback[:, place].tolist()], dtype="str")
        columns: dict[str, Any] = {
            "size": task.size,
            "seed": task.seeds,
            "entity": task.novel[:, place],
            "fallback": fell,
        }
        rows.append(measure_columns(result).assign(**columns))
    return pd.concat(rows)
