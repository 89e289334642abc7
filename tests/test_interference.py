"""``Inserted.interference``: ranks of known answers without and with the new entities,
by hand and one by one.
"""

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import assume, given
from hypothesis import strategies as st

import isi
from isi.errors import InputError
from isi.insertion.interference import RankChange
from isi.insertion.result import Inserted
from tests.small_embedding import KNOWN_TRIPLES, LINE, call, on_a_line
from tests.small_graphs import random_embedding

#: Entities before a row of insertions; before its last one; relations.
OLD, FIRST, RELATIONS = 7, 9, 2
ends, labels = st.integers(0, OLD - 1), st.integers(0, RELATIONS - 1)
among_old = st.lists(st.tuples(ends, labels, ends), min_size=1, max_size=8)

TIE = 1e-3  #: Scores that are nearer may count as a tie.


def test_interference_by_hand() -> None:
    """Sorted scores of (?, 0, 1): 3·2, 2·2, 1·2, 0.5·2, -4·2; sorted scores of (0, 0, ?):
    3, 2, 1, 0.5, -4.
    """
    measured = on_a_line().interference([(0, 0, 1)])
    assert (measured.queries, measured.above, measured.changes) == (2, [0.0], [])
    assert (measured.rank_old, measured.rank_cur) == (2.5, 2.5)  # 3rd as head, 2nd as tail
    assert measured.h_old == measured.h_cur == pytest.approx((1 / 3 + 1 / 2) / 2)
    # heads by 2: -4 last; tails by -4: -4, 0.5 before 1, 2, 3
    lowest = on_a_line().interference([(3, 0, 1)])
    assert lowest.above == [0.5]  # 4 ranks above 1 as a tail; as a head it is a true answer
    assert (lowest.rank_old, lowest.rank_cur) == ((4 + 3) / 2, (4 + 4) / 2)
    assert (lowest.h_old, lowest.h_cur) == pytest.approx(((1 / 4 + 1 / 3) / 2, 1 / 4))
    assert lowest.changes == [RankChange((3, 0, "?"), 1, 3.0, 4.0, 4)]


def test_the_largest_fall_of_a_reciprocal_rank_comes_first() -> None:
    done = on_a_line([(4, 0, 0)])
    tail, head = RankChange((3, 0, "?"), 1, 3.0, 4.0, 4), RankChange(("?", 0, 1), 3, 4.0, 5.0, 4)
    assert done.interference([(3, 0, 1)]).changes == [tail, head]
    assert done.interference([(3, 0, 1)], show=1).changes == [tail]
    assert done.interference([(3, 0, 1)], show=0).changes == []
    names = {"entity_names": ["a", "b", "c", "d"], "relation_names": ["in"]}
    named = isi.insert(
        **LINE, **names, triples=[("new", "in", "a")], new=["new"], initializer="mean"
    )
    assert named.interference([("d", "in", "b")], show=1).changes == [
        RankChange(("d", "in", "?"), "b", 3.0, 4.0, "new")
    ]


def test_an_answer_that_ties_with_a_new_entity_loses_half_a_rank() -> None:
    # at 2, as entity 1
    done = isi.insert(**LINE, triples=[(4, 0, 1)], new=1, initializer="er_avg")
    measured = done.interference([(1, 0, 0)])  # tails by 2: 3, 2, 2, 1, -4
    assert measured.changes == [
        RankChange(("?", 0, 0), 1, 2.0, 2.5, 4),
        RankChange((1, 0, "?"), 0, 3.0, 4.0, 4),
    ]


def test_interference_queries_the_known_triples_or_a_sample(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done = call()
    assert done.interference().queries == 2 * len(KNOWN_TRIPLES)
    assert done.interference(most=2).queries == 4
    assert done.interference(most=2) == done.interference(most=2)
    with pytest.raises(
        InputError, match="expected triples of known entities, which give the queries"
    ):
        call(known_triples=None).interference()
    at_once = done.interference()
    two_queries = 2 * 2 * len(done.entities)
    monkeypatch.setattr("isi.evaluation.ranks.BUDGET", two_queries)
    assert done.interference() == at_once


# A row of insertions


def test_queries_about_later_entities_are_refused_in_a_row_of_insertions() -> None:
    given: dict[str, Any] = {**LINE, "new": 1, "initializer": "mean"}
    first = isi.insert(**given, triples=[(4, 0, 0)])
    second = isi.insert(**given | {"entities": first.entities}, triples=[(5, 0, 0)])
    assert second.interference([(4, 0, 0)]).queries == 2
    with pytest.raises(InputError, match="triples"):
        second.interference([(4, 0, 0)], original=4)


def last_of_a_row(
    seed: int, model: str, known: list[tuple[int, int, int]], linked: int
) -> Inserted:
    """The result for the last entity of three, of which each has one triple,
    with random vectors for all.
    """
    stack = random_embedding(1, FIRST, RELATIONS, 8, seed)
    earlier = [(OLD, 0, linked), (linked, 1, FIRST - 1)]
    return isi.insert(
        stack.entity[0].numpy(),
        stack.relation[0].numpy(),
        [(FIRST, 1, linked)],
        new=1,
        model=model,
        model_options={"margin": 1.0} if model == "transe_l1" else None,
        known_triples=[*known, *earlier],
        initializer="xavier",
        seed=seed,
    )


def rank(
    done: Inserted, true: set[tuple[int, ...]], triple: tuple[int, ...], slot: int, candidates: int
) -> tuple[int, list[int]]:
    """The filtered rank of an answer among the first entities, and those above it;
    each candidate is scored alone.
    """

    def score(end: int) -> float:
        ids = [
            torch.tensor([[end if place == slot else value]]) for place, value in enumerate(triple)
        ]
        return float(done.details.embedding.score(*ids))

    others = [
        end for end in range(candidates) if (*triple[:slot], end, *triple[slot + 1 :]) not in true
    ]
    apart = [score(end) - score(triple[slot]) for end in others]
    assume(all(abs(each) > TIE or not each for each in apart))
    above = [end for end, each in zip(others, apart, strict=True) if each > 0]
    return 1 + len(above), above


@pytest.mark.parametrize("original", [None, OLD])
@pytest.mark.parametrize("model", ["complex", "transe_l1"])
@given(seed=st.integers(0, 99), known=among_old, held_out=st.none() | among_old, linked=ends)
def test_ranks_are_those_of_candidates_scored_one_by_one(
    model: str, original: Any, seed: int, known: list[Any], held_out: list[Any] | None, linked: int
) -> None:
    done, old = last_of_a_row(seed, model, known, linked), original or FIRST
    measured = done.interference(held_out, original=original, show=100)
    listed, added = (
        [tuple(row) for row in part.tolist()]
        for part in (done.details.known_triples, done.details.insert_triples)
    )
    queried = dict.fromkeys(listed if held_out is None else held_out)
    queries = [
        (triple, slot) for slot in (0, 2) for triple in queried if max(triple[0], triple[2]) < old
    ]
    true = {*queried, *listed, *added}
    before = [rank(done, true, *query, old)[0] for query in queries]
    after, above = zip(*(rank(done, true, *query, FIRST + 1) for query in queries), strict=True)
    assert measured.queries == len(queries)
    assert (measured.rank_old, measured.rank_cur) == pytest.approx(
        (np.mean(before), np.mean(after))
    )
    assert (measured.h_old, measured.h_cur) == pytest.approx(
        (np.mean(1 / np.array(before)), np.mean(1 / np.array(after)))
    )
    share = [np.mean([new in ids for ids in above]) for new in range(old, FIRST + 1)]
    assert measured.above == pytest.approx(share)
    assert measured.rank_cur - measured.rank_old == pytest.approx(sum(measured.above))
    changes = {
        (change.query, change.answer): (change.rank_old, change.rank_cur)
        for change in measured.changes
    }
    fallen = {
        ((*triple[:slot], "?", *triple[slot + 1 :]), triple[slot]): (one, other)
        for (triple, slot), one, other in zip(queries, before, after, strict=True)
        if other > one
    }
    assert changes == fallen
    falls = [1 / change.rank_old - 1 / change.rank_cur for change in measured.changes]
    assert falls == sorted(falls, reverse=True)
