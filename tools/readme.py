"""Put tables into the README, each between its ``<!-- table: NAME -->`` and the next ``<!-- end -->``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parent.parent
FOLDERS = (ROOT / "reports" / "tables", ROOT / "docs" / "benchmarks")
PLACE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def filled(readme: str, tables: Mapping[str, Path]) -> str:
    """The README with every marked table as its file has it."""
    return PLACE.sub(lambda place: place[1] + tables[place[2]].read_text("utf-8") + place[3], readme)


if __name__ == "__main__":
    path = ROOT / "README.md"
    tables = {file.stem: file for folder in FOLDERS for file in folder.glob("*.md")}
    path.write_text(filled(path.read_text("utf-8"), tables), encoding="utf-8")
