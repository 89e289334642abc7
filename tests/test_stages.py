"""The pipelines' descriptions against the code:
imports, params, locks and arguments of every stage.
"""

import ast
import operator
import re
from collections.abc import Iterator
from functools import reduce
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import yaml
from dvc.repo import Repo

from isi.tables import paths
from stages.pipeline import BEYOND_PARAMS, BEYOND_PIPELINE, PIPELINE
from tests import committed
from tests.imports import PLUMBING, closure, imported
from tests.listed_params import listed

ROOT = Path(__file__).parent.parent


def read(path: Path) -> dict[str, Any]:
    return dict(yaml.safe_load((ROOT / path).read_text(encoding="utf-8")))


FIRST: dict[str, dict[str, Any]] = read(PIPELINE)["stages"]
BEYOND: dict[str, dict[str, Any]] = read(BEYOND_PIPELINE)["stages"]
PIPELINES = {
    PIPELINE: FIRST,
    BEYOND_PIPELINE: BEYOND,
}
STAGES = FIRST | BEYOND
PARAMS = read(paths.PARAMS) | read(BEYOND_PARAMS)
LOCKS = [path.with_name("dvc.lock") for path in PIPELINES]
OPEN = re.compile(r"\$\{([^}]+)\}")
#: Packages whose modules are imported by name, and the params that name them.
PLUGINS = {"isi/models": "models", "isi/initializers": "initializers", "isi/sources": "sources"}
#: Stages on which all other results depend.
MAKING = (
    "mine",
    "build_graph",
    "embed_words",
    "make_sessions",
    "train_theta0",
    "train_joint",
    "insert",
)
#: Code that changes for other reasons: messages, the command, the page, tables that only the report
#: reads.
APART = (
    "isi/errors.py",
    "isi/process.py",
    "isi/cli",
    "isi/home",
    "isi/insertion",
    "isi/pykeen",
    "stages/check_params.py",
    "stages/report",
)


@pytest.fixture(autouse=True)
def _in_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def cases(name: str) -> Iterator[dict[str, str]]:
    """The arguments with which a pipeline runs a stage."""
    matrix = STAGES[name].get("matrix", {})
    listed = [list(at(OPEN.fullmatch(values)[1])) for values in matrix.values()]  # type: ignore[index]
    for items in product(*listed):
        yield dict(zip(matrix, items, strict=True))


def at(key: str) -> Any:
    """The value at a dotted key of any pipeline's params; the key must exist."""
    return reduce(operator.getitem, key.split("."), PARAMS)


def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


# What dvc.yaml says


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_runs_in_the_folder_that_holds_the_code(name: str) -> None:
    (folder,) = (path.parent for path, stages in PIPELINES.items() if name in stages)
    assert (ROOT / folder / STAGES[name].get("wdir", ".")).resolve() == ROOT
    shipped = [
        OPEN.sub("*", dep) for dep in STAGES[name]["deps"] if re.match("isi|stages|data/raw", dep)
    ]
    assert not [pattern for pattern in shipped if not list(ROOT.glob(pattern))]


def file_of(name: str) -> Path:
    """The file of a stage."""
    package = Path(f"stages/{name}/__main__.py")
    return package if (ROOT / package).exists() else Path(f"stages/{name}.py")


def code_of(name: str) -> list[Path]:
    """The files of code that a stage depends on."""
    return [Path(dep) for dep in STAGES[name]["deps"] if dep.split("/")[0] in ("isi", "stages")]


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_depends_on_every_module_that_it_imports_and_on_packages_whose_modules_params_name(
    name: str,
) -> None:
    """Indirect imports count, too."""
    files, depended = closure(file_of(name)), code_of(name)
    keys = [key.split(".")[0] for key in STAGES[name].get("params", []) if isinstance(key, str)]
    for package, key in PLUGINS.items():
        if (key in keys and Path(package, "__init__.py") in files) or name == "explore":
            assert Path(package) in depended
            files = files | closure(*Path(package).rglob("*.py"))
    if name.startswith("tables"):
        files = files | closure(*Path("stages/report/tables").glob("*.py"))
    missing = [file for file in files if not any(file.is_relative_to(dep) for dep in depended)]
    starting = Path("stages/__init__.py")
    # more than text
    assert not [str(file) for file in missing if len(parsed(file).body) > 1 and file != starting]


@pytest.mark.parametrize("name", STAGES)
def test_no_stage_depends_on_what_changes_for_other_reasons(name: str) -> None:
    """Messages, the command, the page (but for the stages that make it), and, for training and
    insertion, tables that only the report reads.
    """
    apart = {*PLUMBING, Path("isi/cli")}
    if name in MAKING:
        apart |= set(map(Path, APART))
        apart |= {file_of(other) for other in STAGES if other not in MAKING}
    if name.startswith("report"):
        apart |= {
            Path("isi/home"),
            Path("isi/pykeen"),
            Path("isi/initializers"),
            Path("isi/sources"),
        }
    elif name.startswith("tables"):
        apart |= {Path("stages/report/page.py"), Path("stages/report/templates")}
    else:
        apart.add(Path("stages/report"))
    assert not [
        dep
        for dep in code_of(name)
        for path in apart
        if path.is_relative_to(dep) or dep.is_relative_to(path)
    ]


def test_the_door_of_the_package_imports_nothing_of_it() -> None:
    assert not [name for name in imported(Path("isi/__init__.py")) if name.startswith("isi.")]


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_lists_params_that_there_are_and_none_that_change_no_result(name: str) -> None:
    for names in cases(name):
        for keys in listed(name, names).values():
            for key in keys:
                at(key)
                assert not key.startswith("compute")


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_is_called_by_its_arguments_and_takes_the_place_of_the_shell_that_starts_it(
    name: str,
) -> None:
    tops = parsed(file_of(name)).body
    (body,) = (node for node in tops if isinstance(node, ast.FunctionDef) and node.name == name)
    arguments = [argument.arg for argument in body.args.args][1:]
    assert [*STAGES[name].get("matrix", {})] == arguments
    items = [f"${{item.{argument}}}" for argument in arguments]
    # or it outlives DVC
    assert STAGES[name]["cmd"].split() == ["exec", "python", "-m", f"stages.{name}", *items]


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


@pytest.mark.parametrize("pipeline", PIPELINES, ids=str)
def test_the_lock_has_the_stages_that_there_are(pipeline: Path) -> None:
    """DVC keeps entries of removed stages in the lock, and parses them at every start."""
    lock, stages = pipeline.with_name("dvc.lock"), PIPELINES[pipeline]
    if not (ROOT / lock).exists():
        pytest.skip("the pipeline has not run")
    there = {
        "@".join(filter(None, [name, "-".join(items.values())]))
        for name in stages
        for items in cases(name)
    }
    ran = set(read(lock)["stages"])
    # of the second pipeline, what has run with the code of now may be a part
    assert ran == there if pipeline.parent == Path() else ran <= there


def test_the_lock_fits_the_code_and_the_params() -> None:
    """Files that stages make are left out: a run on this machine may have changed them. The second
    pipeline runs for hours: its lock says with which code it ran.
    """
    if not Path("dvc.lock").exists():
        pytest.skip("the pipeline has not run")
    with Repo(str(ROOT), config={"core": {"no_scm": True}}) as repo:  # DVC then needs no git
        status = repo.status(["dvc.yaml"])
    changed = []
    for stage_name, parts in status.items():
        for part in parts:
            deps = {part: ""} if part == "changed command" else part.get("changed deps", {})
            changed += [(stage_name, path) for path in deps if not is_made(path)]
    assert not changed, "make repro"


@pytest.mark.parametrize("path", LOCKS, ids=str)
def test_every_path_has_one_content_in_a_committed_lock(path: Path) -> None:
    """What a stage read is what another made."""
    if not path.exists():
        pytest.skip("the pipeline has not run")
    contents: dict[str, set[str]] = {}
    for stage in yaml.load(committed.text_of(path), yaml.CSafeLoader)["stages"].values():
        for item in [*stage["deps"], *stage["outs"]]:
            contents.setdefault(item["path"], set()).add(item["md5"])
    made = {name: digests for name, digests in contents.items() if is_made(name)}
    assert made
    assert not [name for name, digests in made.items() if len(digests) > 1]


def is_made(path: str) -> bool:
    """Whether stages make the file or folder."""
    return path.startswith("data/") and not path.startswith("data/raw")
