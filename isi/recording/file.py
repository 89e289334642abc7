"""A recording that grows scene by scene: each line is a gzip member of its own, so that a killed run costs one."""

from __future__ import annotations

import gzip
import json
import os
import zlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from isi.errors import InputError, short
from isi.recording.settings import Layout
from isi.sources._materials import Object
from isi.sources._recording import FIELDS, FORMAT, MOST_BYTES, check_header, check_line, parsed
from isi.tables import io

_CHUNK = 1 << 20


class Recording:
    """Scenes on the disk, behind a header that is written with the first."""

    def __init__(self, path: Path, simulator: Mapping[str, Any]) -> None:
        """Read which scenes there are, and cut off a last line that is not whole.

        Args:
            path: of the file; it may be missing.
            simulator: what the header says of it.

        Raises:
            InputError: where the file is no recording, or one of another simulator, or such a line cannot be cut off.
        """
        self.path, self._header = path, FORMAT | dict(simulator)
        #: names of layouts
        self.names: set[str] = set()
        if not path.exists():
            return
        line, whole = 0, 0
        for end, content in _members(path):
            whole = end
            for text in content.splitlines():
                line += 1
                self._note(line, parsed(path, line, text))
        if line == 0:
            raise InputError(path, "", "expected a recording, or no file, to record to")
        try:
            if whole < path.stat().st_size:
                os.truncate(path, whole)
        except OSError as error:
            raise _unwritable(path, error) from error

    def _note(self, line: int, record: Any) -> None:
        if line == 1:
            _check_same(self.path, record, self._header)
        else:
            plan, spawn, _ = check_line(self.path, line, record)
            self.names.add(Layout(plan, spawn).name)

    def append(self, what: Layout, objects: Iterable[Object]) -> None:
        """Add a scene: of each object what mining reads, as the simulator gave it; on the disk when this returns.

        Raises:
            InputError: where that cannot be written.
        """
        kept = [{key: thing[key] for key in FIELDS if key in thing} for thing in objects]
        scene = _member({"scene": what.plan, "spawn": what.spawn, "objects": kept})
        try:
            if self.path.exists():
                with self.path.open("ab") as file:
                    file.write(scene)
                    file.flush()
                    os.fsync(file.fileno())
            else:
                whole = _member(self._header) + scene
                io.atomically(self.path, lambda temporary: temporary.write_bytes(whole))
        except OSError as error:
            raise _unwritable(self.path, error) from error
        self.names.add(what.name)


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(path, "", f"cannot be written ({error.strerror})")


def _member(record: Mapping[str, Any]) -> bytes:
    line = json.dumps(record, separators=(",", ":")) + "\n"
    return gzip.compress(line.encode(), mtime=0)


def _members(path: Path) -> Iterator[tuple[int, bytes]]:
    """Where each whole gzip member of a file ends, and what it holds: no more than the longest line."""
    unpack, content, end, rest = _unpacking(), bytearray(), 0, b""
    try:
        with path.open("rb") as file:
            while chunk := rest or file.read(_CHUNK):
                content += unpack.decompress(chunk, MOST_BYTES + 1 - len(content))
                if len(content) > MOST_BYTES:
                    raise InputError(path, f"byte {end:,}", f"expected lines of at most {MOST_BYTES:,} bytes")
                rest = unpack.unused_data
                end += len(chunk) - len(rest)
                if unpack.eof:
                    yield end, bytes(content)
                    unpack, content = _unpacking(), bytearray()
    except (OSError, zlib.error) as error:
        raise InputError(path, f"byte {end:,}", f"expected a recording, compressed by gzip ({error})") from error


def _unpacking() -> Any:
    return zlib.decompressobj(16 + zlib.MAX_WBITS)


def _check_same(path: Path, found: Any, header: Mapping[str, Any]) -> None:
    check_header(path, found)
    for key, value in header.items():
        if found.get(key) != value:
            other = f"was recorded with {key} {short(found.get(key))}, not {short(value)}"
            raise InputError(path, "line 1", f"{other}: choose another output, or remove it")
