"""Ranks of test sets under all protocols: by hand, by plain loops, and by ``end_ranks``."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from isi.continual import PROTOCOLS, Timeline, evaluate, pooled, query_ranks
from isi.errors import InputError
from isi.evaluation.filtered import end_ranks
from isi.insertion.inverses import InverseRelations
from isi.models.model import make_model
from isi.models.stack import Embedding
from tests.small_graphs import graph_of
from tests.small_timelines import ranks_by_loops, timelines, whole_numbers

#: Entities in order: cup, hall, attic, den; then mug, loft.
GROWN = Timeline.of(
    [
        ([("cup", "in", "hall")], [("cup", "in", "attic")], [("cup", "in", "den")]),
        ([("mug", "in", "loft")], [("cup", "in", "loft")], [("cup", "in", "mug")]),
    ]
)
#: (cup, in, e) scores 1, 5, 4, 2, 3.5, 3.
THETA = Embedding(
    torch.tensor([[[1.0], [5.0], [4.0], [2.0], [3.5], [3.0]]]),
    torch.ones(1, 1, 1),
    make_model("distmult", {}, "model"),
)


def test_protocols_differ_in_candidates_and_filter_as_they_say() -> None:
    ranks = query_ranks(THETA, GROWN, 1, tests=[0])
    tail = ranks[ranks["slot"] == "tail"].iloc[0]
    assert tail["answer"] == "old"
    assert {name: tail[name] for name in PROTOCOLS} == {
        "lkge": 2,  # attic is ahead: valid.txt is not read
        "incde": 1,  # hall and attic are right
        "revisiting": 3,  # mug and loft are ahead, though right since snapshot 1
        "current": 1,  # all of them are right
        "old": 1,
    }


def test_measures_are_means_over_queries() -> None:
    frame = evaluate(THETA, GROWN, 1, tests=[0], protocols=["revisiting"])
    tail = frame[frame["slot"] == "tail"].iloc[0]
    assert tail[["queries", "mrr", "hits@1", "hits@3"]].tolist() == [1, pytest.approx(1 / 3), 0, 1]
    # as head of den, the cup has the lowest score of six
    assert pooled(frame)["mrr"].item() == pytest.approx((1 / 3 + 1 / 6) / 2)


@settings(max_examples=60, deadline=None)
@given(timelines(), st.integers(0, 2), st.integers(0, 3))
def test_ranks_are_those_of_plain_loops(timeline: Timeline, last: int, seed: int) -> None:
    i = min(last, len(timeline.snapshots) - 1)
    theta = whole_numbers(timeline, i, seed)
    ranks = query_ranks(theta, timeline, i)
    for protocol in PROTOCOLS:
        expected = [*ranks_by_loops(theta, timeline, i, protocol)]
        got = [None if np.isnan(rank) else rank for rank in ranks[protocol]]
        assert got == expected, protocol


def large() -> Timeline:
    """Two snapshots of 40 entities and 240 random triples."""
    rng = np.random.default_rng(0)
    names = [f"e{number}" for number in range(40)]
    drawn = {tuple(row) for row in rng.integers((40, 3, 40), size=(240, 3)).tolist()}
    triples = [(names[head], f"r{relation}", names[tail]) for head, relation, tail in drawn]
    return Timeline.of([(triples[0:60], triples[60:80], triples[80:120]), (triples[120:], [], [])])


MODELS = {"complex": {}, "transe": {"margin": 1.0}, "rotate": {"margin": 1.0}, "inverse": {}}


@pytest.mark.parametrize("name", MODELS)
def test_ranks_of_the_current_protocol_are_those_of_end_ranks(name: str) -> None:
    timeline = large()
    plain = make_model("distmult" if name == "inverse" else name, MODELS[name], "model")
    model = InverseRelations(plain) if name == "inverse" else plain
    generator = torch.Generator().manual_seed(1)
    theta = Embedding(
        torch.randn(1, len(timeline.entity_names), 4, generator=generator),
        torch.randn(1, 3, model.width(4), generator=generator),
        model,
    )
    triples = np.concatenate([snapshot.triples for snapshot in timeline.snapshots])
    graph = graph_of(dict.fromkeys(map(tuple, triples.tolist()), 1), len(timeline.entity_names), 3)
    rows = torch.arange(80, 120)
    assert np.array_equal(triples[80:120], timeline.snapshots[0].test)
    expected = end_ranks(theta, graph, rows).flatten().tolist()
    ranks = query_ranks(theta, timeline, 1, tests=[0], protocols=["current"])
    assert ranks["current"].tolist() == expected


def test_ranks_in_batches_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    timeline = large()
    theta = whole_numbers(timeline, 1)
    whole = query_ranks(theta, timeline, 1)
    monkeypatch.setattr("isi.evaluation.ranks.BUDGET", 600)  # 7 triples
    assert query_ranks(theta, timeline, 1).equals(whole)


def test_further_rows_are_ignored_and_a_sample_is_a_part() -> None:
    timeline = large()
    theta = whole_numbers(timeline, 0)
    more = Embedding(
        torch.cat([theta.entity, torch.full((1, 9, 2), 100.0)], 1), theta.relation, theta.model
    )
    whole = query_ranks(theta, timeline, 0)
    assert query_ranks(more, timeline, 0).equals(whole)
    sample = query_ranks(theta, timeline, 0, most=10)
    assert len(sample) == 20
    assert len(sample.merge(whole)) == 20
    assert sample.equals(query_ranks(theta, timeline, 0, most=10))


def test_equal_scores_and_nan_are_at_chance() -> None:
    timeline = Timeline.of([([("a", "r", "b"), ("c", "r", "d")], [], [("a", "r", "e")])])
    for number in (1.0, float("nan")):
        theta = Embedding(
            torch.full((1, 5, 2), number), torch.ones(1, 1, 2), make_model("distmult", {}, "model")
        )
        ranks = query_ranks(theta, timeline, 0, protocols=["incde"])
        # of the head: four other candidates; of the tail: b is right, too
        assert ranks["incde"].tolist() == [3.0, 2.5]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"i": 2}, "argument 'i': expected a snapshot from 0 to 1, got 2"),
        ({"tests": [1]}, "argument 'tests': expected snapshots from 0 to 0, got 1"),
        ({"protocols": ["lgke"]}, "argument 'protocols': expected names of lkge, .*got 'lgke'"),
        ({"i": 1}, "argument 'theta': expected a stack of one with 6 entities or more, got"),
    ],
)
def test_wrong_arguments_are_named(changed: dict[str, object], message: str) -> None:
    theta = whole_numbers(GROWN, 0)
    with pytest.raises(InputError, match=message):
        query_ranks(theta, GROWN, **{"i": 0, **changed})  # type: ignore[arg-type]
