"""Observations of any file that a reader can read, and which reader that is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa

from isi.errors import InputError, meant, short
from isi.graph.graph import MinedSource
from isi.sources import Source, all_readers
from isi.sources.readers import UNREADABLE, open_text, parse_json, suffix_of
from isi.tables import paths

#: Characters that are read to tell, at most.
MOST = 2**26
_TRIPLE = ["head", "relation", "tail"]
_PLAIN = pa.schema([*((name, pa.string()) for name in _TRIPLE), ("count", pa.int64())])


@dataclass(frozen=True)
class Read:
    """What a file was read as, what its reader counted, and what it observed, added up by triple."""

    reader: str
    counts: Counter[str]
    seen: MinedSource


def read(file: Path, reader: str | None, given: Mapping[str, Any], seed: int) -> Read:
    """The observations of a file.

    Args:
        file: or folder, for a reader that reads one.
        reader: a module of ``isi.sources``; guessed from the file where it is null.
        given: settings of the reader beside the file.
        seed: root of every random stream.

    Raises:
        InputError: where no reader is plain, it does not take these settings, or the file is broken.
    """
    reader = reader or guess(file)
    source = _source(reader, file, given, seed)
    observations = _added_up(pa.concat_tables([_added_up(part) for part in source.tables()])).to_pandas()
    return Read(reader, source.counts, MinedSource(file.name, observations, source.kinds))


def _source(reader: str, file: Path, given: Mapping[str, Any], seed: int) -> Source:
    """A file and its settings as a section of params has them."""
    known = all_readers()
    if reader not in known:
        expected = f"expected one of {', '.join(known)}, got {short(reader)}{meant(reader, known)}"
        raise InputError("--reader", "", expected)
    if known[reader].path is None:
        raise InputError(f"reader {reader}", "", "expected one that reads a file")
    slot = str(known[reader].path).removesuffix("_")
    if {"reader", slot} & set(given):
        raise InputError("--set", "reader" if "reader" in given else slot, "expected another setting: it is given")
    try:
        return Source({"reader": reader, **known[reader].defaults, slot: str(file), **given}, "--set", seed)
    except InputError as error:
        file_named, *rest = error.args
        raise (InputError("", *rest) if file_named == str(paths.PARAMS) else error) from error


def _added_up(part: pa.Table) -> pa.Table:
    plain = part.select([*_TRIPLE, "count"]).cast(_PLAIN)
    return plain.group_by(_TRIPLE).aggregate([("count", "sum")]).rename_columns([*_TRIPLE, "count"])


def together(read: Sequence[Read]) -> MinedSource:
    """What several files observed, as one.

    Raises:
        InputError: where an entity has another kind in one of them than in another.
    """
    if len(read) == 1:
        return read[0].seen
    kinds = pd.concat([one.seen.kinds for one in read]).drop_duplicates("entity").reset_index(drop=True)
    first = dict(zip(kinds["entity"], kinds["kind"], strict=True))
    for one in read:
        for name, kind in zip(one.seen.kinds["entity"], one.seen.kinds["kind"], strict=True):
            if kind != first[name]:
                raise InputError(one.seen.source, f"entity {name!r}", f"expected kind {first[name]!r}, got {kind!r}")
    return MinedSource("files", pd.concat([one.seen.observations for one in read]), kinds)


def guess(file: Path) -> str:
    """The reader of a file, by its name, and of JSON by its keys.

    Raises:
        InputError: where neither tells.
    """
    suffix, known = suffix_of(file), all_readers()
    fitting = [name for name, reader in known.items() if suffix in reader.suffixes]
    if not fitting and suffix in (".json", ".jsonl"):
        value = _first(file)
        fitting = [name for name, reader in known.items() if reader.reads_json(value)]
    if not fitting:
        expected = f"expected a file whose form is plain; else name its reader by --reader: {', '.join(known)}"
        raise InputError(file, "", expected)
    return fitting[0]


def _first(file: Path) -> Any:
    """What JSON Lines begin with, or else what JSON holds."""
    try:
        with open_text(file) as text:
            line = text.readline(MOST)
            try:
                return parse_json(Any, line, file)
            except InputError:
                return parse_json(Any, line + text.read(MOST), file)
    except UNREADABLE as error:
        raise InputError(file, "", f"expected UTF-8 text ({error})") from error
