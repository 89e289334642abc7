"""What a user types beside the pipeline: ``isi COMMAND``, or ``python -m isi COMMAND``."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import sys
from collections.abc import Sequence
from pathlib import Path

from isi import cli

try:
    from isi.process import Parser, one_line
except ModuleNotFoundError as error:
    sys.exit(f"isi: {sys.executable} lacks the package {error.name}: activate .venv, or use its `isi`")


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command that is asked for; each is a module of ``isi.cli``, and no other is imported."""
    with one_line("isi"):  # while what a command needs is imported, too
        given = list(sys.argv[1:] if argv is None else argv)
        about = "New entities in knowledge-graph embeddings, what is asked of them, and graphs of your own."
        parser = Parser(prog="isi", description=about)
        added = parser.add_subparsers(metavar="COMMAND", required=True)
        for name in _names():
            about, typed = _about(name), name.rstrip("_").replace("_", "-")
            own = added.add_parser(typed, help=about, description=about)
            if typed in given:
                module = importlib.import_module(f"{cli.__name__}.{name}")
                module.configure(own)
                own.set_defaults(run=module.run, prog=own.prog)
        arguments = parser.parse_args(given)
        with one_line(arguments.prog):
            arguments.run(arguments)


def _names() -> list[str]:
    """Modules of commands; those that are called as Python reserves it end with an underscore."""
    return [found.name for found in pkgutil.iter_modules(cli.__path__) if not found.name.startswith("_")]


def _about(name: str) -> str:
    """What a command is for: what its module begins with, which is not imported for that."""
    source = (Path(cli.__path__[0]) / f"{name}.py").read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(source)) or "").partition("\n\n")[0]


if __name__ == "__main__":
    main()
