"""Sources of observations, one module each: scenes or tallies as (head, relation, tail), with what they left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from isi.config import Name, check, keywords
from isi.errors import InputError, short
from isi.registry import Plugins
from isi.sources._naming import fault
from isi.sources.tables import OBSERVATIONS
from isi.tables.rules import MOST_OBSERVED

#: Settings that name what a source reads.
READ = ("path", "from_", "folder")
_TRIPLE = ["head", "relation", "tail"]
#: Names the entities of a source (``tables.KINDS``), given its unique triples and the names of its rooms.
Entities = Callable[[pd.DataFrame, Collection[str]], pd.DataFrame]


@dataclass
class Mining:
    """What a source is given beside its settings, and where it counts what it leaves out."""

    #: root of every random stream
    seed: int
    #: instances left after each step, in the order of the steps; stays empty where a source does not count
    left: Counter[str] = field(default_factory=Counter)
    #: set by a source whose settings, or the file itself, say how its entities are named; else ``Source.entities`` does
    entities: Entities | None = None


@dataclass(frozen=True)
class Source:
    """How to observe, and how to name what was observed."""

    #: gives observations part by part (``tables.OBSERVATIONS``), from a ``Mining`` and its settings
    observe: Callable[..., Iterable[pa.Table]]
    entities: Entities


SOURCES: Plugins[Source] = Plugins("isi.sources")


def source(name: str, entities: Entities) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make a function of a ``Mining`` and settings a source; the settings are checked by their types."""

    def register(observe: Callable[..., Any]) -> Callable[..., Any]:
        SOURCES.register(name, Source(observe, entities))
        return observe

    return register


def settings_of(values: object, key: str) -> tuple[Source, dict[str, Any]]:
    """The source that a section of params names as its ``reader``, and its other keys as keyword arguments.

    Raises:
        InputError: where there is no such source, or it does not take these settings; ``key`` is where they stand.
    """
    given = dict(check(values, dict[str, Any], key))
    reader = check(given.pop("reader", None), Name, f"{key}.reader")
    found = SOURCES.get(reader, f"{key}.reader")
    settings = keywords(found.observe, given, key)
    for name, value in settings.items():
        if isinstance(value, str) and "\0" in value:  # which is in no path
            raise InputError(f"{key}.{name.removesuffix('_')}", "", f"expected text without null, got {short(value)}")
    return found, settings


def part(rows: Sequence[Sequence[str | int | None]]) -> pa.Table:
    """A part of a source's observations: rows of scene, room, instance (null where there is none) ... and count."""
    columns = zip(*rows, strict=True) if rows else [()] * len(OBSERVATIONS.schema)
    arrays = [pa.array(column, field.type) for column, field in zip(columns, OBSERVATIONS.schema, strict=True)]
    return pa.Table.from_arrays(arrays, schema=OBSERVATIONS.schema)


@dataclass
class Observed:
    """Passes observations on, and names the entities of all of them when they end."""

    entities: Entities
    mining: Mining = field(default_factory=lambda: Mining(0))
    #: what is read, for errors that no reader sees
    file: str = "observations"
    #: of the entities (``tables.KINDS``), once the observations have ended
    kinds: pd.DataFrame = field(init=False)

    def passing(self, parts: Iterable[pa.Table]) -> Iterator[pa.Table]:
        """The parts, as they come.

        Raises:
            InputError: where a name is none, there are none, or more than are counted; at their end, where an entity
                has no kind, or more than one.
        """
        triples: set[tuple[str, str, str]] = set()
        rooms: set[str] = set()
        total = 0
        for table in parts:
            new = _distinct(table, _TRIPLE) - triples
            if wrong := next(filter(None, map(fault, {name for triple in new for name in triple})), None):
                raise InputError(self.file, "", wrong)
            total += pc.sum(table["count"]).as_py() or 0
            if total > MOST_OBSERVED:
                raise InputError(self.file, "", f"expected at most {MOST_OBSERVED:,} observations in all")
            triples |= new
            rooms |= {room for (room,) in _distinct(table, ["room"]) if room is not None}
            yield table
        if not triples:
            raise InputError(self.file, "", "expected observations, got none")
        entities = self.mining.entities or self.entities
        self.kinds = entities(pd.DataFrame(sorted(triples), columns=_TRIPLE), rooms)
        named = list(self.kinds["entity"])
        missing = {name for head, _, tail in triples for name in (head, tail)} - set(named)
        if missing or len(set(named)) < len(named):
            name = min(missing) if missing else self.kinds.loc[self.kinds["entity"].duplicated(), "entity"].iloc[0]
            raise InputError(f"entity {short(name)}", "", "expected its source to give it one kind")


def observing(values: object, key: str, seed: int) -> tuple[Observed, Iterator[pa.Table]]:
    """What the source of a section of params observes, part by part, and what names and counts it.

    Args:
        values: of the section.
        key: where it stands.
        seed: root of every random stream.

    Raises:
        InputError: where there is no such source, or it does not take these settings; parts, where what it reads is
            missing or broken.
    """
    chosen, settings = settings_of(values, key)
    file = next((str(settings[slot]) for slot in READ if slot in settings), key)
    observed = Observed(chosen.entities, Mining(seed), file)

    def parts() -> Iterator[pa.Table]:
        yield from observed.passing(chosen.observe(observed.mining, **settings))

    return observed, parts()


def _distinct(table: pa.Table, columns: list[str]) -> set[tuple[Any, ...]]:
    """Rows of some columns that differ."""
    plain = table.select(columns).cast(pa.schema([(name, pa.string()) for name in columns]))
    unique = plain.group_by(columns).aggregate([])
    return set(zip(*(unique[name].to_pylist() for name in columns), strict=True))
