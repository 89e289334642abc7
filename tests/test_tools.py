"""The tools around the pipeline: what they say, and what they refuse."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from isi.params import load
from tools import compare, headline, repro, workspace

ROOT = Path(__file__).parent.parent


def check_params(folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "isi.params"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("file", "sound", "wrong", "named"),
    [
        ("params.yaml", "patience:", "patients:", "params.yaml: training.patients"),
        (
            "beyond/params.yaml",
            "max_insert_triples: 2,",
            "max_insert_triples: -2,",
            "beyond/params.yaml: variants.insert_triples_2.max_insert_triples",
        ),
    ],
)
def test_a_mistake_in_params_is_one_line_and_a_status(
    tmp_path: Path, file: str, sound: str, wrong: str, named: str
) -> None:
    (tmp_path / "beyond").mkdir()
    for name in ("params.yaml", "beyond/params.yaml"):
        text = (ROOT / name).read_text(encoding="utf-8")
        assert name != file or sound in text
        (tmp_path / name).write_text(text.replace(sound, wrong) if name == file else text, encoding="utf-8")
    ended = check_params(tmp_path)
    assert ended.returncode == 1
    assert ended.stderr.splitlines() == [ended.stderr.strip()]
    assert named in ended.stderr


@pytest.mark.parametrize(
    "gone",
    [[], ["initializers.gaussian"], ["experiments.published", "sources.published"], ["initializers.mean"]],
    ids=["nothing", "an initializer", "an experiment", "another initializer"],
)
def test_the_quick_grid_fits_params_from_which_something_was_left_out(tmp_path: Path, gone: list[str]) -> None:
    params = yaml.safe_load((ROOT / "params.yaml").read_text(encoding="utf-8"))
    workspace.change_all(params, dict.fromkeys(gone, workspace.DROP))
    workspace.change_all(params, workspace.QUICK)
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(params), encoding="utf-8")
    quick = load(tmp_path / "params.yaml")
    assert quick.experiments["ai2thor"].sessions.seeds == 4
    assert set(quick.plots.initializers) <= set(quick.initializers)
    assert "published" not in quick.experiments


def test_a_change_of_what_was_left_out_is_no_change() -> None:
    params: dict[str, Any] = {"experiments": {"here": {"seeds": 3}}}
    workspace.change_all(params, {"experiments.gone.seeds": 4, "experiments.here.seeds": 5})
    assert params == {"experiments": {"here": {"seeds": 5}}}


def test_what_is_dropped_goes_from_every_list() -> None:
    params: dict[str, Any] = {"initializers": {"es": {}, "rs": {}}, "plots": {"listed": ["es", "rs", 3]}, "k": ["es"]}
    workspace.change_all(params, {"initializers.es": workspace.DROP})
    assert params == {"initializers": {"rs": {}}, "plots": {"listed": ["rs", 3]}, "k": []}


def test_the_headline_has_a_part_for_each_experiment(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    metrics = {"immediate_mrr_star": {"all": {"es": 71.25}, "novel": {"es": 60.0}}}
    other = {"immediate_mrr_star": {"all": {"rs": 50.0}, "novel": {}}}
    (tmp_path / "metrics.json").write_text(json.dumps({**metrics, "graph": {"entities": 3}, "elsewhere": other}))
    headline.main(tmp_path)
    printed = capsys.readouterr().out
    lines = [line.split() for line in printed.splitlines() if line]
    assert ["es", "71.25", "60.00"] in lines
    assert lines.index(["rs", "50.00"]) > next(place for place, line in enumerate(lines) if line[0] == "elsewhere")
    assert printed.rstrip().endswith("index.html")


def test_progress_counts_what_runs_and_what_is_skipped() -> None:
    progress = repro.Progress(["mine", "train", "report"], {"mine": 1.0, "train": 60.0, "report": 120.0})
    printed = []
    for line in (
        "Stage 'mine' didn't change, skipping",
        "Running stage 'train':",
        "> exec python",
        "Running stage 'report':",
    ):
        if match := repro.BEGINS.match(line):
            printed.append(progress.begin(match["stage"] or match["same"], bool(match["stage"])))
    assert printed == [
        None,
        "[2 of 3; 0 min gone; at most about 3 min left]",
        "[3 of 3; 0 min gone; at most about 2 min left]",
    ]
    assert progress.seconds["train"] < 60  # as it took here


def test_the_second_way_of_computing_shares_no_code_with_the_library() -> None:
    """Nor with the tools around it."""
    listed = {"verify": {"tools.recomputed"}, "recomputed": set()}
    for name, allowed in listed.items():
        nodes = list(ast.walk(ast.parse((ROOT / f"tools/{name}.py").read_text(encoding="utf-8"))))
        imported = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
        imported |= {str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)}
        assert {module for module in imported if module.split(".")[0] in ("isi", "stages", "tools", "tests")} == allowed
        assert not {module.split(".")[0] for module in imported} & {"torch", "pandas", "importlib"}


@pytest.mark.parametrize(
    ("line", "stage", "runs"),
    [
        ("Running stage 'train_joint@published':", "train_joint@published", True),
        ("Running stage 'beyond/dvc.yaml:vary@insert_triples_0':", "vary@insert_triples_0", True),
        ("Stage 'mine@ai2thor' didn't change, skipping", "mine@ai2thor", False),
        ("Stage 'beyond/dvc.yaml:vary@insert_triples_0' didn't change, skipping", "vary@insert_triples_0", False),
        (
            "Stage 'beyond/dvc.yaml:vary@insert_triples_0' is cached - skipping run, checking out outputs",
            "vary@insert_triples_0",
            False,
        ),
        ("> exec python -m stages.vary insert_triples_0", None, None),
        ("Updating lock file 'beyond/dvc.lock'", None, None),
    ],
)
def test_what_dvc_says_names_a_stage_of_either_pipeline(line: str, stage: str | None, runs: bool | None) -> None:
    match = repro.BEGINS.match(line)
    assert (match and (match["stage"] or match["same"])) == stage
    assert (match and bool(match["stage"])) == runs


#: As DVC writes it.
LOCK = """schema: '2.0'
stages:
  mine@here:
    cmd: mine
    deps:
    - path: a
      hash: md5
      md5: d58d856d185b4819303cce492ad3cc65
      size: 4428
  report:
    cmd: report
"""


@pytest.mark.parametrize(
    ("before", "left", "whole"),
    [
        (LOCK, 0, False), (LOCK, 30, False), (LOCK, LOCK.index("  report"), False), (LOCK, len(LOCK), True),
        (None, 0, False), (None, 30, False), (None, len(LOCK), True),
    ],
)  # fmt: skip
def test_a_lock_file_that_was_cut_short_is_as_before_and_a_whole_one_stays(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    before: str | None,
    left: int,
    whole: bool,
) -> None:
    """Whoever is stopped while it is written, by whatever, and whether or not the run before could mend it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / ".dvc/tmp").mkdir(parents=True)
    path, now = tmp_path / "dvc.lock", LOCK.replace("4428", "4429")
    if before:
        path.write_text(before, encoding="utf-8")
    repro.LockFile(Path("dvc.lock")).back_up()
    path.write_text(now[:left], encoding="utf-8")
    for _ in range(2):
        repro.LockFile(Path("dvc.lock")).mend()
        expected = now[:left] if whole else before
        assert (path.read_text(encoding="utf-8") if path.exists() else None) == expected
    assert ("was cut short" in capsys.readouterr().out) is not whole
    assert not list((tmp_path / ".dvc/tmp").iterdir())


@pytest.mark.parametrize(
    ("notes", "stay"), [("", False), ('{"read": {"a', False), ("{}", True), ('{"read": {}}', True)]
)
def test_notes_of_dvc_that_were_cut_short_go(tmp_path: Path, notes: str, stay: bool) -> None:
    path = tmp_path / "rwlock"
    path.write_text(notes, encoding="utf-8")
    repro.mend_notes(path)
    assert (path.read_text(encoding="utf-8") if path.exists() else None) == (notes if stay else None)
    repro.mend_notes(tmp_path / "none")


def test_stages_are_read_from_the_lock_of_their_pipeline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    lock = "schema: '2.0'\nstages:\n  mine@here:\n    cmd: mine\n    deps:\n    - path: a\n  report:\n    cmd: report\n"
    (tmp_path / "dvc.lock").write_text(lock)
    (tmp_path / "beyond").mkdir()
    (tmp_path / "beyond/dvc.lock").write_text("schema: '2.0'\nstages:\n  vary@insert_triples_0:\n    cmd: vary\n")
    assert [repro.stages(pipeline) for pipeline in repro.PIPELINES] == [
        ["mine@here", "report"],
        ["vary@insert_triples_0"],
    ]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, ""),
        ({"mrr": [0.5, 0.25]}, "columns mrr"),
        ({"extra": [1, 2]}, "only in one: extra"),
        ({"seed": [0]}, "2 rows against 1"),
    ],
)
def test_tables_are_compared_by_their_values(tmp_path: Path, change: dict[str, Any], expected: str) -> None:
    columns: dict[str, Any] = {"seed": [0, 1], "mrr": [0.5, 0.75]}
    pd.DataFrame(columns).to_parquet(tmp_path / "one.parquet")
    changed = {name: values[: len(change.get("seed", [0, 1]))] for name, values in (columns | change).items()}
    pd.DataFrame(changed).astype({"seed": "int64"}).to_parquet(tmp_path / "other.parquet", compression="zstd")
    assert compare.difference(tmp_path / "one.parquet", tmp_path / "other.parquet") == expected
