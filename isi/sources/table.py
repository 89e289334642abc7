"""Triples of one's own, from a table: CSV, TSV or Parquet."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import pyarrow as pa

from isi.errors import InputError
from isi.sources import Mining, part, source
from isi.sources._naming import Kinds, Naming, fault
from isi.sources._rows import Row, read_rows
from isi.tables.rules import MOST_OBSERVED

TRIPLE = ("head", "relation", "tail")
MAY = ("count", "scene", "room", "instance")
#: Observations that are held at once: a row group of the table that they go into.
CHUNK = 65_536

#: Scene, room, instance, head, relation, tail, count.
Observation = tuple[str | None, str | None, str | None, str, str, str, int]


@source("table", entities=Naming())
def table(
    mining: Mining, path: str, entities: str | None = None, kinds: Kinds | None = None, household: bool = False
) -> Iterator[pa.Table]:
    """Observations of a table of triples.

    Args:
        mining: is told how entities are named.
        path: of a file with the columns ``head``, ``relation``, ``tail``, and perhaps ``count`` (else one each),
            ``scene``, ``room``, ``instance``. What it is, its name says: ``.csv``, ``.tsv``, ``.parquet``.
        entities: path of such a file with the column ``entity``, and perhaps ``kind`` and ``phrase``.
        kinds: of entities to which that gives none: those of each relation's heads and tails.
        household: whether these are the relations and kinds of homes, where a room is what the column ``room`` names.

    Raises:
        InputError: with the line, where a file is not of this form.
    """
    mining.entities = naming(entities, kinds, household)
    rest = _observations(Path(path))
    while chunk := list(islice(rest, CHUNK)):
        yield part(chunk)


def naming(entities: str | None, kinds: Kinds | None, household: bool) -> Naming:
    """How to name entities by a table of them and by relation, either of which may be missing.

    Raises:
        InputError: where the table is broken or lists an entity twice, or kinds are given beside those of homes.
    """
    if kinds and household:
        raise InputError("kinds", "", "expected none beside household, which has its own")
    named = Naming(kinds, household, strict=bool(kinds) or household)
    places: dict[str, str] = {}
    for row in read_rows(Path(entities), ["entity"], ["kind", "phrase"]) if entities else ():
        entity, kind, phrase = row.values
        for name in filter(None, (kind, phrase)):
            _check(row, name)
        _check(row, entity)
        if entity in places:
            raise row.error(f"{entity!r} is also in {places[entity]}")
        places[entity] = row.place
        if kind:
            named.kind_of[entity], named.strict = kind, True
        if phrase:
            named.phrase_of[entity] = phrase
    return named


def _observations(path: Path) -> Iterator[Observation]:
    total, known = 0, set[str | None]()
    for row in read_rows(path, TRIPLE, MAY):
        head, relation, tail, count, *where = row.values
        scene, room, instance = (value or None for value in where)
        for name in (head, relation, tail, scene or head, room or head):
            if name not in known:
                _check(row, name)
                known.add(name)
        if instance:
            _check(row, instance)
        total += (count := 1 if count is None else count)
        if total > MOST_OBSERVED:
            raise row.error(f"expected at most {MOST_OBSERVED} observations in all")
        yield scene, room, instance, head, relation, tail, count
    if not total:
        raise InputError(path, "", "expected triples, got none")


def _check(row: Row, name: str) -> None:
    wrong = fault(name)
    if wrong:
        raise row.error(wrong)
