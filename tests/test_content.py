"""The digest of what a table or tensors hold: of nothing else, and of all of it."""

from __future__ import annotations

from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from isi.analyses.query_breakdown import NOVEL
from isi.errors import InputError
from isi.graph.sessions import SPLITS
from isi.initializers.api import FALLBACKS
from isi.tables import catalogue, io
from isi.tables.catalogue import FALLBACK_NAMES, NOVEL_AT, SPLIT_NAMES
from isi.tables.content import Content, digest_of_table, digest_of_tensors
from isi.tables.provenance import CONTENT, Provenance, metadata_of, own
from isi.tables.rules import SHOWN, shown
from tests.lawful import SCHEMAS, alter, lawful

MADE = Provenance("some_stage", {})


def arrow(name: str, frame: pd.DataFrame | None = None) -> pa.Table:
    return pa.Table.from_pandas(lawful(name) if frame is None else frame, SCHEMAS[name].columns, preserve_index=False)


# What it hangs on


@pytest.mark.parametrize("name", SCHEMAS)
@settings(max_examples=15)
@given(cuts=st.lists(st.integers(0, 3), max_size=3), plain=st.booleans())
def test_a_digest_hangs_neither_on_parts_nor_on_chunks_nor_on_dictionaries(
    name: str, cuts: list[int], plain: bool
) -> None:
    whole, ends = arrow(name), [0, *sorted(cuts), 3]
    parts = [whole.slice(start, end - start) for start, end in pairwise(ends)]
    if plain:
        text = [pa.field(f.name, pa.string()) if pa.types.is_dictionary(f.type) else f for f in whole.schema]
        parts = [part.cast(pa.schema(text)) for part in parts]
    content = Content(SCHEMAS[name].columns)
    for part in parts:
        content.add(part)
    assert content.digest() == digest_of_table(pa.concat_tables(parts), SCHEMAS[name].columns)
    assert content.digest() == digest_of_table(whole, SCHEMAS[name].columns)


@pytest.mark.parametrize("compression", ["none", "snappy", "zstd"])
@pytest.mark.parametrize("rows", [1, 2, 100])
def test_it_hangs_on_nothing_of_the_file(tmp_path: Path, compression: str, rows: int) -> None:
    io.write(tmp_path / "runs.parquet", lawful("RUNS"), catalogue.RUNS, MADE)
    again = pq.read_table(tmp_path / "runs.parquet")
    options: dict[str, Any] = {"row_group_size": rows, "compression": compression, "use_dictionary": rows > 1}
    pq.write_table(again, tmp_path / "again.parquet", **options)
    assert len(io.read(tmp_path / "again.parquet", catalogue.RUNS)) == 3


def test_it_is_the_same_today_as_when_this_was_written() -> None:
    digest = digest_of_table(arrow("NOVEL"), catalogue.NOVEL.columns)
    assert digest == "9c83498dc4c66435d5ecbeab2bb74e1722fd8ee307c2c06a24231b0bb67e9bb0"
    assert (
        digest_of_table(arrow("RUNS"), catalogue.RUNS.columns)
        == "250d0216943206aff9687794d032c56747437ce37b826226645e6a69864df6c1"
    )
    tensors = {"b": torch.arange(6.0).reshape(2, 3), "a": torch.tensor([True, False])}
    assert digest_of_tensors(tensors) == "2a301d9d0400af759f2561e85c8eb26efd10fb101f61997fd1c10a0ab4b5b5a5"


def test_of_tensors_it_hangs_on_names_types_shapes_and_numbers_and_not_on_their_order() -> None:
    tensors = {"b": torch.arange(6.0).reshape(2, 3), "a": torch.tensor([True, False])}
    same = {"a": tensors["a"], "b": tensors["b"].T.contiguous().T}
    assert digest_of_tensors(same) == digest_of_tensors(tensors)
    others = [
        {"b": tensors["b"], "c": tensors["a"]}, {**tensors, "b": tensors["b"].double()},
        {**tensors, "b": tensors["b"].reshape(3, 2)}, {**tensors, "b": tensors["b"] + 1e-6}, {"b": tensors["b"]},
    ]  # fmt: skip
    assert len({digest_of_tensors(one) for one in [tensors, *others]}) == 6


def test_a_stream_bears_the_digest_of_the_whole(tmp_path: Path) -> None:
    whole = arrow("OBSERVATIONS")
    parts = [whole.slice(0, 1), whole.slice(1, 0), whole.slice(1, 2)]
    io.write_stream(tmp_path / "s.parquet", parts, catalogue.OBSERVATIONS, MADE)
    assert metadata_of(tmp_path / "s.parquet")[CONTENT] == digest_of_table(whole, catalogue.OBSERVATIONS.columns)
    assert len(io.read(tmp_path / "s.parquet", catalogue.OBSERVATIONS)) == 3


# What it tells


def another(value: Any, kind: pa.DataType, draw: st.DataObject) -> Any:
    """Any value of a column's type that is not this one."""
    if pa.types.is_boolean(kind):
        return not value
    if pa.types.is_floating(kind):
        values: st.SearchStrategy[Any] = st.none() | st.floats(allow_nan=False)
    elif pa.types.is_integer(kind):
        values = st.integers(-(2 ** (kind.bit_width - 1)), 2 ** (kind.bit_width - 1) - 1)
    else:
        values = st.none() | st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
    is_null = value is None or value != value
    return draw.draw(values.filter(lambda other: (other is not None) if is_null else other is None or other != value))


@pytest.mark.parametrize("name", SCHEMAS)
@settings(max_examples=20)
@given(draw=st.data())
def test_any_single_value_that_is_altered_is_refused(
    tmp_path_factory: pytest.TempPathFactory, name: str, draw: st.DataObject
) -> None:
    """By its rule, with the row, or by the digest."""
    path, schema = tmp_path_factory.getbasetemp() / f"{name}.parquet", SCHEMAS[name]
    io.write(path, lawful(name), schema, MADE)
    column, row = draw.draw(st.sampled_from(list(schema.columns))), draw.draw(st.integers(0, 2))

    def altered(frame: pd.DataFrame) -> pd.DataFrame:
        plain = [None if pd.isna(value) else value for value in io.as_text(frame)[column.name].tolist()]
        plain = [None if value == "nan" else value for value in plain]
        plain[row] = another(plain[row], column.type, draw)
        values = pd.Series(plain, dtype=object)
        return frame.assign(**{column.name: values})

    before = pq.read_table(path)
    alter(path, altered, schema)
    if pq.read_table(path).equals(before):  # as 0.0 for -0.0, or one null for another
        return
    with pytest.raises(InputError, match=r"row \d|was edited") as refused:
        io.read(path, schema)
    assert len(str(refused.value)) < 300
    assert str(refused.value).startswith(str(path))


@pytest.mark.parametrize("how", [lambda f: f[:0], lambda f: f[1:], lambda f: f[::-1], lambda f: pd.concat([f, f])])
@pytest.mark.parametrize("name", SCHEMAS)
def test_rows_that_are_missing_doubled_or_in_another_order_are_refused(tmp_path: Path, name: str, how: Any) -> None:
    path = tmp_path / "t.parquet"
    io.write(path, lawful(name), SCHEMAS[name], MADE)
    alter(path, how, SCHEMAS[name])
    with pytest.raises(InputError, match=r"row \d|was edited"):
        io.read(path, SCHEMAS[name])


def test_a_file_is_read_whole_once_however_often_it_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    io.write(tmp_path / "t.parquet", lawful("NOVEL"), catalogue.NOVEL, MADE)
    seen: list[Path] = []
    monkeypatch.setattr(type(catalogue.NOVEL), "check", lambda _, frame, path: seen.append(path))  # noqa: ARG005
    reading = Provenance("reading", {})
    for _ in range(3):
        io.read(tmp_path / "t.parquet", catalogue.NOVEL, reading)
    assert len(seen) == 1
    io.read(tmp_path / "t.parquet", catalogue.NOVEL)
    assert len(seen) == 2


# Rules


def test_params_that_are_the_same_to_dvc_are_the_same_to_whoever_reads() -> None:
    """Or else `dvc repro` would find nothing to do; and params may hold what JSON does not."""
    same = [{"margin": 2.0, "sizes": [1.0, 2]}, {"sizes": (1, 2.0), "margin": 2}]
    assert own("insert", same[0]) == own("insert", same[1])
    others = [{"margin": 2.5, "sizes": [1, 2]}, {"margin": 2, "sizes": [2, 1]}, {"margin": 2, "sizes": [1], "k": None},
              {"margin": "2", "sizes": [1, 2]}, {1: date(2001, 1, 1), "b": b"x"}]  # fmt: skip
    assert len({own("insert", one) for one in [same[0], *others]}) == 1 + len(others)
    assert own("insert", same[0]) != own("train", same[0])


def test_a_table_that_breaks_a_rule_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "novel.parquet"
    io.write(path, lawful("NOVEL"), catalogue.NOVEL, MADE)
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"row 1 \(entity -1\): expected 'entity' from 0 on"):
        io.write(path, lawful("NOVEL").assign(entity=[4, -1, 3]), catalogue.NOVEL, MADE)
    parts = [arrow("KINDS"), arrow("KINDS", lawful("KINDS").assign(entity=["a", "", "b"]))]
    with pytest.raises(InputError, match=r"row 1 \(entity ''\): expected 'entity' to be a name"):
        io.write_stream(path, parts, catalogue.KINDS, MADE)
    with pytest.raises(InputError, match=r"tensor 'x', \[1\]: expected finite numbers"):
        io.write_tensors(path, {"x": torch.tensor([1.0, np.inf])}, MADE)
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == ["novel.parquet"]


def test_a_value_is_cut_where_a_message_repeats_it() -> None:
    assert shown("x" * 5000) == f"'{'x' * (SHOWN - 1)}…"
    assert [shown(value) for value in (None, float("nan"), 0, 0.5, "a b", True)] == [
        "null", "null", "0", "0.5", "'a b'", "True",
    ]  # fmt: skip


def test_lists_of_names_are_those_of_the_code_that_writes_them() -> None:
    assert SPLIT_NAMES == SPLITS
    assert (None, *FALLBACK_NAMES) == FALLBACKS
    assert set(NOVEL_AT) == set(NOVEL)
