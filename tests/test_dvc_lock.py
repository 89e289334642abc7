"""What DVC and stages that are called by hand know of each other."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from isi.dvc_lock import RUN_BY_DVC, noted
from isi.errors import InputError
from isi.pipeline import called
from isi.process import LOCKS
from tests.environment import ENVIRONMENT

ROOT = Path(__file__).parent.parent
#: Calls a stage by hand, which lasts until a file is there.
BY_HAND = """
import sys, time
from pathlib import Path
from isi.dvc_lock import noted
from isi.pipeline import called

with noted(called(sys.argv[1], {})):
    Path("begun").touch()
    while not Path("end").exists():
        time.sleep(0.02)
"""
PIPELINE = """
stages:
  make:
    cmd: touch begun; while [ ! -e end ]; do sleep 0.02; done; echo new > data/made
    deps: [data/given]
    outs: [data/made]
  make_other:
    cmd: echo other > data/other
    deps: [data/given]
    outs: [data/other]
  give:
    cmd: echo given > data/given
    outs: [data/given]
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A pipeline, of which an earlier run has left an output."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(RUN_BY_DVC, raising=False)
    subprocess.run([sys.executable, "-m", "dvc", "init", "--no-scm", "-q"], check=True, env=ENVIRONMENT)
    LOCKS.mkdir(exist_ok=True)
    (tmp_path / "data").mkdir()
    for name in ("params.yaml", "data/given", "data/made"):
        (tmp_path / name).write_text("{}\n", encoding="utf-8")
    (tmp_path / "dvc.yaml").write_text(PIPELINE, encoding="utf-8")
    return tmp_path


@contextmanager
def begun(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    """A command that has begun its work, and is let end."""
    with subprocess.Popen(command, env=ENVIRONMENT | {"PYTHONPATH": str(ROOT)}, stdout=subprocess.DEVNULL) as process:
        while not Path("begun").exists() and process.poll() is None:
            time.sleep(0.02)
        yield process
        Path("end").touch()


def by_hand(stage: str) -> tuple[str, ...]:
    return sys.executable, "-c", BY_HAND, stage


def dvc(stage: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "dvc", "repro", "--single-item", stage]
    return subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT)


def test_dvc_leaves_what_a_stage_that_was_called_by_hand_works_on(folder: Path) -> None:
    with begun(*by_hand("make")) as stage:
        for one, path in (("make", "data/made"), ("give", "data/given")):
            refused = dvc(one)
            assert refused.returncode
            assert f"'{folder / path}' is busy" in refused.stderr
            assert f"(PID {stage.pid})" in refused.stderr
            assert (folder / path).exists()
        assert dvc("make_other").returncode == 0  # which reads the same
    assert dvc("make").returncode == 0


def test_a_stage_that_is_called_by_hand_leaves_what_dvc_or_another_works_on() -> None:
    for command, who in (
        ((sys.executable, "-m", "dvc", "repro", "--single-item", "make"), "dvc"), (by_hand("make"), "stages.make")
    ):  # fmt: skip
        with begun(*command) as process:
            for one, path in (("make", "data/made"), ("give", "data/given")):
                with (
                    pytest.raises(
                        InputError, match=rf"^{path} is in use by process {process.pid} \(.*{who}.*\): let it end"
                    ),
                    noted(called(one, {})),
                ):
                    raise AssertionError("it began")
            with noted(called("make_other", {})):
                pass
        assert process.returncode == 0
        for name in ("begun", "end"):
            Path(name).unlink()


def test_who_has_ended_is_in_nobodys_way() -> None:
    with begun(*by_hand("make")) as process:
        process.kill()
        process.wait()
    with noted(called("make", {})):
        pass
    with pytest.raises(KeyError), noted(called("make", {})):
        raise KeyError
    assert dvc("make").returncode == 0


@pytest.mark.parametrize(
    "change",
    [lambda: os.environ.update({RUN_BY_DVC: "make"}), lambda: LOCKS.rename("elsewhere")],
    ids=["run by DVC", "no DVC"],
)
def test_nothing_is_noted_where_dvc_has_done_so_or_is_not_there(
    change: Callable[[], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(RUN_BY_DVC, "")
    monkeypatch.delenv(RUN_BY_DVC)
    change()
    with noted(called("make", {})):
        assert not (LOCKS / "rwlock").exists()


def test_notes_that_are_broken_are_told_in_one_line() -> None:
    (LOCKS / "rwlock").write_text("{", encoding="utf-8")
    says = r"\.dvc/tmp: DVC cannot note what is in use \(Unable to read RWLock-file"
    with pytest.raises(InputError, match=says), noted(called("make", {})):
        raise AssertionError("it began")
