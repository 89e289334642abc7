"""Functions that read JSON (pydantic), and tables and text (pandas) for all sources;
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
from io import BufferedReader, BytesIO, TextIOWrapper
from pathlib import Path
from typing import TypeVar

import pandas as pd
from pydantic_core import from_json

from isi import config
from isi.columns import COUNT, KNOWN, OTHER_NAMES, TRIPLE, known_columns
from isi.errors import NO_SUCH_FILE, InputError, at, cut, extra, is_of_pyarrow, short
from isi.names import clean, name_fault
from isi.tables.rules import MOST_OBSERVED

BATCH = 65_536  #: Maximum number of rows of a table that are read at once.
#: Maximum size of a file that is read as a whole: characters, rows.
MOST, MOST_ROWS = 2**26, 1_000_000
TAB = "\t"
GZIP = b"\x1f\x8b"  #: The first bytes of a file that gzip has compressed.
SEPARATORS = {".csv": ",", ".tsv": TAB, ".txt": TAB}
#: Forms of tables that are no text, by the first bytes of a file.
FORMS = {b"PAR1": "Parquet", b"ARRO": "Feather", b"FEA1": "Feather"}
#: Descriptions of counts.
HEADERLESS = "lines without a header, read as head, relation, tail; the first: {}"
NAMES_OF_HEADER = 2  #: A first line with as many names of columns is a header.
PERHAPS_TRIPLE = "first line read as a header, though other lines have its words: {}"
#: Errors that reading a broken file raises, beside those of pyarrow.
UNREADABLE = (OSError, EOFError, ValueError, zlib.error)
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
            raise InputError(path, "", NO_SUCH_FILE) from error
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
        if file.peek(len(GZIP)).startswith(GZIP):
            with gzip.GzipFile(fileobj=file) as unpacked:
                yield unpacked
        else:
            yield file


def read_text(path: Path, content: str) -> str:
    """The whole text of a file; InputError if it is missing, broken, not UTF-8,
    or longer than ``MOST`` characters.
    """
    with reading(path, f"{content} in UTF-8"), open_bytes(path) as file:
        text = TextIOWrapper(file, encoding="utf-8-sig", newline="").read(MOST + 1)
    if len(text) > MOST:
        raise InputError(path, "", f"expected {content} of at most {MOST:,} characters, got more")
    return text


def read_json(form: type[T], path: Path, content: str) -> T:
    """Read a JSON file as a value of type ``form`` (see ``read_text`` and ``parse_json``)."""
    return parse_json(form, read_text(path, content), path)


def json_lines(path: Path, most: int, content: str) -> Iterator[tuple[int, bytes]]:
    """Yield (number from 1, line) for each non-blank line of a plain or gzip file;
    InputError over ``most`` bytes.

    A file whose first line is not JSON by itself is yielded as one line: JSON over several lines.
    ``content`` describes the file in errors.
    """
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
    ``place`` and the wrong key, or one that stands twice.
    """
    with at(path, place):
        text = content.decode("utf-8-sig") if isinstance(content, bytes) else content
        config.check_keys(text)
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
    """Yield the rows of a file in batches: Parquet or Feather (``form_of``), or text with commas
    (``.csv``) or tabs (``.tsv``, ``.txt``), each perhaps with ``.gz``.

    In a text of another suffix, or a pipe without one, tabs part columns if the first line has any.

    Columns: ``required``, and ``optional`` if present, in any case; further columns are ignored if
    ``others``, else refused. Head, relation and tail may have other names (``isi.columns``).
    Values: text (None is empty); in ``COUNT``, integers of at least 1. Index: numbers of lines, or
    of rows of Parquet from 1; its name is ``line`` or ``row``. ``headerless``: where the lines of a
    text of triples without a header, and a header that may be a triple, are counted; None refuses
    such a text.
    """
    form, known = form_of(path), (*required, *optional)
    is_text = form is None
    counts = headerless if is_text else None
    first, header, line, is_header = list[str](), list[str](), "", True
    for rows in _text(path) if form is None else _rows(path, form, known):
        if not header:
            first = list(rows.iloc[0] if is_text else rows.columns)
            line = short(" ".join(first))
            with at(path, "line 1" if is_text else "columns"):
                header, is_header = _header(
                    first, required, optional, others, may_lack=counts is not None
                )
            rows = rows.iloc[int(is_text and is_header) :]
        rows = rows.set_axis(header, axis=1)[[name for name in header if name in known]]
        rows = rows.set_axis((rows.index + 1).set_names("line" if is_text else "row"))
        if is_text:  # blank lines are no rows
            rows = rows[(rows != "").any(axis=1)]
        if COUNT in rows:
            rows = rows.assign(**{COUNT: _numbers(path, rows[COUNT])})
        if counts is not None and not is_header:
            counts[HEADERLESS.format(line)] += len(rows)
        elif counts is not None and rows[["head", "tail"]].isin({*first} - {*TRIPLE}).any(
            axis=None
        ):
            counts[PERHAPS_TRIPLE.format(line)] = 1
        if len(rows):
            yield rows


def form_of(path: Path) -> str | None:
    """The form of a table: Parquet or Feather by its first bytes, folders of Parquet's parts as
    Spark writes them; None: text.
    """
    if path.is_dir():
        return "folder" if any(path.rglob("*.parquet")) else None
    if path.is_file():  # from a pipe, nothing is taken
        with path.open("rb") as file:
            if form := FORMS.get(file.read(4)):
                return form
    return "Parquet" if suffix_of(path) == ".parquet" else None


def _header(
    first: Sequence[str],
    required: Sequence[str],
    optional: Sequence[str],
    others: bool,
    may_lack: bool,
) -> tuple[list[str], bool]:
    """The names of the columns of a table, and whether its first row has them: other names of
    ``TRIPLE`` are replaced, and three values, of which at most one is the name of a column, are a
    triple if the table ``may_lack`` a header.
    """
    known, has_triples = (*required, *optional), set(TRIPLE) <= set(required)
    names = known_columns(first) if has_triples else [name.strip().lower() for name in first]
    known_names = [name for name in names if name in known]
    is_whole = set(required) <= set(known_names) and len(set(known_names)) == len(known_names)
    if is_whole and (others or known_names == names):
        return names, True
    of_columns = sum(name in KNOWN for name in names)
    if may_lack and len(first) == len(TRIPLE) and of_columns < NAMES_OF_HEADER:
        return list(TRIPLE), False
    expected = f"expected the columns {', '.join(required)} {OTHER_NAMES * has_triples}".strip()
    expected += f" and optionally {', '.join(optional)}" * bool(optional)
    got = cut(", ".join(repr(name[:40]) for name in first) or "none", 80)
    got += "; commas part columns of .csv, tabs those of .tsv and .txt" * (len(first) == 1)
    raise InputError("", "", f"{expected}; got {got}")


def _numbers(path: Path, column: pd.Series) -> pd.Series:
    """A column of counts as integers."""
    numbers = column.where(column.str.fullmatch("[0-9]{1,10}"), "0").astype("int64")
    expected = f"expected a whole number from 1 to {MOST_OBSERVED} as count"
    refuse(path, column, ~numbers.between(1, MOST_OBSERVED), expected)
    return numbers


def _text(path: Path) -> Iterator[pd.DataFrame]:
    """The lines of a table, its header among them; empty fields and missing ones are empty text."""
    with reading(path, "a table of UTF-8 text"), open_bytes(path) as file:
        start = file.peek(1).removeprefix(codecs.BOM_UTF8)
        if b"\0" in start:
            raise ValueError("a byte is zero, as in UTF-16")
        first = start.partition(b"\n")[0].rstrip()
        separator = SEPARATORS.get(suffix_of(path), TAB if b"\t" in first else ",")
        # A text with tabs has no quoting, unless each field of its first line is quoted.
        is_quoted = separator == "," or re.fullmatch(rb'("[^"]*"\t?)+', first)
        parts = pd.read_csv(
            file,
            sep=separator,
            header=None,
            dtype=object,
            na_filter=False,
            quoting=csv.QUOTE_MINIMAL if is_quoted else csv.QUOTE_NONE,
            skipinitialspace=True,
            skip_blank_lines=False,
            encoding="utf-8-sig",
            encoding_errors="surrogateescape",  # such names are refused, with their line
            chunksize=BATCH,
        )
        for rows in parts:
            yield rows if is_quoted else rows.map(_unquoted)


def _unquoted(field: str) -> str:
    """The text of a field that pandas and PyKEEN quote, since it has a quote, which is doubled;
    other quotes are part of the text.
    """
    inner = field[1:-1].replace('""', "\n")  # no field contains a line end
    is_quoted = field[:1] == field[-1:] == '"' and "\n" in inner and '"' not in inner
    return inner.replace("\n", '"') if is_quoted else field


def _rows(path: Path, form: str, known: Collection[str]) -> Iterator[pd.DataFrame]:
    """The rows of a table in a form of ``form_of`` as text, without pandas' index unless a column
    of it is known. The names of a folder's folders may be values, ``relation=in``.
    """
    with extra("pipeline"):
        import pyarrow as pa
        from pyarrow import dataset, feather, fs

    def texts(column: pd.Series) -> pd.Series:
        values = pa.array(column.convert_dtypes(), from_pandas=True).cast(pa.string())
        return pd.Series(values.fill_null("").to_pylist(), dtype=object)

    with reading(path, f"a table in {form}" if form != "folder" else "a folder of Parquet"):
        if form == "Parquet":
            table = pd.read_parquet(BytesIO(path.read_bytes()))
        elif form == "Feather":
            table = feather.read_table(BytesIO(path.read_bytes())).to_pandas()
        else:  # as a path of this machine, also where it looks like that of another place
            local = fs.LocalFileSystem()
            parts = dataset.dataset(
                str(path.absolute()), filesystem=local, format="parquet", partitioning="hive"
            )
            table = parts.to_table().to_pandas()
        index = [name for name in table.index.names if known_columns([name])[0] in known]
        table = table.reset_index(index)
        columns = [texts(table.iloc[:, place]) for place in range(table.shape[1])]
        yield pd.DataFrame(dict(enumerate(columns))).set_axis(list(map(str, table.columns)), axis=1)
