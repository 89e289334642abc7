"""The tables and tensors of the pipeline: their schemas, checked reads and atomic writes."""

from __future__ import annotations

import glob
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from isi.base.errors import InputError, Unwritable
from isi.base.lifetime import lives
from isi.base.pipeline import absent

if TYPE_CHECKING:
    from torch import Tensor

_NAME = pa.dictionary(pa.int32(), pa.string())
_MEASURES = [("mrr_star", pa.float64()), ("mrr_star_entity", pa.float64()),
             ("mrr_star_relation", pa.float64()), ("mrr", pa.float64())]  # fmt: skip

OBSERVATIONS = pa.schema([("scene", _NAME), ("room", _NAME), ("instance", pa.string()),
                          ("head", _NAME), ("relation", _NAME), ("tail", _NAME), ("count", pa.int32())])  # fmt: skip
#: Entities of a source, and how many instances each step of mining it left.
KINDS = pa.schema([("entity", pa.string()), ("kind", _NAME), ("phrase", pa.string())])
MINED = pa.schema([("step", pa.string()), ("instances", pa.int64())])
ENTITIES = pa.schema([("entity", pa.string()), ("kind", _NAME), ("source", _NAME), ("phrase", pa.string())])
TRIPLES = pa.schema([("head", _NAME), ("relation", _NAME), ("tail", _NAME), ("count", pa.int32()), ("source", _NAME)])
COVERAGE = pa.schema([("entity", pa.string()), ("phrase", pa.string()), ("served_by", pa.string())])
SPLITS = pa.schema([("seed", pa.int32()), ("triple", pa.int32()), ("split", _NAME)])
#: ``session``: the one that inserts the entity, from 1; Θ⁰ is learned in session 0.
NOVEL = pa.schema([("size", pa.int32()), ("seed", pa.int32()), ("entity", pa.int32()), ("session", pa.int32())])
INSERT_TRIPLES = pa.schema([("size", pa.int32()), ("seed", pa.int32()), ("entity", pa.int32()), ("triple", pa.int32()),
                            ("session", pa.int32())])  # fmt: skip
TRAINING_LOG = pa.schema([("size", pa.int32()), ("seed", pa.int32()), ("epoch", pa.int32()),
                          *_MEASURES, ("kept", pa.bool_())])  # fmt: skip
#: ``queries`` counts triples, of each of which head, tail and relation are asked for.
RUNS = pa.schema([("size", pa.int32()), ("seed", pa.int32()), ("epoch", pa.int32()), ("scope", _NAME),
                  *_MEASURES, ("queries", pa.int32()), ("session", pa.int32())])  # fmt: skip
#: One row per inserted entity: its own queries of scope ``novel`` at once, and what it fell back to.
INSERTED = pa.schema([("size", pa.int32()), ("seed", pa.int32()), ("entity", pa.int32()), ("kind", _NAME),
                      ("fallback", _NAME), *_MEASURES, ("queries", pa.int32()), ("ties", pa.int32()),
                      ("session", pa.int32())])  # fmt: skip
#: Runs with indicator sets of several sizes, and at multiples of the fine-tuning rate.
INDICATOR_SWEEP = pa.schema([("k", pa.int32()), *RUNS])
RATE_SWEEP = pa.schema([("factor", pa.float64()), *RUNS])
#: One row per setting and fold: the best look at the fold held out.
CROSS_VALIDATION = pa.schema([("dimension", pa.int32()), ("ratio", pa.int32()), ("learning_rate", pa.float64()),
                              ("weight_decay", pa.float64()), ("fold", pa.int32()),
                              *_MEASURES, ("epoch", pa.int32())])  # fmt: skip
#: Measures of the joint model of each embedding family.
FAMILIES = pa.schema([("seed", pa.int32()), ("epochs", pa.int32()), *_MEASURES, ("valid_mrr_star", pa.float64()),
                      ("queries", pa.int32())])  # fmt: skip
#: Rank of each answer to (entity, relation, ?) right after insertion.
AFFORDANCES = pa.schema(
    [("initializer", _NAME), ("seed", pa.int32()), ("entity", pa.int32()), ("answer", pa.int32()), ("rank", pa.int32())]
)
#: Queries right after insertion, grouped by what is asked; MRR* and MRR are means over them. ``filter``: ``learned``,
#: the scope's own, or ``true``, all true triples. ``hidden``: the slot that is asked for (head, relation, tail).
#: ``novel``: where a novel entity is (``given``, hidden as the ``answer``, ``both``, ``none``). ``observations``: the
#: relation's in D¹, its weight in equation 7.
ASKED = pa.schema([("size", pa.int32()), ("seed", pa.int32()), ("session", pa.int32()), ("model", _NAME),
                   ("scope", _NAME), ("filter", _NAME), ("relation", _NAME), ("hidden", _NAME), ("novel", _NAME),
                   ("queries", pa.int32()), ("mrr_star", pa.float64()), ("mrr", pa.float64()),
                   ("observations", pa.int64())])  # fmt: skip
#: Runs of each model of experiments under other conditions, the joint model's among them, and their answers at once.
VARIANTS = pa.schema([("experiment", _NAME), ("model", _NAME), *RUNS])
VARIANTS_ASKED = pa.schema([("experiment", _NAME), *ASKED])
#: Coordinates of relations that are not zero: of each relation, and (null) of any of them.
USED = pa.schema([("seed", pa.int32()), ("model", _NAME), ("relation", _NAME), ("part", _NAME),
                  ("used", pa.int32()), ("of", pa.int32())])  # fmt: skip
#: Rivals whose score is tied with the answer's, at epoch 0.
TIES = pa.schema([("size", pa.int32()), ("seed", pa.int32()), ("scope", _NAME), ("ties", pa.int32()),
                  ("session", pa.int32())])  # fmt: skip


@dataclass
class Provenance:
    """What a stage's outputs were made from: goes into the metadata of each of them."""

    stage: str
    params: Mapping[str, Any]
    inputs: set[str] = field(default_factory=set)

    def metadata(self) -> dict[str, str]:
        """Stage and hash of the params that shape its outputs, its inputs' params included."""
        text = json.dumps([self.stage, self.params, sorted(self.inputs)], sort_keys=True)
        return {"isi.stage": self.stage, "isi.params": hashlib.sha256(text.encode()).hexdigest()}

    def seen(self, metadata: Mapping[str, str] | None) -> None:
        """Note an input by its own hash."""
        self.inputs.add((metadata or {}).get("isi.params", ""))


def read(path: Path, schema: pa.Schema, provenance: Provenance | None = None) -> pd.DataFrame:
    """Read a Parquet table whose columns must be those of the schema.

    Raises:
        InputError: where the file is missing or broken, or a column is missing or of another type.
    """
    try:
        table = pq.read_table(path)
    except FileNotFoundError as error:
        raise absent(path) from error
    except (OSError, pa.ArrowException) as error:
        raise InputError(path, "", f"expected a Parquet table ({_first_line(error)})") from error
    for expected in schema:
        place = table.schema.get_field_index(expected.name)
        if place < 0:
            raise InputError(path, f"column {expected.name!r}", "missing")
        if not _same_values(table.schema.field(place).type, expected.type):
            got = table.schema.field(place).type
            raise InputError(path, f"column {expected.name!r}", f"expected {expected.type}, got {got}")
    if provenance:
        provenance.seen({k.decode(): v.decode() for k, v in (table.schema.metadata or {}).items()})
    frame: pd.DataFrame = table.select(schema.names).to_pandas()
    return frame


def read_text(path: Path, schema: pa.Schema) -> pd.DataFrame:
    """Like ``read``, with text in place of categories."""
    return as_text(read(path, schema))


def as_text(frame: pd.DataFrame) -> pd.DataFrame:
    """The same with plain text in place of categories."""
    return frame.astype(dict.fromkeys(frame.select_dtypes("category").columns, str))


def together(parts: Iterable[pd.DataFrame], *schemas: pa.Schema) -> pd.DataFrame:
    """Parts of a table behind each other; without any, a table without rows that has the columns of the schemas."""
    listed = list(parts)
    names = dict.fromkeys(name for schema in schemas for name in schema.names)
    return pd.concat(listed) if listed else pd.DataFrame({name: pd.Series(dtype=object) for name in names})


def write(path: Path, frame: pd.DataFrame, schema: pa.Schema, provenance: Provenance) -> None:
    """Write a Parquet table through a temporary file: it is whole or it is not there."""
    whole = pa.Table.from_pandas(frame, schema=schema, preserve_index=False)
    columns = [_as_first_seen(column) for column in whole.columns]
    write_stream(path, [pa.Table.from_arrays(columns, schema=schema)], schema, provenance)


def _as_first_seen(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """The same with dictionaries in order of appearance, which hang neither on categories nor on chunks."""
    if not pa.types.is_dictionary(column.type):
        return column
    return pa.chunked_array(column.cast(column.type.value_type).combine_chunks().dictionary_encode())


def write_stream(path: Path, parts: Iterable[pa.Table], schema: pa.Schema, provenance: Provenance) -> int:
    """Write a Parquet table whose parts come one by one, each as a row group of its own.

    Like ``write``, it is whole or it is not there, whatever the parts raise on their way.

    Returns:
        how many rows it has.
    """
    schema = schema.with_metadata(provenance.metadata())
    rows = 0

    def write_parts(temporary: Path) -> None:
        nonlocal rows
        with pq.ParquetWriter(temporary, schema, compression="zstd") as writer:
            for part in parts:
                writer.write_table(part)
                rows += part.num_rows

    atomically(path, write_parts)
    return rows


def read_tensors(path: Path, names: Sequence[str], provenance: Provenance | None = None) -> dict[str, Tensor]:
    """Read named tensors of a safetensors file.

    Raises:
        InputError: where the file is missing or broken, or lacks a tensor.
    """
    from safetensors import SafetensorError, safe_open  # here, since it loads torch

    try:
        with safe_open(path, framework="pt") as file:
            missing = set(names) - set(file.keys())
            if missing:
                raise InputError(path, f"tensor {min(missing)!r}", "missing")
            if provenance:
                provenance.seen(file.metadata())
            return {name: file.get_tensor(name) for name in names}
    except FileNotFoundError as error:
        raise absent(path) from error
    except (OSError, SafetensorError) as error:
        raise InputError(path, "", f"expected a safetensors file ({_first_line(error)})") from error


def write_tensors(path: Path, tensors: Mapping[str, Tensor], provenance: Provenance) -> None:
    """Write a safetensors file through a temporary file."""
    from safetensors.torch import save

    content = _in_order(save({name: t.contiguous() for name, t in tensors.items()}, metadata=provenance.metadata()))
    atomically(path, lambda temporary: temporary.write_bytes(content))


def _in_order(content: bytes) -> bytes:
    """A safetensors file with the keys of its header in order: safetensors writes those of metadata in any."""
    end = 8 + int.from_bytes(content[:8], "little")
    header = json.dumps(json.loads(content[8:end]), sort_keys=True, separators=(",", ":")).encode()
    return content[:8] + header.ljust(end - 8) + content[end:]


def atomically(path: Path, write_to: Callable[[Path], object]) -> None:
    """Let a function write to a temporary name beside the path, then replace the path.

    Raises:
        Unwritable: where the disk is full, read-only, or refuses otherwise; what was there stays.
    """
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
        raise Unwritable(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def keep_only(folder: Path, kept: Sequence[Path]) -> None:
    """Remove the files of a folder that are not among those to keep (of an earlier run, or killed)."""
    for path in set(folder.glob("*")) | set(folder.glob(".*.tmp")):
        if path not in kept and path.is_file():
            path.unlink()


def _same_values(actual: pa.DataType, expected: pa.DataType) -> bool:
    plain = [t.value_type if pa.types.is_dictionary(t) else t for t in (actual, expected)]
    return bool(plain[0] == plain[1])


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
