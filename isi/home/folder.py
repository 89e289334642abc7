"""The folder of a home: its database, and a file of trained vectors that its digest names.

The vectors are written before the transaction that names them, so that a process that is killed
leaves a home that is whole.
"""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from safetensors.numpy import load, save

from isi.errors import InputError, at, short, unwritable
from isi.home.bundle import MANIFEST, Bundle, Manifest, check_numbers
from isi.home.changes import as_text, now
from isi.home.database import DATABASE, Database
from isi.tables.io import atomically
from isi.vocabulary import Vocabulary, ids_by_name

#: ``full``: a change is on the disk when it is acknowledged. ``memory``: changes stay in this
#: process, and the folder as it is.
Durability = Literal["full", "memory"]


# -- make, open and copy ---------------------------------------------------------------------------


def create(bundle: Bundle, folder: Path | None = None, time: str | None = None) -> Database:
    """The database of a new home of a trained embedding, in a folder or in memory.

    ``InputError`` if a home with changes is there, or what the folder has is no home.
    """
    database = Database()
    database.upgrade()
    with training(database, bundle, time):
        pass
    if folder is None:
        return database
    with database:
        write_to(folder, database, bundle)
    return opened(folder)


def opened(folder: Path, durability: Durability = "full") -> Database:
    """The database of a folder. ``InputError`` where there is none, or another program's file."""
    if not is_home(folder):
        files = "; of these files, isi import makes one" * (folder / MANIFEST).is_file()
        raise InputError(folder, "", f"expected a home: a folder with {DATABASE}{files}")
    if durability == "memory":
        with _to_read(folder) as database:
            return copied(database)
    if not os.access(folder, os.W_OK):
        return _to_read(folder)
    return _to_write(folder)


def is_home(path: Path) -> bool:
    """Whether a path is the folder of a home."""
    return (path / DATABASE).is_file()


def _to_write(folder: Path) -> Database:
    database = Database(str(folder / DATABASE), folder)
    try:
        database.use()
    except BaseException:
        database.close()
        raise
    return database


def _to_read(folder: Path) -> Database:
    """The database of a folder that stays as it is: it may be on a disk that is read-only."""
    path, parameters = folder / DATABASE, "mode=rw"  # which leaves no files for readers
    if not os.access(folder, os.W_OK):
        has_writer = path.with_name(f"{DATABASE}-wal").exists()
        parameters = "mode=ro" + "&immutable=1" * (not has_writer)
    database = Database(f"{path.absolute().as_uri()}?{parameters}", folder)
    try:
        database.use_to_read()
    except BaseException:
        database.close()
        raise
    return database


def copied(database: Database) -> Database:
    """A copy in memory; its trained vectors are read from the same folder."""
    copy = Database()
    copy.vectors_folder = database.vectors_folder
    database.copy_into(copy)
    copy.upgrade()
    return copy


def write_to(folder: Path, database: Database, bundle: Bundle) -> None:
    """Write a copy of a home, whose trained embedding is ``bundle``, into another folder, as a
    whole or not at all.
    """
    check_free(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from error
    with copied(database) as copy:
        copy.put_setting("vectors", write_vectors(folder, bundle))
        if is_home(folder):
            with _to_write(folder) as replaced:
                copy.copy_into(replaced)
        else:
            _link(copy, folder / DATABASE)
    _remove_vectors(folder)


def check_free(folder: Path) -> None:
    """``InputError`` unless a home may be written into a folder: there is none, it is empty, or it
    has a home without changes.
    """
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise InputError(folder, "", "a file or a link: choose a new name, or the folder of a home")
    present = sorted(path.name for path in folder.iterdir()) if folder.exists() else []
    if not present:
        return
    if DATABASE not in present:
        expected = "expected an empty folder, or a home without changes"
        raise InputError(folder, present[0], f"not a file of a home: {expected}")
    with opened(folder) as database:
        if number := database.number_of_changes():
            message = f"holds {number:,} changes: choose another folder, or retrain it (isi train)"
            raise InputError(folder, "", message)


def _link(database: Database, path: Path) -> None:
    """Write a database into a file that comes into being with all its content, unless another
    process has made it by then.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with Database(str(temporary)) as copy:
            database.copy_into(copy)
        with suppress(FileExistsError):
            os.link(temporary, path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


# -- the trained embedding -------------------------------------------------------------------------


@contextmanager
def training(
    database: Database, bundle: Bundle, time: str | None = None, keep: bool = False
) -> Iterator[int]:
    """Make a database that of a newly trained embedding (``Database.put_training``). What is done
    inside, and given the number of the change, is a part of it.
    """
    folder = database.folder
    vectors = write_vectors(folder, bundle) if folder else None
    try:
        with database.transaction():
            yield database.put_training(bundle, vectors, time or as_text(now()), keep)
    finally:
        if folder:
            _remove_vectors(folder)


def trained(database: Database) -> Bundle:
    """The trained embedding of a home. An ``InputError`` names what is missing or broken."""
    settings, path = database.settings(), database.path
    vectors = settings.pop("vectors", None)
    if database.vectors_folder is None or vectors is None:
        raise InputError(path, "setting", "expected the name of a file of vectors")
    with at(path, "setting"):
        manifest = Manifest.model_validate(settings)
    names, kinds, phrases = zip(*database.trained_entities(), strict=True)
    labels = database.trained_relations()
    tensors = read_vectors(database.vectors_folder / vectors, len(names), len(labels))
    facts = database.trained_facts()
    if (unknown := database.unknown_name()) is not None:
        expected = "expected names of the tables entity and relation"
        raise InputError(path, "fact", f"{expected}, got {short(unknown)}")
    entity_ids, label_ids = Vocabulary("entity", names).ids, Vocabulary("relation", labels).ids
    return Bundle(
        manifest,
        tensors["entities"],
        tensors["relations"],
        list(names),
        [kind or "" for kind in kinds],
        list(phrases),
        labels,
        ids_by_name([fact[:3] for fact in facts], entity_ids, label_ids),
        tensors.get("words"),
        np.array([count for *_, count in facts], np.int64),
    )


# -- the file of vectors ---------------------------------------------------------------------------


def write_vectors(folder: Path, bundle: Bundle) -> str:
    """Write the tables of an embedding into a file that their digest names; its name."""
    tensors = {"entities": bundle.entities, "relations": bundle.relations}
    if bundle.words is not None:
        tensors["words"] = bundle.words
    content = save({name: np.ascontiguousarray(table) for name, table in tensors.items()})
    name = f"vectors-{hashlib.sha256(content).hexdigest()[:16]}.safetensors"
    atomically(folder / name, partial(_write_durably, content=content))
    return name


def _write_durably(path: Path, content: bytes) -> None:
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def read_vectors(path: Path, entities: int, relations: int) -> dict[str, np.ndarray]:
    """The tables of a file of trained vectors; ``InputError`` if it is missing or broken."""
    with at(path):
        content = path.read_bytes()
    if hashlib.sha256(content).hexdigest()[:16] != path.stem.removeprefix("vectors-"):
        raise InputError(path, "", "its digest is not the one in its name: it was changed")
    tensors: dict[str, np.ndarray] = load(content)
    rows = {"entities": entities, "relations": relations, "words": entities}
    for name, table in tensors.items():
        with at(path, f"tensor {name!r}"):
            check_numbers(table, rows[name])
    return tensors


def _remove_vectors(folder: Path) -> None:
    """Remove files of trained vectors but the two newest: a process may still read the one before
    the last.
    """
    with suppress(OSError, InputError):
        with _to_read(folder) as database:
            in_force = database.settings().get("vectors")
        files = [path for path in folder.glob("vectors-*.safetensors") if path.name != in_force]
        files.sort(key=_age, reverse=True)
        for path in files[1:]:
            path.unlink()


def _age(path: Path) -> float:
    return path.stat().st_mtime
