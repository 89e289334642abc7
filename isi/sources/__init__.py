"""Sources of graphs: readers give observations (head, relation, tail) of scenes, tallies or tables.

Each module registers its readers by the names that ``reader`` has in params; a source is a reader with its settings.
An ``InputError`` refuses a file that is missing, broken or of another form, and names the file and the place.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import pandas as pd
import pyarrow as pa

from isi import config
from isi.errors import InputError, short
from isi.sources.names import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL, name_fault
from isi.tables.rules import COUNT, MOST_OBSERVED, NAME, TEXT, ColumnType, at_least
from isi.tables.table import Table

#: One row per instance, or per tally with its number.
OBSERVATIONS = Table(
    "data/observations/{source}.parquet",
    {"scene": ColumnType(NAME.type, nullable=True), "room": NAME.optional,
     "instance": ColumnType(TEXT.type, nullable=True), "head": NAME, "relation": NAME, "tail": NAME, "count": COUNT},
)  # fmt: skip
#: The entities of a source.
KINDS = Table(
    "data/observations/{source}.entities.parquet",
    {"entity": TEXT, "kind": NAME, "phrase": TEXT},
    key=["entity"],
)
#: How many instances each step of mining leaves.
MINED = Table(
    "data/observations/{source}.mined.parquet", {"step": TEXT, "instances": at_least(0, pa.int64())}, key=["step"]
)
CHUNK = 65_536  #: Maximum number of observations in memory.
#: Scene, room and instance (null where there is none), head, relation, tail, count.
Observation = tuple[str | None, str | None, str | None, str, str, str, int]
#: Gives the entities of a source (``KINDS``) from its unique triples and the names of its rooms.
NameEntities = Callable[[pd.DataFrame, Collection[str]], pd.DataFrame]
Read = Callable[..., Iterable[Observation]]


@dataclass
class Mining:
    """Arguments of a reader besides its settings: a seed, and fields in which the reader reports results."""

    seed: int  #: root of every random stream
    counts: Counter[str] = field(default_factory=Counter)  #: what is dropped, or left after each step
    name_entities: NameEntities | None = None  #: set where settings or the file say it, in place of the reader's own


@dataclass(frozen=True)
class Reader:
    """A function that reads observations, and which settings and files it takes."""

    read: Read  #: gives observations from a ``Mining`` and settings, which are its other parameters
    name_entities: NameEntities
    path: str | None = None  #: the setting that names the file or folder to read; null where it reads what ships
    suffixes: Collection[str] = ()  #: suffixes of the files that it reads
    reads_json: Callable[[Any], bool] = lambda _value: False  #: whether it reads JSON that begins with this value
    defaults: Mapping[str, Any] = field(default_factory=dict)  #: settings for a file alone, beside those of ``read``


#: The recorder loads the simulator's package, and registers nothing.
READERS: config.Plugins[Reader] = config.Plugins("isi.sources", skipped=["recorder"])


def reader(name: str, name_entities: NameEntities, **known: Any) -> Callable[[Read], Read]:
    """Register a function as a reader; ``known`` are the other fields of ``Reader``."""

    def register(read: Read) -> Read:
        READERS.register(name, Reader(read, name_entities, **known))
        return read

    return register


def all_readers() -> dict[str, Reader]:
    """All readers by name."""
    return {name: READERS.get(name) for name in READERS.names()}


def settings_of(section: object, key: str) -> tuple[Reader, dict[str, Any]]:
    """The reader that a section of params names, and its settings as keyword arguments; ``key`` is for errors."""
    given = dict(config.check(section, dict[str, Any], key))
    name = config.check(given.pop("reader", None), config.Name, f"{key}.reader")
    chosen = READERS.get(name, f"{key}.reader")
    for setting, value in given.items():
        if isinstance(value, str) and "\0" in value:  # which is in no path
            raise InputError(f"{key}.{setting}", "", f"expected text without null, got {short(value)}")
    return chosen, config.keywords(chosen.read, given, key)


def observed(
    scene: str, room: str | None, instance: str, head: str, receptacles: Iterable[str] = (),
    materials: Iterable[str] = (), affordances: Iterable[str] = (), count: int = 1,
) -> Iterator[Observation]:  # fmt: skip
    """The observations of an object: one each for its room, if known, receptacles, materials and affordances."""
    locations = [room, *receptacles] if room else receptacles
    tails = {AT_LOCATION: locations, HAS_MATERIAL: materials, HAS_AFFORDANCE: affordances}
    for relation, names in tails.items():
        for tail in names:
            yield scene, room, instance, head, relation, tail, count


class Source:
    """A reader with its settings: gives observations in tables, and then the entities."""

    kinds: pd.DataFrame  #: entities with kind and phrase (``KINDS``), once all observations have been read

    def __init__(self, section: object, key: str, seed: int) -> None:
        """Choose the reader (see ``settings_of``); nothing is read yet. ``seed`` is the root of random streams."""
        self._reader, self._settings = settings_of(section, key)
        self._place = str(self._settings.get(self._reader.path or "", key))
        self._mining = Mining(seed)
        self.counts = self._mining.counts

    def tables(self) -> Iterator[pa.Table]:
        """Observations (``OBSERVATIONS``), at most ``CHUNK`` a table; InputError also for an entity without a kind."""
        observations = iter(self._reader.read(self._mining, **self._settings))
        triples: set[tuple[str, str, str]] = set()
        rooms: set[str] = set()
        total = 0
        while rows := list(islice(observations, CHUNK)):
            columns = list(zip(*rows, strict=True))
            new = set(zip(*columns[3:6], strict=True)) - triples
            total += sum(columns[6])
            fault = next(filter(None, map(name_fault, {name for triple in new for name in triple})), None)
            if fault or total > MOST_OBSERVED:
                raise InputError(self._place, "", fault or f"expected at most {MOST_OBSERVED:,} observations in all")
            triples |= new
            rooms |= set(columns[1]) - {None}
            yield pa.table([*map(pa.array, columns, OBSERVATIONS.schema.types)], schema=OBSERVATIONS.schema)
        if not triples:
            raise InputError(self._place, "", "expected observations, got none")
        name_entities = self._mining.name_entities or self._reader.name_entities
        self.kinds = name_entities(pd.DataFrame(sorted(triples), columns=["head", "relation", "tail"]), rooms)
        missing = {name for head, _, tail in triples for name in (head, tail)} - set(self.kinds["entity"])
        if wrong := sorted(missing) or list(self.kinds.loc[self.kinds["entity"].duplicated(), "entity"]):
            raise InputError(f"entity {short(wrong[0])}", "", "expected exactly one kind from its source")
