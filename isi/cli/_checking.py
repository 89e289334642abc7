"""Every rule of the tables and tensors under data/, each file by itself and beside the others."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isi.config import check, value_of
from isi.errors import InputError
from isi.pipeline import made_files, maker_now
from isi.tables import catalogue, io, paths
from isi.tables.catalogue import Schema
from isi.tables.origin import PipelineOrigins
from isi.tables.provenance import Provenance, metadata_of

if TYPE_CHECKING:
    from isi.experiment.grid import GridPoints
    from isi.experiment.store import Store


#: Models of a stack, at most: all of a size.
_ALL = 10**9
#: The tables of single insertions, and their columns of ids of entities.
OF_SINGLES: dict[str, tuple[Schema, Sequence[str]]] = {
    "entities": (catalogue.SINGLES, ["entity"]),
    "indicators": (catalogue.SINGLE_INDICATORS, ["entity", "indicator"]),
    "places": (catalogue.SINGLE_PLACES, ["entity"]),
    "answers": (catalogue.SINGLE_ANSWERS, ["entity", "answer"]),
}
#: Which table lies where: by its path's function of names.
TABLES: list[tuple[Callable[..., Path], Schema]] = [
    (paths.observations, catalogue.OBSERVATIONS),
    (paths.kinds, catalogue.KINDS),
    (paths.mined, catalogue.MINED),
    (paths.entities, catalogue.ENTITIES),
    (paths.triples, catalogue.TRIPLES),
    (paths.coverage, catalogue.COVERAGE),
    (paths.splits, catalogue.SPLITS),
    (paths.novel, catalogue.NOVEL),
    (paths.insert_triples, catalogue.INSERT_TRIPLES),
    (paths.training_log, catalogue.TRAINING_LOG),
    (paths.runs, catalogue.RUNS),
    (paths.inserted, catalogue.INSERTED),
    (paths.ties, catalogue.TIES),
    (paths.affordances, catalogue.AFFORDANCES),
    (paths.asked, catalogue.ASKED),
    (paths.used, catalogue.USED),
    (paths.nothing, catalogue.RUNS),
    (paths.indicator_sweep, catalogue.INDICATOR_SWEEP),
    (paths.rate_sweep, catalogue.RATE_SWEEP),
    (paths.cross_validation, catalogue.CROSS_VALIDATION),
    (paths.families, catalogue.FAMILIES),
    (paths.variant, catalogue.VARIANTS),
    (paths.variant_asked, catalogue.VARIANTS_ASKED),
    *((partial(paths.explorer, what=what), schema) for what, (schema, _) in OF_SINGLES.items()),
    (partial(paths.explored, what="entities"), catalogue.ENTITIES),
    (partial(paths.explored, what="triples"), catalogue.TRIPLES),
    (partial(paths.explored, what="runs"), catalogue.VARIANTS),
    (partial(paths.explored, what="asked"), catalogue.VARIANTS_ASKED),
    (paths.hidden, catalogue.HIDDEN),
]
#: Where tensors lie, but for Θ⁰'s.
TENSORS: list[Callable[..., Path]] = [paths.vectors, paths.joint, paths.initial_vectors, paths.approach]


def schema_of(path: Path) -> Schema | None:
    """What a table of the pipeline holds, by where it lies."""
    return next((schema for at_path, schema in TABLES if _lies(path, at_path)), None)


def is_tensors(path: Path) -> bool:
    """Whether tensors of the pipeline lie there."""
    theta0 = re.fullmatch(r"data/embeddings/\w+/theta0/size=\d+\.safetensors", path.as_posix())
    return bool(theta0) or any(_lies(path, at_path) for at_path in TENSORS)


def _lies(path: Path, at_path: Callable[..., Path]) -> bool:
    names = [name for name in inspect.signature(at_path).parameters if name != "what"]
    pattern = re.escape(at_path(**dict.fromkeys(names, "NAME")).as_posix()).replace("NAME", r"\w+")
    return re.fullmatch(pattern, path.as_posix()) is not None


class Checking:
    """The files of a project, and what is wrong with them."""

    def __init__(self, everything: Mapping[str, Any]) -> None:
        """``everything``: what ``params.yaml`` holds."""
        self.everything = everything
        #: how many were looked at
        self.files = 0
        self._provenance = Provenance("check", {}, origins=PipelineOrigins(everything))

    def findings(self) -> Iterator[InputError]:
        """What is wrong, file by file and then between them."""
        for path, _ in made_files(self.everything):
            if schema_of(path) or is_tensors(path):
                self.files += 1
                yield from found(partial(self._read, path))
        for folder in sorted(paths.KEPT.glob("*")):
            if maker_now(folder, self.everything):
                self.files += sum(1 for _ in folder.iterdir())
                yield from found(partial(self._read_kept, folder))
        for listed in self._made(paths.DATA / "graph", "*/entities.parquet"):
            yield from self.between(listed.parent.name)

    def _made(self, folder: Path, names: str) -> list[Path]:
        """Files that a run of the pipelines writes, not those of what params no longer list."""
        return [path for path in sorted(folder.glob(names)) if maker_now(path, self.everything)]

    def _read(self, path: Path) -> None:
        schema = schema_of(path)
        if schema:
            io.read(path, schema, self._provenance)
        else:
            io.read_tensors(path, [], self._provenance)

    def _read_kept(self, folder: Path) -> None:
        from isi.bundle.folder import ABOUT, read

        read(folder)
        self._provenance.seen(folder / ABOUT, metadata_of(folder / ABOUT))

    def between(self, experiment: str) -> Iterator[InputError]:
        """What does not agree with what it stands beside, of one experiment, as far as that has run."""
        from isi.experiment.store import Store  # here, since it loads torch

        store = Store(experiment, self._provenance)
        if _there(paths.entities(experiment), paths.triples(experiment)):
            yield from found(store.graph)
            yield from self._of_entities(store)
        sessions = paths.splits, paths.novel, paths.insert_triples
        if _there(paths.entities(experiment), *(at_path(experiment) for at_path in sessions)):
            yield from found(store.insert_triples)
            yield from self._of_sessions(store)

    def _of_sessions(self, store: Store) -> Iterator[InputError]:
        from isi.models.model import EmbeddingParams, make_model

        try:
            stacks = store.grid(_ALL)
            how = check(self.everything.get("embedding"), EmbeddingParams, "embedding")
            family = make_model(
                how.family, value_of(self.everything, f"families.{how.family}"), f"families.{how.family}"
            )
        except InputError as error:
            yield error
            return
        for points in stacks:
            if paths.theta0(store.experiment, points.size).exists():
                yield from found(partial(store.theta0, points, family))
                yield from self._of_inserted(store, points)
            if paths.joint(store.experiment).exists():
                yield from found(partial(store.joint, points, family))
            if paths.runs(store.experiment, "joint").exists():
                yield from found(partial(_see_joint_runs, store, points))

    def _of_entities(self, store: Store) -> Iterator[InputError]:
        """What lists entities, or their ids."""
        experiment = store.experiment
        listed = [
            (paths.affordances(experiment), catalogue.AFFORDANCES, ["entity", "answer"]),
            *((path, catalogue.INSERTED, ["entity"]) for path in self._made_by_insertion(store, ".inserted.parquet")),
            *((paths.explorer(experiment, what), *of_singles) for what, of_singles in OF_SINGLES.items()),
        ]
        if paths.coverage(experiment).exists():
            yield from found(partial(_see_coverage, store))
        if paths.vectors(experiment).exists():
            yield from found(store.words)
        for path, schema, columns in listed:
            if path.exists():
                yield from found(partial(_see_ids, store, path, schema, columns))

    def _of_inserted(self, store: Store, points: GridPoints) -> Iterator[InputError]:
        """The vectors that each initializer inserted."""
        for path in self._made_by_insertion(store, ".safetensors"):
            yield from found(partial(_see_inserted, store, path, points))

    def _made_by_insertion(self, store: Store, ending: str) -> list[Path]:
        return self._made(paths.runs(store.experiment, "x").parent, f"*{ending}")


def _see_coverage(store: Store) -> None:
    from isi.tables import checks

    path = paths.coverage(store.experiment)
    checks.rows_are_entities(path, io.read(path, catalogue.COVERAGE, store.provenance), store.entities())


def _see_ids(store: Store, path: Path, schema: Schema, columns: Sequence[str]) -> None:
    from isi.tables import checks

    table, number = io.read(path, schema, store.provenance), len(store.entities())
    for column in columns:
        checks.ids_below(path, table, column, number, "graph's entities")


def _see_inserted(store: Store, path: Path, points: GridPoints) -> None:
    """An initializer that an experiment does not list has left no vectors."""
    if io.opened_tensors(path, [f"size={points.size:02d}"])[0]:
        store.initial_vectors(path.stem, points)


def _see_joint_runs(store: Store, points: GridPoints) -> None:
    from isi.experiment.insert import joint_targets

    joint_targets(store.runs("joint"), points)


def _there(*files: Path) -> bool:
    return all(file.exists() for file in files)


def found(see: Callable[[], object]) -> Iterator[InputError]:
    """What a check refuses."""
    try:
        see()
    except InputError as error:
        yield error
