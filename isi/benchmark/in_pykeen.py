"""Insert hidden entities into a model of PyKEEN:
by ``isi.pykeen.insert``, by PyKEEN's initializer, by retraining.
"""

import gc
import logging
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, cast

import numpy as np
import pandas as pd
import torch
from pykeen.evaluation import RankBasedEvaluator
from pykeen.losses import loss_resolver
from pykeen.models import ERModel, model_resolver
from pykeen.stoppers import EarlyStopper
from pykeen.training import training_loop_resolver
from pykeen.triples import TriplesFactory
from torch.optim import Adagrad, Adam

from isi.benchmark import HiddenSplit, hide
from isi.benchmark.study import Hidden, HiddenTraining
from isi.config import check_names
from isi.errors import InputError, at
from isi.experiment.grid import GridPoints
from isi.graph.graph import Graph
from isi.graph.vocabulary import Vocabulary
from isi.insertion.inverses import both_ways
from isi.insertion.result import with_vectors
from isi.models.losses import loss_named
from isi.pykeen import EnlargedModel, insert, read_model, warm
from isi.pykeen.reading import loss_of, relation_tables_of, stored, table_rows, tables_of
from isi.tables import paths
from isi.training import rows
from isi.training.rows import Recipe

Model = ERModel[Any, Any, Any]
OPTIMIZERS = {"adam": Adam, "adagrad": Adagrad}  #: By their names in params.
BATCH = 256  #: Number of triples in a batch of PyKEEN's evaluation.


def hidden_in(
    points: GridPoints, words: np.ndarray | None, settings: Hidden, key: str, root: int
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Rows of ``HIDDEN_ENTITIES`` for one seed, and the CPU seconds by method,
    initializer and ``told``.
    """
    for name in ("pykeen", "torch_max_mem"):
        logging.getLogger(name).setLevel(logging.ERROR)
    warnings.filterwarnings("ignore", "'pin_memory' argument", UserWarning)
    gc.freeze()  # PyKEEN collects garbage after every epoch; frozen objects are skipped
    graph, (seed,), training = points.graph, points.seeds, settings.training
    with at(paths.BEYOND_PARAMS):
        check_names([training.model], model_resolver.lookup_dict, f"{key}.training.model")
        check_names([training.loss], loss_resolver.lookup_dict, f"{key}.training.loss")
    with refused_at(f"{key}.training.loss_options"):
        loss_resolver.make(training.loss, training.loss_options)
    split = hidden(graph, settings, key, root, seed)
    names, inverse = split.entities, training.inverse_triples
    known = factory_of(split.ids.triples, names[: split.ids.known], split.relations, inverse)
    held_out = training.valid
    train, valid, test = known.split([1 - 2 * held_out, held_out, held_out], random_state=seed)
    with refused_at(f"{key}.training.model_options"):
        untrained(train, training, seed)
    words = None if words is None else words[split.ids.order]
    start = time.process_time()
    case = Case(trained(train, valid, training, seed), train, valid, names, words, settings, seed)
    seconds = [{"method": "known", "seconds": time.process_time() - start}]
    earlier = test.mapped_triples.numpy()
    before = split.evaluate(case.model, earlier=earlier).measures()
    answers = [{"method": "nothing", **measures} for measures in before.to_dict("records")]
    methods: dict[str, dict[str, Any]] = {
        "insert": {},
        **{name: {"initializer": name} for name in settings.initializers},
        "own": {"pykeen_rows": True},
        "insert_new_rows": {"then": "new_rows"},
        "own_new_rows": {"pykeen_rows": True, "then": "new_rows"},
    }
    if settings.train_all_rows:
        methods["own_all_rows"] = {"pykeen_rows": True, "then": "all_rows"}
    if settings.retrain:
        methods["retrained"] = {"then": "retrain"}
    for number, (name, options) in product(settings.max_insert_triples, methods.items()):
        if name in ("own_all_rows", "retrained") and number is not None:
            continue
        start = time.process_time()
        model, result = case.enlarged(split.ids.insert_triples(number), **options)
        row = {"method": name, "initializer": result and result.initializer, "told": number}
        seconds.append(row | {"seconds": time.process_time() - start})
        trained_with = result and loss_named(result.rows.details.method.trained_with)
        row["trained_with"] = trained_with and trained_with.name
        estimate = result.harm if name == "insert" and result else None
        measured = split.evaluate(model, earlier=earlier).measures()
        for measures in measured.to_dict("records"):
            is_estimated = measures["asked"] == "earlier"
            answers.append(row | measures | {"estimated_loss": estimate if is_estimated else None})
    table = pd.DataFrame(answers).assign(seed=seed, entities=len(split.hidden))
    return table, pd.DataFrame(seconds)


@contextmanager
def refused_at(key: str) -> Iterator[None]:
    """InputError at a key of ``beyond/params.yaml`` for options that PyKEEN refuses."""
    try:
        yield
    except (KeyError, TypeError) as error:
        raise InputError(paths.BEYOND_PARAMS, key, str(error)) from error


def hidden(graph: Graph, settings: Hidden, key: str, root: int, seed: int) -> HiddenSplit:
    """The split of a study; InputError names the key in ``beyond/params.yaml``."""
    share, fewest, queries = settings.fraction, settings.fewest, settings.queries
    try:
        return hide(graph, fraction=share, fewest=fewest, queries=queries, seed=seed, root=root)
    except InputError as error:
        raise InputError(paths.BEYOND_PARAMS, f"{key}.fraction", error.message) from error


@dataclass(frozen=True)
class Case:
    """A model of the known entities, and the data with which hidden entities are inserted."""

    model: Model
    train: TriplesFactory
    valid: TriplesFactory
    names: list[str]  #: of known entities, then of hidden ones
    words: np.ndarray | None
    settings: Hidden
    seed: int

    def enlarged(
        self,
        insert_triples: np.ndarray,
        initializer: str | None = None,
        pykeen_rows: bool = False,
        then: Literal["new_rows", "all_rows", "retrain"] | None = None,
    ) -> tuple[Model, EnlargedModel | None]:
        """The model with the hidden entities, and the result of ``isi.pykeen.insert``
        (None for other methods).

        The rows of hidden entities come from ``initializer`` (None: the default) or, with
        ``pykeen_rows``, from PyKEEN's initializer. ``then`` trains the new rows, or all rows, or
        instead retrains a model from scratch.
        """
        known, training = self.train.num_entities, self.settings.training
        triples = np.concatenate([self.train.mapped_triples.numpy(), insert_triples])
        relations, inverse = list(self.train.relation_to_id), training.inverse_triples
        larger = factory_of(triples, self.names, relations, inverse)
        if then == "retrain":
            return trained(larger, self.valid, training, self.seed), None
        result = insert(
            self.model,
            self.train,
            insert_triples,
            new=self.names[known:],
            words=self.words,
            initializer="mean" if pykeen_rows else initializer,
            validation=self.valid,
            seed=self.seed,
        )
        if pykeen_rows:
            fresh = read_model(untrained(larger, training, self.seed), larger.mapped_triples, None)
            vectors = fresh.entity[0, known:].numpy()
            result = replace(result, rows=with_vectors(result.rows, vectors))
        if then == "new_rows":
            result = result.train(self.settings.epochs)
        model = result.model
        if then == "all_rows" and training.loop == "rows":
            fit_rows(model, larger, training, self.settings.epochs, self.seed)
        elif then == "all_rows":
            torch.manual_seed(self.seed)
            fit(model.train(), larger, training, self.settings.epochs, continue_training=True)
        return model.eval(), None if pykeen_rows else result


def factory_of(
    triples: np.ndarray, entities: Sequence[str], relations: Sequence[str], inverse: bool
) -> TriplesFactory:
    """PyKEEN's ``TriplesFactory`` of triples of ids (N, 3), which adds ``inverse`` ones on demand;
    labels are listed in the order of ids.
    """
    return TriplesFactory(
        torch.from_numpy(triples),
        Vocabulary("entity", entities).ids,
        Vocabulary("relation", relations).ids,
        create_inverse_triples=inverse,
    )


def untrained(factory: TriplesFactory, settings: HiddenTraining, seed: int) -> Model:
    torch.manual_seed(seed)
    return cast(
        Model,
        model_resolver.make(
            settings.model,
            {"regularizer": None, **settings.model_options},
            triples_factory=factory,
            embedding_dim=settings.dimension,
            loss=settings.loss,
            loss_kwargs=settings.loss_options,
            random_seed=seed,
        ),
    )


def trained(
    factory: TriplesFactory, valid: TriplesFactory, settings: HiddenTraining, seed: int
) -> Model:
    """Train a model, with early stopping on the MRR of the validation triples."""
    model = untrained(factory, settings, seed)
    if settings.loop == "rows":
        fit_rows(model, factory, settings, settings.max_epochs, seed)
        return model.eval()
    with TemporaryDirectory() as folder:
        stopper = EarlyStopper(
            model,
            evaluator(),
            factory,
            valid,
            evaluation_batch_size=BATCH,
            frequency=settings.frequency,
            patience=settings.patience,
            metric="mrr",
            relative_delta=0.0,
            best_model_path=Path(folder, "best.pt"),
        )
        fit(model, factory, settings, settings.max_epochs, stopper=stopper)
    return model.eval()


def fit(
    model: Model, factory: TriplesFactory, settings: HiddenTraining, epochs: int, **more: Any
) -> None:
    """Train with PyKEEN's loop and the optimizer of the settings;
    ``warm`` lets PyKEEN continue a trained model.
    """
    sampling: dict[str, Any] = {}
    if settings.negatives is not None:
        sampling["negative_sampler_kwargs"] = {"num_negs_per_pos": settings.negatives}
    optimizer = OPTIMIZERS[settings.optimizer](model.parameters(), lr=settings.learning_rate)
    training_loop_resolver.make(
        settings.loop,
        sampling,
        model=model,
        triples_factory=factory,
        optimizer=warm(optimizer),
    ).train(factory, epochs, settings.batch_size, use_tqdm=False, pin_memory=False, **more)


def fit_rows(
    model: Model, factory: TriplesFactory, settings: HiddenTraining, epochs: int, seed: int
) -> None:
    """Train all rows of a model's tables, from their present vectors, with ``isi.training.rows``,
    by the model's own loss.
    """
    triples, inverse = factory.mapped_triples, settings.inverse_triples
    theta = read_model(model, triples, 0.0)
    loss = loss_named(loss_of(model, theta.model) or "logistic")
    recipe = Recipe(
        loss=loss.name,
        margin=loss.margin,
        temperature=loss.temperature,
        batch_size=settings.batch_size,
        learning_rate=settings.learning_rate,
        negatives=settings.negatives,
        n3=settings.n3,
    )
    triples = both_ways(triples) if inverse else triples
    task = rows.Task(rows.Facts(triples, torch.ones(len(triples))), tails_only=inverse)
    theta = rows.fit(theta, task, recipe, epochs, seed)
    of_relations = table_rows(theta.model, theta.relation[0])
    tables = stored(tables_of(model), theta.entity[0])
    tables += stored(relation_tables_of(model), of_relations)
    for table, values in tables:
        table._embeddings.weight.data.copy_(values)


def evaluator() -> RankBasedEvaluator:
    """An evaluator of MRR and Hits@k alone; PyKEEN's other measures take most of
    the time of an evaluation.
    """
    return RankBasedEvaluator(metrics=["mrr", "hits_at_k"], add_defaults=False)
