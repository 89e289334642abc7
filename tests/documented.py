"""The code, the params and the commands that pages of docs/ show, for tests to run."""

import re
from pathlib import Path
from typing import Any

import yaml

DOCS = Path(__file__).parent.parent / "docs"
PAGE = DOCS / "extending.md"


def block(mark: str, language: str) -> str:
    """What the fence behind ``<!-- mark -->`` holds."""
    _, there, rest = PAGE.read_text(encoding="utf-8").partition(f"<!-- {mark} -->\n```{language}\n")
    assert there, f"{PAGE.name} has no {mark}"
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


def blocks(page: str, language: str) -> list[str]:
    """What all fences of a language on a page hold, in their order."""
    return re.findall(
        rf"^```{language}\n(.*?)^```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )


def commands(page: str) -> list[str]:
    """Every command that a page shows at a prompt."""
    shown = "".join(blocks(page, "console"))
    return [line.removeprefix("$ ") for line in shown.splitlines() if line.startswith("$ ")]
