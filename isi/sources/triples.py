"""Observations from triples: a user's tables, OpenKE's files of ids,
and the three shipped graphs.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Annotated

import pandas as pd

from isi.columns import COUNT, PLACES
from isi.config import EachOnce
from isi.errors import InputError, short
from isi.sources import Mining, Observation, reader
from isi.sources.names import ENTITY, KindsByRelation, Naming
from isi.sources.readers import (
    SEPARATORS,
    check_names,
    form_of,
    read_batches,
    read_table,
    read_text,
    refuse,
)
from isi.tables import paths

TRIPLE = ["head", "relation", "tail"]
#: Files of a folder of triples.
TRIPLES_FILE, ENTITIES_FILE = "triples.csv", "entities.csv"
ENTITIES, RELATIONS, ALL = "entity2id.txt", "relation2id.txt", "gt2id.txt"
#: The kind of an entity by the suffix of its name, after the last dot.
KINDS_BY_SUFFIX = {
    "o": "object",
    "l": "location",
    "r": "room",
    "a": "action",
    "s": "state",
    "m": "material",
}
SHIPPED = ("virtualhome", "thor_u")
Triple = tuple[str, str, str]


@reader("table", Naming(), path="path", suffixes=(*SEPARATORS, TRIPLES_FILE))
def table(
    mining: Mining,
    path: str,
    entities: str | None = None,
    kinds: KindsByRelation | None = None,
    household: bool = False,
) -> Iterator[Observation]:
    """Observations of a table (``.csv``, ``.tsv``, ``.txt``, Parquet, Feather).

    Its columns are ``TRIPLE``, and optionally ``count`` and ``PLACES``; three columns without a
    header are ``TRIPLE``. ``path`` may be a folder with such a table, ``triples.csv``, and perhaps
    ``entities.csv``, the table ``entities``.
    ``entities``: path of a table with the column ``entity`` and optionally ``kind`` and ``phrase``.
    ``kinds``: kinds of each relation's heads and tails, for entities without a kind in that table.
    ``household``: relations and kinds are ``HOUSEHOLD``; the names in the column ``room`` are
    rooms.
    """
    file = Path(path)
    if file.is_dir() and form_of(file) is None:
        beside = file / ENTITIES_FILE
        file /= TRIPLES_FILE
        entities = entities or (str(beside) if beside.exists() else None)
    mining.name_entities = naming(entities, kinds, household, mining.counts)
    for batch in read_batches(file, TRIPLE, [COUNT, *PLACES], headerless=mining.counts):
        rows = pd.DataFrame({**dict.fromkeys(PLACES, ""), COUNT: 1, **batch}, batch.index)
        check_names(rows[[*TRIPLE, *PLACES]], file, PLACES)
        places = ([place or None for place in rows[name]] for name in PLACES)
        yield from zip(*places, *(rows[name] for name in TRIPLE), rows[COUNT], strict=True)


def naming(
    entities: str | None,
    kinds: KindsByRelation | None,
    household: bool,
    counts: Counter[str] | None = None,
) -> Naming:
    """``Naming`` by a table of entities (path), by relations, or both;
    InputError for ``kinds`` with ``household``.

    ``counts``: where entities of the table that no triple has are counted.
    """
    if kinds and household:
        raise InputError(
            "kinds", "", "expected no kinds together with household, which has its own"
        )
    named = Naming(kinds, household, strict=bool(kinds) or household)
    if entities:
        columns, optional = ["entity"], ["kind", "phrase"]
        table = read_table(Path(entities), columns, columns, optional=optional).set_index("entity")
        for column, by_name in (("kind", named.kind_of), ("phrase", named.phrase_of)):
            if column in table:
                by_name.update(table.loc[table[column] != "", column])
        named.strict = named.strict or bool(named.kind_of)
        if counts is not None:
            named.of_table, named.counts = list(table.index), counts
    return named


@reader("published", Naming())
def published(mining: Mining) -> Iterator[Observation]:
    """Observations of the paper's graph, one row per triple;
    a shipped table has kinds and phrases of entities.
    """
    described = published_phrases().set_index("synset")
    of_entity = described.set_index("entity")
    mining.name_entities = Naming(
        kind_of=dict(of_entity["kind"]), phrase_of=dict(of_entity["phrase"])
    )
    path = paths.PUBLISHED_TRIPLES
    rows = read_table(path, [*TRIPLE, COUNT], TRIPLE)
    for slot in ("head", "tail"):
        refuse(
            path,
            rows[slot],
            ~rows[slot].isin(described.index),
            "expected a synset with an entity",
        )
        rows[slot] = rows[slot].map(described["entity"])
    yield from ((None, None, None, *row) for row in rows.itertuples(index=False, name=None))


def published_phrases() -> pd.DataFrame:
    """Name, phrase and kind of each synset of the paper's graph:
    columns synset, entity, phrase, kind.
    """
    return read_table(
        paths.PUBLISHED_PHRASES, ["synset", "entity", "phrase", "kind"], ["synset"], ["entity"]
    )


@reader("triples_with_ids", Naming(), path="from_", suffixes=(ENTITIES,))
def triples_with_ids(
    mining: Mining, from_: str, triples: Annotated[list[str], EachOnce] | None = None
) -> Iterator[Observation]:
    """Observations from OpenKE's files of ids; the count of a triple is its number of lines.

    ``from_`` is a shipped graph (``virtualhome``, ``thor_u``) or a folder with the files
    ``entity2id.txt`` and ``relation2id.txt``; ``triples`` names the files of triples in the folder
    (None: ``gt2id.txt``). A suffix in ``KINDS_BY_SUFFIX`` gives an entity's kind; the rest of the
    name is its phrase, unless a shipped list has another.
    """
    if from_ in SHIPPED:
        shipped = read_table(paths.RAW / from_ / "triples.csv", [*TRIPLE, COUNT], TRIPLE)
        counts = {
            (head, rel, tail): count
            for head, rel, tail, count in shipped.itertuples(index=False, name=None)
        }
        known = list(
            shipped_names()[["name", "entity", "phrase"]].itertuples(index=False, name=None)
        )
    else:
        counts, known = read_ids(Path(from_), triples or [ALL]), []
    entity_of = {name: entity for name, entity, _ in known}
    mining.name_entities = named = Naming()
    # their suffixes stay
    unlisted = ((name, name, "") for head, _, tail in counts for name in (head, tail))
    for name, entity, phrase in (*known, *unlisted):
        stem, _, suffix = name.rpartition(".")
        kind = KINDS_BY_SUFFIX.get(suffix) if stem else None
        named.kind_of.setdefault(entity, kind or ENTITY)
        named.phrase_of.setdefault(entity, phrase or (stem if kind else name).replace("_", " "))
    for (head, relation, tail), count in sorted(counts.items()):
        yield (
            None,
            None,
            None,
            entity_of.get(head, head),
            relation,
            entity_of.get(tail, tail),
            count,
        )


@cache
def shipped_names() -> pd.DataFrame:
    """Entities of the shipped graphs ``SHIPPED``:
    columns name (in ``triples.csv``), entity and phrase.
    """
    parts = [
        read_table(paths.RAW / name / "names.csv", ["name", "entity", "phrase"], ["name"])
        for name in SHIPPED
    ]
    return pd.concat(parts).drop_duplicates()


def read_ids(folder: Path, files: Collection[str]) -> dict[Triple, int]:
    """Number of lines of each triple (by names) in files of ids, whose columns are head,
    tail, relation.
    """
    names, relations = read_id_names(folder / ENTITIES), read_id_names(folder / RELATIONS)
    most = {"head": len(names), "tail": len(names), "relation": len(relations)}
    counts: Counter[Triple] = Counter()
    for path in (folder / file for file in files):
        lines, table = _read_lines(
            path, r"\s*([0-9]{1,9})[\s,]+([0-9]{1,9})[\s,]+([0-9]{1,9})\s*", most, "three ids"
        )
        ids = table.astype(int)
        expected = f"expected ids of {len(names)} entities and {len(relations)} relations"
        refuse(path, lines, (ids >= pd.Series(most)).any(axis=1), expected)
        counts.update(
            (names[head], relations[relation], names[tail])
            for _, head, tail, relation in ids.itertuples()
        )
    if not counts:
        raise InputError(folder, ", ".join(files), "expected triples, got none")
    return counts


def read_id_names(path: Path) -> list[str]:
    """Names in order of id, from lines of name, tab and id;
    InputError unless the ids are 0, 1, ..., each once.
    """
    lines, table = _read_lines(
        path, r"(.+)\t([0-9]{1,9})\s*", ["name", "id"], "a name, a tab and an id"
    )
    names, ids = table["name"], table["id"].astype(int)
    check_names(table[["name"]], path)
    refuse(
        path, lines, names.duplicated() | ids.duplicated(), "expected each name and each id once"
    )
    if set(ids) != set(range(len(ids))):
        raise InputError(path, "", f"expected each id from 0 to {len(ids) - 1}")
    return names.loc[ids.sort_values().index].tolist()


def _read_lines(
    path: Path, pattern: str, columns: Iterable[str], content: str
) -> tuple[pd.Series, pd.DataFrame]:
    """Lines after the first, which must be their number,
    and a table of the groups that a pattern matches in them.
    """
    first, *rest = read_text(path, "a text file of ids").split("\n")
    filled = {number: line for number, line in enumerate(rest, 2) if line.strip()}
    if not re.fullmatch(r"[0-9]{1,9}\s*", first) or int(first) != len(filled):
        expected = f"expected {len(filled)}, the number of lines that follow, got {short(first)}"
        raise InputError(path, "line 1", expected)
    lines = pd.Series(filled, dtype=object).rename_axis("line")
    table = lines.str.extract(f"^(?:{pattern})$").set_axis(list(columns), axis=1)
    refuse(path, lines, table.isna().any(axis=1), f"expected {content}")
    return lines, table
