"""What is told to a home, what a change did, and the changes as they are listed."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from isi.config import check
from isi.errors import InputError, short
from isi.insertion.arguments import listed_triples
from isi.live.bundle import Fact
from isi.live.home import Home


def as_time(value: Any) -> Any:
    """A time with its zone, of a text in ISO 8601, of a datetime (both without a zone: local time,
    as Python has it) or of seconds since 1970.
    """
    given = value
    try:
        if isinstance(value, str):
            value = datetime.fromisoformat(value)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            value = datetime.fromtimestamp(value, UTC)
        return value.astimezone(UTC) if isinstance(value, datetime) else value
    except (ValueError, OverflowError, OSError) as error:
        expected = "expected a time such as 2026-11-25T09:30:00Z, or seconds since 1970"
        raise ValueError(f"{expected}, got {short(given)}") from error


Time = Annotated[datetime, BeforeValidator(as_time)]
Confidence = Annotated[float, Field(gt=0, le=1)]


@dataclass(frozen=True)
class Effect:
    """What a change did."""

    inserted: list[str] = field(default_factory=list)
    updated: list[str] = field(default_factory=list)  #: inserted entities with a new vector
    removed: list[str] = field(default_factory=list)
    relations: list[str] = field(default_factory=list)  #: new ones
    facts: int = 0  #: number of facts that hold now and did not before
    lost: list[Fact] = field(default_factory=list)  #: facts that held before and do not now
    known: int = 0  #: number of facts that held already, and were seen again
    notes: list[str] = field(default_factory=list)  #: sentences


@dataclass(frozen=True)
class Change:
    """A change since the first training, as ``history`` lists it."""

    id: int
    verb: str
    time: str  #: UTC
    source: str | None  #: what reported it
    undone: bool
    inserted: list[str] = field(default_factory=list)
    removed: list[str] = field(default_factory=list)
    added: list[Fact] = field(default_factory=list)  #: facts that held afterwards and not before
    seen: list[Fact] = field(default_factory=list)  #: facts that held already
    lost: list[Fact] = field(default_factory=list)  #: facts that held before and not afterwards


#: The list of a ``Change`` that names what an effect was on.
_LISTS = {
    "added": "added",
    "restored": "added",
    "seen": "seen",
    "removed": "lost",
    "retracted": "lost",
}


def changes_of(home: Home) -> list[Change]:
    """All changes of a home, in order; of one that undoes another, the effects are reversed."""
    query = "SELECT id, verb, time, source, undone, undoes FROM change ORDER BY id"
    changes, number_of = list[Change](), dict[int, list[tuple[Change, bool]]]()
    for number, verb, time, source, undone, undoes in home.read(query):
        change = Change(number, verb, time, source, undone is not None)
        changes.append(change)
        number_of.setdefault(undoes or number, []).append((change, undoes is not None))
    query = "SELECT change, effect, entity, head, relation, tail FROM effect ORDER BY rowid"
    for number, effect, entity, *fact in home.read(query):
        for change, is_undo in number_of[number]:
            if entity:
                is_new = (effect == "added") != is_undo
                (change.inserted if is_new else change.removed).append(entity)
            elif fact[0]:
                name = _LISTS[effect]
                if is_undo and name != "seen":
                    name = "lost" if name == "added" else "added"
                getattr(change, name).append((fact[0], fact[1], fact[2]))
    return changes


def told(facts: Any, confidence: float | None = None) -> dict[Fact, float | None]:
    """Facts in any form of ``listed_triples``, by name and once each, with their confidence: a
    fourth part of a fact, or else ``confidence``.

    An ``InputError`` refuses what is not three texts and perhaps a number.
    """
    check(confidence, Confidence | None, "", "argument 'confidence'")  # type: ignore[arg-type]
    listed = dict[Fact, float | None]()
    for number, row in enumerate(listed_triples(facts)):
        parts = list(row) if isinstance(row, list | tuple) or hasattr(row, "tolist") else [row]
        if len(parts) not in (3, 4) or not all(isinstance(part, str) for part in parts[:3]):
            expected = "expected head, relation and tail by name, and perhaps a confidence"
            raise InputError(f"fact {number}", "", f"{expected}, got {short(row)}")
        believed = confidence
        if len(parts) == 4:
            believed = check(parts[3], Confidence, "confidence", f"fact {number}")
        head, relation, tail = parts[:3]
        listed[head, relation, tail] = believed
    return listed


def names_in(facts: Iterable[Fact]) -> list[str]:
    """The ends of facts, once each, in order."""
    return list(dict.fromkeys(end for head, _, tail in facts for end in (head, tail)))
