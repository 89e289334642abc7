"""A run whose numbers leave the numbers stops, and names experiment, size, seed, epoch and what to turn down."""

from __future__ import annotations

import pickle
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from isi.config import Option
from isi.errors import InputError
from isi.experiment.insert import insert_stack
from isi.experiment.runner import Compute, run
from isi.experiment.train import train_stack
from isi.models.stack import LARGEST, Embedding, NotFinite, check_finite
from isi.training.batches import Negatives, training_data
from isi.training.trainer import Optimizer, start, train
from tests.small_graphs import ANALOGY, points_of, random_embedding, random_graph, score_all
from tests.small_grid import LEARNING, insert_tasks, theta0, training_tasks
from tests.stage_workspace import Says, main_of, says, set_params, workspace

__all__ = ["says", "workspace"]  # fixtures

SAMPLED = Negatives(mode="sampled", ratio=3, head_pool="unseen")
STEEP = Optimizer(batch_size=50, learning_rate=1e30, weight_decay=1e-3, max_epochs=6)


def test_models_that_are_not_finite_are_named_by_their_places() -> None:
    sound = torch.ones(4, 3, 2)
    check_finite((sound, -LARGEST * sound), "vectors")
    for value in (torch.nan, torch.inf, -torch.inf, 2 * LARGEST, -2 * LARGEST):
        broken = sound.clone()
        broken[[1, 3], 2, 1] = value
        for tables in ((sound, broken), (broken, sound)):
            with pytest.raises(NotFinite, match=r"^NaN or infinity in vectors$") as ended:
                check_finite(tables, "vectors")
            assert ended.value.models == [1, 3]
    again = pickle.loads(pickle.dumps(ended.value))  # noqa: S301 (its own bytes, as between processes)
    assert (again.models, str(again)) == ([1, 3], "NaN or infinity in vectors")


def test_vectors_below_the_bound_have_finite_scores() -> None:
    extreme = Embedding(torch.full((1, 3, 400), LARGEST), torch.full((1, 2, 400), LARGEST), ANALOGY)
    assert score_all(extreme).isfinite().all()


def diverging(embedding: Embedding, settings: Optimizer, seeds: list[int]) -> NotFinite:
    points = points_of(random_graph(13, 3, 80), 2, seeds)
    data = training_data(points.last_session, "training", points.keys(), "unseen")

    def onward(_: int, __: Embedding, models: torch.Tensor) -> torch.Tensor:
        return torch.tensor([place != 1 for place in models.tolist()])  # the second leaves at once

    with pytest.raises(NotFinite) as ended:
        train(embedding, data, SAMPLED, settings, 0, onward)
    return ended.value


def test_training_that_diverges_stops_with_its_epoch_and_rate() -> None:
    error = diverging(random_embedding(3, 13, 3, 8), STEEP, [0, 1, 2])
    assert error.models == [0, 2]  # places in the stack as it was at first
    assert str(error).startswith("diverged in epoch 1 (NaN or infinity in ")
    assert str(error).endswith("): turn down the learning rate (1e+30)")


def test_what_training_starts_from_is_looked_at_before_it() -> None:
    embedding = random_embedding(3, 13, 3, 8)
    embedding.entity[2, 5, 1] = torch.nan
    error = diverging(embedding, STEEP.model_copy(update={"learning_rate": 0.1}), [0, 1, 2])
    assert error.models == [2]
    assert str(error) == "diverged in epoch 0 (NaN or infinity in vectors or scores): check the initial vectors"


def test_adagrads_sums_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    def overflowing(state: object, *_: object) -> None:
        state.squares.relation[0, 0, 0] = torch.inf  # type: ignore[attr-defined]

    monkeypatch.setattr("isi.training.trainer.run_epoch", overflowing)
    error = diverging(random_embedding(1, 13, 3, 8), STEEP, [0])
    assert str(error).startswith("diverged in epoch 1 (NaN or infinity in Adagrad's sums): ")
    assert start(random_embedding(1, 13, 3, 8)).squares.entity.isfinite().all()


@pytest.mark.parametrize("workers", [1, 2])
def test_a_grid_names_the_cells_that_diverged(workers: int) -> None:
    steep = replace(LEARNING, training=LEARNING.training.model_copy(update={"learning_rate": 1e30}))
    tasks = training_tasks(2, steep)
    with pytest.raises(InputError) as ended:
        run(train_stack, tasks, Compute(workers=workers, stack=2), "learning")
    assert any(f": {points}: diverged in epoch 1 (" in str(ended.value) for points, *_ in tasks), str(ended.value)


def second_filled(value: float) -> Embedding:
    """Θ⁰ with one value for all vectors of the second model."""
    trained = theta0()
    trained.entity[1] = value
    return trained


def test_insertion_of_vectors_that_are_none_names_its_cells() -> None:
    tasks = insert_tasks(2, "xavier", second_filled(torch.nan))
    with pytest.raises(InputError, match=r"seeds \d+: diverged in epoch 0 \(NaN or infinity in vectors or scores\)"):
        run(insert_stack, tasks, Compute(workers=1, stack=2), "insertion")


def test_insertion_by_the_covariance_of_vectors_that_do_not_differ_names_its_cells() -> None:
    options: dict[str, Option] = {"strength": 0.5, "ratio": 3}
    tasks = [
        (*rest, replace(config, initializer="map_mean", options=options))
        for *rest, config in insert_tasks(2, "mean", second_filled(0.0))
    ]
    with pytest.raises(InputError, match=r"params\.yaml: .*seeds 1: the known vectors are all equal .*: lower"):
        run(insert_stack, tasks, Compute(workers=1, stack=2), "insertion")


def test_a_stage_that_diverges_says_so_in_one_line(
    workspace: Path, says: Says, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    set_params(workspace, {
        "experiments.published.sessions.sizes": [1], "experiments.published.sessions.seeds": 2,
        "training.learning_rate": 1e30, "embedding.dimension": 8, "compute.workers": 1,
    })  # fmt: skip
    monkeypatch.chdir(workspace)
    for stage in ("mine", "build_graph", "make_sessions"):
        monkeypatch.setattr(sys, "argv", [stage, "published"])
        main_of(stage)()
    capsys.readouterr()
    line = says("train_theta0 published")
    assert line.startswith("params.yaml: published, size 1, seeds 0, 1: diverged in epoch 1 (NaN or infinity in ")
    assert line.endswith(": turn down the learning rate (1e+30)")
