"""No output of a command may overwrite one of its inputs."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from isi.errors import InputError


def refuse_inputs(outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """InputError for an output that is an input, or that lies in a folder that is one.

    Of an output folder, all its files count.
    """
    read = [each for each in inputs if os.path.exists(each)]  # noqa: PTH110  # of any text
    for output in outputs:
        for file in sorted(output.iterdir()) if output.is_dir() else [output]:
            for each in read if file.is_file() else ():
                folders = [*file.absolute().parents, *file.resolve().parents]
                places = folders if each.is_dir() else [file]
                if any(map(each.samefile, places)):
                    raise InputError(file, "", "is read by this command: choose another output")


def paths_in(settings: Mapping[str, object]) -> list[Path]:
    """The settings of a reader that may be paths of inputs."""
    return [Path(value) for value in settings.values() if isinstance(value, str)]
