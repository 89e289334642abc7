"""The changes of a live embedding, the state that they leave, and the file that lists them.

``journal.jsonl`` in the folder of a bundle has a line of JSON for each change, and one for each
choice of an initializer. Lines are only appended, but for ``isi compact``. A last line without a
line end is of a process that was killed: it does not count.
"""

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, TypeAdapter

from isi.config import Option, Seed
from isi.errors import InputError, at, short, unwritable
from isi.live import folder as folders
from isi.live.folder import JOURNAL, Bundle, ManifestSection, NamedTriple, Text
from isi.models.losses import Loss
from isi.tables.io import atomically

Fact = tuple[str, str, str]  #: Head, relation and tail by name.


def as_time(value: Any) -> Any:
    """A time in UTC, of a text in ISO 8601 (without a zone: in UTC) or of seconds since 1970."""
    given = value
    try:
        if isinstance(value, str):
            value = datetime.fromisoformat(value)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            value = datetime.fromtimestamp(value, UTC)
        if not isinstance(value, datetime):
            return value
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)
    except (ValueError, OverflowError, OSError) as error:
        expected = "expected a time such as 2026-11-25T09:30:00Z, or seconds since 1970"
        raise ValueError(f"{expected}, got {short(given)}") from error


Time = Annotated[datetime, BeforeValidator(as_time)]


class NewEntity(ManifestSection):
    """What is given about a new entity, except its facts."""

    definition: Text | None = None
    kind: Text | None = None
    initializer: Text | None = None  #: None: the one chosen on hidden known entities
    options: dict[str, Option] = Field(default_factory=dict)
    seed: Seed = 0


class Change(ManifestSection):
    """One change.

    ``remove`` takes back entities with all their facts, or facts alone: those that were added are
    gone, those that the embedding was trained on are retracted. ``move`` replaces facts by others.
    ``undo`` takes back the last change.
    """

    do: Literal["insert", "observe", "move", "remove", "undo"]
    entities: dict[Text, NewEntity] = Field(default_factory=dict)
    facts: list[NamedTriple] = Field(default_factory=list)
    replaced: list[NamedTriple] = Field(default_factory=list)  #: by ``facts``, of a move
    time: Time | None = None  #: when it was made, or what it reports was seen
    source: Text | None = None  #: what reported it: a camera, a person, a file

    @property
    def added(self) -> list[Fact]:
        """The facts that hold after it."""
        return [] if self.do == "remove" else self.facts

    @property
    def removed(self) -> list[Fact]:
        """The facts that do not hold after it, without those of removed entities."""
        return self.facts if self.do == "remove" else self.replaced

    @property
    def is_empty(self) -> bool:
        """Whether it changes nothing."""
        return not (self.entities or self.facts or self.replaced or self.do == "undo")


class Selected(ManifestSection):
    """The initializer for new entities with so many facts,
    with or without words (``isi.insertion.selection``).
    """

    do: Literal["choose"] = "choose"
    facts: int
    words: bool
    initializer: Text
    options: dict[str, Option]
    why: Text
    warnings: list[str]
    trained_with: Loss = "logistic"  #: assumed, where the embedding's loss is unknown


Line = Change | Selected
_LINE: TypeAdapter[Line] = TypeAdapter(Annotated[Line, Field(discriminator="do")])


@dataclass(frozen=True)
class Alteration:
    """What a change alters in ``Additions``."""

    inserted: dict[str, NewEntity]
    removed: dict[str, NewEntity]
    added: list[Fact]  #: facts that the embedding was not trained on
    dropped: list[Fact]  #: such facts that were added before
    retracted: list[Fact]  #: facts of training that no longer hold
    restored: list[Fact]  #: facts of training that were retracted and hold again
    order: tuple[str, ...] = ()  #: of the inserted entities before some are removed

    @property
    def inverse(self) -> "Alteration":
        """What takes it back."""
        return Alteration(
            self.removed,
            self.inserted,
            self.dropped,
            self.added,
            self.restored,
            self.retracted,
            self.order,
        )

    @property
    def holding(self) -> list[Fact]:
        """The facts that hold from now on."""
        return self.added + self.restored

    @property
    def lost(self) -> list[Fact]:
        """The facts that hold no longer."""
        return self.dropped + self.retracted


@dataclass
class Additions:
    """What changes leave: inserted entities in order, added facts,
    and facts of training that were retracted.
    """

    entities: dict[str, NewEntity] = field(default_factory=dict)
    facts: dict[Fact, None] = field(default_factory=dict)
    retracted: dict[Fact, None] = field(default_factory=dict)
    #: the added facts of each inserted entity
    of_entity: dict[str, set[Fact]] = field(default_factory=dict)
    done: list[Alteration] = field(default_factory=list)  #: by the changes in force, in order

    def alteration(self, change: Change) -> Alteration:
        """What a change would alter. ``undo`` needs a change in force."""
        if change.do == "undo":
            return self.done[-1].inverse
        is_removal = change.do == "remove"
        removed = {name: self.entities[name] for name in change.entities} if is_removal else {}
        dropped = dict[Fact, None]()
        for name in removed:
            dropped |= dict.fromkeys(sorted(self.of_entity[name]))
        dropped |= dict.fromkeys(fact for fact in change.removed if fact in self.facts)
        return Alteration(
            inserted={} if is_removal else dict(change.entities),
            removed=removed,
            added=[fact for fact in change.added if fact not in self.retracted],
            dropped=list(dropped),
            retracted=[fact for fact in change.removed if fact not in self.facts],
            restored=[fact for fact in change.added if fact in self.retracted],
            order=tuple(self.entities) if removed else (),
        )

    def alter(self, by: Alteration) -> None:
        """Alter the state by an alteration or its ``inverse``."""
        for fact in by.dropped:
            del self.facts[fact]
            for end in {fact[0], fact[2]} & self.of_entity.keys():
                self.of_entity[end].discard(fact)
        for name in by.removed:
            del self.entities[name], self.of_entity[name]
        self.entities |= by.inserted
        self.of_entity |= {name: set() for name in by.inserted}
        if by.inserted and by.order:  # a removal is taken back: the entities get their places again
            self.entities = {name: self.entities[name] for name in by.order}
        for fact in by.added:
            self.facts[fact] = None
            for end in {fact[0], fact[2]} & self.of_entity.keys():
                self.of_entity[end].add(fact)
        for fact in by.restored:
            del self.retracted[fact]
        self.retracted |= dict.fromkeys(by.retracted)

    def apply(self, change: Change) -> Alteration:
        """Make a change; the alteration that it makes. ``revert`` takes it back."""
        alteration = self.alteration(change)
        self.alter(alteration)
        if change.do == "undo":
            self.done.pop()
        else:
            self.done.append(alteration)
        return alteration

    def revert(self, change: Change, alteration: Alteration) -> None:
        """Take back the last ``apply``."""
        self.alter(alteration.inverse)
        if change.do == "undo":
            self.done.append(alteration.inverse)
        else:
            self.done.pop()


@dataclass(frozen=True)
class Effect:
    """What a change did."""

    inserted: list[str] = field(default_factory=list)
    updated: list[str] = field(default_factory=list)  #: inserted entities with a new vector
    removed: list[str] = field(default_factory=list)
    facts: int = 0  #: number of facts that hold now and did not before
    lost: list[Fact] = field(default_factory=list)  #: facts that held before and do not now
    known: int = 0  #: number of facts that were known already
    notes: list[str] = field(default_factory=list)  #: sentences


def now() -> datetime:
    """The time of a change that gives none: in UTC, to the second."""
    return datetime.now(UTC).replace(microsecond=0)


def additions_of(changes: Iterable[Change]) -> Additions:
    """What changes leave, ``undo`` included."""
    result = Additions()
    for change in changes:
        result.apply(change)
    return result


def replayed(
    changes: Sequence[Change], base: Bundle, file: Path | None, lines: Sequence[int]
) -> Additions:
    """What changes leave in a bundle of known entities with the triples of training.

    An ``InputError`` names the file and the line of the first change that does not fit: an unknown
    entity, relation or fact, a name that is known already, or nothing to undo. ``lines``: the
    number of each change's line.
    """
    result = Additions()
    names, relations = frozenset(base.entity_names), frozenset(base.relation_names)
    trained = frozenset(base.named_triples())
    for change, line in zip(changes, lines, strict=True):
        if fault := _fault(change, result, names, relations, trained):
            raise InputError(file or "changes", f"line {line}", fault)
        result.apply(change)
    return result


def _fault(
    change: Change,
    state: Additions,
    names: frozenset[str],
    relations: frozenset[str],
    trained: frozenset[Fact],
) -> str | None:
    """Why a change does not fit a state, or None."""
    if change.do == "undo":
        return None if state.done else "expected a change before it: there is none to undo"
    for name in change.entities:
        if change.do == "remove" and name not in state.entities:
            return f"expected an inserted entity, got {short(name)}"
        if change.do != "remove" and (name in names or name in state.entities):
            return f"expected a new entity: {short(name)} is known"
    for head, relation, tail in (*change.facts, *change.replaced):
        for end in (head, tail):
            if not (end in names or end in state.entities or end in change.entities):
                return f"unknown entity {short(end)}"
        if relation not in relations:
            return f"unknown relation {short(relation)}"
    for fact in change.removed:
        if fact not in state.facts and (fact not in trained or fact in state.retracted):
            return f"expected a fact that holds, got {short(' '.join(fact))}"
    for fact in change.added:
        if fact in state.facts or (fact in trained and fact not in state.retracted):
            return f"expected a new fact: {short(' '.join(fact))} is known"
    return None


def compacted(changes: Iterable[Change], written: Sequence[Fact] = ()) -> list[Change]:
    """A shorter list of changes, each with its time and source, that leaves the same state.

    Of each change, what a later one has taken back is left out, and ``undo`` with what it took
    back. ``written``: facts in the folder's ``triples.tsv`` that changes have added. Those that no
    longer hold are added and removed first: without these two changes, they would count as facts of
    training.
    """
    in_force = list[Change]()
    for change in changes:
        if change.do == "undo":
            in_force.pop()
        else:
            in_force.append(change)
    left = additions_of(in_force)
    entities, facts, retracted = dict(left.entities), dict(left.facts), dict(left.retracted)
    kept = list[Change]()
    for change in reversed(in_force):
        if change.do == "remove":
            named = {}
            of_facts = [fact for fact in change.facts if fact in retracted]
            replaced = list[Fact]()
        else:
            named = {name: about for name, about in change.entities.items() if name in entities}
            of_facts = [fact for fact in change.facts if fact in facts]
            replaced = [fact for fact in change.replaced if fact in retracted]
        for name in named:
            del entities[name]
        for fact in of_facts:
            del (retracted if change.do == "remove" else facts)[fact]
        for fact in replaced:
            del retracted[fact]
        update = {"entities": named, "facts": of_facts, "replaced": replaced}
        smaller = change.model_copy(update=update)
        if not smaller.is_empty:
            kept.append(smaller)
    gone = [fact for fact in written if fact not in left.facts]
    first = [Change(do="observe", facts=gone), Change(do="remove", facts=gone)] if gone else []
    return first + kept[::-1]


def from_records(bundle: Bundle) -> Iterator[Change]:
    """The changes of a bundle without a journal, by its records of insertions."""
    records, later = bundle.manifest.inserted, bundle.insertions()
    kinds = bundle.kinds[len(bundle.kinds) - len(records) :]
    for record, kind in zip(records, kinds, strict=True):
        del later[record.entity]
        about = NewEntity(
            definition=record.definition,
            kind=kind or None,
            initializer=record.initializer,
            options=record.options,
            seed=record.seed,
        )
        facts = [fact for fact in record.insert_triples if not {fact[0], fact[2]} & later.keys()]
        yield Change(do="insert", entities={record.entity: about}, facts=facts)


def read(folder: Path) -> list[Line] | None:
    """The lines of a folder's journal; None without any.
    An ``InputError`` names the broken line.
    """
    path, lines = folder / JOURNAL, list[Line]()
    if not path.exists():
        return None
    with at(path):
        content = path.read_bytes()
    for number, line in enumerate(content.split(b"\n")[:-1], 1):
        with at(path, f"line {number}"):
            lines.append(_LINE.validate_json(line))
    return lines or None


def history(folder: Path) -> list[Change]:
    """All changes of a bundle since training, those that were undone included."""
    bundle, lines = folders.read(folder), read(folder)
    if lines is None:
        return list(from_records(bundle))
    return [line for line in lines if isinstance(line, Change)]


def text_of(lines: Sequence[Line]) -> str:
    """The lines as they stand in the file."""
    rows = (line.model_dump(mode="json", exclude_defaults=True) | {"do": line.do} for line in lines)
    return "".join(json.dumps(row, ensure_ascii=False, allow_nan=False) + "\n" for row in rows)


class Journal:
    """A folder's journal, open for one process. A line is on the disk before ``append`` returns."""

    def __init__(self, folder: Path) -> None:
        """Open it. An ``InputError`` refuses it where another process has it open.

        A broken last line is cut off by the first ``append``, so that a folder on a read-only disk
        can be opened.
        """
        import fcntl

        self.path = folder / JOURNAL
        try:
            # of the folder: a journal without lines is no file
            self._lock = os.open(folder, os.O_RDONLY)
        except OSError as error:
            raise unwritable(folder, error) from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            content = self.path.read_bytes() if self.path.exists() else b""
        except BlockingIOError as error:
            self.close()
            message = "another process has this embedding open (isi live?)"
            raise InputError(folder, "", message) from error
        except OSError as error:
            self.close()
            raise unwritable(self.path, error) from error
        self._end = content.rfind(b"\n") + 1  #: bytes of whole lines

    def append(self, lines: Sequence[Line]) -> None:
        """Append lines; all or none of them after a failure."""
        content = text_of(lines).encode()
        try:
            with self.path.open("ab", buffering=0) as file:
                file.truncate(self._end)
                try:
                    left = content
                    while left:
                        left = left[file.write(left) :]  # a disk that is nearly full takes a part
                    os.fsync(file.fileno())
                except OSError:
                    file.truncate(self._end)
                    raise
        except OSError as error:
            raise unwritable(self.path, error) from error
        self._end += len(content)

    def replace(self, lines: Sequence[Line]) -> None:
        """Write these lines in place of all others; after a failure, the others stand."""
        content = text_of(lines).encode()

        def write(path: Path) -> None:
            with path.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())

        atomically(self.path, write)
        self._end = len(content)

    def close(self) -> None:
        """Let other processes open it."""
        os.close(self._lock)
