"""A graph that grows: snapshots whose triples arrive one after the other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from isi.columns import TRIPLE
from isi.config import as_list
from isi.errors import InputError, at, cut, extra, suggestion
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.graph.vocabulary import numbered
from isi.insertion.arguments import named_triples
from isi.tables import paths

if TYPE_CHECKING:
    import pandas as pd

Split = Literal["train", "valid", "test"]
SPLITS: tuple[Split, ...] = ("train", "valid", "test")
#: By published name of a benchmark, its column in ``data/raw/snapshots/triples.parquet``.
BENCHMARKS = {
    "ENTITY": "lkge_entity",
    "RELATION": "lkge_relation",
    "FACT": "lkge_fact",
    "HYBRID": "lkge_hybrid",
    "GraphEqual": "graph_equal",
    "GraphHigher": "graph_higher",
    "GraphLower": "graph_lower",
    "FBinc-S": "fbinc_s",
    "FBinc-M": "fbinc_m",
    "FBinc-L": "fbinc_l",
}
PACKED = paths.RAW / "snapshots"  #: Tables of all of ``BENCHMARKS``.
ABSENT = 255  #: In a column of a benchmark: the triple takes no part.


@dataclass(frozen=True, eq=False)
class GraphSnapshot:
    """The triples that arrive together, in ids of the whole timeline; shapes (N, 3), int64."""

    train: np.ndarray
    valid: np.ndarray
    test: np.ndarray

    def split(self, name: Split) -> np.ndarray:
        """The triples of a split."""
        triples: np.ndarray = getattr(self, name)
        return triples

    @property
    def triples(self) -> np.ndarray:
        """The triples of all splits, in the order of ``SPLITS``; shape (N, 3)."""
        return np.concatenate([self.split(name) for name in SPLITS])


@dataclass(frozen=True, eq=False, repr=False)
class Timeline:
    """Snapshots over one vocabulary, whose ids are in the order of first appearance.

    The order is that of snapshots, then of ``SPLITS``, then of triples, head before tail. So the
    first ``entities[j]`` ids are the entities that a triple of snapshots 0 to j has, and a table of
    vectors only grows at its end.

    Example:
        >>> from isi.continual import Timeline
        >>> home = [("cup", "in", "kitchen"), ("bed", "in", "bedroom")]
        >>> later = [("mug", "like", "cup")]
        >>> grown = Timeline.of([(home, [], []), (later, [], [("mug", "in", "kitchen")])])
        >>> grown
        2 snapshots: entities 4, 5; relations 1, 2; triples 2, 2
        >>> grown.entity_names, grown.relation_names
        (['cup', 'kitchen', 'bed', 'bedroom', 'mug'], ['in', 'like'])
        >>> grown.snapshots[1].test.tolist(), grown.entities.tolist()
        ([[4, 0, 1]], [4, 5])
    """

    snapshots: tuple[GraphSnapshot, ...]
    entity_names: list[str]  #: by id
    relation_names: list[str]  #: by id
    #: by id of an entity, a text for word vectors: a label where names are codes, else the name
    words: list[str]
    #: pairs of an entity and the number of a class of it, each once, (P, 2); None: no classes
    classes: np.ndarray | None = None

    @classmethod
    def benchmark(cls, name: str) -> Timeline:
        """One of the ``BENCHMARKS`` of FB15k-237, from the checkout in the current folder.

        Entities have the names of Freebase, the labels of Wikidata as ``words``, and DBpedia's
        ``classes``. InputError for another name.
        """
        if name not in BENCHMARKS:
            known = suggestion(name, BENCHMARKS)
            expected = f"expected one of {', '.join(BENCHMARKS)}, got {name!r:.80}{known}"
            raise InputError("argument 'name'", "", expected)
        import pandas as pd

        with extra("pipeline"):
            import pyarrow  # noqa: F401

        column = BENCHMARKS[name]
        with at(PACKED):
            table = pd.read_parquet(PACKED / "triples.parquet", columns=[*TRIPLE, column])
            entities = pd.read_parquet(PACKED / "entities.parquet")
            relations = pd.read_parquet(PACKED / "relations.parquet")["relation"]
            classes = pd.read_parquet(PACKED / "classes.parquet")
        place = table[column].to_numpy()
        rows = table[list(TRIPLE)].to_numpy(np.int64)
        number = int(place[place != ABSENT].max()) // len(SPLITS) + 1
        parts = [rows[place == part] for part in range(number * len(SPLITS))]
        snapshots, entity_rows, relation_rows = snapshots_of(parts)
        named = entities.iloc[entity_rows]
        names, words = named["entity"].tolist(), named["label"].tolist()
        ids = np.full(len(entities), -1)
        ids[entity_rows] = np.arange(len(entity_rows))
        pairs = np.stack([ids[classes["entity"]], pd.factorize(classes["class"])[0]], 1)
        labels = relations.iloc[relation_rows].tolist()
        return cls(snapshots, names, labels, words, pairs[pairs[:, 0] >= 0])

    @classmethod
    def from_folder(cls, path: str | Path) -> Timeline:
        """The timeline in a folder as LKGE writes it: ``0``, ``1``, ... with ``train.txt``,
        ``valid.txt`` and ``test.txt``, each line a head, a relation and a tail between tabs.

        A file may be empty. InputError names the file, the line and what was expected.

        Example:
            >>> from pathlib import Path
            >>> from isi.continual import Timeline
            >>> for name in ("train", "valid", "test"):
            ...     file = Path("grown", "0", f"{name}.txt")
            ...     file.parent.mkdir(parents=True, exist_ok=True)
            ...     _ = file.write_text("cup\\tin\\tkitchen\\n" if name == "train" else "")
            >>> Timeline.from_folder("grown")
            1 snapshot: entities 2; relations 1; triples 1
            >>> _ = file.write_text("mug\\tin\\n")
            >>> Timeline.from_folder("grown")  # doctest: +ELLIPSIS
            Traceback (most recent call last):
            isi.errors.InputError: grown/0/test.txt: line 1: expected the columns head, relation...
        """
        folders = _snapshot_folders(Path(path))
        files = [folder / f"{name}.txt" for folder in folders for name in SPLITS]
        return cls._of_names([_read(file) for file in files])

    @classmethod
    def of(cls, snapshots: Sequence[Sequence[Any]]) -> Timeline:
        """The timeline of snapshots, each of which is its triples of names for training, validation
        and test. A whole number is the name of its digits.

        Raises:
            InputError: names the snapshot, the split, the triple and what was expected.

        Example:
            >>> from isi.continual import Timeline
            >>> Timeline.of([([("cup", "in")], [], [])])
            Traceback (most recent call last):
            isi.errors.InputError: snapshot 0: train, triple 0: expected head, relation and tail, \
got ('cup', 'in')
        """
        parts = []
        for number, snapshot in enumerate(_triples_of(snapshots, "argument 'snapshots'")):
            place = f"snapshot {number}"
            splits = _triples_of(snapshot, place)
            if len(splits) != len(SPLITS):
                expected = f"expected the triples of {', '.join(SPLITS)}, got {len(splits)} parts"
                raise InputError(place, "", expected)
            for name, split in zip(SPLITS, splits, strict=True):
                with at(place, name):
                    parts.append(named_triples(split))
        if not sum(map(len, parts)):
            raise InputError("argument 'snapshots'", "", "expected a snapshot with triples")
        return cls._of_names(parts)

    @classmethod
    def _of_names(cls, parts: Sequence[np.ndarray]) -> Timeline:
        snapshots, entities, relations = snapshots_of(parts)
        names = entities.tolist()
        return cls(snapshots, names, relations.tolist(), names)

    @cached_property
    def entities(self) -> np.ndarray:
        """Number of entities known after each snapshot; shape (T,), int64."""
        return self._known([HEAD, TAIL])

    @cached_property
    def relations(self) -> np.ndarray:
        """Number of relations known after each snapshot; shape (T,), int64."""
        return self._known([RELATION])

    def _known(self, slots: list[int]) -> np.ndarray:
        highest = [snapshot.triples[:, slots].max(initial=-1) for snapshot in self.snapshots]
        return np.maximum.accumulate(np.array(highest, np.int64) + 1)

    def table(self) -> pd.DataFrame:
        """A row for each snapshot: ``snapshot``, ``entities`` and ``relations`` known after it,
        ``new_entities``, ``new_relations``, and numbers of triples by split.

        Example:
            >>> from isi.continual import Timeline
            >>> first, second = [("cup", "in", "kitchen")], [("mug", "in", "kitchen")]
            >>> table = Timeline.of([(first, [], []), ([], [], second)]).table()
            >>> table[["snapshot", "entities", "new_entities", "train", "test"]]
               snapshot  entities  new_entities  train  test
            0         0         2             2      1     0
            1         1         3             1      0     1
        """
        import pandas as pd

        columns: dict[str, Any] = {"snapshot": range(len(self.snapshots))}
        for name, known in (("entities", self.entities), ("relations", self.relations)):
            columns |= {name: known, f"new_{name}": np.diff(known, prepend=0)}
        for split in SPLITS:
            columns[split] = [len(snapshot.split(split)) for snapshot in self.snapshots]
        return pd.DataFrame(columns)

    def __repr__(self) -> str:
        def each(numbers: Any) -> str:
            return ", ".join(f"{number:,}" for number in numbers)

        number = len(self.snapshots)
        return (
            f"{number} snapshot{'s' * (number != 1)}: entities {each(self.entities)}; "
            f"relations {each(self.relations)}; "
            f"triples {each(len(snapshot.triples) for snapshot in self.snapshots)}"
        )


def _triples_of(values: Any, place: str) -> list[Any]:
    """Snapshots, or the parts of one; InputError at ``place`` for a value that holds none."""
    with at(place):
        return as_list(values, object, "a list")


def snapshots_of(
    parts: Sequence[np.ndarray],
) -> tuple[tuple[GraphSnapshot, ...], np.ndarray, np.ndarray]:
    """Snapshots from the triples of their splits, (N, 3) each, in the order of ``SPLITS``; and the
    entities, (E,), and relations, (R,), of the triples by id.
    """
    ids, entities, relations = numbered(np.concatenate(parts))
    borders = np.cumsum([len(part) for part in parts])[:-1]
    splits = np.split(ids, borders)
    firsts = range(0, len(splits), len(SPLITS))
    snapshots = tuple(GraphSnapshot(*splits[first : first + len(SPLITS)]) for first in firsts)
    return snapshots, entities, relations


def _snapshot_folders(path: Path) -> list[Path]:
    """The folders ``0``, ``1``, ... in a folder; InputError if a number is missing."""
    names = [folder.name for folder in path.iterdir()] if path.is_dir() else []
    number = sum(name.isdecimal() for name in names)
    folders = [path / str(snapshot) for snapshot in range(number)]
    missing = [folder.name for folder in folders if not folder.is_dir()]
    if missing or not folders:
        got = cut(", ".join(sorted(names)) or "none", 80)
        expected = f"expected the folders 0, 1, ... of snapshots, got {got}"
        raise InputError(path, f"folder {missing[0]}" if missing else "", expected)
    return folders


def _read(file: Path) -> np.ndarray:
    """The triples of names in a file; shape (N, 3), object."""
    from isi.sources.readers import check_names, cleaned, read_batches

    if file.is_file() and not file.stat().st_size:
        return np.empty((0, len(TRIPLE)), object)
    parts = []
    for batch in read_batches(file, TRIPLE, headerless=Counter()):
        check_names(batch, file)
        parts.append(cleaned(batch)[list(TRIPLE)].to_numpy(object))
    return np.concatenate(parts)
