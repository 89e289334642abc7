"""One update for each observation, in triples scored per second: compiled, as batches of one, and TorchKGE's.

Ours score an observation with 9 corrupted tails, 9 heads and 9 relations, TorchKGE with 9 corrupted triples in
all. What is not compiled runs over a few observations.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import pytest
import torch
from torchkge.models import AnalogyModel
from torchkge.sampling import BernoulliNegativeSampler
from torchkge.utils import LogisticLoss

from isi.graph.graph import Graph
from isi.graph.sessions import session_of
from isi.models.model import make_model
from isi.models.stack import uniform
from isi.params import Params
from isi.training import trainer
from isi.training.batches import TrainingData, training_data
from tests.benchmarks.training_triples import as_torchkge, splits

#: All run on one thread: what else the machine does costs them no time of the processor.
pytestmark = pytest.mark.benchmark(timer=time.process_time)

FEW = 200
ROUNDS = 5


def measure(benchmark: Any, what: str, epoch: Callable[[], object], observations: int, each: int) -> None:
    """Time updates for some observations, each with a number of triples scored."""
    benchmark.group = "one_by_one"
    benchmark.pedantic(epoch, rounds=ROUNDS, warmup_rounds=1)
    seconds = benchmark.stats.stats.median
    benchmark.extra_info.update({
        "what": what, "observations": f"{observations:,}", "µs per update": 1e6 * seconds / observations,
        "million triples scored per second": observations * each / seconds / 1e6,
    })  # fmt: skip


@pytest.fixture(scope="module")
def data(home: Graph, params: Params) -> TrainingData:
    session = session_of(home, splits(home, params, 1))
    return training_data(session, "training", torch.zeros(1, 2, dtype=torch.int64), params.negatives.head_pool)


def time_epoch(benchmark: Any, what: str, family: str, data: TrainingData, params: Params) -> None:
    how, graph = params.embedding, data.session.graph
    negatives = params.negatives.model_copy(update={"mode": "sampled"})
    settings = params.training.model_copy(update={"batch_size": 1})
    kind, relations = make_model(family, {}, f"models.{family}"), len(graph.relations)
    start = uniform(data.session.entities, relations, kind, how.dimension, how.init_range, params.seed, data.keys)
    state = trainer.start(start)

    def epoch() -> None:
        trainer.run_epoch(state, data, negatives, settings, params.seed, 1)

    measure(benchmark, what, epoch, int(data.counts.sum()), 1 + relations * negatives.ratio)


@pytest.mark.parametrize("family", ["analogy", "distmult", "complex"])
def test_compiled(benchmark: Any, data: TrainingData, params: Params, family: str) -> None:
    what = f"isi, {type(make_model(family, {}, family)).__name__}, compiled"
    time_epoch(benchmark, what, family, data, params)


def test_batches_of_one(benchmark: Any, data: TrainingData, params: Params) -> None:
    few = (data.counts.cumsum(1) <= FEW) * data.counts
    with patch.object(trainer, "is_compiled", return_value=False):
        time_epoch(benchmark, "isi, ANALOGY, batches of one", "analogy", replace(data, counts=few), params)


def test_torchkge(benchmark: Any, home: Graph, params: Params) -> None:
    observations = home.triples[:FEW]
    known = as_torchkge(home, observations)
    model, loss = AnalogyModel(params.embedding.dimension, known.n_ent, known.n_rel), LogisticLoss()
    sampler = BernoulliNegativeSampler(known, n_neg=params.negatives.ratio)
    optimizer = torch.optim.Adagrad(model.parameters(), params.training.learning_rate)

    def epoch() -> None:
        for batch in observations.split(1):
            heads, relations, tails = batch.T
            other_heads, other_tails = sampler.corrupt_batch(heads, tails, relations)
            optimizer.zero_grad()
            loss(*model(heads, tails, relations, other_heads, other_tails)).backward()
            optimizer.step()

    measure(benchmark, "TorchKGE, AnalogyModel, batches of one", epoch, len(observations), 1 + params.negatives.ratio)
