"""What a change of a home did, and the changes as they are listed."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from isi.config import check
from isi.errors import InputError, short
from isi.home.bundle import Fact
from isi.home.database import Database
from isi.home.verbs import Confidence
from isi.insertion.arguments import listed_triples


@dataclass(frozen=True)
class Effect:
    """What a change did."""

    inserted: list[str] = field(default_factory=list)
    updated: list[str] = field(default_factory=list)  #: inserted entities with a new vector
    removed: list[str] = field(default_factory=list)
    relations: list[str] = field(default_factory=list)  #: new ones
    facts: int = 0  #: number of facts that hold now and did not before
    lost: list[Fact] = field(default_factory=list)  #: facts that held before and do not now
    seen: int = 0  #: number of facts that held already, and were seen again
    notes: list[str] = field(default_factory=list)  #: sentences


@dataclass
class Change:
    """A change since the first training, as ``history`` lists it."""

    id: int
    verb: str
    time: datetime  #: in UTC
    source: str | None  #: what reported it
    undone: bool
    inserted: list[str] = field(default_factory=list)
    removed: list[str] = field(default_factory=list)
    relations: list[str] = field(default_factory=list)  #: new ones
    added: list[Fact] = field(default_factory=list)  #: facts that held afterwards and not before
    seen: list[Fact] = field(default_factory=list)  #: facts that held already
    unseen: list[Fact] = field(default_factory=list)  #: facts that were seen once less: of undo
    lost: list[Fact] = field(default_factory=list)  #: facts that held before and not afterwards
    believed: list[Fact] = field(default_factory=list)  #: of ``seen``, with another confidence
    training: bool = False  #: whether facts of training came or went

    @property
    def has_effect(self) -> bool:
        """Whether an entity or a fact came, went or was seen."""
        facts = self.added, self.seen, self.lost, self.unseen
        return any([self.inserted, self.removed, *facts])


def effect_of(change: Change, updated: Sequence[str] = (), notes: Sequence[str] = ()) -> Effect:
    """What a change did; ``updated``: entities whose vectors it has computed."""
    of_unseen = [f"{' '.join(fact)} counts as seen once less" for fact in change.unseen]
    return Effect(
        inserted=change.inserted,
        updated=[name for name in updated if name not in change.inserted],
        removed=change.removed,
        relations=change.relations,
        facts=len(change.added),
        lost=change.lost,
        seen=len(change.seen),
        notes=list(dict.fromkeys([*notes, *of_unseen])),
    )


#: The list of a ``Change`` that has what an effect was on.
LISTS = {
    "inserted": "inserted",
    "removed": "removed",
    "new relation": "relations",
    "added": "added",
    "restored": "added",
    "taken": "lost",
    "retracted": "lost",
    "seen": "seen",
    "believed": "seen",
    "unseen": "unseen",
}


def changes_of(database: Database, first: int = 0) -> list[Change]:
    """The changes of a home from a number on, in order."""
    changes = dict[int, Change]()
    for number, verb, time, source, undone, _, effect, *item in database.effects(first):
        new = Change(number, verb, datetime.fromisoformat(time), source, undone is not None)
        change = changes.setdefault(number, new)
        if effect is None:
            continue
        entity, head, relation, tail = item
        subject = (head, relation, tail) if head else entity or relation
        getattr(change, LISTS[effect]).append(subject)
        if effect == "believed":
            change.believed.append(subject)
        change.training |= effect in ("restored", "retracted")
    return list(changes.values())


def checked_facts(facts: Any, confidence: float | None = None) -> dict[Fact, float | None]:
    """Facts in any form of ``listed_triples``, by name and once each, with their confidence: a
    fourth part of a fact, or else ``confidence``.

    An ``InputError`` refuses what is not three texts and perhaps a number.
    """
    confidences = dict[Fact, float | None]()
    for number, row in enumerate(listed_triples(facts)):
        parts = list(row) if isinstance(row, list | tuple) or hasattr(row, "tolist") else [row]
        if len(parts) not in (3, 4) or not all(isinstance(part, str) for part in parts[:3]):
            expected = "expected head, relation and tail by name, and perhaps a confidence"
            raise InputError(f"fact {number}", "", f"{expected}, got {short(row)}")
        believed = confidence
        if len(parts) == 4:
            believed = check(parts[3], Confidence, "confidence", f"fact {number}")
        head, relation, tail = parts[:3]
        confidences[head, relation, tail] = believed
    return confidences


def names_in(facts: Iterable[Fact], others: Iterable[str] = ()) -> list[str]:
    """Other names, and the ends of facts, once each, in order."""
    ends = (end for head, _, tail in facts for end in (head, tail))
    return list(dict.fromkeys([*others, *ends]))
