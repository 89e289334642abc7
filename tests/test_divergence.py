"""A run with NaN or infinity stops; the message names experiment, size, seed,
epoch and the option to lower.
"""

import pickle
from dataclasses import replace

import pytest
import torch

from isi.config import LARGEST, Option
from isi.errors import InputError
from isi.models.stack import Embedding, NotFinite, check_finite
from isi.training.batches import Negatives, training_data
from isi.training.trainer import Optimizer, start, train
from stages.insert import insert_stack
from stages.runner import Compute, run
from stages.train_theta0 import train_stack
from tests.init_contexts import EVERYONE
from tests.small_graphs import ANALOGY, points_of, random_embedding, random_graph, score_all
from tests.small_grid import LEARNING, insert_tasks, theta0, training_tasks

SAMPLED = Negatives(mode="sampled", ratio=3)
STEEP = Optimizer(batch_size=50, learning_rate=1e30, weight_decay=1e-3, max_epochs=6)


def test_models_that_are_not_finite_are_named_by_their_places() -> None:
    sound = torch.ones(4, 3, 2)
    check_finite((sound, -LARGEST * sound), "vectors")
    for value in (torch.nan, torch.inf, -torch.inf, 2 * LARGEST, -2 * LARGEST):
        broken = sound.clone()
        broken[[1, 3], 2, 1] = value
        for tables in ((sound, broken), (broken, sound)):
            with pytest.raises(NotFinite, match=r"^NaN or huge numbers in vectors$") as ended:
                check_finite(tables, "vectors")
            assert ended.value.models == [1, 3]
    again = pickle.loads(pickle.dumps(ended.value))  # noqa: S301 (its own bytes, as between processes)
    assert (again.models, str(again)) == ([1, 3], "NaN or huge numbers in vectors")


def test_vectors_below_the_bound_have_finite_scores() -> None:
    extreme = Embedding(torch.full((1, 3, 400), LARGEST), torch.full((1, 2, 400), LARGEST), ANALOGY)
    assert score_all(extreme).isfinite().all()


def diverging(embedding: Embedding, settings: Optimizer, seeds: list[int]) -> NotFinite:
    points = points_of(random_graph(13, 3, 80), 2, seeds)
    data = training_data(points.session(1), "training", points.keys())

    def onward(_: int, __: Embedding, models: torch.Tensor) -> torch.Tensor:
        # model 1 stops at the first call
        return torch.tensor([place != 1 for place in models.tolist()])

    with pytest.raises(NotFinite) as ended:
        train(embedding, data, SAMPLED, settings, 0, onward)
    return ended.value


def test_training_that_diverges_stops_with_its_epoch_and_rate() -> None:
    error = diverging(random_embedding(3, 13, 3, 8), STEEP, [0, 1, 2])
    assert error.models == [0, 2]  # places in the stack as it was at first
    assert str(error).startswith("diverged in epoch 1 (NaN or huge numbers in ")
    assert str(error).endswith("): turn down the learning rate (1e+30)")


def test_what_training_starts_from_is_looked_at_before_it() -> None:
    embedding = random_embedding(3, 13, 3, 8)
    embedding.entity[2, 5, 1] = torch.nan
    error = diverging(embedding, STEEP.model_copy(update={"learning_rate": 0.1}), [0, 1, 2])
    assert error.models == [2]
    assert str(error) == (
        "diverged in epoch 0 (NaN or huge numbers in vectors or scores): check the initial vectors"
    )


def test_adagrads_sums_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    def overflowing(state: object, *_: object) -> None:
        state.squares.relation[0, 0, 0] = torch.inf  # type: ignore[attr-defined]

    monkeypatch.setattr("isi.training.trainer.run_epoch", overflowing)
    error = diverging(random_embedding(1, 13, 3, 8), STEEP, [0])
    assert str(error).startswith("diverged in epoch 1 (NaN or huge numbers in Adagrad's sums): ")
    assert start(random_embedding(1, 13, 3, 8)).squares.entity.isfinite().all()


@pytest.mark.parametrize("workers", [1, 2])
def test_a_grid_names_the_cells_that_diverged(workers: int) -> None:
    steep = replace(LEARNING, training=LEARNING.training.model_copy(update={"learning_rate": 1e30}))
    tasks = training_tasks(2, steep)
    with pytest.raises(InputError) as ended:
        run(train_stack, tasks, Compute(workers=workers, stack=2), "learning")
    assert any(f": {points}: diverged in epoch 1 (" in str(ended.value) for points, *_ in tasks), (
        str(ended.value)
    )


@pytest.mark.parametrize(
    ("name", "options", "value", "says"),
    [
        (
            "xavier",
            {},
            torch.nan,
            r"seeds \d+: diverged in epoch 0 \(NaN or huge numbers in vectors or scores\)",
        ),
        (
            "map",
            EVERYONE["map"],
            0.0,
            r"seeds 1: the known vectors are all equal .*: lower",
        ),
    ],
)
def test_insertion_among_vectors_that_are_none_or_all_equal_names_its_cells(
    name: str, options: dict[str, Option], value: float, says: str
) -> None:
    trained = theta0()
    trained.entity[1] = value
    tasks = [
        (*rest, replace(config, initializer=name, options=options))
        for *rest, config in insert_tasks(2, "mean", trained)
    ]
    with pytest.raises(InputError, match=rf"^params\.yaml: .*{says}"):
        run(insert_stack, tasks, Compute(workers=1, stack=2), "insertion")
