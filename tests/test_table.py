"""A user's tables of triples: observations, names of entities, and refused input."""

import bz2
import gzip
import lzma
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isi.errors import InputError
from isi.graph.files import read_graph
from isi.names import clean, name_fault
from isi.sources import Source
from isi.sources.names import UNMATCHED, phrase
from isi.sources.readers import HEADERLESS, PERHAPS_HEADER, PERHAPS_TRIPLE
from tests.observing import TRIPLE, observe, refused, written

LOG = """head,relation,tail,count,room,instance
mug,atLocation,kitchen,3,kitchen,mug_1
mug,atLocation,kitchen,1,kitchen,mug_2
TVStand,hasMaterial,wood,2,,
"""
EXPECTED = [
    (None, "kitchen", "mug_1", "mug", "atLocation", "kitchen", 3),
    (None, "kitchen", "mug_2", "mug", "atLocation", "kitchen", 1),
    (None, None, None, "TVStand", "hasMaterial", "wood", 2),
]
COLUMNS = ("scene", "room", "instance", *TRIPLE, "count")
HOMELY = {
    "atLocation": {"head": "thing", "tail": "place"},
    "hasMaterial": {"head": "thing", "tail": "stuff"},
}


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return written(tmp_path / "log.csv", LOG)


# What a table gives


def test_every_row_is_an_observation(log: Path) -> None:
    assert observe("table", log).rows(*COLUMNS) == EXPECTED


def test_forms_of_the_same_table_give_the_same(tmp_path: Path) -> None:
    rows = pd.DataFrame(
        [line.split(",") for line in LOG.splitlines()[1:]], columns=LOG.splitlines()[0].split(",")
    )
    as_parquet = rows.replace("", None).astype({"count": "int16", "head": "category"})
    as_parquet.to_parquet(tmp_path / "log.parquet", index=False)
    others = [
        tmp_path / "log.parquet",
        written(tmp_path / "log.tsv", LOG.replace(",", "\t")),
        written(tmp_path / "log.csv.gz", gzip.compress(LOG.encode())),
        written(tmp_path / "excel.csv", b"\xef\xbb\xbf" + LOG.replace("\n", "\r\n").encode()),
        written(tmp_path / "spaced.csv", LOG.replace(",", ", ") + "\n\n"),
    ]
    for path in others:
        assert observe("table", path).rows(*COLUMNS) == EXPECTED, path


def test_columns_in_any_order_and_without_counts_are_one_observation_a_row(tmp_path: Path) -> None:
    path = written(tmp_path / "log.csv", 'tail,head,relation\n"a, b",c,d\n')
    assert observe("table", path).rows(*TRIPLE, "count") == [("c", "d", "a, b", 1)]


def test_a_long_table_is_read_chunk_by_chunk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("isi.sources.CHUNK", 500)
    monkeypatch.setattr("isi.sources.readers.BATCH", 500)
    path = written(tmp_path / "log.csv", "head,relation,tail\n" + "a,r,b\n" * 10_001 + "a,r\n")
    parts = Source({"reader": "table", "path": str(path)}, "sources.mine", 0).frames()
    assert len(next(parts)) == 500
    with pytest.raises(InputError, match=r"line 10003: .*expected 3 columns, got 2"):
        list(parts)


LETTERS = st.characters(categories=["L", "M", "N", "P", "S"])
NAMES = (
    st.text(LETTERS, min_size=1, max_size=9).map(clean).filter(lambda text: not name_fault(text))
)


@given(st.lists(st.tuples(NAMES, NAMES, NAMES), min_size=1))
def test_names_of_any_script_come_through(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[str, ...]]
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.csv"
    pd.DataFrame(rows, columns=TRIPLE).to_csv(path, index=False)
    assert observe("table", path).rows(*TRIPLE) == rows


# How entities are named


def test_without_more_all_entities_are_of_one_kind_and_their_phrases_are_the_words_of_their_names(
    log: Path,
) -> None:
    observed = observe("table", log)
    assert set(observed.kind_of().values()) == {"entity"}
    assert observed.phrase_of() == {
        "TVStand": "tv stand",
        "kitchen": "kitchen",
        "mug": "mug",
        "wood": "wood",
    }
    assert [phrase(name) for name in ("side_table", "_", "Ölfaß")] == ["side table", "_", "ölfaß"]


def test_kinds_come_from_relations(log: Path) -> None:
    expected = {"TVStand": "thing", "kitchen": "place", "mug": "thing", "wood": "stuff"}
    assert observe("table", log, kinds=HOMELY).kind_of() == expected


def test_rooms_of_homes_are_the_names_in_their_column(log: Path) -> None:
    expected = {"TVStand": "object", "kitchen": "room", "mug": "object", "wood": "material"}
    assert observe("table", log, household=True).kind_of() == expected


def test_a_table_of_entities_goes_before_relations(log: Path, tmp_path: Path) -> None:
    listed = written(
        tmp_path / "names.tsv",
        "entity\tkind\tphrase\nmug\tcup\tcoffee mug\nkitchen\t\tgalley\nunseen\tx\t\n",
    )
    observed = observe("table", log, kinds=HOMELY, entities=str(listed))
    assert observed.kind_of() == {
        "TVStand": "thing",
        "kitchen": "place",
        "mug": "cup",
        "wood": "stuff",
    }
    assert observed.phrase_of() == {
        "TVStand": "tv stand",
        "kitchen": "galley",
        "mug": "coffee mug",
        "wood": "wood",
    }


# What is refused


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ({"tail": ["c"]}, ["columns", "'head', 'tail'"]),
        ({"relation": ["b"], "tail": ["c"], "count": [2.5]}, ["row 1", "count", "2.5"]),
        ({"relation": ["b"], "tail": [["c"]]}, ["Parquet table"]),
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


# Forms of tables


@pytest.mark.parametrize(
    ("field", "name"),
    [
        ('"Weird Al" poster', '"Weird Al" poster'),
        ('5" pipe', '5" pipe'),
        ('"open quote', '"open quote'),
        ('"mug"', '"mug"'),
        ('"tv 55"" "', 'tv 55"'),
        ('"""Weird Al"" poster"', '"Weird Al" poster'),
    ],
)
def test_quotes_are_text_where_tabs_part_columns_unless_pandas_has_doubled_them(
    tmp_path: Path, field: str, name: str
) -> None:
    for header in ("head\trelation\ttail\n", ""):
        path = written(tmp_path / "a.tsv", f"{header}{field}\tat\tkitchen\nmug\tat\tkitchen\n")
        assert observe("table", path).rows(*TRIPLE) == [
            (name, "at", "kitchen"),
            ("mug", "at", "kitchen"),
        ]


@given(st.lists(st.tuples(NAMES, NAMES, NAMES), min_size=1))
def test_what_pandas_writes_with_tabs_is_read_as_it_was(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[str, ...]]
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.tsv"
    pd.DataFrame(rows, columns=TRIPLE).to_csv(path, index=False, sep="\t")
    assert observe("table", path).rows(*TRIPLE) == rows


def test_a_table_of_tabs_whose_header_is_quoted_is_quoted(tmp_path: Path) -> None:
    path = written(tmp_path / "a.tsv", '"head"\t"relation"\t"tail"\n"mug"\t"at"\t"5"" pipe"\n')
    assert observe("table", path).rows(*TRIPLE) == [("mug", "at", '5" pipe')]


@pytest.mark.parametrize("file", ["train.txt", "a.tsv", "A.TSV", "a.CSV", "a.Txt", "a.CSV.GZ"])
def test_three_columns_without_a_header_are_a_triple_and_suffixes_have_any_case(
    tmp_path: Path, file: str
) -> None:
    rows = [("mug", "isA", "object"), ("head", "at", "kitchen"), ("cup", "isA", "object")]
    separator = "," if "csv" in file.lower() else "\t"
    content = "".join(separator.join(row) + "\n" for row in rows).encode()
    path = written(tmp_path / file, gzip.compress(content) if file.endswith("GZ") else content)
    observed = observe("table", path)
    assert observed.rows(*TRIPLE) == rows
    assert observed.counts == {HEADERLESS.format("head, relation, tail"): 3}
    _, read = read_graph([path])
    assert read[str(path)]["reader"] == "table"


@pytest.mark.parametrize(
    ("lines", "doubt"),
    [
        (["Thing\tLink\tOther thing", "mug\tat\tkitchen", "cup\tat\tkitchen"], PERHAPS_HEADER),
        (["mug\tat\tkitchen", "cup\tat\tkitchen"], ""),
        (["mug\tat\tkitchen", "kitchen\tin\thome"], ""),
        (["mug\tat\tkitchen"], ""),
        (["e1\tr\te2", "e2\tr\te3", "e3\tr\te1"], PERHAPS_TRIPLE),
        (["e1\tr\te2", "mug\tr\tkitchen"], ""),
        (["head\trelation\ttail", "head\ton\tbody", "tail\ton\tbody"], ""),
    ],
)
def test_a_first_line_that_may_be_taken_wrongly_is_named(
    tmp_path: Path, lines: list[str], doubt: str
) -> None:
    observed = observe("table", written(tmp_path / "a.tsv", "\n".join(lines)))
    named = [label for label in observed.counts if label.startswith("first line")]
    assert named == [doubt.format(repr(lines[0].replace("\t", " ")))] * bool(doubt)


def test_columns_have_any_case(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "Tail,Relation,HEAD,Count\nkitchen,at,mug,3\n")
    assert observe("table", path).rows(*TRIPLE, "count") == [("mug", "at", "kitchen", 3)]


@pytest.mark.parametrize(
    "header",
    [
        "from,rel,to",
        "source,relation,target",
        "Subject,Predicate,Object",
        "h,r,t",
        "source,label,target",
        "head,rel,tail",
        "subjectLabel,predicateLabel,objectLabel",
        "itemLabel,propLabel,value",
        "e1,rel,e2",
        "entity_1,relationship,entity_2",
    ],
)
def test_columns_of_triples_may_have_other_names(tmp_path: Path, header: str) -> None:
    path = written(tmp_path / "a.csv", f"{header},count\nmug,at,kitchen,3\n")
    assert observe("table", path).rows(*TRIPLE, "count") == [("mug", "at", "kitchen", 3)]
    order = [header.split(",")[slot] for slot in (2, 0, 1)]
    table = pd.DataFrame([("kitchen", "mug", "at")], columns=order)
    table.to_parquet(tmp_path / "a.parquet")
    assert observe("table", tmp_path / "a.parquet").rows(*TRIPLE) == [("mug", "at", "kitchen")]


@pytest.mark.parametrize(
    ("file", "content", "remedy"),
    [
        ("a.csv", "start,edge,end\na,b,c\n", "add the line head,relation,tail"),
        ("a.csv", "node,property,node\na,b,c\n", "subject/object"),
        ("a.csv", "from,rel,tail\na,b,c\n", "'from', 'rel', 'tail'"),
        ("a.csv", "from,rel,to,source,target\na,b,c,d,e\n", "'source', 'target'"),
        ("a.csv", "startLabel,edge_type,endName\na,b,c\n", "add the line head,relation,tail"),
        ("a.csv", "item,itemLabel,prop,value\na,b,c,d\n", "'itemLabel'"),
        ("a.csv", "0,1,2\na,b,c\n", "0"),
        ("a.csv", "a;at;b\n", "write , between columns"),
        ("a.txt", "a at b\n", "head<tab>relation<tab>tail"),
        ("a.csv", "a,at,b,3\n", "add the line head,relation,tail"),
        ("a.csv", "", "line 1"),
    ],
)
def test_a_table_with_another_header_is_refused_with_a_remedy(
    tmp_path: Path, file: str, content: str, remedy: str
) -> None:
    refused("table", written(tmp_path / file, content), [file, "line 1", remedy])


def test_a_line_that_is_too_long_and_a_missing_file_are_called_so(tmp_path: Path) -> None:
    long = "head,relation,tail\na,at,b\na,at," + "x" * 2**20
    refused(
        "table",
        written(tmp_path / "a.csv", long),
        ["a.csv: line 3", "line longer than 1,048,576 bytes"],
    )
    refused("table", tmp_path / "nope.csv", ["nope.csv: no such file"])
    refused("rooms", tmp_path / "nope.json", ["nope.json: no such file"])
    refused("rdf", tmp_path / "nope.nt", ["nope.nt: no such file"])
    refused("rdf", tmp_path / "nope.ttl", ["nope.ttl: no such file"])


def test_names_of_the_table_of_entities_that_match_nothing_are_counted(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "head,relation,tail\nmug,at,kitchen\n")
    listed = written(tmp_path / "e.csv", "entity,phrase\nMugg,big mug\nkitchen,galley\ncup,cup\n")
    observed = observe("table", path, entities=str(listed))
    assert observed.counts == {f"{UNMATCHED}: Mugg, cup": 2}
    assert observed.phrase_of() == {"mug": "mug", "kitchen": "galley"}
    refused(
        "table",
        path,
        ["Mugg"],
        entities=str(written(tmp_path / "f.csv", "entity,phrase\nMugg,big mug\n")),
    )


# Parquet by other programs


@pytest.mark.parametrize("type_", ["float64", "float32", "category"])
def test_floats_of_whole_numbers_are_named_as_whole_numbers(tmp_path: Path, type_: str) -> None:
    frame = pd.DataFrame({"head": [1.0, 2.0**60, 0.5], "relation": "at", "tail": "kitchen"})
    frame.astype({"head": type_}).to_parquet(tmp_path / "a.parquet")
    names = [head for (head,) in observe("table", tmp_path / "a.parquet").rows("head")]
    assert names == ["1", "1152921504606846976", "0.5"]
    for missing in (float("nan"), None):
        heads = pa.array([1.0, missing, 0.5], pa.float64())
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


PACKED = {"bz2": bz2.compress, "xz": lzma.compress, "zip": None}


@pytest.mark.parametrize("suffix", PACKED)
def test_other_compressions_are_refused_with_a_command(tmp_path: Path, suffix: str) -> None:
    path, content = tmp_path / f"a.csv.{suffix}", b"head,relation,tail\nmug,at,kitchen\n"
    if pack := PACKED[suffix]:
        path.write_bytes(pack(content))
    else:
        with ZipFile(path, "w") as archive:
            archive.writestr("a.csv", content)
    refused("table", path, [path.name, "gzip", "--reader NAME -"])
    with pytest.raises(InputError, match="--reader NAME -"):
        read_graph([path])
