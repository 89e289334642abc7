"""Another process that has a home open, to write or to read alone."""

import os
import signal
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import isi
from isi.errors import InputError
from isi.home.database import Database
from isi.home.folder import trained
from isi.home.home import Home
from isi.process import tie_to_parent

#: What is known of a fact that holds.
Known = tuple[int, float | None, str | None, str | None, str | None]


def known(home: Home) -> tuple[dict[Any, Known], list[str]]:
    """What a home knows of each fact that holds, and the inserted entities."""
    facts = {
        row.fact: (row.count, row.confidence, row.first_seen, row.last_seen, row.source)
        for row in home.facts()
    }
    return facts, sorted(home.inserted)


def open_quickly(folder: Path) -> Home:
    """A home that is not lost with its process, but with the machine."""
    home = isi.open(folder)
    home.database.execute("PRAGMA synchronous = OFF")
    return home


def read_alone(folder: Path) -> Home:
    """A home as one opens it that may not write its files."""
    database = Database(folder, "you may not write it")
    return Home(trained(database), database)


class Beside:
    """A fork that opens a home, and does what it is asked."""

    def __init__(self, folder: Path, may_write: bool = True) -> None:
        self._asks, answers = Pipe()
        self._process = os.fork()
        if not self._process:
            try:
                tie_to_parent()
                _serve(answers, partial(open_quickly if may_write else read_alone, folder))
            finally:
                os._exit(1)
        answers.close()
        assert self("known")

    def __call__(self, verb: str, *args: Any, **kwargs: Any) -> Any:
        """What a verb of the home gave; raises its ``InputError``."""
        self._asks.send((verb, args, kwargs))
        answer = self._asks.recv()
        if isinstance(answer, InputError):
            raise answer
        return answer

    def end(self, cause: signal.Signals = signal.SIGKILL) -> None:
        """Kill it."""
        os.kill(self._process, cause)
        os.waitpid(self._process, 0)
        self._asks.close()


def _serve(answers: Any, opened: Callable[[], Home]) -> None:
    home = opened()
    with suppress(EOFError):
        while True:
            verb, args, kwargs = answers.recv()
            answer: Any
            try:
                answer = known(home) if verb == "known" else getattr(home, verb)(*args, **kwargs)
            except InputError as error:
                answer = error
            answers.send(answer)
