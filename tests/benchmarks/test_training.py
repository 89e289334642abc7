"""An epoch of training: stacks of models against TorchKGE and PyKEEN, in triples scored per second.

All learn from the training observations of one split, repeats included, in batches of one size. An
observation is scored with 9 corrupted tails, 9 heads and 9 relations here, and with 9 corrupted
triples in all there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from pykeen.models import ComplEx
from pykeen.training import SLCWATrainingLoop
from pykeen.triples import CoreTriplesFactory
from torch import Tensor
from torchkge.models import AnalogyModel
from torchkge.sampling import BernoulliNegativeSampler
from torchkge.utils import LogisticLoss

from isi.graph.graph import Graph
from isi.graph.sessions import TRAIN, session_of
from isi.models.model import make_model
from isi.models.stack import uniform
from isi.params import Params
from isi.training import trainer
from isi.training.batches import training_data
from tests.benchmarks.training_triples import as_torchkge, splits

ROUNDS = 5


def measure(benchmark: Any, epoch: Callable[[], object], scored: int, **facts: object) -> None:
    """Time epochs in which a number of triples is scored."""
    benchmark.group = "training"
    benchmark.extra_info.update(facts, scored=scored)
    benchmark.pedantic(epoch, rounds=ROUNDS, warmup_rounds=1)


@pytest.fixture(scope="module")
def observations(home: Graph, params: Params) -> Tensor:
    """The first model's training observations, as triples; shape (N, 3)."""
    train = splits(home, params, 1)[0] == TRAIN
    return home.triples[train].repeat_interleave(home.counts[train], 0)


def time_stack(benchmark: Any, home: Graph, params: Params, models: int, mode: str, family: str) -> None:
    session = session_of(home, splits(home, params, models))
    keys = torch.tensor([[0, seed] for seed in range(models)])
    negatives = params.negatives.model_copy(update={"mode": mode})
    data = training_data(session, "training", keys, negatives.head_pool)
    how, kind = params.embedding, make_model(family, params.families[family], f"models.{family}")
    start = uniform(session.entities, len(home.relations), kind, how.dimension, how.init_range, params.seed, keys)
    state = trainer.start(start)
    scored = int(data.counts.sum()) * (1 + len(home.relations) * negatives.ratio)

    def epoch() -> None:
        trainer.run_epoch(state, data, negatives, params.training, params.seed, 1)

    measure(benchmark, epoch, scored, library="isi", model=type(kind).__name__, negatives=mode, models=models)


@pytest.mark.parametrize("mode", ["expected", "sampled"])
@pytest.mark.parametrize("models", [1, 5, 10, 30])
def test_stack(benchmark: Any, home: Graph, params: Params, models: int, mode: str) -> None:
    time_stack(benchmark, home, params, models, mode, "analogy")


@pytest.mark.parametrize("family", ["distmult", "complex", "transe", "rotate"])
def test_family(benchmark: Any, home: Graph, params: Params, family: str) -> None:
    time_stack(benchmark, home, params, 30, "expected", family)


def test_torchkge(benchmark: Any, home: Graph, params: Params, observations: Tensor) -> None:
    known = as_torchkge(home, observations)
    model, loss = AnalogyModel(params.embedding.dimension, known.n_ent, known.n_rel), LogisticLoss()
    sampler = BernoulliNegativeSampler(known, n_neg=params.negatives.ratio)
    optimizer = torch.optim.Adagrad(model.parameters(), params.training.learning_rate)

    def epoch() -> None:
        for batch in observations[torch.randperm(len(observations))].split(params.training.batch_size):
            heads, relations, tails = batch.T
            other_heads, other_tails = sampler.corrupt_batch(heads, tails, relations)
            optimizer.zero_grad()
            loss(*model(heads, tails, relations, other_heads, other_tails)).backward()
            optimizer.step()

    scored = len(observations) * (1 + params.negatives.ratio)
    measure(benchmark, epoch, scored, library="TorchKGE", model="AnalogyModel", negatives="sampled", models=1)


def test_pykeen(benchmark: Any, home: Graph, params: Params, observations: Tensor) -> None:
    factory = CoreTriplesFactory(observations, len(home.entities), len(home.relations))
    model = ComplEx(triples_factory=factory, embedding_dim=params.embedding.dimension // 2, random_seed=params.seed)
    optimizer = torch.optim.Adagrad(model.parameters(), params.training.learning_rate)
    sampling = {"num_negs_per_pos": params.negatives.ratio}
    loop = SLCWATrainingLoop(
        model=model, triples_factory=factory, optimizer=optimizer, negative_sampler_kwargs=sampling
    )

    def epoch() -> None:
        loop.train(factory, num_epochs=1, batch_size=params.training.batch_size, use_tqdm=False)

    scored = len(observations) * (1 + params.negatives.ratio)
    measure(benchmark, epoch, scored, library="PyKEEN", model="ComplEx", negatives="sampled", models=1)
