"""The tables of a home's database, and what of them a home that is trained again carries over."""

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
