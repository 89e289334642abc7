"""The vectors of inserted entities in the folder of a bundle,
so that opening it does not compute them again.

``inserted.safetensors`` holds what was computed when the folder was last closed. It may be deleted.
A vector counts only where all its inputs are the same: each has a key, which is a digest of them.
"""

import json
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from isi.errors import InputError
from isi.live.folder import STORED
from isi.tables.io import atomically

VERSION = 2  #: Raised when an initializer computes other vectors from the same inputs.


class StoredVector(NamedTuple):
    """A computed vector."""

    vector: np.ndarray  #: shape: (d,)
    fallback: str | None  #: the rule that replaced the initializer for lack of data, or None


def key_of(*inputs: Any) -> str:
    """A digest of the inputs of a vector: of values that JSON holds."""
    content = json.dumps([VERSION, *inputs], ensure_ascii=False, sort_keys=True)
    return sha256(content.encode()).hexdigest()


def digest_of(*tables: np.ndarray | None) -> str:
    """A digest of tables; None for one that is not there."""
    digest = sha256()
    for table in tables:
        shape = "none" if table is None else f"{table.dtype} {table.shape}"
        digest.update(shape.encode())
        if table is not None:
            digest.update(np.ascontiguousarray(table).data)
    return digest.hexdigest()


def read(folder: Path) -> dict[str, StoredVector]:
    """The vectors of a folder by key; none if the file is missing or broken."""
    with suppress(OSError, SafetensorError, ValueError, KeyError, TypeError):
        with safe_open(folder / STORED, framework="np") as file:
            vectors, about = file.get_tensor("vectors"), file.metadata()
        keys, fallbacks = json.loads(about["keys"]), json.loads(about["fallbacks"])
        if digest_of(vectors) == about["digest"]:
            rows = zip(keys, vectors, fallbacks, strict=True)
            return {key: StoredVector(vector, fallback) for key, vector, fallback in rows}
    return {}


def write(folder: Path, vectors: Mapping[str, StoredVector]) -> None:
    """Write the vectors by key; nothing where the disk does not allow it,
    since they can be computed.
    """
    table = np.stack([stored.vector for stored in vectors.values()])
    about = {
        "keys": json.dumps(list(vectors)),
        "fallbacks": json.dumps([stored.fallback for stored in vectors.values()]),
        "digest": digest_of(table),
    }
    content = save({"vectors": table}, about)
    with suppress(InputError):
        atomically(folder / STORED, partial(Path.write_bytes, data=content))
