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

from isi.analyses.hidden_entities import Hidden, HiddenSplit, HiddenTraining, hide
from isi.experiment.grid import GridPoints
from isi.graph.graph import HEAD
from isi.insertion.api import fit_new
from isi.insertion.result import Inserted
from isi.pykeen import enlarge, inserted, read_model, warm

Model = ERModel[Any, Any, Any]
Slot = Literal["head", "tail"]
#: Triples whose answers are ranked at once.
BATCH = 256


@dataclass(frozen=True)
class Case:
    """A model of known entities, and the insert triples of hidden ones."""

    model: Model
    split: HiddenSplit
    train: TriplesFactory
    valid: TriplesFactory
    insert_triples: np.ndarray
    names: list[str]
    words: np.ndarray | None
    settings: Hidden
    seed: int

    @property
    def larger(self) -> TriplesFactory:
        """Training triples and insert triples."""
        triples = torch.cat([self.train.mapped_triples, torch.from_numpy(self.insert_triples)])
        return factory_of(triples, self.names, self.train.relation_to_id)


#: Gives a model with the hidden entities in it, and, if that began with an initializer, what was inserted.
Method = Callable[[Case], tuple[Model, Inserted | None]]


def hidden_in(
    points: GridPoints, words: np.ndarray | None, settings: Hidden, key: str, root: int
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """What each method answers (``HIDDEN_ENTITIES``), and its seconds of processor time: method, told, seconds.

    Args:
        points: whose graph entities are hidden in, with one seed and no splits of its own.
        words: of the entities; shape (E, w).
        key: where the settings stand in params.
    """
    for name in ("pykeen", "torch_max_mem"):
        logging.getLogger(name).setLevel(logging.ERROR)
    warnings.filterwarnings("ignore", "'pin_memory' argument", UserWarning)
    gc.freeze()  # PyKEEN collects garbage after every epoch
    graph, (seed,) = points.graph, points.seeds
    split = hide(graph.triples.numpy(), len(graph.entities), settings, key, root, seed)
    names = [graph.entities[row] for row in split.order]
    relations = {name: row for row, name in enumerate(graph.relations)}
    known = factory_of(torch.from_numpy(split.triples), names[: split.known], relations)
    train, valid = known.split([1 - settings.training.valid, settings.training.valid], random_state=seed)
    start = time.process_time()
    model = trained(train, valid, settings.training, seed)
    answers, seconds = list[dict[str, Any]](), [{"method": "known", "seconds": time.process_time() - start}]
    case = Case(
        model, split, train, valid, split.rest, names, None if words is None else words[split.order], settings, seed
    )
    for number in settings.max_insert_triples:
        for name, method in methods(settings, number).items():
            start = time.process_time()
            larger, result = method(replace(case, insert_triples=split.insert_triples(number)))
            row = {"method": name, "initializer": result and result.initializer, "told": number}
            seconds.append(row | {"seconds": time.process_time() - start})
            answers += [row | measures for measures in measured(larger, split, valid.mapped_triples.numpy())]
    return pd.DataFrame(answers).assign(seed=seed, entities=len(names) - split.known), pd.DataFrame(seconds)


def methods(settings: Hidden, number: int | None) -> dict[str, Method]:
    """By name: what puts hidden entities into a model of the others. Retraining takes all insert triples only."""
    return {
        "insert": put,
        **{name: partial(put, initializer=name) for name in settings.initializers},
        "own": partial(put, own=True),
        "insert_new_rows": partial(put, new_rows=True),
        "own_new_rows": partial(put, own=True, new_rows=True),
        "own_all_rows": partial(put, own=True, all_rows=True),
        **({"retrained": retrained} if number is None else {}),
    }


def put(
    case: Case, initializer: str | None = None, own: bool = False, new_rows: bool = False, all_rows: bool = False
) -> tuple[Model, Inserted | None]:
    """Insert, by an initializer or as PyKEEN itself begins a row; then train the new rows, or all, if asked."""
    known, settings = case.split.known, case.settings
    result = inserted(
        case.model, case.train, case.insert_triples, new=case.names[known:], words=case.words,
        initializer="mean" if own else initializer, seed=case.seed,
    )  # fmt: skip
    entities = result.entities
    if own:
        fresh = read_model(untrained(case.larger, settings.training, case.seed), case.larger.mapped_triples, None)
        entities = np.concatenate([entities[:known], fresh.entity[0, known:].numpy()])
    if new_rows:
        entities, _ = fit_new(
            entities, result.relations, case.insert_triples, new=len(result.new), model=result.model,
            epochs=settings.epochs, seed=case.seed,
        )  # fmt: skip
    model, _ = enlarge(case.model, case.train, replace(result, entities=entities))
    if all_rows:
        torch.manual_seed(case.seed)
        loop(model.train(), case.larger, settings.training).train(
            case.larger, settings.epochs, settings.training.batch_size, use_tqdm=False, pin_memory=False,
            continue_training=True,
        )  # fmt: skip
        model.eval()
    return model, None if own else result


def retrained(case: Case) -> tuple[Model, None]:
    """A model of all training and insert triples, from nothing."""
    return trained(case.larger, case.valid, case.settings.training, case.seed), None


def factory_of(triples: Tensor, names: list[str], relations: Mapping[str, int]) -> TriplesFactory:
    """Triples of entities that are numbered as they are listed."""
    return TriplesFactory(triples, {name: row for row, name in enumerate(names)}, relations)


def untrained(factory: TriplesFactory, settings: HiddenTraining, seed: int) -> Model:
    """A model before it learns."""
    torch.manual_seed(seed)
    return ComplEx(triples_factory=factory, embedding_dim=settings.dimension, random_seed=seed, regularizer=None)


def trained(factory: TriplesFactory, valid: TriplesFactory, settings: HiddenTraining, seed: int) -> Model:
    """A model as it was when it answered validation triples best."""
    model = untrained(factory, settings, seed)
    with TemporaryDirectory() as folder:
        stopper = EarlyStopper(
            model, RankBasedEvaluator(), factory, valid, evaluation_batch_size=BATCH, frequency=settings.frequency,
            patience=settings.patience, metric="mrr", relative_delta=0.0, best_model_path=Path(folder, "best.pt"),
        )  # fmt: skip
        loop(model, factory, settings).train(
            factory, settings.max_epochs, settings.batch_size, stopper=stopper, use_tqdm=False, pin_memory=False
        )
    return model.eval()


def loop(model: Model, factory: TriplesFactory, settings: HiddenTraining) -> SLCWATrainingLoop:
    """PyKEEN's training against wrong triples, with an optimizer that lets it go on where a model is trained."""
    return SLCWATrainingLoop(
        model=model, triples_factory=factory, optimizer=warm(Adam(model.parameters(), lr=settings.learning_rate)),
        negative_sampler_kwargs={"num_negs_per_pos": settings.negatives},
    )  # fmt: skip


def measured(model: Model, split: HiddenSplit, valid: np.ndarray) -> Iterator[dict[str, Any]]:
    """How right answers rank among all entities, less other true answers; ties are halved.

    Args:
        valid: triples of known entities that were not trained on; shape (V, 3).
    """
    by_head = split.queries[:, HEAD] >= split.known
    of_heads, of_tails = split.queries[by_head], split.queries[~by_head]
    queries: dict[str, list[tuple[Slot, np.ndarray]]] = {
        "known": [("tail", of_heads), ("head", of_tails)],
        "hidden": [("head", of_heads), ("tail", of_tails)],
        "earlier": [("head", valid), ("tail", valid)],
    }
    for name, parts in queries.items():
        ranked = [(len(triples), *_ranked(model, triples, split, slot)) for slot, triples in parts if len(triples)]
        number, mrr, hits = np.array(ranked).T
        total = number.sum()
        yield {"asked": name, "queries": int(total), "mrr": mrr @ number / total, "hits_at_10": hits @ number / total}


def _ranked(model: Model, triples: np.ndarray, split: HiddenSplit, slot: Slot) -> tuple[float, float]:
    """Mean reciprocal rank of what is in a slot, and Hits@10."""
    results = RankBasedEvaluator().evaluate(
        model, torch.from_numpy(triples), targets=(slot,), additional_filter_triples=torch.from_numpy(split.true),
        batch_size=BATCH, use_tqdm=False,
    )  # fmt: skip
    measures = "inverse_harmonic_mean_rank", "hits_at_10"
    mrr, hits = (results.get_metric(f"{slot}.realistic.{measure}") for measure in measures)
    return mrr, hits
