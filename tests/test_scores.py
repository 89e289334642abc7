"""Scores with NumPy alone are those of the models, which PyTorch computes."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isi.errors import InputError
from isi.home.loaded import LoadedEmbedding
from isi.insertion.arguments import checked_model
from isi.models.arrays import SCALARS, TRANSLATIONS, ArrayScores, ModelScores
from tests.small_bundle import opened, small

MARGINS = {"transe": 2.0, "transe_l1": 8.0, "rotate": 4.0}


@st.composite
def embeddings(draw: st.DrawFn) -> LoadedEmbedding:
    """Six entities and two relations with random vectors, of any model."""
    name = draw(st.sampled_from([*SCALARS, *TRANSLATIONS]))
    options: dict[str, Any] = {"margin": MARGINS[name]} if name in MARGINS else {}
    if name in ("transe", "rotate"):
        options["squared"] = draw(st.booleans())
    dimension = 4 * draw(st.integers(1, 6))
    width = checked_model(name, options, dimension).width(dimension)
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    size = draw(st.sampled_from([0.01, 1.0, 3.0]))
    tables = {"entities": (6, dimension), "relations": (2, width)}
    vectors = {key: size * random.normal(size=shape) for key, shape in tables.items()}
    if draw(st.booleans()):
        vectors["entities"][1] = vectors["entities"][0]
    manifest = small().manifest.model_copy(update={"model_name": name, "model_options": options})
    floats = draw(st.sampled_from([np.float32, np.float64]))
    return opened(
        manifest=manifest, **{key: table.astype(floats) for key, table in vectors.items()}
    )


@given(embeddings(), st.integers(0, 5), st.integers(0, 5), st.integers(0, 1))
def test_both_ways_of_scoring_agree_for_every_model(
    embedding: LoadedEmbedding, head: int, tail: int, relation: int
) -> None:
    fast, model = embedding.scores, ModelScores(embedding.embedding)
    assert isinstance(fast, ArrayScores)
    ends = np.array([head, tail])
    near = {"rtol": 1e-5, "atol": 1e-5 * max(1.0, float(np.abs(model.tails(ends, relation)).max()))}
    np.testing.assert_allclose(fast.tails(ends, relation), model.tails(ends, relation), **near)
    np.testing.assert_allclose(fast.heads(ends, relation), model.heads(ends, relation), **near)
    np.testing.assert_allclose(fast.relations(head, tail), model.relations(head, tail), **near)


@pytest.mark.parametrize(
    ("name", "options", "dimension", "width"),
    [
        ("distmult", {}, 4, 3),
        ("complex", {}, 3, 3),
        ("rotate", {"margin": 4.0}, 4, 4),
        ("transe", {}, 4, 4),
        ("transe", {"margin": "far"}, 4, 4),
        ("distmult", {"margin": 1.0}, 4, 4),
        ("distmult", {"rank": 2}, 4, 4),
    ],
)
def test_tables_and_options_that_are_none_of_the_model_are_refused(
    name: str, options: dict[str, Any], dimension: int, width: int
) -> None:
    about = {"model_name": name, "model_options": options}
    embedding = opened(
        manifest=small().manifest.model_copy(update=about),
        entities=np.ones((6, dimension), np.float32),
        relations=np.ones((2, width), np.float32),
    )
    with pytest.raises(InputError):
        _ = embedding.scores
