"""The graph that the paper's first author published: unique triples of WordNet synsets, with their counts."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

import pandas as pd

from isi.errors import InputError, short
from isi.sources import Mining, Observation, reader
from isi.sources.readers import read_table
from isi.tables import paths

TRIPLE = ["head", "relation", "tail"]


def entities(triples: pd.DataFrame, _rooms: Collection[str]) -> pd.DataFrame:
    """Entities of the triples in alphabetical order, with the kinds and phrases that they were given by hand."""
    listed = read_phrases(paths.PUBLISHED_PHRASES)
    is_there = listed["entity"].isin({*triples["head"], *triples["tail"]})
    return listed.loc[is_there, ["entity", "kind", "phrase"]].sort_values("entity").reset_index(drop=True)


@reader("published", entities)
def published(_mining: Mining) -> Iterator[Observation]:
    """Observations, added up by triple: of which scene and instance they were is not published."""
    listed = read_phrases(paths.PUBLISHED_PHRASES)
    return observations(paths.PUBLISHED_TRIPLES, dict(zip(listed["synset"], listed["entity"], strict=True)))


def observations(path: Path, entity_of: Mapping[str, str]) -> Iterator[Observation]:
    """Observations of a CSV of ``head,relation,tail,count``, whose heads and tails are synsets.

    Raises:
        InputError: where the file is missing or broken, lists a triple twice, or has a synset of no entity.
    """
    table = read_table(path, [*TRIPLE, "count"], TRIPLE)
    for line, head, relation, tail, count in table.itertuples(name=None):
        for synset in (head, tail):
            if synset not in entity_of:
                raise InputError(path, f"line {line}", f"the synset {short(synset)} has no entity")
        yield None, None, None, entity_of[head], relation, entity_of[tail], count


def read_phrases(path: Path) -> pd.DataFrame:
    """Name, phrase and kind of each synset: a CSV of ``synset,entity,phrase,kind``.

    Raises:
        InputError: where the file is missing or broken, or a synset or an entity is there twice.
    """
    return read_table(path, ["synset", "entity", "phrase", "kind"], ["synset"], ["entity"])
