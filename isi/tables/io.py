"""The tables and tensors of the pipeline on disk: checked reads and atomic writes."""

from __future__ import annotations

import glob
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from isi.errors import InputError, NotAsWritten, unwritable
from isi.pipeline import absent
from isi.process import lives
from isi.tables.catalogue import (
    Schema,
)
from isi.tables.content import Content, digest_of_table, digest_of_tensors
from isi.tables.provenance import CONTENT, Metadata, Provenance, metadata_of_table
from isi.tables.rules import first_not_finite

if TYPE_CHECKING:
    from torch import Tensor


def read(path: Path, schema: Schema, provenance: Provenance | None = None) -> pd.DataFrame:
    """Read a Parquet table whose columns must be those of the schema, whose rows must hold its rules.

    Args:
        provenance: of what is made from the table, which notes it; it may refuse what is not of these params (see
            ``Provenance.seen``).

    Raises:
        InputError: where the file is missing or broken, a column is missing or of another type, a row breaks a rule,
            or the values are not those that were written.
    """
    table, metadata = opened(path, schema)
    frame: pd.DataFrame = table.to_pandas()
    if provenance is None or provenance.to_check(path):
        schema.check(frame, path)
        check_content(path, metadata, digest_of_table(table, schema.columns))
    if provenance:
        provenance.checked(path)
        provenance.seen(path, metadata)
    return frame


def opened(path: Path, schema: Schema) -> tuple[pa.Table, Metadata]:
    """The columns of a table as they stand in a file, unchecked but for their types, and its metadata."""
    try:
        with pq.ParquetFile(path) as file:
            table, metadata = file.read(), metadata_of_table(file.metadata.metadata)
    except FileNotFoundError as error:
        raise absent(path) from error
    except (OSError, pa.ArrowException) as error:
        raise InputError(path, "", f"expected a Parquet table ({_first_line(error)})") from error
    for expected in schema.columns:
        place = table.schema.get_field_index(expected.name)
        if place < 0:
            raise InputError(path, f"column {expected.name!r}", "missing")
        if not _same_values(table.schema.field(place).type, expected.type):
            got = table.schema.field(place).type
            raise InputError(path, f"column {expected.name!r}", f"expected {expected.type}, got {got}")
    return table.select(schema.names), metadata


def check_content(path: Path, metadata: Metadata, digest: str) -> None:
    """See that a file holds the values that it says were written.

    Raises:
        NotAsWritten: where it does not, or does not say.
    """
    if metadata.get(CONTENT) != digest:
        edited = "was edited" if CONTENT in metadata else "bears no digest of a stage"
        ways = f"`dvc checkout --force {path}`, or where the edit is meant, `isi check --accept {path}`"
        raise NotAsWritten(path, "", f"{edited}: {ways}")


def read_text(path: Path, schema: Schema) -> pd.DataFrame:
    """Like ``read``, with text in place of categories."""
    return as_text(read(path, schema))


def as_text(frame: pd.DataFrame) -> pd.DataFrame:
    """The same with plain text in place of categories."""
    return frame.astype(dict.fromkeys(frame.select_dtypes("category").columns, str))


def together(parts: Iterable[pd.DataFrame], *schemas: Schema) -> pd.DataFrame:
    """Parts of a table behind each other; without any, a table without rows that has the columns of the schemas."""
    listed = list(parts)
    names = dict.fromkeys(name for schema in schemas for name in schema.names)
    return pd.concat(listed) if listed else pd.DataFrame({name: pd.Series(dtype=object) for name in names})


def write(path: Path, frame: pd.DataFrame, schema: Schema, provenance: Provenance) -> None:
    """Write a Parquet table through a temporary file: it is whole and holds its rules, or it is not there.

    Raises:
        InputError: where a row breaks a rule.
    """
    whole = pa.Table.from_pandas(frame, schema=schema.columns, preserve_index=False)
    write_table(path, whole, schema, provenance.metadata())


def write_table(path: Path, table: pa.Table, schema: Schema, metadata: Metadata) -> None:
    """The same of columns of the schema's types, dictionary-encoded or not, with metadata and the values' digest."""
    schema.check(table.to_pandas(), path)
    columns = [_as_first_seen(table.column(field.name), field.type) for field in schema.columns]
    stated = {**metadata, CONTENT: digest_of_table(table, schema.columns)}
    whole = pa.Table.from_arrays(columns, schema=schema.columns.with_metadata(stated))
    atomically(path, lambda temporary: pq.write_table(whole, temporary, compression="zstd"))


def _as_first_seen(column: pa.ChunkedArray, kind: pa.DataType) -> pa.ChunkedArray:
    """The same with dictionaries in order of appearance, which hang neither on categories nor on chunks."""
    if not pa.types.is_dictionary(kind):
        return column.cast(kind)
    return pa.chunked_array(column.cast(kind.value_type).combine_chunks().dictionary_encode())


def write_stream(path: Path, parts: Iterable[pa.Table], schema: Schema, provenance: Provenance) -> int:
    """Write a Parquet table whose parts come one by one, each as a row group of its own.

    Like ``write``, it is whole or it is not there, whatever the parts raise on their way. The digest is known when all
    have come: it stands in the file's metadata, but not in those of its Arrow schema. Each part holds the rules.

    Returns:
        how many rows it has.
    """
    rows, content = 0, Content(schema.columns)

    def write_parts(temporary: Path) -> None:
        nonlocal rows
        columns = schema.columns.with_metadata(provenance.metadata())
        with pq.ParquetWriter(temporary, columns, compression="zstd") as writer:
            for part in _read(parts):
                writer.write_table(part)
                schema.check(part.to_pandas(), path)
                content.add(part)
                rows += part.num_rows
            writer.add_key_value_metadata({CONTENT: content.digest()})

    atomically(path, write_parts)
    return rows


def _read(parts: Iterable[pa.Table]) -> Iterator[pa.Table]:
    """Parts as they come; a fault in reading what they are made of is none in writing."""
    try:
        yield from parts
    except OSError as error:
        raise InputError(error.filename or "its source", "", f"cannot be read ({error.strerror or error})") from error


def read_tensors(path: Path, names: Sequence[str], provenance: Provenance | None = None) -> dict[str, Tensor]:
    """Read named tensors of a safetensors file, all of whose numbers must be finite.

    Raises:
        InputError: where the file is missing or broken, lacks a tensor, or its values are not those that were written.
    """
    whole = provenance is None or (path.exists() and provenance.to_check(path))
    tensors, metadata = opened_tensors(path, None if whole else names)
    if not set(names) <= set(tensors):
        raise InputError(path, f"tensor {min(set(names) - set(tensors))!r}", "missing")
    if whole:
        check_finite(path, tensors)
        check_content(path, metadata, digest_of_tensors(tensors))
    if provenance:
        provenance.checked(path)
        provenance.seen(path, metadata)
    return {name: tensors[name] for name in names}


def opened_tensors(path: Path, names: Iterable[str] | None = None) -> tuple[dict[str, Tensor], Metadata]:
    """Those of the named tensors (null: all) that a file has, unchecked, and its metadata."""
    with _tensors_of(path) as file:
        there = file.keys()
        wanted = there if names is None else set(names) & set(there)
        return {name: file.get_tensor(name) for name in wanted}, file.metadata() or {}


@contextmanager
def _tensors_of(path: Path) -> Iterator[Any]:
    """A safetensors file, opened."""
    from safetensors import SafetensorError, safe_open  # here, since it loads torch

    try:
        with safe_open(path, framework="pt") as file:
            yield file
    except FileNotFoundError as error:
        raise absent(path) from error
    except (OSError, SafetensorError) as error:
        raise InputError(path, "", f"expected a safetensors file ({_first_line(error)})") from error


def shape_of(path: Path, name: str) -> tuple[int, ...]:
    """The shape of a tensor of a safetensors file.

    Raises:
        InputError: where the file is missing or broken, or lacks it.
    """
    with _tensors_of(path) as file:
        if name not in file.keys():  # noqa: SIM118 it is no mapping
            raise InputError(path, f"tensor {name!r}", "missing")
        return tuple(file.get_slice(name).get_shape())


def write_tensors(path: Path, tensors: Mapping[str, Tensor], provenance: Provenance) -> None:
    """Write a safetensors file through a temporary file.

    Raises:
        InputError: where a number is not finite.
    """
    check_finite(path, tensors)
    write_tensors_with(path, tensors, provenance.metadata())


def write_tensors_with(path: Path, tensors: Mapping[str, Tensor], metadata: Metadata) -> None:
    """The same with metadata, and the digest of the tensors."""
    from safetensors.torch import save

    whole = {name: tensor.contiguous() for name, tensor in tensors.items()}
    content = _in_order(save(whole, metadata={**metadata, CONTENT: digest_of_tensors(whole)}))
    atomically(path, lambda temporary: temporary.write_bytes(content))


def check_finite(path: Path, tensors: Mapping[str, Tensor]) -> None:
    for name, tensor in sorted(tensors.items()):
        try:
            numbers = tensor.numpy()
        except TypeError as error:
            raise InputError(path, f"tensor {name!r}", f"expected a type that NumPy has, got {tensor.dtype}") from error
        if tensor.is_floating_point() and (place := first_not_finite(numbers)) is not None:
            raise InputError(path, f"tensor {name!r}, {list(place)}", "expected finite numbers")


def _in_order(content: bytes) -> bytes:
    """A safetensors file with the keys of its header in order: safetensors writes those of metadata in any."""
    end = 8 + int.from_bytes(content[:8], "little")
    header = json.dumps(json.loads(content[8:end]), sort_keys=True, separators=(",", ":")).encode()
    return content[:8] + header.ljust(end - 8) + content[end:]


def atomically(path: Path, write_to: Callable[[Path], object]) -> None:
    """Let a function write to a temporary name beside the path, then replace the path.

    Raises:
        InputError: where the path has no name, such as ``.``.
        InputError: where the disk is full, read-only, or refuses otherwise; what was there stays.
    """
    if path.name in ("", ".."):
        raise InputError(path, "", "expected the name of a file")
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for stale in path.parent.glob(f".{glob.escape(path.name)}.*.tmp"):  # of a stage that was killed
            if not lives(stale.name.split(".")[-2]):
                stale.unlink()
        write_to(temporary)
        temporary.replace(path)
    except OSError as error:
        if error.errno is None or (error.filename and Path(error.filename).name not in {temporary.name, *path.parts}):
            raise  # of what was to be written, not of writing it
        raise unwritable(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def keep_only(folder: Path, kept: Sequence[Path]) -> None:
    """Remove the files of a folder that are not among those to keep (of an earlier run, or killed)."""
    for path in set(folder.glob("*")) | set(folder.glob(".*.tmp")):
        if path not in kept and path.is_file():
            path.unlink()


def _same_values(actual: pa.DataType, expected: pa.DataType) -> bool:
    plain = [kind.value_type if pa.types.is_dictionary(kind) else kind for kind in (actual, expected)]
    return bool(plain[0] == plain[1]) or all(pa.types.is_string(k) or pa.types.is_large_string(k) for k in plain)


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
