"""The pipelines' description against their code: what stages import, read and were locked with, and are given."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import yaml

from isi.initializers.api import INITIALIZERS
from isi.models.model import MODELS
from isi.sources import SOURCES
from isi.stage import StageContext
from isi.tables import paths
from tests.imports import closure

ROOT = Path(__file__).parent.parent


def read(path: Path) -> dict[str, Any]:
    return dict(yaml.safe_load((ROOT / path).read_text(encoding="utf-8")))


FIRST: dict[str, dict[str, Any]] = read(paths.PIPELINE)["stages"]
BEYOND: dict[str, dict[str, Any]] = read(paths.BEYOND_PIPELINE)["stages"]
STAGES = FIRST | BEYOND
PARAMS, BEYOND_PARAMS = read(paths.PARAMS), read(paths.BEYOND_PARAMS)
PACKAGES = {plugins.package.replace(".", "/"): plugins for plugins in (MODELS, INITIALIZERS, SOURCES)}
#: What it offers to others is imported when it is asked for, which no stage does.
DOOR = Path("isi/__init__.py")
OPEN = re.compile(r"\$\{([^}]+)\}")
#: Where the options of plug-ins stand in params, and their package.
OPTIONS = {"families": "isi/families", "initializers": "isi/initializers", "sweep.initializers": "isi/initializers"}
ONE = re.compile(rf"({'|'.join(map(re.escape, OPTIONS))})\.(.+)")


@pytest.fixture(autouse=True)
def _in_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def fillings(dep: str) -> list[str]:
    """A dependency with the name of every plug-in of its package where it leaves one open."""
    package = dep.rpartition("/")[0]
    if not OPEN.search(dep) or package not in PACKAGES:
        return [dep]
    return [OPEN.sub(name, dep) for name in PACKAGES[package].names() if Path(package, f"{name}.py").is_file()]


def cases(name: str) -> Iterator[dict[str, str]]:
    """The arguments with which a pipeline runs a stage."""
    matrix = STAGES[name].get("matrix", {})
    listed = [list(at(OPEN.fullmatch(values)[1])) for values in matrix.values()]  # type: ignore[index]
    for items in product(*listed):
        yield dict(zip(matrix, items, strict=True))


def at(key: str) -> Any:
    """The value at a dotted key of the params of either pipeline, which must be there."""
    value: Any = PARAMS | BEYOND_PARAMS
    for part in key.split("."):
        value = value[part]
    return value


def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


# What dvc.yaml says


def own_values(given: StageContext) -> dict[str, object]:
    """Without those that change no result."""
    return {key: value for key, value in given.values.items() if key != "compute"}


def test_the_pipelines_share_no_stage_and_no_key_of_params() -> None:
    assert not set(FIRST) & set(BEYOND)
    assert not set(PARAMS) & set(BEYOND_PARAMS)


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_runs_in_the_folder_that_holds_the_code(name: str) -> None:
    folder = (paths.PIPELINE if name in FIRST else paths.BEYOND_PIPELINE).parent
    assert (ROOT / folder / STAGES[name].get("wdir", ".")).resolve() == ROOT
    shipped = [OPEN.sub("*", dep) for dep in STAGES[name]["deps"] if re.match("isi|stages|data/raw", dep)]
    assert not [pattern for pattern in shipped if not list(ROOT.glob(pattern))]


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_depends_on_every_module_that_it_imports_and_that_those_import(name: str) -> None:
    """Plug-ins, which are imported by name, among them: whichever a stage's dependencies leave open."""
    filled = [fillings(dep) for dep in STAGES[name]["deps"]]
    for number in range(max(map(len, filled))):
        listed = [Path(options[min(number, len(options) - 1)]) for options in filled]
        code = [path for path in listed if path.parts[0] in ("isi", "stages")]
        files = [file for path in code for file in (path.rglob("*.py") if path.is_dir() else [path])]
        assert Path(f"stages/{name}.py") in files
        missing = [path for path in closure(*files) if not any(path.is_relative_to(dep) for dep in code)]
        assert not [str(path) for path in missing if len(parsed(path).body) > 1 and path != DOOR]  # more than text


def test_the_door_of_the_package_imports_nothing_of_it_so_that_no_stage_depends_on_it() -> None:
    assert closure(DOOR) == {DOOR}


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_depends_on_the_plugins_whose_options_it_is_given_alone(name: str) -> None:
    deps, keys = STAGES[name]["deps"], [key for key in STAGES[name].get("params", []) if isinstance(key, str)]
    modules = {dep for dep in deps if dep.rpartition("/")[0] in PACKAGES and not dep.endswith("__init__.py")}
    of_one = {f"{OPTIONS[found[1]]}/{found[2]}.py" for key in keys if (found := ONE.fullmatch(key))}
    of_all = {OPTIONS[key] for key in keys if key in OPTIONS}
    assert of_one <= modules
    assert all(module in of_one or module.rpartition("/")[0] in of_all for module in modules)


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_is_called_by_its_arguments_and_takes_the_place_of_the_shell_that_starts_it(name: str) -> None:
    tops = parsed(Path(f"stages/{name}.py")).body
    (body,) = (node for node in tops if isinstance(node, ast.FunctionDef) and node.name == name)
    _given, *arguments = [argument.arg for argument in body.args.args]
    assert [*STAGES[name].get("matrix", {})] == arguments
    items = [f"${{item.{argument}}}" for argument in arguments]
    assert STAGES[name]["cmd"].split() == ["exec", "python", "-m", f"stages.{name}", *items]  # or it outlives DVC


@pytest.mark.parametrize("name", STAGES)
def test_outputs_persist_where_dvc_keeps_no_copy(name: str) -> None:
    for out in [*STAGES[name].get("outs", []), *STAGES[name].get("metrics", [])]:
        options = next(iter(out.values())) if isinstance(out, dict) else {}
        assert options.get("persist", False) is not options.get("cache", True)


def test_no_two_stages_write_the_same() -> None:
    written = [
        OPEN.sub(lambda part, items=items: items[part[1].removeprefix("item.")], out)
        for name in STAGES
        for items in cases(name)
        for out in STAGES[name].get("outs", [])
        if isinstance(out, str)
    ]
    assert len(set(written)) == len(written)
    assert all(path.startswith("data/") and not path.startswith("data/raw/") for path in written)


@pytest.mark.parametrize("stages", [FIRST, BEYOND], ids=["first", "beyond"])
def test_the_lock_has_the_stages_that_there_are(stages: dict[str, dict[str, Any]]) -> None:
    """DVC keeps those that are no more, and reads them all at every start."""
    lock = (paths.PIPELINE if stages is FIRST else paths.BEYOND_PIPELINE).with_name("dvc.lock")
    if stages is BEYOND and not lock.exists():
        pytest.skip("the second pipeline has not run")
    there = {"@".join(filter(None, [name, "-".join(items.values())])) for name in stages for items in cases(name)}
    assert set(read(lock)["stages"]) == there


def test_the_lock_fits_the_pipeline_and_the_params() -> None:
    ran = [path for path in (paths.PIPELINE, paths.BEYOND_PIPELINE) if path.with_name("dvc.lock").exists()]
    asked = [sys.executable, "-m", "dvc", "status", "--json", *map(str, ran)]
    status = json.loads(subprocess.run(asked, capture_output=True, text=True, check=True).stdout)
    changed = []
    for stage_name, parts in status.items():
        for part in parts:
            if part == "changed command":
                changed.append((stage_name, part))
                continue
            changed += [
                (stage_name, path) for path, state in part.get("changed deps", {}).items() if state != "deleted"
            ]
    assert not changed


def test_a_stage_without_the_packages_says_so_in_one_line() -> None:
    """As where DVC is another installation's, whose Python runs the stages."""
    ended = subprocess.run(
        [sys.executable, "-S", "-m", "stages.insert", "ai2thor", "es"],
        env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    (line,) = ended.stderr.splitlines()
    assert re.fullmatch(r"stages: \S+ lacks the packages of this project: .*make repro.*\.venv.*", line)
    assert ended.returncode == 1
    assert ended.stdout == ""
