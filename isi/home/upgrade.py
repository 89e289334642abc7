"""The step from version 1 of the database of a home: names were texts in each row, the row before
an effect was a list, and the trained vectors were in a file of safetensors beside the database.
"""

import json
from hashlib import sha256
from pathlib import Path

import numpy as np
from safetensors.numpy import load

from isi.errors import InputError, at
from isi.home.connection import Connection
from isi.home.schema import FURTHER, PUT_TABLE, TABLES, row_of_table

OLD_INDEXES = (
    *("fact_of_tail", "fact_by_status", "change_that_trained"),
    *("effect_of_change", "vector_by_change"),
)


def _columns(names: str, first: int) -> str:
    """SQL of an object with the columns that ``before`` has from a place on."""
    pairs = (
        f"'{name}', json_extract(before, '$[{place}]')"
        for place, name in enumerate(names.split(), first)
    )
    return f"json_object({', '.join(pairs)})"


def _id(table: str, name: str) -> str:
    return f"(SELECT id FROM {table} WHERE {table}.name = old.{name})"


_FACT = f"{_id('entity', 'head')}, {_id('relation', 'relation')}, {_id('entity', 'tail')}"
_FACT_ID = f"(SELECT id FROM fact WHERE (fact.head, fact.relation, fact.tail) = ({_FACT}))"
#: Rows of the old tables as rows of the new ones, with names, facts and undone effects that had no
#: row.
FILL = (
    "INSERT INTO setting SELECT name, value FROM old_setting WHERE name <> 'vectors'",
    "INSERT INTO entity SELECT id, name, iif(trained, 'trained', 'inserted'), iif(trained, id,"
    " NULL), kind, phrase, definition, initializer, options, seed FROM old_entity",
    "INSERT OR IGNORE INTO entity (name, status, phrase) SELECT name, 'removed', name FROM"
    " (SELECT entity AS name FROM old_effect UNION SELECT head FROM old_effect"
    " UNION SELECT tail FROM old_effect) WHERE name IS NOT NULL",
    "INSERT INTO relation SELECT id, name, iif(trained, 'trained', 'inserted'), iif(trained, id,"
    " NULL), vector FROM old_relation",
    "INSERT OR IGNORE INTO relation (name, status)"
    " SELECT DISTINCT relation, 'removed' FROM old_effect WHERE relation IS NOT NULL",
    f"INSERT INTO fact SELECT id, {_FACT}, status, iif(status = 'added', NULL,"
    " row_number() OVER (ORDER BY status = 'added', id) - 1),"
    " count, confidence, first_seen, last_seen, source FROM old_fact AS old",
    "INSERT OR IGNORE INTO fact (head, relation, tail, status)"
    f" SELECT {_FACT}, 'removed' FROM old_effect AS old WHERE head IS NOT NULL",
    "INSERT INTO change SELECT * FROM old_change",
    "INSERT INTO effect SELECT change, row_number() OVER (PARTITION BY change ORDER BY rowid) - 1,"
    f" effect, {_id('entity', 'entity')}, iif(head IS NULL, {_id('relation', 'relation')}, NULL),"
    f" {_FACT_ID}, NULL, CASE WHEN before IS NULL THEN NULL WHEN head IS NULL"
    f" THEN {_columns('kind phrase definition initializer options seed', 3)}"
    f" ELSE {_columns('status count confidence first_seen last_seen source', 4)} END"
    " FROM old_effect AS old",
    "INSERT INTO effect SELECT change.id, number, CASE effect"
    " WHEN 'inserted' THEN 'removed' WHEN 'removed' THEN 'inserted' WHEN 'added' THEN 'taken'"
    " WHEN 'taken' THEN 'added' WHEN 'restored' THEN 'retracted' WHEN 'retracted' THEN 'restored'"
    " ELSE 'unseen' END, entity, NULL, fact, NULL, NULL"
    " FROM change JOIN effect ON effect.change = change.undoes WHERE effect <> 'new relation'",
    "INSERT INTO vector SELECT entity.id, change, old.initializer, old.options, why, fallback,"
    " old.kind, notes, facts, words, vector"
    " FROM old_vector AS old JOIN entity ON entity.name = old.entity",
    "INSERT INTO choice SELECT * FROM old_choice",
)


def upgrade(database: Connection, folder: Path) -> None:
    """Bring a database of version 1 to the newest one, as a whole or not at all; ``folder``: where
    the file of its trained vectors is.
    """
    old = [table for table in TABLES if table != "trained"]
    database.execute("PRAGMA foreign_keys = 0")
    try:
        with database.transaction(of_copy=True):
            name = json.loads(database.value("SELECT value FROM setting WHERE name = 'vectors'"))
            database.execute("DROP VIEW now")
            database.execute("DROP VIEW history")
            for index in OLD_INDEXES:
                database.execute(f"DROP INDEX {index}")
            for table in old:
                database.execute(f"ALTER TABLE {table} RENAME TO old_{table}")
            for statement in (*TABLES.values(), *FILL):
                database.execute(statement)
            for table in old:
                database.execute(f"DROP TABLE old_{table}")
            for statement in FURTHER:
                database.execute(statement)
            for table, vectors in _vectors(folder / name).items():
                database.execute(PUT_TABLE, *row_of_table(table, vectors))
    finally:
        database.execute("PRAGMA foreign_keys = 1")


def _vectors(path: Path) -> dict[str, np.ndarray]:
    with at(path):
        content = path.read_bytes()
    if sha256(content).hexdigest()[:16] != path.stem.removeprefix("vectors-"):
        raise InputError(path, "", "its digest is not the one in its name: it was changed")
    tables: dict[str, np.ndarray] = load(content)
    return tables
