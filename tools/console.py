"""Put what commands print today into the pages of docs/ that show it, below each prompt that has output.

The commands run in a folder of their own, beside the final model of the pipeline. Those of the pages want the
extra ``words``.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from isi.process import one_line

ROOT = Path(__file__).parent.parent
BLOCK = re.compile(r"(?<=^```console\n)(.*?)(?=^```)", re.DOTALL | re.MULTILINE)
COMMAND = re.compile(r"^\$ (isi .*)\n((?:[^$\n].*\n)*)", re.MULTILINE)


def shown(page: str, folder: Path) -> str:
    """A page with the output of every command that has some on it; the others run, too, in their order.

    Raises:
        subprocess.CalledProcessError: where a command fails.
    """

    def ran(command: re.Match[str]) -> str:
        line, before = command.groups()
        arguments = [sys.executable, "-m", "isi", *shlex.split(line)[1:]]
        said = subprocess.run(arguments, cwd=folder, check=True, capture_output=True, text=True).stdout
        return f"$ {line}\n{said if before else ''}"

    return BLOCK.sub(lambda block: COMMAND.sub(ran, block[1]), page)


def main(pages: list[str]) -> None:
    """Rewrite the pages."""
    for path in map(Path, pages):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "data").symlink_to(ROOT / "data")
            path.write_text(shown(path.read_text(encoding="utf-8"), Path(folder)), encoding="utf-8")


if __name__ == "__main__":
    with one_line("console"):
        main(sys.argv[1:] or [str(ROOT / "docs" / "insert.md")])
