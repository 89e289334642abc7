"""Tables and tensors on disk: the catalogue, checked reads and atomic writes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from safetensors import safe_open

from isi.errors import InputError
from isi.tables import io
from isi.tables.rules import ArrowType
from isi.tables.table import Table, concat
from stages.files import ENTITIES, KINDS, NOVEL, TRIPLES
from stages.store import MEASURE_CHANGES, RUNS
from tests.example_tables import ROWS, rows_of

MADE = "some_stage"


def plain(table: pd.DataFrame) -> list[tuple[Any, ...]]:
    return list(table.astype(object).where(table.notna(), None).itertuples(index=False, name=None))


def novel(path: Path) -> Path:
    row = pd.DataFrame({"size": [1], "seed": [0], "entity": [4]})
    NOVEL.write_file(path, row, MADE)
    return path


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


# Tables


@pytest.mark.parametrize("table", ROWS, ids=lambda table: table.template)
def test_a_table_comes_back_as_it_was_written(tmp_path: Path, table: Table) -> None:
    path = tmp_path / "table.parquet"
    table.write_file(path, rows_of(table).sample(frac=1, axis=1, random_state=0), MADE)
    read = table.read_file(path)
    assert list(read.columns) == list(table.columns)
    assert plain(read) == plain(rows_of(table))
    assert set(read.select_dtypes("number").dtypes.astype(str)) <= {"int32", "int64", "float64"}


def test_the_examples_have_every_type_with_and_without_nulls() -> None:
    """Stages write all other tables; their columns are of the same types."""
    columns = [column for table in ROWS for column in table.columns.values()]
    assert {column.type for column in columns} == {*get_args(ArrowType)}
    nullable = {column.type for column in columns if column.nullable}
    assert nullable >= {"string", "category", "float64"}


@pytest.mark.parametrize("cut", [0, 1, 3])
@pytest.mark.parametrize("kind", ["str", "category"])
def test_bytes_do_not_depend_on_chunks_or_categories(tmp_path: Path, cut: int, kind: str) -> None:
    kinds = ["room", "object", "room", "material"]
    rows = pd.DataFrame({"entity": list("abcd"), "kind": kinds, "source": "x", "phrase": "y"})
    parts = [rows[:cut].astype({"kind": kind}), rows[cut:].astype({"kind": kind})]
    ENTITIES.write_file(tmp_path / "whole.parquet", rows, MADE)
    ENTITIES.write_file(tmp_path / "parts.parquet", pd.concat(parts), MADE)
    assert (tmp_path / "parts.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()
    assert plain(ENTITIES.read_file(tmp_path / "parts.parquet")) == list(
        rows.itertuples(index=False, name=None)
    )


def test_a_table_may_hold_plain_strings_and_more_columns(tmp_path: Path) -> None:
    plain_strings = pa.table(
        {"more": [1], "entity": ["mug"], "kind": ["object"], "source": ["x"], "phrase": ["mug"]}
    )
    pq.write_table(plain_strings, tmp_path / "entities.parquet")
    assert plain(ENTITIES.read_file(tmp_path / "entities.parquet")) == [
        ("mug", "object", "x", "mug")
    ]


def part(*entities: str) -> pd.DataFrame:
    return pd.DataFrame(dict.fromkeys(KINDS.columns, entities))


def test_a_stream_is_one_row_group_a_part_and_reads_as_the_whole_would(tmp_path: Path) -> None:
    parts = [part("mug", "bed"), part("cup", "sofa", "fan"), part("tap")]
    assert KINDS.write_parts(tmp_path / "t.parquet", iter(parts), MADE) == 6
    file = pq.ParquetFile(tmp_path / "t.parquet")
    assert [file.metadata.row_group(place).num_rows for place in range(file.num_row_groups)] == [
        2,
        3,
        1,
    ]
    KINDS.write_file(tmp_path / "whole.parquet", pd.concat(parts), MADE)
    whole = KINDS.read_file(tmp_path / "whole.parquet")
    pd.testing.assert_frame_equal(KINDS.read_file(tmp_path / "t.parquet"), whole)
    assert pq.read_schema(tmp_path / "t.parquet") == pq.read_schema(tmp_path / "whole.parquet")


def test_without_parts_a_table_has_no_rows(tmp_path: Path) -> None:
    assert KINDS.write_parts(tmp_path / "t.parquet", [], MADE) == 0
    assert list(KINDS.read_file(tmp_path / "t.parquet").columns) == list(KINDS.columns)
    nothing = concat([], RUNS, MEASURE_CHANGES)
    for table in (RUNS, MEASURE_CHANGES):
        table.write_file(tmp_path / "t.parquet", nothing, MADE)
        read = table.read_file(tmp_path / "t.parquet")
        assert (len(read), list(read.columns)) == (0, list(table.columns))


# Metadata


def test_metadata_names_the_stage_and_nothing_else(tmp_path: Path) -> None:
    io.write_tensors(tmp_path / "t.safetensors", {"entity": torch.zeros(1)}, MADE)
    with safe_open(tmp_path / "t.safetensors", framework="pt") as file:
        assert file.metadata() == {"isi.stage": MADE}
    assert pq.read_schema(novel(tmp_path / "t.parquet")).metadata == {b"isi.stage": MADE.encode()}


def test_equal_tensors_are_equal_bytes(tmp_path: Path) -> None:
    for place in range(20):
        io.write_tensors(tmp_path / str(place), {"b": torch.ones(2), "a": torch.zeros(2)}, MADE)
    assert len({path.read_bytes() for path in tmp_path.iterdir()}) == 1


# Refusals


def test_a_missing_column_and_a_missing_tensor_are_named(tmp_path: Path) -> None:
    pq.write_table(
        pa.table({"size": pa.array([1], pa.int32()), "seed": pa.array([1], pa.int32())}),
        tmp_path / "t",
    )
    with pytest.raises(InputError, match=rf"{tmp_path / 't'}: column 'entity': missing"):
        NOVEL.read_file(tmp_path / "t")
    io.write_tensors(tmp_path / "t.safetensors", {"entity": torch.zeros(1)}, MADE)
    with pytest.raises(InputError, match=r"t\.safetensors: tensor 'relation': missing"):
        io.read_tensors(tmp_path / "t.safetensors", ["entity", "relation"])


@pytest.mark.parametrize(
    ("column", "kind", "content"),
    [
        ("count", "int64", [1]),
        ("count", "double", [1.0]),
        ("count", "string", ["1"]),
        ("head", "int32", [1]),
    ],
)
def test_a_column_of_another_type_is_named_with_both_types(
    tmp_path: Path, column: str, kind: str, content: list[Any]
) -> None:
    TRIPLES.write_file(tmp_path / "t.parquet", rows_of(TRIPLES)[:1], MADE)
    table = pq.read_table(tmp_path / "t.parquet")
    place = table.schema.get_field_index(column)
    pq.write_table(
        table.set_column(place, column, pa.array(content, pa.type_for_alias(kind))),
        tmp_path / "t.parquet",
    )
    with pytest.raises(
        InputError, match=rf"t\.parquet: column '{column}': expected .*(int32|string).*, got {kind}"
    ):
        TRIPLES.read_file(tmp_path / "t.parquet")


# Tensors


def test_tensors_come_back_as_they_were_written_even_views(tmp_path: Path) -> None:
    path = tmp_path / "size=01.safetensors"
    entity = torch.arange(12.0).reshape(3, 4).T
    io.write_tensors(path, {"entity": entity, "known": torch.tensor([True, False])}, MADE)
    read = io.read_tensors(path, ["known", "entity"])
    assert list(read) == ["known", "entity"]
    assert torch.equal(read["entity"], entity)
    assert read["known"].tolist() == [True, False]


# Writes


def test_a_stream_that_breaks_off_leaves_the_old_table_and_nothing_else(tmp_path: Path) -> None:
    before = novel(tmp_path / "t.parquet").read_bytes()

    def parts(last: pd.DataFrame | None) -> Iterator[pd.DataFrame]:
        yield part("mug")
        assert len(names(tmp_path)) == 2
        if last is None:
            raise InputError("recording.json", "FloorPlan9", "broken")
        yield last

    for last, refused in ((None, InputError), (pd.DataFrame({"entity": ["mug"]}), KeyError)):
        with pytest.raises(refused):
            KINDS.write_parts(tmp_path / "t.parquet", parts(last), MADE)
        assert (tmp_path / "t.parquet").read_bytes() == before
        assert names(tmp_path) == ["t.parquet"]


def test_tensors_that_cannot_be_written_leave_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "t.safetensors"
    io.write_tensors(path, {"entity": torch.ones(3)}, MADE)
    with pytest.raises(
        InputError, match=r"tensor 'entity': expected a type that NumPy has, got torch\.bfloat16"
    ):
        io.write_tensors(path, {"entity": torch.ones(3).bfloat16()}, MADE)
    assert torch.equal(io.read_tensors(path, ["entity"])["entity"], torch.ones(3))
    assert names(tmp_path) == ["t.safetensors"]


def test_keep_only_removes_files_of_earlier_and_killed_runs_but_no_folder(tmp_path: Path) -> None:
    for name in (
        "size=01.safetensors",
        "size=02.safetensors",
        "size=10.safetensors",
        ".size=01.safetensors.7.tmp",
    ):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "folder").mkdir()
    io.keep_only(tmp_path, [tmp_path / "size=01.safetensors", tmp_path / "size=02.safetensors"])
    assert names(tmp_path) == ["folder", "size=01.safetensors", "size=02.safetensors"]
