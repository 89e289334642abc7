"""Declarations of the tables and tensor files of a pipeline, which read and write them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from isi.tables import io
from isi.tables.rules import ColumnType, Rule, ascending, refuse, unique

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa
    from torch import Tensor


@dataclass(frozen=True, eq=False)
class DataFile:
    """Files with one template of their path, such as ``data/runs/{experiment}/{model}.parquet``;
    names complete it.
    """

    template: str

    def path(self, **names: str | int) -> Path:
        """The template completed by ``names``: a path relative to the folder of ``dvc.yaml``."""
        return Path(self.template.format(**names))


@dataclass(frozen=True, eq=False)
class Table(DataFile):
    """A Parquet table: its path, its columns in order, and the rules for its rows."""

    columns: Mapping[str, ColumnType]
    #: no two rows agree in these columns; rows ascend in them if ``ordered``
    key: Sequence[str] = ()
    ordered: bool = False
    checks: Sequence[Rule] = ()  #: in addition to the rules of columns and key

    @cached_property
    def schema(self) -> pa.Schema:
        # here, since it loads pyarrow, which few commands need
        from isi.tables.parquet import schema_of

        return schema_of(self.columns)

    def check(self, frame: pd.DataFrame, path: Path) -> None:
        """Check all rules; InputError names the first row (from 0) that breaks one,
        and the rule.
        """
        of_columns = [rule for name, column in self.columns.items() for rule in column.rules(name)]
        of_key = [(ascending if self.ordered else unique)(*self.key)] if self.key else []
        for rule in (*of_columns, *self.checks, *of_key):
            refuse(path, frame, rule.broken(frame), rule.columns, rule.expected)

    def read(self, **names: str | int) -> pd.DataFrame:
        """Read the table at ``path(**names)``, dictionary-encoded text as categories;
        InputError for a broken rule.
        """
        return self.read_file(self.path(**names))

    def read_text(self, **names: str | int) -> pd.DataFrame:
        """Like ``read``, with plain strings in place of categories."""
        return as_text(self.read(**names))

    def read_file(self, path: Path) -> pd.DataFrame:
        """Like ``read``, from any path."""
        from isi.tables import parquet

        frame: pd.DataFrame = parquet.read(path, self.schema).to_pandas()
        self.check(frame, path)
        return frame

    def write(self, frame: pd.DataFrame, stage: str, **names: str | int) -> None:
        """Check and write the table's columns of a frame, sorted by key if ``ordered``;
        metadata: ``stage``.
        """
        self.write_file(self.path(**names), frame, stage)

    def write_file(self, path: Path, frame: pd.DataFrame, stage: str) -> None:
        """Like ``write``, to any path."""
        frame = frame.sort_values(list(self.key)) if self.ordered else frame
        self.write_parts(path, [frame], stage)

    def write_parts(self, path: Path, parts: Iterable[pd.DataFrame], stage: str) -> int:
        """Check each part by itself, and write it as a row group;
        return the number of rows of all parts.
        """
        from isi.tables import parquet

        rows = 0

        def checked() -> Iterator[pa.Table]:
            nonlocal rows
            for part in parts:
                table = parquet.table_of(part, self.schema)
                self.check(table.to_pandas(), path)
                rows += table.num_rows
                yield table

        parquet.write(path, checked(), self.schema, stage)
        return rows


@dataclass(frozen=True, eq=False)
class TensorFile(DataFile):
    """A safetensors file; all numbers in it are finite."""

    def read(self, tensors: Sequence[str], **names: str | int) -> dict[str, Tensor]:
        """Read ``tensors`` from the file whose path ``names`` complete (``io.read_tensors``)."""
        return io.read_tensors(self.path(**names), tensors)

    def read_file(self, path: Path) -> dict[str, Tensor]:
        return io.read_tensors(path)

    def write(self, tensors: Mapping[str, Tensor], stage: str, **names: str | int) -> None:
        """Write the file whose path ``names`` complete, atomically;
        ``InputError`` where a number is not finite.
        """
        io.write_tensors(self.path(**names), tensors, stage)


def as_text(frame: pd.DataFrame) -> pd.DataFrame:
    """The same rows, with categorical columns as plain strings."""
    return frame.astype(dict.fromkeys(frame.select_dtypes("category").columns, str))


def concat(parts: Iterable[pd.DataFrame], *tables: Table) -> pd.DataFrame:
    """Concatenate ``parts``; without parts, return an empty frame with
    the columns of ``tables``.
    """
    import pandas as pd

    frames = list(parts)
    names = dict.fromkeys(name for table in tables for name in table.columns)
    return (
        pd.concat(frames)
        if frames
        else pd.DataFrame({name: pd.Series(dtype=object) for name in names})
    )
