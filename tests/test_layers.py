"""Imports form no circle, and the library imports nothing of the study.

All import statements count: at the top of a file, within a function, and for types alone.
"""

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parent.parent
DOOR = ROOT / "isi/__init__.py"  #: Names its modules as text, and imports them on first use.
PACKAGES = ("isi", "stages")
FILES = sorted({path for name in PACKAGES for path in (ROOT / name).rglob("*.py")} - {DOOR})


def file_of(name: str) -> Path | None:
    """The file of a module or package."""
    path = ROOT.joinpath(*name.split("."))
    files = [path.with_suffix(".py"), path / "__init__.py"]
    return next((file for file in files if file.is_file()), None)


def imported_by(file: Path) -> Iterator[Path]:
    """The files of both packages that a file imports."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        found: list[Path | None] = []
        if isinstance(node, ast.Import):
            found = [file_of(alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.module, f"{file}: a relative import"
            for alias in node.names:
                found.append(file_of(f"{node.module}.{alias.name}") or file_of(node.module))
        yield from (path for path in found if path in FILES)


IMPORTS = {file: set(imported_by(file)) for file in FILES}


def test_no_imports_form_a_circle() -> None:
    TopologicalSorter(IMPORTS).prepare()  # its error names the circle


def test_the_library_imports_nothing_of_the_study() -> None:
    library = [file for file in FILES if file.is_relative_to(ROOT / "isi")]
    of_study = [file for file in FILES if file.is_relative_to(ROOT / "stages")]
    assert not [file for file in library if IMPORTS[file] & set(of_study)]
