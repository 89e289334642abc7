"""Θ⁰ trained on with nothing inserted: what it measures, and what must stay as it is."""

from __future__ import annotations

from itertools import product

import numpy as np
import pandas as pd
import pytest
import torch

from isi.analyses.finetuning import finetune_only
from isi.experiment.grid import GridPoints
from isi.experiment.insert import insert_stack
from isi.models.stack import Embedding
from isi.training import trainer
from tests.small_graphs import points_of
from tests.small_grid import GRAPH, OPTIMIZER, SAMPLED, SEEDS, SIZE, insert_tasks, some_models, theta0

MEASURES = ["mrr_star", "mrr_star_entity", "mrr_star_relation", "mrr", "queries"]


def finetuned(points: GridPoints, trained: Embedding) -> pd.DataFrame:
    return finetune_only(points, trained, 0, SAMPLED, OPTIMIZER)


def test_earlier_knowledge_has_a_row_for_each_seed_and_epoch() -> None:
    runs = finetuned(points_of(GRAPH, SIZE, SEEDS), theta0())
    found = sorted(runs[["seed", "epoch"]].itertuples(index=False, name=None))
    assert found == list(product(SEEDS, range(OPTIMIZER.max_epochs + 1)))
    assert set(runs["scope"]) == {"known_closed"}
    assert set(runs["size"]) == {SIZE}
    assert set(runs["session"]) == {1}
    assert runs["mrr_star"].between(0, 1).all()


def test_before_training_it_is_what_every_insertion_starts_from() -> None:
    trained = theta0()
    runs = finetuned(points_of(GRAPH, SIZE, SEEDS), trained).query("epoch == 0").set_index("seed")
    (inserting,) = insert_tasks(len(SEEDS), "es", trained)
    inserted = insert_stack(*inserting).runs.query("epoch == 0 and scope == 'known_closed'").set_index("seed")
    pd.testing.assert_frame_equal(runs[MEASURES], inserted[MEASURES], check_exact=True)


def test_known_entities_move_and_novel_ones_never_do(monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[Embedding] = []

    def recorded(*arguments: object) -> Embedding:
        ended.append(trainer.train(*arguments))  # type: ignore[arg-type]
        return ended[-1]

    monkeypatch.setattr("isi.analyses.finetuning.train", recorded)
    points, trained = points_of(GRAPH, SIZE, SEEDS), theta0()
    finetuned(points, trained)
    (after,), before = ended, trained
    still = (after.entity == before.entity).all(-1)
    for model, novel in enumerate(points.novel[:, 0].tolist()):
        assert set(torch.where(still[model])[0].tolist()) == set(novel)
    assert not torch.equal(after.relation, before.relation)


def test_a_cell_learns_the_same_whatever_stands_beside_it() -> None:
    trained = theta0()
    together = finetuned(points_of(GRAPH, SIZE, SEEDS), trained).sort_values(["seed", "epoch"])
    for model, seed in enumerate(SEEDS):
        alone = finetuned(points_of(GRAPH, SIZE, [seed]), some_models(trained, [model]))
        expected = together[together["seed"] == seed]
        assert np.array_equal(alone[MEASURES].to_numpy(), expected[MEASURES].to_numpy())
