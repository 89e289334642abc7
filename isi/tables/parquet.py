"""Parquet files of the pipeline: each is checked when read,
and written completely or not at all.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from isi.errors import InputError, extra
from isi.tables.io import STAGE, atomically, opening

with extra("pipeline"):
    import pyarrow as pa
    import pyarrow.parquet as pq

if TYPE_CHECKING:
    import pandas as pd

    from isi.tables.rules import ColumnType


def schema_of(columns: Mapping[str, ColumnType]) -> pa.Schema:
    """The Arrow schema of a table's columns."""
    category = pa.dictionary(pa.int32(), pa.string())
    kinds = [column.type for column in columns.values()]
    types = [category if kind == "category" else pa.type_for_alias(kind) for kind in kinds]
    return pa.schema([*zip(columns, types, strict=True)])


def table_of(frame: pd.DataFrame, schema: pa.Schema) -> pa.Table:
    """The columns of a schema in a frame, as an Arrow table."""
    return pa.Table.from_pandas(frame, schema=schema, preserve_index=False)


def read(path: Path, schema: pa.Schema) -> pa.Table:
    """Read the columns of a schema, dictionary-encoded or not;
    ``InputError`` if one is missing or of another type.
    """
    with opening(path, "a Parquet table", pa.ArrowException):
        table = pq.ParquetFile(path).read()
    for expected in schema:
        place = table.schema.get_field_index(expected.name)
        if place < 0:
            raise InputError(path, f"column {expected.name!r}", "missing")
        got = table.schema.field(place).type
        if _plain(got) != _plain(expected.type):
            raise InputError(
                path, f"column {expected.name!r}", f"expected {expected.type}, got {got}"
            )
    return table.select(schema.names)


def _plain(kind: pa.DataType) -> pa.DataType:
    """A column's type without dictionary encoding; large strings become strings."""
    kind = kind.value_type if pa.types.is_dictionary(kind) else kind
    return pa.string() if pa.types.is_large_string(kind) else kind


def write(path: Path, parts: Iterable[pa.Table], schema: pa.Schema, stage: str) -> None:
    """Write each part as a row group, atomically; metadata: ``stage``.
    Equal arguments give equal bytes.
    """

    def write_parts(temporary: Path) -> None:
        with pq.ParquetWriter(
            temporary, schema.with_metadata({STAGE: stage}), compression="zstd"
        ) as writer:
            for part in parts:
                columns = [
                    _in_order_of_rows(part.column(field.name), field.type) for field in schema
                ]
                writer.write_table(pa.Table.from_arrays(columns, schema=schema))

    atomically(path, write_parts)


def _in_order_of_rows(column: pa.ChunkedArray, kind: pa.DataType) -> pa.ChunkedArray:
    """The same column with its dictionary sorted by first appearance."""
    if not pa.types.is_dictionary(kind):
        return column.cast(kind)
    return pa.chunked_array(column.cast(kind.value_type).combine_chunks().dictionary_encode())
