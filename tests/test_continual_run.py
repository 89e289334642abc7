"""``isi.Timeline.run``: an embedding, trained or one's own, is carried along a timeline."""

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import isi
from isi.continual.api import GrownEmbedding, with_inverses
from isi.errors import InputError
from isi.models.model import make_model
from isi.models.stack import Embedding
from tests.documented import blocks
from tests.small_continual import write_timeline

TRAINING = {"base_epochs": 2, "epochs": 1, "batch_size": 16, "init_range": 0.3}
MODELS = [
    ("distmult", {}),
    ("complex", {}),
    ("analogy", {}),
    ("transe", {"margin": 2.0}),
    ("transe_l1", {"margin": 2.0}),
    ("rotate", {"margin": 2.0}),
]


@pytest.fixture
def timeline(tmp_path: Path) -> isi.Timeline:
    write_timeline(tmp_path / "my")
    return isi.Timeline.from_folder(tmp_path / "my")


def run(timeline: isi.Timeline, *model: Any, **arguments: Any) -> GrownEmbedding:
    given = {"initializer": "er_avg", "training": TRAINING, "dimension": 4} | arguments
    return timeline.run(*model, **given)


def tables(name: str, timeline: isi.Timeline) -> dict[str, np.ndarray]:
    """Random rows of the first snapshot's entities and relations."""
    rng = np.random.default_rng(0)
    width = make_model(name, dict(MODELS)[name], "model").width(4)
    shapes = {"entities": (timeline.entities[0], 4), "relations": (timeline.relations[0], width)}
    return {kind: rng.normal(size=shape).astype(np.float32) for kind, shape in shapes.items()}


def test_a_users_own_sequence_gives_a_matrix_costs_and_the_last_embedding(
    timeline: isi.Timeline,
) -> None:
    grown = run(timeline, "complex")
    assert grown.entities.shape == (17, 4)
    assert grown.relations.shape == (2, 8)
    assert set(grown.matrix["i"]) == {0, 1, 2}
    assert len(grown.costs) == 5
    measures = grown.measures().set_index(["measure", "protocol"])["value"]
    assert 0 < measures["mean mrr", "incde"] <= 1
    again = isi.insert(
        grown.entities,
        grown.relations,
        model=grown.model,
        entity_names=timeline.entity_names,
        relation_names=timeline.relation_names,
        triples=[("later", "r0", "e1")],
        new=["later"],
        initializer="er_avg",
    )
    assert again.entities.shape == (18, 4)


def test_the_code_of_the_page_runs_as_it_stands(
    timeline: isi.Timeline, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    left: dict[str, Any] = {}
    for block in blocks("continual.md", "python"):
        exec(compile(block, "docs/continual.md", "exec"), left)  # noqa: S102
    assert len(left["vectors"]) == len(timeline.entity_names)
    assert (tmp_path / "matrix.csv").exists()


@pytest.mark.parametrize(("name", "options"), MODELS)
def test_ones_own_arrays_keep_their_scores_and_their_rows(
    timeline: isi.Timeline, name: str, options: dict[str, Any]
) -> None:
    own = tables(name, timeline)
    model = make_model(name, options, "model")
    theta = Embedding(*(torch.from_numpy(table)[None] for table in own.values()), model)
    packed, ids = with_inverses(theta), torch.tensor([[0, 1, 2]])
    relation = torch.zeros_like(ids)
    assert torch.allclose(
        packed.score_heads(relation, ids), theta.score_heads(relation, ids), atol=1e-5
    )
    grown = run(timeline, name, model_options=options, strategy="insert", **own)
    assert np.array_equal(grown.entities[: len(own["entities"])], own["entities"])
    width = own["relations"].shape[1]
    assert np.array_equal(grown.relations[:, :width], own["relations"])


def test_names_order_ones_own_rows(timeline: isi.Timeline) -> None:
    own = tables("complex", timeline)
    number = len(own["entities"])
    order = np.random.default_rng(1).permutation(number)
    names = [timeline.entity_names[row] for row in order]
    mixed = own | {"entities": own["entities"][order], "entity_names": names}
    mixed["relation_names"] = timeline.relation_names
    plain, named = (run(timeline, "complex", strategy="insert", **given) for given in (own, mixed))
    assert np.array_equal(plain.entities, named.entities)


def test_a_pykeen_model_is_carried_along(timeline: isi.Timeline) -> None:
    pykeen = pytest.importorskip("pykeen.models")
    from pykeen.triples import TriplesFactory

    names = np.array(timeline.entity_names, object), np.array(timeline.relation_names, object)
    head, relation, tail = timeline.snapshots[0].triples.T
    labels = np.stack([names[0][head], names[1][relation], names[0][tail]], 1).astype(str)
    factory = TriplesFactory.from_labeled_triples(labels)
    model = pykeen.ComplEx(triples_factory=factory, embedding_dim=2, random_seed=0)
    grown = run(timeline, model, factory, strategy="new_rows", loss="logistic")
    assert grown.entities.shape == (17, 4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"strategy": "new_row"}, r"argument 'strategy'.*new_rows"),
        ({"strategy": "replay", "strategy_options": {"n": 1}}, r"argument 'strategy_options'.*n"),
        ({"initializer": "er_agv"}, "argument 'initializer'.*er_avg"),
        ({"training": {"epoch": 3}}, "argument 'training'.*epochs"),
        (
            {"entities": np.ones((3, 4)), "relations": np.ones((2, 4))},
            "expected 12 entities, got 3",
        ),
        ({"dimension": 0}, "argument 'dimension'"),
        ({"most": -1}, "argument 'most'"),
        ({"seed": -1}, "argument 'seed'"),
    ],
)
def test_a_wrong_argument_is_named(
    timeline: isi.Timeline, arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        run(timeline, "complex", **arguments)


FIRST = [(f"e{a}", "near", f"e{b}") for a in range(8) for b in range(8) if (a + b) % 3 == 0]
LATER = [("mug", "near", "e1"), ("mug", "near", "e2")]
#: The snapshot after ``FIRST``, and what nothing is learned of.
BARE: dict[str, tuple[Any, list[str]]] = {
    "entity of a test": ((LATER, [], [("bath tub", "near", "e2")]), ["entities.*bath tub"]),
    "entity of validation": ((LATER, [("bath tub", "near", "e2")], []), ["entities.*bath tub"]),
    "relation of a test": ((LATER, [], [("e1", "on", "e2")]), ["relations.*on"]),
    "nothing else": (([], [], [("bath tub", "on", "e2")]), ["entities.*tub", "relations.*on"]),
    "loop": (([("mug", "near", "mug")], [], [("mug", "near", "e1")]), []),
    "empty": (([], [], []), []),
}


@pytest.mark.parametrize("strategy", ["insert", "new_rows_and_earlier", "finetune", "retrain"])
@pytest.mark.parametrize("case", BARE)
def test_what_arrives_without_training_triples_is_counted(case: str, strategy: str) -> None:
    later, warned = BARE[case]
    grows = isi.Timeline.of([(FIRST, [], FIRST[:3]), later])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        grown = run(grows, initializer=None, strategy=strategy)
    texts = [str(each.message) for each in caught if "without a training" in str(each.message)]
    assert len(texts) == len(warned)
    for words, text in zip(warned, texts, strict=True):
        assert re.search(words, text)
    assert np.isfinite(grown.entities).all()
    assert np.isfinite(grown.relations).all()
    assert len(grown.measures())
    if strategy == "insert" and "bath tub" in grows.entity_names:
        row = grows.entity_names.index("bath tub")
        known = grown.entities[: grows.entities[0]]
        np.testing.assert_allclose(grown.entities[row], known.mean(0), atol=1e-6)


def test_measures_without_queries_are_no_numbers() -> None:
    grown = run(isi.Timeline.of([(FIRST, [], []), (LATER, [], [])]))
    assert grown.matrix.empty
    assert grown.measures()["value"].isna().all()


def test_a_model_needs_training_triples_of_the_first_snapshot() -> None:
    with pytest.raises(InputError, match="snapshot 0: train"):
        run(isi.Timeline.of([([], [], FIRST), (LATER, [], [])]))


def test_neighbouring_seeds_share_no_draws() -> None:
    """The second snapshot of a seed, and the third one of the seed before it."""
    more = [("jar", "near", "e1")]
    for_both = {"initializer": "xavier", "strategy": "insert"}
    grows = isi.Timeline.of([(FIRST, [], []), (LATER, [], []), (more, [], [])])
    first, second = (run(grows, seed=seed, **for_both).entities[-2:] for seed in (4, 5))
    assert not np.allclose(first[1], second[0])
