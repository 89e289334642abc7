"""A small live embedding of random vectors, with its choices of initializers,
and a comparison of two of them.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from isi.live.journal import Change, Selected

from isi.live.embedding import LiveEmbedding
from isi.live.groups import PREPARED
from tests.small_bundle import random_bundle

KINDS = ["object", "place"]
KNOWN = replace(random_bundle(90), words=None, kinds=[KINDS[number % 2] for number in range(30)])
Answers = dict[tuple[str, ...], dict[str, tuple[Any, ...]]]


CURVES: dict[Any, Any] = {}  # of known entities; the same for all objects


@cache
def chosen() -> list[Change | Selected]:
    """The choices of initializers, made once."""
    made = LiveEmbedding(KNOWN)
    return [made.groups.selected_for(number, False) for number in PREPARED]


def live_of(changes: Sequence[Change] = ()) -> LiveEmbedding:
    """The small bundle, with the choices and some changes."""
    live = LiveEmbedding(KNOWN, [*chosen(), *changes])
    live.groups._curves = CURVES
    return live


def seen(live: LiveEmbedding) -> tuple[dict[str, np.ndarray], Answers]:
    """The vectors of the inserted entities, and the answers about them
    and about some known ones.
    """
    vectors = {name: row.vector for name, row in live.inserted.items()}
    queries: list[tuple[str | None, str | None, str | None]] = [
        (name, "in", None) for name in [*vectors, "e0", "e1"]
    ]
    queries += [(None, "on", name) for name in [*vectors, "e2"]] + [
        ("e0", None, name) for name in vectors
    ]
    answers = {
        tuple(map(str, query)): {
            answer.entity: (
                answer.score,
                answer.probability,
                answer.given,
                answer.known,
                answer.inserted,
            )
            for answer in live.ask(*query, top=99).answers
        }
        for query in queries
    }
    return vectors, answers


def assert_same(
    one: tuple[dict[str, np.ndarray], Answers], other: tuple[dict[str, np.ndarray], Answers]
) -> None:
    (vectors, answers), (others, expected) = one, other
    assert vectors.keys() == others.keys()
    for name, vector in vectors.items():
        np.testing.assert_allclose(vector, others[name], rtol=0, atol=1e-6)
    assert answers.keys() == expected.keys()
    for query, found in answers.items():
        assert found.keys() == expected[query].keys(), query
        for entity, (score, probability, *marks) in found.items():
            score_there, probability_there, *marks_there = expected[query][entity]
            assert score == pytest.approx(score_there, abs=2e-5)
            assert probability == pytest.approx(probability_there, abs=2e-5)
            assert marks == marks_there
