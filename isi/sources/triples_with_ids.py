"""Triples as ids, in the form of OpenKE, and two household graphs that ship: VirtualHome's and AI2-THOR's of 2020."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path

import pandas as pd

from isi.errors import InputError, short
from isi.sources import Mining, Observation, reader
from isi.sources.names import ENTITY, name_fault
from isi.sources.readers import read_table, read_text
from isi.tables import paths

ENTITIES, RELATIONS, ALL = "entity2id.txt", "relation2id.txt", "gt2id.txt"
#: Of what kind an entity is, by the last part of its name.
KINDS = {"o": "object", "l": "location", "r": "room", "a": "action", "s": "state", "m": "material"}
SHIPPED = ("virtualhome", "thor_u")
TRIPLE = ["head", "relation", "tail"]
Triple = tuple[str, str, str]


def shipped_entities(triples: pd.DataFrame, _rooms: Collection[str]) -> pd.DataFrame:
    """Entities of a graph that ships, in alphabetical order, with kind and phrase."""
    return _entities(triples, shipped_names().drop_duplicates("entity").set_index("entity"))


def folder_entities(triples: pd.DataFrame, _rooms: Collection[str]) -> pd.DataFrame:
    """Entities of a folder, likewise; they go by their name in the file: ``bowl.o`` is another than ``bowl``."""
    return _entities(triples, pd.DataFrame(columns=["name", "phrase"]))


def _entities(triples: pd.DataFrame, listed: pd.DataFrame) -> pd.DataFrame:
    """Entities whose kind is that of their name in the file; the phrase is its words, where no other is listed."""
    rows = []
    for entity in sorted({*triples["head"], *triples["tail"]}):
        name = listed["name"].get(entity, entity)
        stem, _, suffix = name.rpartition(".")
        kind = KINDS.get(suffix) if stem else None
        words = (stem if kind else name).replace("_", " ")
        rows.append((entity, kind or ENTITY, listed["phrase"].get(entity, words)))
    return pd.DataFrame(rows, columns=["entity", "kind", "phrase"])


@reader("triples_with_ids", shipped_entities, path="from_")
def triples_with_ids(mining: Mining, from_: str, triples: list[str] | None = None) -> Iterator[Observation]:
    """Observations, added up by triple: their scenes and instances are not known.

    Args:
        mining: is given how the entities of a folder are named.
        from_: ``virtualhome`` or ``thor_u``, which ship, or the path of a folder with the files ``entity2id.txt`` and
            ``relation2id.txt``.
        triples: the files of triples in that folder, whose repeats are observations; null: ``gt2id.txt``.
    """
    entity_of: dict[str, str] = {}
    if from_ in SHIPPED:
        counts = read_counts(paths.RAW / from_ / "triples.csv")
        entity_of = dict(shipped_names()[["name", "entity"]].itertuples(index=False, name=None))
    else:
        counts = read_ids(Path(from_), triples or [ALL])
        mining.name_entities = folder_entities
    for (head, relation, tail), count in sorted(counts.items()):
        yield None, None, None, entity_of.get(head, head), relation, entity_of.get(tail, tail), count


@cache
def shipped_names() -> pd.DataFrame:
    """The names of entities of the graphs that ship: columns name (in the file), entity and phrase."""
    listed = [read_table(paths.RAW / name / "names.csv", ["name", "entity", "phrase"], ["name"]) for name in SHIPPED]
    return pd.concat(listed).drop_duplicates()


def read_counts(path: Path) -> Counter[Triple]:
    """Triples with their counts: a CSV of ``head,relation,tail,count``.

    Raises:
        InputError: where the file is missing or broken, or lists a triple twice.
    """
    table = read_table(path, [*TRIPLE, "count"], TRIPLE)
    return Counter({(head, rel, tail): count for head, rel, tail, count in table.itertuples(index=False, name=None)})


def read_ids(folder: Path, files: Collection[str]) -> Counter[Triple]:
    """How often each triple stands in files of ids, heads before tails before relations.

    Raises:
        InputError: where a file is missing, has another number of lines than it says, or has an id without a name; or
            where there is no triple.
    """
    names, relations = read_id_names(folder / ENTITIES), read_id_names(folder / RELATIONS)
    counts: Counter[Triple] = Counter()
    for path in (folder / file for file in files):
        for number, line in _lines(path):
            ids = re.fullmatch(r"\s*([0-9]{1,9})[\s,]+([0-9]{1,9})[\s,]+([0-9]{1,9})\s*", line)
            if not ids:
                raise InputError(path, f"line {number}", f"expected three ids, got {short(line)}")
            head, tail, relation = map(int, ids.groups())
            if max(head, tail) >= len(names) or relation >= len(relations):
                expected = f"expected ids of {len(names)} entities and {len(relations)} relations, got {short(line)}"
                raise InputError(path, f"line {number}", expected)
            counts[names[head], relations[relation], names[tail]] += 1
    if not counts:
        raise InputError(folder, ", ".join(files), "expected triples, got none")
    return counts


def read_id_names(path: Path) -> list[str]:
    """Names in the order of their ids: lines of a name, a tab and an id.

    Raises:
        InputError: where the file is missing or broken, or a name or an id is missing or repeats.
    """
    name_of, names = dict[int, str](), set[str]()
    for number, line in _lines(path):
        named = re.fullmatch(r"(.+)\t([0-9]{1,9})\s*", line)
        if not named:
            raise InputError(path, f"line {number}", f"expected a name, a tab and an id, got {short(line)}")
        fault = name_fault(named[1])
        if not fault and (int(named[2]) in name_of or named[1] in names):
            fault = f"{short(line)} has a name or an id that is there already"
        if fault:
            raise InputError(path, f"line {number}", fault)
        names.add(named[1])
        name_of[int(named[2])] = named[1]
    if sorted(name_of) != list(range(len(name_of))):
        raise InputError(path, "", f"expected the ids from 0 to {len(name_of) - 1}")
    return [name for _, name in sorted(name_of.items())]


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """The lines behind the first, which says how many they are, with their numbers."""
    first, *lines = read_text(path, "a text file of ids").split("\n")
    filled = [(number, line) for number, line in enumerate(lines, 2) if line.strip()]
    if not re.fullmatch(r"[0-9]{1,9}\s*", first) or int(first) != len(filled):
        expected = f"expected how many lines follow, which are {len(filled)}, got {short(first)}"
        raise InputError(path, "line 1", expected)
    return iter(filled)
