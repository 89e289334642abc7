"""Put tables into the README, between ``<!-- table: PATH -->`` (without ``.md``) and the next ``<!-- end -->``."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
PLACE = re.compile(r"(<!-- table: ([\w/]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def filled(readme: str) -> str:
    """The README with every marked table as its file has it."""
    return PLACE.sub(lambda place: place[1] + (ROOT / f"{place[2]}.md").read_text("utf-8") + place[3], readme)


if __name__ == "__main__":
    path = ROOT / "README.md"
    path.write_text(filled(path.read_text("utf-8")), encoding="utf-8")
