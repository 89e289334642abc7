"""What ``isi.insert`` says of mistakes: one line that names the argument and the place in it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from isi.base.errors import InputError
from tests.test_insert import KNOWN, TOLD, call, tables, words

NAN = np.float32("nan")


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (
            {"triples": [("cup", "under", "e1")]},
            "'triples': triple 0: relation: expected one of 'relation_names' or of 'new', got 'under'",
        ),
        (
            {"triples": [("cup", "in", "kup")]},
            "'triples': triple 0: tail: expected one of 'entity_names' or of 'new', got 'kup'",
        ),
        ({"triples": [(14, 0, 1)]}, "'triples': triple 0: head: expected an id from 0 to 13, got 14"),
        (
            {"triples": np.array([[12, 0, 1], [13, 3, 1]])},
            "'triples': triple 1: relation: expected an id from 0 to 2, got 3",
        ),
        ({"triples": np.array([[12, 0, -1]])}, "'triples': triple 0: tail: expected an id from 0 to 13, got -1"),
        ({"triples": [("cup", "in")]}, "'triples': triple 0: expected head, relation and tail, got ('cup', 'in')"),
        ({"triples": [("cup", "in", True)]}, "'triples': triple 0: tail: expected a name or an id, got True"),
        (
            {"triples": [*TOLD, ("e1", "in", "e2")]},
            "'triples': (e1, in, e2): expected a new entity in it: triples of known ones are 'known_triples'",
        ),
        ({"known_triples": TOLD[:1]}, "'known_triples': (cup, in, e1): expected known entities alone"),
        ({"new": ["cup", "e3"]}, "'entity_names': 'e3': expected names that do not repeat"),
        ({"new": ["cup", "cup"]}, "'entity_names': 'cup': expected names that do not repeat"),
        ({"new": 2}, "'new': expected names where 'entity_names' are given, else a number"),
        ({"entity_names": [*KNOWN[1:], 7]}, "'entity_names': expected texts, got 7"),
        ({"seed": -1}, "'seed': Input should be greater than or equal to 0, got -1"),
        ({"new": []}, "'new': expected at least one new entity"),
        ({"new": "cup"}, "'new': expected a list of names, got one text"),
        ({"entity_names": KNOWN[1:]}, "'entity_names': expected 12 names, got 11"),
        ({"relation_names": ["in", "in", "on"]}, "'relation_names': 'in': expected names that do not repeat"),
        ({"relation_names": ["in"]}, "'relation_names': expected 3 names, got 1"),
        (
            {"triples": TOLD[:2]},
            "new entity 'mug': expected a triple with a known entity, or a word vector, or an initializer "
            "that needs neither",
        ),
        (
            {"triples": [("cup", "in", "e1"), ("cup", "in", "mug")]},
            "new entity 'mug': expected a triple with a known entity, or a word vector, or an initializer "
            "that needs neither",
        ),
        (
            {"triples": TOLD[:2], "words": {"mug": [1.0], "cup": [2.0]}},  # of which no known entity has one
            "new entity 'mug': expected a triple with a known entity, or a word vector, or an initializer "
            "that needs neither",
        ),
        (
            {"entities": np.where(np.eye(12, 8) == 1, NAN, tables()["entities"])},
            "'entities': row 0: expected finite numbers, got NaN or infinity",
        ),
        (
            {"relations": np.full((3, 8), np.float32("inf"))},
            "'relations': row 0: expected finite numbers, got NaN or infinity",
        ),
        ({"relations": tables()["relations"][:, :4]}, "'relations': expected rows of 8 numbers, got rows of 4"),
        (
            {"entities": tables()["entities"][:, :6]},
            "'family': dimension 6: expected a multiple of 4, as ANALOGY needs",
        ),
        (
            {"entities": tables()["entities"].astype(int)},
            "'entities': expected a table of floats (rows, numbers), got int64 (12, 8)",
        ),
        (
            {"entities": tables()["entities"] + 1j},
            "'entities': expected real numbers: of complex vectors the real halves, then the imaginary ones",
        ),
        (
            {"entities": tables()["entities"][0]},
            "'entities': expected a table of floats (rows, numbers), got float32 (8,)",
        ),
        ({"words": words()[:, :1] * NAN}, "'words': row 0: expected finite numbers, got NaN or infinity"),
        (
            {"entities": tables()["entities"] * np.float32(1e30), "initializer": "map_mean"},
            "'entities': expected smaller numbers: of these, map_mean makes NaN or infinity",
        ),
        (
            {"entities": tables()["entities"].astype(float) * 1e300, "initializer": "mean"},
            "'entities': expected smaller numbers: of these, mean makes NaN or infinity",
        ),
        (
            {"entities": np.ones((12, 8), np.float32)},
            "'entities': expected known vectors that differ, whose covariance map_mean goes by",
        ),
        ({"words": words().astype(float) * 1e300}, "'words': row 0: expected finite numbers, got NaN or infinity"),
        ({"words": words()[1:]}, "'words': expected 14 rows, of known and new entities, got 13"),
        ({"words": {"cup": [1, 2], "mug": [1]}}, "'words': 'mug': expected a vector of 2 numbers, got (1,)"),
        (
            {"words": {"cup": "a cup"}},
            "'words': expected vectors, or the argument 'word_source' that makes vectors of texts",
        ),
        (
            {"words": {"cup": "a cup"}, "word_source": 3},
            "'word_source': expected a function, gensim's KeyedVectors or a file of such, got 3",
        ),
        ({"words": {"kup": [1.0]}}, "'words': expected one of 'entity_names' or of 'new', got 'kup'"),
        ({"kinds": ["a"]}, "'kinds': expected 14 kinds, of known and new entities, got 1"),
        ({"initializer": "er"}, "'initializer': expected one of "),
        (
            {"initializer": "es", "options": {"k": 0}},
            "'initializer': k: Input should be greater than or equal to 1, got 0",
        ),
        ({"initializer": "mean", "options": {"k": 1}}, "'initializer': k: "),
        ({"family": "transe"}, "'family': margin: Field required"),
        ({"family": "transformer"}, "'family': expected one of "),
    ],
)
def test_a_mistake_is_one_line(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError) as refused:
        call(**wrong)
    assert str(refused.value).removeprefix("argument ").startswith(said)
    assert "\n" not in str(refused.value)


def test_a_report_and_an_interference_of_too_few_are_refused() -> None:
    done = call()
    with pytest.raises(InputError, match=r"argument 'nearest'.* greater than or equal to 0, got -1"):
        done.report(-1)
    for most in (0, -1):
        with pytest.raises(InputError, match=r"argument 'most'.* greater than or equal to 1"):
            done.interference(most=most)
