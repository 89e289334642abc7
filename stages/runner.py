"""Where the tasks of a stage run: on processes of this machine, or on a Dask cluster."""

import asyncio
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    ProcessPoolExecutor,
    as_completed,
)
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing.reduction import ForkingPickler
from typing import Annotated, Any, ClassVar, Literal, Protocol, TypeVar, TypeVarTuple

import torch
from pydantic import Field
from torch import Tensor
from tqdm import tqdm

from isi.config import Count, Section
from isi.errors import InputError, at, extra
from isi.models.stack import NotFinite, mapped
from isi.process import become_worker
from isi.tables import paths
from isi.training.batches import DENSE_LIMIT

Arguments = TypeVarTuple("Arguments")  #: Of a task, after its grid points.
Done = TypeVar("Done")


class Compute(Section):
    """``compute`` in params: where and how tasks run; changes no result."""

    rules = (
        (
            lambda compute: compute.engine != "dask" or compute.scheduler is not None,
            "engine dask needs the address of its scheduler: compute.scheduler: tcp://host:port",
        ),
    )
    workers: Count | Literal["all"]
    stack: Count
    engine: Literal["processes", "dask"] = "processes"
    scheduler: Annotated[str, Field(pattern=r"^tcp://[^/\s]+:[0-9]{1,5}$")] | None = None
    device: Literal["cpu", "auto", "cuda"] = "cpu"


#: Tensors are sent to other processes as arrays: shared memory may run out.
ForkingPickler.register(Tensor, lambda tensor: (torch.from_numpy, (tensor.numpy(),)))


class PointsLike(Protocol):
    """The models that a task computes, a data class: one for each seed."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def seeds(self) -> Sequence[int]: ...


Points = TypeVar("Points", bound=PointsLike)
REACH = 5  #: Seconds in which a scheduler must answer.
#: Maximal bytes on a GPU for one model of a stack: batch, scores and slopes as float32 tables,
#: times two.
BYTES_PER_MODEL = 6 * 4 * DENSE_LIMIT


class TaskError(Exception):
    """A task failed: names its grid points and the cause."""


def run(
    function: Callable[[Points, *Arguments], Done],
    tasks: Sequence[tuple[Points, *Arguments]],
    compute: Compute,
    name: str,
) -> list[Done]:
    """Results of a function for each task, run as ``compute`` says;
    ``TaskError`` or ``InputError`` once one fails.
    """
    results = dict[int, Done]()
    engine = _dask if compute.engine == "dask" else _processes
    total = sum(len(points.seeds) for points, *_ in tasks)
    with engine(compute) as executor:
        futures = {
            executor.submit(run_task, function, task, compute.device): place
            for place, task in enumerate(tasks)
        }
        # it starts a thread: workers come first
        with tqdm(total=total, desc=name, unit="model", disable=None) as bar:
            for future in as_completed(list(futures)):
                place = futures.pop(future)
                points = tasks[place][0]
                try:
                    results[place] = future.result()
                except (InputError, CancelledError):  # not a fault in the task's code
                    raise
                except BrokenExecutor as error:
                    died = (
                        "a worker process was killed, perhaps out of memory: try fewer, "
                        "or a lower compute.stack"
                    )
                    raise InputError(paths.PARAMS, "compute.workers", died) from error
                except Exception as error:
                    if isinstance(
                        error, MemoryError | torch.OutOfMemoryError
                    ) or "can't allocate memory" in str(error):
                        much = (
                            f"not enough memory for the running tasks ({points}): lower it; "
                            "on a GPU, use device cpu"
                        )
                        raise InputError(paths.PARAMS, "compute.stack", much) from error
                    raise TaskError(f"{points}: {type(error).__name__}: {error}") from error
                bar.update(len(points.seeds))
    return [results[place] for place in range(len(tasks))]


def run_task(
    function: Callable[[Points, *Arguments], Done],
    task: tuple[Points, *Arguments],
    device: str,
) -> Done:
    """Run a task on one thread, denormal numbers as zero (they are slow); return CPU tensors.
    InputError for NaN or ∞.

    Both settings belong to the thread of the engine and are never reset, so that tasks cannot
    disturb each other.
    """
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    points, target = task[0], device_of(device)
    try:
        if target.type == "cpu":
            return function(*task)
        with target:
            return mapped(function(*mapped(task, lambda tensor: tensor.to(target))), Tensor.cpu)
    except NotFinite as error:
        seeds = [points.seeds[place] for place in error.models]
        raise InputError(paths.PARAMS, str(replace(points, seeds=seeds)), error.message) from error


def device_of(name: str) -> torch.device:
    """The device that ``compute.device`` names, on this machine;
    an ``InputError`` where there is no such GPU.
    """
    if name == "cuda" and not torch.cuda.is_available():
        raise InputError(
            paths.PARAMS, "compute.device", "no NVIDIA GPU that this build of PyTorch can use"
        )
    return torch.device("cuda" if name != "cpu" and torch.cuda.is_available() else "cpu")


def stack_height(compute: Compute) -> int:
    """Maximum models in a stack: ``compute.stack``;
    without Dask, more if a worker's share of a GPU holds more.
    """
    if compute.engine == "dask" or device_of(compute.device).type == "cpu":
        return compute.stack
    free, _ = torch.cuda.mem_get_info()
    return max(compute.stack, free // (_workers(compute) * BYTES_PER_MODEL))


@contextmanager
def _processes(compute: Compute) -> Iterator[Executor]:
    """Worker processes of this machine; forked ones save the imports but cannot use a GPU."""
    forked = sys.platform == "linux" and compute.device == "cpu"
    context = multiprocessing.get_context("fork" if forked else "spawn")
    with ProcessPoolExecutor(_workers(compute), context, become_worker, (os.getpid(),)) as executor:
        try:
            yield executor
        except BaseException:
            for worker in multiprocessing.active_children():  # do not wait for them
                worker.kill()
            raise


def _workers(compute: Compute) -> int:
    """The number of workers; ``all``: the cores that this process may use."""
    if compute.workers != "all":
        return compute.workers
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _dask(compute: Compute) -> Iterator[Executor]:
    """Workers of a Dask cluster. Dask repeats tasks of a lost worker;
    the end of the context cancels tasks.
    """
    with at(paths.PARAMS, "compute.engine"), extra("cluster"):
        from distributed import Client
        from distributed.comm import connect

    async def greet() -> None:
        """Fail if the scheduler does not answer; a Client would wait forever."""
        (await asyncio.wait_for(connect(compute.scheduler, timeout=REACH), REACH)).abort()

    try:
        asyncio.run(greet())
        client = Client(compute.scheduler, timeout=REACH, set_as_default=False)
    except (OSError, MemoryError) as error:  # the answer of another server may be read as a length
        absent = f"no Dask scheduler answers at {compute.scheduler} within {REACH} seconds"
        raise InputError(paths.PARAMS, "compute.scheduler", absent) from error
    with client:
        try:
            yield client.get_executor(pure=False)
        except CancelledError as error:
            raise InputError(
                paths.PARAMS, "compute.scheduler", f"lost connection to {compute.scheduler}"
            ) from error
