"""A user's tables of triples: long ones, Parquet and pipes
(`read_files.yaml` has what is written in text).
"""

import gzip
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from isi.errors import InputError
from isi.sources import Source
from tests.observing import TRIPLE, observe, refused, written

# What a table gives


def test_a_long_table_is_read_chunk_by_chunk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("isi.sources.CHUNK", 500)
    monkeypatch.setattr("isi.sources.readers.BATCH", 500)
    path = written(tmp_path / "log.csv", "head,relation,tail\n" + "a,r,b\n" * 10_001 + "a,r\n")
    parts = Source({"reader": "table", "path": str(path)}, "sources.mine", 0).frames()
    assert len(next(parts)) == 500
    with pytest.raises(InputError, match="line 10003: tail: expected a name"):
        list(parts)


# What is refused


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ({"tail": ["c"]}, ["columns", "'head', 'tail'"]),
        ({"relation": ["b"], "tail": ["c"], "count": [2.5]}, ["row 1", "count", "2.5"]),
        ({"relation": ["b"], "tail": [["c"]]}, ["Parquet"]),
        ({"relation": ["b"], "tail": [None]}, ["row 1", "got none"]),
        ({"relation": ["b"], "tail": pa.array([None], pa.string())}, ["row 1", "got none"]),
        (
            {"relation": ["b"], "tail": ["c"], "count": pa.array([None], pa.int8())},
            ["row 1", "count"],
        ),
        ({"relation": ["b"], "tail": ["c"], "count": [-1]}, ["row 1", "from 1"]),
    ],
)
def test_a_broken_parquet_table_is_refused_by_its_row(
    tmp_path: Path, columns: dict[str, object], expected: list[str]
) -> None:
    pq.write_table(pa.table({"head": ["a"], **columns}), tmp_path / "a.parquet")
    refused("table", tmp_path / "a.parquet", ["a.parquet", *expected])


# Parquet by other programs


@pytest.mark.parametrize("type_", ["float64", "float32"])
def test_floats_of_whole_numbers_are_named_as_whole_numbers(tmp_path: Path, type_: str) -> None:
    frame = pd.DataFrame({"head": [1.0, 2.0**60], "relation": "at", "tail": "kitchen"})
    frame.astype({"head": type_}).to_parquet(tmp_path / "a.parquet")
    names = [head for (head,) in observe("table", tmp_path / "a.parquet").rows("head")]
    assert names == ["1", "1152921504606846976"]
    for missing in (float("nan"), None):
        heads = pa.array([1.0, missing], pa.float64())
        table = pa.table(frame).set_column(0, "head", heads)
        pq.write_table(table, tmp_path / "b.parquet")
        refused("table", tmp_path / "b.parquet", ["row 2", "head", "got none"])


@pytest.mark.parametrize("index", [None, "row", ["shelf", "row"]])
def test_the_index_of_pandas_in_parquet_is_no_column(tmp_path: Path, index: Any) -> None:
    frame = pd.DataFrame([("mug", "at", "kitchen"), ("cup", "at", "kitchen")], columns=TRIPLE)
    if index:
        frame = frame.assign(row=[1, 2], shelf=[3, 4]).set_index(index)[list(TRIPLE)]
    frame[frame["head"] == "cup"].to_parquet(tmp_path / "a.parquet")
    frame.set_index("head").to_parquet(tmp_path / "b.parquet")
    assert observe("table", tmp_path / "a.parquet").rows(*TRIPLE) == [("cup", "at", "kitchen")]
    assert observe("table", tmp_path / "b.parquet").rows("head") == [("mug",), ("cup",)]
    plain = pa.Table.from_pandas(frame.reset_index(), preserve_index=False)
    named = plain.append_column("__index_level_0__", pa.array([0, 1])).replace_schema_metadata(None)
    pq.write_table(named, tmp_path / "c.parquet")
    refused("table", tmp_path / "c.parquet", ["__index_level_0__"])


def test_metadata_of_pandas_that_is_broken_is_refused(tmp_path: Path) -> None:
    table = pa.table({name: ["a"] for name in TRIPLE})
    pq.write_table(table.replace_schema_metadata({"pandas": "{"}), tmp_path / "a.parquet")
    refused("table", tmp_path / "a.parquet", ["a.parquet", "pandas"])


# Pipes and compressed files


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("name", ["a.tsv", "a.csv.gz", "a.parquet", "pipe"])
def test_a_pipe_is_read_once(tmp_path: Path, name: str, packed: bool) -> None:
    rows, path = [("mug", "at", "kitchen"), ("cup", "at", "hall")], tmp_path / name
    frame = pd.DataFrame(rows, columns=TRIPLE)
    if name == "a.parquet":
        content = frame.to_parquet(index=False)
    else:
        text = frame.to_csv(index=False, sep="," if "csv" in name else "\t").encode()
        content = gzip.compress(text) if packed else text
    os.mkfifo(path)
    with ThreadPoolExecutor() as pool:
        written_all = pool.submit(path.write_bytes, content)
        assert observe("table", path).rows(*TRIPLE) == rows
        assert written_all.result(timeout=10) == len(content)
