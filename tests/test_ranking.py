"""Ranks and MRR* against values by hand, and at chance (``test_query_sets`` has brute force)."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import pytest
import torch

from isi.evaluation.query_sets import query_sets, validation
from isi.evaluation.ranking import evaluate, make_queries, padded_ids
from isi.graph.sessions import session_of
from isi.models.bilinear import DistMult
from isi.models.distance import TransE
from isi.models.model import Model
from isi.models.stack import Embedding, select
from tests.small_graphs import ANALOGY, Triple, graph_of, points_of, random_embedding, random_graph

NONE: frozenset[Triple] = frozenset()


def measure(
    counts: Mapping[Triple, int],
    embedding: Embedding,
    answers: Collection[Triple],
    filtered: Collection[Triple] = NONE,
    candidates: Collection[int] | None = None,
) -> list[float]:
    """``MEASURES`` of the first model over the queries of ``answers``."""
    _, entities, _ = embedding.entity.shape
    session = session_of(
        graph_of(counts, entities, embedding.relation.shape[1]), torch.zeros(1, len(counts))
    )
    queried, left_out = (
        torch.tensor([[triple in chosen for triple in counts]]) for chosen in (answers, filtered)
    )
    may_answer = torch.tensor(
        [[candidates is None or entity in candidates for entity in range(entities)]]
    )
    queries = make_queries(session, padded_ids(queried), queried, left_out, left_out, may_answer)
    return evaluate(embedding, {"own": queries})["own"].measures[0].tolist()


def scalar(entities: list[float], relations: list[float]) -> Embedding:
    """An embedding with f(h, r, t) = h · r · t: all coordinates but the first are zero."""
    return Embedding(
        *(torch.tensor([[[x, 0, 0, 0] for x in table]]) for table in (entities, relations)), ANALOGY
    )


#: Counts of tails of entity 0 under relation 0 are 0, 5, 2, 3; the query is for its tail 3.
COUNTS: dict[Triple, int] = {(0, 0, 1): 5, (0, 0, 2): 2, (0, 0, 3): 3, (1, 1, 2): 7}
QUERY: Triple = (0, 0, 3)


@dataclass(frozen=True)
class Case:
    """Expected terms of MRR* and reciprocal ranks of the query;
    both are 1/2 for the relation slot.
    """

    tail: float
    head: float
    tail_rank: float
    head_rank: float
    #: with which tails of entity 0 score 0, 1, 2, 3 in this order
    values: tuple[float, ...] = (1, 4, 3, 2)
    counts: tuple[tuple[Triple, int], ...] = ()
    filtered: frozenset[Triple] = NONE
    candidates: tuple[int, ...] = (0, 1, 2, 3)


CASES = {
    # tail: 1 is seen more often, R_G = 2; 1 and 2 score higher, R_P = 3. Head: R_G = 1, all score
    # higher, R_P = 4
    "plain": Case(tail=1 / 2, head=1 / 4, tail_rank=1 / 3, head_rank=1 / 4),
    # tail: 2 is no rival, R_G = 2 = R_P
    "filtered rival": Case(
        tail=1, head=1 / 4, tail_rank=1 / 2, head_rank=1 / 4, filtered=frozenset({(0, 0, 2)})
    ),
    # tail: R_G = 1 without 1, R_P = 2
    "filtered better": Case(
        tail=1 / 2, head=1 / 4, tail_rank=1 / 2, head_rank=1 / 4, filtered=frozenset({(0, 0, 1)})
    ),
    "filtered answer stays": Case(
        tail=1 / 2, head=1 / 4, tail_rank=1 / 3, head_rank=1 / 4, filtered=frozenset({QUERY})
    ),
    # tail: R_P = 1 + 1 + 1/2 beside R_G = 2
    "tie counts half": Case(
        tail=2 / 3, head=1 / 4, tail_rank=2 / 5, head_rank=1 / 4, values=(1, 4, 2, 2)
    ),
    # tail: 2 is interchangeable, R_P = 2 = R_G; but it counts for the plain rank
    "equal counts": Case(
        tail=1, head=1 / 4, tail_rank=1 / 3, head_rank=1 / 4, counts=(((0, 0, 2), 3),)
    ),
    # tail: R_G = 1, R_P = 2; head: R_P = 3
    "fewer candidates": Case(
        tail=1 / 2, head=1 / 3, tail_rank=1 / 2, head_rank=1 / 3, candidates=(0, 2, 3)
    ),
    # the answers are no candidates: tail R_G = 1 = R_P without competitors, head R_P = 1
    "answer always stays": Case(tail=1, head=1, tail_rank=1, head_rank=1, candidates=()),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_mrr_star_by_hand(case: Case) -> None:
    found = measure(
        COUNTS | dict(case.counts),
        scalar([*case.values], [1, 2]),
        [QUERY],
        case.filtered,
        case.candidates,
    )
    star, plain = (case.tail + case.head) / 2, (case.tail_rank + case.head_rank) / 2
    halves = [((entity + 1 / 2) / 2, entity, 1 / 2) for entity in (star, plain)]
    assert found == pytest.approx([*halves[0], *halves[1]])


@pytest.mark.parametrize("value", [0.0, 1e-25, 1.0, -3.0])
def test_embedding_without_opinion_by_hand(value: float) -> None:
    # tail: R_P = 1 + 3/2 beside R_G = 2; head: the same beside R_G = 1; relation: R_P = 3/2 beside
    # R_G = 1
    entity = (1 / 1.5 + 1 / 2.5) / 2
    found = measure(COUNTS, scalar([value] * 4, [value] * 2), [QUERY])
    assert found == pytest.approx(
        [(entity + 1 / 1.5) / 2, entity, 1 / 1.5, (1 / 2.5 + 1 / 1.5) / 2, 1 / 2.5, 1 / 1.5]
    )


def test_queries_ranked_in_pieces_give_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    points, embedding = (
        points_of(random_graph(13, 3, 300), 2, [0, 1]),
        random_embedding(2, 13, 3, 8),
    )
    given = points.session(1), points.novel_ids, points.insert_mask
    whole = evaluate(embedding, query_sets(*given))
    monkeypatch.setattr("isi.evaluation.ranks.BUDGET", 2 * 2 * 13 * 3)  # three queries at a time
    pieces = query_sets(*given)
    assert pieces["novel"].rows is None
    for name, result in evaluate(embedding, pieces).items():
        assert torch.equal(result.measures.nan_to_num(-1), whole[name].measures.nan_to_num(-1))


@pytest.mark.parametrize("dimension", [1, 5, 7, 8])
@pytest.mark.parametrize("model", [DistMult(), TransE(margin=1.0)])
def test_measures_are_the_same_whatever_the_stack(model: Model, dimension: int) -> None:
    """The number of queries is that of the seed with most of them, so it changes, too."""
    graph, seeds = random_graph(13, 3, 80), [0, 1, 2]
    embedding = random_embedding(3, 13, 3, dimension, model=model)
    together = evaluate(embedding, validation(points_of(graph, 2, seeds).session(1)))["valid"]
    for place, seed in enumerate(seeds):
        session = points_of(graph, 2, [seed]).session(1)
        alone = evaluate(select(embedding, torch.tensor([place])), validation(session))["valid"]
        assert torch.equal(alone.measures[0], together.measures[place])
