"""The study of entities hidden from PyKEEN's training: its methods and its stage."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from isi.benchmark.study import HIDDEN_ENTITIES, Hidden, seconds_path
from isi.config import check
from isi.errors import InputError
from isi.experiment.grid import GridPoints
from isi.tables import paths
from tests.beyond_entries import HIDDEN, ROOT, TRAINING, copy_pipelines, list_entries
from tests.small_graphs import random_graph

#: Cross-entropy over all entities, with inverse triples.
CROSS_ENTROPY = TRAINING | {
    "model_options": {"entity_initializer": "xavier_uniform"},
    "loss": "crossentropy",
    "loop": "lcwa",
    "negatives": None,
    "inverse_triples": True,
}
#: The same by ``isi.training.rows``.
ROWS = CROSS_ENTROPY | {"loop": "rows", "negatives": 8, "n3": 0.005, "learning_rate": 0.1}
ENTITIES, RELATIONS = 30, 3
GRAPH = random_graph(ENTITIES, RELATIONS, 200)
POINTS = GridPoints("ring", GRAPH, 0, [0], np.zeros((1, 0)), np.zeros((1, 0, 0)))


def settings_of(**changed: Any) -> Hidden:
    return check(HIDDEN | changed, Hidden, "hidden.ring")


def test_a_share_that_leaves_too_few_triples_is_refused_at_its_key() -> None:
    pytest.importorskip("pykeen")
    from isi.benchmark.in_pykeen import hidden

    with pytest.raises(
        InputError, match=r"^beyond/params\.yaml: hidden\.ring\.fraction: expected fewer hidden"
    ):
        hidden(GRAPH, settings_of(fraction=0.9), "hidden.ring", 0, 0)


# With PyKEEN


@pytest.mark.parametrize(
    ("training", "trained_with"),
    [(TRAINING, "logistic"), (CROSS_ENTROPY, "softmax"), (ROWS, "softmax")],
)
def test_each_method_answers_and_pykeens_own_vectors_depend_on_no_insert_triple(
    training: dict[str, Any], trained_with: str
) -> None:
    pytest.importorskip("pykeen")
    from isi.benchmark.in_pykeen import hidden_in

    words = np.random.default_rng(1).standard_normal((ENTITIES, 5)).astype(np.float32)
    settings = settings_of(training=training)
    answers, seconds = hidden_in(POINTS, words, settings, "hidden.ring", 0)
    methods = ["insert", "mean", "own", "insert_new_rows", "own_new_rows"]
    before = answers[answers["method"] == "nothing"]
    assert list(before["asked"]) == ["earlier"]
    for number in (1.0, 3.0, None):
        rows = answers[answers["told"].isna() if number is None else answers["told"] == number]
        expected = [*methods, "own_all_rows", "retrained"] if number is None else methods
        inserted = rows.loc[rows["method"] != "nothing", "method"]
        assert list(inserted) == [name for name in expected for _ in range(3)]
    assert answers.loc[answers["method"] == "insert", "initializer"].notna().all()
    assert answers["mrr"].between(0, 1).all()
    default = answers["method"] == "insert"
    assert set(answers.loc[default, "trained_with"]) == {trained_with}
    estimated = answers["estimated_loss"].notna()
    assert (estimated == (default & (answers["asked"] == "earlier"))).all()
    assert (seconds["seconds"] > 0).all()
    assert len(answers[answers["method"] == "own"].drop(columns="told").drop_duplicates()) == 3


def test_a_large_graph_can_leave_out_the_training_of_all_rows() -> None:
    pytest.importorskip("pykeen")
    from isi.benchmark.in_pykeen import hidden_in

    for retrain in (False, True):
        settings = settings_of(train_all_rows=False, retrain=retrain, max_insert_triples=[None])
        answers, seconds = hidden_in(POINTS, None, settings, "hidden.ring", 0)
        expected = {"retrained"} if retrain else set()
        for table in (answers, seconds):
            assert {"own_all_rows", "retrained"} & set(table["method"]) == expected


def test_insertion_gets_the_validation_triples_and_no_test_triple(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("pykeen")
    from isi.benchmark import HiddenSplit, in_pykeen

    given, queried, trained_on = list[set[Any]](), list[set[Any]](), list[set[Any]]()
    insert, evaluate = in_pykeen.insert, HiddenSplit.evaluate

    def insert_spy(model: Any, factory: Any, *facts: Any, validation: Any, **options: Any) -> Any:
        given.append(set(map(tuple, validation.mapped_triples.tolist())))
        trained_on.append(set(map(tuple, factory.mapped_triples.tolist())))
        return insert(model, factory, *facts, validation=validation, **options)

    def evaluate_spy(split: HiddenSplit, model: Any, *, earlier: Any) -> Any:
        queried.append(set(map(tuple, earlier.tolist())))
        return evaluate(split, model, earlier=earlier)

    monkeypatch.setattr(in_pykeen, "insert", insert_spy)
    monkeypatch.setattr(HiddenSplit, "evaluate", evaluate_spy)
    settings = settings_of(
        training=CROSS_ENTROPY | {"optimizer": "adagrad"},
        max_insert_triples=[1],
        train_all_rows=False,
        retrain=False,
    )
    in_pykeen.hidden_in(POINTS, None, settings, "hidden.ring", 0)
    valid, test, train = given[0], queried[0], trained_on[0]
    assert all(triples == valid for triples in given)
    assert all(triples == test for triples in queried)
    assert not valid & test
    assert not (valid | test) & train
    assert len(valid) == pytest.approx(len(test), abs=1)


def test_the_stage_writes_the_same_with_any_number_of_workers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pykeen")
    from stages.insert_hidden import insert_hidden as hide_stage

    monkeypatch.chdir(tmp_path)
    copy_pipelines(tmp_path)
    training = TRAINING | {"batch_size": 512}
    few = {"seeds": 2, "max_insert_triples": [None], "epochs": 1, "training": training}
    few |= {"train_all_rows": False, "retrain": False}
    list_entries(hidden={"nations": HIDDEN | few})
    monkeypatch.setattr(sys, "argv", ["insert_hidden", "nations"])
    params, written = yaml.safe_load((ROOT / paths.PARAMS).read_text(encoding="utf-8")), []
    for workers in (1, 2):
        paths.PARAMS.write_text(
            yaml.safe_dump(params | {"compute": params["compute"] | {"workers": workers}})
        )
        hide_stage()
        written.append(HIDDEN_ENTITIES.path(study="nations").read_bytes())
    assert written[0] == written[1]
    table = HIDDEN_ENTITIES.read(study="nations")
    assert set(table["entities"]) == {1}
    assert set(table["seed"]) == {0, 1}
    seconds = json.loads(seconds_path("nations").read_text(encoding="utf-8"))
    assert {row["method"] for row in seconds} == {"known", *table["method"]} - {"nothing"}


@pytest.mark.parametrize(
    "wrong",
    [
        {"model": "complexx"},
        {"model_options": {"bias": 1.0}},
        {"model_options": {"entity_initializer": "xavier_unifrom"}},
        {"loss": "softplush"},
        {"loss_options": {"bias": 1.0}},
    ],
)
def test_a_model_loss_or_option_that_pykeen_lacks_is_named(wrong: dict[str, Any]) -> None:
    pytest.importorskip("pykeen")
    from isi.benchmark.in_pykeen import hidden_in

    (place,) = wrong
    with pytest.raises(InputError, match=rf"hidden\.ring\.training\.{place}: "):
        hidden_in(POINTS, None, settings_of(training=TRAINING | wrong), "hidden.ring", 0)


def test_a_dataset_that_pykeen_lacks_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pykeen")
    from stages.insert_hidden import insert_hidden as hide_stage

    monkeypatch.chdir(tmp_path)
    copy_pipelines(tmp_path)
    list_entries(hidden={"own": HIDDEN | {"graph": "nationss"}})
    monkeypatch.setattr(sys, "argv", ["insert_hidden", "own"])
    with pytest.raises(SystemExit, match=r"hidden\.own\.graph: .*'nations'"):
        hide_stage()
