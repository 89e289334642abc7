"""Update the README and the pages of docs/: tables, numbers within sentences, and output of commands.

A table is inserted between ``<!-- table: PATH -->`` and ``<!-- end -->``. A number is inserted between
``<!-- value: PATH | CELL ... | COLUMN -->`` and ``<!-- end -->``: from the table at PATH, in the row that starts with
these cells, without its interval; or, after ``<!-- value: params | KEY -->``, from ``params.yaml``. A PATH is relative
to the root and has no suffix ``.md``.

python -m tools.docs            update tables and numbers (``make readme``)
python -m tools.docs PAGE ...   run the commands of pages and update their output (``make console``), in a temporary
                                folder with the pipeline's ``data``; needs the extra ``words``
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from isi.config import read, value_of
from isi.process import errors_in_one_line

if TYPE_CHECKING:
    import pandas as pd

ROOT = Path(__file__).parent.parent
BENCHMARKS = ROOT / "docs" / "benchmarks"
PLACE = re.compile(r"(<!-- (table|value): ([^>]+?) -->)(.*?)(<!-- end -->)", re.DOTALL)
BLOCK = re.compile(r"(?<=^```console\n)(.*?)(?=^```)", re.DOTALL | re.MULTILINE)
COMMAND = re.compile(r"^\$ (isi .*)\n((?:[^$\n].*\n)*)", re.MULTILINE)


def pages(root: Path = ROOT) -> list[Path]:
    """The documents that may have marked places."""
    return [
        root / "README.md",
        *sorted((root / "docs").glob("*.md")),
        *sorted((root / "docs" / "you-have").glob("*.md")),
    ]


def filled(page: str, root: Path = ROOT) -> str:
    """The text of a page with the current table or number in every marked place.

    Raises:
        LookupError: if a table lacks the row or column of a number.
    """

    def fill(place: re.Match[str]) -> str:
        begin, kind, path, _, end = place.groups()
        content = "\n" + (root / f"{path}.md").read_text("utf-8") if kind == "table" else value(path.split(" | "), root)
        return begin + content + end

    return PLACE.sub(fill, page)


def value(path: list[str], root: Path = ROOT) -> str:
    """The text of the number at PATH | CELL ... | COLUMN, or at params | KEY."""
    name, *cells = path
    if name == "params":
        return str(value_of(read(root / "params.yaml"), cells[0]))
    lines = (root / f"{name}.md").read_text(encoding="utf-8").splitlines()
    head, _, *body = ([cell.strip() for cell in line.split("|")[1:-1]] for line in lines)
    rows = [row for row in body if row[: len(cells) - 1] == cells[:-1]]
    if len(rows) != 1 or cells[-1] not in head:
        raise LookupError(f"{' | '.join(path)}: expected one row, got {len(rows)}; the columns are {', '.join(head)}")
    return rows[0][head.index(cells[-1])].partition(" [")[0]


def with_output(page: str, folder: Path) -> str:
    """The text of a page with new output below commands that have output; all commands run in ``folder``, in order.

    Raises:
        subprocess.CalledProcessError: if a command fails.
    """

    def run(command: re.Match[str]) -> str:
        line, before = command.groups()
        arguments = [sys.executable, "-m", "isi", *shlex.split(line)[1:]]
        printed = subprocess.run(arguments, cwd=folder, check=True, capture_output=True, text=True).stdout
        return f"$ {line}\n{printed if before else ''}"

    return BLOCK.sub(lambda block: COMMAND.sub(run, block[1]), page)


def write_table(path: Path, table: pd.DataFrame, left: int | None = None, behind: str = "") -> None:
    """Print a table; write it in Markdown, followed by the text ``behind``. The first ``left`` columns align left."""
    align = None if left is None else ["left"] * left + ["right"] * (table.shape[1] - left)
    text = table.astype(str).to_markdown(index=False, disable_numparse=True, colalign=align) + "\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text + behind, encoding="utf-8")
    print(text)


def main(named: list[str]) -> None:
    """Update the commands' output in the named pages; without names, the tables and numbers of all pages."""
    for page in map(Path, named) if named else pages():
        text = page.read_text(encoding="utf-8")
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "data").symlink_to(ROOT / "data")
            page.write_text(with_output(text, Path(folder)) if named else filled(text), encoding="utf-8")


if __name__ == "__main__":
    with errors_in_one_line("docs"):
        main(sys.argv[1:])
