"""Broken homes and broken folders of plain files, which commands read."""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
from safetensors.numpy import save

from tests.mistakes.calls import Typed
from tests.mistakes.commands import HOME
from tests.small_bundle import edit, small, tamper, written


def edited(statements: str) -> Callable[[], object]:
    """A function that changes the database."""

    def edit() -> None:
        with closing(sqlite3.connect(HOME / "home.sqlite")) as database, database:
            database.executescript(statements)

    return edit


#: Texts of the message, and the function that breaks the home.
HOMES: list[tuple[str, Callable[[], object]]] = [
    ("home.sqlite|trained relations|missing", edited("DELETE FROM trained WHERE rows = 2")),
    ("home.sqlite|trained entities|digest", edited("UPDATE trained SET columns = 2 * columns")),
    ("home.sqlite|another program", edited("DROP VIEW now; DROP VIEW history; DROP TABLE setting")),
    ("home.sqlite|another program", edited("PRAGMA application_id = 7")),
    ("home.sqlite|newer", edited("PRAGMA user_version = 99")),
    ("home.sqlite|setting", edited("DELETE FROM setting WHERE name = 'model_name'")),
    ("home.sqlite|trained entities", edited("UPDATE entity SET row = NULL WHERE name = 'lie on'")),
]

OLD = Path("old")


def put(name: str, content: bytes) -> Callable[[], object]:
    """A function that writes plain files, one of them with other bytes and their digest."""
    return lambda: tamper(written(OLD), name, content)


def manifest(**changed: object) -> Callable[[], object]:
    """A function that writes plain files whose manifest has other values."""
    return lambda: edit(written(OLD), lambda values: values.update(changed))


def tensors(**changed: np.ndarray) -> Callable[[], object]:
    given = {"entities": small().entities, "relations": small().relations, **changed}
    return put("vectors.safetensors", bytes(save(given)))


#: Texts of the message, and the function that writes broken plain files.
PLAIN: list[tuple[str, Callable[[], object]]] = [
    ("triples.tsv", lambda: (written(OLD) / "triples.tsv").unlink()),
    ("entities.tsv|SHA-256", lambda: (written(OLD) / "entities.tsv").write_text("x")),
    ("embedding.json", lambda: (written(OLD) / "embedding.json").write_bytes(b"{")),
    ("embedding.json|version", manifest(version=1)),
    ("embedding.json|pickle", manifest(pickle="x")),
    ("vectors.safetensors", put("vectors.safetensors", b"x" * 50)),
    ("vectors.safetensors|tensor 'entities'", tensors(entities=np.full((6, 4), np.nan))),
    ("vectors.safetensors|tensor 'words'", tensors(words=np.ones((6, 2), np.int64))),
    ("relations.tsv|line 2", put("relations.tsv", b"relation\n \nx\n")),
    ("relations.tsv|line 3", put("relations.tsv", b"relation\nx\n\x1b\n")),
    ("relations.tsv|UTF-8", put("relations.tsv", b"relation\nat\nh\xff\n")),
    ("triples.tsv|line 2", put("triples.tsv", b"head\trelation\ttail\nbed\tatLocation\tsofa\n")),
]
FOLDER_CASES = [
    Typed(f"a home: {names}", "ask bed atLocation", names, before=before) for names, before in HOMES
]
#: A dry run copies the home into memory, and names its folder alone.
DRY = "remove --fact kettle atLocation kitchen --dry-run"
FOLDER_CASES += [
    Typed(f"a dry run, {names}", DRY, names.replace(".sqlite", ""), before=before)
    for names, before in HOMES
]
FOLDER_CASES += [
    Typed(f"plain files: {names}", "import old --out out", f"old/{names}", before=before)
    for names, before in PLAIN
]
