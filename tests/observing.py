"""Sources that run as in mining."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pytest

from isi.errors import InputError
from isi.sources import READERS, NameEntities, Observation, Reader, Source
from isi.sources.names import household

TRIPLE = ["head", "relation", "tail"]


@dataclass(frozen=True)
class Observations:
    """All observations of a source, its entities,
    and the instances that each step of mining leaves.
    """

    table: pd.DataFrame
    kinds: pd.DataFrame
    counts: Counter[str]

    def rows(self, *columns: str) -> list[tuple[object, ...]]:
        """The observations as tuples of these columns; missing values are None."""
        chosen = self.table[list(columns)].astype(object)
        return list(chosen.where(chosen.notna(), None).itertuples(index=False, name=None))

    def kind_of(self) -> dict[str, str]:
        return dict(zip(self.kinds["entity"], self.kinds["kind"], strict=True))

    def phrase_of(self) -> dict[str, str]:
        return dict(zip(self.kinds["entity"], self.kinds["phrase"], strict=True))


def observations_of(section: object) -> Observations:
    """Mine the source of a section of params."""
    source = Source(section, "sources.mine", 0)
    return Observations(pd.concat(source.frames(), ignore_index=True), source.kinds, source.counts)


def observe(reader: str, path: Path, **settings: object) -> Observations:
    """Mine a file with a reader and its settings."""
    return observations_of({"reader": reader, "path": str(path), **settings})


def source_of(rows: Iterable[Observation], name_entities: NameEntities = household) -> Source:
    """A source that yields these observations."""
    READERS.register("given", Reader(lambda _mining: rows, name_entities))
    return Source({"reader": "given"}, "sources.given", 0)


def refused(reader: str, path: Path, expected: Sequence[str], **settings: object) -> None:
    """A reader refuses a file in one short line with all of these parts."""
    with pytest.raises(InputError) as error:
        observe(reader, path, **settings)
    line = str(error.value)
    assert line.isprintable()
    assert len(line) < 500 + len(str(path))
    assert all(part in line for part in expected), line


def written(path: Path, content: str | bytes) -> Path:
    """A file of this content."""
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path
