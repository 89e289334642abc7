"""A graph from a user's files: scenes or triples,
each read by a named reader or by the one that fits it.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from isi.columns import COUNT
from isi.errors import NO_SUCH_FILE, InputError
from isi.graph.graph import GraphTables, MinedSource, build_tables
from isi.sources import READERS, Source
from isi.sources.names import ENTITY
from isi.sources.readers import MOST, form_of, json_lines, parse_json, suffix_of
from isi.sources.triples import TRIPLE
from isi.tables import paths

JSON = (".json", ".jsonl")
#: Readers of JSON by the key of its first value that tells them, in this order; a list is of
#: scenes.
OF_JSON = {
    "rooms": "rooms",
    "nodes": "spark_dsg",
    "format": "ai2thor",
    "kitchens": "ai2thor",
    "objects": "ai2thor_scene",
    "metadata": "ai2thor_scene",
}


def read_graph(
    files: Sequence[str | Path],
    reader: str | None = None,
    settings: Mapping[str, Any] | None = None,
    seed: int = 0,
) -> tuple[GraphTables, dict[str, dict[str, Any]]]:
    """The graph of files or folders, and by file the name of its reader
    (that of ``reader_of`` if None) and what that counted.

    ``ROOM=FILE`` gives the scenes of a file a room. ``settings`` are those of the reader.
    InputError for a file that cannot be read, two kinds of an entity, or no triples.
    """
    seen, kinds, read = [], [], {}
    paths_read = set[Path]()
    for number, file in enumerate(files):
        path = path_of(file)
        if path.resolve() in paths_read:
            raise InputError(file, "", "is given twice: each of its observations would count twice")
        paths_read.add(path.resolve())
        name = reader or reader_of(path)
        source = _open(name, file, settings or {}, seed)
        try:
            for part in source.frames():
                seen.append(part.groupby(TRIPLE, sort=False)[COUNT].sum().reset_index())
        except InputError as error:
            guessed = reader is None and suffix_of(path) in (*JSON, "")
            message = error.message + f" (read by {name}; --reader names another)" * guessed
            raise InputError(error.file, error.place, message) from error
        kinds.append(source.kinds.assign(file=number))
        # a path may hold bytes that are no text
        shown = str(file).encode(errors="backslashreplace").decode()
        read[shown] = {"reader": name, **source.counts}
    named = _one_kind_each(pd.concat(kinds), files)
    tables = build_tables(MinedSource("files", pd.concat(seen), named))
    if tables.triples.empty:
        raise InputError(files[0], "", "expected a triple, got none")
    return tables, read


def path_of(file: str | Path) -> Path:
    """The path of ``FILE`` or ``ROOM=FILE``; a path may contain an equals sign."""
    room, _, path = str(file).partition("=")
    if room and path and not Path(file).exists() and Path(path).exists():
        return Path(path)
    return Path(file)


def reader_of(file: Path) -> str:
    """The reader of a table by its first bytes, of a file's suffix, of its JSON or of what is in a
    folder; ``table`` without a suffix. ``InputError`` if none fits.
    """
    if not file.exists():
        raise InputError(file, "", NO_SUCH_FILE)
    if form_of(file):
        return "table"
    suffix = suffix_of(file)
    names = {path.name for path in file.iterdir()} if file.is_dir() else {suffix}
    for name in READERS.names():
        if not names.isdisjoint(READERS.get(name).suffixes):
            return name
    if not suffix and not file.is_dir():
        return "table"
    if suffix in JSON and file.is_file():
        _, content = next(json_lines(file, MOST, "JSON"), (1, b"null"))
        value = parse_json(Any, content, file)
        fitting = [
            name for key, name in OF_JSON.items() if isinstance(value, dict) and key in value
        ]
        if fitting or isinstance(value, list):
            return fitting[0] if fitting else "ai2thor_scene"
    expected = "expected a file of a known format; --reader names its reader"
    raise InputError(file, "", f"{expected}: {', '.join(READERS.names())}")


def _open(name: str, file: str | Path, settings: Mapping[str, Any], seed: int) -> Source:
    """The source of a file with a reader."""
    path = path_of(file)
    try:
        known = READERS.get(name, "--reader")
        if known.path is None:
            expected = "expected a reader of files: this one reads shipped data"
            raise InputError(f"reader {name}", "", expected)
        slot = known.path.removesuffix("_")
        for key in {"reader", slot} & set(settings):
            expected = "expected another setting: FILE or --reader gives this one"
            raise InputError("--set", key, expected)
        in_room = {} if path == Path(file) else {"room": str(file).partition("=")[0]}
        section = {"reader": name, **known.defaults, slot: str(path), **settings, **in_room}
        return Source(section, str(file) if in_room else "--set", seed)
    except InputError as error:
        if error.file == str(paths.PARAMS):  # there are none
            raise InputError("", *error.args[1:]) from error
        raise


def _one_kind_each(kinds: pd.DataFrame, files: Sequence[str | Path]) -> pd.DataFrame:
    """One row per entity, without the kind ``ENTITY`` if a file has another;
    InputError for two others.

    The column ``file`` of ``kinds`` is the place in ``files``.
    """
    known = kinds[kinds["kind"] != ENTITY].drop_duplicates(["entity", "kind"])
    for name, row in known[known["entity"].duplicated()].set_index("entity").iterrows():
        expected = f"expected the kind of another file, got {row['kind']!r}"
        raise InputError(files[row["file"]], f"entity {name!r}", expected)
    return (
        pd.concat([known, kinds]).drop_duplicates("entity", ignore_index=True).drop(columns="file")
    )
