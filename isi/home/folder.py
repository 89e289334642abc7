"""The folder of a home: its database is made, opened, copied and replaced."""

import os
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from isi.errors import InputError, at, unwritable
from isi.home.bundle import MANIFEST, Bundle, Manifest, check_numbers
from isi.home.connection import DATABASE, INDEX, LOG, Connection, DatabaseFailure
from isi.home.database import Database

#: ``full``: a change is on the disk when it is acknowledged. ``memory``: changes stay in this
#: process, and the folder as it is.
Durability = Literal["full", "memory"]


def create(bundle: Bundle, folder: Path | None = None, time: str | None = None) -> Database:
    """The database of a new home of a trained embedding, in a folder or in memory.

    ``InputError`` if a home with changes is there, or what the folder has is no home.
    """
    fill = partial(Database.put_training, bundle=bundle, time=time, keep=False)
    if folder is not None:
        _write(folder, fill)
        return opened(folder)
    database = Database()
    with database.transaction():
        database.make(fill)
    return database


def opened(folder: Path, durability: Durability = "full") -> Database:
    """The database of a folder. ``InputError`` where there is none, or another program's file.

    Where it cannot be written, or its disk is full, it is opened to read.
    """
    if not is_home(folder):
        files = "; of these files, isi import makes one" * (folder / MANIFEST).is_file()
        raise InputError(folder, "", f"expected a home: a folder with {DATABASE}{files}")
    refusal = _refusal(folder)
    if durability == "memory":
        database = Database()
        with Connection(folder, refusal) as source:
            source.copy_into(database)
        database.use(folder)
    else:
        try:
            database = Database(folder, refusal)
        except DatabaseFailure as error:
            if refusal:
                raise
            database = Database(folder, error.message)
    if database.is_new:
        database.close()
        raise InputError(folder / DATABASE, "", "expected the database of a home, got an empty one")
    return database


def is_home(path: Path) -> bool:
    """Whether a path is the folder of a home."""
    return (path / DATABASE).is_file()


def _refusal(folder: Path) -> str:
    """Why the home of a folder cannot be changed; empty if it can."""
    if not os.access(folder, os.W_OK):
        return f"cannot be changed: you may not write into {folder}"
    for ending in ("", LOG, INDEX):
        path = folder / f"{DATABASE}{ending}"
        if path.exists() and not os.access(path, os.W_OK):
            return f"cannot be changed: you may not write {path.name}, which {path.owner()} owns"
    return ""


def write_to(folder: Path, database: Database) -> None:
    """Write a copy of a home into another folder, as a whole or not at all. To be called in a
    snapshot.
    """
    _write(folder, partial(Database.copy_from, other=database))


def _write(folder: Path, fill: Callable[[Database], object]) -> None:
    """Write a home into a folder, or over one without changes; ``fill`` writes its rows."""
    check_free(folder)
    path = folder / DATABASE
    is_new = not path.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.touch()
    except OSError as error:
        raise unwritable(path, error) from error
    try:
        with Database(folder) as database:
            database.execute("PRAGMA foreign_keys = 0")
            with database.transaction():
                if database.checked_version():
                    _refuse_changes(database)
                database.make(fill)
            database.keep_log()
    except BaseException:
        with suppress(OSError):
            if is_new and not path.stat().st_size:
                path.unlink()
        raise


def check_free(folder: Path) -> None:
    """``InputError`` unless a home may be written into a folder: there is none, it is empty, or it
    has a home without changes.
    """
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise InputError(folder, "", "a file or a link: choose a new name, or the folder of a home")
    present = sorted(path.name for path in folder.iterdir()) if folder.exists() else []
    if DATABASE in present:
        with Database(folder, _refusal(folder)) as database:
            if not database.is_new:
                _refuse_changes(database)
    elif present:
        expected = "expected an empty folder, or a home without changes"
        raise InputError(folder, present[0], f"not a file of a home: {expected}")


def _refuse_changes(database: Database) -> None:
    if number := database.number_of_changes():
        message = f"holds {number:,} changes: choose another folder, or retrain it (isi train)"
        raise InputError(database.folder, "", message)


def trained(database: Database) -> Bundle:
    """The trained embedding of a home. An ``InputError`` names what is missing or broken."""
    with at(database.path, "setting"):
        manifest = Manifest.model_validate(database.settings())
    names, kinds, phrases = zip(*database.trained_entities(), strict=True)
    labels = database.trained_relations()
    rows = {"entities": len(names), "relations": len(labels), "words": len(names)}
    tables = database.tables()
    for name, number in rows.items():
        with at(database.path, f"trained {name}"):
            if name in tables:
                check_numbers(tables[name], number)
            elif name != "words":
                raise InputError("", "", "are missing: put a copy back")
    facts = np.array(database.trained_facts(), np.int64).reshape(-1, 4)
    return Bundle(
        manifest,
        tables["entities"],
        tables["relations"],
        list(names),
        [kind or "" for kind in kinds],
        list(phrases),
        labels,
        facts[:, :3],
        tables.get("words"),
        facts[:, 3],
    )
