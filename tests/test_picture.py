"""The picture of the method shows one insertion of the run as it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isi.report import picture
from isi.report.explorer import Explored, starts_at
from isi.report.page import Page
from tests.reports import small_results, svg_alone
from tests.small_explorer import NAMES, scores, small

OPTIONS = {"es": {"k": 3}, "xavier": {}}


@pytest.fixture(scope="module")
def run() -> Explored:
    return small()[0]


def test_the_indicators_are_the_most_alike_names_that_are_known(run: Explored) -> None:
    drawn = picture.picture(run, OPTIONS)
    assert drawn
    entity = starts_at(run.points)
    words = run.words.astype(float)
    trained = run.points.session(0).trained()[0].numpy()
    cosines = {
        name: float(words[place] @ words[entity])
        / float(np.linalg.norm(words[place]) * np.linalg.norm(words[entity]))
        for place, name in enumerate(NAMES)
        if trained[place] and words[place].any()
    }
    best = sorted(cosines, key=lambda name: -cosines[name])
    assert [row["name"] for row in drawn["alike"]] == best[:5]
    assert [row["cosine"] for row in drawn["alike"]] == pytest.approx(
        [cosines[name] for name in best[:5]]
    )
    assert [row["chosen"] for row in drawn["alike"]] == [True] * 3 + [False] * 2
    assert {one["name"] for one in drawn["map"]["indicators"]} == set(best[:3])


def test_answers_are_the_best_from_the_mean_of_the_indicators(run: Explored) -> None:
    drawn = picture.picture(run, OPTIONS)
    assert drawn
    points, entity = run.points, starts_at(run.points)
    chosen = [NAMES.index(one["name"]) for one in drawn["map"]["indicators"]]
    table = run.theta0.entity.clone()
    table[0, entity] = table[0, chosen].mean(0)
    ranked = scores(replace(run.theta0, entity=table), entity)[:, 0]
    known = points.session(0).entities[0].numpy()
    assert drawn["questions"]
    for question in drawn["questions"]:
        relation = points.graph.relations.index(question.relation)
        order = [one for one in (-ranked[relation]).argsort() if known[one]]
        triples = points.graph.triples.tolist()
        assert question.ours == [
            (NAMES[one], [entity, relation, int(one)] in triples) for one in order[:4]
        ]
        assert len(question.random) == 4


def test_the_map_has_the_centre_of_the_indicators_in_its_middle(run: Explored) -> None:
    drawn = picture.picture(run, OPTIONS)
    assert drawn
    places = np.array([one["at"] for one in drawn["map"]["indicators"]])
    assert places.mean(0) == pytest.approx(drawn["map"]["centre"], abs=0.1)


def test_the_random_start_has_the_median_answers_of_its_draws(
    run: Explored, monkeypatch: pytest.MonkeyPatch
) -> None:
    qualities, shown = dict[int, float](), list[picture.Start]()
    start_of, question_of = picture._start, picture._question

    def start(*of: Any) -> picture.Start:
        made, truth = start_of(*of), of[-1]
        ranks = [rank for one, answers in truth.items() for rank in made.ranks(one, answers)]
        qualities[id(made)] = float(np.mean(1 / np.array(ranks)))
        shown.append(made)  # keeps its id
        return made

    def question(*of: Any) -> picture.Question:
        assert qualities[id(of[-1])] == sorted(map(qualities.get, map(id, shown[1:])))[24]
        return question_of(*of)

    monkeypatch.setattr(picture, "_start", start)
    monkeypatch.setattr(picture, "_question", question)
    assert picture.picture(run, OPTIONS)
    assert len(shown) == 1 + 50  # ours, then the draws


def test_without_words_or_the_initializer_there_is_no_picture(
    run: Explored, tmp_path: Path
) -> None:
    assert picture.picture(run, {"xavier": {}}) is None
    silent = replace(run, words=np.zeros_like(run.words))
    assert picture.picture(silent, OPTIONS) is None
    with svg_alone():
        Page.of("report").write(tmp_path, small_results(["home"], studies=False))
    assert 'id="picture"' not in (tmp_path / "index.html").read_text("utf-8")
