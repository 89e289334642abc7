"""``isi check``: whether the database of a home is whole."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from isi.cli import HOME
from isi.errors import InputError


def check(
    folder: Annotated[Path, Parameter(name="--home", help="folder of a home")] = HOME,
) -> None:
    """Check pages, indexes, keys, and the digests of the trained vectors."""
    from isi.home.folder import opened

    with opened(folder) as database:
        if faults := database.faults():
            more = f" (and {len(faults) - 1} more)" * (len(faults) > 1)
            raise InputError(database.path, "", f"{faults[0]}{more}; put a copy back")
        changes = database.number_of_changes()
    print(f"{database.path} is whole: {changes:,} changes since training")
