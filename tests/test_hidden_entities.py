"""Entities that are hidden from PyKEEN's training: what is hidden, told and asked, and what the answers' ranks are."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

from isi.analyses.hidden_entities import HIDDEN_ENTITIES, Hidden, HiddenSplit, hide, seconds_path
from isi.config import check
from isi.errors import InputError
from isi.experiment.grid import GridPoints
from isi.graph.graph import Graph
from isi.tables import paths
from tests.beyond_entries import HIDDEN, ROOT, copy_pipelines, list_entries

ENTITIES, RELATIONS = 30, 3


def settings_of(**changed: Any) -> Hidden:
    return check(HIDDEN | changed, Hidden, "hidden.ring")


@pytest.fixture(scope="module")
def triples() -> np.ndarray:
    """A ring with every relation, and random triples."""
    rng = np.random.default_rng(0)
    ring = {(e, e % RELATIONS, (e + 1) % ENTITIES) for e in range(ENTITIES)}
    drawn = {tuple(row) for row in rng.integers((ENTITIES, RELATIONS, ENTITIES), size=(200, 3)).tolist()}
    return np.array(sorted(ring | drawn))


def hidden(triples: np.ndarray, seed: int = 0, **changed: Any) -> HiddenSplit:
    return hide(triples, ENTITIES, settings_of(**changed), "hidden.ring", 0, seed)


def as_set(triples: np.ndarray) -> set[tuple[int, ...]]:
    return set(map(tuple, triples.tolist()))


@pytest.mark.parametrize("seed", range(5))
def test_triples_are_known_inserted_or_queried_or_between_hidden_entities(triples: np.ndarray, seed: int) -> None:
    found = hidden(triples, seed)
    assert found.known == 27
    assert sorted(found.order) == list(range(ENTITIES))
    back = found.true.copy()
    back[:, [0, 2]] = found.order[found.true[:, [0, 2]]]
    assert np.array_equal(back, triples)
    parts = [as_set(part) for part in (found.triples, found.rest, found.queries)]
    both = as_set(found.true[(found.true[:, [0, 2]] >= found.known).all(1)])
    assert sum(map(len, parts)) + len(both) == len(triples)
    assert set().union(*parts, both) == as_set(found.true)
    assert (found.triples[:, [0, 2]] < found.known).all()
    assert {*found.triples[:, [0, 2]].flatten()} == {*range(27)}
    assert {*found.triples[:, 1]} == {*range(RELATIONS)}
    for row in range(27, ENTITIES):
        told, asked = ((part[:, [0, 2]] == row).any(1).sum() for part in (found.rest, found.queries))
        assert told + asked >= 4
        assert asked == max(1, (told + asked) // 4)


def test_fewer_insert_triples_are_the_first_of_the_others_and_a_seed_hides_the_same(triples: np.ndarray) -> None:
    found, again, other = hidden(triples), hidden(triples), hidden(triples, 1)
    assert np.array_equal(found.rest, again.rest)
    assert not np.array_equal(found.order, other.order)
    one, three, everything = (found.insert_triples(number) for number in (1, 3, None))
    assert as_set(one) < as_set(three) < as_set(everything) == as_set(found.rest)
    for number, told in ((1, one), (3, three)):
        assert [(told[:, [0, 2]] == row).any(1).sum() for row in range(27, ENTITIES)] == [number] * 3


def test_no_relation_and_no_entity_is_left_without_triples(triples: np.ndarray) -> None:
    """Only 0 and 1 have relation 3, and 29's only neighbour is 2: none of these three is hidden."""
    own = triples[(triples[:, [0, 2]] != 29).all(1)]
    own = np.concatenate([own, [[0, 3, 1], [29, 0, 2]]])
    for seed in range(10):
        found = hidden(own, seed, fraction=0.3)
        assert not {0, 1, 2, 29} & {*found.order[found.known :]}


def test_a_share_that_leaves_too_few_triples_is_refused(triples: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"^beyond/params\.yaml: hidden\.ring\.fraction: expected a lower share"):
        hidden(triples, fraction=0.9)


# With PyKEEN


@pytest.fixture(scope="module")
def points(triples: np.ndarray) -> GridPoints:
    names = [f"e{row}" for row in range(ENTITIES)]
    counts, kinds = torch.ones(len(triples), dtype=torch.int64), torch.zeros(ENTITIES, dtype=torch.int64)
    graph = Graph(names, ["r0", "r1", "r2"], torch.from_numpy(triples), counts, kinds)
    return GridPoints("ring", graph, 0, [0], np.zeros((1, 0)), np.zeros((1, 0, 0)))


def test_each_method_answers_and_what_knows_the_same_knows_the_same(points: GridPoints) -> None:
    pytest.importorskip("pykeen")
    from isi.analyses.hidden_in_pykeen import hidden_in

    words = np.random.default_rng(1).standard_normal((ENTITIES, 5)).astype(np.float32)
    (answers, seconds), (again, _) = (hidden_in(points, words, settings_of(), "hidden.ring", 0) for _ in range(2))
    assert answers.equals(again)
    first = ["insert", "mean", "own", "insert_new_rows", "own_new_rows", "own_all_rows"]
    for told in (1.0, 3.0, None):
        of = answers[answers["told"].isna() if told is None else answers["told"] == told]
        listed = first + ["retrained"] * (told is None)
        assert list(of["method"]) == [name for name in listed for _ in range(3)]
    assert {*answers.loc[answers["method"] == "insert", "initializer"]} == {"map_soft_hybrid"}
    assert answers["mrr"].between(0, 1).all()
    assert (seconds["seconds"] > 0).all()
    untold = answers[answers["method"].isin(["own"])].drop(columns="told").drop_duplicates()
    assert len(untold) == 3  # PyKEEN's own vectors do not depend on what is told


def test_ranks_are_those_among_all_entities_less_other_true_answers(triples: np.ndarray) -> None:
    pytest.importorskip("pykeen")
    from isi.analyses.hidden_in_pykeen import factory_of, measured, untrained

    found, asked = hidden(triples), {}
    factory = factory_of(found.true, [f"e{row}" for row in range(ENTITIES)], ["a", "b", "c"])
    model = untrained(factory, settings_of().training, 3).eval()
    true, valid = as_set(found.true), found.triples[::5]
    for head, relation, tail in np.concatenate([found.queries, valid]).tolist():
        for slot in (0, 2):
            rivals = np.array([[head, relation, tail]] * ENTITIES)
            rivals[:, slot] = range(ENTITIES)
            scores = model.score_hrt(torch.from_numpy(rivals))[:, 0].detach().numpy()
            own = scores[(head, relation, tail)[slot]]
            wrong = [score for rival, score in zip(rivals.tolist(), scores, strict=True) if tuple(rival) not in true]
            rank = 1 + sum(score > own for score in wrong)
            new = [end >= found.known for end in (head, tail)]
            name = "earlier" if not any(new) else "hidden" if new[slot // 2] else "known"
            asked.setdefault(name, []).append(rank)
    for row in measured(model, found, valid):
        ranks = np.array(asked[row["asked"]])
        assert row["queries"] == len(ranks)
        assert row["mrr"] == pytest.approx((1 / ranks).mean(), abs=1e-6)
        assert row["hits_at_10"] == pytest.approx((ranks <= 10).mean(), abs=1e-6)


def test_the_stage_writes_the_same_with_any_number_of_workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pykeen")
    from stages.insert_hidden import insert_hidden as hide_stage

    monkeypatch.chdir(tmp_path)
    copy_pipelines(tmp_path)
    list_entries(hidden={"nations": HIDDEN | {"seeds": 2, "max_insert_triples": [None]}})
    params, written = yaml.safe_load((ROOT / paths.PARAMS).read_text(encoding="utf-8")), []
    for workers in (1, 2):
        paths.PARAMS.write_text(yaml.safe_dump(params | {"compute": params["compute"] | {"workers": workers}}))
        monkeypatch.setattr(sys, "argv", ["insert_hidden", "nations"])
        hide_stage()
        written.append(HIDDEN_ENTITIES.path(graph="nations").read_bytes())
    assert written[0] == written[1]
    found = HIDDEN_ENTITIES.read(graph="nations")
    assert set(found["entities"]) == {1}
    assert set(found["seed"]) == {0, 1}
    took = json.loads(seconds_path("nations").read_text(encoding="utf-8"))
    assert {row["method"] for row in took} == {"known", *found["method"]}
