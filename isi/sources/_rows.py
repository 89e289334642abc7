"""Rows of CSV, TSV and Parquet files, one by one, each with its place."""

from __future__ import annotations

import csv
import gzip
import re
import zlib
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import pyarrow as pa
import pyarrow.parquet as pq

from isi.base.errors import InputError

#: Rows of a Parquet file that are read at once.
BATCH = 65_536
#: Characters of a line that are read at once: what is longer has a field that the CSV reader refuses.
LINE = 2**20
#: Characters of a file that is read as a whole, at most.
MOST = 2**26
#: Name of the column of whole numbers; the others hold text.
COUNT = "count"
LARGEST = 2**31 - 1

SEPARATORS = {".csv": ",", ".tsv": "\t"}
UNREADABLE = (OSError, EOFError, UnicodeDecodeError, csv.Error, zlib.error, pa.ArrowException)


class Row(NamedTuple):
    """Values of a row, in the order of the columns that were asked for.

    Empty where it has none, null where the file has no such column.
    """

    path: Path
    place: str
    values: Sequence[Any]

    def error(self, expected: str) -> InputError:
        return InputError(self.path, self.place, expected)


def read_rows(path: Path, required: Sequence[str], optional: Sequence[str]) -> Iterator[Row]:
    """Rows of a file whose name ends in ``.csv`` or ``.tsv``, either with ``.gz`` behind it, or ``.parquet``.

    Args:
        path: of the file; text is UTF-8, its first line names the columns.
        required: columns that it must have.
        optional: columns that it may have; it must have no others.

    Raises:
        InputError: where the file is missing or broken, or has other columns; a value of ``COUNT`` is no number.
    """
    columns = [*required, *optional]
    form = form_of(path)
    if form in SEPARATORS:
        rows = _of_text(path, SEPARATORS[form], required, columns)
    elif form == ".parquet":
        rows = _of_parquet(path, required, columns)
    else:
        raise InputError(path, "", "expected a name that ends in .csv, .tsv (.gz behind it or not) or .parquet")
    if COUNT not in columns:
        return rows
    return map(partial(_counted, columns.index(COUNT)), rows)


def printable(text: str) -> str:
    """The beginning of what another library says, without control characters of the text that it says it of."""
    return "".join(character if character.isprintable() else "?" for character in text[:120])


def form_of(path: Path) -> str:
    """How the name of a file ends, compressed or not: ``.csv`` of ``log.csv.gz``."""
    return Path(path.stem).suffix if path.suffix == ".gz" else path.suffix


def open_text(path: Path) -> TextIO:
    """Open a text file, which may be compressed."""
    if path.suffix == ".gz":
        return gzip.open(path, "rt", encoding="utf-8-sig", newline="")
    return path.open(encoding="utf-8-sig", newline="")


def read_text(path: Path, what: str) -> str:
    """All of a text file, which may be compressed.

    Raises:
        InputError: where it is missing, no UTF-8, broken, or longer than ``MOST``; ``what`` is what was expected.
    """
    try:
        with open_text(path) as file:
            text = file.read(MOST + 1)
    except UNREADABLE as error:
        raise InputError(path, "", f"expected {what} in UTF-8 ({error})") from error
    if len(text) > MOST:
        raise InputError(path, "", f"expected {what} of at most {MOST:,} characters, got more")
    return text


def _of_text(path: Path, separator: str, required: Sequence[str], columns: Sequence[str]) -> Iterator[Row]:
    line = 0
    try:
        with open_text(path) as file:
            lines = iter(partial(file.readline, LINE), "")
            reader = csv.reader(lines, delimiter=separator, strict=True, skipinitialspace=True)
            header = next(reader, [])
            places = _places(path, "line 1", header, required, columns)
            line = reader.line_num
            for fields in reader:
                line = reader.line_num
                if len(fields) == len(header):
                    yield Row(path, f"line {line}", [None if p is None else fields[p] for p in places])
                elif fields:
                    raise InputError(path, f"line {line}", f"expected {len(header)} fields, got {len(fields)}")
    except UNREADABLE as error:
        place = "" if isinstance(error, FileNotFoundError | PermissionError) else f"line {line + 1}"
        raise InputError(path, place, f"expected a table of UTF-8 text ({printable(str(error))})") from error


def _of_parquet(path: Path, required: Sequence[str], columns: Sequence[str]) -> Iterator[Row]:
    number = 0
    try:
        with pq.ParquetFile(path) as file:
            header = file.schema_arrow.names
            places = _places(path, "columns", header, required, columns)
            for name in header:
                _check_type(path, name, file.schema_arrow.field(name).type)
            for batch in file.iter_batches(BATCH):
                for fields in zip(*(column.to_pylist() for column in batch.columns), strict=True):
                    number += 1
                    values = [None if p is None else "" if fields[p] is None else fields[p] for p in places]
                    yield Row(path, f"row {number}", values)
    except UNREADABLE as error:
        place = f"row {number + 1}" if number else ""
        raise InputError(path, place, f"expected a Parquet table ({printable(str(error))})") from error


def _places(
    path: Path, place: str, header: Sequence[str], required: Sequence[str], columns: Sequence[str]
) -> list[int | None]:
    """Where each column stands."""
    listed = [name[:40] for name in header]
    may = [name for name in columns if name not in required]
    expected = f"expected the columns {', '.join(required)}" + f" and, if at all, {', '.join(may)}" * bool(may)
    if not set(required) <= set(listed) <= set(columns) or len(set(listed)) < len(listed):
        raise InputError(path, place, f"{expected}; got {', '.join(map(repr, listed[:12])) or 'none'}")
    return [listed.index(name) if name in listed else None for name in columns]


def _check_type(path: Path, column: str, kind: pa.DataType) -> None:
    plain = kind.value_type if pa.types.is_dictionary(kind) else kind
    if column == COUNT:
        right, expected = pa.types.is_integer(plain), "whole numbers"
    else:
        right, expected = pa.types.is_string(plain) or pa.types.is_large_string(plain), "text"
    if not right:
        raise InputError(path, f"column {column!r}", f"expected {expected}, got {kind}")


def _counted(place: int, row: Row) -> Row:
    """The row with its count as a number; null where it has none."""
    given = row.values[place]
    if given is None:
        return row
    if isinstance(given, str) and not re.fullmatch(r"[0-9]{1,10}", given):
        raise row.error(f"expected a whole number as count, got {given[:40]!r}")
    if not 1 <= int(given) <= LARGEST:
        raise row.error(f"expected a count from 1 to {LARGEST}, got {given}")
    values = [*row.values]
    values[place] = int(given)
    return row._replace(values=values)
