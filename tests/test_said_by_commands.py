"""What a user meets who types something wrong, or gives the library something wrong: one line, to the letter."""

from __future__ import annotations

import shutil
import sys
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import pytest

from isi.initializers.api import INITIALIZERS
from isi.models.model import MODELS
from isi.sources import SOURCES
from tests.said.__main__ import BY_COMMANDS, TABLE, by_commands
from tests.said.calls import ROOT, Called, Program, Typed, lay_out
from tests.said.pieces import EXCEPT, long_pieces
from tests.said.running import files, line_of, message_of
from tests.said.typed import CALLS, PROGRAMS

TYPED = [
    pytest.param(program, case, id=f"{program.name}: {case.what}") for program in PROGRAMS for case in program.cases
]
CALLED = [pytest.param(name, case, id=f"{name}: {case.what}") for name, cases in CALLS.items() for case in cases]


@pytest.fixture(scope="module")
def laid_out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lay_out(tmp_path_factory.mktemp("said") / "folder")


@pytest.fixture(autouse=True)
def _as_it_ships(monkeypatch: pytest.MonkeyPatch) -> None:
    """Messages list what there is: not what other tests have registered."""
    for plugins in (MODELS, INITIALIZERS, SOURCES):
        modules = {module.name for module in iter_modules(import_module(plugins.package).__path__)}
        for name in plugins._registered.keys() - modules:
            monkeypatch.delitem(plugins._registered, name)


@pytest.mark.parametrize(("program", "case"), TYPED)
def test_a_mistake_in_what_is_typed_is_told_in_one_line_and_nothing_is_written(
    laid_out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: Program, case: Typed
) -> None:
    if case.needs:
        pytest.importorskip(case.needs)
    shutil.copytree(laid_out, tmp_path / "folder", symlinks=True)
    monkeypatch.chdir(tmp_path / "folder")
    monkeypatch.delenv("DISPLAY", raising=False)
    case.before()
    before = files()
    line, status, printed = line_of(program, case)
    assert (line, status, printed) == (program.says + case.said, case.status, "")
    assert len(line) < 300
    assert line.isprintable()
    assert files() == before


@pytest.mark.parametrize(("name", "case"), CALLED)
def test_a_mistake_in_an_argument_is_told_in_one_line(name: str, case: Called) -> None:
    if "pykeen" in name:
        pytest.importorskip("pykeen")
    said = message_of(name, case.arguments)
    assert said == case.said
    assert len(said) < 300
    assert said.isprintable()


def test_without_pykeen_it_is_said_how_to_have_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("isi.pykeen")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pykeen", None)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ImportError, match=r"^isi\.pykeen needs PyKEEN: pip install pykeen$"):
        __import__("isi.pykeen")
    (program,) = [one for one in PROGRAMS if one.name == "isi import"]
    (case,) = [one for one in program.cases if one.what == "a pickle that is none"]
    case.before()
    line, status, _ = line_of(program, case)
    assert line == "isi import: theirs/trained_model.pkl: needs PyKEEN to be read: pip install pykeen"
    assert status == 1


# The list is whole


def test_what_the_documentation_lists_is_what_is_said() -> None:
    """After a change: ``python -m tests.said``, then ``make readme``."""
    assert BY_COMMANDS.read_text(encoding="utf-8") == by_commands()


def test_the_documentation_has_every_message() -> None:
    """Each constant piece of a message that the code raises stands in docs/trust.md, or has a reason not to."""
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "docs/trust.md", TABLE, BY_COMMANDS)]
    assert all(f"<!-- table: docs/benchmarks/{path.stem} -->" in texts[0] for path in (TABLE, BY_COMMANDS))
    page = " ".join(" ".join(texts).replace("&#124;", "|").replace("&lt;", "<").split())
    modules = [path for room in ("isi", "stages", "tools") for path in sorted((ROOT / room).rglob("*.py"))]
    missing = {
        piece: str(path.relative_to(ROOT)) for path in modules for piece in long_pieces(path) if piece not in page
    }
    assert set(missing) - set(EXCEPT) == set(), missing
    assert set(EXCEPT) <= set(missing), "no exception any more"
