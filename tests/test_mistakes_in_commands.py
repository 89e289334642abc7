"""A mistake in what is typed, or in an argument of the library, ends in one line that names its place."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from tests.mistakes import assert_names
from tests.mistakes.calls import Called, Program, Typed, lay_out
from tests.mistakes.commands import ASK_CASES, EXPLAIN_CASES, INSERT_CASES, ISI_CASES, NEAREST_CASES
from tests.mistakes.folders import FOLDER_CASES
from tests.mistakes.graphs import EXPORT_CASES, GRAPH_CASES
from tests.mistakes.imports import IMPORT_CASES
from tests.mistakes.library import FIT_CASES, INTERFERENCE_CASES, REPORT_CASES
from tests.mistakes.library import INSERT_CASES as OF_INSERT
from tests.mistakes.of_pykeen import PYKEEN_CASES
from tests.mistakes.running import files, line_of, message_of
from tests.mistakes.settings import HEADLINE_CASES, OTHER_CASES, PARAMS_CASES, RECORD_CASES, SOURCES_CASES

ISI = [*ISI_CASES, *INSERT_CASES, *ASK_CASES, *NEAREST_CASES, *EXPLAIN_CASES, *FOLDER_CASES, *IMPORT_CASES,
       *GRAPH_CASES, *EXPORT_CASES]  # fmt: skip
PROGRAMS = [
    Program("isi", "isi", "isi", ISI),
    Program("make record", "stages.record", "record: ", RECORD_CASES),
    Program("make repro, of params", "isi.params", "", PARAMS_CASES),
    Program("make repro, at its end", "tools.headline", "headline: ", HEADLINE_CASES),
    Program("python -m tools.sources", "tools.sources", "", SOURCES_CASES),
    *(Program(f"python -m {name}", name, "", cases) for name, cases in OTHER_CASES.items()),
]
CALLS = {
    "isi.insert": OF_INSERT,
    "isi.fit_new": FIT_CASES,
    "Inserted.report": REPORT_CASES,
    "Inserted.interference": INTERFERENCE_CASES,
    "isi.pykeen.insert": PYKEEN_CASES,
}
TYPED = [
    pytest.param(program, case, id=f"{program.name}: {case.what}") for program in PROGRAMS for case in program.cases
]
CALLED = [pytest.param(name, case, id=f"{name}: {case.what}") for name, cases in CALLS.items() for case in cases]


@pytest.fixture(scope="module")
def laid_out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lay_out(tmp_path_factory.mktemp("typed") / "folder")


@pytest.mark.parametrize(("program", "case"), TYPED)
def test_a_mistake_in_what_is_typed_ends_in_one_line_and_nothing_is_written(
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
    assert (line.startswith(program.says), status, printed) == (True, case.status, "")
    assert_names(line, case.names)
    assert files() == before


@pytest.mark.parametrize(("name", "case"), CALLED)
def test_a_mistake_in_an_argument_names_it_in_one_line(name: str, case: Called) -> None:
    if "pykeen" in name:
        pytest.importorskip("pykeen")
    assert_names(message_of(name, case.arguments), case.names)


def test_without_pykeen_the_message_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("isi.pykeen")]:
        monkeypatch.delitem(sys.modules, name)
    for name in ("pykeen", "pykeen.models"):
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ImportError, match="pip install pykeen"):
        __import__("isi.pykeen")
    (case,) = [case for case in IMPORT_CASES if case.what == "a pickle that is none"]
    case.before()
    line, status, _ = line_of(PROGRAMS[0], case)
    assert_names(line, "trained_model.pkl|pip install pykeen")
    assert status == 1
