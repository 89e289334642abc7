"""The code, the params and the commands that pages of docs/ show, for tests to run."""

import re
from pathlib import Path
from typing import Any

import yaml

DOCS = Path(__file__).parent.parent / "docs"
PAGE = DOCS / "extending.md"


def block(mark: str, language: str) -> str:
    """The text of the code block after ``<!-- mark -->`` in docs/extending.md."""
    _, there, rest = PAGE.read_text(encoding="utf-8").partition(f"<!-- {mark} -->\n```{language}\n")
    assert there, f"{PAGE.name} has no {mark}"
    return rest.partition("```")[0]


def code(mark: str) -> str:
    """The Python module after a mark."""
    return block(mark, "python")


def params(mark: str) -> dict[str, Any]:
    """The entries of params after a mark, by SECTION.NAME: ``{"sources.notebook": {...}}``."""
    return {
        f"{section}.{name}": value
        for section, entries in yaml.safe_load(block(mark, "yaml")).items()
        for name, value in entries.items()
    }


def blocks(page: str, language: str) -> list[str]:
    """The texts of all code blocks of a language on a page, in order."""
    return re.findall(
        rf"^```{language}\n(.*?)^```",
        (DOCS / page).read_text(encoding="utf-8"),
        re.DOTALL | re.MULTILINE,
    )
