"""Tables and tensors on disk: schemas, provenance, checked reads and atomic writes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch

from isi.errors import InputError
from isi.tables import catalogue, io
from isi.tables.content import digest_of_table
from isi.tables.provenance import Provenance
from tests.lawful import SCHEMAS, lawful

MADE = Provenance("some_stage", {"experiments.home.graph": 1})


def plain(table: pd.DataFrame) -> list[tuple[Any, ...]]:
    return list(table.astype(object).where(table.notna(), None).itertuples(index=False, name=None))


def novel(path: Path, provenance: Provenance = MADE) -> Path:
    row = pd.DataFrame({"size": [1], "seed": [0], "entity": [4], "session": [1]})
    io.write(path, row, catalogue.NOVEL, provenance)
    return path


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


# Tables


@pytest.mark.parametrize("name", SCHEMAS)
def test_a_table_comes_back_as_it_was_written(tmp_path: Path, name: str) -> None:
    path, schema = tmp_path / "table.parquet", SCHEMAS[name]
    io.write(path, lawful(name).sample(frac=1, axis=1, random_state=0), schema, MADE)
    read = io.read(path, schema)
    assert list(read.columns) == schema.names
    assert plain(read) == plain(lawful(name))
    assert set(read.select_dtypes("number").dtypes.astype(str)) <= {"int32", "int64", "float64"}


@pytest.mark.parametrize(
    ("name", "repeated"),
    [
        ("OBSERVATIONS", {"scene", "room", "head", "relation", "tail"}),
        ("KINDS", {"kind"}),
        ("ENTITIES", {"kind", "source"}),
        ("TRIPLES", {"head", "relation", "tail", "source"}),
        ("SPLITS", {"split"}),
        ("RUNS", {"scope"}),
    ],
)
def test_strings_that_repeat_are_dictionary_encoded_on_disk(tmp_path: Path, name: str, repeated: set[str]) -> None:
    io.write(tmp_path / "table.parquet", lawful(name), SCHEMAS[name], MADE)
    on_disk = pq.read_schema(tmp_path / "table.parquet")
    assert {field.name for field in on_disk if pa.types.is_dictionary(field.type)} == repeated


@pytest.mark.parametrize("cut", [0, 1, 3])
@pytest.mark.parametrize("kind", ["str", "category"])
def test_bytes_hang_on_no_chunks_and_on_no_categories(tmp_path: Path, cut: int, kind: str) -> None:
    kinds = ["room", "object", "room", "material"]
    rows = pd.DataFrame({"entity": list("abcd"), "kind": kinds, "source": "x", "phrase": "y"})
    parts = [rows[:cut].astype({"kind": kind}), rows[cut:].astype({"kind": kind})]
    io.write(tmp_path / "whole.parquet", rows, catalogue.ENTITIES, MADE)
    io.write(tmp_path / "parts.parquet", pd.concat(parts), catalogue.ENTITIES, MADE)
    assert (tmp_path / "parts.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()
    assert plain(io.read(tmp_path / "parts.parquet", catalogue.ENTITIES)) == list(
        rows.itertuples(index=False, name=None)
    )


def test_a_table_may_hold_plain_strings_and_more_columns(tmp_path: Path) -> None:
    plain_strings = pa.table({"more": [1], "entity": ["mug"], "kind": ["object"], "source": ["x"], "phrase": ["mug"]})
    stated = {"isi.content": digest_of_table(plain_strings, catalogue.ENTITIES.columns)}
    pq.write_table(plain_strings.replace_schema_metadata(stated), tmp_path / "entities.parquet")
    assert plain(io.read(tmp_path / "entities.parquet", catalogue.ENTITIES)) == [("mug", "object", "x", "mug")]


def part(*entities: str) -> pa.Table:
    kinds = pa.array(entities, catalogue.KINDS.columns.field("kind").type)
    return pa.Table.from_arrays([pa.array(entities), kinds, pa.array(entities)], schema=catalogue.KINDS.columns)


def test_a_stream_is_one_row_group_a_part_and_reads_as_the_whole_would(tmp_path: Path) -> None:
    parts = [part("mug", "bed"), part("cup", "sofa", "fan"), part("tap")]
    assert io.write_stream(tmp_path / "t.parquet", iter(parts), catalogue.KINDS, MADE) == 6
    file = pq.ParquetFile(tmp_path / "t.parquet")
    assert [file.metadata.row_group(place).num_rows for place in range(file.num_row_groups)] == [2, 3, 1]
    io.write(tmp_path / "whole.parquet", pa.concat_tables(parts).to_pandas(), catalogue.KINDS, MADE)
    whole = io.read(tmp_path / "whole.parquet", catalogue.KINDS)
    pd.testing.assert_frame_equal(io.read(tmp_path / "t.parquet", catalogue.KINDS), whole)
    assert pq.read_schema(tmp_path / "t.parquet") == pq.read_schema(tmp_path / "whole.parquet")


def test_a_stream_of_nothing_is_an_empty_table(tmp_path: Path) -> None:
    assert io.write_stream(tmp_path / "t.parquet", [], catalogue.KINDS, MADE) == 0
    assert list(io.read(tmp_path / "t.parquet", catalogue.KINDS).columns) == catalogue.KINDS.names


def test_equal_streams_are_equal_bytes(tmp_path: Path) -> None:
    for name in ("1", "2"):
        io.write_stream(tmp_path / name, [part("mug"), part("bed")], catalogue.KINDS, in_order(1))
    assert (tmp_path / "1").read_bytes() == (tmp_path / "2").read_bytes()


def test_no_parts_of_a_table_are_a_table_without_rows(tmp_path: Path) -> None:
    nothing = io.together([], catalogue.RUNS, catalogue.TIES)
    for schema in (catalogue.RUNS, catalogue.TIES):
        io.write(tmp_path / "t.parquet", nothing, schema, MADE)
        read = io.read(tmp_path / "t.parquet", schema)
        assert (len(read), list(read.columns)) == (0, schema.names)


def test_parts_of_a_table_come_behind_each_other() -> None:
    parts = [lawful("NOVEL")[:1], lawful("NOVEL")[1:]]
    assert plain(io.together(iter(parts), catalogue.NOVEL)) == plain(lawful("NOVEL"))


# Provenance


def test_metadata_names_stage_params_inputs_and_content_and_nothing_of_pandas(tmp_path: Path) -> None:
    novel(tmp_path / "1.parquet")
    second = Provenance("second", {})
    read = io.read(tmp_path / "1.parquet", catalogue.NOVEL, second)
    io.write(tmp_path / "2.parquet", read, catalogue.NOVEL, second)
    metadata = {key.decode(): value.decode() for key, value in pq.read_schema(tmp_path / "2.parquet").metadata.items()}
    assert set(metadata) == {"isi.stage", "isi.own", "isi.params", "isi.inputs", "isi.content"}
    assert metadata["isi.stage"] == "second"
    assert {len(metadata[f"isi.{key}"]) for key in ("own", "params", "content")} == {64}
    assert json.loads(metadata["isi.inputs"]) == {(tmp_path / "1.parquet").as_posix(): metadata["isi.content"]}


def in_order(step: int) -> Provenance:
    """One provenance, its params and inputs met in one order or the other."""
    made = Provenance("stage", dict([("seed", 0), ("sessions.sizes", [1, 5])][::step]))
    for name in ["aa", "bb"][::step]:
        made.seen(Path(name), {"isi.params": name, "isi.content": name})
    return made


def test_equal_params_give_equal_bytes_of_tables_in_whatever_order_params_and_inputs_came(tmp_path: Path) -> None:
    assert novel(tmp_path / "1", in_order(1)).read_bytes() == novel(tmp_path / "2", in_order(-1)).read_bytes()


def test_equal_params_give_equal_bytes_of_tensors_every_time(tmp_path: Path) -> None:
    written = set()
    for time in range(20):
        path = tmp_path / str(time)
        io.write_tensors(path, {"b": torch.ones(2), "a": torch.zeros(2)}, in_order(1 if time % 2 else -1))
        written.add(path.read_bytes())
    assert len(written) == 1


@pytest.mark.parametrize(
    "other",
    [
        Provenance("other_stage", {"experiments.home.graph": 1}),
        Provenance("some_stage", {"experiments.home.graph": 2}),
        Provenance("some_stage", {"experiments.hom.graph": 1}),
        Provenance("some_stage", {"experiments.home.graph": 1}, {"data/a.parquet": {"isi.params": "aa"}}),
    ],
)
def test_another_stage_param_or_input_gives_another_hash(other: Provenance) -> None:
    assert other.metadata()["isi.params"] != MADE.metadata()["isi.params"]


def test_a_param_of_an_early_stage_reaches_the_hash_of_every_later_table(tmp_path: Path) -> None:
    def last(min_count: int) -> str:
        novel(tmp_path / "first.parquet", Provenance("first", {"experiments.home.graph": min_count}))
        second = Provenance("second", {})
        io.read(tmp_path / "first.parquet", catalogue.NOVEL, second)
        io.write_tensors(tmp_path / "second.safetensors", {"entity": torch.zeros(1)}, second)
        third = Provenance("third", {})
        io.read_tensors(tmp_path / "second.safetensors", ["entity"], third)
        return third.metadata()["isi.params"]

    assert last(1) == last(1)
    assert last(1) != last(2)


# Refusals


def test_a_missing_column_is_named(tmp_path: Path) -> None:
    pq.write_table(pa.table({"size": pa.array([1], pa.int32()), "seed": pa.array([1], pa.int32())}), tmp_path / "t")
    with pytest.raises(InputError, match=rf"{tmp_path / 't'}: column 'entity': missing"):
        io.read(tmp_path / "t", catalogue.NOVEL)


@pytest.mark.parametrize(
    ("column", "kind", "content"),
    [("count", "int64", [1]), ("count", "double", [1.0]), ("count", "string", ["1"]), ("head", "int32", [1])],
)
def test_a_column_of_another_type_is_named_with_both_types(
    tmp_path: Path, column: str, kind: str, content: list[Any]
) -> None:
    io.write(tmp_path / "t.parquet", lawful("TRIPLES")[:1], catalogue.TRIPLES, MADE)
    table = pq.read_table(tmp_path / "t.parquet")
    place = table.schema.get_field_index(column)
    pq.write_table(table.set_column(place, column, pa.array(content, pa.type_for_alias(kind))), tmp_path / "t.parquet")
    with pytest.raises(InputError, match=rf"t\.parquet: column '{column}': expected .*(int32|string).*, got {kind}"):
        io.read(tmp_path / "t.parquet", catalogue.TRIPLES)


def truncated(path: Path) -> bytes:
    return novel(path).read_bytes()[:-10]


def overwritten(path: Path) -> bytes:
    raw = novel(path).read_bytes()
    return raw[:4] + b"\xff" * 40 + raw[44:]


def text(_path: Path) -> bytes:
    return b"size,seed,entity\n1,0,4\n"


def empty(_path: Path) -> bytes:
    return b""


@pytest.mark.parametrize("damage", [truncated, overwritten, text, empty])
def test_what_is_no_parquet_is_named_in_one_line(tmp_path: Path, damage: Any) -> None:
    path = tmp_path / "novel.parquet"
    path.write_bytes(damage(path))
    with pytest.raises(InputError, match=r"novel\.parquet: expected a Parquet table") as refused:
        io.read(path, catalogue.NOVEL)
    assert "\n" not in str(refused.value)


def test_a_missing_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.parquet: no such file"):
        io.read(tmp_path / "nowhere.parquet", catalogue.NOVEL)


# Tensors


def test_tensors_come_back_as_they_were_written_even_views(tmp_path: Path) -> None:
    path = tmp_path / "size=01.safetensors"
    entity = torch.arange(12.0).reshape(3, 4).T
    io.write_tensors(path, {"entity": entity, "known": torch.tensor([True, False])}, MADE)
    read = io.read_tensors(path, ["known", "entity"])
    assert list(read) == ["known", "entity"]
    assert torch.equal(read["entity"], entity)
    assert read["known"].tolist() == [True, False]


def test_a_missing_tensor_is_named(tmp_path: Path) -> None:
    io.write_tensors(tmp_path / "t.safetensors", {"entity": torch.zeros(1)}, MADE)
    with pytest.raises(InputError, match=r"t\.safetensors: tensor 'relation': missing"):
        io.read_tensors(tmp_path / "t.safetensors", ["entity", "relation"])


@pytest.mark.parametrize("content", [None, b"", b"no tensors here", b"\x10\0\0\0\0\0\0\0{}"])
def test_what_is_no_safetensors_file_is_named(tmp_path: Path, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / "t.safetensors").write_bytes(content)
    with pytest.raises(InputError, match=r"t\.safetensors: (expected a safetensors file|no such file)"):
        io.read_tensors(tmp_path / "t.safetensors", ["entity"])


# Writes


def test_folders_on_the_way_are_made(tmp_path: Path) -> None:
    assert novel(tmp_path / "graph" / "ai2thor" / "novel.parquet").is_file()


def test_an_exception_halfway_through_a_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "table.parquet"
    path.write_bytes(b"the last good one")

    def half(temporary: Path) -> None:
        temporary.write_bytes(b"half of the n")
        assert path.read_bytes() == b"the last good one"
        raise RuntimeError("no space left")

    with pytest.raises(RuntimeError, match="no space left"):
        io.atomically(path, half)
    assert path.read_bytes() == b"the last good one"
    assert names(tmp_path) == ["table.parquet"]


def test_an_interrupt_before_the_first_byte_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "table.parquet").write_bytes(b"the last good one")

    def interrupted(_: Path) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        io.atomically(tmp_path / "table.parquet", interrupted)
    assert names(tmp_path) == ["table.parquet"]


def test_a_frame_that_does_not_fit_its_schema_leaves_the_old_table(tmp_path: Path) -> None:
    before = novel(tmp_path / "novel.parquet").read_bytes()
    for unfit in ({"size": [1], "seed": [0]}, {"size": [1], "seed": [0], "entity": ["mug"], "session": [1]}):
        with pytest.raises((KeyError, pa.ArrowException)):
            io.write(tmp_path / "novel.parquet", pd.DataFrame(unfit), catalogue.NOVEL, MADE)
    assert (tmp_path / "novel.parquet").read_bytes() == before
    assert names(tmp_path) == ["novel.parquet"]


def test_a_stream_that_breaks_off_leaves_the_old_table_and_nothing_else(tmp_path: Path) -> None:
    before = novel(tmp_path / "t.parquet").read_bytes()

    def parts(last: pa.Table | None) -> Iterator[pa.Table]:
        yield part("mug")
        assert len(names(tmp_path)) == 2
        if last is None:
            raise InputError("recording.json", "FloorPlan9", "broken")
        yield last

    for last, refused in ((None, InputError), (pa.table({"entity": ["mug"]}), ValueError)):
        with pytest.raises(refused):
            io.write_stream(tmp_path / "t.parquet", parts(last), catalogue.KINDS, MADE)
        assert (tmp_path / "t.parquet").read_bytes() == before
        assert names(tmp_path) == ["t.parquet"]


def test_tensors_that_cannot_be_written_leave_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "t.safetensors"
    io.write_tensors(path, {"entity": torch.ones(3)}, MADE)
    with pytest.raises(InputError, match=r"tensor 'entity': expected a type that NumPy has, got torch\.bfloat16"):
        io.write_tensors(path, {"entity": torch.ones(3).bfloat16()}, MADE)
    assert torch.equal(io.read_tensors(path, ["entity"])["entity"], torch.ones(3))
    assert names(tmp_path) == ["t.safetensors"]


def test_a_write_replaces_the_table_that_was_there(tmp_path: Path) -> None:
    io.write(tmp_path / "t.parquet", lawful("NOVEL"), catalogue.NOVEL, MADE)
    assert len(io.read(novel(tmp_path / "t.parquet"), catalogue.NOVEL)) == 1
    assert names(tmp_path) == ["t.parquet"]


def test_keep_only_removes_files_of_earlier_and_killed_runs_but_no_folder(tmp_path: Path) -> None:
    for name in ("size=01.safetensors", "size=02.safetensors", "size=10.safetensors", ".size=01.safetensors.7.tmp"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "folder").mkdir()
    io.keep_only(tmp_path, [tmp_path / "size=01.safetensors", tmp_path / "size=02.safetensors"])
    assert names(tmp_path) == ["folder", "size=01.safetensors", "size=02.safetensors"]
