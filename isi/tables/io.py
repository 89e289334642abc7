"""Safetensors files of the pipeline, each checked when read;
files of any form are written completely or not at all.
"""

from __future__ import annotations

import glob
import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isi.errors import NO_SUCH_FILE, InputError, at, unwritable
from isi.process import is_running

if TYPE_CHECKING:
    from torch import Tensor

STAGE = "isi.stage"  #: Key of a file's metadata that names the stage that wrote it.


@contextmanager
def opening(path: Path, form: str, fault: type[Exception]) -> Iterator[None]:
    """Turn errors of opening a file, ``fault`` included, into an ``InputError`` with its path."""
    try:
        yield
    except FileNotFoundError as error:
        raise InputError(path, "", NO_SUCH_FILE) from error
    except (OSError, fault) as error:
        why = next(iter(str(error).splitlines()), type(error).__name__)
        raise InputError(path, "", f"expected {form} ({why})") from error


def read_tensors(path: Path, names: Sequence[str] | None = None) -> dict[str, Tensor]:
    """Read named tensors (None: all) of a safetensors file;
    ``InputError`` where one is missing or not finite.
    """
    with _opened(path) as file:
        tensors = {
            name: file.get_tensor(_tensor_of(path, file, name)) for name in names or file.keys()
        }
    _check_finite(path, tensors)
    return tensors


def write_tensors(path: Path, tensors: Mapping[str, Tensor], stage: str) -> None:
    """Write a safetensors file, atomically; metadata: ``stage``.
    InputError for NaN, infinity or a failed write.
    """
    from safetensors.torch import save

    _check_finite(path, tensors)
    content = save(
        {name: tensor.contiguous() for name, tensor in tensors.items()}, metadata={STAGE: stage}
    )
    atomically(path, lambda temporary: temporary.write_bytes(content))


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    from safetensors import SafetensorError, safe_open  # imported here: it loads torch

    with (
        opening(path, "a safetensors file", SafetensorError),
        safe_open(path, framework="pt") as file,
    ):
        yield file


def _tensor_of(path: Path, file: Any, name: str) -> str:
    if name not in file.keys():  # noqa: SIM118 it is no mapping
        raise InputError(path, f"tensor {name!r}", "missing")
    return name


def _check_finite(path: Path, tensors: Mapping[str, Tensor]) -> None:
    for name, tensor in sorted(tensors.items()):
        try:
            finite = np.isfinite(tensor.numpy())
        except TypeError as error:
            raise InputError(
                path, f"tensor {name!r}", f"expected a type that NumPy has, got {tensor.dtype}"
            ) from error
        if not finite.all():
            place = np.argwhere(~finite)[0].tolist()
            raise InputError(path, f"tensor {name!r}, {place}", "expected finite numbers")


def check_sha256(path: Path, expected: str | None) -> None:
    """InputError unless the SHA-256 of a file is ``expected``
    (64 hexadecimal digits; None: no check).
    """
    if expected is not None:
        with at(path), path.open("rb") as file:
            got = hashlib.file_digest(file, "sha256").hexdigest()
        if got != expected:
            raise InputError(path, "", f"expected {expected} as its sha256, got {got}")


def atomically(path: Path, write_to: Callable[[Path], object]) -> None:
    """Call ``write_to`` with a temporary path, then rename that file to ``path``;
    InputError if writing fails.
    """
    if path.name in ("", ".."):
        raise InputError(path, "", "expected the name of a file")
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # of a stage that was killed
        for stale in path.parent.glob(f".{glob.escape(path.name)}.*.tmp"):
            if not is_running(stale.name.split(".")[-2]):
                stale.unlink()
        write_to(temporary)
        temporary.replace(path)
    except OSError as error:
        if error.errno is None or (
            error.filename and Path(error.filename).name not in {temporary.name, *path.parts}
        ):
            raise  # raised by reading a source of the content
        raise unwritable(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def keep_only(folder: Path, files: Sequence[Path]) -> None:
    """Remove the files that earlier and killed runs left in a folder: all except ``files``."""
    for path in {*folder.glob("*"), *folder.glob(".*.tmp")} - set(files):
        if path.is_file():
            path.unlink()
