"""Mistakes in files that readers mine: the faulty content,
and the places that the message must name.
"""

import gzip
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from isi.sources.recordings import FORMAT
from tools.fuzz import formats
from tools.fuzz.formats import THINGS, Files

LOG = "head,relation,tail\nmug,atLocation,kitchen\n"
LONG = "x" * 10_000


@dataclass(frozen=True)
class Case:
    """A mistake in files of a format."""

    what: str
    #: the format (``tools.fuzz.formats``) whose valid files are changed
    format: str
    #: new contents by name of the file; None: the file is missing
    files: dict[str, str | bytes | None]
    #: texts that the message must contain, such as the file and the line, separated by |
    names: str
    #: changed settings in the section of params
    settings: dict[str, Any] = field(default_factory=dict)


def of_file(format: str, file: str) -> Callable[..., Case]:
    """A function that makes cases of one file, from a title, the file's content,
    and texts of the message.
    """

    def case(
        what: str,
        content: str | bytes | None,
        names: str = "",
        settings: dict[str, Any] | None = None,
    ) -> Case:
        return Case(what, format, {file: content}, f"{file}|{names}", settings or {})

    return case


def recording(*lines: object) -> bytes:
    """A recording in the format of ``make record``; lines that are text are written unchanged."""
    return gzip.compress(
        "\n".join(
            one if isinstance(one, str) else json.dumps(one) for one in (FORMAT, *lines)
        ).encode()
    )


#: A scene in a recording.
SPAWNED = {"scene": "FloorPlan1", "spawn": None, "objects": THINGS}


def log(what: str, rows: str, names: str, **settings: object) -> Case:
    """A case with a mistake in a table of triples."""
    return Case(
        what, "table, CSV", {"log.csv": rows}, f"log.csv|{names}", {"entities": None, **settings}
    )


def replaced(text: str, changes: dict[str, str]) -> str:
    """A text in which the first place of each key has the value."""
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new, 1)
    return text


def with_values(name: str, content: bytes, values: dict[str, Any]) -> bytes:
    """A file of JSON, or of a line of JSON for each object, with other values at dotted keys; the
    index behind the last one of a list appends.
    """
    text = (gzip.decompress(content) if name.endswith(".gz") else content).decode()
    has_lines = ".jsonl" in name
    tree = list(map(json.loads, text.splitlines())) if has_lines else json.loads(text)
    for key, value in values.items():
        *parents, last = (int(step) if step.isdigit() else step for step in key.split("."))
        part = tree
        for step in parents:
            part = part[step]
        if isinstance(part, list) and last == len(part):
            part.append(value)
        else:
            part[last] = value
    text = "\n".join(map(json.dumps, tree)) if has_lines else json.dumps(tree)
    return gzip.compress(text.encode()) if name.endswith(".gz") else text.encode()


def listed() -> list[Case]:
    """The cases of `files.yaml`."""
    cases = []
    by_format = yaml.safe_load((Path(__file__).parent / "files.yaml").read_text(encoding="utf-8"))
    for form, mistakes in by_format.items():
        valid = formats.FORMATS[form].files
        for mistake in mistakes:
            files: dict[str, str | bytes | None] = {
                name: replaced(valid[name].decode(), new) if isinstance(new, dict) else new
                for name, new in mistake.get("files", {}).items()
            }
            for name, values in mistake.get("json", {}).items():
                files[name] = with_values(name, valid[name], values)
            settings = mistake.get("settings", {})
            cases.append(Case(mistake["what"], form, files, mistake["says"], settings))
    return cases


def vectors(what: str, content: bytes, names: str, binary: bool = False) -> Case:
    """A case with a mistake in a file of word vectors."""
    name = "words.bin" if binary else "words.txt"
    return Case(what, f"words{', binary' * binary}", {name: content}, f"{name}|{names}")


def files_of(case: Case) -> Files:
    """All files of a case: the valid ones of its format, with its changes."""
    files: Files = dict(formats.FORMATS[case.format].files)
    for name, content in case.files.items():
        files.pop(name, None)
        if content is not None:
            files[name] = (
                content
                if isinstance(content, bytes)
                else content.encode("utf-8", "surrogateescape")
            )
    return files


def assert_names(line: str, names: str) -> None:
    """Check that a message is one printable line under 300 characters with these texts
    and at least one more word.
    """
    assert len(line) < 300
    assert line.isprintable()
    missing = [name for name in filter(None, names.split("|")) if name not in line]
    assert not missing, f"{missing} not named in: {line}"
    assert len(line.split()) > 1
