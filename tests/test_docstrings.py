"""The examples in docstrings: all public names have one, and it prints what it says."""

import importlib
import inspect
import re
from collections.abc import Iterator
from doctest import DocTestFinder, DocTestRunner
from pathlib import Path
from typing import Any

import pytest

import isi
from isi.home.home import Home
from isi.home.questions import Questions

API = Path(__file__).parent.parent / "docs/api.md"
#: May have no example: data that a caller only reads, and what shows nothing.
NO_EXAMPLE = {
    "isi.benchmark.evaluation.Evaluation",
    "isi.errors.InputError",
    "isi.initializers.api.InitResult",
    "isi.initializers.context.InitContext",
    "isi.initializers.context.NewRows",
    "isi.insertion.api.insert",
    "isi.insertion.interference.Interference",
    "isi.insertion.request.InsertRequest",
    "isi.insertion.result.Details",
    "isi.insertion.result.Entity",
    "isi.insertion.result.Inserted",
    "isi.insertion.selection.Selection",
    "isi.home.changes.Change",
    "isi.home.changes.Effect",
    "isi.home.facts.StoredFact",
    *(
        f"isi.home.home.Home.{name}"
        for name in ("close", "folder", "now", "prepare", "train_again")
    ),
}


def public_names() -> Iterator[str]:
    """The objects on the page of the API, and the public methods of a home."""
    for name in re.findall(r"^::: (\S+)", API.read_text(encoding="utf-8"), re.MULTILINE):
        yield name
        if name.endswith(f".{Home.__name__}"):
            own = (
                method for method in [*vars(Questions), *vars(Home)] if not method.startswith("_")
            )
            yield from (f"{name}.{method}" for method in own)


def found(name: str) -> tuple[Any, dict[str, Any]]:
    """The object with a dotted name, and the globals of its module."""
    path, _, last = name.rpartition(".")
    try:
        module = importlib.import_module(path)
        return getattr(module, last), vars(module)
    except ModuleNotFoundError:
        owner, variables = found(path)
        return inspect.getattr_static(owner, last), variables


def printed(name: str, namespace: dict[str, Any]) -> int:
    """Run the example of an object, which may use names of its module; the number of its lines."""
    subject, variables = found(name)
    if isinstance(subject, property) or hasattr(subject, "func"):  # a cached one
        subject = getattr(subject, "fget", None) or subject.func
    finder, runner = DocTestFinder(recurse=False), DocTestRunner(verbose=False)
    tried = 0
    for example in finder.find(subject, name, globs={**variables, **namespace}):
        report = list[str]()
        outcome = runner.run(example, out=report.append, clear_globs=False)
        assert not outcome.failed, "".join(report)
        namespace.update(example.globs)
        tried += outcome.attempted
    return tried


@pytest.fixture(scope="module")
def shared() -> dict[str, Any]:
    """What the examples of a home and of PyKEEN share: names of the first ones."""
    names = dict[str, Any]()
    printed("isi.home.home.Home", names)
    pytest.importorskip("pykeen")
    printed("isi.pykeen.insertion.insert", names)
    return {name: names[name] for name in ("isi", "home", "model", "factory")}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.usefixtures("registries")
@pytest.mark.parametrize("name", list(public_names()))
def test_a_public_name_has_an_example_that_prints_what_it_says(
    name: str, shared: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    home = Home(shared["home"].base)
    assert printed(name, {**shared, "home": home}) or name in NO_EXAMPLE


def test_what_may_have_no_example_is_public() -> None:
    assert set(public_names()) >= NO_EXAMPLE
    assert set(isi.__all__) <= {name.rpartition(".")[2] for name in public_names()}
