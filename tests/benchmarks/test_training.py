"""Training against TorchKGE and PyKEEN, in triples scored per second:
an epoch of batches, and of single observations.

All train on the training observations of one split, with repetitions. Ours scores each observation
with 9 corrupted tails, 9 corrupted heads and 9 corrupted relations; the others with 9 corrupted
triples in total.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from typing import Any
from unittest.mock import patch

import pytest
import torch
from pykeen.models import ComplEx
from pykeen.training import SLCWATrainingLoop
from pykeen.triples import CoreTriplesFactory
from torch import Tensor
from torchkge.data_structures import KnowledgeGraph
from torchkge.models import AnalogyModel
from torchkge.sampling import BernoulliNegativeSampler
from torchkge.utils import LogisticLoss

from isi.graph.graph import Graph
from isi.graph.sessions import TRAIN, session_of
from isi.models.model import make_model
from isi.models.stack import uniform
from isi.training import trainer
from isi.training.batches import TrainingData, training_data
from isi.training.trainer import Training
from stages.check_params import Params
from tests.benchmarks.conftest import split_session
from tests.small_graphs import random_graph

ROUNDS = 5
#: Number of single observations in an epoch without compilation.
FEW = 200
#: About the number of observations of the paper's graph.
OBSERVATIONS = 14_759
#: Updates by single observations run on one thread; CPU time excludes other work of the machine.
singly = pytest.mark.benchmark(timer=time.process_time)


def time_batches(benchmark: Any, epoch: Callable[[], object], scored: int, **facts: object) -> None:
    """Time epochs, each of which scores ``scored`` triples."""
    benchmark.group = "training"
    benchmark.extra_info.update(facts, scored=scored)
    benchmark.pedantic(epoch, rounds=ROUNDS, warmup_rounds=1)


def time_updates(
    benchmark: Any, epoch: Callable[[], object], observations: int, each: int, what: str
) -> None:
    """Time the updates of ``observations`` observations, each of which scores ``each`` triples."""
    benchmark.group = "one_by_one"
    benchmark.pedantic(epoch, rounds=ROUNDS, warmup_rounds=1)
    seconds = benchmark.stats.stats.median
    benchmark.extra_info.update(
        {
            "what": what,
            "observations": f"{observations:,}",
            "µs per update": 1e6 * seconds / observations,
            "million triples scored per second": observations * each / seconds / 1e6,
        }
    )


@pytest.fixture(scope="module")
def observations(home: Graph, params: Params) -> Tensor:
    """The training observations of the first model as triples, with repetitions; shape (N, 3)."""
    train = split_session(home, params, 1).members(TRAIN)[0]
    return home.triples[train].repeat_interleave(home.counts[train], 0)


def epoch_of(
    params: Params, data: TrainingData, name: str, mode: str, settings: Training
) -> Callable[[], object]:
    graph, embedding = data.session.graph, params.embedding
    negatives = params.negatives.model_copy(update={"mode": mode})
    model = make_model(name, params.models[name], f"models.{name}")
    shape = len(graph.relations), model, embedding.dimension, embedding.init_range
    state = trainer.start(uniform(data.session.entities, *shape, params.seed, data.keys))
    return lambda: trainer.run_epoch(state, data, negatives, settings, params.seed, 1)


def torchkge_epoch(
    home: Graph, params: Params, observations: Tensor, batch_size: int
) -> Callable[[], object]:
    heads, relations, tails = observations.T
    names = (
        {name: number for number, name in enumerate(listed)}
        for listed in (home.entities, home.relations)
    )
    columns = {"heads": heads, "tails": tails, "relations": relations}
    known = KnowledgeGraph(kg=columns, **dict(zip(("ent2ix", "rel2ix"), names, strict=True)))
    model, loss = AnalogyModel(params.embedding.dimension, known.n_ent, known.n_rel), LogisticLoss()
    sampler = BernoulliNegativeSampler(known, n_neg=params.negatives.ratio)
    optimizer = torch.optim.Adagrad(model.parameters(), params.training.learning_rate)

    def epoch() -> None:
        for batch in observations[torch.randperm(len(observations))].split(batch_size):
            heads, relations, tails = batch.T
            other_heads, other_tails = sampler.corrupt_batch(heads, tails, relations)
            optimizer.zero_grad()
            loss(*model(heads, tails, relations, other_heads, other_tails)).backward()
            optimizer.step()

    return epoch


@pytest.mark.parametrize(
    ("models", "mode", "name"),
    [
        *(
            (models, mode, "analogy")
            for models in (1, 5, 10, 30)
            for mode in ("expected", "sampled")
        ),
        *((30, "expected", name) for name in ("distmult", "complex", "transe", "rotate")),
    ],
)
def test_stack(
    benchmark: Any, home: Graph, params: Params, models: int, mode: str, name: str
) -> None:
    keys = torch.tensor([[0, seed] for seed in range(models)])
    data = training_data(split_session(home, params, models), "training", keys)
    scored = int(data.counts.sum()) * (1 + len(home.relations) * params.negatives.ratio)
    label = type(make_model(name, params.models[name], name)).__name__
    epoch = epoch_of(params, data, name, mode, params.training)
    time_batches(
        benchmark, epoch, scored, library="isi", model=label, negatives=mode, models=models
    )


def test_torchkge(benchmark: Any, home: Graph, params: Params, observations: Tensor) -> None:
    epoch = torchkge_epoch(home, params, observations, params.training.batch_size)
    scored = len(observations) * (1 + params.negatives.ratio)
    time_batches(
        benchmark,
        epoch,
        scored,
        library="TorchKGE",
        model="AnalogyModel",
        negatives="sampled",
        models=1,
    )


def test_pykeen(benchmark: Any, home: Graph, params: Params, observations: Tensor) -> None:
    factory = CoreTriplesFactory(observations, len(home.entities), len(home.relations))
    model = ComplEx(
        triples_factory=factory,
        embedding_dim=params.embedding.dimension // 2,
        random_seed=params.seed,
    )
    optimizer = torch.optim.Adagrad(model.parameters(), params.training.learning_rate)
    sampling = {"num_negs_per_pos": params.negatives.ratio}
    loop = SLCWATrainingLoop(
        model=model, triples_factory=factory, optimizer=optimizer, negative_sampler_kwargs=sampling
    )

    epochs, losses = count(1), []

    def epoch() -> None:
        number = next(epochs)  # of all epochs; the loop goes on from those that it has done
        losses[:] = loop.train(
            factory,
            num_epochs=number,
            batch_size=params.training.batch_size,
            continue_training=number > 1,
            use_tqdm=False,
        )

    scored = len(observations) * (1 + params.negatives.ratio)
    time_batches(
        benchmark, epoch, scored, library="PyKEEN", model="ComplEx", negatives="sampled", models=1
    )
    assert len(losses) == ROUNDS + 1, "a call trained nothing"
    assert losses[-1] < losses[0]


@singly
@pytest.mark.parametrize("name", ["analogy", "distmult", "complex", "batches of one"])
def test_single_observations(benchmark: Any, home: Graph, params: Params, name: str) -> None:
    keys, compiled = torch.zeros(1, 2, dtype=torch.int64), name != "batches of one"
    data = training_data(split_session(home, params, 1), "training", keys)
    if not compiled:
        data, name = replace(data, counts=(data.counts.cumsum(1) <= FEW) * data.counts), "analogy"
    epoch = epoch_of(
        params, data, name, "sampled", params.training.model_copy(update={"batch_size": 1})
    )
    each = 1 + len(home.relations) * params.negatives.ratio
    what = (
        f"isi, {type(make_model(name, {}, name)).__name__}, "
        f"{'compiled' if compiled else 'batches of one'}"
    )
    with patch.object(trainer, "is_compiled", return_value=compiled):
        time_updates(benchmark, epoch, int(data.counts.sum()), each, what)


@singly
@pytest.mark.parametrize("entities", [20, 101, 145, 300])
def test_updates_by_number_of_entities(benchmark: Any, params: Params, entities: int) -> None:
    """Compiled epochs, each followed by batches of one of the same graph."""
    graph, keys = random_graph(entities, 3, 350), torch.zeros(1, 2, dtype=torch.int64)
    counts = torch.full_like(graph.counts, OBSERVATIONS // len(graph.counts))
    splits = torch.full((1, len(counts)), TRAIN, dtype=torch.int8)
    everything = session_of(replace(graph, counts=counts), splits)
    data = training_data(everything, "training", keys)
    few = replace(data, counts=(data.counts.cumsum(1) <= FEW) * data.counts)
    settings = params.training.model_copy(update={"batch_size": 1})
    plain = epoch_of(params, few, "analogy", "sampled", settings)
    seconds = []

    def measure_peer() -> None:
        before = time.process_time()
        with patch.object(trainer, "is_compiled", return_value=False):
            plain()
        seconds.append((time.process_time() - before) / int(few.counts.sum()))

    benchmark.group = "updates"
    epoch = epoch_of(params, data, "analogy", "sampled", settings)
    benchmark.pedantic(epoch, setup=measure_peer, rounds=ROUNDS, warmup_rounds=1)
    observations = int(data.counts.sum())
    benchmark.extra_info.update(
        entities=entities, observations=observations, plain=statistics.median(seconds)
    )


@singly
def test_single_observations_of_torchkge(benchmark: Any, home: Graph, params: Params) -> None:
    epoch, each = torchkge_epoch(home, params, home.triples[:FEW], 1), 1 + params.negatives.ratio
    time_updates(benchmark, epoch, FEW, each, "TorchKGE, AnalogyModel, batches of one")
