"""The one rule of ranks: by hand, at the edge of a tie, and against plain loops."""

import math
from typing import get_args

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from isi.evaluation import ranks
from isi.evaluation.ranks import TIE, Ties, ahead, compare_with, parts, scores_of, wins
from tests.plain_ranks import plain_rank

RULES: tuple[Ties, ...] = get_args(Ties)
numbers = st.integers(-3, 3).map(float)


@pytest.mark.parametrize("ties", RULES)
@pytest.mark.parametrize(("gap", "halves"), [(9e-6, 1), (-9e-6, 1), (2e-5, 2), (-2e-5, 0)])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_scores_within_a_hundred_thousandth_of_the_largest_are_tied(
    gap: float, halves: int, scale: float, ties: Ties
) -> None:
    scores = torch.tensor([0.25, 0.25 + gap, -1.0]) * scale
    assert wins(scores, scores[0], ties).tolist() == [1, halves, 0]
    above, not_below = compare_with(scores, scores[0], ties)
    assert above.tolist() == [False, halves == 2, False]
    assert not_below.tolist() == [True, halves > 0, False]


@pytest.mark.parametrize("ties", RULES)
def test_the_answer_counts_for_the_tolerance_and_others_need_not_compete(ties: Ties) -> None:
    near = torch.tensor([1.0 + 5e-6])
    assert wins(near, torch.tensor(1.0), ties).tolist() == [1]
    far = torch.tensor([1.0 + 5e-5, -100.0])
    assert wins(far, torch.tensor(1.0), ties).tolist() == [1, 0]
    assert ahead(far, torch.tensor(1.0), torch.tensor([True, False])).item() == 0.5
    assert wins(far[:1], torch.tensor(1.0), ties).tolist() == [2]
    assert wins(torch.tensor([99.9999]), torch.tensor(100.0), ties).tolist() == [1]


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("ties", RULES)
def test_scores_of_a_diverged_model_are_tied_with_all(ties: Ties, value: float) -> None:
    assert wins(torch.full((3,), value), torch.tensor(value), ties).tolist() == [1, 1, 1]
    assert wins(torch.tensor([1.0, value]), torch.tensor(1.0), ties).tolist() == [1, 1]


def test_the_two_rules_differ_only_where_rounding_decides() -> None:
    generator = torch.Generator().manual_seed(0)
    scores = torch.randn(300, 4000, generator=generator)
    answer = scores[:, 0]
    bounds, gap = (wins(scores, answer, ties) for ties in RULES)
    tie = TIE * scores.abs().amax(-1, keepdim=True)
    from_edge = ((scores.double() - answer.double()[:, None]).abs() - tie).abs()
    rounding = torch.finfo(torch.float32).eps * scores.abs().amax(-1, keepdim=True)
    assert torch.equal(bounds[from_edge > rounding], gap[from_edge > rounding])


@st.composite
def queries(draw: st.DrawFn) -> tuple[Tensor, Tensor, Tensor]:
    """Scores of a stack of queries, (2, Q, C), the places of answers, and who competes."""
    count, candidates = draw(st.integers(0, 3)), draw(st.integers(1, 6))
    size = 2 * count * candidates
    scores = torch.tensor(draw(st.lists(numbers, min_size=size, max_size=size)))
    mask = torch.tensor(draw(st.lists(st.booleans(), min_size=size, max_size=size)))
    place = st.integers(0, candidates - 1)
    answer = torch.tensor(draw(st.lists(place, min_size=2 * count, max_size=2 * count)))
    shape = (2, count, candidates)
    return scores.view(shape), answer.long().view(shape[:2]), mask.bool().view(shape)


@given(queries())
def test_ranks_are_those_of_plain_loops(given_queries: tuple[Tensor, Tensor, Tensor]) -> None:
    scores, answer, competes = given_queries
    of_answer = scores_of(answer, scores)
    expected = [
        plain_rank(row[mask].tolist(), row[place].item()) - 1
        for row, place, mask in zip(
            scores.flatten(0, 1), answer.flatten(), competes.flatten(0, 1), strict=True
        )
    ]
    assert ahead(scores, of_answer, competes).flatten().tolist() == expected
    assert torch.equal(wins(scores, of_answer, "gap"), wins(scores, of_answer, "bounds"))


def test_parts_fit_into_the_budget_or_are_one_query(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ranks, "BUDGET", 10)
    ids = torch.arange(8).view(2, 4)
    assert [part.tolist() for part in parts(ids, 3, 1)] == [[[0, 1, 2], [4, 5, 6]], [[3], [7]]]
    assert [len(part) for part in parts(ids, 11)] == [1, 1]
