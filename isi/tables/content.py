"""Digests of what a table or tensors hold, whatever the file that holds them looks like."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

if TYPE_CHECKING:
    from torch import Tensor


class Content:
    """The SHA-256 of a table's values, which come part by part.

    It hangs on names, types and values alone: not on chunks, row groups, dictionaries, compression or what wrote them.
    Of each column are hashed the values, little-endian or in UTF-8 (null: 0, or nothing), and beside them which are
    there (a byte each) or how long they are (int32; null: -1).
    """

    def __init__(self, columns: pa.Schema) -> None:
        self._columns = columns
        self._hashes = [(hashlib.sha256(), hashlib.sha256()) for _ in columns]

    def add(self, part: pa.Table) -> None:
        """Take the next rows; the columns are those of the schema, dictionary-encoded or plain."""
        for (values, beside), field in zip(self._hashes, self._columns, strict=True):
            for chunk in part.column(field.name).chunks:
                of_values, of_places = _text(chunk) if _is_text(field.type) else _numbers(chunk)
                values.update(of_values)
                beside.update(of_places)

    def digest(self) -> str:
        """Of all that came, as hexadecimal digits."""
        described = [
            [field.name, "string" if _is_text(field.type) else str(field.type), *(one.hexdigest() for one in hashes)]
            for field, hashes in zip(self._columns, self._hashes, strict=True)
        ]
        return hashlib.sha256(json.dumps(described).encode()).hexdigest()


def digest_of_table(table: pa.Table, columns: pa.Schema) -> str:
    """The digest of a whole table (see ``Content``)."""
    content = Content(columns)
    content.add(table)
    return content.digest()


def digest_of_tensors(tensors: Mapping[str, Tensor]) -> str:
    """The SHA-256 of tensors' names, types, shapes and numbers, in the order of their names."""
    content = hashlib.sha256()
    for name in sorted(tensors):
        array = np.ascontiguousarray(tensors[name].numpy())
        content.update(json.dumps([name, str(array.dtype), list(tensors[name].shape)]).encode())
        content.update(array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes())
    return content.hexdigest()


def _is_text(kind: pa.DataType) -> bool:
    return bool(pa.types.is_string(kind.value_type if pa.types.is_dictionary(kind) else kind))


def _numbers(chunk: pa.Array) -> tuple[bytes, bytes]:
    values = chunk.fill_null(False if pa.types.is_boolean(chunk.type) else 0).to_numpy(zero_copy_only=False)
    return values.astype(values.dtype.newbyteorder("<"), copy=False).tobytes(), _bytes(chunk.is_valid())


def _text(chunk: pa.Array) -> tuple[bytes, bytes]:
    plain = chunk.cast(pa.large_string())
    lengths = pc.binary_length(plain).fill_null(-1).to_numpy(zero_copy_only=False)
    there = plain.drop_null()
    if not len(there):
        return b"", lengths.astype("<i4").tobytes()
    ends = np.frombuffer(there.buffers()[1], dtype=np.int64)[[there.offset, there.offset + len(there)]]
    return memoryview(there.buffers()[2])[slice(*ends.tolist())].tobytes(), lengths.astype("<i4").tobytes()


def _bytes(booleans: pa.Array) -> bytes:
    return bytes(booleans.to_numpy(zero_copy_only=False).astype(np.uint8).tobytes())
