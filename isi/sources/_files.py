"""Files that sources read: those that installed packages have, and those that must hash to something."""

from __future__ import annotations

import hashlib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import IO

from isi.errors import InputError


def packaged(package: str, path: str, what: str) -> Path:
    """A file or folder of an installed package, which is never imported.

    Args:
        package: its name.
        path: from where the package is installed.
        what: it has, for the error.

    Raises:
        InputError: where the package is not installed.
    """
    try:
        return Path(str(distribution(package).locate_file(path)))
    except PackageNotFoundError as error:
        raise InputError(f"package {package}", "", f"not installed, which has {what}") from error


def check_sha256(path: Path, file: IO[bytes], expected: str | None) -> None:
    """Refuse an open file that hashes to something else than expected, if anything is; then go back to its start.

    Raises:
        InputError: where it does.
        OSError: where it cannot be read.
    """
    if expected is None:
        return
    got = hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]
    if got != expected:
        raise InputError(path, "", f"expected {expected} as its sha256, got {got}")
    file.seek(0)
