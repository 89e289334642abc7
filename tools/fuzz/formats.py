"""All formats that are read: small valid files of each, and the function that reads them."""

import gzip
import hashlib
import io
import json
import re
import struct
import tempfile
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pandas as pd
import pyarrow.parquet as pq
import yaml

from isi.errors import InputError, at
from isi.graph.files import read_graph
from isi.graph.graph import MinedSource, build_tables
from isi.graph.words import look_up, read_vectors
from isi.home.home import Home
from isi.home.stream import answer
from isi.home.train import tables_of
from isi.names import name_fault
from isi.sources import Source
from isi.sources.recordings import ITHOR
from isi.sources.triples import shipped_names
from isi.tables import io as tables
from isi.tables import paths
from isi.tables.table import as_text
from stages.files import KINDS, OBSERVATIONS, TRIPLES
from stages.record import Recording
from tests.small_home import KNOWN, assert_same, quick_choices, seen

Files = dict[str, bytes]
ROOT = Path(__file__).parents[2]
LISTED: dict[str, Any] = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text("utf-8"))
THINGS: list[dict[str, Any]] = LISTED["values"]["things"]
HOME: dict[str, Any] = LISTED["values"]["home"]
#: Of recordings.
HEADER: Mapping[str, Any] = {"build": "thor-1", "package": "5.0.0"}
OUT = (Path("out/observations.parquet"), Path("out/kinds.parquet"))
MADE = "fuzz"


@dataclass(frozen=True)
class Format:
    """Small valid files, and a function that reads them in the current folder."""

    files: Files
    #: returns a text that is equal for files with equal content
    read: Callable[[], str]
    #: outputs that must not change if a file is refused
    writes: tuple[Path, ...] = ()
    #: section of params, if the format is a source
    section: Mapping[str, Any] = field(default_factory=dict)


# The functions that read


def mined(section: dict[str, Any]) -> str:
    """Mine a source as its stage does, and check that its tables are valid;
    returns a hash of them and the counts.
    """
    shipped_names.cache_clear()
    source = Source(section, "sources.fuzz", 0)
    OBSERVATIONS.write_parts(OUT[0], source.frames(), MADE)
    KINDS.write_file(OUT[1], source.kinds, MADE)
    observations, kinds = OBSERVATIONS.read_file(OUT[0]), KINDS.read_file(OUT[1])
    plain, text = as_text(observations), as_text(kinds)
    triples, about = plain[["head", "relation", "tail"]], text[["entity", "kind", "phrase"]]
    assert not any(map(name_fault, {*triples.to_numpy().flat, *about.to_numpy().flat} - {""}))
    assert plain["count"].between(1, 2**31 - 1).all()
    assert plain["count"].sum() < 2**31
    assert text["entity"].is_unique
    assert set(text["entity"]) == {*plain["head"], *plain["tail"]}
    graph = build_tables(MinedSource("fuzz", observations, kinds))
    assert graph.triples["count"].sum() == plain["count"].sum()
    both = plain.to_csv(index=False) + text.to_csv(index=False)
    return hashlib.sha256(both.encode()).hexdigest() + repr(sorted(source.counts.items()))


def guessed(file: str) -> str:
    """Read a file as ``isi train`` does, which detects the reader from the content."""
    graph, read = read_graph([file])
    return f"{read} {graph.triples.to_csv()} {graph.entities.to_csv()}"


def words(file: str) -> str:
    """Read word vectors, and look up phrases."""
    known = look_up(read_vectors(Path(file)), ["mug", "house plant", "none of them"])
    return repr(known.served_by) + hashlib.sha256(known.vectors.tobytes()).hexdigest()


def gone_on_with(file: str) -> str:
    """Open a recording to continue it; an incomplete last line may be removed."""
    return repr(sorted(Recording(Path(file), HEADER).names))


def pipeline_table(file: str) -> str:
    """Read a table of the pipeline."""
    return str(TRIPLES.read_file(Path(file)).to_csv())


def pipeline_tensors(file: str) -> str:
    """Read tensors of the pipeline."""
    return repr(tables.read_tensors(Path(file), ["vectors"])["vectors"].shape)


def arrow_table(file: str) -> str:
    """The graph that ``isi.train`` makes of a table of pyarrow's."""
    with at(file):
        table = pq.read_table(file)
    return str(tables_of(table).triples.to_csv())


TIME = re.compile(r"'(time|first_seen|last_seen)': '[^']*'")
"""When a change was made: two readings of the same requests differ in it."""


def stream(file: str) -> str:
    """Answer each line as ``isi live`` does; refused if all lines are.
    A copy of the home must have the same answers.
    """
    with quick_choices(of_known=True):
        home = Home(KNOWN)
        lines = Path(file).read_bytes().split(b"\n")
        answers = [answer(home, line) for line in lines]
        assert_same(seen(home), seen(copy(home)))
    assert all(whole.endswith(b"\n") and whole.count(b"\n") == 1 for whole in answers)
    replies = list(map(json.loads, answers))
    errors = [reply["error"] for reply in replies if "error" in reply]
    for error in errors:
        assert error.isprintable()
        assert len(error) < 300
        assert not error.startswith("internal")
    if len(errors) == len(replies):
        raise InputError(file, "", errors[0])
    return TIME.sub("", repr(replies))


# The files that are made


def small_scene_graph() -> dict[str, Any]:
    """The scene graph of the tests, with only the attributes that mining reads and two more."""
    text = (ROOT / "tests" / "scene_graph.json").read_text(encoding="utf-8")
    graph: dict[str, Any] = json.loads(text)
    for node in graph["nodes"]:
        names = ("type", "name", "semantic_label", "position", "metadata")
        node["attributes"] = {
            name: node["attributes"][name] for name in names if name in node["attributes"]
        }
    return graph


def scene_graph() -> bytes:
    return json.dumps(small_scene_graph()).encode()


def of_package() -> bytes:
    """A recording in the format of the package ``procthor``:
    lists of scenes, of which most are empty.
    """
    scenes = {plans.key: [THINGS, *([[]] * (len(plans.names) - 1))] for plans in ITHOR}
    return json.dumps(scenes).encode()


def log() -> pd.DataFrame:
    """The table of the format "table, CSV"."""
    text = LISTED["formats"]["table, CSV"]["files"]["log.csv"]
    return pd.read_csv(io.StringIO(text), keep_default_na=False)


def parquet() -> bytes:
    return bytes(log().to_parquet(index=False))


def pipeline_triples() -> bytes:
    columns = ["head", "relation", "tail"]
    frame = log()[[*columns, "count"]].assign(source="x").sort_values(columns)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "triples.parquet"
        TRIPLES.write_file(path, frame, MADE)
        return path.read_bytes()


def tensors() -> bytes:
    values = {"dtype": "F32", "shape": [2, 3], "data_offsets": [0, 24]}
    header = json.dumps({"vectors": values}).encode()
    return struct.pack("<Q", len(header)) + header + struct.pack("<6f", *range(6))


def binary() -> bytes:
    """Word vectors in word2vec's binary format."""
    lines = LISTED["formats"]["words, GloVe"]["files"]["glove.txt"].splitlines()
    rows = [(word.encode(), *map(float, row)) for word, *row in map(str.split, lines)]
    return b"3 3\n" + b"".join(
        word + struct.pack("<c3fc", b" ", *row, b"\n") for word, *row in rows
    )


def content_of(name: str, value: Any) -> bytes:
    """A file from its value in formats.yaml."""
    if isinstance(value, str):
        lines = [value]
    elif ".jsonl" in name:
        lines = list(map(json.dumps, value))
    else:
        lines = [json.dumps(value)]
    if not name.endswith(".gz"):
        return "\n".join(lines).encode()
    ends = "\n" if ".jsonl" in name else ""
    return b"".join(gzip.compress((line + ends).encode(), mtime=0) for line in lines)


MAKERS: dict[str, Callable[[], bytes]] = {
    "r.json": of_package,
    "dsg.json": scene_graph,
    "log.parquet": parquet,
    "words.bin": binary,
    "triples.parquet": pipeline_triples,
    "vectors.safetensors": tensors,
}


def format_of(
    files: Mapping[str, Any] = MappingProxyType({}),
    shipped: Mapping[str, int | None] = MappingProxyType({}),
    made: Sequence[str] = (),
    read: str = "mined",
    section: Mapping[str, Any] = MappingProxyType({}),
) -> Format:
    """A format from its entry in formats.yaml."""
    contents = {name: content_of(name, value) for name, value in files.items()}
    for name, number in shipped.items():
        lines = (ROOT / paths.RAW / name).read_bytes().splitlines(keepends=True)
        contents[f"data/raw/{name}"] = b"".join(lines[:number])
    contents |= {name: MAKERS[name]() for name in made}
    source = dict(section)
    reading = partial(globals()[read], source or next(iter(contents)))
    return Format(contents, reading, OUT if source else (), source)


FORMATS = {name: format_of(**about) for name, about in LISTED["formats"].items()}
