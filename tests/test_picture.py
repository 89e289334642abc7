"""The demonstration by hand: the projection, the picture, the payload, the median draw."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stages import demonstrate as demonstration
from stages.demonstrate import ANSWERS, COMPUTED, DRAWS, draws, median_draw
from stages.projection import Projection, ticks
from stages.report.explorer import TEMPLATES
from tests.small_explorer import NAMES, Shown, scores, small


@pytest.fixture(scope="module")
def shown() -> Shown:
    return small()


@pytest.fixture(scope="module")
def picture(shown: Shown) -> dict[str, Any]:
    made = demonstration.picture(shown.explored, shown.options)
    assert made
    return made


def test_the_projection_is_the_distance_from_the_mean_and_the_place_along_the_longest_axis() -> (
    None
):
    vectors = np.array([[4, 0, 1], [-2, 0, 1], [1, 2, 1], [1, -2, 1.0]])
    found = Projection.of(vectors)
    assert found.centre == pytest.approx([1, 0, 1])
    assert found.axis == pytest.approx([1, 0, 0])
    assert found.share == pytest.approx(18 / 26)
    places = found.places(np.array([[1, 0, 1], [5, 3, 1], [-3, 0, 4.0]]))
    assert places == pytest.approx(np.array([[0, 0], [5, 4], [5, -4]]))
    assert Projection.of(-vectors).axis == pytest.approx(found.axis)  # whatever the sign


def test_ticks_are_round() -> None:
    assert ticks(0, 4.1) == [0, 1, 2, 3, 4]
    assert ticks(-2.4, 0.9) == [-2, -1, 0]
    assert ticks(0.03, 0.9) == pytest.approx([0.2, 0.4, 0.6, 0.8])


def test_the_indicators_are_the_most_alike_names_that_are_known(
    shown: Shown, picture: dict[str, Any]
) -> None:
    words, entity = shown.explored.words.astype(float), shown.explored.first
    unit = words / np.maximum(np.linalg.norm(words, axis=1, keepdims=True), 1e-12)
    alike, trained = unit @ unit[entity], shown.explored.points.session(0).trained()[0].numpy()
    order = [place for place in (-alike).argsort() if trained[place] and words[place].any()][:5]
    rows = picture["alike"]
    assert [row["name"] for row in rows] == [NAMES[place] for place in order]
    assert [row["cosine"] for row in rows] == pytest.approx(alike[order])
    assert [row["chosen"] for row in rows] == [True] * 3 + [False] * 2


def test_the_picture_has_the_mean_and_the_median_draw_with_their_places_and_answers(
    shown: Shown, picture: dict[str, Any]
) -> None:
    explored, drawn, entity = shown.explored, picture["map"], shown.explored.first
    vectors, known = explored.vectors, np.flatnonzero(explored.known).tolist()
    chosen = [NAMES.index(one["name"]) for one in drawn["indicators"]]
    starts = {
        "ours": vectors[chosen].mean(0),
        "random": median_draw(explored, entity, draws(explored)),
    }
    centre = vectors[known].mean(0)
    away = np.linalg.norm(vectors - centre, axis=1)
    assert drawn["usual"] == pytest.approx(away[known].mean(), abs=1e-3)
    assert [one["at"][0] for one in drawn["indicators"]] == pytest.approx(away[chosen], abs=1e-3)
    assert len(drawn["known"]) + len(chosen) == len(known)
    assert picture["questions"]
    triples = explored.points.graph.triples.tolist()
    for start, vector in starts.items():
        assert drawn[start][0] == pytest.approx(np.linalg.norm(vector - centre), abs=1e-3)
        table = explored.theta0.entity.clone()
        table[0, entity] = table.new_tensor(vector)
        ranked = scores(replace(explored.theta0, entity=table), entity)[:, 0]
        for question in picture["questions"]:
            relation = explored.points.graph.relations.index(question["relation"])
            heads = {entity, *known}
            had = {tail for head, of, tail in triples if of == relation and head in heads}
            order = [one for one in (-ranked[relation]).argsort() if one in had & {*known}]
            assert question[start] == [
                [NAMES[one], [entity, relation, int(one)] in triples] for one in order[:ANSWERS]
            ]


def test_the_median_draw_has_as_many_better_as_worse_draws(shown: Shown) -> None:
    explored, drawn = shown.explored, draws(shown.explored)
    entity, qualities = explored.first, []
    for vector in drawn:
        table, ranks = explored.theta0.entity.clone(), []
        table[0, entity] = table.new_tensor(vector)
        ranked = scores(replace(explored.theta0, entity=table), entity)
        for (relation, is_tail), answers in explored.truth(entity).items():
            row = ranked[relation, int(is_tail)]
            listed = explored.candidates((relation, is_tail)) | {*answers}
            ranks += [sum(row[one] >= row[answer] for one in listed) for answer in answers]
        qualities.append(np.mean(1 / np.array(ranks)))
    median = median_draw(explored, entity, drawn)
    place = next(place for place in range(DRAWS) if (drawn[place] == median).all())
    assert qualities[place] == sorted(qualities)[(DRAWS - 1) // 2]


def test_without_words_or_an_initializer_there_is_no_picture(shown: Shown) -> None:
    assert demonstration.picture(shown.explored, {"xavier": {}}) is None
    silent = replace(shown.explored, words=np.zeros_like(shown.explored.words))
    assert demonstration.picture(silent, shown.options) is None


def test_the_payload_gives_the_insert_triples_of_the_run(shown: Shown) -> None:
    points, data = shown.explored.points, shown.data
    rows = points.insert_triples
    for place, entity in enumerate(points.novel[0]):
        assert data["given"][str(entity)] == rows[rows[:, 1] == place, 2].tolist()
    assert {*map(int, data["random"])} == {*data["novel"]}


def test_the_script_computes_the_initializers_of_the_payload() -> None:
    text = (TEMPLATES / "explorer/initializers.js").read_text(encoding="utf-8")
    assert re.findall(r"^  (\w+): \(world, subject", text, re.MULTILINE) == [*COMPUTED]


def test_a_turned_scaled_and_moved_joint_model_lies_on_theta0() -> None:
    rng = np.random.default_rng(1)
    onto, known = rng.normal(size=(9, 4)), np.arange(9) < 6
    rotation = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    turned, fitted = demonstration.procrustes(0.3 * onto @ rotation + 7, onto, known)
    assert turned == pytest.approx(onto)
    assert fitted == pytest.approx(1)
