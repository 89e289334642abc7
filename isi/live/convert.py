"""Homes of before they were databases: a folder of a bundle with ``journal.jsonl``, which lists the
changes. Such a folder becomes a home when it is opened; its files stay.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from isi.errors import at
from isi.graph.graph import HEAD, TAIL
from isi.live.bundle import (
    MANIFEST,
    Bundle,
    EntityRecord,
    Fact,
    NamedTriple,
    NewEntity,
    Text,
    read,
)
from isi.live.changes import Stamp

JOURNAL = "journal.jsonl"


class Line(Stamp):
    """A line of a journal: a change."""

    do: Literal["insert", "observe", "move", "remove", "undo"]
    entities: dict[Text, NewEntity] = Field(default_factory=dict)
    facts: list[NamedTriple] = Field(default_factory=list)
    replaced: list[NamedTriple] = Field(default_factory=list)  #: by ``facts``, of a move

    @property
    def added(self) -> list[Fact]:
        """The facts that hold after it."""
        return [] if self.do == "remove" else self.facts

    @property
    def removed(self) -> list[Fact]:
        """The facts that do not hold after it, without those of removed entities."""
        return self.facts if self.do == "remove" else self.replaced


def is_old(folder: Path) -> bool:
    """Whether a folder has a bundle's files."""
    return (folder / MANIFEST).is_file()


def trained_and_changes(folder: Path) -> tuple[Bundle, list[Line]]:
    """What the embedding of a folder was trained on, and the changes since then. An ``InputError``
    names the file and the line that is broken.
    """
    bundle, records = read(folder)
    lines = _lines(folder / JOURNAL) or list(_changes_of(bundle, records))
    known = len(bundle.entity_names) - len(records)
    later = _added_later(lines)
    is_trained = (bundle.triples[:, [HEAD, TAIL]] < known).all(1)
    is_trained &= np.array([fact not in later for fact in bundle.named_triples()], bool)
    trained = replace(
        bundle,
        entities=bundle.entities[:known],
        entity_names=bundle.entity_names[:known],
        kinds=bundle.kinds[:known],
        phrases=bundle.phrases[:known],
        triples=bundle.triples[is_trained],
        words=None if bundle.words is None else bundle.words[:known],
    )
    return trained, lines


def _lines(path: Path) -> list[Line]:
    """The changes of a journal; a last line without an end is of a process that was killed, and
    does not count. Choices of initializers are made anew.
    """
    if not path.exists():
        return []
    with at(path):
        content = path.read_bytes()
    lines = list[Line]()
    for number, text in enumerate(content.split(b"\n")[:-1], 1):
        with at(path, f"line {number}"):
            if not _is_choice(text):
                lines.append(Line.model_validate_json(text))
    return lines


def _is_choice(line: bytes) -> bool:
    """Whether a line is a choice of an initializer; what is no JSON is none."""
    try:
        value = json.loads(line)
    except ValueError:
        return False
    return isinstance(value, dict) and value.get("do") == "choose"


def _changes_of(bundle: Bundle, records: Sequence[EntityRecord]) -> Iterator[Line]:
    """The changes of a bundle without a journal, by how its last entities were inserted."""
    kinds = bundle.kinds[len(bundle.kinds) - len(records) :]
    later = {record.entity for record in records}
    for record, kind in zip(records, kinds, strict=True):
        later.remove(record.entity)
        about = NewEntity(
            definition=record.definition,
            kind=kind or None,
            initializer=record.initializer,
            options=record.options,
            seed=record.seed,
        )
        facts = [fact for fact in record.insert_triples if not {fact[0], fact[2]} & later]
        yield Line(do="insert", entities={record.entity: about}, facts=facts)


def _added_later(lines: Sequence[Line]) -> set[Fact]:
    """The facts that a change adds before any removes them."""
    first = dict[Fact, bool]()
    for line in lines:
        for fact in line.removed:
            first.setdefault(fact, False)
        for fact in line.added:
            first.setdefault(fact, True)
    return {fact for fact, is_added in first.items() if is_added}
