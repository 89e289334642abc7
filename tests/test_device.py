"""A task computes on the device of its input, and its results are on the CPU."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from multiprocessing.reduction import ForkingPickler
from typing import Any

import numpy as np
import pytest
import torch

from isi.errors import InputError
from isi.models.model import MODELS, make_model
from isi.training import batches
from stages import runner
from stages.insert import insert_stack
from stages.runner import Compute
from stages.trace_trajectory import trace
from stages.train_joint import evaluate_stack
from stages.train_theta0 import train_stack
from tests import small_grid as grid
from tests.fake_device import DEVICE, FakeDevice

TRAINED = grid.theta0()
(POINTS,) = grid.stacks(4)
TASKS: dict[str, tuple[Callable[..., Any], tuple[Any, ...]]] = {
    **{
        f"inserting by {name}": (insert_stack, grid.insert_tasks(4, name, TRAINED)[0])
        for name in grid.INITIALIZERS
    },
    "measuring": (evaluate_stack, (POINTS, [TRAINED, TRAINED])),
    "tracing": (
        trace,
        (
            *grid.insert_tasks(1, "es", TRAINED)[0][:3],
            grid.insert_tasks(1, "es", TRAINED)[0][-1],
            1,
        ),
    ),
}


@pytest.fixture
def on_both(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., bool]]:
    """A function that tells whether a task returns equal bytes on the CPU and on the
    pretended GPU (``DEVICE``).
    """
    monkeypatch.setattr(
        runner, "device_of", lambda name: DEVICE if name == "cuda" else torch.device("cpu")
    )

    def same(function: Callable[..., Any], task: tuple[Any, ...]) -> bool:
        there, here = (runner.run_task(function, task, device) for device in ("cuda", "cpu"))
        return bytes(ForkingPickler.dumps(there)) == bytes(ForkingPickler.dumps(here))

    with FakeDevice():
        yield same
    torch.set_flush_denormal(False)


def test_the_device_that_pretends_refuses_what_a_gpu_refuses() -> None:
    with FakeDevice():
        here = torch.zeros(3)
        with DEVICE:
            there = torch.as_tensor(np.ones(3))
            assert (there + there.sum()).tolist() == [4, 4, 4]
            with pytest.raises(RuntimeError, match="same device"):
                there + here
            with pytest.raises(TypeError, match="NumPy"):
                there.exp().numpy()
            assert (there.cpu() + here).tolist() == [1, 1, 1]


@pytest.mark.parametrize("name", MODELS.names())
@pytest.mark.parametrize("mode", ["sampled", "expected", "lists"])
def test_training_on_another_device_is_training(
    name: str, mode: str, monkeypatch: pytest.MonkeyPatch, on_both: Callable[..., bool]
) -> None:
    if mode == "lists":
        monkeypatch.setattr(batches, "DENSE_LIMIT", 0)
    negatives = grid.LEARNING.negatives.model_copy(
        update={"mode": "expected" if mode == "expected" else "sampled"}
    )
    model = make_model(name, grid.MODEL_OPTIONS.get(name, {}), f"models.{name}")
    for points in (grid.stacks(4)[0], grid.stacks(4)[0].all_known):
        assert on_both(
            train_stack, (points, replace(grid.LEARNING, model=model, negatives=negatives))
        )


@pytest.mark.parametrize("name", TASKS)
def test_a_task_gives_the_same_on_another_device(name: str, on_both: Callable[..., bool]) -> None:
    assert on_both(*TASKS[name])


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_without_a_gpu_auto_is_the_cpu_and_cuda_is_refused_by_name() -> None:
    assert runner.device_of("auto") == torch.device("cpu")
    assert runner.stack_height(Compute(workers=1, stack=7, device="auto")) == 7
    with pytest.raises(InputError, match=r"compute\.device"):
        runner.stack_height(Compute(workers=1, stack=7, device="cuda"))
    # by a worker, which may be another machine
    with pytest.raises(InputError, match=r"compute\.device"):
        runner.run(
            train_stack,
            grid.training_tasks(2),
            Compute(workers=1, stack=2, device="cuda"),
            "refused",
        )


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
def test_on_a_gpu_training_learns_as_much() -> None:
    (task,) = grid.training_tasks(4)
    there, here = (runner.run_task(train_stack, task, device) for device in ("cuda", "cpu"))
    assert np.allclose(there.log["mrr_star"].mean(), here.log["mrr_star"].mean(), atol=0.02)
