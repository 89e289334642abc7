"""Which modules of the project a module imports, directly or through others."""

from __future__ import annotations

import ast
from pathlib import Path

PACKAGES = ("isi", "stages")


def closure(path: Path) -> set[Path]:
    """The project's files that importing a file loads, itself included."""
    found: set[Path] = set()
    waiting = [path]
    while waiting:
        current = waiting.pop()
        if current not in found:
            found.add(current)
            waiting += [
                file for name in [".".join(current.with_suffix("").parts), *_imported(current)] for file in _files(name)
            ]
    return found


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
