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

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from isi.errors import InputError, cut, short
from isi.sources._naming import fault
from isi.tables.rules import MOST_OBSERVED

#: Rows of a Parquet file that are read at once.
BATCH = 65_536
#: Characters of a line that are read at once: what is longer has a field that the CSV reader refuses.
LINE = 2**20
#: Characters, and rows, of a file that is read as a whole, at most.
MOST = 2**26
MOST_ROWS = 1_000_000
#: Names of the columns of whole numbers, and of numbers from 0 to 1; the others hold text.
COUNT, SHARE = "count", "share"

SEPARATORS = {".csv": ",", ".tsv": "\t"}
UNREADABLE = (OSError, EOFError, UnicodeDecodeError, csv.Error, zlib.error, pa.ArrowException)


class _Columns(NamedTuple):
    """Which columns a table must have, which it may have, and whether others."""

    required: Sequence[str]
    optional: Sequence[str]
    others: bool

    @property
    def all(self) -> list[str]:
        return [*self.required, *self.optional]

    def places(self, path: Path, place: str, header: Sequence[str]) -> list[int | None]:
        """Where each column stands in a header."""
        listed = [name[:40] for name in header]
        known = [name for name in listed if name in self.all] if self.others else listed
        if not set(self.required) <= set(known) <= set(self.all) or len(set(known)) < len(known):
            expected = f"expected the columns {', '.join(self.required)}"
            expected += f" and, if at all, {', '.join(self.optional)}" * bool(self.optional)
            raise InputError(path, place, f"{expected}; got {cut(', '.join(map(repr, listed)) or 'none', 100)}")
        return [listed.index(name) if name in listed else None for name in self.all]


class Row(NamedTuple):
    """Values of a row, in the order of the columns that were asked for.

    Empty where it has none, null where the file has no such column.
    """

    path: Path
    place: str
    values: Sequence[Any]

    def error(self, expected: str) -> InputError:
        return InputError(self.path, self.place, expected)


def read_rows(path: Path, required: Sequence[str], optional: Sequence[str] = (), others: bool = False) -> Iterator[Row]:
    """Rows of a file whose name ends in ``.csv`` or ``.tsv``, either with ``.gz`` behind it, or ``.parquet``.

    Args:
        path: of the file; text is UTF-8, its first line names the columns.
        required: columns that it must have.
        optional: columns that it may have.
        others: whether it may have others, too, which are skipped.

    Raises:
        InputError: where the file is missing or broken, or has other columns; a value of ``COUNT`` is no number.
    """
    columns = _Columns(required, optional, others)
    form = form_of(path)
    if form in SEPARATORS:
        rows = _of_text(path, SEPARATORS[form], columns)
    elif form == ".parquet":
        rows = _of_parquet(path, columns)
    else:
        raise InputError(path, "", "expected a name that ends in .csv, .tsv (.gz behind it or not) or .parquet")
    if COUNT not in columns.all:
        return rows
    return map(partial(_counted, columns.all.index(COUNT)), rows)


def read_listed(path: Path, columns: Sequence[str], *keys: Sequence[str]) -> pd.DataFrame:
    """Columns of a table that is small, whatever others it has; rows are numbered by their lines.

    Args:
        path: of the file (``read_rows``).
        columns: of names, but for ``COUNT`` and ``SHARE``.
        keys: columns that no two rows may have alike.

    Raises:
        InputError: where the file is missing or broken, or a value is not what its column holds.
    """
    rows: list[Sequence[Any]] = []
    lines: list[int] = []
    seen = [dict[tuple[Any, ...], str]() for _ in keys]
    for row in read_rows(path, columns, others=True):
        values = [_listed(row, column, value) for column, value in zip(columns, row.values, strict=True)]
        for key, places in zip(keys, seen, strict=True):
            own = tuple(values[columns.index(column)] for column in key)
            if places.setdefault(own, row.place) != row.place:
                raise row.error(f"{short(' '.join(own))} is there twice: also in {places[own]}")
        if len(rows) >= MOST_ROWS:
            raise row.error(f"expected a table of at most {MOST_ROWS:,} rows")
        rows.append(values)
        lines.append(int(row.place.split()[-1]))
    if not rows:
        raise InputError(path, "", "expected rows, got none")
    return pd.DataFrame(rows, columns=list(columns), index=lines)


def _listed(row: Row, column: str, value: Any) -> Any:
    """A value as its column holds it."""
    if column == COUNT:
        return value
    if column == SHARE:
        if not re.fullmatch(r"([0-9]+\.?[0-9]*|\.[0-9]+)(e-?[0-9]{1,3})?", value[:40].lower()) or float(value) > 1:
            raise row.error(f"expected a number from 0 to 1 as share, got {short(value)}")
        return float(value)
    wrong = fault(value)
    if wrong:
        raise row.error(f"{column}: {wrong}")
    return value


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


def _of_text(path: Path, separator: str, columns: _Columns) -> Iterator[Row]:
    line = 0
    try:
        with open_text(path) as file:
            lines = iter(partial(file.readline, LINE), "")
            reader = csv.reader(lines, delimiter=separator, strict=True, skipinitialspace=True)
            header = next(reader, [])
            places = columns.places(path, "line 1", header)
            line = reader.line_num
            for fields in reader:
                line = reader.line_num
                if len(fields) == len(header):
                    yield Row(path, f"line {line}", [None if p is None else fields[p] for p in places])
                elif fields:
                    raise InputError(path, f"line {line}", f"expected {len(header)} fields, got {len(fields)}")
    except UNREADABLE as error:
        place = "" if isinstance(error, FileNotFoundError | PermissionError) else f"line {line + 1}"
        raise InputError(path, place, f"expected a table of UTF-8 text ({cut(str(error), 120)})") from error


def _of_parquet(path: Path, columns: _Columns) -> Iterator[Row]:
    number = 0
    try:
        with pq.ParquetFile(path) as file:
            header = file.schema_arrow.names
            places = columns.places(path, "columns", header)
            for name in columns.all:
                if name in header:
                    _check_type(path, name, file.schema_arrow.field(name).type)
            for batch in file.iter_batches(BATCH):
                for fields in zip(*(column.to_pylist() for column in batch.columns), strict=True):
                    number += 1
                    values = [None if p is None else "" if fields[p] is None else fields[p] for p in places]
                    yield Row(path, f"row {number}", values)
    except UNREADABLE as error:
        place = f"row {number + 1}" if number else ""
        raise InputError(path, place, f"expected a Parquet table ({cut(str(error), 120)})") from error


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
        raise row.error(f"expected a whole number as count, got {short(given)}")
    if not 1 <= int(given) <= MOST_OBSERVED:
        raise row.error(f"expected a count from 1 to {MOST_OBSERVED}, got {given}")
    values = [*row.values]
    values[place] = int(given)
    return row._replace(values=values)
