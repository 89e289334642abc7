"""What a user types beside the pipeline: ``python -m isi COMMAND``."""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import sys
from collections.abc import Sequence
from typing import NoReturn

from isi import commands
from isi.base.errors import InputError


class Parser(argparse.ArgumentParser):
    """Answers mistakes in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}\n")


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command that is asked for; each is a module of ``isi.commands``."""
    parser = Parser(prog="python -m isi", description=__doc__.partition(":")[0] + ".")
    added = parser.add_subparsers(metavar="COMMAND", required=True)
    for found in pkgutil.iter_modules(commands.__path__):
        if not found.name.startswith("_"):
            module = importlib.import_module(f"{commands.__name__}.{found.name}")
            about = (module.__doc__ or "").partition("\n\n")[0]
            own = added.add_parser(found.name.replace("_", "-"), help=about, description=about)
            module.configure(own)
            own.set_defaults(run=module.run, prog=own.prog)
    arguments = parser.parse_args(argv)
    try:
        arguments.run(arguments)
    except InputError as error:
        sys.exit(f"{arguments.prog}: {error}")


if __name__ == "__main__":
    main()
