"""Training against TorchKGE and PyKEEN: an epoch of batches, and of single observations.

Libraries are compared with one model each, of the same family: ComplEx with PyKEEN's, ANALOGY with
TorchKGE's. Both train on the training observations of one split, with repetitions; with as many
sampled negatives for each observation (TorchKGE's corrupts no relations), as many numbers in a
vector, the same size of batches, Adagrad, and one thread; without decay or regularizer, which takes
most of PyKEEN's time. Each epoch must change the parameters, and all of them lower the loss.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import pytest
import torch
from pykeen.models import ComplEx
from pykeen.training import SLCWATrainingLoop
from pykeen.triples import CoreTriplesFactory
from torch import Tensor
from torch.nn.functional import softplus
from torchkge.data_structures import KnowledgeGraph
from torchkge.models import AnalogyModel
from torchkge.sampling import BernoulliNegativeSampler
from torchkge.utils import LogisticLoss

from isi.graph.graph import HEAD, RELATION, TAIL, Graph
from isi.graph.sessions import TRAIN, session_of
from isi.models.model import make_model
from isi.models.stack import uniform
from isi.training import trainer
from isi.training.batches import Negatives, TrainingData, training_data
from isi.training.trainer import Training
from stages.check_params import Params
from tests.benchmarks.conftest import split_session
from tests.small_graphs import random_graph

ROUNDS = 5
#: Number of single observations in an epoch without compilation.
FEW = 200
#: About the number of observations of the paper's graph.
OBSERVATIONS = 14_759
#: Everything here runs on one thread; CPU time excludes other work of the machine.
pytestmark = pytest.mark.benchmark(timer=time.process_time)
#: Initial coordinates are uniform in ± this: from a tenth of it, as in the pipeline, ComplEx needs
#: more epochs to leave zero than are timed.
INIT_RANGE = 0.1
#: Of the observations, every so many are looked at between epochs.
LOOKED_AT = 20
#: Sampled negatives of an observation by slot: a third, and all, of those of the pipeline.
PER_SLOT = [3, 9]
SLOTS = ["head", "relation", "tail"]


@dataclass(frozen=True)
class Learner:
    """Models in training."""

    epoch: Callable[[], object]
    parameters: list[Tensor]
    score: Callable[[Tensor], Tensor]  #: of triples, (N, 3)


class Looks:
    """The loss of a learner before and after each epoch, and whether its parameters change.

    The loss is that of a few observations and of a corrupted triple for each slot of them, without
    those that are facts, with the weights that they have in training.
    """

    def __init__(self, learner: Learner, observations: Tensor, home: Graph, per_slot: int) -> None:
        self.learner, self.per_slot = learner, per_slot
        self.losses = list[float]()
        self.before = list[Tensor]()
        self.positive = observations[::LOOKED_AT]
        limits = {HEAD: home.entities, RELATION: home.relations, TAIL: home.entities}
        generator = torch.Generator().manual_seed(0)
        corrupted = []
        for slot, names in limits.items():
            part = self.positive.clone()
            part[:, slot] = torch.randint(len(names), (len(part),), generator=generator)
            corrupted.append(part)
        facts = set(map(tuple, home.triples.tolist()))
        others = [row for row in torch.cat(corrupted).tolist() if tuple(row) not in facts]
        self.negative = torch.tensor(others)

    @torch.no_grad()
    def look(self) -> None:
        now = [table.detach().clone() for table in self.learner.parameters]
        for table, before in zip(now, self.before, strict=bool(self.before)):
            assert not table.equal(before), "an epoch trained nothing"
        self.before = now
        positive = softplus(-self.learner.score(self.positive)).mean()
        negative = softplus(self.learner.score(self.negative)).mean()
        negatives = len(SLOTS) * self.per_slot
        self.losses.append(float(positive + negatives * negative) / (1 + negatives))

    def check(self) -> None:
        self.look()
        assert self.losses[-1] < self.losses[0], self.losses


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


def time_epochs(
    benchmark: Any, learner: Learner, looks: Looks, scored: int | None, **facts: object
) -> None:
    """Time epochs, each of which trains; ``scored``: triples that one scores, if it scores any."""
    benchmark.group = "training"
    benchmark.extra_info.update(facts, scored=scored)
    benchmark.pedantic(learner.epoch, setup=looks.look, rounds=ROUNDS, warmup_rounds=1)
    looks.check()


def of_isi(
    params: Params,
    data: TrainingData,
    name: str,
    negatives: Negatives,
    settings: Training,
    compiled: bool = True,
) -> Learner:
    relations, dimension = len(data.session.graph.relations), params.embedding.dimension
    model = make_model(name, params.models[name], f"models.{name}")
    shape = relations, model, dimension, INIT_RANGE
    state = trainer.start(uniform(data.session.entities, *shape, params.seed, data.keys))
    numbers = count(1)

    def epoch() -> None:
        number = next(numbers)
        trainer.run_epoch(state, data, negatives, settings, params.seed, number, compiled)

    def score(triples: Tensor) -> Tensor:
        columns = triples.T[:, None].expand(-1, len(data.keys), -1)
        return state.embedding.score(*columns)

    return Learner(epoch, [state.embedding.entity, state.embedding.relation], score)


def of_torchkge(
    home: Graph, params: Params, observations: Tensor, batch_size: int, negatives: int
) -> Learner:
    """An AnalogyModel: a half of a vector's numbers are scalars, as in ``isi``."""
    heads, relations, tails = observations.T
    names = (
        {name: number for number, name in enumerate(listed)}
        for listed in (home.entities, home.relations)
    )
    columns = {"heads": heads, "tails": tails, "relations": relations}
    known = KnowledgeGraph(kg=columns, **dict(zip(("ent2ix", "rel2ix"), names, strict=True)))
    torch.manual_seed(params.seed)
    dimension = params.embedding.dimension
    parts = 3 * dimension // 4  # two thirds of them scalars, the others of two numbers each
    model = AnalogyModel(parts, known.n_ent, known.n_rel, scalar_share=2 / 3)
    assert sum(table.weight.shape[1] for table in model.children()) == 2 * dimension
    loss = LogisticLoss()
    sampler = BernoulliNegativeSampler(known, n_neg=negatives)
    optimizer = torch.optim.Adagrad(model.parameters(), params.training.learning_rate)

    def epoch() -> None:
        for batch in observations[torch.randperm(len(observations))].split(batch_size):
            heads, relations, tails = batch.T
            other_heads, other_tails = sampler.corrupt_batch(heads, tails, relations)
            optimizer.zero_grad()
            loss(*model(heads, tails, relations, other_heads, other_tails)).backward()
            optimizer.step()

    def score(triples: Tensor) -> Tensor:
        heads, relations, tails = triples.T
        return model.scoring_function(heads, tails, relations)

    return Learner(epoch, list(model.parameters()), score)


def of_pykeen(home: Graph, params: Params, observations: Tensor, negatives: int) -> Learner:
    factory = CoreTriplesFactory(observations, len(home.entities), len(home.relations))
    model = ComplEx(
        triples_factory=factory,
        embedding_dim=params.embedding.dimension // 2,
        regularizer=None,
        random_seed=params.seed,
    )
    loop = SLCWATrainingLoop(
        model=model,
        triples_factory=factory,
        optimizer=torch.optim.Adagrad(model.parameters(), params.training.learning_rate),
        negative_sampler_kwargs={"num_negs_per_pos": negatives, "corruption_scheme": SLOTS},
    )
    numbers = count(1)

    def epoch() -> None:
        number = next(numbers)  # of all epochs; the loop goes on from those that it has done
        losses = loop.train(
            factory,
            num_epochs=number,
            batch_size=params.training.batch_size,
            continue_training=number > 1,
            use_tqdm=False,
        )
        assert len(losses) == number

    def score(triples: Tensor) -> Tensor:
        return model.score_hrt(triples)[:, 0]

    return Learner(epoch, list(model.parameters()), score)


def sampled(params: Params, per_slot: int) -> Negatives:
    return params.negatives.model_copy(update={"mode": "sampled", "ratio": per_slot})


@pytest.mark.parametrize(
    ("name", "mode", "models", "per_slot"),
    [
        *((name, "sampled", 1, number) for name in ("complex", "analogy") for number in PER_SLOT),
        *(("analogy", "sampled", models, 9) for models in (5, 30)),
        *(("analogy", "expected", models, 9) for models in (1, 5, 30)),
        *((name, "expected", 30, 9) for name in ("distmult", "complex", "transe", "rotate")),
    ],
)
def test_isi(
    benchmark: Any,
    home: Graph,
    params: Params,
    observations: Tensor,
    name: str,
    mode: str,
    models: int,
    per_slot: int,
) -> None:
    keys = torch.tensor([[0, seed] for seed in range(models)])
    data = training_data(split_session(home, params, models), "training", keys)
    negatives = params.negatives.model_copy(update={"mode": mode, "ratio": per_slot})
    settings = params.training.model_copy(update={"weight_decay": 0.0})
    learner = of_isi(params, data, name, negatives, settings)
    number = len(SLOTS) * per_slot
    time_epochs(
        benchmark,
        learner,
        Looks(learner, observations, home, per_slot),
        int(data.counts.sum()) * (1 + number) if mode == "sampled" else None,
        library="isi",
        model=type(make_model(name, params.models[name], name)).__name__,
        family=name,
        negatives=f"{number} {mode}",
        models=models,
    )


@pytest.mark.parametrize("per_slot", PER_SLOT)
@pytest.mark.parametrize("library", ["PyKEEN", "TorchKGE"])
def test_others(
    benchmark: Any,
    home: Graph,
    params: Params,
    observations: Tensor,
    library: str,
    per_slot: int,
) -> None:
    negatives = len(SLOTS) * per_slot
    if library == "PyKEEN":
        learner = of_pykeen(home, params, observations, negatives)
        model, family = "ComplEx", "complex"
    else:
        learner = of_torchkge(home, params, observations, params.training.batch_size, negatives)
        model, family = "AnalogyModel", "analogy"
    time_epochs(
        benchmark,
        learner,
        Looks(learner, observations, home, per_slot),
        len(observations) * (1 + negatives),
        library=library,
        model=model,
        family=family,
        negatives=f"{negatives} sampled",
        models=1,
    )


@pytest.mark.parametrize("name", ["analogy", "distmult", "complex", "batches of one"])
def test_single_observations(benchmark: Any, home: Graph, params: Params, name: str) -> None:
    keys, compiled = torch.zeros(1, 2, dtype=torch.int64), name != "batches of one"
    data = training_data(split_session(home, params, 1), "training", keys)
    if not compiled:
        data, name = replace(data, counts=(data.counts.cumsum(1) <= FEW) * data.counts), "analogy"
    settings = params.training.model_copy(update={"batch_size": 1})
    negatives = sampled(params, params.negatives.ratio)
    learner = of_isi(params, data, name, negatives, settings, compiled)
    each = 1 + len(home.relations) * params.negatives.ratio
    what = (
        f"isi, {type(make_model(name, {}, name)).__name__}, "
        f"{'compiled' if compiled else 'batches of one'}"
    )
    time_updates(benchmark, learner.epoch, int(data.counts.sum()), each, what)


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
    negatives = sampled(params, params.negatives.ratio)
    plain = of_isi(params, few, "analogy", negatives, settings, compiled=False)
    seconds = []

    def measure_peer() -> None:
        before = time.process_time()
        plain.epoch()
        seconds.append((time.process_time() - before) / int(few.counts.sum()))

    benchmark.group = "updates"
    learner = of_isi(params, data, "analogy", negatives, settings)
    benchmark.pedantic(learner.epoch, setup=measure_peer, rounds=ROUNDS, warmup_rounds=1)
    observations = int(data.counts.sum())
    benchmark.extra_info.update(
        entities=entities, observations=observations, plain=statistics.median(seconds)
    )


def test_single_observations_of_torchkge(benchmark: Any, home: Graph, params: Params) -> None:
    negatives = len(SLOTS) * params.negatives.ratio
    learner = of_torchkge(home, params, home.triples[:FEW], 1, negatives)
    what = "TorchKGE, AnalogyModel, batches of one"
    time_updates(benchmark, learner.epoch, FEW, 1 + negatives, what)
