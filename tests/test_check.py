"""``isi check``: the problems of the files under data/, one line each."""

import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import chdir
from pathlib import Path

import pytest

from isi import config
from isi.__main__ import main
from isi.cli.check import catalogue, check_data
from isi.experiment.store import INITIAL_VECTORS, INSERTED, RUNS, THETA0
from isi.graph.graph import ENTITIES
from isi.graph.sessions import SPLITS
from isi.graph.words import COVERAGE
from isi.params import load
from isi.tables import paths
from isi.tables.table import Table
from tests import small
from tests.broken_tables import CASES, TENSOR_CASES, Tensors, put
from tests.example_tables import ROWS, Change, change_table, change_tensors
from tests.small import NAME, for_a_while

FILES = 26  #: Of the pipeline, and of the final model.


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("checked")
    small.run_all(folder)
    with chdir(folder):
        small.run(f"train_final {NAME}")
    return folder


@pytest.fixture
def _in_copy(made: Path, tmp_path: Path) -> Iterator[None]:
    shutil.copytree(made, tmp_path / "copy", symlinks=True)
    with chdir(tmp_path / "copy"):
        yield


def check(capsys: pytest.CaptureFixture[str]) -> tuple[list[str], object]:
    """Run ``isi check``; returns the printed lines and the exit status."""
    ended: object = 0
    try:
        main(["check"])
    except SystemExit as error:
        ended = error.code
    return capsys.readouterr().out.splitlines(), ended


def problems() -> list[str]:
    number, lines = check_data(load())
    assert number == FILES
    assert len(set(lines)) == len(lines)
    assert all("\n" not in line and len(line) < 300 for line in lines)
    return lines


@pytest.mark.usefixtures("_in_copy")
def test_what_the_stages_wrote_has_no_problem(capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert check(capsys) == ([f"{FILES} files under data, 0 problems"], 0)


@pytest.mark.usefixtures("_in_copy")
def test_each_problem_is_one_line_and_the_status_is_1(capsys: pytest.CaptureFixture[str]) -> None:
    splits, vectors = (
        SPLITS.path(experiment=NAME),
        INITIAL_VECTORS.path(experiment=NAME, initializer="rs"),
    )
    runs, theta0 = RUNS.path(experiment=NAME, model="rs"), THETA0.path(experiment=NAME, size=2)
    change_table(SPLITS, splits, put("triple", -1))
    change_table(RUNS, runs, put("mrr_star", 2.0))
    for path in (theta0, vectors):
        path.write_bytes(path.read_bytes()[:-100])
    capsys.readouterr()
    lines, ended = check(capsys)
    assert ended == 1
    assert f"{FILES} files under data, {len(lines) - 1} problems" in lines[-1]
    for path in (splits, runs, theta0, vectors):
        assert any(line.startswith(f"{path}: ") for line in lines), path


@pytest.mark.parametrize(
    ("table", "change", "pattern"), [case[1:] for case in CASES], ids=[case[0] for case in CASES]
)
def test_a_broken_table_is_named_with_what_was_expected(
    made: Path, table: Table, change: Change, pattern: str
) -> None:
    with chdir(made):
        path = table.path(experiment=NAME, source=NAME, model="joint")
        with for_a_while(path, lambda path: change_table(table, path, change)):
            assert any(re.search(pattern, line) for line in problems())


@pytest.mark.parametrize(
    ("path", "change", "pattern"),
    [case[1:] for case in TENSOR_CASES],
    ids=[case[0] for case in TENSOR_CASES],
)
def test_broken_tensors_are_named_with_what_was_expected(
    made: Path, path: Path, change: Callable[[Tensors], None], pattern: str
) -> None:
    with chdir(made), for_a_while(path, lambda path: change_tensors(path, change)):
        assert any(line.startswith(str(path)) and re.search(pattern, line) for line in problems())


@pytest.mark.usefixtures("_in_copy")
def test_files_that_params_no_longer_list_are_not_checked() -> None:
    """DVC does not delete such files."""
    for table in (INITIAL_VECTORS, INSERTED):
        rs, gone = (table.path(experiment=NAME, initializer=name) for name in ("rs", "gone"))
        shutil.copy(rs, gone)
    shutil.copytree(ENTITIES.path(experiment=NAME).parent, ENTITIES.path(experiment="gone").parent)
    assert problems() == []


@pytest.mark.usefixtures("_in_copy")
def test_the_final_model_and_what_does_not_agree_with_the_graph_are_found() -> None:
    coverage, names = COVERAGE.path(experiment=NAME), paths.final_model(NAME) / "entities.tsv"
    names.write_bytes(names.read_bytes()[:-1] + b"x\n")
    change_table(COVERAGE, coverage, lambda frame: frame[::-1])
    assert sorted(line.split(" ")[0] for line in problems()) == [f"{names}:", f"{coverage}:"]


def test_every_output_of_the_pipelines_is_declared_and_every_table_has_an_example() -> None:
    files = catalogue()
    with chdir(small.ROOT):
        for pipeline in (paths.PIPELINE, paths.BEYOND_PIPELINE):
            for entry in config.read(pipeline)["stages"].values():
                for out in entry["outs"]:
                    if isinstance(out, str) and not re.search(r"^data/final_models/|\.json$", out):
                        path = Path(re.sub(r"\$\{[^}]*\}", "x", out))
                        assert any(
                            file.names_in(path) or file.names_in(path / "size=01.safetensors")
                            for file in files
                        )
    columns = {tuple(table.columns) for table in ROWS}
    assert {
        file for file in files if isinstance(file, Table) and tuple(file.columns) not in columns
    } == set()
