"""The report of an insertion, and new rows after further training, by hand."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

import isi
from isi.models.bilinear import DistMult
from tests.small_embedding import (
    BETWEEN,
    ENTITIES,
    KNOWN_TRIPLES,
    LINE,
    call,
    on_a_line,
)
from tests.small_graphs import random_embedding


def test_the_nearest_known_and_the_distance_from_their_cloud() -> None:
    (own,) = on_a_line().report(nearest=3)
    assert sorted(own.nearest) == [(0, 1.0), (1, 1.0), (2, 1.0)]  # of the same sign
    assert own.distance == 0  # the mean, in deviations
    assert own.farther_than == 0
    assert (own.insert_triples, own.between, own.fallback) == (1, 0, None)
    far = isi.insert(**LINE, triples=[(4, 0, 3)], new=1, initializer="er_avg").report()[0]
    assert far.distance == pytest.approx(4.5 / np.std([1, 2, 3, -4]))
    assert far.farther_than == 0.75  # -4 itself lies as far


def test_a_result_shows_itself_in_five_lines_and_its_report_as_a_frame() -> None:
    shown = repr(call(initializer="mean")).splitlines()
    assert len(shown) <= 5
    assert all(len(line) <= 120 for line in shown)
    for text in (
        "2 new",
        "12 known",
        "3 triples",
        "cup, mug",
        "mean, as named",
        "nearest to cup: ",
    ):
        assert text in "\n".join(shown)
    done = on_a_line()
    (own,), frame = done.report(nearest=2), pd.DataFrame(done.report(nearest=2))
    assert frame.to_dict("records") == [vars(own)]
    assert (
        len(
            repr(
                isi.insert(
                    np.ones((30, 2)),
                    np.ones((1, 2)),
                    [],
                    new=100,
                    model="distmult",
                    initializer="mean",
                )
            )
        )
        < 500
    )


@pytest.mark.parametrize("apart", [0.0, 2e-6])  # a few steps of single precision
def test_coordinates_in_which_all_known_are_the_same_count_for_no_distance(apart: float) -> None:
    known = np.array([[1, 7], [2, 7], [3, 7], [-4, 7 + apart]])
    given: dict[str, Any] = {
        "model": "distmult",
        "triples": [(4, 0, 1)],
        "new": 1,
        "initializer": "xavier",
    }
    done = isi.insert(known, np.ones((1, 2)), **given)
    own = done.report()[0].distance
    assert own == pytest.approx(abs(done.entities[4, 0] - 0.5) / np.std([1, 2, 3, -4]), rel=1e-5)
    (same,) = isi.insert(
        np.ones((3, 2)), np.ones((1, 2)), **(given | {"triples": [(3, 0, 1)]})
    ).report()
    assert same.distance == 0


def test_transe_with_the_norm_of_city_blocks() -> None:
    entities = np.array([[1.0, 2.0], [0.0, 0.0], [-1.0, 3.0]], np.float32)
    options: dict[str, Any] = {"new": 1, "model": "transe_l1", "model_options": {"margin": 4.0}}
    triples, relations = [(0, 0, 3), (1, 1, 3)], np.array([[1.0, -1.0], [2.0, 1.0]], np.float32)
    done = isi.insert(entities, relations, triples, initializer="er_avg", **options)
    np.testing.assert_array_equal(done.entities[3], [2.0, 1.0])  # where both put it
    stack = done.details.embedding
    assert stack.score(
        torch.tensor([[0, 2]]), torch.tensor([[0, 1]]), torch.tensor([[3, 3]])
    ).tolist() == [[4.0, 0.0]]
    learned = done.train(epochs=5)
    assert learned.entities[:3].tobytes() == entities.tobytes()
    assert (learned.vectors != done.vectors).any()


@dataclass(frozen=True)
class Short(DistMult):
    """A user's model: no coordinate of a new entity is above a fifth."""

    def constrain(self, vectors: torch.Tensor) -> torch.Tensor:
        return vectors.clamp(-0.2, 0.2)


@pytest.mark.parametrize("initializer", ["mean", "map", None])
def test_a_constraint_of_a_users_own_holds_for_new_rows(initializer: str | None) -> None:
    """Every function that computes new rows keeps them under the constraint, as the hidden ones."""
    wide = random_embedding(1, ENTITIES, len(BETWEEN), 4)
    given = {
        "entities": (9 * wide.entity[0]).clamp(-0.5, 0.5).numpy(),
        "relations": 9 * wide.relation[0].numpy(),
    }
    model, known = Short(), list(KNOWN_TRIPLES)
    done = call(**given, model=model, initializer=initializer, known_triples=known)
    new = torch.from_numpy(done.entities[ENTITIES:])
    assert torch.equal(model.constrain(new), new)
    if initializer == "map":
        free = call(**given, model=DistMult(), initializer="map")
        assert (np.abs(free.entities[ENTITIES:]) > 0.2).any()
    made = done.details
    hidden = made.test.hide()
    if hidden is not None:
        inserted = hidden.insert(made.method.initializer, made.options)
        assert inserted is not None
        assert torch.equal(model.constrain(inserted[1]), inserted[1])
    fitted = done.train(epochs=50)
    rows = torch.from_numpy(fitted.vectors)
    assert torch.equal(model.constrain(rows), rows)
    assert fitted.entities[:ENTITIES].tobytes() == done.entities[:ENTITIES].tobytes()
