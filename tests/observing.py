"""Sources run as mining runs them."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pyarrow as pa

from isi.errors import InputError
from isi.sources import READERS, NameEntities, Observation, Reader, Source
from isi.sources.names import household

TRIPLE = ["head", "relation", "tail"]


@dataclass(frozen=True)
class Observations:
    """All of a source's observations, and what it says of its entities."""

    table: pd.DataFrame
    kinds: pd.DataFrame
    counts: Counter[str]

    def rows(self, *columns: str) -> list[tuple[object, ...]]:
        """Some columns of the observations, row by row; missing values are null."""
        chosen = self.table[list(columns)].astype(object)
        return list(chosen.where(chosen.notna(), None).itertuples(index=False, name=None))

    def kind_of(self) -> dict[str, str]:
        return dict(zip(self.kinds["entity"], self.kinds["kind"], strict=True))

    def phrase_of(self) -> dict[str, str]:
        return dict(zip(self.kinds["entity"], self.kinds["phrase"], strict=True))


def observations_of(section: object) -> Observations:
    """What the source of a section of params observes."""
    source = Source(section, "sources.mine", 0)
    return Observations(pa.concat_tables(source.tables()).to_pandas(), source.kinds, source.counts)


def observe(reader: str, path: Path, **settings: object) -> Observations:
    """What a reader observes in a file."""
    return observations_of({"reader": reader, "path": str(path), **settings})


def source_of(rows: Iterable[Observation], name_entities: NameEntities = household) -> Source:
    """A source of these observations."""
    READERS.register("given", Reader(lambda _mining: rows, name_entities))
    return Source({"reader": "given"}, "sources.given", 0)


def refusal(reader: str, path: Path, **settings: object) -> str:
    """The line in which a reader refuses a file; empty where it reads it."""
    try:
        observe(reader, path, **settings)
    except InputError as error:
        return str(error)
    return ""


def refused(reader: str, path: Path, expected: Sequence[str], **settings: object) -> None:
    """A reader refuses a file in one short line with all of these parts."""
    line = refusal(reader, path, **settings)
    assert line
    assert line.isprintable()
    assert len(line) < 500 + len(str(path))
    assert all(part in line for part in expected), line


def written(path: Path, content: str | bytes) -> Path:
    """A file of this content."""
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path
