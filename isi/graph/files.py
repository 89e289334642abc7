"""A graph from a user's files: scenes, houses or triples, each read by a named reader or by the one that fits it."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from isi.errors import InputError
from isi.graph.graph import GraphTables, MinedSource, build_tables
from isi.sources import READERS, Source
from isi.sources.names import ENTITY
from isi.sources.readers import COUNT, MOST, json_lines, parse_json, suffix_of
from isi.sources.triples import ENTITIES_FILE, TRIPLE, TRIPLES_FILE
from isi.tables import paths
from isi.tables.io import atomically


def read_graph(
    files: Sequence[str | Path], reader: str | None = None, settings: Mapping[str, Any] | None = None,
    min_count: int = 1, seed: int = 0,
) -> tuple[GraphTables, dict[str, dict[str, Any]]]:  # fmt: skip
    """The graph of files or folders, and by file the name of its reader (guessed if null) and what that counted.

    ``ROOM=FILE`` gives the scenes of a file a room. ``settings`` are those of the reader; ``min_count``: triples with
    fewer observations are dropped. InputError for a file that cannot be read, two kinds of an entity, or no triples.
    """
    seen, kinds, read = [], [], {}
    for file in files:
        name, source = _open(file, reader, settings or {}, seed)
        seen += [part.groupby(TRIPLE, sort=False)[COUNT].sum().reset_index() for part in source.frames()]
        kinds.append(source.kinds.assign(file=str(file)))
        read[str(file)] = {"reader": name, **source.counts}
    tables = build_tables(MinedSource("files", pd.concat(seen), _one_kind_each(pd.concat(kinds))), min_count)
    if tables.triples.empty:
        raise InputError(files[0], "", f"expected a triple of count {min_count} (--min-count) or more, got none")
    return tables, read


def write_graph(folder: Path, tables: GraphTables) -> None:
    """Write a folder that the reader ``table`` reads: ``triples.csv`` and ``entities.csv``."""
    triples, entities = tables.triples[[*TRIPLE, COUNT]], tables.entities[["entity", "kind", "phrase"]]
    for name, frame in ((TRIPLES_FILE, triples), (ENTITIES_FILE, entities)):
        atomically(folder / name, partial(frame.to_csv, index=False, lineterminator="\n"))


def _open(file: str | Path, reader: str | None, given: Mapping[str, Any], seed: int) -> tuple[str, Source]:
    """The name of the reader (guessed if null) of ``FILE`` or ``ROOM=FILE``, and the source."""
    room, equals, path = str(file).partition("=")
    in_room = {"room": room} if equals and not Path(file).exists() else {}
    path = path if in_room else str(file)
    try:
        name = reader or guess(Path(path))
        known = READERS.get(name, "--reader")
        if known.path is None:
            raise InputError(f"reader {name}", "", "expected a reader of files: this one reads shipped data")
        slot = known.path.removesuffix("_")
        for key in {"reader", slot} & set(given):
            raise InputError("--set", key, "expected another setting: FILE or --reader gives this one")
        section = {"reader": name, **known.defaults, slot: path, **given, **in_room}
        return name, Source(section, str(file) if in_room else "--set", seed)
    except InputError as error:
        raise (InputError("", *error.args[1:]) if error.file == str(paths.PARAMS) else error) from error


def guess(file: Path) -> str:
    """The first reader that fits a file's suffix or JSON, or the files of a folder; ``InputError`` if none fits."""
    known, suffix = {name: READERS.get(name) for name in READERS.names()}, suffix_of(file)
    names = {path.name for path in file.iterdir()} if file.is_dir() else {suffix}
    fitting = [name for name, reader in known.items() if not names.isdisjoint(reader.suffixes)]
    if not fitting and suffix in (".json", ".jsonl"):
        _, content = next(json_lines(file, None, MOST, "JSON"), (1, b""))
        value = parse_json(Any, content, file)
        fitting = [name for name, reader in known.items() if reader.reads_json(value)]
    if not fitting:
        expected = f"expected a file of a known format; else name its reader with --reader: {', '.join(known)}"
        raise InputError(file, "", expected)
    return fitting[0]


def _one_kind_each(kinds: pd.DataFrame) -> pd.DataFrame:
    """One row per entity, without the kind ``ENTITY`` if a file has another; InputError for two others."""
    known = kinds[kinds["kind"] != ENTITY].drop_duplicates(["entity", "kind"])
    for name, row in known[known["entity"].duplicated()].set_index("entity").iterrows():
        raise InputError(row["file"], f"entity {name!r}", f"expected the kind of another file, got {row['kind']!r}")
    return pd.concat([known, kinds]).drop_duplicates("entity", ignore_index=True).drop(columns="file")
