"""Sources of graphs: a reader turns scenes,
tallies or tables into observations (head, relation, tail, count).

A source is a reader with its settings. Each module registers its readers by name; ``reader`` in
params is such a name. A reader raises an ``InputError``, with file and place, if a file is missing,
is broken or has another format.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from operator import attrgetter
from typing import Any

import pandas as pd

from isi import config
from isi.errors import InputError, at, short
from isi.names import clean, name_fault
from isi.sources.names import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL
from isi.tables.rules import MOST_OBSERVED

CHANGED = "names changed to Unicode's NFC, without invisible characters and outer spaces"
REPEATED = "observations dropped that an earlier event has, too"
CHUNK = 65_536  #: Maximum number of rows of a table that ``Source.frames`` yields.
#: Names of what ``Observation`` holds.
OBSERVED = ("scene", "room", "instance", "head", "relation", "tail", "count")
#: Scene, room and instance (None where there is none), head, relation, tail, count.
Observation = tuple[str | None, str | None, str | None, str, str, str, int]
#: Unique triples (columns head, relation, tail) and names of rooms → entities with kind and phrase.
NameEntities = Callable[[pd.DataFrame, Collection[str]], pd.DataFrame]
Read = Callable[..., Iterable[Observation]]


@dataclass
class Mining:
    """First argument of a reader: a seed, and two fields that the reader fills."""

    seed: int  #: root of every random stream
    #: instances or triples by description
    counts: Counter[str] = field(default_factory=Counter)
    name_entities: NameEntities | None = None  #: replaces ``Reader.name_entities`` unless None


@dataclass(frozen=True)
class Reader:
    """A function that reads observations, and the settings and files that it accepts."""

    read: Read  #: called with a ``Mining`` and the settings as keywords; yields observations
    name_entities: NameEntities
    path: str | None = None  #: name of the setting that holds the path to read; None: shipped files
    #: suffixes of the files that it reads, names of files in the folders that it reads
    suffixes: Collection[str] = ()
    #: default settings in ``isi train FILE``
    defaults: Mapping[str, Any] = field(default_factory=dict)


READERS: config.Plugins[Reader] = config.Plugins("isi.sources", attrgetter("read"))


def reader(name: str, name_entities: NameEntities, **known: Any) -> Callable[[Read], Read]:
    """A decorator that registers a function as a reader;
    ``known`` are the other fields of ``Reader``.

    Example:
        >>> @reader("two_cups", name_entities=lambda triples, rooms: None)
        ... def two_cups(mining: Mining, relation: str) -> Iterator[Observation]:
        ...     yield None, None, None, "cup", relation, "kitchen", 2
        >>> chosen, settings = settings_of({"reader": "two_cups", "relation": "in"}, "sources.mine")
        >>> list(chosen.read(Mining(0), **settings))
        [(None, None, None, 'cup', 'in', 'kitchen', 2)]
    """

    def register(read: Read) -> Read:
        READERS.register(name, Reader(read, name_entities, **known))
        return read

    return register


def settings_of(section: object, key: str) -> tuple[Reader, dict[str, Any]]:
    """Reader and validated keyword arguments from the params at ``key``;
    InputError names the key that is wrong.
    """
    settings = dict(config.check(section, dict[str, Any], key))
    name = config.check(settings.pop("reader", None), config.Name, f"{key}.reader")
    chosen = READERS.get(name, f"{key}.reader")
    for setting, value in settings.items():
        if isinstance(value, str) and "\0" in value:  # no path contains it
            raise InputError(
                f"{key}.{setting}",
                "",
                f"expected text without a null character, got {short(value)}",
            )
    return chosen, config.keywords(chosen.read, settings, key)


def observed(
    scene: str,
    room: str | None,
    instance: str,
    head: str,
    receptacles: Iterable[str] = (),
    materials: Iterable[str] = (),
    affordances: Iterable[str] = (),
    count: int = 1,
) -> Iterator[Observation]:
    """Yield one row for each location (``room`` unless None, receptacles),
    material and affordance of an object.
    """
    locations = [room, *receptacles] if room else receptacles
    tails = {AT_LOCATION: locations, HAS_MATERIAL: materials, HAS_AFFORDANCE: affordances}
    for relation, names in tails.items():
        for tail in names:
            yield scene, room, instance, head, relation, tail, count


def once(events: Iterable[Iterable[Observation]], counts: Counter[str]) -> Iterator[Observation]:
    """Yield the observations of events in order,
    but drop and count those that an earlier event has, too.
    """
    seen: set[Observation] = set()
    for event in events:
        rows = list(event)
        yield from (row for row in rows if row not in seen)
        counts.update(REPEATED for row in rows if row in seen)
        seen.update(rows)


class Source:
    """A reader with its settings: ``frames`` yields the observations,
    and then ``kinds`` holds the entities.
    """

    kinds: pd.DataFrame  #: entities with kind and phrase; set after the last part of ``frames``

    def __init__(self, section: object, key: str, seed: int) -> None:
        """Check the section (``settings_of``) without reading a file;
        ``seed`` is the root of all random streams.
        """
        self._reader, self._settings = settings_of(section, key)
        self._place = str(self._settings.get(self._reader.path or "", key))
        self._mining = Mining(seed)
        self.counts = self._mining.counts

    def frames(self) -> Iterator[pd.DataFrame]:
        """Yield the observations in parts, with the columns ``OBSERVED``; InputError for none, too
        many, invalid names, or not one kind per entity.
        """
        observations = iter(self._reader.read(self._mining, **self._settings))
        triples: set[tuple[str, str, str]] = set()
        rooms: set[str] = set()
        changed: dict[str, str] = {}  # valid names that ``clean`` changes
        total = 0
        while rows := list(islice(observations, CHUNK)):
            columns = list(zip(*rows, strict=True))
            names = set().union(*columns[3:6])
            total += sum(columns[6])
            fault = next(filter(None, map(name_fault, names)), None)
            if fault or total > MOST_OBSERVED:
                raise InputError(
                    self._place,
                    "",
                    fault or f"expected at most {MOST_OBSERVED:,} observations in all",
                )
            new_rooms = set(columns[1]) - {None}
            changed |= {name: clean(name) for name in names | new_rooms if clean(name) != name}
            for place in (1, 3, 4, 5) if changed else ():  # room, head, relation, tail
                columns[place] = tuple(changed.get(name, name) for name in columns[place])
            triples |= set(zip(*columns[3:6], strict=True))
            rooms |= set(columns[1]) - {None}
            frame = dict(zip(OBSERVED, columns, strict=True))
            yield pd.DataFrame(frame, dtype=object).astype({"count": "int64"})
        if changed:
            self.counts[CHANGED] = len(changed)
        if not triples:
            raise InputError(self._place, "", "expected observations, got none")
        name_entities = self._mining.name_entities or self._reader.name_entities
        with at(self._place):
            self.kinds = name_entities(
                pd.DataFrame(sorted(triples), columns=["head", "relation", "tail"]), rooms
            )
        missing = {name for head, _, tail in triples for name in (head, tail)} - set(
            self.kinds["entity"]
        )
        if wrong := sorted(missing) or list(
            self.kinds.loc[self.kinds["entity"].duplicated(), "entity"]
        ):
            raise InputError(
                f"entity {short(wrong[0])}", "", "expected exactly one kind from its source"
            )
