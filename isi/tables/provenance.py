"""Where a file comes from: what its metadata says of the stage, the params and the inputs that made it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import pyarrow as pa
import pyarrow.parquet as pq

#: Keys of metadata: the stage; the hash of its own params, and of those with its inputs'; the digests of its inputs, by
#: path, as JSON; the digest of what it wrote (``isi.tables.content``); and, where a user has accepted an edit, of that.
STAGE, OWN, PARAMS, INPUTS, CONTENT, ACCEPTED = (
    f"isi.{key}" for key in ("stage", "own", "params", "inputs", "content", "accepted")
)

Metadata = Mapping[str, str]
#: Bytes of a safetensors header, at most.
_LONGEST = 10**8


class Origins(Protocol):
    """Tells whether files are what their stages would write now."""

    def check(self, path: Path) -> None: ...

    def check_first(self) -> None: ...


@dataclass
class Provenance:
    """What a stage's outputs were made from: goes into the metadata of each of them."""

    stage: str
    params: Mapping[str, Any]
    #: metadata of the files that it has read
    inputs: dict[str, Metadata] = field(default_factory=dict)
    #: of what it reads; null: whoever reads does not ask
    origins: Origins | None = None
    _checked: dict[str, tuple[int, int]] = field(default_factory=dict, init=False, repr=False)

    def metadata(self) -> dict[str, str]:
        """Stage, hashes of the params that shape its outputs, its inputs' params included, and the inputs' digests."""
        made_under = sorted({of_input.get(PARAMS, "") for of_input in self.inputs.values()})
        digests = {path: of_input.get(CONTENT, "") for path, of_input in self.inputs.items()}
        return {
            STAGE: self.stage,
            OWN: own(self.stage, self.params),
            PARAMS: _hash([self.stage, self.params, made_under]),
            INPUTS: json.dumps(digests, sort_keys=True),
        }

    def seen(self, path: Path, metadata: Metadata) -> None:
        """Note a file that was read.

        Raises:
            InputError: where it is not what its stage would write now.
        """
        if self.origins and path.as_posix() not in self.inputs:
            self.origins.check(path)
        self.inputs[path.as_posix()] = metadata

    def to_check(self, path: Path) -> bool:
        """Whether a file was not yet checked as it is now."""
        return self._checked.get(path.as_posix()) != _stamp(path)

    def checked(self, path: Path) -> None:
        """Note that a file holds its rules and what was written."""
        self._checked[path.as_posix()] = _stamp(path)


def own(stage: str, params: Mapping[str, Any]) -> str:
    """The hash of a stage and its own params."""
    return _hash([stage, params])


def metadata_of(path: Path) -> dict[str, str]:
    """What a table, tensors or a kept embedding say of themselves; nothing where the file is missing or broken."""
    try:
        if path.suffix == ".json":
            return metadata_of_embedding(path)
        if path.suffix == ".safetensors":
            return metadata_of_tensors(path)
        return metadata_of_table(pq.read_metadata(path).metadata)
    except (OSError, ValueError, RecursionError, pa.ArrowException):
        return {}


def metadata_of_table(metadata: Mapping[bytes, bytes] | None) -> dict[str, str]:
    """The product's own part of a Parquet file's metadata."""
    found = (metadata or {}).items()
    return {key.decode(): value.decode() for key, value in found if key.startswith(b"isi.")}


def metadata_of_tensors(path: Path) -> dict[str, str]:
    """The metadata of a safetensors file, from its header."""
    with path.open("rb") as file:
        size = int.from_bytes(file.read(8), "little")
        header = json.loads(file.read(size if size <= _LONGEST else 0))
    found = header.get("__metadata__", {}) if isinstance(header, dict) else {}
    return dict(found) if isinstance(found, dict) else {}


def metadata_of_embedding(path: Path) -> dict[str, str]:
    """The product's own part of what a kept embedding says of how it was made."""
    found = json.loads(path.read_bytes())
    made = found.get("made") if isinstance(found, dict) else None
    return {key: str(value) for key, value in made.items() if key.startswith("isi.")} if isinstance(made, dict) else {}


def inputs_of(metadata: Metadata) -> dict[str, str]:
    """The digests of what a file was made from, by path."""
    try:
        found = json.loads(metadata.get(INPUTS, "{}"))
    except (ValueError, RecursionError):
        return {}
    return {path: digest for path, digest in found.items() if len(path) < 1000} if isinstance(found, dict) else {}


def _stamp(path: Path) -> tuple[int, int]:
    stat = path.stat()
    return stat.st_mtime_ns, stat.st_size


def _hash(value: Any) -> str:
    return hashlib.sha256(json.dumps(_as_compared(value), sort_keys=True, default=str).encode()).hexdigest()


def _as_compared(value: Any) -> Any:
    """Params as DVC compares them, to which 2.0 is 2."""
    if isinstance(value, Mapping):
        return {str(key): _as_compared(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_as_compared(one) for one in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value
