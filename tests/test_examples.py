"""The scripts of examples/ run as they stand;
live_client.py and ros2_node.py in test_live_examples.py.
"""

import contextlib
import io
import runpy
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import isi
from tests import stage_run

EXAMPLES = Path(__file__).parent.parent / "examples"
SCRIPT = EXAMPLES / "read_runs.py"
Run = Callable[[str], tuple[dict[str, Any], str]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made: Path = tmp_path_factory.mktemp("examples")
    stage_run.run_all(made)
    with chdir(made):
        stage_run.run(f"insert {stage_run.NAME} iu")
    return made


def shown(folder: Path, text: str) -> str:
    out = io.StringIO()
    with chdir(folder), contextlib.redirect_stdout(out):
        exec(compile(text, str(SCRIPT), "exec"), {})  # noqa: S102
    return out.getvalue()


def test_runs_are_read_and_compared_in_pairs(folder: Path) -> None:
    text, named = SCRIPT.read_text(encoding="utf-8"), '"ai2thor", "es", "xavier"'
    assert named in text
    printed = shown(folder, text.replace(named, f'"{stage_run.NAME}", "rs", "iu"'))
    tables = {
        name: pd.read_parquet(folder / f"data/runs/{stage_run.NAME}/{name}.parquet")
        for name in ("rs", "iu")
    }
    by_run = [
        {
            (row.size_, row.seed): row.mrr
            for row in table.rename(columns={"size": "size_"}).itertuples()
            if row.epoch == 0 and row.scope == "novel"
        }
        for table in tables.values()
    ]
    apart = np.array([100 * (by_run[0][run] - by_run[1][run]) for run in by_run[0]])
    half = 1.96 * apart.std(ddof=1) / np.sqrt(len(apart))
    assert f"rs - iu: {apart.mean():+.2f} ± {half:.2f} points over {len(apart)} runs" in printed
    for column in tables["rs"].columns:
        assert f"# | `{column}`" in text or f"`{column}`, " in text or f", `{column}`" in text


def test_without_runs_a_line_says_what_makes_them(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="make quick"):
        shown(tmp_path, SCRIPT.read_text(encoding="utf-8"))


@pytest.fixture
def run(
    tmp_path: Path,
    registries: None,  # noqa: ARG001
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Run:
    """Runs a script in an empty folder; the names that it leaves, and what it prints."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["example"])
    return lambda name: (runpy.run_path(str(EXAMPLES / name)), capsys.readouterr().out)


def test_a_table_is_trained_on_and_saved_with_a_new_object(run: Run) -> None:
    _, printed = run("train_csv.py")
    assert "Answer(entity='turn on'" in printed
    saved = isi.open("home")
    assert list(saved.inserted) == ["espresso machine"]
    assert ("espresso machine", "atLocation", "counter top") not in saved.now.named_triples()


def test_arrays_get_a_row(run: Run) -> None:
    left, printed = run("insert_arrays.py")
    assert left["done"].entities.shape == (60, 16)
    assert "known rows unchanged: True" in printed


def test_a_model_of_pykeen_gets_an_entity(run: Run) -> None:
    pytest.importorskip("pykeen")
    left, printed = run("insert_pykeen.py")
    assert left["answers"].tail_label.iloc[0] == "cook"
    assert "Interference(" in printed
    assert list(left["home"].inserted) == ["microwave"]
    assert left["larger"].num_entities == left["model"].num_entities + 1


def test_initializers_are_compared_by_the_answers_about_hidden_entities(run: Run) -> None:
    left, printed = run("compare_initializers.py")
    mrr = left["table"].set_index("initializer")["MRR of new entities"]
    assert mrr["ers"] > mrr["mean"] > mrr["xavier"]
    assert not set(left["hidden"]) & {*left["known"]["head"], *left["known"]["tail"]}
    assert f"{len(left['queries'])} queries" in printed


def test_a_study_of_hidden_entities_has_a_row_for_each_method(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pykeen")
    asked = ["nations", "--seeds", "1", "--facts", "1", "--epochs", "2", "--tables", "."]
    monkeypatch.setattr("sys.argv", ["hidden_study.py", *asked])
    left, printed = run("hidden_study.py")
    written = pd.read_csv("hidden_methods.csv")
    assert written["method"].tolist() == ["default", *left["METHODS"][1:]]
    assert written["known ends"].between(0, 1).all()
    summary = pd.read_csv("hidden.csv")
    named = written[~written["method"].isin(["default", "retrained"])]
    assert summary["best named is"].item() in named["method"].tolist()
    assert float(summary["best named"].item().split()[0]) == named["known ends"].max()
    assert "earlier lost" in printed


def test_an_own_initializer_is_used_by_name(run: Run) -> None:
    left, printed = run("own_initializer.py")
    np.testing.assert_allclose(left["done"].entities[40], left["entities"].mean(0) / 2, atol=1e-6)
    assert "twice as long: 2.0" in printed
    assert "needs_are_what_it_uses" in printed


def test_a_map_becomes_an_embedding_and_the_next_map_adds_to_it(run: Run) -> None:
    with pytest.warns(UserWarning, match="learned nothing"):
        _, printed = run("scene_graph.py")
    assert "inserted: espresso machine" in printed
    assert list(isi.open("mapped_home").inserted) == ["espresso machine"]


def test_the_list_of_examples_is_complete() -> None:
    listed = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    for path in EXAMPLES.iterdir():
        assert f"[{path.name}]({path.name})" in listed or path.name in (
            "README.md",
            "__pycache__",
        ), path.name
