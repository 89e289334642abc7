"""ComplEx and DistMult against PyKEEN's on UMLS,
with PyKEEN's split and the same dimension and filter.

Each is trained with early stopping and with the best options on validation triples. Options tried:
for ours Adagrad at 0.1 and 0.5; for PyKEEN's Adagrad at 0.1 and Adam at 0.01, with and without its
own regularizer and constraint. PyKEEN's evaluator ranks the test triples for both.
"""

from typing import Any

import pytest
import torch
from pykeen.datasets import UMLS
from pykeen.evaluation import RankBasedEvaluator
from pykeen.models import ComplEx, DistMult, ERModel
from pykeen.training import SLCWATrainingLoop
from torch import Tensor

from isi.graph.graph import Graph
from isi.graph.sessions import TEST, TRAIN, VALID, Session, session_of
from isi.models.model import make_model
from isi.models.stack import Embedding, uniform
from isi.training.batches import Negatives, training_data
from isi.training.trainer import Training, train_until_best

DIMENSION = 100
NEGATIVES = Negatives(mode="expected", ratio=9)
SETTINGS = Training(
    batch_size=256,
    learning_rate=0.5,
    weight_decay=0.0,
    max_epochs=200,
    evaluate_every=5,
    patience=4,
)
#: Validation of PyKEEN's models: every ``EPOCHS`` epochs, with this patience and this maximum
#: number of evaluations.
EPOCHS, PATIENCE, LOOKS = 10, 4, 20
WITHIN = 0.02
PYKEEN: dict[str, tuple[type[ERModel], dict[str, Any], type[torch.optim.Optimizer], float]] = {
    "complex": (ComplEx, {"embedding_dim": DIMENSION // 2}, torch.optim.Adam, 0.01),
    "distmult": (
        DistMult,
        {"embedding_dim": DIMENSION, "entity_constrainer": None, "regularizer": None},
        torch.optim.Adagrad,
        0.1,
    ),
}


@pytest.fixture(scope="module")
def umls() -> UMLS:
    return UMLS()


@pytest.fixture(scope="module")
def session(umls: UMLS) -> Session:
    parts = (
        umls.training.mapped_triples,
        umls.validation.mapped_triples,
        umls.testing.mapped_triples,
    )
    codes = [
        torch.full((len(part),), code, dtype=torch.int8)
        for part, code in zip(parts, (TRAIN, VALID, TEST), strict=True)
    ]
    names = (
        [f"{number}" for number in range(count)]
        for count in (umls.num_entities, umls.num_relations)
    )
    triples = torch.cat(parts)
    ones, kinds = (
        torch.ones(len(triples), dtype=torch.int64),
        torch.zeros(umls.num_entities, dtype=torch.int64),
    )
    return session_of(Graph(*names, triples, ones, kinds), torch.cat(codes)[None])


def ours(name: str, session: Session) -> Embedding:
    keys, family = torch.zeros(1, 2, dtype=torch.int64), make_model(name, {}, name)
    start = uniform(
        session.entities, len(session.graph.relations), family, DIMENSION, 0.01, 0, keys
    )
    data = training_data(session, "training", keys)
    return train_until_best(start, data, NEGATIVES, SETTINGS, 0)[0]


def as_pykeen(embedding: Embedding, model: ERModel) -> ERModel:
    """PyKEEN's model with the vectors of our embedding."""
    tables = (embedding.entity[0], embedding.relation[0])
    for table, theirs in zip(
        tables, (model.entity_representations, model.relation_representations), strict=True
    ):
        (weights,) = theirs[0].parameters()
        halves = torch.stack(table.chunk(2, -1), -1) if isinstance(model, ComplEx) else table
        weights.data.copy_(halves.reshape(weights.shape))
    return model


def mean_reciprocal_rank(model: ERModel, umls: UMLS, triples: Tensor) -> float:
    """MRR of head and tail queries, with all triples of the dataset as filter."""
    known = [
        umls.training.mapped_triples,
        umls.validation.mapped_triples,
        umls.testing.mapped_triples,
    ]
    evaluator = RankBasedEvaluator()
    result = evaluator.evaluate(
        model, triples, batch_size=512, additional_filter_triples=known, use_tqdm=False
    )
    return float(result.get_metric("both.realistic.inverse_harmonic_mean_rank"))


def theirs(name: str, umls: UMLS) -> float:
    """Test MRR of PyKEEN's model at the evaluation with the best validation MRR."""
    model_class, options, optimizer_class, rate = PYKEEN[name]
    model = model_class(triples_factory=umls.training, random_seed=0, loss="softplus", **options)
    optimizer = optimizer_class(model.get_grad_params(), rate)  # type: ignore[call-arg]
    sampling = {"num_negs_per_pos": 3 * NEGATIVES.ratio}
    loop = SLCWATrainingLoop(
        model=model,
        triples_factory=umls.training,
        optimizer=optimizer,
        negative_sampler_kwargs=sampling,
    )
    highest, best, since = -1.0, 0.0, 0
    for look in range(1, LOOKS + 1):
        loop.train(
            umls.training,
            EPOCHS * look,
            SETTINGS.batch_size,
            continue_training=look > 1,
            use_tqdm=False,
        )
        valid = mean_reciprocal_rank(model, umls, umls.validation.mapped_triples)
        since = 0 if valid > highest else since + 1
        if valid > highest:
            highest, best = valid, mean_reciprocal_rank(model, umls, umls.testing.mapped_triples)
        if since == PATIENCE:
            break
    return best


@pytest.mark.parametrize("name", PYKEEN)
def test_umls(benchmark: Any, name: str, umls: UMLS, session: Session) -> None:
    benchmark.group = "umls"
    embedding = benchmark.pedantic(ours, args=(name, session), rounds=1)
    model_class, options, *_ = PYKEEN[name]
    model = as_pykeen(embedding, model_class(triples_factory=umls.training, **options))
    head, relation, tail = umls.testing.mapped_triples.T
    scores = embedding.score(head[None], relation[None], tail[None])[0]
    torch.testing.assert_close(
        model.score_hrt(umls.testing.mapped_triples)[:, 0].detach(), scores, rtol=1e-3, atol=1e-3
    )
    own, other = mean_reciprocal_rank(model, umls, umls.testing.mapped_triples), theirs(name, umls)
    benchmark.extra_info.update(
        model=model_class.__name__, isi=own, pykeen=other, triples=len(head)
    )
    assert own >= other - WITHIN
