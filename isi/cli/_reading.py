"""Observations of any file that a reader can read, and which reader that is."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa

from isi.config import options
from isi.errors import InputError
from isi.graph.graph import MinedSource
from isi.sources import SOURCES, observing
from isi.sources._json import json_of
from isi.sources._rows import SEPARATORS, UNREADABLE, form_of, open_text
from isi.tables import paths

READERS = {**dict.fromkeys([*SEPARATORS, ".parquet"], "table"), ".nt": "rdf", ".ttl": "rdf"}
#: The setting of a reader that names what it reads.
PATHS = ("path", "from", "folder")
#: Of settings that a reader must be given: what a file alone can tell.
DEFAULTS = {"sha256": None, "materials": "simulator", "broken": "error"}
#: Readers of JSON by the keys of the mapping that it begins with.
KEYS = {
    "format": "ai2thor", "kitchens": "ai2thor", "rooms": "procthor_houses", "objects": "ai2thor_scene",
    "metadata": "ai2thor_scene",
}  # fmt: skip
#: Characters that are read to tell, at most.
MOST = 2**26
_TRIPLE = ["head", "relation", "tail"]
_PLAIN = pa.schema([*((name, pa.string()) for name in _TRIPLE), ("count", pa.int64())])


@dataclass(frozen=True)
class Read:
    """What a file was read as, what its reader counted, and what it observed, added up by triple."""

    reader: str
    left: Counter[str]
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
    try:
        observed, parts = observing(_section(reader, file, given), "--set", seed)
    except InputError as error:
        file_named, *rest = error.args
        raise (InputError("", *rest) if file_named == str(paths.PARAMS) else error) from error
    observations = _added_up(pa.concat_tables([_added_up(part) for part in parts])).to_pandas()
    return Read(reader, observed.mining.left, MinedSource(file.name, observations, observed.kinds))


def _section(reader: str, file: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """A file and what is told of it, as a section of params tells of a source."""
    fields = options(SOURCES.get(reader, "--reader").observe).model_fields
    takes = [field.alias or name for name, field in fields.items()]
    slot = next((name for name in PATHS if name in takes), None)
    if slot is None:
        raise InputError(f"reader {reader}", "", "expected one that reads a file")
    if {"reader", slot} & set(given):
        raise InputError("--set", "reader" if "reader" in given else slot, "expected another setting: it is given")
    preset = {name: value for name, value in DEFAULTS.items() if name in takes}
    return {"reader": reader, **preset, slot: str(file), **given}


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
    form = form_of(file)
    if form in READERS:
        return READERS[form]
    found = _first(file) if form in (".json", ".jsonl") else None
    if isinstance(found, list):
        return KEYS["objects"]
    for key, reader in KEYS.items():
        if isinstance(found, dict) and key in found:
            return reader
    expected = f"expected a file whose form is plain; else name its reader by --reader: {', '.join(SOURCES.names())}"
    raise InputError(file, "", expected)


def _first(file: Path) -> Any:
    """What JSON Lines begin with, or else what JSON holds."""
    try:
        with open_text(file) as text:
            line = text.readline(MOST)
            try:
                return json.loads(line)
            except ValueError:
                return json_of(file, "", line + text.read(MOST))
    except UNREADABLE as error:
        raise InputError(file, "", f"expected UTF-8 text ({error})") from error
    except RecursionError as error:
        raise InputError(file, "", "expected JSON: lists and mappings are too deep in each other") from error
