"""Shares of queries that faults of protocols touch: published counts, and plain loops."""

from functools import cache

import numpy as np
import pandas as pd
import pytest
from hypothesis import given

from isi.continual import Timeline, fault_shares
from tests.small_timelines import known_facts, timelines

UNFILTERED, ENTITIES, FACTS, VALIDATED = (
    "validation facts unfiltered",
    "later entities",
    "later facts",
    "validated on test",
)
#: Percent of the queries of each test set, with the number of its decimals, as printed in reviews
#: of the protocols, which counted them in the published files.
SHARES: list[tuple[str, str, int, list[float]]] = [
    ("ENTITY", UNFILTERED, 1, [58.4, 62.8, 62.5, 65.3, 69.5]),
    ("ENTITY", ENTITIES, 1, [73.5, 68.2, 58.0, 46.1, 0]),
    ("ENTITY", FACTS, 1, [0, 0, 0, 0, 0]),
    ("RELATION", FACTS, 1, [0, 0, 0, 0, 0]),
    ("FACT", ENTITIES, 1, [38.5, 30.4, 22.9, 13.0, 0]),
    ("FACT", FACTS, 1, [60.6, 62.4, 63.2, 60.6, 0]),
    ("GraphEqual", ENTITIES, 1, [78.9, 69.6, 54.4, 31.8, 0]),
    ("GraphEqual", FACTS, 0, [0, 67, 67, 63, 0]),
]
#: Percent: the least and the greatest of the test sets.
RANGES = {
    ("FACT", UNFILTERED): (36, 89),
    ("GraphEqual", UNFILTERED): (61, 68),
    ("HYBRID", FACTS): (0, 26),
}


@cache
def of_benchmark(name: str) -> pd.DataFrame:
    return fault_shares(Timeline.benchmark(name)).set_index("fault")


@pytest.mark.parametrize(("name", "fault", "digits", "expected"), SHARES)
def test_shares_are_the_published_ones(
    name: str, fault: str, digits: int, expected: list[float]
) -> None:
    shares = 100 * of_benchmark(name).loc[fault, "share"]
    assert shares.round(digits).tolist() == expected


@pytest.mark.parametrize(("name", "fault"), RANGES)
def test_shares_span_the_published_range(name: str, fault: str) -> None:
    shares = (100 * of_benchmark(name).loc[fault, "share"]).round()
    assert (shares.min(), shares.max()) == RANGES[name, fault]


def test_numbers_of_answers_are_the_published_ones() -> None:
    answers = of_benchmark("ENTITY")["answers"].round(1)
    assert answers.loc[ENTITIES].tolist() == [170.4, 98.4, 55.4, 24.3, 0]
    unfiltered = answers.loc[UNFILTERED]
    assert (unfiltered.min(), unfiltered.max()) == (9.3, 34.7)


@pytest.mark.parametrize("name", ["ENTITY", "FBinc-L"])
def test_no_test_triple_of_a_benchmark_is_a_validation_triple(name: str) -> None:
    assert (of_benchmark(name).loc[VALIDATED, "share"] == 1).all()


@given(timelines())
def test_answers_are_those_of_plain_loops(timeline: Timeline) -> None:
    last = len(timeline.snapshots) - 1
    everything = known_facts(timeline, last, ("train", "valid", "test"))
    table = fault_shares(timeline).set_index(["fault", "test"])
    for j, snapshot in enumerate(timeline.snapshots):
        read = known_facts(timeline, j, ("train", "test"))
        known = known_facts(timeline, j, ("train", "valid", "test"))
        numbers: dict[str, list[int]] = {UNFILTERED: [], ENTITIES: [], FACTS: []}
        for triple in snapshot.test.tolist():
            for slot in (0, 2):
                rest = [other for other in everything if alike(other, triple, slot)]
                later = [other[slot] for other in rest if other not in known]
                old = [entity < timeline.entities[j] for entity in later]
                unread = [other for other in rest if other in known and other not in read]
                numbers[UNFILTERED].append(len(unread))
                numbers[ENTITIES].append(len(old) - sum(old))
                numbers[FACTS].append(sum(old))
        for fault, counted in numbers.items():
            got = table.loc[(fault, j)]
            assert got["queries"] == len(counted)
            if counted:
                assert got["answers"] == pytest.approx(np.mean(counted))
                assert got["share"] == pytest.approx(np.mean(np.array(counted) > 0))


def alike(triple: tuple[int, ...], other: list[int], slot: int) -> bool:
    """Whether two triples agree outside a slot."""
    return all(triple[place] == other[place] for place in range(3) if place != slot)
