"""A stage that is called by hand is known to DVC as one that it runs: neither takes the other's files away."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from isi.errors import InputError
from isi.pipeline import Maker, dependencies, outputs
from isi.process import LOCKS
from isi.tables import paths

#: What DVC tells the stages that it runs.
RUN_BY_DVC = "DVC_STAGE"


@contextmanager
def noted(by: Maker) -> Iterator[None]:
    """Hold what a stage reads and writes, in DVC's own notes of that, unless DVC runs it and has done so.

    DVC forgets the notes of a process that has ended. Where it is not there, or has never run, nothing is held.

    Raises:
        InputError: where DVC, or another stage that was called by hand, writes what is read or uses what is written.
    """
    with ExitStack() as held:
        if RUN_BY_DVC not in os.environ and LOCKS.is_dir():
            with suppress(ImportError):
                _hold(by, held)
        yield


def _hold(by: Maker, held: ExitStack) -> None:
    from dvc.exceptions import DvcException  # here, since it takes a while, and most runs are DVC's
    from dvc.fs import localfs
    from dvc.rwlock import rwlock

    reads, writes = ([str(Path(path).absolute()) for path in listed] for listed in (dependencies(by), outputs(by)))
    data = [path for path in reads if Path(path).is_relative_to(paths.DATA.absolute())]
    command = f"{Path(sys.executable).name} -m stages.{' '.join([by.stage, *by.arguments.values()])}"
    try:
        held.enter_context(rwlock(str(LOCKS.absolute()), localfs, command, data, writes, False))
    except DvcException as error:
        raise InputError("", "", _said(str(error))) from error


def _said(busy: str) -> str:
    """In one line, what DVC says."""
    path, holder = re.search(r"'(.+)' is busy", busy), re.search(r"\(PID (\d+)\): (.+)", busy)
    if not (path and holder):
        return f"{LOCKS}: DVC cannot note what is in use ({busy}): `rm {LOCKS / 'rwlock'}`"
    name = Path(os.path.relpath(path[1]))
    return f"{name} is in use by process {holder[1]} ({holder[2]}): let it end, or stop it"
