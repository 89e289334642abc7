"""Which modules of the project a module imports, directly or through others."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

PACKAGES = ("isi", "stages")


def closure(*paths: Path) -> set[Path]:
    """The project's files that importing some files loads, themselves included; plug-ins only where given."""
    found: set[Path] = set()
    waiting = list(paths)
    while waiting:
        current = waiting.pop()
        if current not in found:
            found.add(current)
            waiting += _loads(current)
    return found


@cache
def _loads(path: Path) -> list[Path]:
    return [file for name in [".".join(path.with_suffix("").parts), *_imported(path)] for file in _files(name)]


def _imported(path: Path) -> list[str]:
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return [name for name in names if name.split(".")[0] in PACKAGES]


def _files(name: str) -> list[Path]:
    parts = name.split(".")
    files = [Path(*parts[:depth], "__init__.py") for depth in range(1, len(parts) + 1)]
    return [file for file in [*files, Path(*parts).with_suffix(".py")] if file.is_file()]
