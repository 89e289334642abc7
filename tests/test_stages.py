"""The pipeline's description against its code: what stages import, read and were locked with."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.imports import closure

ROOT = Path(__file__).parent.parent
STAGES: dict[str, dict[str, Any]] = yaml.safe_load((ROOT / "dvc.yaml").read_text(encoding="utf-8"))["stages"]


@pytest.fixture(autouse=True)
def _in_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_depends_on_every_module_that_it_imports(name: str) -> None:
    imported = {str(path) for path in closure(Path(f"stages/{name}.py"))}
    listed = [Path(dep) for dep in STAGES[name]["deps"]]
    missing = [path for path in imported if not any(Path(path).is_relative_to(dep) for dep in listed)]
    assert not missing


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_lists_the_params_that_shape_its_outputs(name: str) -> None:
    declared = {key.replace("${item.", "{") for key in STAGES[name].get("params", [])}
    stage = getattr(importlib.import_module(f"stages.{name}"), name)
    assert declared == set(stage.keys)
    assert not any(key.startswith("compute") for key in declared)


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_takes_the_place_of_the_shell_that_starts_it(name: str) -> None:
    assert STAGES[name]["cmd"].startswith(f"exec python -m stages.{name}")  # or it would outlive a killed DVC


@pytest.mark.parametrize("name", STAGES)
def test_outputs_persist(name: str) -> None:
    stage = STAGES[name]
    for out in [*stage.get("outs", []), *stage.get("metrics", [])]:
        (options,) = out.values()
        assert options["persist"] is True


def test_the_lock_fits_the_pipeline_and_the_params() -> None:
    asked = [sys.executable, "-m", "dvc", "status", "--json"]
    status = json.loads(subprocess.run(asked, capture_output=True, text=True, check=True).stdout)
    changed = []
    for stage, parts in status.items():
        for part in parts:
            if part == "changed command":
                changed.append((stage, part))
                continue
            changed += [(stage, path) for path, state in part.get("changed deps", {}).items() if state != "deleted"]
    assert not changed
