"""The graph that the paper's first author published: unique triples of WordNet synsets, with their counts."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

import pandas as pd
import pyarrow as pa

from isi.errors import InputError, short
from isi.sources import Mining, part, source
from isi.sources._rows import read_listed
from isi.tables import paths

_TRIPLE = ["head", "relation", "tail"]


def entities(triples: pd.DataFrame, _rooms: Collection[str]) -> pd.DataFrame:
    """Entities of the triples in alphabetical order, with the kinds and phrases that they were given by hand."""
    listed = read_phrases(paths.PUBLISHED_PHRASES)
    there = listed["entity"].isin({*triples["head"], *triples["tail"]})
    return listed.loc[there, ["entity", "kind", "phrase"]].sort_values("entity").reset_index(drop=True)


@source("published", entities=entities)
def published(_mining: Mining) -> Iterator[pa.Table]:
    """Observations, added up by triple: of which scene and instance they were is not published."""
    listed = read_phrases(paths.PUBLISHED_PHRASES)
    yield observations(paths.PUBLISHED_TRIPLES, dict(zip(listed["synset"], listed["entity"], strict=True)))


def observations(path: Path, entity: Mapping[str, str]) -> pa.Table:
    """Observations of the triples of a file.

    Args:
        path: CSV of ``head,relation,tail,count``, heads and tails synsets.
        entity: of each synset.

    Raises:
        InputError: where the file is missing or broken, lists a triple twice, or has a synset of no entity.
    """
    table = read_listed(path, [*_TRIPLE, "count"], _TRIPLE)
    for column in ("head", "tail"):
        unknown = table.index[~table[column].isin(entity)]
        if len(unknown):
            synset = short(table.loc[unknown[0], column])
            raise InputError(path, f"line {unknown[0]}", f"the synset {synset} has no entity")
    return part(
        [
            (None, None, None, entity[head], relation, entity[tail], count)
            for head, relation, tail, count in table.itertuples(index=False, name=None)
        ]
    )


def read_phrases(path: Path) -> pd.DataFrame:
    """What each synset goes by: a CSV of ``synset,entity,phrase,kind``.

    Raises:
        InputError: where the file is missing or broken, or a synset or an entity is there twice.
    """
    return read_listed(path, ["synset", "entity", "phrase", "kind"], ["synset"], ["entity"])
