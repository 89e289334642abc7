"""Mistakes in command lines and in arguments of the library, and the places that the message must name."""

import gzip
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from isi.tables import paths
from tests.mistakes import LOG
from tests.small_bundle import without_words, written
from tools.workspace import change_all

ROOT = Path(__file__).parents[2]


def nothing() -> None:
    """What most mistakes need to be made before."""


@dataclass(frozen=True)
class Typed:
    """A mistake in what is typed, or in what a command finds."""

    what: str
    typed: str  #: behind the name of the program, as in a shell
    names: str  #: parts that the message names, with | between them
    before: Callable[[], object] = nothing  #: what is done before, in the folder where it is typed
    status: int = 1  #: with which the command ends
    needs: str = ""  #: a package that it takes to make the mistake


@dataclass(frozen=True)
class Called:
    """A mistake in an argument of the library."""

    what: str
    given: dict[str, Any] | Callable[[], dict[str, Any]]  #: in place of what is sound; a function if it is slow to make
    names: str  #: parts that the message names, with | between them


def put(**files: str | bytes) -> Callable[[], object]:
    """Write files; ``__`` in a name stands for the dot before its ending."""

    def write() -> None:
        for name, content in files.items():
            path = Path(name.replace("__", "."))
            path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogateescape"))

    return write


def params(changes: dict[str, Any]) -> Callable[[], object]:
    """The params that ship, changed at dotted keys."""

    def write() -> None:
        values = yaml.load(paths.PARAMS.read_text(encoding="utf-8"), yaml.CSafeLoader)
        change_all(values, changes)
        paths.PARAMS.write_text(yaml.dump(values, Dumper=yaml.CSafeDumper, sort_keys=False), encoding="utf-8")

    return write


def lay_out(folder: Path) -> Path:
    """Where commands are typed: params, what ships, an embedding without words, and a log of one triple."""
    for path in (paths.PARAMS, paths.BEYOND_PARAMS, paths.PIPELINE, paths.BEYOND_PIPELINE):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / path, folder / path)
    (folder / paths.DATA).mkdir()
    (folder / paths.RAW).symlink_to(ROOT / paths.RAW)
    (folder / "log.csv").write_text(LOG, encoding="utf-8")
    written(folder / "home", without_words())
    return folder


def packed(columns: str, *rows: str) -> bytes:
    """A table as PyKEEN compresses it."""
    return gzip.compress("".join(f"{row}\n" for row in (columns, *rows)).encode())
