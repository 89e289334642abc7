"""Time of filtered ranking of test triples against PyKEEN's evaluator; ranks must be equal.

Both rank by the scores of one ComplEx model. Its vectors are whole numbers, so that scores are
exact and ties frequent. Ours also ranks relations, and compares with true ranks; PyKEEN computes
the mean reciprocal rank of heads and tails alone.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from pykeen.evaluation import RankBasedEvaluator
from pykeen.models import ComplEx
from pykeen.triples import CoreTriplesFactory
from torch import Tensor

from isi.evaluation.query_sets import query_sets
from isi.evaluation.ranking import MEASURES, Queries, evaluate, make_queries, padded_ids
from isi.graph.graph import Graph
from isi.graph.sessions import TEST, TRAIN, VALID, Session
from isi.models.model import make_model
from isi.models.stack import Embedding, uniform
from stages.check_params import Params
from stages.make_sessions import sample_novel
from tests.benchmarks.conftest import split_session

SCOPES_MODELS = 5
NOVEL = 5


def measure(benchmark: Any, ranked: Callable[[], object], triples: int, **facts: object) -> None:
    """Time a ranking of the queries of ``triples`` triples."""
    benchmark.group = "ranking"
    benchmark.extra_info.update(facts, triples=triples)
    benchmark.pedantic(ranked, rounds=15, warmup_rounds=2)


@pytest.fixture(scope="module")
def session(home: Graph, params: Params) -> Session:
    return split_session(home, params, 1)


@pytest.fixture(scope="module")
def complex_model(home: Graph, params: Params) -> ComplEx:
    torch.manual_seed(params.seed)
    factory = CoreTriplesFactory(home.triples, len(home.entities), len(home.relations))
    model = ComplEx(triples_factory=factory, embedding_dim=params.embedding.dimension // 2)
    for weights in model.parameters():
        weights.data.copy_(torch.randint(-2, 3, weights.shape))
    return model


@pytest.fixture(scope="module")
def embedding(complex_model: ComplEx) -> Embedding:
    """The vectors of PyKEEN's model as an embedding, a stack of one."""
    parts = complex_model.entity_representations, complex_model.relation_representations
    tables = (torch.cat([part[0]().real, part[0]().imag], -1)[None].detach() for part in parts)
    return Embedding(*tables, make_model("complex", {}, "models.complex"))


def ask(session: Session) -> Queries:
    """Queries of the test triples; the filter is all train, validation and test triples."""
    queried = session.members(TEST)
    known = session.members(TRAIN, VALID, TEST)
    return make_queries(session, padded_ids(queried), queried, known, known, session.entities)


def mean_reciprocal_ranks(embedding: Embedding, session: Session) -> Tensor:
    """Mean reciprocal rank of the head and tail query of each test triple;
    model i of the stack queries triple i.
    """
    triples = session.members(TEST)[0].nonzero()
    number = len(triples)
    queried = torch.zeros(number, session.splits.shape[1], dtype=torch.bool).scatter_(
        1, triples, True
    )
    everyone, known = (
        part.expand(number, -1) for part in (session.entities, session.members(TRAIN, VALID, TEST))
    )
    alone = Session(session.graph, everyone, session.splits.expand(number, -1))
    queries = make_queries(alone, triples, queried, known, known, everyone)
    assert queries.rows is not None
    stack = Embedding(
        embedding.entity.expand(number, -1, -1),
        embedding.relation.expand(number, -1, -1),
        embedding.model,
    )
    return evaluate(stack, {"test": queries})["test"].measures[:, MEASURES.index("mrr_entity")]


@pytest.mark.parametrize("prepared", [True, False])
def test_ours(benchmark: Any, embedding: Embedding, session: Session, prepared: bool) -> None:
    ready = ask(session)

    def ranked() -> None:
        evaluate(embedding, {"test": ready if prepared else ask(session)})

    label = "isi, prepared queries" if prepared else "isi, including preparation"
    measure(benchmark, ranked, int(ready.queried.sum()), what=label)


def test_pykeen(
    benchmark: Any, complex_model: ComplEx, embedding: Embedding, session: Session, home: Graph
) -> None:
    evaluator = RankBasedEvaluator(metrics=["mrr"], add_defaults=False, clear_on_finalize=False)
    test, learned = (
        home.triples[session.members(*splits)[0]] for splits in ((TEST,), (TRAIN, VALID))
    )

    def ranked() -> None:
        evaluator.evaluate(
            complex_model,
            test,
            batch_size=len(test),
            additional_filter_triples=learned,
            use_tqdm=False,
        )

    measure(benchmark, ranked, len(test), what="PyKEEN, RankBasedEvaluator")
    heads, tails = (np.concatenate(evaluator.ranks[slot, "realistic"]) for slot in ("head", "tail"))
    expected = torch.from_numpy((1 / heads + 1 / tails) / 2).double()
    torch.testing.assert_close(
        mean_reciprocal_ranks(embedding, session), expected, rtol=1e-5, atol=0
    )


def test_scopes(benchmark: Any, home: Graph, params: Params) -> None:
    """The ranking of a stack after each epoch of fine-tuning."""
    session = split_session(home, params, SCOPES_MODELS)
    everyone = np.arange(len(home.entities))
    novel = np.stack(
        [sample_novel(everyone, params.seed, NOVEL, seed) for seed in range(SCOPES_MODELS)]
    )
    scopes = query_sets(session, torch.from_numpy(novel), torch.zeros(session.splits.shape) > 0)
    keys, name = torch.arange(SCOPES_MODELS)[:, None], params.embedding.model
    model = make_model(name, params.models[name], f"models.{name}")
    stack = uniform(
        session.entities,
        len(home.relations),
        model,
        params.embedding.dimension,
        1.0,
        params.seed,
        keys,
    )
    triples = sum(int(scope.queried.sum()) for scope in scopes.values())
    label = f"isi, {SCOPES_MODELS} models, {len(scopes)} query sets"
    measure(benchmark, lambda: evaluate(stack, scopes), triples, what=label)
