"""Graphs published as triples: three that ship (the paper's own, VirtualHome's, THOR_U), and any with OpenKE's ids."""

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
from isi.sources.readers import read_table, read_text, refuse
from isi.tables import paths

ENTITIES, RELATIONS, ALL = "entity2id.txt", "relation2id.txt", "gt2id.txt"
#: Of what kind an entity is, by the last part of its name.
KINDS = {"o": "object", "l": "location", "r": "room", "a": "action", "s": "state", "m": "material"}
SHIPPED = ("virtualhome", "thor_u")
TRIPLE = ["head", "relation", "tail"]
Triple = tuple[str, str, str]


def published_entities(triples: pd.DataFrame, _rooms: Collection[str]) -> pd.DataFrame:
    """Entities of the paper's graph in alphabetical order, with the kinds and phrases that they were given by hand."""
    listed = published_phrases()
    is_there = listed["entity"].isin({*triples["head"], *triples["tail"]})
    return listed.loc[is_there, ["entity", "kind", "phrase"]].sort_values("entity").reset_index(drop=True)


@reader("published", published_entities)
def published(_mining: Mining) -> Iterator[Observation]:
    """Observations of the paper's graph, added up by triple: of which scene and instance they were is not published.

    Raises:
        InputError: where a file is missing or broken, lists a triple twice, or has a synset of no entity.
    """
    listed = published_phrases()
    entity_of = dict(zip(listed["synset"], listed["entity"], strict=True))
    path = paths.PUBLISHED_TRIPLES
    table = read_table(path, [*TRIPLE, "count"], TRIPLE)
    for slot in ("head", "tail"):
        refuse(path, table[slot], ~table[slot].isin(entity_of), "expected a synset that has an entity")
        table[slot] = table[slot].map(entity_of)
    for triple_and_count in table.itertuples(index=False, name=None):
        yield None, None, None, *triple_and_count


def published_phrases() -> pd.DataFrame:
    """Name, phrase and kind of each synset of the paper's graph: columns synset, entity, phrase, kind."""
    return read_table(paths.PUBLISHED_PHRASES, ["synset", "entity", "phrase", "kind"], ["synset"], ["entity"])


def shipped_entities(triples: pd.DataFrame, _rooms: Collection[str]) -> pd.DataFrame:
    """Entities of VirtualHome or THOR_U, in alphabetical order, with kind and phrase."""
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
        table = read_table(paths.RAW / from_ / "triples.csv", [*TRIPLE, "count"], TRIPLE)
        counts = {(head, rel, tail): count for head, rel, tail, count in table.itertuples(index=False, name=None)}
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


def read_ids(folder: Path, files: Collection[str]) -> dict[Triple, int]:
    """How often each triple stands in files of ids, heads before tails before relations.

    Raises:
        InputError: where a file is missing, has another number of lines than it says, or has an id without a name; or
            where there is no triple.
    """
    names, relations = read_id_names(folder / ENTITIES), read_id_names(folder / RELATIONS)
    counts: Counter[Triple] = Counter()
    for path in (folder / file for file in files):
        for number, ids in _lines(path, r"\s*([0-9]{1,9})[\s,]+([0-9]{1,9})[\s,]+([0-9]{1,9})\s*", "three ids"):
            head, tail, relation = map(int, ids.groups())
            if max(head, tail) >= len(names) or relation >= len(relations):
                expected = f"expected ids of {len(names)} entities and {len(relations)} relations, got {short(ids[0])}"
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
    name_of: dict[int, str] = {}
    names: set[str] = set()
    for number, line in _lines(path, r"(.+)\t([0-9]{1,9})\s*", "a name, a tab and an id"):
        name, row = line[1], int(line[2])
        is_there = row in name_of or name in names
        if fault := name_fault(name) or f"{short(line[0])} has a name or an id that is there already" * is_there:
            raise InputError(path, f"line {number}", fault)
        names.add(name)
        name_of[row] = name
    if sorted(name_of) != list(range(len(name_of))):
        raise InputError(path, "", f"expected the ids from 0 to {len(name_of) - 1}")
    return [name for _, name in sorted(name_of.items())]


def _lines(path: Path, pattern: str, content: str) -> Iterator[tuple[int, re.Match[str]]]:
    """The lines behind the first, which says how many they are, with their numbers."""
    first, *lines = read_text(path, "a text file of ids").split("\n")
    filled = [(number, line) for number, line in enumerate(lines, 2) if line.strip()]
    if not re.fullmatch(r"[0-9]{1,9}\s*", first) or int(first) != len(filled):
        expected = f"expected how many lines follow, which are {len(filled)}, got {short(first)}"
        raise InputError(path, "line 1", expected)
    for number, line in filled:
        match = re.fullmatch(pattern, line)
        if not match:
            raise InputError(path, f"line {number}", f"expected {content}, got {short(line)}")
        yield number, match
