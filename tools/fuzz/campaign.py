"""Thousands of changed files by format, and the counts of their outcomes."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from hypothesis import HealthCheck, Phase, given, seed, settings

from tools.fuzz.formats import FORMATS
from tools.fuzz.giants import GIANTS
from tools.fuzz.mutations import Files, changed
from tools.fuzz.worker import Outcome, Worker


@dataclass
class Counts:
    """Counts of the outcomes for the inputs of a format."""

    format: str
    read: int = 0
    refused: int = 0
    seconds: float = 0.0
    mib: int = 0
    #: the problem and the files of inputs that were neither read nor refused
    faults: list[tuple[str, Files]] = field(default_factory=list)

    def add(self, files: Files, outcome: Outcome, case: str = "") -> None:
        self.read += outcome.kind == "read"
        self.refused += outcome.kind == "refused"
        if outcome.kind == "fault":
            self.faults.append((f"{case}{outcome.problem}", files))
        self.seconds, self.mib = max(self.seconds, outcome.seconds), max(self.mib, outcome.mib)

    @property
    def inputs(self) -> int:
        return self.read + self.refused + len(self.faults)

    def row(self) -> tuple[object, ...]:
        """The row of the table in docs/benchmarks/fuzz.csv."""
        faults = len(self.faults)
        return self.format, self.inputs, self.read, self.refused, faults, self.seconds, self.mib


def read_changed(name: str, inputs: int, root: int, worker: Worker) -> Counts:
    """Read ``inputs`` random changes of the files of a format."""
    counts = Counts(name)

    @seed(root)
    @settings(
        max_examples=inputs,
        database=None,
        phases=[Phase.generate],
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(changed(FORMATS[name].files))
    def attempt(files: Files) -> None:
        counts.add(files, worker.read(name, files))

    attempt()
    return counts


def try_format(name: str, inputs: int, root: int) -> Counts:
    """``read_changed`` with a new process for reading."""
    with Worker() as worker:
        return read_changed(name, inputs, root, worker)


def try_giants(names: Iterable[str] = tuple(GIANTS)) -> Counts:
    """Read the largest and deepest files; files of faults are not kept, since they are large."""
    counts = Counts("giants: a million objects, rows or levels")
    with Worker() as worker:
        for name in names:
            form, make = GIANTS[name]
            counts.add({}, worker.read(form, FORMATS[form].files | make()), f"{name}: ")
    return counts
