"""Put what was made into the README and the pages of docs/: tables, and numbers within sentences.

A table stands between ``<!-- table: PATH -->`` and ``<!-- end -->``. A number, in the same way, after
``<!-- value: PATH | CELL ... | COLUMN -->``: of the table at PATH, the column of the row that starts with these cells;
or after ``<!-- value: params | KEY -->``: of ``params.yaml``. Paths of tables go from the root and leave out ``.md``.
An interval behind a number stays in the table.
"""

from __future__ import annotations

import re
from pathlib import Path

from ruamel.yaml import YAML

ROOT = Path(__file__).parent.parent
PLACE = re.compile(r"(<!-- (table|value): ([^>]+?) -->)(.*?)(<!-- end -->)", re.DOTALL)


def pages(root: Path = ROOT) -> list[Path]:
    """The documents that have places to fill."""
    return [root / "README.md", *sorted((root / "docs").glob("*.md"))]


def filled(page: str, root: Path = ROOT) -> str:
    """A page with every marked place as it was made.

    Raises:
        LookupError: where a place names what is not there.
    """

    def fill(place: re.Match[str]) -> str:
        begin, kind, what, _, end = place.groups()
        content = f"\n{_text(root, what)}" if kind == "table" else value(what.split(" | "), root)
        return begin + content + end

    return PLACE.sub(fill, page)


def value(path: list[str], root: Path = ROOT) -> str:
    """What a place for a number names."""
    name, *cells = path
    if name == "params":
        found = YAML(typ="safe", pure=True).load((root / "params.yaml").read_text(encoding="utf-8"))
        for key in cells[0].split("."):
            found = found[key]
        return str(found)
    head, _, *body = ([cell.strip() for cell in line.split("|")[1:-1]] for line in _text(root, name).splitlines())
    rows = [row for row in body if row[: len(cells) - 1] == cells[:-1]]
    if len(rows) != 1 or cells[-1] not in head:
        raise LookupError(f"{' | '.join(path)}: {len(rows)} rows, columns {', '.join(head)}")
    return rows[0][head.index(cells[-1])].partition(" [")[0]


def _text(root: Path, table: str) -> str:
    return (root / f"{table}.md").read_text(encoding="utf-8")


if __name__ == "__main__":
    for page in pages():
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")
