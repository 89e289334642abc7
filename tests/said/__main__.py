"""Put what is said, and why, into docs/benchmarks/said.md and said_by_commands.md: ``python -m tests.said``."""

from __future__ import annotations

from pathlib import Path

from tests.said.every import CASES
from tests.said.typed import CALLS, PROGRAMS

BENCHMARKS = Path(__file__).parents[2] / "docs" / "benchmarks"
#: What readers say of files, and what commands and the library's calls say of what they are given.
TABLE, BY_COMMANDS = BENCHMARKS / "said.md", BENCHMARKS / "said_by_commands.md"


def table() -> str:
    """A row for each mistake."""
    rows = [
        f"| {group} | {case.what} | {case.said.replace('|', '&#124;')} |"
        for group, cases in CASES.items()
        for case in cases
    ]
    return "\n".join(["| read as | what went wrong | what is said |", "| --- | --- | --- |", *rows, ""])


def by_commands() -> str:
    """A row for each mistake of what is typed, or called."""
    listed = [(f"`{one.name}`", case.what, one.says + case.said) for one in PROGRAMS for case in one.cases]
    listed += [(f"`{name}`", case.what, case.said) for name, cases in CALLS.items() for case in cases]
    cells = ([cell.replace("|", "&#124;").replace("<", "&lt;") for cell in row] for row in listed)
    rows = [f"| {' | '.join(row)} |" for row in cells]
    return "\n".join(["| what is called | what went wrong | what is said |", "| --- | --- | --- |", *rows, ""])


if __name__ == "__main__":
    BY_COMMANDS.write_text(by_commands(), encoding="utf-8")
    TABLE.write_text(table(), encoding="utf-8")
