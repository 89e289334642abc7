"""A graph from a user's files: scenes or triples,
each read by a named reader or by the one that fits it.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pandas as pd

from isi.errors import InputError, short
from isi.graph.graph import GraphTables, MinedSource, build_tables
from isi.names import first_of
from isi.sources import READERS, Source
from isi.sources.names import ENTITY
from isi.sources.readers import COUNT, MOST, json_lines, open_bytes, parse_json, suffix_of
from isi.sources.triples import ENTITIES_FILE, TRIPLE, TRIPLES_FILE
from isi.tables import paths

JSON = (".json", ".jsonl")  #: Suffixes of files whose reader is guessed from their content.


def read_graph(
    files: Sequence[str | Path],
    reader: str | None = None,
    settings: Mapping[str, Any] | None = None,
    seed: int = 0,
) -> tuple[GraphTables, dict[str, dict[str, Any]]]:
    """The graph of files or folders, and by file the name of its reader
    (guessed if None) and what that counted.

    ``ROOM=FILE`` gives the scenes of a file a room. ``settings`` are those of the reader.
    InputError for a file that cannot be read, two kinds of an entity, or no triples.
    """
    seen, kinds, read = [], [], {}
    paths_read = set[Path]()
    for number, file in enumerate(files):
        room, path = _room_and_path(file)
        name = reader or guess(path)
        whole = path.resolve() if path.exists() else path
        if whole in paths_read:
            raise InputError(file, "", "is given twice: each of its observations would count twice")
        paths_read.add(whole)
        is_guess = reader is None and (suffix_of(path) in JSON or _is_stream(path))
        with _suggesting_a_reader(name) if is_guess else nullcontext():
            source = _open(name, path, room, settings or {}, seed)
            seen += [
                part.groupby(TRIPLE, sort=False)[COUNT].sum().reset_index()
                for part in source.frames()
            ]
        kinds.append(source.kinds.assign(file=number))
        # a path may hold bytes that are no text
        shown = str(file).encode(errors="backslashreplace").decode()
        read[shown] = {"reader": name, **source.counts}
    named = _one_kind_each(pd.concat(kinds), files)
    tables = build_tables(MinedSource("files", pd.concat(seen), named))
    if tables.triples.empty:
        raise InputError(files[0], "", "expected a triple, got none")
    return tables, read


def graph_files(tables: GraphTables) -> dict[str, str]:
    """The texts of ``triples.csv`` and ``entities.csv``, which the reader ``table`` reads."""
    frames = {
        TRIPLES_FILE: tables.triples[[*TRIPLE, COUNT]],
        ENTITIES_FILE: tables.entities[["entity", "kind", "phrase"]],
    }
    files = dict[str, str]()
    for name, frame in frames.items():
        files[name] = frame.to_csv(index=False, lineterminator="\n")
    return files


def path_of(file: str | Path) -> Path:
    """The path of ``FILE`` or ``ROOM=FILE``."""
    return _room_and_path(file)[1]


def _room_and_path(file: str | Path) -> tuple[str, Path]:
    """The room (empty without one) and the path of ``FILE`` or ``ROOM=FILE``;
    a path may contain an equals sign.
    """
    room, _, path = str(file).partition("=")
    if room and path and not Path(file).exists() and Path(path).exists():
        return room, Path(path)
    return "", Path(file)


@contextmanager
def _suggesting_a_reader(name: str) -> Iterator[None]:
    """Errors inside say that the reader was guessed, and how to name another one."""
    try:
        yield
    except InputError as error:
        message = f"{error.message} (guessed reader: {name}; --reader names another)"
        raise InputError(error.file, error.place, message) from error


def _open(name: str, path: Path, room: str, given: Mapping[str, Any], seed: int) -> Source:
    """The source of a file with a reader; ``room``: that of the file's scenes, or empty."""
    try:
        known = READERS.get(name, "--reader")
        if known.path is None:
            raise InputError(
                f"reader {name}", "", "expected a reader of files: this one reads shipped data"
            )
        slot = known.path.removesuffix("_")
        for key in {"reader", slot} & set(given):
            raise InputError(
                "--set", key, "expected another setting: FILE or --reader gives this one"
            )
        in_room = {"room": room} if room else {}
        section = {"reader": name, **known.defaults, slot: str(path), **given, **in_room}
        return Source(section, f"{room}={path}" if room else "--set", seed)
    except InputError as error:
        raise (
            InputError("", *error.args[1:]) if error.file == str(paths.PARAMS) else error
        ) from error


def guess(file: Path) -> str:
    """The first reader that fits a file's suffix or JSON, or the files of a folder; ``table`` for a
    stream without a suffix. ``InputError`` if none fits.
    """
    if not file.exists():
        raise InputError(file, "", "no such file")
    known, suffix = {name: READERS.get(name) for name in READERS.names()}, suffix_of(file)
    got = ""
    names = {path.name for path in file.iterdir()} if file.is_dir() else {suffix}
    fitting = [name for name, reader in known.items() if not names.isdisjoint(reader.suffixes)]
    is_stream = _is_stream(file)  # which can be read once only, by its reader
    if is_stream and not suffix:
        return "table"
    if not fitting and not is_stream and suffix in JSON:
        _, content = next(json_lines(file, None, MOST, "JSON"), (1, b""))
        value = parse_json(Any, content, file)
        fitting = [name for name, reader in known.items() if reader.reads_json(value)]
        keys = f"the keys {first_of(list(value))}" if isinstance(value, dict) else short(value)
        got = f", got JSON with {keys}"
    if not fitting:
        if file.is_file():
            with open_bytes(file):  # refuses what other programs have compressed
                pass
        expected = (
            f"expected a file of a known format{got}; --reader names its reader: {', '.join(known)}"
        )
        raise InputError(file, "", expected)
    return fitting[0]


def _is_stream(path: Path) -> bool:
    """Whether a path is a pipe, or a shell's name of one: ``/dev/stdin``, ``/dev/fd/63``."""
    return path.is_relative_to("/dev") or path.is_fifo()


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
