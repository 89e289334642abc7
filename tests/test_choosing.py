"""What ``tools/choose_initializers.py`` hides, tells and asks, and how it shows what it found."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import torch

from isi.evaluation.query_sets import novel_query_set
from isi.evaluation.ranking import evaluate
from isi.experiment.grid import GridPoints
from isi.graph.sessions import OUT, TEST, TRAIN, VALID
from isi.initializers.api import INITIALIZERS, options_of
from tests.small_graphs import points_of, random_embedding, random_graph
from tools.choose_initializers import about, compared, hide, settings_of, shown, table_of

ENTITIES, RELATIONS = 20, 3


def hidden(draw: int = 0) -> tuple[GridPoints, GridPoints]:
    points = points_of(random_graph(ENTITIES, RELATIONS, 140), 3, [0, 1, 2])
    return points, hide(points, 4, draw, 0, 0.5)


def test_known_entities_are_hidden_and_neither_novel_ones_nor_test_triples_have_a_part() -> None:
    points, pseudo = hidden()
    for model in range(3):
        known = points.session(0).trained()[model].nonzero().flatten().tolist()
        assert set(pseudo.novel[model, 0].tolist()) <= set(known)
        touched = np.isin(points.graph.triples[:, [0, 2]], points.novel[model]).any(1)
        assert (pseudo.splits[model][touched] == OUT).all()
    assert (pseudo.splits[points.splits == TEST] == OUT).all()
    kept = pseudo.splits != OUT
    assert (pseudo.splits[kept] == points.splits[kept]).all()
    assert set(pseudo.splits[kept].tolist()) == {TRAIN, VALID}
    assert not (pseudo.session(0).entities.gather(1, pseudo.novel_in(1))).any()
    assert (pseudo.novel != hidden(draw=1)[1].novel).any()


def test_half_of_the_training_triples_of_hidden_entities_is_told() -> None:
    _, pseudo = hidden()
    told = pseudo.insert_triples
    for session, model, place, triple in told.tolist():
        head, _, tail = pseudo.graph.triples[triple].tolist()
        assert session == 1
        assert pseudo.splits[model, triple] == TRAIN
        assert pseudo.novel[model, 0, place] in (head, tail)
    number = pd.DataFrame(told).groupby([1, 2]).size()
    for (model, place), count in number.items():  # type: ignore[misc]
        ends = torch.from_numpy(np.isin(pseudo.graph.triples[:, [0, 2]], pseudo.novel[model, 0]))
        own = (pseudo.graph.triples[:, [0, 2]] == pseudo.novel[model, 0, place]).any(1)
        usable = own & (ends.sum(1) == 1) & torch.from_numpy(pseudo.splits[model] == TRAIN)
        assert count == max(1, int(usable.sum()) // 2)


def test_half_of_the_queries_for_entities_are_about_the_novel_one() -> None:
    _, pseudo = hidden()
    queries = novel_query_set(pseudo.session(1), pseudo.novel_in(1), pseudo.insert_mask(1))["novel"]
    some = about(queries, pseudo.novel_in(1))
    theta = random_embedding(3, ENTITIES, RELATIONS, 8)
    found = evaluate(theta, {"about": some})["about"].measures[:, 1]
    assert some.rows is not None
    torch.testing.assert_close(some.rows.entity_weight.sum(1), torch.ones(3))
    rows = some.rows
    for model in range(3):
        novel = set(pseudo.novel[model, 0].tolist())
        heads, _, tails = (ids[model].tolist() for ids in rows.ids)
        for place, (head, tail) in enumerate(zip(heads, tails, strict=True)):
            weights = rows.entity_weight[model, [place, place + len(heads)]]
            asked = bool(queries.rows.entity_weight[model, place] > 0)  # type: ignore[union-attr]
            assert (weights > 0).tolist() == [asked and tail in novel, asked and head in novel]
    assert ((found > 0) & (found < 1)).all()


def test_settings_are_the_grid_and_what_params_say() -> None:
    settings = settings_of(["es", "mean"], {"es": {"k": 5}, "mean": {}})
    assert settings[0] == ("es", {"k": 5})
    assert [options["k"] for name, options in settings[1:-1]] == (INITIALIZERS.get("es", "es").grid or {})["k"]
    assert settings[-1] == ("mean", {})
    assert all(options_of(name, options, name) == options for name, options in settings_of(compared(), {}))
    assert shown({"k": 3, "candidates": 4}) == "k 3, candidates 4"
    assert shown({}) == "–"


def test_the_best_setting_of_an_initializer_stands_first_with_errors_of_differences() -> None:
    settings = [("es", {"k": 1}), ("es", {"k": 2}), ("mean", {})]
    here = np.array([[[50.0, 1.0], [52.0, 3.0]], [[60.0, 2.0], [66.0, 4.0]], [[40.0, 0.0], [np.nan, 0.0]]])
    there = here + 10
    table = table_of(settings, {"here": here, "there": there})
    assert table["options"].tolist() == ["k 2", "k 1", "–"]
    assert table["MRR*"].tolist() == [68.0, 56.0, 45.0]
    assert table["asked about"].tolist() == [8.0, 7.0, 5.0]
    assert table["here: MRR*"].tolist() == [63.0, 51.0, 40.0]
    differences = np.array([10.0, 14.0])  # in both
    error = (2 * differences.var(ddof=1) / 2) ** 0.5 / 2
    assert table["±"].tolist()[:2] == [0.0, pytest.approx(error, abs=0.01)]
    assert list(table_of(settings, {"here": here}).columns) == ["initializer", "options", "MRR*", "asked about", "±"]
