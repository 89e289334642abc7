"""A small embedding of random vectors, a home of it, and a comparison of two homes."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from isi.home import choosing
from isi.home.bundle import Fact
from isi.home.home import Home
from isi.home.inserted import Choice, Key
from isi.home.loaded import LoadedEmbedding
from isi.insertion.engine import Method
from isi.insertion.hidden import HoldOut
from isi.insertion.selection import named
from tests.small_bundle import random_bundle

KINDS = ["object", "place"]
KNOWN = replace(random_bundle(90), words=None, kinds=[KINDS[number % 2] for number in range(30)])
TRAINED = KNOWN.named_triples()
#: Vectors of inserted entities by name; then, by query, what is said of each answer.
Seen = tuple[dict[str, np.ndarray], dict[tuple[str, ...], dict[str, tuple[Any, ...]]]]
CHOICES: dict[Key, Choice] = {}  # of ``KNOWN``


def _selected(test: HoldOut, has_facts: bool, *_: Any, **__: Any) -> tuple[Method, None]:
    entities = test.theta0.entity.shape[1]
    return named("map" if has_facts else "mean", {}, test.theta0.model, entities), None


_choose = choosing.choose


def _remembered(base: LoadedEmbedding, key: Key, selected: Choice | None = None) -> Choice:
    if key not in CHOICES:
        CHOICES[key] = _choose(base, key, selected)
    return CHOICES[key]


@contextmanager
def quick_choices(of_known: bool = False) -> Iterator[None]:
    """Initializers are not compared, which takes seconds: MAP, or the mean without facts.

    ``of_known``: all homes inside are of ``KNOWN``, so that curves are fitted once.
    """
    choose = _remembered if of_known else _choose
    with patch.object(choosing, "select", _selected), patch.object(choosing, "choose", choose):
        yield


def facts_of(home: Home) -> dict[Fact, tuple[int, float | None]]:
    """The count and the confidence of each fact that holds."""
    return {row.fact: (row.count, row.confidence) for row in home.facts()}


def seen(home: Home) -> Seen:
    """The vectors of the inserted entities, and the answers about them and some known ones."""
    vectors = {name: row.vector for name, row in home.inserted.items()}
    queries: list[tuple[str | None, str | None, str | None]] = [("e0", "in", None)]
    queries += [(None, "on", "e2"), *(("e0", None, name) for name in vectors)]
    for name in vectors:
        queries += [(name, "in", None), (None, "on", name)]
    answers = {}
    for query in queries:
        answers[tuple(map(str, query))] = {
            best.entity: (best.score, best.probability, best.given, best.known, best.inserted)
            for best in home.ask(*query, top=99).answers
        }
    return vectors, answers


def assert_same(one: Seen, other: Seen) -> None:
    (vectors, answers), (others, expected) = one, other
    assert vectors.keys() == others.keys()
    for name, vector in vectors.items():
        np.testing.assert_allclose(vector, others[name], rtol=0, atol=1e-6)
    assert answers.keys() == expected.keys()
    for query, found in answers.items():
        assert found.keys() == expected[query].keys(), query
        for entity, (*numbers, given, known, inserted) in found.items():
            *numbers_there, given_there, known_there, inserted_there = expected[query][entity]
            assert numbers == pytest.approx(numbers_there, abs=2e-5)
            assert (given, known, inserted) == (given_there, known_there, inserted_there)
