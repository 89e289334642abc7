"""A mistake in a command line, or in an argument of the library,
ends in one line that names its place.
"""

import contextlib
import io
import runpy
import shlex
import shutil
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

import isi
from isi.__main__ import main
from isi.errors import InputError
from isi.insertion.result import Inserted
from tests.mistakes import assert_names, commands, graphs, imports, of_pykeen, settings
from tests.mistakes.calls import Called, Typed, lay_out, listed
from tests.mistakes.folders import FOLDER_CASES
from tests.mistakes.imports import IMPORT_CASES
from tests.mistakes.library import INSERT_CASES, INTERFERENCE_CASES, REPORT_CASES, TRAIN_CASES
from tests.mistakes.of_pykeen import PYKEEN_CASES
from tests.small_bundle import write_lists
from tests.small_embedding import call

#: Mistakes in command lines by program.
PROGRAMS = listed(
    changed=commands.changed,
    of_another_build=settings.of_another_build,
    of_pipeline=commands.of_pipeline,
    own_files=commands.own_files,
    not_compressed=imports.not_compressed,
    of_pykeen=imports.of_pykeen,
    player=settings.player,
    texts=graphs.texts,
    with_tables=imports.with_tables(),
    without_a_scene=settings.without_a_scene,
    write_lists=write_lists,
)
PROGRAMS["isi"] += [
    *commands.COMMAND_CASES,
    *FOLDER_CASES,
    *IMPORT_CASES,
    *graphs.GRAPH_CASES,
]
#: By program: the beginning of its lines of refusal.
SAYS = {"isi": "isi", "stages.record": "record: ", "tools.headline": "headline: "}
TYPED = [
    pytest.param(module, case, id=f"{module}: {case.what}")
    for module, cases in PROGRAMS.items()
    for case in cases
]


@cache
def inserted() -> Inserted:
    return call()


#: By name: a function of the library, and mistakes in its arguments.
LIBRARY: dict[str, tuple[Callable[..., object], list[Called]]] = {
    "isi.insert": (call, INSERT_CASES),
    "Inserted.train": (lambda **given: inserted().train(**given), TRAIN_CASES),
    "Inserted.report": (lambda **given: inserted().report(**given), REPORT_CASES),
    "Inserted.interference": (lambda **given: inserted().interference(**given), INTERFERENCE_CASES),
    "isi.pykeen.insert": (
        lambda **given: isi.pykeen.insert(**{**of_pykeen.sound(), **given}),
        PYKEEN_CASES,
    ),
}
CALLED = [
    pytest.param(name, case, id=f"{name}: {case.what}")
    for name, (_, cases) in LIBRARY.items()
    for case in cases
]


def line_of(module: str, case: Typed) -> tuple[str, object, str]:
    """Run a command; returns its line on standard error, its exit status,
    and its standard output.
    """
    out, err = io.StringIO(), io.StringIO()
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        pytest.raises(SystemExit) as ended,
    ):
        _run(module, shlex.split(case.typed))
    status = ended.value.code
    # as for a program: the text goes to standard error, and the status is 1
    if isinstance(status, str):
        return status, 1, out.getvalue()
    return err.getvalue().removesuffix("\n"), status, out.getvalue()


def _run(module: str, arguments: list[str]) -> None:
    """Run a module in this process as ``python -m`` does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [module, *arguments])
        if module == "isi":
            main(arguments)
        else:
            runpy.run_module(module, run_name="__main__")


def files() -> dict[Path, bytes]:
    """The bytes of all files in the current folder, by path."""
    return {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def laid_out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lay_out(tmp_path_factory.mktemp("typed") / "folder")


@pytest.mark.parametrize(("module", "case"), TYPED)
def test_a_mistake_in_what_is_typed_ends_in_one_line_and_nothing_is_written(
    laid_out: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    module: str,
    case: Typed,
) -> None:
    shutil.copytree(laid_out, tmp_path / "folder", symlinks=True)
    monkeypatch.chdir(tmp_path / "folder")
    monkeypatch.delenv("DISPLAY", raising=False)
    case.before()
    before = files()
    line, status, printed = line_of(module, case)
    assert (line.startswith(SAYS.get(module, "")), status, printed) == (True, case.status, "")
    assert_names(line, case.names)
    assert files() == before


@pytest.mark.parametrize(("name", "case"), CALLED)
def test_a_mistake_in_an_argument_names_it_in_one_line(name: str, case: Called) -> None:
    if "pykeen" in name:
        pytest.importorskip("pykeen")
    with pytest.raises(InputError) as refused:
        LIBRARY[name][0](**(case.given() if callable(case.given) else case.given))
    assert_names(str(refused.value), case.names)


def test_without_pykeen_the_message_says_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in [name for name in sys.modules if name.startswith("isi.pykeen")]:
        monkeypatch.delitem(sys.modules, name)
    for name in ("pykeen", "pykeen.models"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError, match=r"isi-kge\[pykeen\]"):
        __import__("isi.pykeen")
