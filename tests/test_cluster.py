"""The grid on a cluster of a Dask scheduler and two workers on loopback;
one worker is killed during its task.
"""

import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
import torch

from isi.errors import InputError
from isi.training.fit import TrainConfig
from stages import runner
from stages.grid import GridPoints
from stages.insert import insert_stack
from stages.runner import Compute, TaskError, run
from stages.train_theta0 import TrainResult, train_stack
from tests.dask_cluster import Cluster, two_workers
from tests.environment import wait_for
from tests.small_grid import insert_tasks, inserted_bytes, theta0, trained_bytes, training_tasks

pytest.importorskip("distributed")

PROCESSES = Compute(workers=2, stack=1)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with two_workers(tmp_path_factory.mktemp("cluster")) as started:
        yield started


def on_cluster(cluster: Cluster) -> Compute:
    return Compute(workers=1, stack=1, engine="dask", scheduler=cluster.scheduler)


@pytest.fixture(params=["processes", "dask"])
def compute(request: pytest.FixtureRequest) -> Compute:
    """The section ``compute`` for each engine."""
    return (
        PROCESSES
        if request.param == "processes"
        else on_cluster(request.getfixturevalue("cluster"))
    )


def state(*_: object) -> tuple[int, float]:
    """Number of torch threads, and the value of a denormal number (0 if flushed)."""
    return torch.get_num_threads(), (torch.tensor([1e-40]) * 1).item()


def fail(points: GridPoints, *_: object) -> None:
    if points.seeds == [2]:
        raise ValueError("no such indicator")


def noted(folder: Path, points: GridPoints, config: TrainConfig) -> TrainResult:
    """Write a file named after this process and the first seed,
    wait until a worker was killed, then train.
    """
    (folder / f"{os.getpid()} {points.seeds[0]}").touch()
    assert wait_for((folder / "killed").exists)
    return train_stack(points, config)


def test_a_task_runs_on_one_thread_without_denormal_numbers(compute: Compute) -> None:
    assert set(run(state, training_tasks(1), compute, "state")) == {(1, 0.0)}


def test_a_task_that_fails_names_its_cell_and_the_cause(compute: Compute) -> None:
    with pytest.raises(
        TaskError, match=r"^home, size 2, seeds 2: ValueError: no such indicator$"
    ) as failed:
        run(fail, training_tasks(1), compute, "failing")
    assert isinstance(failed.value.__cause__, ValueError)


def test_a_cluster_gives_the_bytes_of_processes_though_a_worker_is_killed(
    cluster: Cluster, tmp_path: Path
) -> None:
    tasks = training_tasks(1)
    expected = trained_bytes(run(train_stack, tasks, PROCESSES, "theta0"))

    def kill_one() -> None:
        note = wait_for(lambda: next(tmp_path.iterdir(), None))
        assert note
        os.kill(int(note.name.split()[0]), signal.SIGKILL)
        (tmp_path / "killed").touch()

    killer = threading.Thread(target=kill_one)
    killer.start()
    learned = run(partial(noted, tmp_path), tasks, on_cluster(cluster), "theta0")
    killer.join()
    (killed,) = [
        pid for pid, process in cluster.workers.items() if process.poll() == -signal.SIGKILL
    ]
    (other,) = cluster.workers.keys() - {killed}
    done_by = {
        pid: {path.name.split()[1] for path in tmp_path.glob(f"{pid} *")} for pid in cluster.workers
    }
    assert done_by[killed] <= done_by[other] == {"0", "1", "2", "3"}
    assert trained_bytes(learned) == expected
    later = insert_tasks(2, "ers", theta0())
    inserted, again = (
        run(insert_stack, later, compute, "ers") for compute in (PROCESSES, on_cluster(cluster))
    )
    assert inserted_bytes(inserted) == inserted_bytes(again)


@pytest.mark.parametrize(
    "says", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n"], ids=["nothing", "another protocol"]
)
def test_a_server_that_is_no_scheduler_is_refused_in_time(
    monkeypatch: pytest.MonkeyPatch, says: bytes
) -> None:
    monkeypatch.setattr(runner, "REACH", 1)
    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=lambda: server.accept()[0].sendall(says), daemon=True).start()
        other = Compute(
            workers=1,
            stack=1,
            engine="dask",
            scheduler=f"tcp://127.0.0.1:{server.getsockname()[1]}",
        )
        with pytest.raises(
            InputError, match=r"^params\.yaml: compute\.scheduler: no Dask scheduler answers"
        ):
            run(state, [], other, "nothing")


def test_the_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(
        InputError, match=r"^params\.yaml: compute\.engine: .*pip install 'isi-kge\[cluster\]'$"
    ):
        run(
            state,
            [],
            Compute(workers=1, stack=1, engine="dask", scheduler="tcp://127.0.0.1:1"),
            "nothing",
        )
