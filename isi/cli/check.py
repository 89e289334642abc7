"""``isi check``: checks each table and tensor file under data/ by its declared
rules and against the others.
"""

import pkgutil
import sys
from collections import defaultdict
from collections.abc import Callable, Mapping
from importlib import import_module
from itertools import product
from pathlib import Path

import isi.analyses
import isi.sources
from isi.errors import InputError
from isi.experiment import agreement
from isi.experiment.grid import GridPoints
from isi.experiment.insert import joint_targets
from isi.experiment.store import INITIAL_VECTORS, JOINT, RUNS, THETA0, Store
from isi.graph.graph import ENTITIES, TRIPLES
from isi.graph.sessions import INSERT_TRIPLES, NOVEL, SPLITS
from isi.graph.words import COVERAGE, WORD_VECTORS
from isi.live import folder as bundles
from isi.params import Params, load
from isi.pipeline import makers
from isi.tables import io, paths
from isi.tables.table import DataFile, Table, declared

Declared = tuple[Path, DataFile, Mapping[str, str]]  #: Path, declaration, names in the path.
ALL = 10**9  #: Maximum number of models in a stack: one stack holds all seeds of a size.


def check() -> None:
    """Print a line per problem, then a summary. Exit with status 1 for any problem;
    InputError without valid params.
    """
    number, problems = check_data(load())
    print(*problems, sep="\n", end="\n" * bool(problems))
    nothing = "" if number else ": nothing has run (`dvc repro`)"
    print(f"{number:,} files under {paths.DATA}, {len(problems):,} problems{nothing}")
    if problems:
        sys.exit(1)


def catalogue() -> list[DataFile]:
    """All declared tables and tensor files."""
    for module in pkgutil.iter_modules(isi.analyses.__path__):
        if "pykeen" not in module.name:  # a module that needs PyKEEN, which may not be installed
            import_module(f"isi.analyses.{module.name}")
    return declared()


def check_data(params: Params) -> tuple[int, list[str]]:
    """Check all files that the pipelines wrote: the number of files, and a line per problem."""
    problems, experiments = list[InputError](), defaultdict[str, list[Declared]](list)

    def attempt(check: Callable[..., object], *arguments: object) -> None:
        try:
            check(*arguments)
        except InputError as error:
            problems.append(error)

    data = (
        path
        for path in sorted(paths.DATA.rglob("*"))
        if path.is_file() and not path.is_relative_to(paths.RAW)
    )
    files = [path for path in data if any(makers(path))]
    for path, file in product(files, catalogue()):
        if (names := file.names_in(path)) is not None:
            attempt(file.read_file, path)
            experiments[names.get("experiment", "")].append((path, file, names))
    for folder in sorted(
        {path.parent for path in files if path.is_relative_to(paths.FINAL_MODELS)}
    ):
        attempt(bundles.read, folder)
    for experiment, listed in experiments.items():
        if {ENTITIES, TRIPLES} <= {file for _, file, _ in listed}:
            _check_agreement(Store(experiment), listed, params, attempt)
    return len(files), list(dict.fromkeys(map(str, problems)))


def _check_agreement(
    store: Store, listed: list[Declared], params: Params, attempt: Callable[..., None]
) -> None:
    """Check that the files of one experiment agree, as far as its stages have run."""
    attempt(store.graph)
    stacks = list[GridPoints]()
    if {SPLITS, NOVEL, INSERT_TRIPLES} <= {file for _, file, _ in listed}:
        attempt(store.insert_triples)
        attempt(lambda: stacks.extend(store.grid(ALL)))
    for path, file, names in listed:
        attempt(_check_entities, store, path, file)
        for points in stacks:
            attempt(_check_stack, store, path, file, names, points, params)


def _check_entities(store: Store, path: Path, file: DataFile) -> None:
    """Check that the rows or entity ids of a file fit the entities of the graph."""
    if file is WORD_VECTORS:
        store.words()
    elif file is COVERAGE:
        agreement.rows_are_entities(path, COVERAGE.read_file(path), store.entities())
    elif isinstance(file, Table) and file.entity_ids:
        rows = file.read_file(path)
        for column in file.entity_ids:
            agreement.ids_below(path, rows, column, len(store.entities()), "the graph's entities")


def _check_stack(
    store: Store,
    path: Path,
    file: DataFile,
    names: Mapping[str, str],
    points: GridPoints,
    params: Params,
) -> None:
    """Check the part of a file that belongs to a stack of grid points."""
    if file is THETA0 and int(names["size"]) == points.size:
        store.theta0(points, params.model_of())
    elif file is JOINT:
        for session in range(1, points.sessions + 1):
            store.joint(points, params.model_of(), session)
    elif file is RUNS and names["model"] == "joint":
        joint_targets(RUNS.read_file(path), points)
    # else it did not run
    elif file is INITIAL_VECTORS and f"size={points.size:02d}" in io.tensors_in(path):
        store.initial_vectors(names["initializer"], points)
