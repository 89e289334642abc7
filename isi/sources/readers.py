"""Functions that read JSON (pydantic), tables and text for all sources;
errors name file and place.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import re
import zlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, distribution
from io import BufferedReader, TextIOWrapper
from itertools import chain, count, islice
from pathlib import Path
from typing import TextIO, TypeVar

import pandas as pd
from pydantic_core import from_json

from isi import config
from isi.columns import COLUMN_NAMES, TRIPLE, other_names, with_triple
from isi.errors import InputError, at, cut, extra, is_of_pyarrow, short
from isi.names import clean, name_fault
from isi.tables.io import check_sha256
from isi.tables.rules import MOST_OBSERVED

#: Maximum number of bytes of a line of a table; number of rows in a batch.
BLOCK, BATCH = 2**20, 65_536
#: Maximum size of a file that is read as a whole: characters, rows.
MOST, MOST_ROWS = 2**26, 1_000_000
COUNT = "count"  #: This column holds whole numbers from 1; all other columns hold text.
TAB = "\t"
GZIP = b"\x1f\x8b"  #: The first bytes of a file that gzip has compressed.
SEPARATORS = {".csv": ",", ".tsv": "\t", ".txt": "\t"}
#: Words in headers of triples, in this and other projects: a line with one of them in each column
#: is a header.
HEADER_WORDS = COLUMN_NAMES | {
    *("entity", "node", "start", "end", "edge", "type", "property", "id"),
    *"spo012",
}
HEADERLESS = "lines without a header, read as {}"  #: Description of a count.
#: Errors that reading a broken file raises, beside those of pyarrow.
UNREADABLE = (OSError, EOFError, UnicodeDecodeError, csv.Error, zlib.error)
T = TypeVar("T")


@contextmanager
def reading(path: Path, content: str, place: Callable[[], str] = str) -> Iterator[None]:
    """Turn errors of reading a file into an ``InputError`` with its path, the place,
    and the expected content.
    """
    try:
        yield
    except Exception as error:
        if not isinstance(error, UNREADABLE) and not is_of_pyarrow(error):
            raise
        if isinstance(error, FileNotFoundError):
            raise InputError(path, "", "no such file") from error
        raise InputError(path, place(), f"expected {content} ({cut(str(error), 120)})") from error


def packaged(package: str, path: str, content: str) -> Path:
    """Path of a package's data, without importing the package;
    InputError if the package is not installed.
    """
    try:
        return Path(str(distribution(package).locate_file(path)))
    except PackageNotFoundError as error:
        raise InputError(
            f"package {package}", "", f"not installed; it contains {content}"
        ) from error


def suffix_of(path: Path) -> str:
    """The suffix of a file's name in lower case, without ``.gz``: ``.csv`` for ``log.CSV.gz``."""
    name = Path(path.name.lower())
    return Path(name.stem).suffix if name.suffix == ".gz" else name.suffix


def open_bytes(path: Path) -> gzip.GzipFile | BufferedReader:
    """Open a file, which gzip may have compressed."""
    with path.open("rb") as file:
        is_compressed = file.read(len(GZIP)) == GZIP
    return gzip.open(path) if is_compressed else path.open("rb")


def open_text(path: Path) -> TextIO:
    """Open a text file in UTF-8, which gzip may have compressed."""
    return TextIOWrapper(open_bytes(path), encoding="utf-8-sig", newline="")


def read_text(path: Path, content: str) -> str:
    """The whole text of a file; InputError if it is missing, broken, not UTF-8,
    or longer than ``MOST`` characters.
    """
    with reading(path, f"{content} in UTF-8"), open_text(path) as file:
        text = file.read(MOST + 1)
    if len(text) > MOST:
        raise InputError(path, "", f"expected {content} of at most {MOST:,} characters, got more")
    return text


def read_json(form: type[T], path: Path, content: str) -> T:
    """Read a JSON file as a value of type ``form`` (see ``read_text`` and ``parse_json``)."""
    return parse_json(form, read_text(path, content), path)


def json_lines(
    path: Path, sha256: str | None, most: int, content: str
) -> Iterator[tuple[int, bytes]]:
    """Yield (number from 1, line) for each non-blank line of a plain or gzip file;
    InputError over ``most`` bytes.

    A file whose first line is not JSON by itself is yielded as one line: JSON over several lines.
    ``content`` describes the file in errors. ``sha256``: expected hash; None: no check.
    """
    check_sha256(path, sha256)
    number, is_first = 0, True
    with reading(path, content, lambda: f"line {number + 1}"), open_bytes(path) as file:
        while line := file.readline(most + 1):
            number += 1
            # the next lines belong to it
            if is_first and line.strip() and file.peek(1) and not _is_json(line):
                line += file.read(most)
            is_first = is_first and not line.strip()
            if len(line) > most:
                raise InputError(path, f"line {number}", f"expected at most {most:,} bytes")
            if line.strip():
                yield number, line


def _is_json(text: bytes) -> bool:
    try:
        from_json(text.removeprefix(codecs.BOM_UTF8))
    except ValueError:
        return False
    return True


def parse_json(form: type[T], content: bytes | str, path: object, place: str = "") -> T:
    """Parse JSON as a value of type ``form``; InputError names ``path``,
    ``place`` and the wrong key.
    """
    with at(path, place):
        text = content.removeprefix(codecs.BOM_UTF8) if isinstance(content, bytes) else content
        return config.adapter(form).validate_json(text, strict=True)


def refuse(path: Path, column: pd.Series, wrong: pd.Series[bool], expected: str) -> None:
    """InputError for the first ``wrong`` value of a column, with its line or row number,
    which is in the index.
    """
    if wrong.any():
        place, value = next(iter(column[wrong].items()))
        raise InputError(path, f"{column.index.name} {place}", f"{expected}, got {short(value)}")


def check_settings(path: Path, content: str, named: Iterable[T], known: Iterable[T]) -> None:
    """InputError if an item in ``named`` (by settings) is not ``known`` (in the file);
    ``content``: kind of item.
    """
    present = set(known)
    if unknown := [item for item in dict.fromkeys(named) if item not in present]:
        more = f" (and {len(unknown) - 1:,} more)" * (len(unknown) > 1)
        raise InputError(
            path,
            f"{content} {short(unknown[0])}",
            f"a setting names it, but this file lacks it{more}",
        )


def check_names(table: pd.DataFrame, path: object, optional: Collection[str] = ()) -> None:
    """InputError for the first invalid name, with line or row (``read_batches``);
    ``optional`` columns may be empty.
    """
    for column, names in table.drop(columns=COUNT, errors="ignore").items():
        faults = {name: fault for name in names.unique() if (fault := name_fault(name))}
        if column in optional:
            faults.pop("", None)
        if faults:
            place, name = next((place, name) for place, name in names.items() if name in faults)
            raise InputError(path, f"{names.index.name} {place}", f"{column}: {faults[name]}")


def cleaned(table: pd.DataFrame) -> pd.DataFrame:
    """The table with all names in their clean form (``isi.names.clean``)."""
    names = table.drop(columns=COUNT, errors="ignore")
    forms = {name: clean(name) for column in names for name in table[column].unique()}
    return table.assign(**{str(column): table[column].map(forms) for column in names})


def read_table(
    path: Path,
    columns: Sequence[str],
    *keys: Sequence[str],
    optional: Sequence[str] | None = None,
) -> pd.DataFrame:
    """Read a whole table of 1 to ``MOST_ROWS`` rows of valid names;
    its index holds line numbers (``read_batches``).

    Each key is a list of columns in which no two rows agree. None as ``optional`` ignores any other
    columns.
    """
    batches, rows = [], 0
    for batch in read_batches(path, columns, optional or (), optional is None):
        check_names(batch, path, optional or ())
        batches.append(cleaned(batch))
        rows += len(batch)
        if rows > MOST_ROWS:
            raise InputError(path, "", f"expected a table of at most {MOST_ROWS:,} rows")
    if not batches:
        raise InputError(path, "", "expected rows, got none")
    table = pd.concat(batches)
    for key in map(list, keys):
        refuse(
            path,
            table[key].agg(" ".join, axis=1),
            table.duplicated(key),
            f"expected each {' '.join(key)} once",
        )
    return table


def read_batches(
    path: Path,
    required: Sequence[str],
    optional: Sequence[str] = (),
    others: bool = False,
    headerless: Counter[str] | None = None,
) -> Iterator[pd.DataFrame]:
    """Yield the rows of a file
    (``.csv``, ``.tsv``, ``.txt``, each perhaps with ``.gz``, or ``.parquet``) in batches.

    Columns: ``required``, and ``optional`` if present, in any case; further columns are ignored if
    ``others``, else refused. Head, relation and tail may have other names (``isi.columns``).
    Values: text (None is empty); in ``COUNT``, integers of at least 1. Index: numbers of lines, or
    of rows of Parquet from 1; its name is ``line`` or ``row``. ``headerless``: where the lines of a
    text without a header, which then has the columns ``required``, are counted; None refuses such a
    text.
    """
    form = suffix_of(path)
    if form not in (*SEPARATORS, ".parquet"):
        raise InputError(
            path,
            "",
            "expected a file name that ends in .csv, .tsv, .txt (or these with .gz) or .parquet",
        )
    rows, unit = (
        (_parquet_rows(path), "row")
        if form == ".parquet"
        else (_text_rows(path, SEPARATORS[form]), "line")
    )
    _, first = next(rows)
    known = (*required, *optional)
    has_triples = set(TRIPLE) <= set(required)
    folded = {name: name.strip().lower() for name in first}
    header = [folded[name] if folded[name] in known else name for name in first]
    if has_triples:
        header = with_triple(header)
    names = [name for name in header if name in known]
    is_header = set(required) <= set(names)
    if not is_header and unit == "line" and headerless is not None and _is_triple(first):
        rows, header, names = chain([(1, first)], rows), list(required), list(required)
    elif not is_header or len(set(names)) < len(names) or not (others or names == header):
        expected = f"expected the columns {', '.join(required)}"
        if has_triples and not is_header:
            expected += f" {other_names()}"
        elif optional:
            expected += f" and optionally {', '.join(optional)}"
        got = cut(", ".join(repr(name[:40]) for name in first) or "none", 80)
        if unit == "line" and not is_header:
            separator = SEPARATORS[form].replace(TAB, "<tab>")
            got += f"; write {separator} between columns" * (len(first) == 1)
            got += f"; if line 1 is no header, add the line {separator.join(required)}"
        raise InputError(path, "line 1" if unit == "line" else "columns", f"{expected}; got {got}")
    while batch := list(islice(rows, BATCH)):
        places, values = zip(*batch, strict=True)
        frame = pd.DataFrame(values, pd.Index(places, name=unit), list(header), dtype=str)[names]
        if COUNT in frame:
            number = (
                frame[COUNT].where(frame[COUNT].str.fullmatch("[0-9]{1,10}"), "0").astype("int64")
            )
            expected = f"expected a whole number from 1 to {MOST_OBSERVED} as count"
            refuse(path, frame[COUNT], ~number.between(1, MOST_OBSERVED), expected)
            frame[COUNT] = number
        if headerless is not None and not is_header:
            headerless[HEADERLESS.format(", ".join(required))] += len(frame)
        yield frame


def _is_triple(values: Sequence[str]) -> bool:
    """Whether the first line of a table has three columns,
    and not a word of ``HEADER_WORDS`` in each.
    """
    words = [set(re.findall("[a-z0-9]+", value.lower())) for value in values]
    return len(values) == 3 and any(HEADER_WORDS.isdisjoint(each) for each in words)


def _text_rows(path: Path, separator: str) -> Iterator[tuple[int, Sequence[str]]]:
    """Yield (line, values) of the header and of each line that is not blank."""
    line = 1
    with reading(path, "a table of UTF-8 text", lambda: f"line {line}"), open_bytes(path) as file:
        lines = map(_decoded, iter(lambda: file.readline(BLOCK + 1), b""))
        first = next(lines, "")
        # A text with tabs has no quoting, unless each field of its first line is quoted.
        is_quoted = separator != TAB or all(
            re.fullmatch('"[^"]*"', field) for field in first.strip().split(TAB)
        )
        quoting = csv.QUOTE_MINIMAL if is_quoted else csv.QUOTE_NONE
        form = {
            "delimiter": separator,
            "skipinitialspace": True,
            "strict": True,
            "quoting": quoting,
        }
        rows = csv.reader(chain([first], lines), **form)  # type: ignore[arg-type]
        width = None
        for row in rows:
            width = len(row) if width is None else width
            if row and len(row) != width:
                raise csv.Error(f"expected {width} columns, got {len(row)}")
            if row or line == 1:
                yield line, row if is_quoted else [_unquoted(field) for field in row]
            line = rows.line_num + 1
        if width is None:
            yield 1, []


def _decoded(line: bytes) -> str:
    if len(line) > BLOCK:
        raise csv.Error(f"line longer than {BLOCK:,} bytes")
    return line.decode("utf-8-sig")


def _unquoted(field: str) -> str:
    """The text of a field that pandas has quoted, since it contains a quote;
    other quotes are part of the text.
    """
    inner = field[1:-1]
    is_quoted = (
        field[:1] == field[-1:] == '"' and '"' in inner and '"' not in inner.replace('""', "")
    )
    return inner.replace('""', '"') if is_quoted else field


def _parquet_rows(path: Path) -> Iterator[tuple[int, Sequence[str]]]:
    """Yield (0, header), then (row, values as text) for each row; null is empty."""
    with extra("pipeline"):
        import pyarrow as pa
        import pyarrow.parquet as pq

    with reading(path, "a Parquet table"):
        file, rows = pq.ParquetFile(path), count(1)
        yield 0, file.schema_arrow.names
        for batch in file.iter_batches(BATCH):
            columns = [
                column.cast(pa.string()).fill_null("").to_pylist() for column in batch.columns
            ]
            yield from ((next(rows), values) for values in zip(*columns, strict=True))
