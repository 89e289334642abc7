"""Folders that ``isi import`` reads, and an object that must not be unpickled."""

from pathlib import Path
from typing import Any

import isi
from isi.__main__ import main
from isi.home.loaded import LoadedEmbedding


def imported(*arguments: str) -> LoadedEmbedding:
    """What ``isi import`` makes of these arguments, in the folder ``out``."""
    main(["import", *arguments, "--out", "out"])
    with isi.open("out") as home:
        return home.base


class Bomb:
    """An object that creates a folder when it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.mkdir, (Path("exploded"),)
