"""Tables of names as TSV: a header, then a row a line; nothing is quoted, so that no name may break lines or cells."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Sequence
from pathlib import Path

from isi.base.errors import InputError

#: Categories of characters that break lines or cells, do something to a terminal, or are no text.
HOSTILE = frozenset({"Cc", "Cs", "Zl", "Zp"})


def fault(name: str) -> str | None:
    """What is wrong with a name; null where nothing is."""
    if not name.strip():
        return "expected a name, got none"
    return cell_fault(name)


def cell_fault(text: str) -> str | None:
    """What is wrong with a cell; null where nothing is."""
    if not text.isprintable() and any(unicodedata.category(character) in HOSTILE for character in text):
        return f"expected text without tabs, line breaks or other control characters, got {text[:80]!r}"
    return None


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> bytes:
    """A table as TSV in UTF-8."""
    return "".join("\t".join(row) + "\n" for row in [columns, *rows]).encode()


def read_rows(path: Path, content: bytes, columns: Sequence[str]) -> list[list[str]]:
    """Rows of a table, without its header.

    Raises:
        InputError: naming the line that is broken.
    """
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(path, f"line {line}", "expected UTF-8 text") from error
    header, *lines = (text.removesuffix("\n")).split("\n")
    if header.split("\t") != list(columns):
        raise InputError(path, "line 1", f"expected the columns {', '.join(columns)}, got {header[:80]!r}")
    rows = [line.split("\t") for line in lines]
    for number, row in enumerate(rows, 2):
        if len(row) != len(columns):
            raise InputError(path, f"line {number}", f"expected {len(columns)} columns, got {len(row)}")
        wrong = next(filter(None, map(cell_fault, row)), None)
        if wrong:
            raise InputError(path, f"line {number}", wrong)
    return rows


def distinct_names(path: Path, names: Sequence[str], first: int = 2) -> dict[str, int]:
    """Rows by name.

    Args:
        first: line of the first.

    Raises:
        InputError: naming the line of a name that is none, or is there for the second time.
    """
    found: dict[str, int] = {}
    for row, name in enumerate(names):
        wrong = fault(name)
        if wrong or found.setdefault(name, row) != row:
            raise InputError(
                path, f"line {row + first}", wrong or f"expected names that do not repeat, got {name!r:.80}"
            )
    return found
