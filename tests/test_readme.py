"""The README shows what the pipeline made, and nothing else."""

from __future__ import annotations

import re
from pathlib import Path

from tools import readme

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def test_its_tables_are_those_that_were_made() -> None:
    assert len(readme.PLACE.findall(TEXT)) >= 5
    assert readme.filled(TEXT) == TEXT


def test_its_links_lead_somewhere() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", TEXT)
    missing = [link for link in links if not link.startswith("https://") and not (ROOT / link).exists()]
    assert not missing
