"""A fact as the database holds it, and what changes make of it."""

import json
from dataclasses import dataclass, replace
from typing import Literal

from isi.home.bundle import Fact
from isi.home.times import as_seconds, of_seconds

#: What a change may change of a fact.
COLUMNS = ("status", "count", "confidence", "first_seen", "last_seen", "source")
#: What a change does to a fact by its status before and after. Another one has seen it.
EFFECTS = {
    ("removed", "added"): "added",
    ("added", "removed"): "taken",
    ("trained", "retracted"): "retracted",
    ("retracted", "trained"): "restored",
}


@dataclass(frozen=True)
class StoredFact:
    """A row of the table ``fact``, with names."""

    id: int
    head: str
    relation: str
    tail: str
    status: Literal["trained", "added", "retracted", "removed"]
    count: int
    confidence: float | None
    first_seen: str | None
    last_seen: str | None
    source: str | None

    @property
    def fact(self) -> Fact:
        return self.head, self.relation, self.tail


def seen(
    row: StoredFact, time: str, source: str | None = None, confidence: float | None = None
) -> StoredFact:
    """A fact after it was told once more."""
    if row.status == "removed":
        new = replace(row, status="added", count=1, confidence=confidence, source=source)
        return replace(new, first_seen=time, last_seen=time)
    return replace(
        row,
        status="trained" if row.status == "retracted" else row.status,
        count=row.count + 1,
        confidence=row.confidence if confidence is None else confidence,
        first_seen=min(row.first_seen or time, time),
        last_seen=max(row.last_seen or time, time),
        source=row.source if source is None else source,
    )


def effect_of(before: StoredFact, after: StoredFact) -> str:
    """What a change did to a fact."""
    effect = "seen" if before.confidence == after.confidence else "believed"
    if after.count < before.count:
        effect = "unseen"
    return EFFECTS.get((before.status, after.status), effect)


def changed_columns(before: StoredFact, after: StoredFact) -> list[str]:
    """The columns that a change has changed."""
    return [name for name in COLUMNS if getattr(before, name) != getattr(after, name)]


def stored(before: StoredFact, after: StoredFact) -> str | int | None:
    """What ``effect.before`` holds of a fact: None if it was not there; seconds since 1970 if it
    was only seen less; else the columns that a change has changed, or all if it removed the fact.
    """
    if before.status == "removed":
        return None
    names = changed_columns(before, after)
    if before.last_seen and after.count == before.count + 1 and {*names} <= {"count", "last_seen"}:
        return as_seconds(before.last_seen)
    if after.status == "removed":
        names = list(COLUMNS)
    return json.dumps({name: getattr(before, name) for name in names}, ensure_ascii=False)


def before(after: StoredFact, value: str | int | None) -> StoredFact:
    """A fact before a change, by what ``effect.before`` holds."""
    if value is None:
        return replace(after, status="removed")
    if isinstance(value, int):
        return replace(after, count=after.count - 1, last_seen=of_seconds(value))
    return replace(after, **json.loads(value))
