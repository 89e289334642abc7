"""One novel entity from where it is inserted to where fine-tuning takes it (Figure 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch

from isi import lessons, training
from isi.experiments.insertion import InsertTask, insertion_of, put
from isi.initializers import INITIALIZERS, has_insert_triples, has_words

#: The paper's initializers.
TRACED = ("xavier", "iu", "es", "rs", "ers")


@dataclass(frozen=True)
class TraceTask(InsertTask):
    """Insert the novel entities of one cell and follow one of them: a stack of height 1."""

    #: of the entity in ``novel``
    place: int
    epochs: int


@dataclass(frozen=True)
class Trace:
    """What became of one novel entity."""

    #: its vector before training and after each epoch; shape: (epochs + 1, d)
    path: np.ndarray
    #: its indicators, none where the initializer takes none; shape: (E,), bool
    indicators: np.ndarray


def trace(task: TraceTask) -> Trace:
    """Follow the entity through the same training as ``insertion.insert``."""
    how, novel = task.tuning, torch.as_tensor(task.novel)
    insertion = insertion_of(task)
    initial = INITIALIZERS[task.initializer](insertion, **task.options)
    state = training.start(put(insertion.theta0, novel, initial.vectors))
    lesson = lessons.lesson(task.joint, "fine-tuning", task.keys, how.negatives.head_pool)
    entity, path = novel[0, task.place], [initial.vectors[0, task.place]]
    for epoch in range(1, task.epochs + 1):
        training.run_epoch(state, lesson, how.negatives, how.optimizer, how.root, epoch)
        path.append(state.embedding.entity[0, entity].clone())
    chosen = torch.zeros(len(task.graph.entities), dtype=torch.bool)
    if initial.indicators is not None:
        chosen = initial.indicators[0, task.place]
    return Trace(torch.stack(path).cpu().numpy(), chosen.cpu().numpy())


def place_of_interest(task: InsertTask, kinds: pd.Series) -> int | None:
    """Place of the first novel object with a word vector and insert triples in a cell; None where there is none.

    Args:
        kinds: of entities, by id.
    """
    insertion = insertion_of(task)
    able = (has_words(insertion) & has_insert_triples(insertion))[0].numpy()
    places = np.flatnonzero(able & (kinds.astype(str)[task.novel[0]] == "object").to_numpy())
    return int(places[0]) if len(places) else None
