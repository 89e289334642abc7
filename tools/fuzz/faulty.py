"""Readers with faults, which the fuzz tests must detect."""

import os
import re
from pathlib import Path
from typing import NoReturn

from isi.errors import InputError
from tools.fuzz.formats import Format

OUT = Path("out/table.parquet")


class Verbatim(InputError):
    """An ``InputError`` whose message is neither shortened nor escaped."""

    def __str__(self) -> str:
        return ": ".join(part for part in self.args if part)


def leave_behind(path: Path) -> NoReturn:
    path.write_bytes(b"half")
    raise InputError("file", "", "is broken")


def refuse(message: str) -> NoReturn:
    raise Verbatim("file", "", message)


FAULTY = {
    "!endless in C": Format({}, lambda: str(re.match(r"(a+)+$", "a" * 60 + "b"))),
    "!memory": Format({}, lambda: str(len(bytearray(3 * 2**30)))),
    "!dies": Format({}, lambda: os._exit(3)),
    "!writes into an output": Format({}, lambda: leave_behind(OUT), (OUT,)),
    "!leaves a file": Format({}, lambda: leave_behind(Path(".x.tmp"))),
    "!is not printable": Format({}, lambda: refuse("is \x1b[2J")),
    "!is long": Format({}, lambda: refuse("x" * 494)),
    "!raises": Format({}, lambda: {"": ""}["head"]),
}
