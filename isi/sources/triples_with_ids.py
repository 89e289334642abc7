"""Triples as ids, in the form of OpenKE, and two household graphs that ship: VirtualHome's and AI2-THOR's of 2020."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path

import pandas as pd
import pyarrow as pa

from isi.errors import InputError, short
from isi.sources import Mining, part, source
from isi.sources._naming import fault
from isi.sources._rows import read_listed, read_text
from isi.tables import paths

ENTITIES, RELATIONS, ALL = "entity2id.txt", "relation2id.txt", "gt2id.txt"
#: Of what kind an entity is, by the last part of its name.
KINDS = {"o": "object", "l": "location", "r": "room", "a": "action", "s": "state", "m": "material"}
#: Of an entity whose name does not say.
THING = "entity"
SHIPPED = ("virtualhome", "thor_u")
_TRIPLE = ["head", "relation", "tail"]
Triple = tuple[str, str, str]


def entities(triples: pd.DataFrame, _rooms: Collection[str]) -> pd.DataFrame:
    """Entities of a graph that ships, in alphabetical order, with kind and phrase."""
    return _entities(triples, shipped_names().drop_duplicates("entity").set_index("entity"))


def own_entities(triples: pd.DataFrame, _rooms: Collection[str]) -> pd.DataFrame:
    """Entities of a folder, likewise; they go by their name in the file: ``bowl.o`` is another than ``bowl``."""
    return _entities(triples, pd.DataFrame(columns=["name", "phrase"]))


def _entities(triples: pd.DataFrame, listed: pd.DataFrame) -> pd.DataFrame:
    """Of a kind by the name in the file, and of its words, where no other is listed."""
    rows = []
    for entity in sorted({*triples["head"], *triples["tail"]}):
        name = listed["name"].get(entity, entity)
        stem, _, suffix = name.rpartition(".")
        told = bool(stem) and suffix in KINDS
        own = (stem if told else name).replace("_", " ")
        rows.append((entity, KINDS[suffix] if told else THING, listed["phrase"].get(entity, own)))
    return pd.DataFrame(rows, columns=["entity", "kind", "phrase"])


@source("triples_with_ids", entities=entities)
def triples_with_ids(mining: Mining, from_: str, triples: list[str] | None = None) -> Iterator[pa.Table]:
    """Observations, added up by triple: of which scene and instance they were is not told.

    Args:
        mining: is told how the entities of a folder are named.
        from_: ``virtualhome`` or ``thor_u``, which ship, or the path of a folder with the files ``entity2id.txt`` and
            ``relation2id.txt``.
        triples: the files of triples in that folder, whose repeats are observations; null: ``gt2id.txt``.
    """
    named: dict[str, str] = {}
    if from_ in SHIPPED:
        observed = read_counts(paths.RAW / from_ / "triples.csv")
        named = dict(shipped_names()[["name", "entity"]].itertuples(index=False, name=None))
    else:
        observed = read_ids(Path(from_), triples or [ALL])
        mining.entities = own_entities
    yield part(
        [
            (None, None, None, named.get(head, head), relation, named.get(tail, tail), count)
            for (head, relation, tail), count in sorted(observed.items())
        ]
    )


@cache
def shipped_names() -> pd.DataFrame:
    """What entities of the graphs that ship go by: columns name, entity and phrase."""
    listed = [read_listed(paths.RAW / name / "names.csv", ["name", "entity", "phrase"], ["name"]) for name in SHIPPED]
    return pd.concat(listed).drop_duplicates()


def read_counts(path: Path) -> Counter[Triple]:
    """Triples with their counts: a CSV of ``head,relation,tail,count``.

    Raises:
        InputError: where the file is missing or broken, or lists a triple twice.
    """
    table = read_listed(path, [*_TRIPLE, "count"], _TRIPLE)
    return Counter({(head, rel, tail): count for head, rel, tail, count in table.itertuples(index=False, name=None)})


def read_ids(folder: Path, files: Collection[str]) -> Counter[Triple]:
    """How often each triple stands in files of ids, heads before tails before relations.

    Raises:
        InputError: where a file is missing, holds other than as many lines as it says, or names an id that there is
            no name of; or where there is no triple.
    """
    names, relations = _names(folder / ENTITIES), _names(folder / RELATIONS)
    found: Counter[Triple] = Counter()
    for path in (folder / file for file in files):
        for number, line in _lines(path):
            ids = re.fullmatch(r"\s*([0-9]{1,9})[\s,]+([0-9]{1,9})[\s,]+([0-9]{1,9})\s*", line)
            if not ids:
                raise InputError(path, f"line {number}", f"expected three ids, got {short(line)}")
            head, tail, relation = (int(text) for text in ids.groups())
            if max(head, tail) >= len(names) or relation >= len(relations):
                expected = f"expected ids of {len(names)} entities and {len(relations)} relations, got {short(line)}"
                raise InputError(path, f"line {number}", expected)
            found[names[head], relations[relation], names[tail]] += 1
    if not found:
        raise InputError(folder, ", ".join(files), "expected triples, got none")
    return found


def _names(path: Path) -> list[str]:
    """Names in the order of their ids."""
    by_id, names = dict[int, str](), set[str]()
    for number, line in _lines(path):
        named = re.fullmatch(r"(.+)\t([0-9]{1,9})\s*", line)
        if not named:
            raise InputError(path, f"line {number}", f"expected a name, a tab and an id, got {short(line)}")
        if wrong := fault(named[1]):
            raise InputError(path, f"line {number}", wrong)
        if int(named[2]) in by_id or named[1] in names:
            raise InputError(path, f"line {number}", f"{short(line)} has a name or an id that is there already")
        names.add(named[1])
        by_id[int(named[2])] = named[1]
    if sorted(by_id) != list(range(len(by_id))):
        raise InputError(path, "", f"expected the ids from 0 to {len(by_id) - 1}")
    return [by_id[number] for number in range(len(by_id))]


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """The lines behind the first, which says how many they are, with their numbers."""
    first, *lines = read_text(path, "a text file of ids").split("\n")
    filled = [(number, line) for number, line in enumerate(lines, 2) if line.strip()]
    if not re.fullmatch(r"[0-9]{1,9}\s*", first) or int(first) != len(filled):
        said = f"expected how many lines follow, which are {len(filled)}, got {short(first)}"
        raise InputError(path, "line 1", said)
    yield from filled
