"""Imports between the modules of the package:
no circle, and none against the list in CONTRIBUTING.md.

All import statements count: at the top of a file, within a function, and for types alone.
"""

import ast
import re
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parent.parent
DOOR = ROOT / "isi/__init__.py"  #: Names its modules as text, and imports them on first use.
FILES = sorted(set((ROOT / "isi").rglob("*.py")) - {DOOR})
LIST = re.compile(r"further left in this list.*?```text\n(.*?)```", re.DOTALL)


def file_of(name: str) -> Path | None:
    """The file of a module or package."""
    path = ROOT.joinpath(*name.split("."))
    files = [path.with_suffix(".py"), path / "__init__.py"]
    return next((file for file in files if file.is_file()), None)


def imported_by(file: Path) -> Iterator[Path]:
    """The files of the package that a file imports."""
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


def layers() -> list[str]:
    """The list in CONTRIBUTING.md: packages, and modules apart from a package."""
    match = LIST.search((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
    assert match
    return match[1].split()


def layer_of(file: Path, listed: list[str]) -> int:
    """The place of a file in the list: its own, or else that of its package."""
    name = file.relative_to(ROOT / "isi").with_suffix("").as_posix()
    package = name.split("/")[0]
    return listed.index(name if name in listed else package)


def test_no_imports_form_a_circle() -> None:
    TopologicalSorter(IMPORTS).prepare()  # its error names the circle


def test_no_module_imports_what_is_listed_after_it() -> None:
    listed = layers()
    against = [
        (str(file.relative_to(ROOT)), str(other.relative_to(ROOT)))
        for file, imports in IMPORTS.items()
        for other in imports
        if layer_of(other, listed) > layer_of(file, listed)
    ]
    assert not against


def test_all_that_is_listed_exists() -> None:
    listed = layers()
    assert len(set(listed)) == len(listed)
    places = {layer_of(file, listed) for file in FILES}
    assert places == set(range(len(listed)))
