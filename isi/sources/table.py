"""Triples of one's own, from a table: CSV, TSV or Parquet."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from isi.errors import InputError
from isi.sources import Mining, Observation, reader
from isi.sources.names import KindsByRelation, Naming, check_names
from isi.sources.readers import COUNT, SEPARATORS, read_batches, read_table

TRIPLE = ("head", "relation", "tail")
PLACES = ("scene", "room", "instance")


@reader("table", Naming(), path="path", suffixes=(*SEPARATORS, ".parquet"))
def table(
    mining: Mining,
    path: str,
    entities: str | None = None,
    kinds: KindsByRelation | None = None,
    household: bool = False,
) -> Iterator[Observation]:
    """Observations of a table of triples.

    Args:
        mining: is given how entities are named.
        path: of a file with the columns ``head``, ``relation``, ``tail``, and perhaps ``count`` (else one each),
            ``scene``, ``room``, ``instance``. What it is, its name says: ``.csv``, ``.tsv``, ``.parquet``.
        entities: path of such a file with the column ``entity``, and perhaps ``kind`` and ``phrase``.
        kinds: of entities to which that gives none: those of each relation's heads and tails.
        household: whether these are the relations and kinds of homes, where a room is what the column ``room`` names.

    Raises:
        InputError: with the line, where a file is not of this form.
    """
    mining.name_entities = naming(entities, kinds, household)
    for batch in read_batches(Path(path), TRIPLE, (COUNT, *PLACES)):
        for name in TRIPLE:
            check_names(batch[name], path)
        places = []
        for name in PLACES:
            given = batch.get(name, pd.Series("", batch.index))
            check_names(given[given != ""], path)
            places.append([place or None for place in given])
        counts = batch.get(COUNT, pd.Series(1, batch.index))
        yield from zip(*places, *(batch[name] for name in TRIPLE), counts, strict=True)


def naming(entities: str | None, kinds: KindsByRelation | None, household: bool) -> Naming:
    """How to name entities by a table of them and by relation, either of which may be missing.

    Raises:
        InputError: where the table is broken or lists an entity twice, or kinds are given beside those of homes.
    """
    if kinds and household:
        raise InputError("kinds", "", "expected none beside household, which has its own")
    named = Naming(kinds, household, strict=bool(kinds) or household)
    if entities:
        listed = read_table(Path(entities), ["entity"], ["entity"], optional=["kind", "phrase"]).set_index("entity")
        for column, given in (("kind", named.kind_of), ("phrase", named.phrase_of)):
            if column in listed:
                given.update(listed.loc[listed[column] != "", column])
        named.strict = named.strict or bool(named.kind_of)
    return named
