"""Run ``dvc repro``, and print the number of the running stage, the total,
and an estimate of the minutes left.
"""

import fcntl
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path

if not (find_spec("dvc") and find_spec("isi")):
    sys.exit(
        f"repro: {sys.executable} lacks DVC or this project: use `make repro`, "
        "or activate .venv first"
    )

from isi.errors import InputError
from isi.process import errors_in_one_line, tie_to_parent

#: Seconds of the last run of each stage in this folder; stages without one take those of
#: ``SHIPPED``.
HERE = Path(".dvc/tmp/stage_seconds.json")
#: DVC's file of read and write locks: which process uses which path.
NOTES = Path(".dvc/tmp/rwlock")
ROOT = Path(__file__).parent.parent
SHIPPED = ROOT / "docs" / "benchmarks" / "stage_seconds.json"
PIPELINES = (Path("dvc.yaml"), Path("beyond/dvc.yaml"))
#: The lines in which DVC begins or skips a stage; the name follows the pipeline file, unless that
#: is ./dvc.yaml.
BEGINS = re.compile(
    r"^Running stage '(?:\S+:)?(?P<stage>[^':]+)'|^Stage "
    r"'(?:\S+:)?(?P<same>[^':]+)' (didn't change|is cached)"
)


class Progress:
    """Progress of a run: the number of stages seen, the stages still to come,
    and the seconds of each stage.
    """

    def __init__(self, stages: list[str], seconds: dict[str, float]) -> None:
        self.seen, self.waiting, self.seconds = 0, set(stages), seconds
        self.start, self.running, self.since = time.monotonic(), "", 0.0

    def begin(self, stage: str, runs: bool) -> str | None:
        """Record that a stage begins (``runs``) or is skipped;
        returns a line of progress if it begins, else None.
        """
        self.end()
        self.seen += 1
        self.waiting.discard(stage)
        if not runs:
            return None
        self.running, self.since = stage, time.monotonic()
        left = sum(self.seconds.get(name, 0) for name in [stage, *self.waiting]) / 60
        about = f"; at most about {left:.0f} min left" if left >= 1 else ""
        gone = (self.since - self.start) / 60
        return f"[{self.seen} of {self.seen + len(self.waiting)}; {gone:.0f} min gone{about}]"

    def end(self) -> None:
        """Record the seconds of the stage that ran, if any."""
        if self.running:
            self.seconds[self.running] = round(time.monotonic() - self.since, 1)
        self.running = ""


def main(arguments: list[str]) -> int:
    """Run ``dvc repro`` with the arguments, and print its output with lines of progress;
    returns its exit status.
    """
    known = {**(_read(SHIPPED) if Path.cwd() == ROOT else {}), **_read(HERE)}
    files = {argument.partition(":")[0] for argument in arguments}
    pipeline = next((path for path in PIPELINES if str(path) in files), PIPELINES[0])
    allow_no_git()
    lock = LockFile(pipeline.with_name("dvc.lock"))
    lock.mend()
    mend_notes()
    progress = Progress(wanted(stages(pipeline), arguments), known)
    try:
        return run([sys.executable, "-m", "dvc", "repro", *arguments], progress, lock)
    finally:
        lock.mend()
        # reading the stages of a pipeline that never ran takes seconds
        locked = [path for path in PIPELINES if path.with_name("dvc.lock").exists()]
        names = {name for path in {pipeline, *locked} for name in stages(path)}
        with suppress(OSError):  # no space on the disk
            seconds = {name: took for name, took in progress.seconds.items() if name in names}
            HERE.write_text(json.dumps(seconds, indent=1, sort_keys=True), encoding="utf-8")


def allow_no_git() -> None:
    """Tell DVC, in its local configuration, if this folder is in no git repository;
    otherwise it refuses to run.
    """
    here = Path.cwd()
    if any((folder / ".git").exists() for folder in (here, *here.parents)):
        return
    from dvc.config import Config  # here, since it is slow to import

    config = Config(".dvc")
    if not config["core"]["no_scm"]:
        with config.edit("local") as local:
            local["core"]["no_scm"] = True
        print(
            (
                "repro: no git repository: `dvc exp` and `dvc ... "
                "diff` cannot run here (docs/reproduce.md)"
            ),
            flush=True,
        )


class LockFile:
    """A dvc.lock with a backup: DVC writes it in place,
    so the file is broken if DVC is stopped during a write.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._copy = path, HERE.with_name("_".join([*path.parts, "whole"]))

    def back_up(self) -> None:
        """Copy the file while DVC does not write it; the copy of a missing file is empty."""
        with suppress(OSError):  # no space on the disk
            self._copy.write_bytes(self.path.read_bytes() if self.path.exists() else b"")

    def mend(self) -> None:
        """Replace a broken lock file by its copy (remove it if the copy is empty),
        and delete the copy.
        """
        if self._copy.exists() and self.path.exists() and not self._is_whole():
            self._copy.replace(self.path)
            if not self.path.stat().st_size:
                self.path.unlink()
            print(
                (
                    f"repro: {self.path} was cut short when DVC ended: "
                    "restored as before the last stage"
                ),
                flush=True,
            )
        self._copy.unlink(missing_ok=True)

    def _is_whole(self) -> bool:
        from dvc.schema import COMPILED_LOCKFILE_SCHEMA  # here, since both imports are slow
        from dvc.utils.serialize import load_yaml

        # DVC removes no stage
        if not set(_stage_names(self._copy)) <= set(_stage_names(self.path)):
            return False
        with suppress(Exception):  # any error: the file is broken
            COMPILED_LOCKFILE_SCHEMA(load_yaml(self.path))
            return True
        return False


def mend_notes(path: Path = NOTES) -> None:
    """Remove DVC's file of locks if it is broken, since DVC would refuse to run.

    The file is removed only if it stays broken for a second, since another DVC may be writing it.
    """
    with suppress(FileNotFoundError):
        for _ in range(10):
            try:
                json.loads(path.read_text(encoding="utf-8"))
                return
            except ValueError:
                time.sleep(0.1)
        path.unlink()


def run(command: list[str], progress: Progress, lock: LockFile) -> int:
    """Run DVC in its own process group: Ctrl-C reaches this process alone,
    which then ends DVC and its stage.
    """
    tied = partial(tie_to_parent, os.getpid()) if sys.platform == "linux" else None
    piped = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "text": True, "bufsize": 1}
    with subprocess.Popen(command, process_group=0, preexec_fn=tied, **piped) as dvc:
        try:
            for line in dvc.stdout or ():
                match = BEGINS.match(line)
                if match and match["stage"]:
                    lock.back_up()
                progress_line = (
                    progress.begin(match["stage"] or match["same"], bool(match["stage"]))
                    if match
                    else None
                )
                print(*filter(None, [progress_line, line]), sep="\n", end="", flush=True)
        except BaseException:
            dvc.terminate()
            raise
    if not dvc.returncode:
        progress.end()
    return dvc.returncode


@contextmanager
def alone() -> Iterator[None]:
    """Lock this folder; InputError if another run holds the lock.
    The system releases it when the process ends.
    """
    HERE.parent.mkdir(parents=True, exist_ok=True)
    with (HERE.parent / "isi.repro").open("a+", encoding="ascii") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            file.seek(0)
            raise InputError(
                "", "", f"runs already in this folder (process {file.read(20).strip()})"
            ) from error
        file.truncate(0)
        print(os.getpid(), file=file, flush=True)
        yield


def stages(pipeline: Path) -> list[str]:
    """Names of a pipeline's stages, from its lock file, which is quick to read,
    or else from DVC.
    """
    lock = pipeline.with_name("dvc.lock")
    if lock.exists():
        return _stage_names(lock)
    from dvc.repo import Repo  # here, since it takes seconds to import

    path = str(pipeline.resolve())
    return [
        stage.addressing.rpartition(":")[2] for stage in Repo().index.stages if stage.path == path
    ]


def wanted(names: list[str], arguments: list[str]) -> list[str]:
    """The stages among names that targets such as ``beyond/dvc.yaml:explore@behavior`` name;
    without such targets, all.
    """
    targets = {target for argument in arguments if (target := argument.partition(":")[2])}
    return [name for name in names if not targets or {name, name.partition("@")[0]} & targets]


def _stage_names(lock: Path) -> list[str]:
    return re.findall(r"^  ([a-z]\S*):$", lock.read_text(encoding="utf-8"), re.MULTILINE)


def _read(path: Path) -> dict[str, float]:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, RecursionError):
        return {}


if __name__ == "__main__":
    if not PIPELINES[0].exists():
        sys.exit(f"repro: {Path.cwd()} has no dvc.yaml: go to the folder of the project first")
    with errors_in_one_line("repro", "the same command goes on from here"), alone():
        sys.exit(main(sys.argv[1:]))
