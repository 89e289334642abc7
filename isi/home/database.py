"""The database of a home, ``home.sqlite``: entities, relations, facts, changes, vectors of what was
inserted, choices of initializers. All that is said to SQLite stands here and in ``schema``.

What it says is the state; nothing is kept beside it but the trained vectors, a safetensors file
that ``setting`` names by its digest. A change is one transaction. Its effects, with what stood
before, are in ``effect``: ``undo`` puts that back. Any tool that reads SQLite shows a home::

    sqlite3 home/home.sqlite "select * from now where head = 'mug'"
"""

import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from isi.errors import InputError
from isi.home.bundle import Bundle, Fact, NewEntity
from isi.home.schema import CARRIED_OVER, COLUMNS, KEYS, STEPS
from isi.names import plain

DATABASE = "home.sqlite"
WAITING = 60.0  #: Seconds that a change waits for those of other processes.
FACT = ("head", "relation", "tail")
LAST_TRAINING = "SELECT max(id) FROM change WHERE verb = 'train'"


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
    """A database, of a folder or in memory (``isi.home.folder`` makes and opens them)."""

    def __init__(self, path: str = ":memory:", folder: Path | None = None) -> None:
        """Connect to a file, or to a new database in memory; ``path`` may be a URI of SQLite's.

        Several threads may use it in turn. No transaction begins by itself.
        """
        self.folder = folder  #: None in memory
        self.vectors_folder = folder  #: where the trained vectors are
        self.is_read_only = False
        self._connection: sqlite3.Connection | None = None
        try:
            self._connection = sqlite3.connect(
                path,
                WAITING,
                isolation_level=None,
                check_same_thread=False,
                uri=path.startswith("file:"),
            )
        except sqlite3.DatabaseError as error:
            raise InputError(path, "", f"cannot be opened ({error})") from error

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

    @property
    def path(self) -> str:
        """Of the database, for messages."""
        return str(self.folder / DATABASE) if self.folder else "home"

    def use(self) -> None:
        """Prepare the database of a home for questions and changes."""
        self._checked_version(least=1)
        self.execute("PRAGMA journal_mode = WAL")
        self.execute("PRAGMA synchronous = FULL")
        self.upgrade()

    def use_to_read(self) -> None:
        """Prepare the database of a home for questions alone: its file stays as it is."""
        self.is_read_only = True
        self._checked_version(least=1)
        self.execute("PRAGMA query_only = 1")

    def _checked_version(self, least: int = 0) -> int:
        ((version,),) = self.rows("PRAGMA user_version")
        tables = {name for (name,) in self.rows("SELECT name FROM sqlite_master")}
        if tables and not {"setting", "effect"} <= tables:
            raise InputError(self.path, "", "is a database of another program")
        if version > len(STEPS):
            newer = f"was written by a newer isi (version {version} of the database)"
            raise InputError(self.path, "", newer)
        if version < least:
            raise InputError(self.path, "", "expected the database of a home")
        return int(version)

    def upgrade(self) -> None:
        """Bring the database to the newest version, step by step; an empty one gets its tables."""
        if self._checked_version() == len(STEPS):
            return
        with self.transaction():
            for number in range(self._checked_version(), len(STEPS)):
                for statement in STEPS[number]:
                    self.execute(statement)
                self.execute(f"PRAGMA user_version = {number + 1}")

    def copy_into(self, other: "Database") -> None:
        """Make another database a copy of this one."""
        of_folder = other if other.folder else self
        with of_folder._in_words():
            self.connection.backup(other.connection)

    # -- statements --------------------------------------------------------------------------------

    def rows(self, query: str, *values: Any) -> list[Any]:
        """The rows of a query."""
        with self._in_words():
            return self.connection.execute(query, values).fetchall()

    def execute(self, statement: str, *values: Any) -> int:
        """Change something; the id of the row that was inserted last."""
        with self._in_words():
            return int(self.connection.execute(statement, values).lastrowid or 0)

    def _insert(self, statement: str, table: str, row: Mapping[str, Any]) -> int:
        columns, places = ", ".join(row), ", ".join("?" * len(row))
        into = f"{statement} INTO {table} ({columns}) VALUES ({places})"
        return self.execute(into, *row.values())

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        """Turn errors of SQLite into an ``InputError`` with the file."""
        try:
            yield
        except sqlite3.DatabaseError as error:
            raise InputError(self.path, "", f"cannot be read or written ({error})") from error

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """All that is done inside, or nothing; it is durable afterwards. One inside another is a
        part of it.
        """
        if self.connection.in_transaction:
            yield
            return
        self.execute("BEGIN IMMEDIATE")
        try:
            with self._in_words():
                yield
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
        self.execute("BEGIN")
        self.rows("SELECT 1 FROM setting LIMIT 1")
        try:
            yield
        finally:
            if self._connection is not None:
                self._connection.rollback()

    def version(self) -> int:
        """A number that changes when another connection changes the database."""
        return int(self.rows("PRAGMA data_version")[0][0])

    # -- what it was trained on --------------------------------------------------------------------

    def put_training(self, bundle: Bundle, vectors: str | None, time: str, keep: bool) -> int:
        """Make this the home of a newly trained embedding, ``bundle``, whose tables are in the file
        ``vectors``; the number of the change. To be called in a transaction.

        ``keep``: what is known of facts and entities stays, and what was told while it was trained
        is told again. Otherwise only the history of a home without changes is left.
        """
        if keep:
            for table in ("entity", "fact"):
                self.execute(f"CREATE TEMP TABLE old_{table} AS SELECT * FROM {table}")
        for table in ("entity", "relation", "fact", "vector", "choice", "setting"):
            self.execute(f"DELETE FROM {table}")
        self._fill(bundle)
        self.put_setting("vectors", vectors)
        number = self.add_change("train", time)
        for statement in CARRIED_OVER if keep else ():
            self.execute(statement)
        return number

    def _fill(self, bundle: Bundle) -> None:
        connection = self.connection
        for name, value in bundle.manifest.model_dump(mode="json").items():
            self.put_setting(name, value)
        kinds = (kind or None for kind in bundle.kinds)
        entities = zip(
            range(len(bundle.entity_names)), bundle.entity_names, kinds, bundle.phrases, strict=True
        )
        add_entity = "INSERT INTO entity (id, name, trained, kind, phrase) VALUES (?, ?, 1, ?, ?)"
        connection.executemany(add_entity, entities)
        relations = enumerate(bundle.relation_names)
        connection.executemany("INSERT INTO relation VALUES (?, ?, 1, NULL)", relations)
        counts = [1] * len(bundle.triples) if bundle.counts is None else bundle.counts.tolist()
        facts = ((*fact, count) for fact, count in zip(bundle.named_triples(), counts, strict=True))
        add_fact = (
            "INSERT INTO fact (head, relation, tail, status, count) VALUES (?, ?, ?, 'trained', ?)"
        )
        connection.executemany(add_fact, facts)

    def last_training(self) -> Any:
        """What tells the last training from others; None before the first."""
        query = (
            "SELECT id, time, (SELECT value FROM setting WHERE name = 'vectors') FROM change"
            " WHERE verb = 'train' ORDER BY id DESC LIMIT 1"
        )
        trainings = self.rows(query)
        return trainings[0] if trainings else None

    def settings(self) -> dict[str, Any]:
        """The manifest of the trained embedding, and the name of its file of ``vectors``: None in
        memory. Empty before training.
        """
        return {name: json.loads(value) for name, value in self.rows("SELECT * FROM setting")}

    def put_setting(self, name: str, value: Any) -> None:
        """Write a setting; ``value`` is what JSON holds."""
        self.execute("REPLACE INTO setting VALUES (?, ?)", name, json.dumps(value))

    def trained_entities(self) -> list[tuple[str, str | None, str]]:
        """Name, kind and phrase of each trained entity, in the order of its vectors."""
        return self.rows("SELECT name, kind, phrase FROM entity WHERE trained ORDER BY id")

    def trained_relations(self) -> list[str]:
        """The names of the trained relations, in the order of their vectors."""
        relations = self.rows("SELECT name FROM relation WHERE trained ORDER BY id")
        return [name for (name,) in relations]

    def trained_facts(self) -> list[tuple[str, str, str, int]]:
        """Head, relation, tail and count of each fact of training, those that were retracted
        included.
        """
        query = "SELECT head, relation, tail, count FROM fact WHERE status <> 'added' ORDER BY id"
        return self.rows(query)

    def unknown_name(self) -> str | None:
        """A name in ``fact`` that its table has not, since another program has written it; None if
        there is none.
        """
        names = self.rows(
            "SELECT relation FROM fact WHERE relation NOT IN (SELECT name FROM relation)"
            " UNION SELECT head FROM fact WHERE head NOT IN (SELECT name FROM entity)"
            " UNION SELECT tail FROM fact WHERE tail NOT IN (SELECT name FROM entity) LIMIT 1"
        )
        return names[0][0] if names else None

    # -- what holds --------------------------------------------------------------------------------

    def about(self, name: str) -> NewEntity:
        """What was told about an inserted entity."""
        query = "SELECT kind, definition, initializer, options, seed FROM entity WHERE name = ?"
        ((kind, definition, initializer, options, seed),) = self.rows(query, name)
        return NewEntity(
            kind=kind,
            definition=definition,
            initializer=initializer,
            options=json.loads(options),
            seed=seed,
        )

    def inserted(self) -> list[str]:
        """The inserted entities, in order."""
        entities = self.rows("SELECT name FROM entity WHERE NOT trained ORDER BY id")
        return [name for (name,) in entities]

    def relations(self) -> list[str]:
        """The names of all relations."""
        return [name for (name,) in self.rows("SELECT name FROM relation")]

    def new_relations(self) -> dict[str, bytes | None]:
        """The relations that are not trained, in order, and their vectors; None without one."""
        return dict(self.rows("SELECT name, vector FROM relation WHERE NOT trained ORDER BY id"))

    def fact(self, fact: Fact) -> StoredFact | None:
        """What is known of a fact, whether it holds or not."""
        rows = self._facts(KEYS["fact"], *fact)
        return rows[0] if rows else None

    def facts(self) -> list[StoredFact]:
        """The facts that hold, in order."""
        return self._facts("status <> 'retracted'")

    def facts_of(self, entity: str) -> list[StoredFact]:
        """The facts that hold of an entity."""
        return self._facts("status <> 'retracted' AND (head = ?1 OR tail = ?1)", entity)

    def facts_of_relation(self, relation: str) -> list[StoredFact]:
        """The facts of a relation, also those that do not hold."""
        return self._facts("relation = ?", relation)

    def facts_with(self, status: Literal["added", "retracted"]) -> list[Fact]:
        """The facts that were added, or that hold no longer, in order."""
        query = "SELECT head, relation, tail FROM fact WHERE status = ? ORDER BY id"
        return self.rows(query, status)

    def facts_not_seen_since(self, time: str) -> list[StoredFact]:
        """The facts that hold and were not seen since a time, the oldest first; one that was not
        seen since training counts as seen then.
        """
        ((trained,),) = self.rows("SELECT max(time) FROM change WHERE verb = 'train'")
        condition = "status <> 'retracted' AND coalesce(last_seen, ?) < ?"
        facts = self._facts(condition, trained, time)
        return sorted(facts, key=lambda row: row.last_seen or trained)

    def _facts(self, condition: str, *values: Any) -> list[StoredFact]:
        query = f"SELECT {COLUMNS['fact']} FROM fact WHERE {condition} ORDER BY id"
        return [StoredFact(*row) for row in self.rows(query, *values)]

    # -- vectors and choices -----------------------------------------------------------------------

    def vectors_after(self, change: int) -> list[tuple[Any, ...]]:
        """What changes after one have computed of inserted entities: the columns that
        ``InsertedEntity.of_row`` takes, in order.
        """
        return self.rows(
            "SELECT entity, vector, vector.kind, vector.initializer, vector.options, why, fallback,"
            " notes, facts, words, entity.initializer, entity.options, seed"
            " FROM vector JOIN entity ON entity.name = vector.entity WHERE change > ?",
            change,
        )

    def put_vector(self, row: Mapping[str, Any]) -> None:
        """Write a row of ``vector``, by column."""
        self._insert("REPLACE", "vector", row)

    def put_relation_vector(self, relation: str, vector: bytes) -> None:
        """Write the vector of a relation that is not trained."""
        self.execute("UPDATE relation SET vector = ? WHERE name = ?", vector, relation)

    def choice(self, facts: int, words: bool, requested: str) -> tuple[Any, ...] | None:
        """Initializer, options, why, trained_with, warnings and curves of a choice, or None."""
        choices = self.rows(
            "SELECT initializer, options, why, trained_with, warnings, curves FROM choice"
            " WHERE facts = ? AND words = ? AND requested = ?",
            *(facts, words, requested),
        )
        return choices[0] if choices else None

    def put_choice(self, row: Mapping[str, Any]) -> None:
        """Write a row of ``choice``, by column."""
        self._insert("REPLACE", "choice", row)

    # -- changes -----------------------------------------------------------------------------------

    def add_change(self, verb: str, time: str, source: str | None = None) -> int:
        """List a change; its number."""
        return self._insert("INSERT", "change", {"verb": verb, "time": time, "source": source})

    def remove_change(self, change: int) -> None:
        """List a change no longer, since it has no effect."""
        self.execute("DELETE FROM change WHERE id = ?", change)

    def last_change(self) -> int:
        return int(self.rows("SELECT max(id) FROM change")[0][0])

    def number_of_changes(self) -> int:
        """Changes since training, those that were undone included."""
        return int(self.rows(f"SELECT count(*) FROM change WHERE id > ({LAST_TRAINING})")[0][0])

    def effects(self, first: int) -> list[tuple[Any, ...]]:
        """The effects of changes from a number on (of an undo: those that it takes back): id, verb,
        time, source, undone, undoes of the change; effect (None: there is none), entity and fact.
        """
        return self.rows(
            "SELECT id, verb, time, source, undone, undoes, effect, entity, head, relation, tail"
            " FROM change LEFT JOIN effect ON effect.change = coalesce(undoes, id)"
            " WHERE id >= ? ORDER BY id, effect.rowid",
            first,
        )

    def note(self, change: int, effect: str, table: str, *key: str) -> None:
        """List the effect of a change on a row, before it is made."""
        rows = self.rows(f"SELECT {COLUMNS[table]} FROM {table} WHERE {KEYS[table]}", *key)
        before = json.dumps(rows[0], ensure_ascii=False) if rows else None
        names = FACT if table == "fact" else (table,)
        subject = dict(zip(names, key, strict=True))
        row = {"change": change, "effect": effect, "before": before} | subject
        self._insert("INSERT", "effect", row)

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
        self.execute(
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
            self.execute("UPDATE fact SET status = 'retracted' WHERE id = ?", row.id)
        else:
            self.note(change, "taken", "fact", *fact)
            self.execute("DELETE FROM fact WHERE id = ?", row.id)

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
        self.execute("DELETE FROM entity WHERE name = ?", name)
        self.execute("DELETE FROM vector WHERE entity = ?", name)

    def add_relation(self, change: int, name: str) -> None:
        """Insert a relation, which has no vector yet."""
        self.note(change, "new relation", "relation", name)
        self._insert("INSERT", "relation", {"name": name, "trained": 0})

    def put_back(self, change: int) -> None:
        """Undo the effects of the last change since training that was not undone, the last one
        first; ``change`` is the one that does so. ``InputError`` if there is none.
        """
        ((target,),) = self.rows(
            "SELECT max(id) FROM change WHERE verb NOT IN ('undo', 'train') AND undone IS NULL"
            f" AND id > ({LAST_TRAINING})"
        )
        if target is None:
            raise InputError("undo", "", "there is no change to take back")
        self.execute("UPDATE change SET undoes = ? WHERE id = ?", target, change)
        self.execute("UPDATE change SET undone = ? WHERE id = ?", change, target)
        columns = "before, entity, head, relation, tail"
        query = f"SELECT {columns} FROM effect WHERE change = ? ORDER BY rowid DESC"
        for before, entity, *fact in self.rows(query, target):
            table = "entity" if entity else "fact" if fact[0] else "relation"
            key = {"entity": (entity,), "relation": (fact[1],), "fact": fact}[table]
            self.execute(f"DELETE FROM {table} WHERE {KEYS[table]}", *key)
            if before is not None:
                names = COLUMNS[table].split(", ")
                self._insert("INSERT", table, dict(zip(names, json.loads(before), strict=True)))
        self.execute("DELETE FROM vector WHERE entity NOT IN (SELECT name FROM entity)")
