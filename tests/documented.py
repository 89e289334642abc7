"""The code and the params that docs/extending.md shows, for tests to run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

PAGE = Path(__file__).parent.parent / "docs" / "extending.md"


def block(mark: str, language: str) -> str:
    """What the fence behind ``<!-- mark -->`` holds."""
    _, found, rest = PAGE.read_text(encoding="utf-8").partition(f"<!-- {mark} -->\n```{language}\n")
    assert found, f"{PAGE.name} has no {mark}"
    return rest.partition("```")[0]


def code(mark: str) -> str:
    """A module of one's own."""
    return block(mark, "python")


def params(mark: str) -> dict[str, Any]:
    """Values by dotted key, as deep as the name of the thing: ``{"sources.notebook": {...}}``."""
    return {
        f"{section}.{name}": value
        for section, entries in yaml.safe_load(block(mark, "yaml")).items()
        for name, value in entries.items()
    }
