"""Update the README and the pages of docs/:
tables, numbers within sentences, and output of commands.

A table (or a sentence) is inserted between ``<!-- table: PATH -->`` and ``<!-- end -->``; after
``<!-- table: PATH::COLUMN... -->``, these columns of it. A number
is inserted between ``<!-- value: PATH::CELL...::COLUMN -->`` and ``<!-- end -->``: from the table
at PATH, in the row that starts with these cells, without its interval; or, after
``<!-- value: params::KEY -->``, from ``params.yaml``. Outside of tables, `` | `` separates, too; in
a row of a table, a forge takes it for the end of a cell. A PATH is relative to the root and has no
suffix: ``.md``, or, where there is no such file, ``.csv``.

The output below a command, ``$ isi ...`` or ``$ sqlite3 FILE QUERY`` in a block of console, is what
it prints in a folder with ``data``, ``examples``, ``params.yaml`` and the files of the page: blocks
after ``<!-- file: PATH -->``. Where a line ``...`` stands for lines that are left out, as many
lines as before stay above and below it. If a page has ``<!-- console: NEED ... -->``, a test
compares its output with that of the present code, but for the last digits of numbers. A NEED is a
path below the root, which contains a slash, or an optional package, without which the test is
skipped.

python -m tools.docs            update tables and numbers (``make readme``)
python -m tools.docs PAGE ...   run the commands of pages and update their output (``make console``)
"""

from __future__ import annotations

import csv
import math
import os
import platform
import re
import shlex
import sqlite3
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime
from itertools import zip_longest
from pathlib import Path

import pandas as pd

from isi.config import read, value_of
from isi.process import errors_in_one_line
from tools.committed import ROOT, git

BENCHMARKS = ROOT / "docs" / "benchmarks"
PLACE = re.compile(r"(<!-- (table|value): ([^>]+?) -->)(.*?)(<!-- end -->)", re.DOTALL)
BLOCK = re.compile(r"(?<=^```console\n)(.*?)(?=^```)", re.DOTALL | re.MULTILINE)
COMMAND = re.compile(r"^\$ ((?:isi|sqlite3) .*)\n((?:[^$\n].*\n)*)", re.MULTILINE)
CHECKED = re.compile(r"^<!-- console:(.*)-->$", re.MULTILINE)
FILE = re.compile(r"^<!-- file: (\S+) -->\n```\w*\n(.*?)^```", re.DOTALL | re.MULTILINE)
SEPARATOR = re.compile(r"::| \| ")
NUMERIC = re.compile(r"[-+]?[\d,.]+( s| MB| %)?$")
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
#: Columns of ``runs.csv`` but that of the table.
RUN = ["date", "isi", "commit", "machine"]
#: Numbers in output that another type of processor may give.
CLOSE = {"rel_tol": 0.02, "abs_tol": 0.011}


def pages(root: Path = ROOT) -> list[Path]:
    """The documents that may have marked places."""
    return [root / "README.md", *sorted((root / "docs").glob("*.md"))]


def filled(page: str, root: Path = ROOT) -> str:
    """The text of a page with the current table, sentence or number in every marked place.

    Raises:
        LookupError: if a table lacks the row or column of a number, or a column to show.
    """

    def fill(place: re.Match[str]) -> str:
        begin, kind, path, _, end = place.groups()
        content = (
            "\n" + shown(*SEPARATOR.split(path), root=root)
            if kind == "table"
            else value(SEPARATOR.split(path), root)
        )
        return begin + content + end

    return PLACE.sub(fill, page)


def rows_of(name: str, root: Path = ROOT) -> list[list[str]]:
    """Header and rows of a table: a Markdown table, or, where there is none, a CSV file."""
    if (markdown := root / f"{name}.md").exists():
        head, _, *body = (
            line.split("|")[1:-1] for line in markdown.read_text(encoding="utf-8").splitlines()
        )
        return [[cell.strip() for cell in row] for row in (head, *body)]
    with (root / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def shown(name: str, *columns: str, root: Path = ROOT) -> str:
    """A file of Markdown as it stands; or the columns of a table, all of a CSV file without any,
    as a Markdown table with columns of numbers aligned right.

    Raises:
        LookupError: if the table lacks a column.
    """
    if not columns and (markdown := root / f"{name}.md").exists():
        return markdown.read_text(encoding="utf-8")
    head, *body = rows_of(name, root)
    if absent := {*columns} - {*head}:
        raise LookupError(f"{name}: no {', '.join(absent)}; the columns are {', '.join(head)}")
    if columns:
        places = [head.index(column) for column in columns]
        head, *body = ([row[place] for place in places] for row in (head, *body))
    numeric = [
        all(cell in ("", "–") or NUMERIC.match(cell) for cell in column)
        for column in zip(*body, strict=True)
    ]
    rule = ["---:" if right else "---" for right in numeric]
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, rule, *body))


def value(path: list[str], root: Path = ROOT) -> str:
    """The text of the number at PATH, CELL ..., COLUMN, or at params, KEY."""
    name, *cells = path
    if name == "params":
        return str(value_of(read(root / "params.yaml"), cells[0]))
    head, *body = rows_of(name, root)
    rows = [row for row in body if row[: len(cells) - 1] == cells[:-1]]
    if len(rows) != 1 or cells[-1] not in head:
        raise LookupError(
            f"{'::'.join(path)}: expected one row, got {len(rows)}; "
            f"the columns are {', '.join(head)}"
        )
    return rows[0][head.index(cells[-1])].partition(" [")[0]


def needs(page: str) -> list[str] | None:
    """What the commands of a page need, by its marks;
    null for a page without a mark, which no test runs.
    """
    marks: list[str] = CHECKED.findall(page)
    return " ".join(marks).split() if marks else None


def prepare(folder: Path) -> None:
    """Link what commands read into an empty folder."""
    for name in ("data", "examples", "params.yaml"):
        (folder / name).symlink_to(ROOT / name)


def run_isi(arguments: list[str], folder: Path) -> str:
    """What ``isi`` prints; CalledProcessError if it fails."""
    command = [sys.executable, "-m", "isi", *arguments]
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout


def rows_in(folder: Path, file: str, query: str) -> str:
    """What ``sqlite3`` prints: a row a line, with | between columns."""
    with closing(sqlite3.connect(folder / file)) as database:
        rows = database.execute(query).fetchall()
    texts = (["" if value is None else str(value) for value in row] for row in rows)
    return "".join("|".join(row) + "\n" for row in texts)


def with_output(page: str, folder: Path, run: Callable[[list[str], Path], str] = run_isi) -> str:
    """The text of a page with new output below commands that have output;
    all commands run in ``folder``, in order.
    """
    for path, content in FILE.findall(page):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(content, encoding="utf-8")

    def again(command: re.Match[str]) -> str:
        line, before = command.groups()
        program, *arguments = shlex.split(line)
        printed = run(arguments, folder) if program == "isi" else rows_in(folder, *arguments)
        return f"$ {line}\n{shortened(printed, before) if before else ''}"

    return BLOCK.sub(lambda block: COMMAND.sub(again, block[1]), page)


def shortened(printed: str, before: str) -> str:
    """Output with a line ``...`` for its middle, if the output before has one,
    with as many lines around it.
    """
    above, dots, below = before.partition("...\n")
    lines, first, last = printed.splitlines(keepends=True), above.count("\n"), below.count("\n")
    if not dots or len(lines) <= first + last:
        return printed
    return "".join([*lines[:first], dots, *lines[len(lines) - last :]])


def alike(new: str, old: str) -> bool:
    """Whether two texts are equal but for spaces and for the last digits of numbers."""
    pairs = list(zip_longest(NUMBER.findall(new), NUMBER.findall(old), fillvalue="nan"))
    words, others = (NUMBER.sub("0", text).split() for text in (new, old))
    return words == others and all(
        math.isclose(float(number), float(before), **CLOSE) for number, before in pairs
    )


def write_table(name: str, table: pd.DataFrame) -> None:
    """Print a table, and write it as ``NAME.csv`` into docs/benchmarks."""
    table.to_csv(BENCHMARKS / f"{name}.csv", index=False, lineterminator="\n")
    print(table.to_string(index=False))


def this_run() -> dict[str, str]:
    """Date, version, commit and machine of a run that starts now; its tables change no commit."""
    day = datetime.now(UTC)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    code = (git("rev-parse", "--short=8", "HEAD") or "unknown").strip()
    changed = git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!docs")
    return {
        "date": f"{day.day} {day:%B %Y}",
        "isi": project["version"],
        "commit": code + (" with changes" if changed else ""),
        "machine": (
            f"{processor()}, {os.cpu_count()} cores, {platform.system()}; "
            f"Python {platform.python_version()}"
        ),
    }


def processor(path: Path = Path("/proc/cpuinfo")) -> str:
    """The name of the processor, with the numbers that tell its generation: in a virtual machine,
    the name is often that of all generations.
    """
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    pairs = [line.partition(":") for line in lines]
    known = {name.strip(): value.strip() for name, _, value in pairs}
    numbers = {"family": "cpu family", "model": "model", "stepping": "stepping"}
    told = " ".join(f"{part} {known[name]}" for part, name in numbers.items() if name in known)
    name = known.get("model name", platform.machine())
    return f"{name} ({told})" if told else name


def record(run: dict[str, str], names: list[str]) -> None:
    """Write into runs.csv, and in words into machine.md, that a run wrote the tables ``names``."""
    runs = recorded(run, names, pd.read_csv(BENCHMARKS / "runs.csv", dtype=str))
    write_table("runs", runs)
    (BENCHMARKS / "machine.md").write_text(runs_in_words(runs), encoding="utf-8")


def recorded(run: dict[str, str], names: list[str], before: pd.DataFrame) -> pd.DataFrame:
    """The runs of all tables after one that wrote the tables ``names``."""
    kept = before[~before["table"].isin(names)]
    written = pd.DataFrame([{"table": name, **run} for name in names])
    return pd.concat([kept, written]).sort_values("table", ignore_index=True)


def runs_in_words(runs: pd.DataFrame) -> str:
    """A sentence for each run, with the tables that it wrote."""
    lines = []
    for run, tables in runs.groupby(RUN, sort=False):
        date, version, commit, machine = run
        whose = "All tables" if len(tables) == len(runs) else ", ".join(tables["table"])
        lines.append(f"- {whose}: one run on {date}, isi {version}, commit {commit}; {machine}.\n")
    return "".join(lines)


def main(named: list[str]) -> None:
    """Update the commands' output in the named pages;
    without names, the tables and numbers of all pages.
    """
    for page in pages() if not named else ():
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")
    for page in map(Path, named):
        with tempfile.TemporaryDirectory() as folder:
            prepare(Path(folder))
            text = with_output(page.read_text(encoding="utf-8"), Path(folder))
        page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    with errors_in_one_line("docs"):
        main(sys.argv[1:])
