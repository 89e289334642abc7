"""What readers make of files: the cases of `read_files.yaml`, and triples that come back from
every form of table in which other programs write them.
"""

import gzip
import json
import shutil
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pandas as pd
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from rdflib import Graph, URIRef

from isi.errors import InputError
from isi.graph.files import read_graph, reader_of
from isi.names import clean, name_fault
from tests.observing import TRIPLE, Observations, observations_of
from tools.fuzz.formats import HOME

FOLDER = Path(__file__).parent
CASES: dict[str, list[dict[str, Any]]] = yaml.safe_load(
    (FOLDER / "read_files.yaml").read_text(encoding="utf-8")
)
#: Contents of files that are not written out: the home of robots, and a scene graph by spark-dsg
#: 1.1.3 of two rooms, kitchen and one of unknown class; labels of objects 5 and 6.
FORMS = {
    "rooms": json.dumps(HOME),
    "scene_graph": (FOLDER / "scene_graph.json").read_text(encoding="utf-8"),
}
OF_FOLDERS = {"from", "folder"}  #: Settings of readers of folders.


def text_of(content: Any) -> str:
    """A text; or a value as JSON, those of ``lines`` on a line each."""
    if isinstance(content, str):
        return content
    if isinstance(content, dict) and "lines" in content:
        return "\n".join(map(json.dumps, content["lines"]))
    return json.dumps(content)


def lay_out(case: dict[str, Any]) -> Path:
    """Write the files of a case into the current folder; returns the first one."""
    for name, listed in case["files"].items():
        content = FORMS[case["form"]] if "form" in case else listed
        for old, new in case.get("replaced", {}).items():
            assert old in content
            content = content.replace(old, new)
        if content is not None:
            Path(name).parent.mkdir(parents=True, exist_ok=True)
            pack = gzip.compress if name.endswith(".gz") else bytes
            Path(name).write_bytes(pack(text_of(content).encode()))
    return Path(next(iter(case["files"])))


def shown(observed: Observations, columns: list[str]) -> list[str]:
    """Observations as in the table of cases, sorted."""
    rows = observed.rows(*columns, *TRIPLE, "count")
    lines = [" | ".join(str(part or "–") for part in row[:-1]) for row in rows]
    counts = [f" × {row[-1]}" if row[-1] != 1 else "" for row in rows]
    return sorted(map(str.__add__, lines, counts))


def is_named(words: str, text: str) -> bool:
    return all(word in text for word in words.split("|"))


def cases(refused: bool) -> list[Any]:
    return [
        pytest.param(reader, case, id=f"{reader}: {case['what']}")
        for reader, of_reader in CASES.items()
        for case in of_reader
        if ("says" in case) == refused
    ]


def section_of(reader: str, case: dict[str, Any], path: Path) -> dict[str, Any]:
    """The section of params that has a case mined."""
    settings = case.get("settings", {})
    return {
        "reader": reader,
        **({} if OF_FOLDERS & settings.keys() else {"path": str(path)}),
        **settings,
    }


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("reader", "case"), cases(refused=True))
def test_a_file_is_refused_in_one_line(reader: str, case: dict[str, Any]) -> None:
    path = lay_out(case)
    read = partial(observations_of, section_of(reader, case, path))
    if reader == "guessed":
        read = partial(read_graph, [path])
    with pytest.raises(InputError) as error:
        read()
    line = str(error.value)
    assert is_named(case["says"], line), line
    assert line.isprintable()
    assert len(line) < 500


@pytest.mark.parametrize(("reader", "case"), cases(refused=False))
def test_a_file_is_read_as_the_table_says(reader: str, case: dict[str, Any]) -> None:
    path = lay_out(case)
    if not OF_FOLDERS & case.get("settings", {}).keys():
        assert reader_of(path) == case.get("reader", reader)
    if reader == "guessed":
        return
    observed = observations_of(section_of(reader, case, path))
    if "rows" in case:
        expected = sorted(case["rows"].strip().splitlines())
        assert shown(observed, case.get("columns", [])) == expected
    assert observed.kind_of() == case.get("kinds", observed.kind_of())
    assert observed.phrase_of() == case.get("phrases", observed.phrase_of())
    if "counts" in case:
        told = +observed.counts
        for words, number in case["counts"].items():
            (label,) = [label for label in told if is_named(words, label)]
            assert told.pop(label) == number, label
        assert not told


# Round trips

LETTERS = st.characters(categories=["L", "M", "N", "P", "S"])
NAMES = (
    st.text(LETTERS, min_size=1, max_size=9).map(clean).filter(lambda text: not name_fault(text))
)
Rows = list[tuple[str, ...]]


def write_csv(rows: Rows, folder: Path) -> dict[str, object]:
    text = pd.DataFrame(rows, columns=TRIPLE).to_csv(index=False)
    (folder / "any.CSV.GZ").write_bytes(gzip.compress(text.encode()))
    return {"reader": "table", "path": str(folder / "any.CSV.GZ")}


def write_tsv(rows: Rows, folder: Path) -> dict[str, object]:
    frame = pd.DataFrame(rows, columns=TRIPLE)
    frame.to_csv(folder / "any.tsv", index=False, sep="\t")
    return {"reader": "table", "path": str(folder / "any.tsv")}


def write_parquet(rows: Rows, folder: Path) -> dict[str, object]:
    frame = pd.DataFrame(rows, columns=["Subject", "rel", "object"]).astype({"rel": "category"})
    frame[["object", "Subject", "rel"]].assign(count=1).astype({"count": "int16"}).to_parquet(
        folder / "any.parquet", index=False
    )
    return {"reader": "table", "path": str(folder / "any.parquet")}


def write_feather(rows: Rows, folder: Path) -> dict[str, object]:
    pd.DataFrame(rows, columns=[*TRIPLE]).to_feather(folder / "any.data")
    return {"reader": "table", "path": str(folder / "any.data")}


def write_parts(rows: Rows, folder: Path) -> dict[str, object]:
    """As Spark does, into a folder whose name looks like another place."""
    parts, half = folder / "s3:/parts", len(rows) // 2
    shutil.rmtree(parts, ignore_errors=True)
    for number, part in enumerate((rows[:half], rows[half:])):
        (parts / f"count=1/{number}").mkdir(parents=True)
        frame = pd.DataFrame(part, columns=[*TRIPLE], dtype=str)
        frame.to_parquet(parts / f"count=1/{number}/part-{number}.snappy.parquet")
    (parts / "_SUCCESS").touch()
    return {"reader": "table", "path": str(parts)}


def write_rdf(form: str, rows: Rows, folder: Path) -> dict[str, object]:
    """By rdflib, which writes a triple once."""
    graph = Graph()
    for row in rows:
        ends = (f"urn:{kind}:{quote(name, safe='')}" for kind, name in zip("ere", row, strict=True))
        graph.add(tuple(map(URIRef, ends)))
    path = folder / f"any.{form}"
    graph.serialize(path, format=form, encoding="utf-8")
    return {"reader": "rdf", "path": str(path)}


def write_ids(rows: Rows, folder: Path) -> dict[str, object]:
    ids = [list(dict.fromkeys(row[slot] for row in rows)) for slot in (0, 2, 1)]
    entities, relations = list(dict.fromkeys(ids[0] + ids[1])), ids[2]
    for file, names in (("entity2id", entities), ("relation2id", relations)):
        lines = [f"{name}\t{number}" for number, name in enumerate(names)]
        content = "\n".join([str(len(names)), *lines, ""])
        (folder / f"{file}.txt").write_text(content, encoding="utf-8")
    numbers = [
        f"{entities.index(head)} {entities.index(tail)} {relations.index(relation)}"
        for head, relation, tail in rows
    ]
    content = "\n".join([str(len(rows)), *numbers, ""])
    (folder / "gt2id.txt").write_text(content, encoding="utf-8")
    return {"reader": "triples_with_ids", "from": str(folder), "triples": None}


WRITERS = (write_csv, write_tsv, write_parquet, write_feather, write_parts, write_ids)
OF_RDF = (partial(write_rdf, "nt"), partial(write_rdf, "ttl"))


@given(st.lists(st.tuples(NAMES, NAMES, NAMES), min_size=1))
def test_triples_come_back_from_whatever_other_programs_write(
    tmp_path_factory: pytest.TempPathFactory, rows: Rows
) -> None:
    folder = tmp_path_factory.getbasetemp()
    for write in (*WRITERS, *OF_RDF):
        observed = observations_of(write(rows, folder))
        counts = Counter[tuple[object, ...]]()
        for *triple, count in observed.rows(*TRIPLE, "count"):
            counts[tuple(triple)] += count  # type: ignore[operator]
        assert counts == Counter(set(rows) if write in OF_RDF else rows), write
