"""The outcomes of changed files of a format, and of the largest files."""

from dataclasses import replace

from hypothesis import HealthCheck, Phase, given, seed, settings

from tools.fuzz.changes import changed
from tools.fuzz.formats import FORMATS, Files
from tools.fuzz.giants import GIANTS, giant
from tools.fuzz.worker import Outcome, Worker

OF_GIANTS = "giants: a million objects, rows or levels"
GIANT_SECONDS = 20  #: Of processor time, for each of them.


def read_changed(name: str, inputs: int, root: int, worker: Worker) -> list[Outcome]:
    """The outcomes of ``inputs`` random changes of the files of a format."""
    outcomes = []

    @seed(root)
    @settings(
        max_examples=inputs,
        database=None,
        phases=[Phase.generate],
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(changed(FORMATS[name].files))
    def read(files: Files) -> None:
        outcomes.append(worker.read(FORMATS[name], files))

    read()
    return outcomes


def read_giant(title: str, worker: Worker) -> Outcome:
    """The outcome of a giant; its files are not kept."""
    name, files = giant(title)
    outcome = worker.read(FORMATS[name], files)
    return replace(outcome, problem=f"{title}: {outcome.problem}", files={})


def outcomes_of(name: str, inputs: int) -> list[Outcome]:
    """All outcomes of a row of the table, with a new process for reading."""
    if name == OF_GIANTS:
        with Worker(GIANT_SECONDS) as worker:
            return [read_giant(title, worker) for title in GIANTS]
    with Worker() as worker:
        return read_changed(name, inputs, 0, worker)
