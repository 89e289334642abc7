"""The database of a home, ``home.sqlite``: entities, relations, facts, changes, vectors of what was
inserted, choices of initializers.

What it says is the state; nothing is kept beside it but the trained vectors, a safetensors file
that ``setting`` names by its digest. A change is one transaction. Its effects, with what stood
before, are in ``effect``: ``undo`` puts that back. Any tool that reads SQLite shows a home::

    sqlite3 home/home.sqlite "select * from now where head = 'mug'"
"""

import hashlib
import json
import os
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from safetensors.numpy import load, save

from isi.errors import InputError, at, short, unwritable
from isi.graph.vocabulary import Vocabulary, ids_by_name
from isi.home.bundle import MANIFEST, Bundle, Fact, Manifest, NewEntity, check_numbers
from isi.names import plain
from isi.tables.io import atomically

DATABASE = "home.sqlite"
#: ``full``: a change is on the disk when it is acknowledged. ``memory``: changes stay in this
#: process, and the folder as it is.
Durability = Literal["full", "memory"]
WAITING = 60.0  #: Seconds that a change waits for those of other processes.

#: What each version of the database adds to the one before; ``PRAGMA user_version`` counts them.
STEPS: tuple[tuple[str, ...], ...] = (
    (
        "CREATE TABLE setting (name TEXT PRIMARY KEY, value TEXT NOT NULL)",  # value: JSON
        """
        CREATE TABLE entity (
            id INTEGER PRIMARY KEY,  -- of a trained one: its row in the trained vectors
            name TEXT NOT NULL UNIQUE,
            trained INTEGER NOT NULL,
            kind TEXT,
            phrase TEXT NOT NULL,  -- the words of its name
            definition TEXT,
            initializer TEXT,  -- that was asked for; none: the one chosen
            options TEXT NOT NULL DEFAULT '{}',
            seed INTEGER NOT NULL DEFAULT 0
        )
        """,
        """
        CREATE TABLE relation (
            id INTEGER PRIMARY KEY,
            name TEXT NOT NULL UNIQUE,
            trained INTEGER NOT NULL,
            vector BLOB  -- of one that is not trained
        )
        """,
        """
        CREATE TABLE fact (
            id INTEGER PRIMARY KEY,
            head TEXT NOT NULL,
            relation TEXT NOT NULL,
            tail TEXT NOT NULL,
            status TEXT NOT NULL CHECK (status IN ('trained', 'added', 'retracted')),
            count INTEGER NOT NULL DEFAULT 1,  -- how often it was observed
            confidence REAL,  -- from 0 to 1; none: it is believed
            first_seen TEXT,  -- UTC; none: not since training
            last_seen TEXT,
            source TEXT,  -- what reported it last
            UNIQUE (head, relation, tail)
        )
        """,
        "CREATE INDEX fact_of_tail ON fact (tail)",
        "CREATE INDEX fact_by_status ON fact (status)",
        """
        CREATE TABLE change (
            id INTEGER PRIMARY KEY,
            verb TEXT NOT NULL,
            time TEXT NOT NULL,
            source TEXT,
            undoes INTEGER REFERENCES change,
            undone INTEGER REFERENCES change
        )
        """,
        "CREATE INDEX change_that_trained ON change (verb) WHERE verb = 'train'",
        """
        CREATE TABLE effect (  -- of a change on an entity, on a relation or on a fact
            change INTEGER NOT NULL REFERENCES change,
            effect TEXT NOT NULL,
            entity TEXT,
            head TEXT,
            relation TEXT,
            tail TEXT,
            before TEXT  -- JSON of the row; none: there was none
        )
        """,
        "CREATE INDEX effect_of_change ON effect (change)",
        """
        CREATE TABLE vector (  -- of an inserted entity
            entity TEXT PRIMARY KEY REFERENCES entity (name),
            change INTEGER NOT NULL,
            initializer TEXT NOT NULL,
            options TEXT NOT NULL,
            why TEXT NOT NULL,
            fallback TEXT,
            kind TEXT NOT NULL,
            notes TEXT NOT NULL,
            facts INTEGER NOT NULL,  -- number and words, for which the initializer was chosen
            words INTEGER NOT NULL,
            vector BLOB NOT NULL
        )
        """,
        "CREATE INDEX vector_by_change ON vector (change)",
        """
        CREATE TABLE choice (  -- made on hidden known entities
            facts INTEGER NOT NULL,
            words INTEGER NOT NULL,
            requested TEXT NOT NULL,  -- an initializer and its options, or nothing
            initializer TEXT NOT NULL,
            options TEXT NOT NULL,
            why TEXT NOT NULL,
            trained_with TEXT NOT NULL,
            warnings TEXT NOT NULL,
            curves TEXT,  -- from scores to probabilities
            PRIMARY KEY (facts, words, requested)
        )
        """,
        """
        CREATE VIEW now AS
            SELECT head, relation, tail, status, count, confidence, first_seen, last_seen, source
            FROM fact WHERE status <> 'retracted'
        """,
        """
        CREATE VIEW history AS
            SELECT change.id, time, verb, source, effect, entity, head, relation, tail, undone,
                undoes
            FROM change LEFT JOIN effect ON effect.change = change.id
            ORDER BY change.id, effect.rowid
        """,
    ),
)
#: A name in ``fact`` that its table has not: of a fact that another program has written.
UNKNOWN = """
    SELECT relation FROM fact WHERE relation NOT IN (SELECT name FROM relation)
    UNION SELECT head FROM fact WHERE head NOT IN (SELECT name FROM entity)
    UNION SELECT tail FROM fact WHERE tail NOT IN (SELECT name FROM entity) LIMIT 1
"""
#: The columns of a row that ``effect.before`` holds, by table.
COLUMNS = {
    "entity": "id, name, trained, kind, phrase, definition, initializer, options, seed",
    "relation": "id, name, trained",
    "fact": ("id, head, relation, tail, status, count, confidence, first_seen, last_seen, source"),
}
KEYS = {
    "entity": "name = ?",
    "relation": "name = ?",
    "fact": "head = ? AND relation = ? AND tail = ?",
}
FACT = ("head", "relation", "tail")
#: What a home that is trained again keeps of before: what is known of facts; facts that the new
#: embedding lacks, since they were told while it was trained, and those that were retracted then;
#: their entities, and inserted ones without facts. What was removed meanwhile is retracted.
CARRIED_OVER = (
    "UPDATE entity SET (definition, initializer, options, seed) = "
    "(old.definition, old.initializer, old.options, old.seed) "
    "FROM old_entity AS old WHERE entity.name = old.name",
    "UPDATE fact SET (count, confidence, first_seen, last_seen, source) = "
    "(old.count, old.confidence, old.first_seen, old.last_seen, old.source), "
    "status = CASE old.status WHEN 'retracted' THEN 'retracted' ELSE 'trained' END "
    "FROM old_fact AS old "
    "WHERE (fact.head, fact.relation, fact.tail) = (old.head, old.relation, old.tail)",
    "UPDATE fact SET status = 'retracted' WHERE (head, relation, tail) NOT IN "
    "(SELECT head, relation, tail FROM old_fact)",
    "INSERT OR IGNORE INTO relation (name, trained) SELECT DISTINCT relation, 0 FROM old_fact "
    "WHERE status <> 'retracted'",
    "INSERT OR IGNORE INTO fact (head, relation, tail, status, count, confidence, first_seen, "
    "last_seen, source) SELECT head, relation, tail, 'added', count, confidence, first_seen, "
    "last_seen, source FROM old_fact "
    "WHERE status <> 'retracted' ORDER BY id",
    "INSERT OR IGNORE INTO entity (name, trained, kind, phrase, definition, initializer, options, "
    "seed) SELECT name, 0, kind, phrase, definition, initializer, options, seed FROM old_entity "
    "WHERE name IN (SELECT head FROM fact UNION SELECT tail FROM fact) OR NOT (trained OR name IN "
    "(SELECT head FROM old_fact UNION SELECT tail FROM old_fact)) ORDER BY id",
    "DROP TABLE temp.old_entity",
    "DROP TABLE temp.old_fact",
)
ADD_FACT = "INSERT INTO fact (head, relation, tail, status, count) VALUES (?, ?, ?, 'trained', ?)"


@dataclass(frozen=True)
class StoredFact:
    """A row of ``fact``, with its columns in order."""

    id: int
    head: str
    relation: str
    tail: str
    status: Literal["trained", "added", "retracted"]
    count: int
    confidence: float | None
    first_seen: str | None
    last_seen: str | None
    source: str | None

    @property
    def fact(self) -> Fact:
        return self.head, self.relation, self.tail


class Database:
    """A database, in a folder or in memory."""

    def __init__(self, folder: Path | None, connection: sqlite3.Connection) -> None:
        """Use ``create`` or ``opened``."""
        self.folder = folder  #: None in memory
        self.vectors_folder = folder  #: where the trained vectors are
        self.is_read_only = False
        self.read_training: Any = None  #: ``last_training`` when vectors were read or written.
        self._connection: sqlite3.Connection | None = connection

    # -- open and close ----------------------------------------------------------------------------

    @classmethod
    def create(
        cls, bundle: Bundle, folder: Path | None = None, time: str | None = None
    ) -> "Database":
        """A home of a trained embedding, in a folder or in memory.

        ``InputError`` if a home with changes is there, or what the folder has is no home.
        """
        database = cls(None, _connected(":memory:"))
        database._upgrade()
        with database.training(bundle, time):
            pass
        if folder is None:
            return database
        with database:
            database.write_to(folder, bundle)
        written = cls.opened(folder)
        written.read_training = written.last_training()
        return written

    @classmethod
    def opened(cls, folder: Path, durability: Durability = "full") -> "Database":
        """The home of a folder. ``InputError`` where there is none, or another program's file."""
        if not (folder / DATABASE).is_file():
            files = "; of these files, isi import makes one" * (folder / MANIFEST).is_file()
            raise InputError(folder, "", f"expected a home: a folder with {DATABASE}{files}")
        if durability == "memory":
            with cls._to_read(folder) as there:
                return there.copied()
        if not os.access(folder, os.W_OK):
            return cls._to_read(folder)
        return cls._in_folder(folder)

    @classmethod
    def _in_folder(cls, folder: Path) -> "Database":
        database = cls(folder, _connected(str(folder / DATABASE)))
        try:
            if not database._check_version():
                raise InputError(database.path, "", "expected the database of a home")
            database.read("PRAGMA journal_mode = WAL")
            database.read("PRAGMA synchronous = FULL")
            database._upgrade()
        except BaseException:
            database.close()
            raise
        return database

    @classmethod
    def _to_read(cls, folder: Path) -> "Database":
        """A home whose folder stays as it is: it may be on a disk that is read-only."""
        path, parameters = folder / DATABASE, "mode=rw"  # which leaves no files for readers
        if not os.access(folder, os.W_OK):
            has_writer = path.with_name(f"{DATABASE}-wal").exists()
            parameters = "mode=ro" + "&immutable=1" * (not has_writer)
        database = cls(folder, _connected(f"{path.absolute().as_uri()}?{parameters}"))
        database.is_read_only = True
        try:
            if not database._check_version():
                raise InputError(database.path, "", "expected the database of a home")
            database.read("PRAGMA query_only = 1")
        except BaseException:
            database.close()
            raise
        return database

    def copied(self) -> "Database":
        """A copy in memory; it reads its trained vectors from the same folder."""
        copy = Database(None, _connected(":memory:"))
        copy.vectors_folder = self.vectors_folder
        with self._in_words():
            self.connection.backup(copy.connection)
        copy._upgrade()
        return copy

    def write_to(self, folder: Path, bundle: Bundle) -> None:
        """Write a copy of the home, whose trained embedding is ``bundle``, into another folder, as
        a whole or not at all.
        """
        check_free(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(folder, error) from error
        with self.copied() as copy:
            copy.set("vectors", write_vectors(folder, bundle))
            if (folder / DATABASE).exists():
                with Database._in_folder(folder) as there, there._in_words():
                    copy.connection.backup(there.connection)
            else:
                copy._link(folder / DATABASE)
        _remove_vectors(folder)

    def _link(self, path: Path) -> None:
        """Write the database into a file that comes into being with all its content, unless another
        process has made it by then.
        """
        temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        try:
            with closing(_connected(str(temporary))) as there, self._in_words():
                self.connection.backup(there)
            with suppress(FileExistsError):
                os.link(temporary, path)
        except OSError as error:
            raise unwritable(path, error) from error
        finally:
            with suppress(OSError):
                temporary.unlink()

    @property
    def connection(self) -> sqlite3.Connection:
        """``InputError`` after ``close``."""
        if self._connection is None:
            raise InputError(self.folder or "this embedding", "", "is closed: open it again")
        return self._connection

    @property
    def is_closed(self) -> bool:
        return self._connection is None

    def close(self) -> None:
        """Close the database; a second time, nothing."""
        if self._connection is not None:
            self._connection.close()
        self._connection = None

    def __enter__(self) -> "Database":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _check_version(self) -> int:
        with self._in_words():
            ((version,),) = self.connection.execute("PRAGMA user_version")
        tables = {name for (name,) in self.read("SELECT name FROM sqlite_master")}
        if tables and not {"setting", "effect"} <= tables:
            raise InputError(self.path, "", "is a database of another program")
        if version > len(STEPS):
            newer = f"was written by a newer isi (version {version} of the database)"
            raise InputError(self.path, "", newer)
        return int(version)

    def _upgrade(self) -> None:
        """Bring the database to the newest version, step by step."""
        if self._check_version() == len(STEPS):
            return
        with self.transaction():
            for number in range(self._check_version(), len(STEPS)):
                for statement in STEPS[number]:
                    self.connection.execute(statement)
                self.connection.execute(f"PRAGMA user_version = {number + 1}")

    @property
    def path(self) -> str:
        """Of the database, for messages."""
        return str(self.folder / DATABASE) if self.folder else "home"

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        """Turn errors of SQLite into an ``InputError`` with the file."""
        try:
            yield
        except sqlite3.DatabaseError as error:
            raise InputError(self.path, "", f"cannot be read or written ({error})") from error

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """All that is done inside, or nothing; it is durable afterwards. One inside another is a
        part of it.
        """
        if self.connection.in_transaction:
            yield self.connection
            return
        with self._in_words():
            self.connection.execute("BEGIN IMMEDIATE")
        try:
            with self._in_words():
                yield self.connection
                self.connection.execute("COMMIT")
        except BaseException:
            with suppress(sqlite3.DatabaseError):
                self.connection.rollback()
            raise

    @contextmanager
    def snapshot(self) -> Iterator[None]:
        """All that is read inside is of one moment."""
        if self.connection.in_transaction:
            yield
            return
        with self._in_words():
            self.connection.execute("BEGIN")
            self.connection.execute("SELECT 1 FROM setting LIMIT 1").fetchall()
        try:
            yield
        finally:
            if self._connection is not None:
                self._connection.rollback()

    def read(self, query: str, *values: Any) -> list[Any]:
        """The rows of a statement."""
        with self._in_words():
            return self.connection.execute(query, values).fetchall()

    def version(self) -> int:
        """A number that changes when another connection changes the database."""
        return int(self.read("PRAGMA data_version")[0][0])

    # -- what it was trained on --------------------------------------------------------------------

    @contextmanager
    def training(
        self, bundle: Bundle, time: str | None = None, keep: bool = False
    ) -> Iterator[int]:
        """Make this the home of a newly trained embedding: its entities, relations and facts are
        those of ``bundle``. What is done inside, and given the number of the change, is a part of
        it.

        ``keep``: what is known of facts and entities stays, and what was told while it was trained
        is told again. Otherwise only the history of a home without changes is left.
        """
        name = write_vectors(self.folder, bundle) if self.folder else None
        try:
            with self.transaction():
                if keep:
                    for table in ("entity", "fact"):
                        self.read(f"CREATE TEMP TABLE old_{table} AS SELECT * FROM {table}")
                for table in ("entity", "relation", "fact", "vector", "choice", "setting"):
                    self.read(f"DELETE FROM {table}")
                self._fill(bundle)
                self.set("vectors", name)
                number = self.add_change("train", time or as_text(now()))
                for statement in CARRIED_OVER if keep else ():
                    self.read(statement)
                self.read_training = self.last_training()
                yield number
        finally:
            if self.folder:
                _remove_vectors(self.folder)

    def _fill(self, bundle: Bundle) -> None:
        connection = self.connection
        for key, value in bundle.manifest.model_dump(mode="json").items():
            self.set(key, value)
        kinds = (kind or None for kind in bundle.kinds)
        entities = zip(
            range(len(bundle.entity_names)), bundle.entity_names, kinds, bundle.phrases, strict=True
        )
        add = "INSERT INTO entity (id, name, trained, kind, phrase) VALUES (?, ?, 1, ?, ?)"
        connection.executemany(add, entities)
        relations = enumerate(bundle.relation_names)
        connection.executemany("INSERT INTO relation VALUES (?, ?, 1, NULL)", relations)
        counts = [1] * len(bundle.triples) if bundle.counts is None else bundle.counts.tolist()
        facts = ((*fact, count) for fact, count in zip(bundle.named_triples(), counts, strict=True))
        connection.executemany(ADD_FACT, facts)

    def last_training(self) -> Any:
        """What tells the last training from others; None before the first."""
        query = (
            "SELECT id, time, (SELECT value FROM setting WHERE name = 'vectors') FROM change"
            " WHERE verb = 'train' ORDER BY id DESC LIMIT 1"
        )
        rows = self.read(query)
        return rows[0] if rows else None

    @property
    def vectors_file(self) -> str | None:
        """The name of the file of trained vectors; None in memory, and before training."""
        rows = self.read("SELECT value FROM setting WHERE name = 'vectors'")
        return json.loads(rows[0][0]) if rows else None

    def bundle(self) -> Bundle:
        """The trained embedding. An ``InputError`` names what is missing or broken."""
        training = self.last_training()
        settings = {name: json.loads(value) for name, value in self.read("SELECT * FROM setting")}
        name = settings.pop("vectors", None)
        if self.vectors_folder is None or name is None:
            raise InputError(self.path, "setting", "expected the name of a file of vectors")
        with at(self.path, "setting"):
            manifest = Manifest.model_validate(settings)
        entities = self.read("SELECT name, kind, phrase FROM entity WHERE trained ORDER BY id")
        names, kinds, phrases = zip(*entities, strict=True)
        labels = [
            row[0] for row in self.read("SELECT name FROM relation WHERE trained ORDER BY id")
        ]
        tensors = read_vectors(self.vectors_folder / name, len(names), len(labels))
        self.read_training = training
        facts = self.read(
            "SELECT head, relation, tail, count FROM fact WHERE status <> 'added' ORDER BY id"
        )
        for (unknown,) in self.read(UNKNOWN):
            expected = "expected names of the tables entity and relation"
            raise InputError(self.path, "fact", f"{expected}, got {short(unknown)}")
        entity_ids, label_ids = Vocabulary("entity", names).ids, Vocabulary("relation", labels).ids
        return Bundle(
            manifest,
            tensors["entities"],
            tensors["relations"],
            list(names),
            [kind or "" for kind in kinds],
            list(phrases),
            labels,
            ids_by_name(facts, entity_ids, label_ids),
            tensors.get("words"),
            np.array([row[3] for row in facts], np.int64),
        )

    def set(self, name: str, value: Any) -> None:
        """Write a setting; ``value`` is what JSON holds."""
        self.connection.execute("REPLACE INTO setting VALUES (?, ?)", (name, json.dumps(value)))

    # -- what holds --------------------------------------------------------------------------------

    def about(self, name: str) -> NewEntity:
        """What was told about an inserted entity."""
        query = "SELECT kind, definition, initializer, options, seed FROM entity WHERE name = ?"
        kind, definition, initializer, options, seed = self.read(query, name)[0]
        return NewEntity(
            kind=kind,
            definition=definition,
            initializer=initializer,
            options=json.loads(options),
            seed=seed,
        )

    def inserted(self) -> list[str]:
        """The inserted entities, in order."""
        rows = self.read("SELECT name FROM entity WHERE NOT trained ORDER BY id")
        return [name for (name,) in rows]

    def fact(self, fact: Fact) -> StoredFact | None:
        """What is known of a fact, whether it holds or not."""
        rows = self.facts(KEYS["fact"], *fact)
        return rows[0] if rows else None

    def facts(self, where: str = "1", *values: Any) -> list[StoredFact]:
        """The facts of a condition, in order."""
        query = f"SELECT {COLUMNS['fact']} FROM fact WHERE {where} ORDER BY id"
        return [StoredFact(*row) for row in self.read(query, *values)]

    def facts_of(self, entity: str) -> list[StoredFact]:
        """The facts that hold of an entity."""
        return self.facts("status <> 'retracted' AND (head = ?1 OR tail = ?1)", entity)

    # -- changes -----------------------------------------------------------------------------------

    def add_change(self, verb: str, time: str, source: str | None = None) -> int:
        """List a change; its number."""
        add = "INSERT INTO change (verb, time, source) VALUES (?, ?, ?) RETURNING id"
        return int(self.read(add, verb, time, source)[0][0])

    def note(self, change: int, effect: str, table: str, *key: str) -> None:
        """List the effect of a change on a row, before it is made."""
        rows = self.read(f"SELECT {COLUMNS[table]} FROM {table} WHERE {KEYS[table]}", *key)
        before = json.dumps(rows[0], ensure_ascii=False) if rows else None
        names = ("head", "relation", "tail") if table == "fact" else (table,)
        item = dict(zip(names, key, strict=True))
        self._insert(
            "INSERT", "effect", {"change": change, "effect": effect, "before": before} | item
        )

    def put_fact(
        self, change: int, fact: Fact, time: str, source: str | None, confidence: float | None
    ) -> None:
        """Let a fact hold, and count that it was seen."""
        row = self.fact(fact)
        if row is None:
            self.note(change, "added", "fact", *fact)
            new = {"status": "added", "confidence": confidence, "source": source}
            new |= {"first_seen": time, "last_seen": time}
            self._insert("INSERT", "fact", dict(zip(FACT, fact, strict=True)) | new)
            return
        is_believed = confidence not in (None, row.confidence)
        effect = "believed" if is_believed else "seen"
        if row.status == "retracted":
            effect = "restored"
        self.note(change, effect, "fact", *fact)
        self.read(
            "UPDATE fact SET status = replace(status, 'retracted', 'trained'), count = count + 1,"
            " confidence = coalesce(?2, confidence), source = coalesce(?4, source),"
            " first_seen = min(coalesce(first_seen, ?3), ?3),"
            " last_seen = max(coalesce(last_seen, ?3), ?3) WHERE id = ?1",
            *(row.id, confidence, time, source),
        )

    def take_fact(self, change: int, fact: Fact) -> None:
        """Let a fact hold no longer: one of training is retracted, another one is gone. An
        ``InputError`` refuses one that does not hold.
        """
        row = self.fact(fact)
        if row is None or row.status == "retracted":
            raise InputError("", " ".join(fact), "expected a fact that holds")
        if row.status == "trained":
            self.note(change, "retracted", "fact", *fact)
            self.read("UPDATE fact SET status = 'retracted' WHERE id = ?", row.id)
        else:
            self.note(change, "taken", "fact", *fact)
            self.read("DELETE FROM fact WHERE id = ?", row.id)

    def add_entity(self, change: int, name: str, about: NewEntity) -> None:
        """Insert an entity; its vector comes by ``put_vector``."""
        self.note(change, "inserted", "entity", name)
        row = {"name": name, "trained": 0, "phrase": plain(name)} | about.model_dump()
        self._insert("INSERT", "entity", row | {"options": json.dumps(about.options)})

    def remove_entity(self, change: int, name: str) -> None:
        """Remove an inserted entity with its facts."""
        for row in self.facts_of(name):
            self.take_fact(change, row.fact)
        self.note(change, "removed", "entity", name)
        self.read("DELETE FROM entity WHERE name = ?", name)
        self.read("DELETE FROM vector WHERE entity = ?", name)

    def add_relation(self, change: int, name: str) -> None:
        """Insert a relation, which has no vector yet."""
        self.note(change, "new relation", "relation", name)
        self._insert("INSERT", "relation", {"name": name, "trained": 0})

    def put_vector(self, row: Mapping[str, Any]) -> None:
        """Write a row of ``vector``."""
        self._insert("REPLACE", "vector", row)

    def _insert(self, statement: str, table: str, row: Mapping[str, Any]) -> None:
        places = ", ".join("?" * len(row))
        self.read(f"{statement} INTO {table} ({', '.join(row)}) VALUES ({places})", *row.values())

    def put_back(self, change: int) -> None:
        """Undo the effects of the last change since training that was not undone, the last one
        first; ``change`` is the one that does so. ``InputError`` if there is none.
        """
        ((target,),) = self.read(
            "SELECT max(id) FROM change WHERE verb NOT IN ('undo', 'train') AND undone IS NULL"
            " AND id > (SELECT max(id) FROM change WHERE verb = 'train')"
        )
        if target is None:
            raise InputError("undo", "", "there is no change to take back")
        self.read("UPDATE change SET undoes = ? WHERE id = ?", target, change)
        self.read("UPDATE change SET undone = ? WHERE id = ?", change, target)
        query = (
            "SELECT before, entity, head, relation, tail FROM effect WHERE change = ?"
            " ORDER BY rowid DESC"
        )
        for before, entity, *fact in self.read(query, target):
            table = "entity" if entity else "fact" if fact[0] else "relation"
            key = {"entity": (entity,), "relation": (fact[1],), "fact": fact}[table]
            self.read(f"DELETE FROM {table} WHERE {KEYS[table]}", *key)
            if before is not None:
                names = COLUMNS[table].split(", ")
                self._insert("INSERT", table, dict(zip(names, json.loads(before), strict=True)))
        self.read("DELETE FROM vector WHERE entity NOT IN (SELECT name FROM entity)")

    def number_of_changes(self) -> int:
        """Changes since training, those that were undone included."""
        query = (
            "SELECT count(*) FROM change"
            " WHERE id > (SELECT max(id) FROM change WHERE verb = 'train')"
        )
        return int(self.read(query)[0][0])


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
    with Database.opened(folder) as database:
        if number := database.number_of_changes():
            message = f"holds {number:,} changes: choose another folder, or retrain it (isi train)"
            raise InputError(folder, "", message)


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


def _remove_vectors(folder: Path) -> None:
    """Remove files of trained vectors but the two newest: a process may still read the one before
    the last.
    """
    with suppress(OSError, InputError):
        with Database._to_read(folder) as database:
            in_force = database.vectors_file
        files = [path for path in folder.glob("vectors-*.safetensors") if path.name != in_force]
        files.sort(key=_age, reverse=True)
        for path in files[1:]:
            path.unlink()


def _age(path: Path) -> float:
    return path.stat().st_mtime


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


def _connected(path: str) -> sqlite3.Connection:
    """A connection that several threads may use in turn, without implicit transactions."""
    try:
        return sqlite3.connect(
            path,
            WAITING,
            isolation_level=None,
            check_same_thread=False,
            uri=path.startswith("file:"),
        )
    except sqlite3.DatabaseError as error:
        raise InputError(path, "", f"cannot be opened ({error})") from error


def now() -> datetime:
    """The time of a change that gives none: in UTC, to the second."""
    return datetime.now(UTC).replace(microsecond=0)


def as_text(time: datetime) -> str:
    """A time as the database holds it: in UTC, to the second, so that texts order as times do."""
    return f"{time.astimezone(UTC).replace(microsecond=0, tzinfo=None).isoformat()}Z"
