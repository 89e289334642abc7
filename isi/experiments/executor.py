"""Where tasks run."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

import torch
from tqdm import tqdm

from isi.experiments.cells import Cells
from isi.lifetime import tie_to_parent
from isi.params import Compute

Task = TypeVar("Task", bound=Cells)
Done = TypeVar("Done")


def run(function: Callable[[Task], Done], tasks: Sequence[Task], compute: Compute, name: str) -> list[Done]:
    """Run tasks on worker processes of one thread each; results come back in the order of the tasks."""
    workers = available_cores() if compute.workers == "all" else compute.workers
    context = multiprocessing.get_context("spawn")  # a worker is then a child of the stage, and dies with it
    done = []
    with (
        ProcessPoolExecutor(
            min(workers, len(tasks)), context, initializer=prepare_worker, initargs=(os.getpid(),)
        ) as executor,
        tqdm(total=sum(len(task.seeds) for task in tasks), desc=name, unit="model", disable=None) as bar,
    ):
        try:
            for task, result in zip(tasks, executor.map(function, tasks), strict=True):
                done.append(result)
                bar.update(len(task.seeds))
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            raise
    return done


def available_cores() -> int:
    """The cores that this process may use, which can be fewer than the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def prepare_worker(parent: int) -> None:
    """One thread, no denormal numbers (they are slow, and far below what a rank can tell), no orphans."""
    tie_to_parent(parent)
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
