"""The changes of a live embedding, the entities and facts that they leave, and the file that lists them.

``journal.jsonl`` in the folder of a bundle has a line of JSON for each change, and one for each choice of an
initializer. Lines are only appended. A last line without a line end is of a process that was killed: it does not count.
"""

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from isi.bundle import folder as folders
from isi.bundle.folder import JOURNAL, Bundle, ManifestSection, NamedTriple, Text
from isi.config import Option, Seed
from isi.errors import InputError, at, unwritable


class NewEntity(ManifestSection):
    """What is given about a new entity, except its facts."""

    definition: Text | None = None
    kind: Text | None = None
    initializer: Text | None = None  #: null: the one chosen on hidden known entities
    options: dict[str, Option] = Field(default_factory=dict)
    seed: Seed = 0


class Change(ManifestSection):
    """One change. ``remove`` takes back entities with all their facts, or facts alone; ``undo`` the last change."""

    do: Literal["insert", "observe", "remove", "undo"]
    entities: dict[Text, NewEntity] = Field(default_factory=dict)
    facts: list[NamedTriple] = Field(default_factory=list)


class Chosen(ManifestSection):
    """The initializer for new entities with so many facts, with or without words (``isi.insertion.choice``)."""

    do: Literal["choose"] = "choose"
    facts: int
    words: bool
    initializer: Text
    options: dict[str, Option]
    why: Text
    warnings: list[str]


_LINE: TypeAdapter[Change | Chosen] = TypeAdapter(Annotated[Change | Chosen, Field(discriminator="do")])


@dataclass
class Additions:
    """Inserted entities in order, and given facts without repeats, by name."""

    entities: dict[str, NewEntity] = field(default_factory=dict)
    facts: dict[tuple[str, str, str], None] = field(default_factory=dict)

    def changed(self, change: Change) -> "Additions":
        """The same additions after a change, which is no ``undo``."""
        if change.do == "remove":
            for name in change.entities:
                self.entities.pop(name, None)
            of_entities = [fact for fact in self.facts if {fact[0], fact[2]} & change.entities.keys()]
            for fact in (*of_entities, *change.facts):
                self.facts.pop(fact, None)
        else:
            self.entities |= change.entities
            self.facts |= dict.fromkeys(change.facts)
        return self


@dataclass(frozen=True)
class Effect:
    """What a change did."""

    inserted: list[str] = field(default_factory=list)
    updated: list[str] = field(default_factory=list)  #: inserted entities with a new vector
    removed: list[str] = field(default_factory=list)
    facts: int = 0  #: by how many the facts that were added are now more
    known: int = 0  #: number of facts that were known already
    notes: list[str] = field(default_factory=list)  #: sentences


def in_force(changes: Iterable[Change]) -> list[Change]:
    """The changes that no ``undo`` has taken back."""
    stack = list[Change]()
    for change in changes:
        if change.do == "undo":
            stack[-1:] = []
        else:
            stack.append(change)
    return stack


def additions_of(changes: Iterable[Change]) -> Additions:
    """What changes leave, ``undo`` included."""
    result = Additions()
    for change in in_force(changes):
        result.changed(change)
    return result


def from_records(bundle: Bundle) -> Iterator[Change]:
    """The changes of a bundle without a journal, by its records of insertions."""
    records, later = bundle.manifest.inserted, bundle.insertions()
    for record, kind in zip(records, bundle.kinds[len(bundle.kinds) - len(records) :], strict=True):
        del later[record.entity]
        about = NewEntity(
            definition=record.definition, kind=kind or None, initializer=record.initializer, options=record.options,
            seed=record.seed,
        )  # fmt: skip
        facts = [fact for fact in record.insert_triples if not {fact[0], fact[2]} & later.keys()]
        yield Change(do="insert", entities={record.entity: about}, facts=facts)


def read(folder: Path) -> list[Change | Chosen] | None:
    """The lines of a folder's journal; null without any. An ``InputError`` names the broken line."""
    path, lines = folder / JOURNAL, list[Change | Chosen]()
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
    return list(from_records(bundle)) if lines is None else [line for line in lines if isinstance(line, Change)]


def text_of(lines: Sequence[Change | Chosen]) -> str:
    """The lines as they stand in the file."""
    rows = (line.model_dump(exclude_defaults=True) | {"do": line.do} for line in lines)
    return "".join(json.dumps(row, ensure_ascii=False, allow_nan=False) + "\n" for row in rows)


class Journal:
    """A folder's journal, open for one process. A line is on the disk before ``append`` returns."""

    def __init__(self, folder: Path) -> None:
        """Open it, without a broken last line. An ``InputError`` refuses it where another process has it open."""
        import fcntl

        self.path = folder / JOURNAL
        try:
            self._lock = os.open(folder, os.O_RDONLY)  # of the folder, so that a journal without lines is no file
        except OSError as error:
            raise unwritable(folder, error) from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if self.path.exists():
                os.truncate(self.path, self.path.read_bytes().rfind(b"\n") + 1)
        except BlockingIOError as error:
            os.close(self._lock)
            raise InputError(folder, "", "another process has this embedding open (isi live?)") from error
        except OSError as error:
            raise unwritable(self.path, error) from error

    def append(self, lines: Sequence[Change | Chosen]) -> None:
        """Append lines; all or none of them after a failure."""
        content = text_of(lines).encode()
        try:
            with self.path.open("ab", buffering=0) as file:
                start = file.tell()
                try:
                    while content:
                        content = content[file.write(content) :]  # a disk that is nearly full takes a part
                    os.fsync(file.fileno())
                except OSError:
                    file.truncate(start)
                    raise
        except OSError as error:
            raise unwritable(self.path, error) from error

    def close(self) -> None:
        os.close(self._lock)
