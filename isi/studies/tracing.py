"""One novel entity from where it is inserted to where fine-tuning takes it (Figure 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.base.params import Count, Section, Seed, Study
from isi.embeddings.stack import Embedding
from isi.experiments.cells import Cells
from isi.insertion.similarity import has_insert_triples, has_words
from isi.insertion.step import initialize, insertion_of, learn, put
from isi.insertion.tasks import InsertTask, how_in, told_in

#: The paper's initializers.
TRACED = ("xavier", "iu", "es", "rs", "ers")


class Approached(Section):
    """Which set is followed, and for how long."""

    size: Count
    seed: Seed
    kind: str
    epochs: Count


class Approach(Approached, Study):
    """``approach`` in params."""


@dataclass(frozen=True)
class TraceTask:
    """Insert the novel entities of one cell and follow one of them: a stack of height 1."""

    cells: Cells
    inserting: InsertTask
    #: of the entity in ``novel``
    place: int


@dataclass(frozen=True)
class Trace:
    """What became of one novel entity."""

    #: its vector before training and after each epoch; shape: (epochs + 1, d)
    path: np.ndarray
    #: its indicators, none where the initializer takes none; shape: (E,), bool
    indicators: np.ndarray


def trace(task: TraceTask) -> Trace:
    """Follow the entity through the same training as a step of insertion, in the first session."""
    told, how, theta0 = told_in(task.inserting, 1), how_in(task.inserting, 1), task.inserting.theta0.stack
    initial = initialize(theta0, task.cells.session(0), told, how)
    entity, path = told.novel[0, task.place], list[Tensor]()

    def watch(epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        path.append(embedding.entity[0, entity].clone() if epoch else initial.vectors[0, task.place])
        return torch.ones(len(models), dtype=torch.bool)

    learn(put(theta0, told.novel, initial.vectors), task.cells.session(1), told.novel, how, watch)
    chosen = torch.zeros(len(task.cells.graph.entities), dtype=torch.bool)
    if initial.indicators is not None:
        chosen = initial.indicators[0, task.place]
    return Trace(torch.stack(path).cpu().numpy(), chosen.cpu().numpy())


def place_of_interest(task: InsertTask, kinds: pd.Series, kind: str) -> int | None:
    """Place of the first novel entity of a kind that has a word vector and insert triples; None where there is none.

    Args:
        kinds: of entities, by id.
    """
    insertion = insertion_of(task.theta0.stack, task.cells.session(0), told_in(task, 1), how_in(task, 1))
    able = (has_words(insertion) & has_insert_triples(insertion))[0].numpy()
    places = np.flatnonzero(able & (kinds.astype(str)[task.cells.novel[0, 0]] == kind).to_numpy())
    return int(places[0]) if len(places) else None
