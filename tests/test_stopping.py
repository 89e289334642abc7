"""Stopped commands, and a second run in the same folder:
one line of output, and no process stays.
"""

import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest
import yaml

from tests import endless
from tests.environment import ENVIRONMENT, PATIENCE, wait_for
from tools import workspace as workspaces

ROOT = Path(__file__).parent.parent
SLEEP = "import sys; from tests import endless; endless.main(sys.argv[1])"
#: Writes half a file, says so, and sleeps.
WRITE = """
import sys, time
from pathlib import Path
from isi.process import errors_in_one_line
from isi.tables.io import atomically

def half(temporary):
    temporary.write_bytes(b"half of the n")
    Path("begun").touch()
    time.sleep(300)

with errors_in_one_line("writer"):
    atomically(Path("table"), half)
"""
#: Starts a stage, as DVC does, says its process id, and waits for it.
PARENT = """
import subprocess, sys
stage = subprocess.Popen([sys.executable, "-c", *sys.argv[1:]])
print(stage.pid, flush=True)
stage.wait()
"""
#: And this code.
WITH_CODE = ENVIRONMENT | {"PYTHONPATH": str(ROOT)}

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
SIGNALS = pytest.mark.parametrize(
    ("signalled", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)]
)


def session(leader: int) -> set[int]:
    """Ids of the living processes in the session of a leader."""
    processes = set()
    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):  # it ended meanwhile
            if os.getsid(process.pid) == leader and process.status() != psutil.STATUS_ZOMBIE:
                processes.add(process.pid)
    return processes


@contextmanager
def running(
    command: list[str], folder: Path, begun: Callable[[], bool]
) -> Iterator[subprocess.Popen[str]]:
    """A command in a new session, after it has begun; all its processes are killed in the end."""
    with subprocess.Popen(
        command,
        cwd=folder,
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=WITH_CODE,
        preexec_fn=_heed_ctrl_c,
    ) as process:
        try:
            assert wait_for(lambda: begun() or process.poll() is not None)
            assert process.poll() is None, process.communicate()
            yield process
        finally:
            wait_for(lambda: not kill_all(process.pid))


def kill_all(leader: int) -> set[int]:
    """Kill the living processes in the session of a leader;
    returns their ids, some of which may end by themselves.
    """
    found = session(leader)
    for left in found:
        with suppress(ProcessLookupError):  # it ended meanwhile
            os.kill(left, signal.SIGKILL)
    return found


def _heed_ctrl_c() -> None:
    """Accept Ctrl-C, which a shell makes background processes ignore."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def asleep(folder: Path) -> Callable[[], bool]:
    """A function that tells whether all workers of ``endless`` sleep."""
    return lambda: (
        len([path for path in folder.iterdir() if path.name.isdigit()]) == endless.WORKERS
    )


@pytest.mark.parametrize(
    ("signalled", "status", "whom"),
    [
        (signal.SIGINT, 130, "all"),
        (signal.SIGINT, 130, "the stage"),
        (signal.SIGTERM, 143, "the stage"),
    ],
)
def test_a_stage_that_is_stopped_ends_in_one_line_with_its_workers(
    tmp_path: Path, signalled: signal.Signals, status: int, whom: str
) -> None:
    with running([sys.executable, "-c", SLEEP, "."], tmp_path, asleep(tmp_path)) as stage:
        (os.killpg if whom == "all" else os.kill)(stage.pid, signalled)  # a terminal signals all
        out, err = stage.communicate(timeout=PATIENCE)
        assert (stage.returncode, out) == (status, "")
        assert (
            err == f"endless: stopped by {signalled.name}; no file is half-written; run it again\n"
        )
        assert wait_for(lambda: not session(stage.pid)), session(stage.pid)


def test_a_stage_whose_worker_is_killed_says_so_in_one_line(tmp_path: Path) -> None:
    with running([sys.executable, "-c", SLEEP, "."], tmp_path, asleep(tmp_path)) as stage:
        os.kill(
            int(next(path.name for path in tmp_path.iterdir() if path.name.isdigit())),
            signal.SIGKILL,
        )
        _, err = stage.communicate(timeout=PATIENCE)
        assert stage.returncode == 1
        assert len(err.splitlines()) == 1
        assert err.startswith("endless: params.yaml: compute.workers: a worker process was killed")


@pytest.mark.parametrize("killed", ["parent", "stage"])
def test_no_process_of_a_stage_outlives_it_or_its_parent(tmp_path: Path, killed: str) -> None:
    with running([sys.executable, "-c", PARENT, SLEEP, "."], tmp_path, asleep(tmp_path)) as parent:
        assert parent.stdout
        stage, workers = (
            int(parent.stdout.readline()),
            {int(p.name) for p in tmp_path.iterdir() if p.name.isdigit()},
        )
        assert {parent.pid, stage} | workers <= session(parent.pid)
        os.kill(parent.pid if killed == "parent" else stage, signal.SIGKILL)
        assert wait_for(lambda: not session(parent.pid)), session(parent.pid)


@SIGNALS
def test_a_stage_that_is_stopped_while_it_writes_leaves_the_earlier_output_and_nothing_else(
    tmp_path: Path, signalled: signal.Signals, status: int
) -> None:
    (tmp_path / "table").write_bytes(b"the last good one")
    with running([sys.executable, "-c", WRITE], tmp_path, (tmp_path / "begun").exists) as stage:
        stage.send_signal(signalled)
        _, err = stage.communicate(timeout=PATIENCE)
    assert (stage.returncode, len(err.splitlines())) == (status, 1)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["begun", "table"]
    assert (tmp_path / "table").read_bytes() == b"the last good one"


def test_a_stage_that_is_stopped_while_it_starts_ends_in_one_line(tmp_path: Path) -> None:
    def importing() -> bool:
        return "libtorch" in Path(f"/proc/{started[0]}/maps").read_text()

    started: list[int] = []
    command = [sys.executable, "-m", "stages.train_theta0", "ai2thor"]
    with running(command, tmp_path, lambda: bool(started) or True) as stage:
        started.append(stage.pid)
        assert wait_for(importing)
        stage.send_signal(signal.SIGINT)
        _, err = stage.communicate(timeout=PATIENCE)
    assert (stage.returncode, len(err.splitlines())) == (130, 1), err
    assert "stopped by SIGINT" in err


# DVC


@pytest.fixture
def pipeline(tmp_path: Path) -> Path:
    """A workspace whose only stage sleeps."""
    workspaces.make(tmp_path, {})
    cmd = shlex.join(["exec", sys.executable, "-c", SLEEP, "asleep"])
    stages = {"sleep": {"cmd": cmd, "outs": [{"asleep/out": {"persist": True}}]}}
    (tmp_path / "dvc.yaml").write_text(yaml.safe_dump({"stages": stages}), encoding="utf-8")
    (tmp_path / "asleep").mkdir()
    return tmp_path


DVC = [sys.executable, "-m", "dvc", "repro"]
REPRO = [sys.executable, str(ROOT / "tools/repro.py")]


def test_ctrl_c_on_dvc_shows_no_traceback_and_leaves_no_process(pipeline: Path) -> None:
    with running(DVC, pipeline, asleep(pipeline / "asleep")) as dvc:
        os.killpg(dvc.pid, signal.SIGINT)
        _, err = dvc.communicate(timeout=PATIENCE)
        assert dvc.returncode not in (0, None)
        assert "Traceback" not in err
        assert (
            "endless: stopped by SIGINT; no file is half-written; run it again" in err.splitlines()
        )
        assert len([line for line in err.splitlines() if line]) == 2  # DVC's own: the stage failed
        assert wait_for(lambda: not session(dvc.pid)), session(dvc.pid)


@SIGNALS
def test_make_repro_that_is_stopped_ends_in_one_line_with_all_its_processes(
    pipeline: Path, signalled: signal.Signals, status: int
) -> None:
    with running(REPRO, pipeline, asleep(pipeline / "asleep")) as repro:
        os.killpg(repro.pid, signalled)
        _, err = repro.communicate(timeout=PATIENCE)
        stopped = f"repro: stopped by {signalled.name}; no file is half-written"
        assert err == f"{stopped}; the same command goes on from here\n"
        assert repro.returncode == status
        assert wait_for(lambda: not session(repro.pid))


@pytest.mark.parametrize("first", [DVC, REPRO], ids=["dvc", "make"])
def test_a_second_run_says_that_there_is_a_first_and_leaves_it_alone(
    pipeline: Path, first: list[str]
) -> None:
    with running(first, pipeline, asleep(pipeline / "asleep")) as running_first:
        before = session(running_first.pid)
        second = subprocess.run(first, cwd=pipeline, capture_output=True, text=True, env=WITH_CODE)
        assert second.returncode
        assert "Traceback" not in second.stderr
        if first is REPRO:
            expected = f"repro: runs already in this folder (process {running_first.pid})"
            assert second.stderr.startswith(expected)
            assert len(second.stderr.splitlines()) == 1
        else:
            assert "is busy, it is being blocked by:" in second.stderr
            assert f"(PID {running_first.pid})" in second.stderr
        assert session(running_first.pid) == before


@pytest.mark.parametrize(
    ("command", "signalled"), [(DVC, signal.SIGTERM), (REPRO, signal.SIGKILL)], ids=["dvc", "make"]
)
def test_a_run_that_is_ended_ends_with_all_its_processes(
    pipeline: Path, command: list[str], signalled: signal.Signals
) -> None:
    with running(command, pipeline, asleep(pipeline / "asleep")) as run:
        run.send_signal(signalled)
        _, err = run.communicate(timeout=PATIENCE)
        assert (run.returncode, err) == (-signalled, "")  # which a shell gives as 128 + its number
        assert wait_for(lambda: not session(run.pid)), session(run.pid)
