"""What ``tools/choose_initializers.py`` hides, tells and asks, and how it shows what it found."""

from __future__ import annotations

import numpy as np
import pandas as pd
import torch

from isi.evaluation.query_sets import novel_query_set
from isi.evaluation.ranking import evaluate
from isi.experiment.grid import GridPoints
from isi.graph.sessions import OUT, TEST, TRAIN, VALID
from tests.small_graphs import points_of, random_embedding, random_graph
from tools.choose_initializers import about, hide

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
