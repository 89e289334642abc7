"""Changes are taken back, or forgotten."""

import json
from contextlib import suppress
from typing import Any

from isi.errors import InputError
from isi.home.connection import DatabaseFailure
from isi.home.database import LAST_TRAINING, Database
from isi.home.facts import before, effect_of, seen, stored

#: A change that may be taken back.
STANDS = f"verb NOT IN ('undo', 'train', 'forget') AND undone IS NULL AND id > ({LAST_TRAINING})"
#: Effects of later changes that were not undone; ``?1``: the change that they are later than.
LATER = (
    "effect JOIN change ON change.id = effect.change"
    " WHERE effect.change > ?1 AND undone IS NULL AND undoes IS NULL"
)
_ENTITIES, _RELATIONS, _FACTS = (
    f"(SELECT {column} FROM effect WHERE change = ?1)" for column in ("entity", "relation", "fact")
)
_ENDS = (
    f"(SELECT head FROM fact WHERE id IN {_FACTS} UNION SELECT tail FROM fact WHERE id IN {_FACTS})"
)
#: The last change that stands on another one.
STANDS_ON = (
    f"SELECT max(change.id) FROM {LATER} AND ("
    f"effect.entity IN {_ENTITIES} OR effect.entity IN {_ENDS}"
    f" OR fact IN (SELECT id FROM fact WHERE head IN {_ENTITIES} OR tail IN {_ENTITIES}"
    f" OR relation IN {_RELATIONS})"
    f" OR fact IN {_FACTS} AND NOT (effect = 'seen' OR effect = 'believed'"
    " AND confidence IS NOT NULL))"
)

#: What was removed, and no effect names any more.
UNUSED = (
    "DELETE FROM fact WHERE status = 'removed'"
    " AND id NOT IN (SELECT fact FROM effect WHERE fact IS NOT NULL)",
    "DELETE FROM entity WHERE status = 'removed'"
    " AND id NOT IN (SELECT entity FROM effect WHERE entity IS NOT NULL)"
    " AND id NOT IN (SELECT head FROM fact UNION SELECT tail FROM fact)",
    "DELETE FROM relation WHERE status = 'removed'"
    " AND id NOT IN (SELECT relation FROM effect WHERE relation IS NOT NULL)"
    " AND id NOT IN (SELECT relation FROM fact)",
)


def last_change_of(database: Database, source: str | None = None) -> int:
    """The last change since training that was not undone; ``source``: of those that it reported.
    ``InputError`` if there is none.
    """
    query = f"SELECT max(id) FROM change WHERE {STANDS} AND (?1 IS NULL OR source = ?1)"
    change = database.value(query, source)
    if change is None:
        of_source = "" if source is None else f" of {source!r:.80}"
        raise InputError("undo", "", f"there is no change{of_source} to take back")
    return int(change)


def put_back(database: Database, change: int, target: int | None = None) -> None:
    """Undo a change since training as if it had not been made; ``change`` is the one that does so.
    To be called in a transaction.

    ``target``: None: the last one that was not undone. Facts that later changes have seen again
    stay, as these have told them. An ``InputError`` names a later change that has done anything
    else to the same facts or entities: it has to be undone first.
    """
    if target is None:
        target = last_change_of(database)
    elif database.value(f"SELECT id FROM change WHERE id = ? AND {STANDS}", target) is None:
        expected = "expected a change since training that was not undone"
        raise InputError("undo", f"change {target}", expected)
    if (last := database.value(STANDS_ON, target)) is not None:
        raise InputError("undo", f"change {target}", f"a later change needs it: undo {last} first")
    database.execute("UPDATE change SET undoes = ? WHERE id = ?", target, change)
    database.execute("UPDATE change SET undone = ? WHERE id = ?", change, target)
    query = (
        "SELECT entity, relation, fact, before FROM effect WHERE change = ? ORDER BY number DESC"
    )
    for entity, relation, fact, value in database.rows(query, target):
        if fact is not None:
            _put_fact_back(database, change, target, fact, value)
        elif relation is not None:
            database.execute("UPDATE relation SET status = 'removed' WHERE id = ?", relation)
        elif value is None:
            database.take_entity(change, entity)
        else:
            database.bring_entity(change, entity, json.loads(value))


def _put_fact_back(database: Database, change: int, target: int, fact: int, value: Any) -> None:
    """Undo what a change has done to a fact: ``value``, what stood ``before``."""
    query = (
        f"SELECT change.id, number, time, source, confidence, before FROM {LATER} AND fact = ?2"
        " ORDER BY change.id"
    )
    later = database.rows(query, target, fact)
    now = row = database.fact_of_id(fact)
    for *_, value_before in reversed(later):
        row = before(row, value_before)
    row = before(row, value)
    for number, place, time, source, confidence, _ in later:
        after = seen(row, time, source, confidence)
        database.execute(
            "UPDATE effect SET effect = ?, before = ? WHERE change = ? AND number = ?",
            *(effect_of(row, after), stored(row, after), number, place),
        )
        row = after
    database.list_effect(change, effect_of(now, row), fact=fact)
    database.write_fact(now, row)


def forget(database: Database, time: str, source: str | None = None) -> int:
    """Forget all changes before the first one that is not older than a time: they are listed no
    longer and cannot be undone, and what holds stays. Then their space is given back. The number
    of forgotten changes.

    The last training stays listed, and the forgetting is listed as a change.
    """
    database.execute("PRAGMA foreign_keys = 0")  # they would be looked for row by row
    try:
        with database.transaction(waiting=0):
            first = database.value("SELECT min(id) FROM change WHERE time >= ?", time)
            first = database.last_change()[0] + 1 if first is None else first
            older = f"id < ? AND id <> ({LAST_TRAINING})"
            number = int(database.value(f"SELECT count(*) FROM change WHERE {older}", first))
            if number:
                database.execute("DELETE FROM effect WHERE change < ?", first)
                database.execute(f"DELETE FROM change WHERE {older}", first)
                for statement in UNUSED:
                    database.execute(statement)
                database.add_change("forget", database.next_time(), source)
    finally:
        database.execute("PRAGMA foreign_keys = 1")
    if number:
        with suppress(DatabaseFailure):  # another program reads, or the disk is full
            database.execute("VACUUM")
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    return number
