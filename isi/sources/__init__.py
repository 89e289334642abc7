"""Sources of graphs: readers give observations (head, relation, tail) of scenes, tallies or tables.

Each module registers its readers by the names that ``reader`` has in params; a source is a reader with its settings.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import pandas as pd
import pyarrow as pa

from isi import config
from isi.errors import InputError, meant, short
from isi.sources.names import name_fault
from isi.sources.tables import OBSERVATIONS
from isi.tables import paths
from isi.tables.rules import MOST_OBSERVED

#: Rows of a table of observations, which are held at once.
CHUNK = 65_536
#: Scene, room and instance (null where there is none), head, relation, tail, count.
Observation = tuple[str | None, str | None, str | None, str, str, str, int]
#: Gives the entities of a source (``tables.KINDS``) from its unique triples and the names of its rooms.
NameEntities = Callable[[pd.DataFrame, Collection[str]], pd.DataFrame]


@dataclass
class Mining:
    """What a reader is given beside its settings, and where it reports what the observations do not say."""

    #: root of every random stream
    seed: int
    #: what was dropped, or is left after each step; empty where a reader does not count
    counts: Counter[str] = field(default_factory=Counter)
    #: set where the settings or the file itself say how entities are named; else the reader's function names them
    name_entities: NameEntities | None = None


@dataclass(frozen=True)
class Reader:
    """A function that reads observations, and what is to be known of it."""

    #: gives observations from a ``Mining`` and settings, whose types and defaults are those of its parameters
    read: Callable[..., Iterable[Observation]]
    name_entities: NameEntities
    #: the setting that names the file or folder to read; null where it reads what ships
    path: str | None = None
    #: suffixes of the files that it reads
    suffixes: Collection[str] = ()
    #: whether it reads JSON that begins with this value
    reads_json: Callable[[Any], bool] = lambda _value: False
    #: settings for a file alone, where its parameters have no default
    defaults: Mapping[str, Any] = field(default_factory=dict)


READERS: dict[str, Reader] = {}


def reader(
    name: str, name_entities: NameEntities, **known: Any
) -> Callable[[Callable[..., Iterable[Observation]]], Callable[..., Iterable[Observation]]]:
    """Register a function as a reader; ``known`` are the other fields of ``Reader``."""

    def register(read: Callable[..., Iterable[Observation]]) -> Callable[..., Iterable[Observation]]:
        READERS[name] = Reader(read, name_entities, **known)
        return read

    return register


def all_readers() -> dict[str, Reader]:
    """All readers by name."""
    for module in pkgutil.iter_modules(__path__, f"{__name__}."):
        if module.name != f"{__name__}.recorder":  # which loads the simulator's package
            importlib.import_module(module.name)
    return dict(sorted(READERS.items()))


def settings_of(section: object, key: str) -> tuple[Reader, dict[str, Any]]:
    """The reader that a section of params names, and its other keys as keyword arguments.

    Raises:
        InputError: where there is no such reader, or it does not take these settings; ``key`` is where they stand.
    """
    given = dict(config.check(section, dict[str, Any], key))
    name = config.check(given.pop("reader", None), config.Name, f"{key}.reader")
    if name not in READERS and name not in all_readers():
        expected = f"expected one of {', '.join(READERS)}, got {short(name)}{meant(name, READERS)}"
        raise InputError(paths.PARAMS, f"{key}.reader", expected)
    for setting, value in given.items():
        if isinstance(value, str) and "\0" in value:  # which is in no path
            raise InputError(f"{key}.{setting}", "", f"expected text without null, got {short(value)}")
    return READERS[name], config.keywords(READERS[name].read, given, key)


def observed(
    scene: str, room: str | None, instance: str, head: str, tails: Iterable[tuple[str, Iterable[str]]], count: int = 1
) -> Iterator[Observation]:
    """The observations of an object: its ``tails`` by relation."""
    for relation, names in tails:
        for tail in names:
            yield scene, room, instance, head, relation, tail, count


class Source:
    """A reader with its settings: its observations table by table, then its entities."""

    #: entities with kind and phrase (``tables.KINDS``), once all observations have been read
    kinds: pd.DataFrame

    def __init__(self, section: object, key: str, seed: int) -> None:
        """Choose the reader; nothing is read yet.

        Args:
            section: of params.
            key: where it stands.
            seed: root of every random stream.

        Raises:
            InputError: where there is no such reader, or it does not take these settings.
        """
        self._reader, self._settings = settings_of(section, key)
        self._place = str(self._settings.get(self._reader.path or "", key))
        self._mining = Mining(seed)
        #: what mining has dropped, or has left after each step
        self.counts = self._mining.counts

    def tables(self) -> Iterator[pa.Table]:
        """Observations (``tables.OBSERVATIONS``), at most ``CHUNK`` at once.

        Raises:
            InputError: where what is read is missing or broken, has no observations or too many, or text that is no
                name; at the end, where an entity has no kind, or more than one.
        """
        observations = iter(self._reader.read(self._mining, **self._settings))
        triples: set[tuple[str, str, str]] = set()
        rooms: set[str] = set()
        total = 0
        while rows := list(islice(observations, CHUNK)):
            columns = list(zip(*rows, strict=True))
            new = set(zip(*columns[3:6], strict=True)) - triples
            if fault := next(filter(None, map(name_fault, {name for triple in new for name in triple})), None):
                raise InputError(self._place, "", fault)
            total += sum(columns[6])
            if total > MOST_OBSERVED:
                raise InputError(self._place, "", f"expected at most {MOST_OBSERVED:,} observations in all")
            triples |= new
            rooms |= set(columns[1]) - {None}
            yield pa.table([*map(pa.array, columns, OBSERVATIONS.schema.types)], schema=OBSERVATIONS.schema)
        if not triples:
            raise InputError(self._place, "", "expected observations, got none")
        name_entities = self._mining.name_entities or self._reader.name_entities
        kinds = name_entities(pd.DataFrame(sorted(triples), columns=["head", "relation", "tail"]), rooms)
        missing = {name for head, _, tail in triples for name in (head, tail)} - set(kinds["entity"])
        if wrong := sorted(missing) or list(kinds.loc[kinds["entity"].duplicated(), "entity"]):
            raise InputError(f"entity {short(wrong[0])}", "", "expected its source to give it one kind")
        self.kinds = kinds
