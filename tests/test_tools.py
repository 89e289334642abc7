"""The tools around the pipeline: what they say, and what they refuse."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import pytest
import yaml

from isi.params import load
from tools import repro, workspace

ROOT = Path(__file__).parent.parent


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


def test_what_is_dropped_goes_from_every_list() -> None:
    params: dict[str, Any] = {"initializers": {"es": {}, "rs": {}}, "plots": {"listed": ["es", "rs", 3]}, "k": ["es"]}
    workspace.change_all(params, {"initializers.es": workspace.DROP})
    assert params == {"initializers": {"rs": {}}, "plots": {"listed": ["rs", 3]}, "k": []}


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
