"""The database of a home, ``home.sqlite``: entities, relations, facts, changes, vectors, choices of
initializers. All that is said to SQLite stands here, in ``connection``, ``schema``, ``undo`` and
``upgrade``.

What it says is the state. A change is one transaction. Its effects, with what stood before, are in
``effect``: ``undo`` puts that back. Any tool that reads SQLite shows a home::

    sqlite3 home/home.sqlite "select * from now where head = 'mug'"
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from isi.errors import InputError, at
from isi.home.bundle import Bundle, Fact, check_numbers
from isi.home.connection import Connection
from isi.home.facts import StoredFact, changed_columns, effect_of, seen, stored
from isi.home.schema import (
    ALL_UNTRAINED,
    APPLICATION,
    FURTHER,
    PUT_TABLE,
    TABLES,
    TOLD_MEANWHILE,
    TRAINED_ENTITY,
    TRAINED_FACT,
    TRAINED_RELATION,
    VERSION,
    digest_of,
    row_of_table,
)
from isi.home.times import as_text, now
from isi.home.upgrade import upgrade
from isi.names import plain

LAST_TRAINING = "SELECT max(id) FROM change WHERE verb = 'train'"
HOLDS = "fact.status IN ('trained', 'added')"
ENTITY = "(SELECT id FROM entity WHERE name = {})"
RELATION = "(SELECT id FROM relation WHERE name = {})"
IS_FACT = (
    f"(fact.head, fact.relation, fact.tail) ="
    f" ({ENTITY.format('?')}, {RELATION.format('?')}, {ENTITY.format('?')})"
)
FACTS = (
    "SELECT fact.id, head.name, relation.name, tail.name, fact.status, count, confidence,"
    " first_seen, last_seen, source FROM fact JOIN entity AS head ON head.id = fact.head"
    " JOIN relation ON relation.id = fact.relation JOIN entity AS tail ON tail.id = fact.tail"
)
#: Facts of training come first.
IN_ORDER = "ORDER BY fact.row IS NULL, fact.row, fact.id"
#: The status of a fact that is taken, by the one before.
TAKEN: dict[str, Literal["retracted", "removed"]] = {"trained": "retracted", "added": "removed"}
#: What undoing the removal of an entity puts back.
OF_ENTITY = ("kind", "phrase", "definition", "initializer", "options", "seed")


#: Number, verb, time and source of a change.
Listed = tuple[int, str, str, str | None]
LISTED = "SELECT id, verb, time, source FROM change"


class Database(Connection):
    """The database of a folder or in memory (``isi.home.folder`` makes and opens them). It is asked
    and told by names.
    """

    def __init__(self, folder: Path | None = None, refusal: str = "") -> None:
        super().__init__(folder, refusal)
        try:
            self.use()
        except BaseException:
            self.close()
            raise

    def use(self, beside: Path | None = None) -> None:
        """Prepare a database for questions and changes; one without tables stays as it is.

        ``beside``: the folder with the vectors of version 1; None: that of the database.
        """
        version = self.checked_version()
        self.is_new = not version  #: whether it has no tables yet
        if version == 1:
            upgrade(self, beside or self.folder or Path())
        if version and self.folder and not self.is_read_only:
            self.keep_log()

    def checked_version(self) -> int:
        """The version of the tables; 0 without any. An ``InputError`` refuses what isi has not
        made.
        """
        application = self.value("PRAGMA application_id")
        version = int(self.value("PRAGMA user_version"))
        tables = {name for (name,) in self.rows("SELECT name FROM sqlite_master")}
        if application == APPLICATION and version > VERSION:
            newer = f"was written by a newer isi (version {version} of the database): update isi"
            raise InputError(self.path, "", newer)
        is_home = application == APPLICATION and version == VERSION and TABLES.keys() <= tables
        is_first = application == 0 and version == 1 and {"setting", "effect"} <= tables
        if is_home or is_first or (application, version, tables) == (0, 0, set()):
            return version
        raise InputError(self.path, "", "is a database of another program, or a damaged one")

    def make(self, fill: Callable[["Database"], object]) -> None:
        """Make the tables of a home anew, with the rows that ``fill`` writes. To be called in a
        transaction, without foreign keys if there are tables.
        """
        if self.checked_version():
            self.execute("DROP VIEW now")
            self.execute("DROP VIEW history")
            for table in TABLES:
                self.execute(f"DROP TABLE {table}")
        for statement in TABLES.values():
            self.execute(statement)
        fill(self)
        for statement in FURTHER:
            self.execute(statement)

    def copy_from(self, other: "Database") -> None:
        """Write all rows of another home into new tables."""
        for table in TABLES:
            rows = other.connection.execute(f"SELECT * FROM {table}")
            places = ", ".join("?" * len(rows.description))
            self.connection.executemany(f"INSERT INTO {table} VALUES ({places})", rows)

    def faults(self) -> list[str]:
        """What is damaged, a sentence each: pages, indexes, keys, trained vectors."""
        faults = [f"SQLite's check says: {row}" for (row,) in self.rows("PRAGMA integrity_check")]
        if faults == ["SQLite's check says: ok"]:
            faults = []
        faults += [
            f"table {table}, row {row}: what it refers to in {parent} is missing"
            for table, row, parent, _ in self.rows("PRAGMA foreign_key_check")
        ]
        try:
            self.tables()
        except InputError as error:
            faults.append(": ".join(filter(None, (error.place, error.message))))
        return faults

    def _insert(self, statement: str, table: str, row: Mapping[str, Any]) -> int:
        columns, places = ", ".join(row), ", ".join("?" * len(row))
        into = f"{statement} INTO {table} ({columns}) VALUES ({places})"
        return self.execute(into, *row.values())

    # -- what it was trained on --------------------------------------------------------------------

    def put_training(self, bundle: Bundle, time: str | None, keep: bool) -> int:
        """Make this the home of a newly trained embedding, ``bundle``; the number of the change. To
        be called in a transaction.

        ``keep``: what is known of facts and entities stays, and what was told while it was trained
        is told again.
        """
        for table in ("vector", "choice", "setting", "trained"):
            self.execute(f"DELETE FROM {table}")
        for statement in ALL_UNTRAINED:
            self.execute(statement)
        self._fill(bundle, "retracted" if keep else "trained")
        for statement in TOLD_MEANWHILE:
            self.execute(statement)
        return self.add_change("train", time or self.next_time())

    def _fill(self, bundle: Bundle, status: str) -> None:
        """Write a trained embedding; ``status``: of facts that are not there."""
        for name, value in bundle.manifest.model_dump(mode="json").items():
            self.execute("INSERT INTO setting VALUES (?, ?)", name, json.dumps(value))
        tables = {"entities": bundle.entities, "relations": bundle.relations}
        if bundle.words is not None:
            tables["words"] = bundle.words
        for name, table in tables.items():
            with at(self.path, f"trained {name}"):
                check_numbers(table, len(table))
            self.execute(PUT_TABLE, *row_of_table(name, table))
        many = self.connection.executemany
        names = enumerate(bundle.entity_names)
        entities = zip(names, bundle.kinds, bundle.phrases, strict=True)
        rows = ((name, row, kind or None, phrase) for (row, name), kind, phrase in entities)
        many(TRAINED_ENTITY, rows)
        many(TRAINED_RELATION, ((name, row) for row, name in enumerate(bundle.relation_names)))
        ids, labels = (
            np.array(self.rows(f"SELECT id FROM {table} WHERE row >= 0 ORDER BY row"))[:, 0]
            for table in ("entity", "relation")
        )
        heads, relations, tails = bundle.triples.T
        parts = (ids[heads].tolist(), labels[relations].tolist(), ids[tails].tolist())
        numbers = range(len(bundle.triples))
        counts = [1] * len(numbers) if bundle.counts is None else bundle.counts.tolist()
        many(TRAINED_FACT, zip(*parts, [status] * len(numbers), numbers, counts, strict=True))

    def last_training(self) -> Any:
        """What tells the last training from others; None before the first."""
        query = (
            "SELECT id, time, (SELECT group_concat(sha256) FROM trained), ? FROM change"
            " WHERE verb = 'train' ORDER BY id DESC LIMIT 1"
        )
        trainings = self.rows(query, self._copies)
        return trainings[0] if trainings else None

    def settings(self) -> dict[str, Any]:
        """The manifest of the trained embedding. Empty before training."""
        return {name: json.loads(value) for name, value in self.rows("SELECT * FROM setting")}

    def tables(self) -> dict[str, np.ndarray]:
        """The trained vectors: ``entities``, ``relations`` and perhaps ``words``. An ``InputError``
        refuses those that are not as they were written.
        """
        tables = dict[str, np.ndarray]()
        for name, dtype, rows, columns, digest, data in self.rows("SELECT * FROM trained"):
            if digest_of(name, dtype, rows, columns, data) != digest:
                damaged = "are not as they were written (their digest is another): put a copy back"
                raise InputError(self.path, f"trained {name}", damaged)
            table = np.frombuffer(data, np.dtype(dtype).newbyteorder("<"))
            tables[name] = table.reshape(rows, columns).astype(dtype)
        return tables

    def trained_entities(self) -> list[tuple[str, str | None, str]]:
        """Name, kind and phrase of each trained entity, in the order of its vectors."""
        return self.rows("SELECT name, kind, phrase FROM entity WHERE row >= 0 ORDER BY row")

    def trained_relations(self) -> list[str]:
        """The names of the trained relations, in the order of their vectors."""
        return self._names("SELECT name FROM relation WHERE row >= 0 ORDER BY row")

    def trained_facts(self) -> list[tuple[int, int, int, int]]:
        """Each fact of training, those that were retracted included: the rows of head, relation
        and tail in the trained vectors, and the count.
        """
        return self.rows(
            "SELECT head.row, relation.row, tail.row, count FROM fact"
            " JOIN entity AS head ON head.id = fact.head"
            " JOIN relation ON relation.id = fact.relation"
            " JOIN entity AS tail ON tail.id = fact.tail WHERE fact.row >= 0 ORDER BY fact.row"
        )

    # -- what holds --------------------------------------------------------------------------------

    def _names(self, query: str) -> list[str]:
        return [name for (name,) in self.rows(query)]

    def about(self, name: str) -> dict[str, Any]:
        """What was told about an inserted entity, by column."""
        query = "SELECT kind, definition, initializer, options, seed FROM entity WHERE name = ?"
        ((kind, definition, initializer, options, seed),) = self.rows(query, name)
        return {
            "kind": kind,
            "definition": definition,
            "initializer": initializer,
            "options": json.loads(options),
            "seed": seed,
        }

    def inserted(self) -> list[str]:
        """The inserted entities, in order."""
        return self._names("SELECT name FROM entity WHERE status = 'inserted' ORDER BY id")

    def relations(self) -> list[str]:
        """The names of all relations."""
        return self._names("SELECT name FROM relation WHERE status <> 'removed' ORDER BY id")

    def new_relations(self) -> dict[str, bytes | None]:
        """The relations that are not trained, in order, and their vectors; None without one."""
        query = "SELECT name, vector FROM relation WHERE status = 'inserted' ORDER BY id"
        return dict(self.rows(query))

    def fact(self, fact: Fact) -> StoredFact | None:
        """What is known of a fact, whether it holds, was retracted or removed."""
        rows = self._facts(IS_FACT, *fact)
        return rows[0] if rows else None

    def fact_of_id(self, number: int) -> StoredFact:
        """A fact by its id."""
        return self._facts("fact.id = ?", number)[0]

    def facts(self) -> list[StoredFact]:
        """The facts that hold: those of training, then those that were added, in order."""
        return self._facts(HOLDS)

    def facts_of(self, entity: str) -> list[StoredFact]:
        """The facts that hold of an entity."""
        ends = f"(fact.head = {ENTITY.format('?1')} OR fact.tail = {ENTITY.format('?1')})"
        return self._facts(f"{HOLDS} AND {ends}", entity)

    def facts_of_relation(self, relation: str) -> list[StoredFact]:
        """The facts that hold of a relation."""
        return self._facts(f"{HOLDS} AND fact.relation = {RELATION.format('?')}", relation)

    def facts_with(self, status: Literal["added", "retracted"]) -> list[Fact]:
        """The facts that were added, or that were retracted, in order."""
        return [row.fact for row in self._facts("fact.status = ?", status)]

    def doubtful_facts(self) -> list[StoredFact]:
        """The facts that hold and are believed less than fully."""
        return self._facts(f"{HOLDS} AND confidence < 1")

    def facts_not_seen_since(self, time: str) -> list[StoredFact]:
        """The facts that hold and were not seen since a time, the oldest first; one that was not
        seen since training counts as seen then.
        """
        trained = self.value("SELECT max(time) FROM change WHERE verb = 'train'")
        facts = self._facts(f"{HOLDS} AND coalesce(last_seen, ?) < ?", trained, time)
        return sorted(facts, key=lambda row: row.last_seen or trained)

    def _facts(self, condition: str, *values: Any) -> list[StoredFact]:
        query = f"{FACTS} WHERE {condition} {IN_ORDER}"
        return [StoredFact(*row) for row in self.rows(query, *values)]

    # -- vectors and choices -----------------------------------------------------------------------

    def vectors_since(self, change: int) -> list[tuple[Any, ...]]:
        """What changes from one on have computed of inserted entities: the columns that
        ``InsertedEntity.of_row`` takes, in order.
        """
        return self.rows(
            "SELECT name, vector, vector.kind, vector.initializer, vector.options, why, fallback,"
            " notes, facts, words, entity.initializer, entity.options"
            " FROM vector JOIN entity ON entity.id = vector.entity WHERE change >= ?",
            change,
        )

    def put_vector(self, row: Mapping[str, Any]) -> None:
        """Write a row of ``vector``, by column; ``entity`` is a name."""
        entity = self.value("SELECT id FROM entity WHERE name = ?", row["entity"])
        self._insert("REPLACE", "vector", {**row, "entity": entity})

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

    def next_time(self) -> str:
        """The time of a change that gives none: now, and never before that of the last change."""
        last = self.value("SELECT time FROM change ORDER BY id DESC LIMIT 1")
        return max(as_text(now()), last or "")

    def add_change(self, verb: str, time: str, source: str | None = None) -> int:
        """List a change; its number."""
        return self._insert("INSERT", "change", {"verb": verb, "time": time, "source": source})

    def remove_change(self, change: int) -> None:
        """List a change no longer, since it has no effect."""
        self.execute("DELETE FROM change WHERE id = ?", change)

    def last_change(self) -> Listed:
        """Number, verb, time and source of the last change."""
        changes: list[Listed] = self.rows(f"{LISTED} ORDER BY id DESC LIMIT 1")
        return changes[0]

    def lists(self, change: Listed) -> bool:
        """Whether a change is listed: else it was forgotten, or a copy was put back."""
        return change in self.rows(f"{LISTED} WHERE id = ?", change[0])

    def number_of_changes(self) -> int:
        """Changes since training, those that were undone included."""
        return int(self.value(f"SELECT count(*) FROM change WHERE id > ({LAST_TRAINING})"))

    def effects(self, first: int) -> list[tuple[Any, ...]]:
        """The effects of changes from a number on: id, verb, time, source, undone, undoes of the
        change; effect (None: there is none), entity and fact.
        """
        return self.rows(
            "SELECT id, verb, time, source, undone, undoes, effect, entity, head, relation, tail"
            " FROM history WHERE id >= ?",
            first,
        )

    def put_fact(
        self, change: int, fact: Fact, time: str, source: str | None, confidence: float | None
    ) -> None:
        """Let a fact hold, and count that it was seen."""
        row = self.fact(fact)
        if row is None:
            ids = f"{ENTITY.format('?')}, {RELATION.format('?')}, {ENTITY.format('?')}"
            columns = "head, relation, tail, status"
            new = self.execute(f"INSERT INTO fact ({columns}) VALUES ({ids}, 'removed')", *fact)
            row = StoredFact(new, *fact, "removed", 1, None, None, None, None)
        self.change_fact(change, row, seen(row, time, source, confidence), confidence)

    def take_fact(self, change: int, fact: Fact) -> None:
        """Let a fact hold no longer: one of training is retracted, another one is removed. An
        ``InputError`` refuses one that does not hold.
        """
        row = self.fact(fact)
        if row is None or row.status not in TAKEN:
            raise InputError("", " ".join(fact), "expected a fact that holds")
        self.change_fact(change, row, replace(row, status=TAKEN[row.status]))

    def change_fact(
        self, change: int, before: StoredFact, after: StoredFact, confidence: float | None = None
    ) -> None:
        """Write a fact, and list that as an effect of a change; ``confidence``: that was told."""
        effect, value = effect_of(before, after), stored(before, after)
        self.list_effect(change, effect, fact=before.id, confidence=confidence, before=value)
        self.write_fact(before, after)

    def write_fact(self, before: StoredFact, after: StoredFact) -> None:
        """Write what has changed of a fact."""
        changed = changed_columns(before, after)
        columns = ", ".join(f"{name} = ?" for name in changed)
        values = [getattr(after, name) for name in changed]
        self.execute(f"UPDATE fact SET {columns} WHERE id = ?", *values, before.id)

    def list_effect(self, change: int, effect: str, **row: Any) -> None:
        """List an effect of a change."""
        last = self.value("SELECT max(number) FROM effect WHERE change = ?", change)
        number = 0 if last is None else last + 1
        self._insert(
            "INSERT", "effect", {"change": change, "number": number, "effect": effect} | row
        )

    def add_entity(self, change: int, name: str, about: Mapping[str, Any]) -> None:
        """Insert an entity, ``about`` which something was told; its vector comes by
        ``put_vector``.
        """
        row = {"name": name, "status": "inserted", "phrase": plain(name), **about}
        self._upsert("entity", row | {"options": json.dumps(about["options"])})
        self.list_effect(change, "inserted", entity=self._id("entity", name))

    def remove_entity(self, change: int, name: str) -> None:
        """Remove an inserted entity with its facts."""
        for row in self.facts_of(name):
            self.take_fact(change, row.fact)
        self.take_entity(change, self._id("entity", name))

    def take_entity(self, change: int, entity: int) -> None:
        """Remove an inserted entity, which has no facts."""
        ((*values,),) = self.rows(f"SELECT {', '.join(OF_ENTITY)} FROM entity WHERE id = ?", entity)
        before = json.dumps(dict(zip(OF_ENTITY, values, strict=True)), ensure_ascii=False)
        self.list_effect(change, "removed", entity=entity, before=before)
        self.execute("UPDATE entity SET status = 'removed' WHERE id = ?", entity)
        self.execute("DELETE FROM vector WHERE entity = ?", entity)

    def bring_entity(self, change: int, entity: int, row: Mapping[str, Any]) -> None:
        """Insert an entity that was removed, as it was."""
        self.list_effect(change, "inserted", entity=entity)
        columns = ", ".join(f"{name} = ?" for name in row)
        statement = f"UPDATE entity SET status = 'inserted', {columns} WHERE id = ?"
        self.execute(statement, *row.values(), entity)

    def add_relation(self, change: int, name: str) -> None:
        """Insert a relation, which has no vector yet."""
        self._upsert("relation", {"name": name, "status": "inserted", "vector": None})
        self.list_effect(change, "new relation", relation=self._id("relation", name))

    def _id(self, table: str, name: str) -> int:
        return int(self.value(f"SELECT id FROM {table} WHERE name = ?", name))

    def _upsert(self, table: str, row: Mapping[str, Any]) -> None:
        """Write a row, over one that was removed."""
        columns, places = ", ".join(row), ", ".join("?" * len(row))
        replaced = ", ".join(f"{name} = excluded.{name}" for name in row)
        self.execute(
            f"INSERT INTO {table} ({columns}) VALUES ({places})"
            f" ON CONFLICT (name) DO UPDATE SET {replaced}",
            *row.values(),
        )
