"""Put the report's tables into the README, between ``<!-- table: NAME -->`` and ``<!-- end -->``."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
PLACE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def filled(readme: str, tables: Path) -> str:
    """The README with every marked table as the report has it."""
    return PLACE.sub(lambda place: place[1] + (tables / f"{place[2]}.md").read_text("utf-8") + place[3], readme)


if __name__ == "__main__":
    path = ROOT / "README.md"
    path.write_text(filled(path.read_text("utf-8"), ROOT / "reports" / "tables"), encoding="utf-8")
