"""The modules of the project that a module imports at run time, directly or indirectly."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

PACKAGES = ("isi", "stages")
#: Packages that the library does without where only its dependencies are installed.
HEAVY = (
    "ai2thor",
    "dvc",
    "gensim",
    "matplotlib",
    "numba",
    "procthor",
    "pyarrow",
    "pykeen",
    "rdflib",
    "scipy",
)
#: Modules without effect on numbers, so that no stage depends on them: messages, process control,
#: what DVC's files say, the start of a stage, and params, which pass on values of sections (each is
#: defined beside the code that uses it).
PLUMBING = {
    *(Path("isi", f"{name}.py") for name in ("__init__", "errors", "process")),
    *(Path("stages", f"{name}.py") for name in ("__init__", "pipeline", "stage", "params")),
}


def closure(*paths: Path) -> set[Path]:
    """The project's files that an import of ``paths`` loads, including ``paths``,
    without ``PLUMBING`` and plug-ins.
    """
    files: set[Path] = set()
    waiting = list(paths)
    while waiting:
        current = waiting.pop()
        if current not in files | PLUMBING:
            files.add(current)
            waiting += _loads(current)
    return files


@cache
def _loads(path: Path) -> list[Path]:
    return [
        file
        for name in [".".join(path.with_suffix("").parts), *imported(path)]
        for file in _files(name)
    ]


def imported(path: Path) -> list[str]:
    names = []
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for_types = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
    ]
    skipped = {inner for node in for_types for inner in ast.walk(node)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import) and node not in skipped:
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and node not in skipped:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return [name for name in names if name.split(".")[0] in PACKAGES]


def _files(name: str) -> list[Path]:
    parts = name.split(".")
    files = [Path(*parts[:depth], "__init__.py") for depth in range(1, len(parts) + 1)]
    return [file for file in [*files, Path(*parts).with_suffix(".py")] if file.is_file()]
