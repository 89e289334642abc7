"""Readers that do what no reader may, so that tests see that it is noticed."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import NoReturn

from isi.errors import InputError
from tests.fuzz.formats import Format

OUT = Path("out/table.parquet")


class Verbatim(InputError):
    """A mistake that is told as it is, whatever is in it."""

    def __str__(self) -> str:
        return ": ".join(part for part in self.args if part)


def endless_in_c() -> str:
    return str(re.match(r"(a+)+$", "a" * 60 + "b"))


def memory() -> str:
    return str(len(bytearray(3 * 2**30)))


def dies() -> NoReturn:
    os._exit(3)


def touches() -> NoReturn:
    OUT.write_bytes(b"half")
    raise InputError("file", "", "is broken")


def leaves() -> NoReturn:
    Path(".x.tmp").write_bytes(b"half")
    raise InputError("file", "", "is broken")


def lines() -> NoReturn:
    raise Verbatim("file", "", "is \x1b[2J")


def says_much() -> NoReturn:
    raise Verbatim("file", "", "x" * 494)


def traceback() -> str:
    table: dict[str, str] = {}
    return table["head"]


FAULTY = {
    "!endless in C": Format({}, endless_in_c),
    "!memory": Format({}, memory),
    "!dies": Format({}, dies),
    "!touches": Format({}, touches, (OUT,)),
    "!leaves": Format({}, leaves),
    "!lines": Format({}, lines),
    "!says much": Format({}, says_much),
    "!traceback": Format({}, traceback),
}
