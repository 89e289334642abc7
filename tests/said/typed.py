"""All mistakes of commands and of the library's arguments, by what is called."""

from __future__ import annotations

from tests.said.calls import Called, Program
from tests.said.commands import ASK_CASES, EXPLAIN_CASES, INSERT_CASES, ISI_CASES, NEAREST_CASES
from tests.said.folders import FOLDER_CASES
from tests.said.graphs import CHECK_CASES, EXPORT_CASES, GRAPH_CASES
from tests.said.imports import IMPORT_CASES
from tests.said.library import FIT_CASES, INTERFERENCE_CASES, REPORT_CASES
from tests.said.library import INSERT_CASES as OF_INSERT
from tests.said.of_pykeen import PYKEEN_CASES
from tests.said.settings import HEADLINE_CASES, OTHER_CASES, PARAMS_CASES, RECORD_CASES, SOURCES_CASES

PROGRAMS = [
    Program("isi", "isi", "isi: ", ISI_CASES),
    Program("isi insert", "isi", "isi insert: ", INSERT_CASES),
    Program("isi ask", "isi", "isi ask: ", ASK_CASES),
    Program("isi nearest", "isi", "isi nearest: ", NEAREST_CASES),
    Program("isi explain", "isi", "isi explain: ", EXPLAIN_CASES),
    Program("any, of a broken folder", "isi", "isi nearest: home", FOLDER_CASES),
    Program("isi import", "isi", "isi import: ", IMPORT_CASES),
    Program("isi graph", "isi", "isi graph: ", GRAPH_CASES),
    Program("isi export", "isi", "isi export: ", EXPORT_CASES),
    Program("isi check", "isi", "isi check: ", CHECK_CASES),
    Program("make record", "stages.record", "record: ", RECORD_CASES),
    Program("make repro, of params", "tools.check_params", "", PARAMS_CASES),
    Program("make repro, at its end", "tools.headline", "headline: ", HEADLINE_CASES),
    Program("python -m tools.sources", "tools.sources", "", SOURCES_CASES),
    *(Program(f"python -m {name}", name, "", cases) for name, cases in OTHER_CASES.items()),
]
CALLS: dict[str, list[Called]] = {
    "isi.insert": OF_INSERT,
    "isi.fit_new": FIT_CASES,
    "Inserted.report": REPORT_CASES,
    "Inserted.interference": INTERFERENCE_CASES,
    "isi.pykeen.insert": PYKEEN_CASES,
}
