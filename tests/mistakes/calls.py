"""Mistakes in command lines and in arguments of the library,
and the places that the message must name.
"""

import gzip
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from isi.tables import paths
from stages.pipeline import BEYOND_PARAMS, BEYOND_PIPELINE, PIPELINE
from tests.mistakes import LOG
from tests.small_bundle import home_of, without_words
from tools.workspace import change_all

ROOT = Path(__file__).parents[2]


def nothing() -> None:
    """Do nothing: the default of ``Typed.before``."""


@dataclass(frozen=True)
class Typed:
    """A mistake in a command line, or in the files that the command reads."""

    what: str
    typed: str  #: the arguments, as in a shell
    names: str  #: parts that the message names, with | between them
    before: Callable[[], object] = nothing  #: a call before the command, in its folder
    status: int = 1  #: exit status of the command


@dataclass(frozen=True)
class Called:
    """A mistake in an argument of the library."""

    what: str
    #: replace valid arguments; a function if slow to make
    given: dict[str, Any] | Callable[[], dict[str, Any]]
    names: str  #: parts that the message names, with | between them


def put(
    files: Mapping[str, str | bytes | None], before: Callable[[], object] = nothing
) -> Callable[[], object]:
    """A function that calls ``before`` and writes files, some of them compressed;
    None: the file is missing.
    """

    def write() -> None:
        before()
        for name, content in files.items():
            if content is None:
                Path(name).unlink()
                continue
            Path(name).parent.mkdir(parents=True, exist_ok=True)
            encoded = content if isinstance(content, bytes) else content.encode()
            Path(name).write_bytes(gzip.compress(encoded) if name.endswith(".gz") else encoded)

    return write


def params(
    changes: dict[str, Any], path: Path = paths.PARAMS, before: Callable[[], object] = nothing
) -> Callable[[], object]:
    """A function that calls ``before`` and writes the shipped params with values changed at dotted
    keys.
    """

    def write() -> None:
        before()
        values = yaml.load(path.read_text(encoding="utf-8"), yaml.CSafeLoader)
        change_all(values, changes)
        text = yaml.dump(values, Dumper=yaml.CSafeDumper, sort_keys=False)
        path.write_text(text, encoding="utf-8")

    return write


def listed(**functions: Callable[[], object]) -> dict[str, list[Typed]]:
    """The cases of `commands.yaml` by program; ``functions``: those that `before` names."""
    text = (Path(__file__).parent / "commands.yaml").read_text(encoding="utf-8")
    programs: dict[str, list[Typed]] = {}
    for program, mistakes in yaml.safe_load(text).items():
        programs[program] = []
        for mistake in mistakes:
            typed = mistake["typed"]
            before = functions.get(mistake.get("before", ""), nothing)
            if "files" in mistake:
                before = put(mistake["files"], before)
            for name, path in (("params", paths.PARAMS), ("beyond", BEYOND_PARAMS)):
                if name in mistake:
                    before = params(mistake[name], path, before)
            about, status = mistake.get("what", typed), mistake.get("status", 1)
            programs[program].append(Typed(about, typed, mistake["says"], before, status))
    return programs


def called(function: str) -> list[Called]:
    """The cases of `calls.yaml` of a function."""
    text = (Path(__file__).parent / "calls.yaml").read_text(encoding="utf-8")
    cases = yaml.safe_load(text)[function]
    return [Called(case["what"], case["given"], case["says"]) for case in cases]


def lay_out(folder: Path) -> Path:
    """Write the folder of commands: params, shipped data, an embedding without word vectors,
    a log of one triple.
    """
    for path in (paths.PARAMS, BEYOND_PARAMS, PIPELINE, BEYOND_PIPELINE):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / path, folder / path)
    (folder / paths.DATA).mkdir()
    (folder / paths.RAW).symlink_to(ROOT / paths.RAW)
    (folder / "log.csv").write_text(LOG, encoding="utf-8")
    home_of(folder / "home", without_words())
    return folder


def packed(columns: str, *rows: str) -> bytes:
    """A compressed table in PyKEEN's format."""
    return gzip.compress("".join(f"{row}\n" for row in (columns, *rows)).encode())
