"""The paper's rule for the indicator set size, against values by hand."""

import pytest

from stages.report.tables.method import select_size

LEVEL = [0.6] * 6


@pytest.mark.parametrize(
    ("epochs", "picked"),
    [
        # means over three, from the second size on: 22, 17, 15 1/3, 15
        ([30, 20, 16, 15, 15, 15], 4),
        ([9, 9, 9, 9, 9, 9], 2),  # nothing gained
        ([1, 2, 3, 4, 5, 6], 2),
        ([10, 9, 8, 7, 6, 5], 5),  # exactly 1 each time; the last size has no mean
        ([12, 12, 12, 0, 0, 0], 5),  # 12, 8, 4, 0: one large fall is shared by three means
    ],
)
def test_the_set_grows_while_three_neighbours_gain_an_epoch(
    epochs: list[float], picked: int
) -> None:
    assert select_size([1, 2, 3, 4, 5, 6], LEVEL, epochs) == picked


@pytest.mark.parametrize(
    ("mrr_star", "picked"),
    [
        ([0.60, 0.62, 0.615, 0.605, 0.62, 0.62], 3),  # 4 is 1.5 points below 2
        ([0.30, 0.40, 0.50, 0.60, 0.70, 0.80], 5),  # larger values at larger sizes have no effect
        ([0.60, 0.55, 0.60, 0.60, 0.60, 0.60], 1),
        # within a point all the way; the last has no part in it
        ([0.60, 0.62, 0.615, 0.612, 0.613, 0.2], 5),
    ],
)
def test_it_stops_before_mrr_star_is_a_point_below_the_best(
    mrr_star: list[float], picked: int
) -> None:
    assert select_size([1, 2, 3, 4, 5, 6], mrr_star, [60, 50, 40, 30, 20, 10]) == picked


@pytest.mark.parametrize(
    ("sizes", "epochs", "picked"),
    [([1, 4, 10, 30], [30.0, 20, 10, 0], 10), ([3], [9.0], 3), ([3, 5], [9.0, 9], 3)],
)
def test_neighbours_are_those_of_the_list_and_too_few_give_the_first(
    sizes: list[int], epochs: list[float], picked: int
) -> None:
    assert select_size(sizes, [0.6] * len(sizes), epochs) == picked
