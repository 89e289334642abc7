"""What a small run wrote is read whole; broken tables and tensors are named where they are read."""

from collections.abc import Callable
from contextlib import chdir
from pathlib import Path

import pytest

from isi.errors import InputError
from isi.evaluation.changes import change_rows
from isi.tables.table import Table
from stages.files import KINDS, OBSERVATIONS
from stages.insert import joint_targets
from stages.params import StageParams
from stages.store import RUNS, Store, model_of
from tests import stage_run
from tests.broken_tables import CASES, TENSOR_CASES, Tensors
from tests.example_tables import Change, change_table, change_tensors
from tests.stage_run import NAME, SOURCE, for_a_while


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    stage_run.run_all(folder)
    return folder


def read_all() -> None:
    """Read the tables and tensors of the small run, as stages do."""
    for table in (OBSERVATIONS, KINDS):
        table.read(source=SOURCE)
    store, model = Store(NAME), model_of(StageParams.load())
    runs = RUNS.read(experiment=NAME, model="joint")
    store.words()
    for points in store.grid(stack=100):
        store.theta0(points, model)
        store.joint(points, model)
        store.initial_vectors("rs", points)
        joint_targets(change_rows(runs), points)


def test_what_the_stages_wrote_is_read(made: Path) -> None:
    with chdir(made):
        read_all()


@pytest.mark.parametrize(
    ("table", "change", "pattern"), [case[1:] for case in CASES], ids=[case[0] for case in CASES]
)
def test_a_broken_table_is_named_with_what_was_expected(
    made: Path, table: Table, change: Change, pattern: str
) -> None:
    with chdir(made):
        path = table.path(experiment=NAME, source=SOURCE, model="joint")
        with for_a_while(path, lambda path: change_table(table, path, change)):
            with pytest.raises(InputError, match=pattern) as refused:
                read_all()
            assert len(str(refused.value)) < 300


@pytest.mark.parametrize(
    ("path", "change", "pattern"),
    [case[1:] for case in TENSOR_CASES],
    ids=[case[0] for case in TENSOR_CASES],
)
def test_broken_tensors_are_named_with_what_was_expected(
    made: Path, path: Path, change: Callable[[Tensors], None], pattern: str
) -> None:
    with chdir(made), for_a_while(path, lambda path: change_tensors(path, change)):
        with pytest.raises(InputError, match=pattern) as refused:
            read_all()
        assert str(refused.value).startswith(str(path))
