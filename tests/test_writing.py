"""Outputs that cannot be written: a one-line error, unchanged earlier outputs,
and no temporary files.
"""

import errno
import os
import re
import resource
import shlex
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from isi.errors import InputError
from isi.tables import io
from stages.files import ENTITIES, TRIPLES
from tests.environment import CAN_MOUNT, OWN_MOUNTS
from tests.stage_workspace import KINDS, OBSERVED, leave, observed, outputs, workspace, write

__all__ = ["workspace"]  # a fixture

ROOT = Path(__file__).parent.parent
BUILD = [sys.executable, "-m", "stages.build_graph", "ai2thor"]


mounts = pytest.mark.skipif(not CAN_MOUNT, reason="no file system can be mounted here")


@pytest.mark.parametrize(
    ("number", "why", "tells_room"),
    [
        (errno.ENOSPC, "No space left on device", True),
        (errno.EDQUOT, "Disk quota exceeded", True),
        (errno.EFBIG, "File too large", True),
        (errno.EROFS, "Read-only file system", False),
        (errno.EACCES, "Permission denied", False),
        (errno.EIO, "Input/output error", False),
    ],
)
def test_what_a_disk_refuses_names_the_output_and_why_and_leaves_the_earlier_one(
    tmp_path: Path, number: int, why: str, tells_room: bool
) -> None:
    path = tmp_path / "runs.parquet"
    path.write_bytes(b"the last good one")

    def refused(temporary: Path) -> None:
        temporary.write_bytes(b"half of the n")
        raise OSError(number, os.strerror(number), str(temporary))

    with pytest.raises(InputError) as ended:
        io.atomically(path, refused)
    room = r"; \d+\.\d [GM]iB free there" if tells_room else ""
    assert re.fullmatch(
        rf"{re.escape(str(path))}: cannot be written \({why}{room}\)", str(ended.value)
    )
    assert path.read_bytes() == b"the last good one"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("path", "why"),
    [
        ("x" * 300, "File name too long"),
        ("file/t", "its folder is a file"),
        (".", "name of a file"),
        ("..", "name of a file"),
        ("/", "name of a file"),
    ],
)
def test_a_path_that_cannot_be_written_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str, why: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    with pytest.raises(InputError, match=why):
        io.atomically(Path(path), lambda temporary: temporary.write_bytes(b""))
    assert list(tmp_path.iterdir()) == [tmp_path / "file"]


def test_a_file_that_cannot_be_read_while_writing_is_not_an_output_that_cannot_be_written(
    tmp_path: Path,
) -> None:
    with pytest.raises(FileNotFoundError):
        io.atomically(
            tmp_path / "out",
            lambda temporary: temporary.write_bytes((tmp_path / "in").read_bytes()),
        )
    assert list(tmp_path.iterdir()) == []


def only_line(stderr: str) -> str:
    (line,) = stderr.splitlines()
    assert len(line) < 300
    return line


@mounts
def test_a_full_disk_ends_a_stage_in_one_line_and_the_earlier_outputs_stand(
    workspace: Path,
) -> None:
    observed(workspace, "ai2thor", OBSERVED, KINDS)
    (workspace / "data/graph/ai2thor").mkdir(parents=True)
    script = f"""
        mount -t tmpfs -o size=8k tmpfs data/graph/ai2thor
        cd data/graph/ai2thor && echo earlier > entities.parquet && echo earlier > triples.parquet
        cd ../../.. && {shlex.join(BUILD)}; status=$?
        cd data/graph/ai2thor && ls -A && cat * && exit $status
    """
    ended = subprocess.run(
        [*OWN_MOUNTS, "sh", "-c", script], cwd=workspace, capture_output=True, text=True
    )
    refused = "data/graph/ai2thor/entities.parquet: cannot be written (No space left on device"
    assert only_line(ended.stderr) == f"build_graph: {refused}; 0.0 MiB free there)"
    assert ended.returncode == 1
    assert ended.stdout.split() == ["entities.parquet", "triples.parquet", "earlier", "earlier"]


@mounts
def test_a_read_only_folder_ends_a_stage_in_one_line(workspace: Path) -> None:
    leave(workspace, ENTITIES.path(experiment="ai2thor"), TRIPLES.path(experiment="ai2thor"))
    observed(workspace, "ai2thor", OBSERVED, KINDS)
    before = outputs(workspace)
    script = (
        "mount --bind data/graph data/graph && mount -o remount,bind,ro "
        f"data/graph && exec {shlex.join(BUILD)}"
    )
    ended = subprocess.run(
        [*OWN_MOUNTS, "sh", "-c", script], cwd=workspace, capture_output=True, text=True
    )
    assert only_line(ended.stderr).endswith(
        "data/graph/ai2thor/entities.parquet: cannot be written (Read-only file system)"
    )
    assert (ended.returncode, outputs(workspace)) == (1, before)


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ("mine mp3d", "data/observations/mp3d.parquet"),  # a stream of tables
        ("embed_words ai2thor", "data/words/ai2thor/vectors.safetensors"),
    ],
)
def test_a_file_that_may_not_grow_ends_a_stage_in_one_line_and_the_earlier_outputs_stand(
    workspace: Path, command: str, named: str
) -> None:
    observed(workspace, "ai2thor", OBSERVED, KINDS)
    write(workspace, ENTITIES.path(experiment="ai2thor"), KINDS.assign(source="ai2thor"), ENTITIES)
    leave(workspace, Path(named))
    before = outputs(workspace)
    ended = subprocess.run(
        [sys.executable, "-m", *f"stages.{command}".split()],
        cwd=workspace,
        capture_output=True,
        text=True,
        # a file of bytecode would be cut, too, and break later tests
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        preexec_fn=partial(resource.setrlimit, resource.RLIMIT_FSIZE, (1000, 1000)),
    )
    expected = rf"{named}: cannot be written \(File too large; \d+\.\d [GM]iB free there\)"
    assert re.search(expected, only_line(ended.stderr)), ended.stderr
    assert (ended.returncode, outputs(workspace)) == (1, before)


def test_a_slow_reader_of_a_pipe_that_does_not_block_gets_all() -> None:
    code = "from isi.process import errors_in_one_line as e\nwith e('x'): print('a' * 10**6)"
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with subprocess.Popen([sys.executable, "-c", code], stdout=writer) as process:
        os.close(writer)
        with os.fdopen(reader, "rb") as pipe:
            time.sleep(0.5)  # the pipe is full by then
            assert len(pipe.read()) == 10**6 + 1
    assert process.returncode == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_output_that_nobody_takes_ends_a_stage_in_at_most_one_line(workspace: Path) -> None:
    observed(workspace, "ai2thor", OBSERVED, KINDS)
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(BUILD, cwd=workspace, stdout=full, stderr=subprocess.PIPE, text=True)
    line = only_line(ended.stderr)
    assert line.startswith("build_graph: standard output")
    assert "No space left on device" in line
    assert ended.returncode == 1
    reader, writer = os.pipe()
    os.close(reader)
    ended = subprocess.run(BUILD, cwd=workspace, stdout=writer, stderr=subprocess.PIPE, text=True)
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (141, "")
