"""The tables of a home's database.

Entities, relations and facts have ids that stay: what holds no longer is ``removed``, and what was
trained on has a ``row``, which training gives anew.
"""

from hashlib import sha256
from typing import Any

import numpy as np

APPLICATION = int.from_bytes(b"isih")  #: ``PRAGMA application_id``
VERSION = 2  #: ``PRAGMA user_version``; ``isi.home.upgrade`` has the step from 1.
#: Whoever writes, and whether or not foreign keys are on.
_REFUSED = "SELECT RAISE(ABORT, 'expected ids of the tables entity and relation')"
_UNKNOWN = """
    NEW.head NOT IN (SELECT id FROM entity) OR NEW.tail NOT IN (SELECT id FROM entity)
    OR NEW.relation NOT IN (SELECT id FROM relation)
"""
#: By name, parents first.
TABLES = {
    "setting": "CREATE TABLE setting (name TEXT PRIMARY KEY, value TEXT NOT NULL)",  # value: JSON
    "trained": """
        CREATE TABLE trained (  -- vectors: entities, relations and words
            name TEXT PRIMARY KEY,
            dtype TEXT NOT NULL,  -- float32 or float64, little-endian
            rows INTEGER NOT NULL,
            columns INTEGER NOT NULL,
            sha256 TEXT NOT NULL,
            data BLOB NOT NULL
        )
    """,
    "entity": """
        CREATE TABLE entity (
            id INTEGER PRIMARY KEY,
            name TEXT NOT NULL UNIQUE,
            status TEXT NOT NULL CHECK (status IN ('trained', 'inserted', 'removed')),
            row INTEGER,  -- of a trained one, in the trained vectors
            kind TEXT,
            phrase TEXT NOT NULL,  -- the words of its name
            definition TEXT,
            initializer TEXT,  -- that was asked for; none: the one chosen
            options TEXT NOT NULL DEFAULT '{}',
            seed INTEGER NOT NULL DEFAULT 0
        )
    """,
    "relation": """
        CREATE TABLE relation (
            id INTEGER PRIMARY KEY,
            name TEXT NOT NULL UNIQUE,
            status TEXT NOT NULL CHECK (status IN ('trained', 'inserted', 'removed')),
            row INTEGER,  -- of a trained one, in the trained vectors
            vector BLOB  -- of an inserted one
        )
    """,
    "fact": """
        CREATE TABLE fact (
            id INTEGER PRIMARY KEY,
            head INTEGER NOT NULL REFERENCES entity,
            relation INTEGER NOT NULL REFERENCES relation,
            tail INTEGER NOT NULL REFERENCES entity,
            -- retracted: of training, and holds no longer
            status TEXT NOT NULL CHECK (status IN ('trained', 'added', 'retracted', 'removed')),
            row INTEGER,  -- among the facts of training
            count INTEGER NOT NULL DEFAULT 1,  -- how often it was observed
            confidence REAL,  -- from 0 to 1; none: it is believed
            first_seen TEXT,  -- UTC; none: not since training
            last_seen TEXT,
            source TEXT,  -- what reported it last
            UNIQUE (head, relation, tail)
        )
    """,
    "change": """
        CREATE TABLE change (
            id INTEGER PRIMARY KEY,
            verb TEXT NOT NULL,
            time TEXT NOT NULL,
            source TEXT,
            undoes INTEGER,  -- a change
            undone INTEGER  -- by a change
        )
    """,
    "effect": """
        CREATE TABLE effect (  -- of a change on an entity, on a relation or on a fact
            change INTEGER NOT NULL REFERENCES change,
            number INTEGER NOT NULL,
            effect TEXT NOT NULL,
            entity INTEGER REFERENCES entity,
            relation INTEGER REFERENCES relation,
            fact INTEGER REFERENCES fact,
            confidence REAL,  -- that was told of a fact
            -- JSON of the columns as they were; none: it was not there;
            -- a number: the fact was seen once less, last at that time (seconds since 1970)
            before,
            PRIMARY KEY (change, number)
        ) WITHOUT ROWID
    """,
    "vector": """
        CREATE TABLE vector (  -- of an inserted entity
            entity INTEGER PRIMARY KEY REFERENCES entity,
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
    "choice": """
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
}
#: Indexes, views, and triggers that refuse what isi has not written.
FURTHER = (
    "CREATE INDEX fact_of_tail ON fact (tail)",
    "CREATE INDEX fact_by_status ON fact (status)",
    "CREATE INDEX change_that_trained ON change (verb) WHERE verb = 'train'",
    "CREATE INDEX vector_by_change ON vector (change)",
    f"CREATE TRIGGER fact_is_of_known BEFORE INSERT ON fact WHEN {_UNKNOWN} BEGIN {_REFUSED}; END",
    f"CREATE TRIGGER fact_stays_of_known BEFORE UPDATE OF head, relation, tail ON fact"
    f" WHEN {_UNKNOWN} BEGIN {_REFUSED}; END",
    f"CREATE TRIGGER entity_has_facts BEFORE DELETE ON entity"
    f" WHEN EXISTS (SELECT 1 FROM fact WHERE head = OLD.id OR tail = OLD.id) BEGIN {_REFUSED}; END",
    f"CREATE TRIGGER relation_has_facts BEFORE DELETE ON relation"
    f" WHEN OLD.id IN (SELECT relation FROM fact) BEGIN {_REFUSED}; END",
    """
    CREATE VIEW now AS
        SELECT head.name AS head, relation.name AS relation, tail.name AS tail, fact.status, count,
            confidence, first_seen, last_seen, source
        FROM fact JOIN entity AS head ON head.id = fact.head
            JOIN relation ON relation.id = fact.relation JOIN entity AS tail ON tail.id = fact.tail
        WHERE fact.status IN ('trained', 'added')
        ORDER BY fact.row IS NULL, fact.row, fact.id
    """,
    """
    CREATE VIEW history AS
        SELECT change.id, time, verb, change.source, effect, entity.name AS entity,
            head.name AS head, relation.name AS relation, tail.name AS tail, undone, undoes
        FROM change LEFT JOIN effect ON effect.change = change.id
            LEFT JOIN entity ON entity.id = effect.entity
            LEFT JOIN fact ON fact.id = effect.fact
            LEFT JOIN entity AS head ON head.id = fact.head
            LEFT JOIN relation ON relation.id = coalesce(effect.relation, fact.relation)
            LEFT JOIN entity AS tail ON tail.id = fact.tail
        ORDER BY change.id, effect.number
    """,
    f"PRAGMA application_id = {APPLICATION}",
    f"PRAGMA user_version = {VERSION}",
)
#: What a home that is trained again does with its rows: first, all are without a row of training;
ALL_UNTRAINED = (
    "UPDATE entity SET row = NULL, status = CASE status WHEN 'inserted' THEN status"
    " ELSE 'removed' END",
    "UPDATE relation SET row = NULL, vector = NULL, status = 'removed'",
    "UPDATE fact SET row = NULL, status = CASE status WHEN 'trained' THEN 'added'"
    " WHEN 'retracted' THEN 'removed' ELSE status END",
)
#: then those of the new embedding get theirs (a fact that
#: was removed meanwhile is retracted);
TRAINED_ENTITY = (
    "INSERT INTO entity (name, status, row, kind, phrase) VALUES (?, 'trained', ?, ?, ?)"
    " ON CONFLICT (name) DO UPDATE SET (status, row, kind, phrase) ="
    " ('trained', excluded.row, excluded.kind, excluded.phrase)"
)
TRAINED_RELATION = (
    "INSERT INTO relation (name, status, row) VALUES (?, 'trained', ?)"
    " ON CONFLICT (name) DO UPDATE SET (status, row) = ('trained', excluded.row)"
)
TRAINED_FACT = (
    "INSERT INTO fact (head, relation, tail, status, row, count) VALUES (?, ?, ?, ?, ?, ?)"
    " ON CONFLICT (head, relation, tail) DO UPDATE SET row = excluded.row,"
    " status = CASE status WHEN 'added' THEN 'trained' ELSE 'retracted' END"
)
#: and what facts hold of that were told meanwhile, is inserted.
TOLD_MEANWHILE = (
    "UPDATE relation SET status = 'inserted' WHERE status = 'removed'"
    " AND id IN (SELECT relation FROM fact WHERE status = 'added')",
    "UPDATE entity SET status = 'inserted' WHERE status = 'removed' AND id IN"
    " (SELECT head FROM fact WHERE status = 'added'"
    " UNION SELECT tail FROM fact WHERE status = 'added')",
)
PUT_TABLE = "INSERT INTO trained VALUES (?, ?, ?, ?, ?, ?)"


def row_of_table(name: str, table: np.ndarray) -> tuple[Any, ...]:
    """The row of ``trained`` for a table of vectors."""
    data = table.astype(table.dtype.newbyteorder("<"), order="C").tobytes()
    rows, columns = table.shape
    about = name, table.dtype.name, rows, columns
    return *about, digest_of(*about, data), data


def digest_of(name: str, dtype: str, rows: int, columns: int, data: bytes) -> str:
    """The SHA-256 of a table of vectors with its name, type and shape."""
    digest = sha256(f"{name} {dtype} {rows} {columns} ".encode())
    digest.update(data)
    return digest.hexdigest()
