"""``make verify`` on a tiny graph that grows: it computes the same, and finds altered numbers."""

import shutil
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from safetensors.numpy import load_file, save_file

from isi.continual import Timeline
from isi.continual.experiment import FIRST, MATRIX
from isi.report.tables.growing import PUBLISHED
from isi.tables import paths
from tests import small_continual, stage_run
from tests.small_continual import NAME
from tools import verify
from tools.verify import TIE, Check, GrowingGraph, ranked, wins_of

INITIALIZERS: dict[str, Any] = {"mean": {}, "er_avg": {}}
PAIRS = {"mean": ["insert", "replay"], "er_avg": ["insert"]}
SETTINGS = small_continual.ENTRY | {"initializers": INITIALIZERS, "pairs": PAIRS}
TABLES = Path("reports/continual/tables")


@pytest.fixture(scope="module")
def grown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project after a run and its report."""
    folder = tmp_path_factory.mktemp("grown")
    stage_run.lay_out(folder, {"compute.workers": 1})
    small_continual.lay_out(folder, initializers=INITIALIZERS, pairs=PAIRS)
    with chdir(folder), pytest.MonkeyPatch.context() as patch:
        for kind, numbers in (("after_last", 3), ("interference", 4)):
            rows = PUBLISHED[kind][0]["rows"]
            patch.setitem(rows, SETTINGS["timeline"], {"theirs": numbers * [0.5]})
        stage_run.run(f"grow {NAME}")
        stage_run.run("tables_continual")
    return folder


@pytest.fixture
def copied(grown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy of it is the current folder."""
    folder = tmp_path / "copied"
    shutil.copytree(grown, folder, symlinks=True)
    monkeypatch.chdir(folder)


def verified() -> tuple[Check, Check]:
    matrix, measured = verify.verify_grown({NAME: SETTINGS})
    return matrix, measured


@pytest.mark.usefixtures("copied")
def test_other_code_computes_the_same_from_the_tables_alone(
    capsys: pytest.CaptureFixture[str],
) -> None:
    matrix, measured = verified()
    assert matrix.disagreements == measured.disagreements == []
    table = pd.read_parquet(MATRIX.path(experiment=NAME))
    plain = table["initializer"].isna() | (table["initializer"] == "mean")
    alone = (table["strategy"] != "replay") | ((table["i"] == 1) & (table["phase"] == "inserted"))
    assert matrix.number == (plain & alone).sum() > 200
    assert measured.number == 3 * 3  # chains, tables
    assert f"R[i, j] of {NAME}: " in capsys.readouterr().out


@pytest.mark.usefixtures("copied")
def test_experiments_that_have_not_run_or_have_another_model_are_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    settings = {"later": SETTINGS, NAME: SETTINGS | {"model": "transe_l1"}}
    matrix, measured = verify.verify_grown(settings)
    assert matrix.number == 0 < measured.number
    lines = capsys.readouterr().out.splitlines()
    assert ["later, which have not run" in lines[0], f"{NAME}, of other" in lines[1]] == [True] * 2


@pytest.mark.usefixtures("copied")
def test_the_command_needs_no_other_pipeline(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["verify"])
    for change, disagreements in ((0.0, 0), (1e-4, 1)):
        alter_matrix("mrr", change, i=0)
        with pytest.raises(SystemExit) as ended:
            verify.main()
        assert ended.value.code == disagreements
        lines = capsys.readouterr().out.splitlines()
        assert lines[0] == "Not computed again: the first pipeline, which has not run."
        (of_matrix,) = (line for line in lines if line.startswith(f"{'R[i, j]':18}"))
        assert of_matrix.split()[-1] == str(disagreements)


def alter_matrix(column: str, change: float, **values: Any) -> str:
    """Add to a number of the first row with these values; how a line names it."""
    path = MATRIX.path(experiment=NAME)
    table = pd.read_parquet(path)
    alike = np.logical_and.reduce([table[name] == value for name, value in values.items()])
    place = table.index[alike][0]
    table.loc[place, column] += change
    table.to_parquet(path)
    row = table.loc[place, ["phase", "i", "protocol", "j", "slot", "answer"]]
    return ", ".join([*(f"{name} {value}" for name, value in row.items()), column])


@pytest.mark.usefixtures("copied")
@pytest.mark.parametrize(
    ("column", "change", "values"),
    [
        ("mrr", 1e-4, {"protocol": "lkge", "initializer": "mean", "strategy": "insert", "i": 2}),
        ("hits@3", -1e-4, {"protocol": "old", "initializer": "mean", "phase": "inserted"}),
        ("queries", 1, {"protocol": "current", "i": 0, "seed": 1}),
        ("hits@10", 1e-3, {"protocol": "revisiting", "strategy": "replay", "phase": "inserted"}),
    ],
)
def test_an_altered_number_of_the_matrix_is_named(
    column: str, change: float, values: dict[str, Any]
) -> None:
    where = alter_matrix(column, change, **values)
    (line,) = verified()[0].disagreements
    assert where in line


@pytest.mark.usefixtures("copied")
def test_a_missing_row_and_one_too_many_disagree() -> None:
    path = MATRIX.path(experiment=NAME)
    table = pd.read_parquet(path)
    table[1:].to_parquet(path)
    assert len(verified()[0].disagreements) == 1
    more = table.iloc[:1].assign(j=7)
    pd.concat([table, more]).to_parquet(path)
    assert len(verified()[0].disagreements) == 1


@pytest.mark.usefixtures("copied")
def test_another_first_embedding_disagrees() -> None:
    path = FIRST.path(experiment=NAME)
    tables = load_file(path)
    save_file(tables | {"entity": tables["entity"][::-1].copy()}, path)
    assert len(verified()[0].disagreements) > 20


@pytest.mark.usefixtures("copied")
@pytest.mark.parametrize(
    ("name", "column", "line"), [(f"grown_{NAME}", "D", 1), ("interference", "A_TN", 2)]
)
def test_an_altered_number_of_the_report_is_named(name: str, column: str, line: int) -> None:
    table = pd.read_csv(TABLES / f"{name}.csv")
    place = line + len(table) - 3  # after the published numbers
    table[column] += 0.02 * (table.index == place)
    table.to_csv(TABLES / f"{name}.csv", index=False)
    (disagreement,) = verified()[1].disagreements
    table_name = name.removesuffix(f"_{NAME}")
    chain = ("mean insert", "mean replay", "er_avg insert")[line]
    expected = f"continual measures, {chain}, {column}, table {table_name}, {NAME}: "
    assert disagreement.startswith(expected)


def test_the_packed_benchmarks_are_read_in_the_same_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(paths.RAW.resolve().parent.parent)
    own, graph = Timeline.benchmark("FBinc-S"), GrowingGraph("FBinc-S")
    assert graph.entities == own.entities.tolist()
    assert graph.tests[0].tolist() == own.snapshots[0].test.tolist()


def test_scores_at_the_edge_of_a_tie_may_fall_either_way() -> None:
    answer, largest = 0.0, 2.0
    gaps = np.array([0.5, 1 - 1e-3, 1 + 1e-3, 2.0, -0.5, -1 + 1e-3, -2.0]) * TIE * largest
    scores = np.array([[answer, *gaps, -largest]])
    fewest, most = wins_of(scores, np.array([0]))[:, 0].tolist()
    assert fewest == [0.5, 0.5, 0.5, 0.5, 1, 0.5, 0, 0, 0]
    assert most == [0.5, 0.5, 1, 1, 1, 0.5, 0.5, 0, 0]


def write_snapshots(folder: Path, *snapshots: list[str]) -> None:
    """Write snapshots of at most one triple in each split."""
    for number, lines in enumerate(snapshots):
        (folder / str(number)).mkdir()
        for split, line in zip(("train", "valid", "test"), lines, strict=True):
            text = line.replace(" ", "\t") + "\n" if line else ""
            (folder / str(number) / f"{split}.txt").write_text(text, encoding="utf-8")


def test_test_sets_with_later_relations_are_left_out(tmp_path: Path) -> None:
    write_snapshots(tmp_path, ["cup in hall", "", "hall in cup"], ["mug on cup", "", "mug on hall"])
    graph = GrowingGraph(str(tmp_path))
    ranks = ranked(graph, np.ones((2, 2), np.float32), np.ones((1, 4), np.float32), 1)
    assert set(ranks["j"]) == {0}
