"""A task runs on whatever device it is given, and what it gives back lies on the CPU."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch

from isi.analyses.single_insertions import TABLES, single_insertions, trace_trajectory
from isi.errors import InputError
from isi.experiment import runner
from isi.experiment.insert import insert_stack
from isi.experiment.runner import Compute
from isi.experiment.train import evaluate_stack, train_stack
from isi.models.model import MODELS, make_model
from isi.training import batches
from tests.pretend import DEVICE, Pretend
from tests.small_grid import (
    FAMILY_OPTIONS,
    INITIALIZERS,
    LEARNING,
    explorer_task,
    insert_tasks,
    stacks,
    theta0,
    training_tasks,
)

TRAINED = theta0(steps=2)


@pytest.fixture
def pretend(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """``compute.device: cuda`` is a device that only pretends."""
    monkeypatch.setattr(runner, "device_of", lambda name: DEVICE if name == "cuda" else torch.device("cpu"))
    with Pretend():
        yield
    torch.set_flush_denormal(False)


def test_the_device_that_pretends_refuses_what_a_gpu_refuses() -> None:
    with Pretend():
        here = torch.zeros(3)
        with DEVICE:
            there = torch.as_tensor(np.ones(3))
            assert (there + there.sum()).tolist() == [4, 4, 4]
            with pytest.raises(RuntimeError, match="same device"):
                there + here
            with pytest.raises(TypeError, match="NumPy"):
                there.exp().numpy()
            assert (there.cpu() + here).tolist() == [1, 1, 1]


@pytest.mark.usefixtures("pretend")
@pytest.mark.parametrize("name", MODELS.names())
@pytest.mark.parametrize("mode", ["sampled", "expected", "lists"])
def test_training_on_another_device_is_training(name: str, mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if mode == "lists":
        monkeypatch.setattr(batches, "DENSE_LIMIT", 0)
    negatives = LEARNING.negatives.model_copy(update={"mode": "expected" if mode == "expected" else "sampled"})
    family = make_model(name, FAMILY_OPTIONS.get(name, {}), f"models.{name}")
    config, (grid,) = replace(LEARNING, model=family, negatives=negatives), stacks(4)
    for points in (grid, grid.all_known):
        there, here = (runner.run_task(train_stack, (points, config), device) for device in ("cuda", "cpu"))
        assert np.array_equal(there.theta.entity, here.theta.entity)
        pd.testing.assert_frame_equal(there.log, here.log)


@pytest.mark.usefixtures("pretend")
@pytest.mark.parametrize("name", INITIALIZERS)
def test_inserting_on_another_device_is_inserting(name: str) -> None:
    (task,) = insert_tasks(4, name, TRAINED, steps=2)
    there, here = (runner.run_task(insert_stack, task, device) for device in ("cuda", "cpu"))
    assert np.array_equal(there.vectors, here.vectors)
    pd.testing.assert_frame_equal(there.runs, here.runs)
    pd.testing.assert_frame_equal(there.entities, here.entities)


@pytest.mark.usefixtures("pretend")
def test_measuring_on_another_device_is_measuring() -> None:
    (points,) = stacks(4, steps=2)
    task = points, [TRAINED, TRAINED]
    there, here = (runner.run_task(evaluate_stack, task, device) for device in ("cuda", "cpu"))
    pd.testing.assert_frame_equal(there, here)


@pytest.mark.usefixtures("pretend")
def test_tracing_on_another_device_is_tracing() -> None:
    points, trained, words, _, config = insert_tasks(1, "es", TRAINED, steps=2)[0]
    task = points, trained, words, config, 1
    for there, here in zip(
        *(runner.run_task(trace_trajectory, task, device) for device in ("cuda", "cpu")), strict=True
    ):
        assert np.array_equal(there, here)


@pytest.mark.usefixtures("pretend")
def test_single_insertions_on_another_device_are_single_insertions() -> None:
    there, here = (runner.run_task(single_insertions, explorer_task(), device) for device in ("cuda", "cpu"))
    for name in TABLES:
        pd.testing.assert_frame_equal(there[name], here[name])


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_without_a_gpu_auto_is_the_cpu_and_cuda_is_refused_by_name() -> None:
    assert runner.device_of("auto") == torch.device("cpu")
    assert runner.stack_height(Compute(workers=1, stack=7, device="auto")) == 7
    with pytest.raises(InputError, match=r"compute\.device"):
        runner.stack_height(Compute(workers=1, stack=7, device="cuda"))
    with pytest.raises(InputError, match=r"compute\.device"):  # found by a worker, which may be another machine
        runner.run(train_stack, training_tasks(2), Compute(workers=1, stack=2, device="cuda"), "refused")


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
def test_on_a_gpu_training_learns_as_much() -> None:
    (task,) = training_tasks(4)
    there, here = (runner.run_task(train_stack, task, device) for device in ("cuda", "cpu"))
    assert np.allclose(there.log["mrr_star"].mean(), here.log["mrr_star"].mean(), atol=0.02)
