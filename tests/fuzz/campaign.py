"""Inputs by the thousand, format by format, and what became of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from hypothesis import HealthCheck, Phase, given, seed, settings

from tests.fuzz.formats import FORMATS
from tests.fuzz.giants import GIANTS
from tests.fuzz.mutations import Files, changed
from tests.fuzz.worker import Outcome, Worker


@dataclass
class Counts:
    """What became of the inputs of a format."""

    format: str
    read: int = 0
    refused: int = 0
    seconds: float = 0.0
    mib: int = 0
    #: files that were none of the two, and why
    faults: list[tuple[str, Files]] = field(default_factory=list)

    def add(self, files: Files, outcome: Outcome) -> None:
        self.read += outcome.kind == "read"
        self.refused += outcome.kind == "refused"
        if outcome.kind == "fault":
            self.faults.append((outcome.said, files))
        self.seconds, self.mib = max(self.seconds, outcome.seconds), max(self.mib, outcome.mib)

    @property
    def inputs(self) -> int:
        return self.read + self.refused + len(self.faults)


def tried(name: str, inputs: int, root: int, worker: Worker) -> Counts:
    """Change the files of a format as often, and read them."""
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


def of_format(name: str, inputs: int, root: int) -> Counts:
    """The same in a process of its own."""
    with Worker() as worker:
        return tried(name, inputs, root, worker)


def giants() -> Counts:
    """The largest and deepest files."""
    with Worker() as worker:
        return of_giants(worker, list(GIANTS))


def of_giants(worker: Worker, names: list[str]) -> Counts:
    counts = Counts("giants: a million objects, rows or levels")
    for name, outcome, files in _giants(worker, names):
        counts.add(files, outcome)
        if outcome.kind == "fault":
            said, _ = counts.faults.pop()
            counts.faults.append((f"{name}: {said}", {}))
    return counts


def _giants(worker: Worker, names: list[str]) -> Iterator[tuple[str, Outcome, Files]]:
    for name in names:
        form, make = GIANTS[name]
        files = FORMATS[form].files | make()
        yield name, worker.read(form, files), files
