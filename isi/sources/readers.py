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
from typing import Any, TextIO, TypeVar

import pandas as pd
from pydantic import BaseModel
from pydantic_core import from_json

from isi import config
from isi.columns import COLUMN_NAMES, TRIPLE, other_names, with_triple
from isi.errors import InputError, at, cut, extra, is_of_pyarrow, short
from isi.names import clean, name_fault, plain
from isi.tables.io import check_sha256
from isi.tables.rules import MOST_OBSERVED

#: Maximum number of bytes of a line of a table; number of rows in a batch.
BLOCK, BATCH = 2**20, 65_536
#: Maximum size of a file that is read as a whole: characters, rows.
MOST, MOST_ROWS = 2**26, 1_000_000
COUNT = "count"  #: This column holds whole numbers from 1; all other columns hold text.
TAB = "\t"
GZIP = b"\x1f\x8b"  #: The first bytes of a file that gzip has compressed.
#: Patterns of the first bytes of files that other programs have compressed, by the command that
#: gives their text.
PACKED = {
    "bzip2 -dc": rb"BZh[1-9]1AY&",
    "xz -dc": rb"\xfd7zXZ\x00",
    "unzip -p": rb"PK\x03\x04",
    "zstd -dc": rb"\x28\xb5\x2f\xfd",
}
SEPARATORS = {".csv": ",", ".tsv": "\t", ".txt": "\t"}
#: Words in headers of triples, in this and other projects: a line with one of them in each column
#: is a header.
HEADER_WORDS = COLUMN_NAMES | {
    *("entity", "node", "start", "end", "edge", "type", "id", "name", "verb"),
    *("src", "dst", "subj", "pred", "obj", "arg1", "arg2"),
    *("weight", "score", "split", "confidence", "probability"),
    *"spo012",
}
#: Descriptions of counts.
HEADERLESS = "lines without a header, read as {}"
PERHAPS_HEADER = "first line read as a triple, though no other line has its words: {}"
PERHAPS_TRIPLE = "first line read as a header, though other lines have its words: {}"
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


@contextmanager
def open_bytes(path: Path) -> Iterator[gzip.GzipFile | BufferedReader]:
    """Open a file or a pipe, which gzip may have compressed; its bytes are read once, in order."""
    with path.open("rb") as file:
        start = file.peek(8)
        for command, pattern in PACKED.items():
            if re.match(pattern, start):
                expected = "expected a file that is not compressed, or by gzip"
                unpack = f"{command} {path.name} | isi graph --reader NAME -"
                raise InputError(path, "", f"{expected}; try {unpack}")
        if start.startswith(GZIP):
            with gzip.GzipFile(fileobj=file) as unpacked:
                yield unpacked
        else:
            yield file


@contextmanager
def open_text(path: Path) -> Iterator[TextIO]:
    """Open a text in UTF-8 (``open_bytes``)."""
    with open_bytes(path) as file:
        yield TextIOWrapper(file, encoding="utf-8-sig", newline="")


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


def refuse(path: object, column: pd.Series, wrong: pd.Series[bool], expected: str) -> None:
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
    """Yield the rows of a file in batches: ``.parquet``, or text with commas (``.csv``) or tabs
    (``.tsv``, ``.txt``), each perhaps with ``.gz``.

    In a text of another suffix, or a pipe without one, tabs part columns if the first line has any.

    Columns: ``required``, and ``optional`` if present, in any case; further columns are ignored if
    ``others``, else refused. Head, relation and tail may have other names (``isi.columns``).
    Values: text (None is empty); in ``COUNT``, integers of at least 1. Index: numbers of lines, or
    of rows of Parquet from 1; its name is ``line`` or ``row``. ``headerless``: where the lines of a
    text without a header, which then has the columns ``required``, and a first line that may be
    taken wrongly are counted; None refuses such a text.
    """
    form, known = suffix_of(path), (*required, *optional)
    if form == ".parquet":
        unit, rows = "row", _parquet_rows(path, {*COLUMN_NAMES, *known})
    else:
        unit, rows = "line", _text_rows(path, SEPARATORS.get(form))
    _, first = next(rows)
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
            separator = SEPARATORS.get(form, ",").replace(TAB, "<tab>")
            got += f"; write {separator} between columns" * (len(first) == 1)
            got += f"; if line 1 is no header, add the line {separator.join(required)}"
        raise InputError(path, "line 1" if unit == "line" else "columns", f"{expected}; got {got}")
    first_line = FirstLine(first, header, is_header)
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
        if headerless is not None and unit == "line":
            if not is_header:
                headerless[HEADERLESS.format(", ".join(required))] += len(frame)
            first_line.compare(frame[list(required)])
        yield frame
    if headerless is not None and (doubt := first_line.doubt()):
        headerless[doubt] += 1


class FirstLine:
    """Compares the first line of a table of triples with the others: a header, in other words than
    ``TRIPLE``, and a triple may be taken for each other.
    """

    def __init__(self, words: Sequence[str], header: Sequence[str], is_header: bool) -> None:
        self.words, self.is_header = words, is_header
        self.ends = {word for word, name in zip(words, header, strict=True) if name in TRIPLE[::2]}
        self.alone, self.others = set(words), 0  #: words that no other line has; number of others

    def compare(self, rows: pd.DataFrame) -> None:
        """Take the words of more lines, whose numbers are the index."""
        rows = rows[rows.index > 1]
        self.others += len(rows)
        for name in rows if self.alone else ():
            self.alone.difference_update(rows[name])

    def doubt(self) -> str:
        """Why the line may have been taken wrongly, as a description of a count; else empty."""
        line = short(" ".join(self.words))
        if self.is_header and not set(TRIPLE) <= set(self.words):
            return PERHAPS_TRIPLE.format(line) * (not self.ends <= self.alone)
        is_alone = self.others > 0 and self.alone == set(self.words)
        return PERHAPS_HEADER.format(line) * (is_alone and not self.is_header)


def _is_triple(values: Sequence[str]) -> bool:
    """Whether the first line of a table has three columns,
    and not a word of ``HEADER_WORDS`` in each.
    """
    words = [set(re.findall("[a-z0-9]+", plain(value))) for value in values]
    return len(values) == 3 and any(HEADER_WORDS.isdisjoint(each) for each in words)


def _text_rows(path: Path, separator: str | None) -> Iterator[tuple[int, Sequence[str]]]:
    """Yield (line, values) of the header and of each line that is not blank.

    Without a ``separator``, it is the tab if the first line has any, else the comma.
    """
    line = 1
    with reading(path, "a table of UTF-8 text", lambda: f"line {line}"), open_bytes(path) as file:
        lines = map(_decoded, iter(lambda: file.readline(BLOCK + 1), b""))
        first = next(lines, "")
        separator = separator or (TAB if TAB in first else ",")
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


class PandasMetadata(BaseModel):
    """What pandas says of the columns of a Parquet file."""

    index_columns: list[Any] = []  #: names of columns, or a mapping that describes a range


def _parquet_rows(path: Path, known: Collection[str]) -> Iterator[tuple[int, Sequence[str]]]:
    """Yield (0, header), then (row, values as text) for each row; null and NaN are empty.

    Columns of pandas' index are left out, unless their names are ``known``.
    """
    with extra("pipeline"):
        import pyarrow as pa
        import pyarrow.parquet as pq

    with reading(path, "a Parquet table"):
        # a pipe is read as a whole: Parquet's header is at the end
        whole = path if path.is_file() else pa.BufferReader(path.read_bytes())
        file, rows = pq.ParquetFile(whole), count(1)
        metadata = (file.schema_arrow.metadata or {}).get(b"pandas", b"{}")
        index = parse_json(PandasMetadata, metadata, path, "pandas' metadata").index_columns
        header = {
            place: name
            for place, name in enumerate(file.schema_arrow.names)
            if name not in index or name.strip().lower() in known
        }
        yield 0, list(header.values())
        for batch in file.iter_batches(BATCH):
            columns = [_texts(batch.column(place)) for place in header]
            yield from ((next(rows), values) for values in zip(*columns, strict=True))


def _texts(column: Any) -> list[str]:
    """The values of pyarrow's column as text: null and NaN are empty, and a float that is a whole
    number is written as one.
    """
    import pyarrow as pa

    if pa.types.is_dictionary(column.type):
        column = column.dictionary_decode()
    texts: list[str] = column.cast(pa.string()).fill_null("").to_pylist()
    if not pa.types.is_floating(column.type):
        return texts
    for row, value in enumerate(column.to_pylist()):
        if value is not None and value == value and float(value).is_integer():
            texts[row] = str(int(value))
        elif value != value:
            texts[row] = ""
    return texts
