"""The files that a user names as outputs of a command: none destroys an input or another file."""

import os
import re
import sys
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from stat import S_IMODE
from typing import Annotated

from cyclopts import Parameter

from isi.errors import InputError, unwritable
from isi.tables.io import atomically

Replace = Annotated[bool, Parameter(help="replace existing files")]


def write_outputs(contents: Mapping[Path, str], inputs: Collection[Path], replace: bool) -> None:
    """Write files, each completely or not at all.

    An ``InputError`` refuses all of them if one exists (unless ``replace``) or is an input. What is
    no regular file (a device, a pipe) is written into, and a link is followed. A file that is
    replaced keeps its mode.
    """
    places = {path: Path(os.path.realpath(path)) for path in contents}
    files = [path for path in contents if not is_device(path)]
    refuse_inputs([*files, *(places[path] for path in files)], inputs)
    for path in files:
        if places[path].exists() and not replace:
            raise InputError(path, "", "exists: choose another name, or --replace replaces it")
    for path, content in contents.items():
        if path in files:
            _replace(places[path], content.encode())
        else:
            _write_into(path, content.encode())


def refuse_inputs(outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """InputError for an output that is an input, or that lies in a folder that is one.

    Of an output folder, all its files count.
    """
    read = [given for given in inputs if os.path.exists(given)]  # noqa: PTH110  # of any text
    for output in outputs:
        for file in sorted(output.iterdir()) if output.is_dir() else [output]:
            for given in read if file.is_file() else ():
                folders = [*file.absolute().parents, *file.resolve().parents]
                places = folders if given.is_dir() else [file]
                if any(map(given.samefile, places)):
                    raise InputError(file, "", "is read by this command: choose another output")


def paths_in(settings: Mapping[str, object]) -> list[Path]:
    """The settings of a reader that may be paths of inputs."""
    return [Path(value) for value in settings.values() if isinstance(value, str)]


def is_device(path: Path) -> bool:
    """Whether a path is no regular file and no folder, or an open file such as ``/dev/stdout``."""
    is_open = re.match(r"/dev/(std|fd/)|/proc/[^/]+/fd/", str(path.absolute()))
    return bool(is_open) or (path.exists() and not path.is_file() and not path.is_dir())


def _write_into(path: Path, content: bytes) -> None:
    try:
        is_output = os.path.samestat(path.stat(), os.fstat(1))
        # appended, since a shell may have given a file that has content
        opened = os.dup(1) if is_output else os.open(path, os.O_WRONLY | os.O_APPEND)
        sys.stdout.flush()
        with os.fdopen(opened, "wb") as file:
            file.write(content)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise unwritable(path, error) from error


def _replace(path: Path, content: bytes) -> None:
    def write(temporary: Path) -> None:
        temporary.write_bytes(content)
        if path.exists():
            temporary.chmod(S_IMODE(path.stat().st_mode))

    atomically(path, write)
