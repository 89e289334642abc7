"""Hidden entities in a model that PyKEEN has trained: put there by ``isi.pykeen.insert``, and by PyKEEN's own means."""

from __future__ import annotations

import gc
import logging
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
import pandas as pd
import torch
from pykeen.evaluation import RankBasedEvaluator
from pykeen.models import ComplEx, ERModel
from pykeen.stoppers import EarlyStopper
from pykeen.training import SLCWATrainingLoop
from pykeen.triples import TriplesFactory
from torch import Tensor
from torch.optim import Adam

from isi.analyses.hidden_entities import Hidden, HiddenTask, HiddenTraining, measure_hidden
from isi.experiment.grid import GridPoints
from isi.graph.graph import HEAD
from isi.insertion.fit_new import fit_new
from isi.insertion.result import Inserted
from isi.pykeen import enlarge, inserted, warm
from isi.pykeen.models import read_model

Model = ERModel[Any, Any, Any]
Slot = Literal["head", "tail"]
#: Triples whose answers are ranked at once.
BATCH = 256


@dataclass(frozen=True)
class HidingTask:
    """Hide entities of a graph with one seed, and insert them by every method."""

    #: whose graph is hidden in; it has one seed and no splits of its own
    points: GridPoints
    #: of the entities; shape (E, w)
    words: np.ndarray | None
    how: Hidden
    key: str
    root: int


@dataclass(frozen=True)
class Case:
    """A model of known entities, and what is told of hidden ones."""

    model: Model
    hiding: HiddenTask
    train: TriplesFactory
    valid: TriplesFactory
    told: np.ndarray
    names: list[str]
    words: np.ndarray | None
    how: Hidden
    seed: int

    @property
    def larger(self) -> TriplesFactory:
        """What is known and told."""
        triples = torch.cat([self.train.mapped_triples, torch.from_numpy(self.told)])
        return factory_of(triples, self.names, self.train.relation_to_id)


#: Gives a model with the hidden entities in it, and, if that began with an initializer, what was inserted.
Method = Callable[[Case], tuple[Model, Inserted | None]]


def hidden_in(task: HidingTask) -> tuple[pd.DataFrame, pd.DataFrame]:
    """What each method answers (``tables.HIDDEN``), and its seconds of processor time: method, initializer, told."""
    for name in ("pykeen", "torch_max_mem"):
        logging.getLogger(name).setLevel(logging.ERROR)
    warnings.filterwarnings("ignore", "'pin_memory' argument", UserWarning)
    gc.freeze()  # PyKEEN collects garbage after every epoch
    graph, (seed,) = task.points.graph, task.points.seeds
    hiding = measure_hidden(graph.triples.numpy(), len(graph.entities), task.how, task.key, task.root, seed)
    names = [graph.entities[row] for row in hiding.order]
    relations = {name: row for row, name in enumerate(graph.relations)}
    known = factory_of(torch.from_numpy(hiding.triples), names[: hiding.known], relations)
    train, valid = known.split([1 - task.how.training.valid, task.how.training.valid], random_state=seed)
    start = time.process_time()
    model = trained(train, valid, task.how.training, seed)
    answers, seconds = list[dict[str, Any]](), [{"method": "known", "seconds": time.process_time() - start}]
    words = None if task.words is None else task.words[hiding.order]
    for told in task.how.max_insert_triples:
        case = Case(model, hiding, train, valid, hiding.insert_triples(told), names, words, task.how, seed)
        for name, method in methods(task.how, told).items():
            start = time.process_time()
            made, done = method(case)
            same = {"method": name, "initializer": done and done.initializer, "told": told}
            seconds.append(same | {"seconds": time.process_time() - start})
            answers += [same | measure for measure in measured(made, hiding, valid.mapped_triples.numpy())]
    number = len(hiding.order) - hiding.known
    return pd.DataFrame(answers).assign(seed=seed, entities=number), pd.DataFrame(seconds)


def methods(how: Hidden, told: int | None) -> dict[str, Method]:
    """By name: what puts hidden entities into a model that knows the others. Retraining is told all, or not done."""
    return {
        "insert": put,
        **{name: partial(put, initializer=name) for name in how.initializers},
        "own": partial(put, own=True),
        "insert_new_rows": partial(put, new_rows=True),
        "own_new_rows": partial(put, own=True, new_rows=True),
        "own_all_rows": partial(put, own=True, all_rows=True),
        **({"retrained": retrained} if told is None else {}),
    }


def put(
    case: Case, initializer: str | None = None, own: bool = False, new_rows: bool = False, all_rows: bool = False
) -> tuple[Model, Inserted | None]:
    """Insert, by an initializer or as PyKEEN itself begins a row; then train the new rows, or all, if asked."""
    known = case.hiding.known
    done = inserted(
        case.model, case.train, case.told, new=case.names[known:], words=case.words,
        initializer="mean" if own else initializer, seed=case.seed,
    )  # fmt: skip
    entities = done.entities
    if own:
        fresh = read_model(untrained(case.larger, case.how.training, case.seed), case.larger.mapped_triples, None)
        entities = np.concatenate([entities[:known], fresh.entity[0, known:].numpy()])
    if new_rows:
        entities, _ = fit_new(
            entities, done.relations, case.told, new=len(done.new), model=done.model, epochs=case.how.epochs,
            seed=case.seed,
        )  # fmt: skip
    model, _ = enlarge(case.model, case.train, replace(done, entities=entities))
    if all_rows:
        further(model, case.larger, case.how, case.seed)
    return model, None if own else done


def retrained(case: Case) -> tuple[Model, None]:
    """A model of everything that is known and told, from nothing."""
    return trained(case.larger, case.valid, case.how.training, case.seed), None


def factory_of(triples: Tensor, names: list[str], relations: Mapping[str, int]) -> TriplesFactory:
    """Triples of entities that are numbered as they are listed."""
    return TriplesFactory(triples, {name: row for row, name in enumerate(names)}, relations)


def untrained(factory: TriplesFactory, how: HiddenTraining, seed: int) -> Model:
    """A model before it learns."""
    torch.manual_seed(seed)
    return ComplEx(triples_factory=factory, embedding_dim=how.dimension, random_seed=seed, regularizer=None)


def trained(factory: TriplesFactory, valid: TriplesFactory, how: HiddenTraining, seed: int) -> Model:
    """A model as it was when it answered validation triples best."""
    model = untrained(factory, how, seed)
    with TemporaryDirectory() as folder:
        stopper = EarlyStopper(
            model, RankBasedEvaluator(), factory, valid, evaluation_batch_size=BATCH, frequency=how.frequency,
            patience=how.patience, metric="mrr", relative_delta=0.0, best_model_path=Path(folder, "best.pt"),
        )  # fmt: skip
        loop(model, factory, how).train(
            factory, how.max_epochs, how.batch_size, stopper=stopper, use_tqdm=False, pin_memory=False
        )
    return model.eval()


def further(model: Model, factory: TriplesFactory, how: Hidden, seed: int) -> None:
    """Train all rows of a model on what is known and told."""
    torch.manual_seed(seed)
    loop(model.train(), factory, how.training).train(
        factory, how.epochs, how.training.batch_size, use_tqdm=False, pin_memory=False, continue_training=True
    )
    model.eval()


def loop(model: Model, factory: TriplesFactory, how: HiddenTraining) -> SLCWATrainingLoop:
    """PyKEEN's training against wrong triples, with an optimizer that lets it go on where a model is trained."""
    return SLCWATrainingLoop(
        model=model, triples_factory=factory, optimizer=warm(Adam(model.parameters(), lr=how.learning_rate)),
        negative_sampler_kwargs={"num_negs_per_pos": how.negatives},
    )  # fmt: skip


def measured(model: Model, hiding: HiddenTask, valid: np.ndarray) -> Iterator[dict[str, Any]]:
    """How right answers rank among all entities, less other true answers; ties are halved.

    Args:
        valid: triples of known entities that were not trained on; shape (V, 3).
    """
    by_head = hiding.asked[:, HEAD] >= hiding.known
    of_heads, of_tails = hiding.asked[by_head], hiding.asked[~by_head]
    asked: dict[str, list[tuple[Slot, np.ndarray]]] = {
        "known": [("tail", of_heads), ("head", of_tails)],
        "hidden": [("head", of_heads), ("tail", of_tails)],
        "earlier": [("head", valid), ("tail", valid)],
    }
    for name, parts in asked.items():
        found = np.array([_ranked(model, triples, hiding, slot) for slot, triples in parts if len(triples)])
        queries, mrr, hits = found.T
        number = queries.sum()
        yield {
            "asked": name,
            "queries": int(number),
            "mrr": mrr @ queries / number,
            "hits_at_10": hits @ queries / number,
        }


def _ranked(model: Model, asked: np.ndarray, hiding: HiddenTask, slot: Slot) -> tuple[int, float, float]:
    """How many triples there are, mean reciprocal rank of what is in a slot, and Hits@10."""
    results = RankBasedEvaluator().evaluate(
        model, torch.from_numpy(asked), targets=(slot,), additional_filter_triples=torch.from_numpy(hiding.true),
        batch_size=BATCH, use_tqdm=False,
    )  # fmt: skip
    find = results.get_metric
    return len(asked), find(f"{slot}.realistic.inverse_harmonic_mean_rank"), find(f"{slot}.realistic.hits_at_10")
