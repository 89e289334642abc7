"""Entities hidden from PyKEEN's training: their insert triples, their queries,
and the ranks of answers.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
import yaml

from isi.config import check
from isi.errors import InputError
from isi.experiment.grid import GridPoints
from isi.extras.hidden_entities import (
    HIDDEN_ENTITIES,
    Hidden,
    HiddenSplit,
    hide,
    seconds_path,
    study_of,
)
from isi.tables import paths
from tests.beyond_entries import HIDDEN, ROOT, TRAINING, copy_pipelines, list_entries
from tests.small_graphs import random_graph

ENTITIES, RELATIONS = 30, 3
GRAPH = random_graph(ENTITIES, RELATIONS, 200)


def settings_of(**changed: Any) -> Hidden:
    return check(HIDDEN | changed, Hidden, "hidden.ring")


@pytest.fixture(scope="module")
def triples() -> np.ndarray:
    return GRAPH.triples.numpy()


def hidden(triples: np.ndarray, seed: int = 0, **changed: Any) -> HiddenSplit:
    return hide(triples, ENTITIES, settings_of(**changed), "hidden.ring", 0, seed)


def as_set(triples: np.ndarray) -> set[tuple[int, ...]]:
    return set(map(tuple, triples.tolist()))


@pytest.mark.parametrize("seed", range(5))
def test_triples_are_known_inserted_or_queried_or_between_hidden_entities(
    triples: np.ndarray, seed: int
) -> None:
    drawn = hidden(triples, seed)
    assert drawn.known == 27
    assert sorted(drawn.order) == list(range(ENTITIES))
    back = drawn.true.copy()
    back[:, [0, 2]] = drawn.order[drawn.true[:, [0, 2]]]
    assert np.array_equal(back, triples)
    parts = [as_set(part) for part in (drawn.triples, drawn.rest, drawn.queries)]
    both = as_set(drawn.true[(drawn.true[:, [0, 2]] >= drawn.known).all(1)])
    assert sum(map(len, parts)) + len(both) == len(triples)
    assert set().union(*parts, both) == as_set(drawn.true)
    assert (drawn.triples[:, [0, 2]] < drawn.known).all()
    assert {*drawn.triples[:, [0, 2]].flatten()} == {*range(27)}
    assert {*drawn.triples[:, 1]} == {*range(RELATIONS)}
    for row in range(27, ENTITIES):
        inserted, queried = (
            (part[:, [0, 2]] == row).any(1).sum() for part in (drawn.rest, drawn.queries)
        )
        assert inserted + queried >= 4
        assert queried == max(1, (inserted + queried) // 4)


def test_fewer_insert_triples_are_the_first_of_the_others_and_a_seed_hides_the_same(
    triples: np.ndarray,
) -> None:
    drawn, again, other = hidden(triples), hidden(triples), hidden(triples, 1)
    assert np.array_equal(drawn.rest, again.rest)
    assert not np.array_equal(drawn.order, other.order)
    single, three, everything = (drawn.insert_triples(number) for number in (1, 3, None))
    assert as_set(single) < as_set(three) < as_set(everything) == as_set(drawn.rest)
    for number, inserted in ((1, single), (3, three)):
        assert [(inserted[:, [0, 2]] == row).any(1).sum() for row in range(27, ENTITIES)] == [
            number
        ] * 3


def test_no_relation_and_no_entity_is_left_without_triples(triples: np.ndarray) -> None:
    """Only 0 and 1 have relation 3, and the only neighbour of 29 is 2:
    so 0, 1 and 2 are not hidden.
    """
    others = triples[(triples[:, [0, 2]] != 29).all(1)]
    tied = np.concatenate([others, [[0, 3, 1], [29, 0, 2]]])
    for seed in range(10):
        drawn = hidden(tied, seed, fraction=0.3)
        assert not {0, 1, 2, 29} & {*drawn.order[drawn.known :]}


def test_a_share_that_leaves_too_few_triples_is_refused(triples: np.ndarray) -> None:
    with pytest.raises(
        InputError, match=r"^beyond/params\.yaml: hidden\.ring\.fraction: expected a lower share"
    ):
        hidden(triples, fraction=0.9)


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({"fewest": 1}, "fewest: "),
        ({"initializers": ["best"]}, "initializers: expected names among "),
        ({"epoch": 1}, "epoch: unknown key; did you mean 'epochs'?"),
    ],
)
def test_what_a_study_cannot_have_is_refused(wrong: dict[str, Any], line: str) -> None:
    with pytest.raises(InputError) as refused:
        study_of({"ring": HIDDEN | wrong}, "ring")
    assert str(refused.value).startswith(f"beyond/params.yaml: hidden.ring.{line}")


# With PyKEEN


def test_each_method_answers_and_pykeens_own_vectors_depend_on_no_insert_triple() -> None:
    pytest.importorskip("pykeen")
    from isi.extras.hidden_in_pykeen import hidden_in

    words = np.random.default_rng(1).standard_normal((ENTITIES, 5)).astype(np.float32)
    points = GridPoints("ring", GRAPH, 0, [0], np.zeros((1, 0)), np.zeros((1, 0, 0)))
    answers, seconds = hidden_in(points, words, settings_of(), "hidden.ring", 0)
    methods = ["insert", "mean", "own", "insert_new_rows", "own_new_rows", "own_all_rows"]
    before = answers[answers["method"] == "nothing"]
    assert list(before["asked"]) == ["earlier"]
    for number in (1.0, 3.0, None):
        rows = answers[answers["told"].isna() if number is None else answers["told"] == number]
        expected = methods + ["retrained"] * (number is None)
        inserted = rows.loc[rows["method"] != "nothing", "method"]
        assert list(inserted) == [name for name in expected for _ in range(3)]
    assert answers.loc[answers["method"] == "insert", "initializer"].notna().all()
    assert answers["mrr"].between(0, 1).all()
    assert (seconds["seconds"] > 0).all()
    assert len(answers[answers["method"] == "own"].drop(columns="told").drop_duplicates()) == 3


def test_ranks_are_those_among_all_entities_less_other_true_answers(triples: np.ndarray) -> None:
    pytest.importorskip("pykeen")
    from isi.extras.hidden_in_pykeen import factory_of, measured, untrained

    drawn, expected = hidden(triples), {}
    factory = factory_of(drawn.true, [f"e{row}" for row in range(ENTITIES)], ["a", "b", "c"])
    model = untrained(factory, settings_of().training, 3).eval()
    true, valid = as_set(drawn.true), drawn.triples[::5]
    for head, relation, tail in np.concatenate([drawn.queries, valid]).tolist():
        for slot in (0, 2):
            rivals = np.array([[head, relation, tail]] * ENTITIES)
            rivals[:, slot] = range(ENTITIES)
            scores = model.score_hrt(torch.from_numpy(rivals))[:, 0].detach().numpy()
            answer = scores[(head, relation, tail)[slot]]
            wrong = [
                score
                for rival, score in zip(rivals.tolist(), scores, strict=True)
                if tuple(rival) not in true
            ]
            rank = 1 + sum(score > answer for score in wrong)
            new = [end >= drawn.known for end in (head, tail)]
            name = "earlier" if not any(new) else "hidden" if new[slot // 2] else "known"
            expected.setdefault(name, []).append(rank)
    for row in measured(model, drawn, valid):
        ranks = np.array(expected[row["asked"]])
        assert row["queries"] == len(ranks)
        assert row["mrr"] == pytest.approx((1 / ranks).mean(), abs=1e-6)
        assert row["hits_at_10"] == pytest.approx((ranks <= 10).mean(), abs=1e-6)


def test_the_stage_writes_the_same_with_any_number_of_workers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pykeen")
    from stages.insert_hidden import insert_hidden as hide_stage

    monkeypatch.chdir(tmp_path)
    copy_pipelines(tmp_path)
    training = TRAINING | {"batch_size": 512}
    few = {"seeds": 2, "max_insert_triples": [None], "epochs": 1, "training": training}
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


def test_a_shipped_table_of_triples_is_a_graph() -> None:
    pytest.importorskip("pykeen")
    from stages.insert_hidden import of_table

    graph, names = of_table("codex_s")
    assert (len(names), len(graph.relations), len(graph.triples)) == (2034, 42, 36543)
    listed = pd.read_csv(ROOT / "data/raw/codex_s/triples.csv")
    for place, slot, labels in (
        (0, "head", names),
        (1, "relation", graph.relations),
        (2, "tail", names),
    ):
        assert [labels[row] for row in graph.triples[:, place].tolist()] == listed[slot].tolist()


@pytest.mark.parametrize(
    "wrong", [{"model": "complexx"}, {"loss": "softplush"}, {"loss_options": {"bias": 1.0}}]
)
def test_a_model_loss_or_option_that_pykeen_lacks_is_named(wrong: dict[str, Any]) -> None:
    pytest.importorskip("pykeen")
    from isi.extras.hidden_in_pykeen import hidden_in

    points = GridPoints("ring", GRAPH, 0, [0], np.zeros((1, 0)), np.zeros((1, 0, 0)))
    (place,) = wrong
    with pytest.raises(InputError, match=rf"hidden\.ring\.training\.{place}: "):
        hidden_in(points, None, settings_of(training=TRAINING | wrong), "hidden.ring", 0)


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
