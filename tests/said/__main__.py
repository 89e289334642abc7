"""Put what is said of files, and why, into docs/benchmarks/said.md: ``python -m tests.said``."""

from __future__ import annotations

from pathlib import Path

from tests.said.every import CASES

TABLE = Path(__file__).parents[2] / "docs" / "benchmarks" / "said.md"


def table() -> str:
    """A row for each mistake."""
    rows = [
        f"| {group} | {case.what} | {case.said.replace('|', '&#124;')} |"
        for group, cases in CASES.items()
        for case in cases
    ]
    return "\n".join(["| read as | what went wrong | what is said |", "| --- | --- | --- |", *rows, ""])


if __name__ == "__main__":
    TABLE.write_text(table(), encoding="utf-8")
