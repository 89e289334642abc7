"""All formats that are read: small valid files of each, and the function that reads them."""

import gzip
import hashlib
import io
import json
import os
import re
import struct
import tempfile
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args
from unittest import mock

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from isi.cli.output import write_outputs
from isi.config import Section
from isi.errors import InputError, at
from isi.extras import procthor_houses
from isi.extras.recorder import Recording
from isi.graph.files import read_graph
from isi.graph.graph import TRIPLES, MinedSource, build_tables
from isi.graph.words import look_up, read_vectors
from isi.live.embedding import LiveEmbedding
from isi.live.stream import answer
from isi.live.train import tables_of
from isi.names import name_fault
from isi.sources import KINDS, OBSERVATIONS, Source
from isi.sources.readers import parse_json
from isi.sources.recordings import FORMAT, ITHOR, Scene, scene_objects
from isi.sources.triples import shipped_names
from isi.tables import io as tables
from isi.tables import paths
from isi.tables.table import as_text
from tests import procthor
from tests.small_live import KNOWN, assert_same, quick_choices, seen
from tools.fuzz.mutations import Files

ROOT = Path(__file__).parent.parent.parent
OUT = (Path("out/observations.parquet"), Path("out/kinds.parquet"))
MADE = "fuzz"
THINGS: list[dict[str, Any]] = [
    {"objectId": "Mug|+00.10|+00.90|-01.20", "objectType": "Mug", "name": "Mug_1",
     "pickupable": True, "canFillWithLiquid": True, "breakable": True,
     "salientMaterials": ["Ceramic"], "receptacleObjectIds": None, "parentReceptacles": ["Shelf|1"],
     "position": {"x": 0.1, "y": 0.9, "z": -1.2}},
    {"objectId": "Shelf|1", "objectType": "Shelf", "openable": False,
     "salientMaterials": ["Wood", "Metal"],
     "receptacleObjectIds": ["Mug|+00.10|+00.90|-01.20", "Fork|1"],
     "parentReceptacles": ["Floor|1"]},
    {"objectId": "Fork|1", "objectType": "Fork", "pickupable": True, "salientMaterials": ["Metal"],
     "receptacleObjectIds": [], "parentReceptacles": ["Shelf|1"]},
    {"objectId": "Floor|1", "objectType": "Floor", "receptacleObjectIds": ["Shelf|1"],
     "parentReceptacles": []},
]  # fmt: skip
ROWS = [
    ("mug", "atLocation", "kitchen", 3, "s1", "kitchen", "Mug|1"),
    ("mug", "hasMaterial", "ceramic", 1, "s1", "", "Mug|1"),
    ("bowl", "atLocation", "mug", 2, "s2", "bedroom", ""),
    ("bowl", "hasAffordance", "fill", 40, "", "", ""),
]
EVENTS = [
    {"metadata": {"sceneName": f"FloorPlan{plan}", "objects": THINGS[: plan + 3]}}
    for plan in (1, 2, 1)
]
HOME = {"rooms": [
    {"id": "r1", "name": "Living_Room",
     "objects": ["mug", {"id": 7, "class": "wall shelf", "material": None}]},
    {"id": "bedroom", "objects": [
        {"name": "mug_3", "class": "mug", "receptacle": "7", "materials": ["ceramic"],
         "affordance": ["fill", "put"]},
    ]},
]}  # fmt: skip
ENVIRONMENT: dict[str, Any] = {
    "nodes": [
        {"id": 1, "class_name": "kitchen", "category": "Rooms", "properties": []},
        {"id": 2, "class_name": "fridge", "category": "Appliances", "properties": ["CAN_OPEN"]},
        {
            "id": 3,
            "class_name": "milk",
            "category": "Food",
            "properties": ["DRINKABLE", "GRABBABLE"],
        },
    ],
    "edges": [
        {"from_id": start, "to_id": end, "relation_type": "INSIDE"}
        for start, end in ((2, 1), (3, 2))
    ],
}
GRAPHML = """<?xml version='1.0' encoding='utf-8'?>
<graphml xmlns="http://graphml.graphdrawing.org/xmlns">
<key id="k" for="node" attr.name="kind" attr.type="string"/>
<key id="r" for="edge" attr.name="relation" attr.type="string"/>
<key id="c" for="edge" attr.name="count" attr.type="long"/>
<graph edgedefault="directed">
<node id="mug"><data key="k">object</data></node>
<node id="kitchen"/>
<edge source="mug" target="kitchen"><data key="r">at</data><data key="c">3</data></edge>
</graph>
</graphml>
"""
TRIPLES_CSV = (
    b"head,relation,tail,count\nmug,atLocation,kitchen,3\nmug,hasMaterial,ceramic,1\n"
    b"bowl,hasAffordance,fill,2\n"
)
COLUMNS = ["head", "relation", "tail", "count", "scene", "room", "instance"]
ENTITIES = (
    "entity,kind,phrase\nmug,object,cup\nbowl,object,\nkitchen,room,kitchen\nceramic,material,\n"
    "fill,affordance,\n"
)
NT = """<http://x.org/mug> <http://x.org/atLocation> <http://x.org/kitchen> .
<http://x.org/mug> <http://www.w3.org/1999/02/22-rdf-syntax-ns#type> <http://x.org/Cup> .
<http://x.org/mug> <http://www.w3.org/2000/01/rdf-schema#label> "a \\u006dug"@en .
_:b <http://x.org/atLocation> <http://x.org/kitchen> .
<urn:x:bowl> <urn:x:near> <http://x.org/mug> .
<urn:x:bowl> <urn:x:weighs> "1.5"^^<http://www.w3.org/2001/XMLSchema#decimal> .
"""
TTL = """@prefix x: <http://x.org/> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
x:mug a x:Cup ; x:atLocation x:kitchen , x:bedroom ; rdfs:label "mug"@en .
x:bowl x:near [ x:near x:mug ] ; x:weighs 1.5 ; x:on true ; x:of ( x:clay x:glass ) .
"""
HOUSE = """ASCII 1.1
H 17DRP5sb8fy -  0 0 0 0 0 3 2 2 0 1  0 0 0 0 0  -1.5 0 0 2 3 2.4  0 0 0 0 0
L 0 2 - 0 0 0 -1.5 0 0 2 3 2.4 0 0 0 0 0
R 0 0 0 0 b  1 2 3  -1.5 0 0 2 3 2.4  2.5  0 0 0 0
R 1 0 0 0 k  1 2 3  -1.5 0 0 2 3 2.4  2.5  0 0 0 0
C 0 10 night#stand 11 chest_of_drawers 0 0 0 0 0
C 1 10 towel 11 towel 0 0 0 0 0
O 0 0 0 1 2 3 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0
O 1 1 1 1 2 3 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0
O 2 -1 -1 1 2 3 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0
"""
BEHAVIOR: Files = {
    "behavior/combined_room_object_list.json": json.dumps(
        {
            "scenes": {
                "House_0": {
                    "kitchen_0": {"stove-abcdef": 1, "bottom_cabinet-ghijkl": 2, "walls-bbbbbb": 4},
                    "childs_room_1": {"bottom_cabinet-mnopqr": 1},
                }
            }
        }
    ).encode(),
    "behavior/category_mapping.csv": (
        b"ID,category,synset\n1,stove,stove.n.01\n2,bottom_cabinet,cabinet.n.01\n"
        b"3,walls,wall.n.01\n"
    ),
    "behavior/propagated_annots_canonical.json": json.dumps(
        {"stove.n.01": {"heatSource": {}}, "cabinet.n.01": {"openable": {}}, "wall.n.01": {}}
    ).encode(),
}
IDS: Files = {
    "ids/entity2id.txt": b"3\nmug.o\t0\nkitchen.r\t1\nceramic.m\t2\n",
    "ids/relation2id.txt": b"2\natLocation\t0\nhasMaterial\t1\n",
    "ids/gt2id.txt": b"3\n0 1 0\n0 1 0\n0 2 1\n",
}
VECTORS = {"mug": [0.1, -0.25, 3.0], "house_plant": [1.0, 2.0, -1e-7], "café": [0.5, 0.5, 8.0]}
GLOVE = "".join(f"{token} {' '.join(map(repr, row))}\n" for token, row in VECTORS.items()).encode()
BINARY = b"3 3\n" + b"".join(
    token.encode() + b" " + struct.pack("<3f", *row) + b"\n" for token, row in VECTORS.items()
)
HEADER: Mapping[str, Any] = {"build": "thor-1", "package": "5.0.0"}


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


def shipped(*names: str, lines: int | None = None) -> Files:
    """Files under ``data/raw``, or their first ``lines`` lines."""
    contents = {f"data/raw/{name}": (ROOT / paths.RAW / name).read_bytes() for name in names}
    return {
        name: b"".join(content.splitlines(keepends=True)[:lines])
        for name, content in contents.items()
    }


def mined(section: dict[str, Any]) -> str:
    """Mine a source as its stage does, and check that its tables are valid;
    returns a hash of them and the counts.
    """
    shipped_names.cache_clear()
    source = Source(section, "sources.fuzz", 0)
    OBSERVATIONS.write_parts(OUT[0], source.frames(), MADE)
    KINDS.write_file(OUT[1], source.kinds, MADE)
    seen = OBSERVATIONS.read_file(OUT[0]), KINDS.read_file(OUT[1])
    return _lawful(*seen) + repr(sorted(source.counts.items()))


def _lawful(observations: pd.DataFrame, kinds: pd.DataFrame) -> str:
    plain, kinds = as_text(observations), as_text(kinds)
    names = {
        *plain["head"],
        *plain["relation"],
        *plain["tail"],
        *kinds["entity"],
        *kinds["kind"],
        *kinds["phrase"],
    }
    assert not list(filter(None, map(name_fault, names)))
    assert plain["count"].between(1, 2**31 - 1).all()
    assert plain["count"].sum() < 2**31
    assert kinds["entity"].is_unique
    assert set(kinds["entity"]) == {*plain["head"], *plain["tail"]}
    graph = build_tables(MinedSource("fuzz", observations, kinds))
    assert graph.triples["count"].sum() == plain["count"].sum()
    text = plain.to_csv(index=False) + kinds.to_csv(index=False)
    return hashlib.sha256(text.encode()).hexdigest()


def guessed(file: str) -> str:
    """Read a file as ``isi graph`` does, which detects the reader from the content."""
    graph, read = read_graph([file])
    return f"{read} {graph.triples.to_csv()} {graph.entities.to_csv()}"


def houses() -> str:
    """Mine a house; small tables replace those of the package, which are slow to read."""
    with mock.patch.multiple(
        procthor_houses, recorded_types=lambda _scenes: RECORDED, asset_types=lambda: ASSETS
    ):
        return mined(dict(PROCTHOR))


PROCTHOR = {
    "reader": "procthor_houses",
    "path": "houses.jsonl",
    "sha256": None,
    "materials": "simulator",
}
RECORDED = procthor_houses.recorded_types(
    [Scene("FloorPlan1", 1, "kitchen", scene_objects(Path(), "FloorPlan1", THINGS))]
)
ASSETS = {"Asset_1": "Mug"}


def words(file: str) -> str:
    """Read word vectors, and look up phrases."""
    given = look_up(read_vectors(Path(file)), ["mug", "house plant", "none of them"])
    return repr(given.served_by) + hashlib.sha256(given.vectors.tobytes()).hexdigest()


def gone_on_with() -> str:
    """Open a recording to continue it; an incomplete last line may be removed."""
    return repr(sorted(Recording(Path("r.jsonl.gz"), HEADER).names))


def pipeline_table() -> str:
    """Read a table of the pipeline."""
    return str(TRIPLES.read_file(Path("triples.parquet")).to_csv())


def pipeline_tensors() -> str:
    """Read tensors of the pipeline."""
    return repr(tables.read_tensors(Path("vectors.safetensors"), ["vectors"])["vectors"].shape)


def arrow_table() -> str:
    """The graph that ``isi.train`` makes of a table of pyarrow's."""
    with at("log.parquet"):
        table = pq.read_table("log.parquet")
    return str(tables_of(table).triples.to_csv())


TIME = re.compile(r"'(time|first_seen|last_seen)': '[^']*'")
"""When a change was made: two readings of the same requests differ in it."""

REQUESTS: list[dict[str, Any]] = [
    {"insert": "mug", "facts": [["mug", "in", "e1"], ["e2", "on", "mug"]], "kind": "place",
     "id": 1},
    {"insert": {"fork": {"in": ["e1", "e3"], "on": "mug"}, "bowl": {"on": "e4"}}, "new": True},
    {"observe": [["mug", "on", "e5"], ["e1", "on", "e1"]], "id": "a"},
    {"ask": ["mug", "in", None], "top": 2}, {"ask": ["mug", None, "e1"]}, {"explain": "fork"},
    {"history": True}, {"undo": True},
    {"remove": True, "facts": [["fork", "on", "mug"]]}, {"remove": "fork"},
    {"tell": [["e4", "near", "mug"], ["mug", "near", "e4", 0.5]], "confidence": 0.9},
    {"ask": ["e4", "near", None], "new": True, "among": ["mug", "e2"]},
    {"insert": "cup", "facts": [["cup", "in", "mug"]], "initializer": "map",
     "options": {"strength": 2.0}, "seed": 1}, {"ask": [None, "in", "mug"]},
    {"ask": [["mug", "in", None], [None, "on", "e2"]], "top": 1},
    {"move": ["mug", "in", "e7"], "source": "camera", "time": "2026-01-01T12:00:00Z"},
    {"move": ["e2", "on", "mug"], "instead_of": "e9"},
    {"history": True, "stale": "30d"},
    {"remove": True, "facts": [list(fact) for fact in KNOWN.named_triples()[:2]], "time": 1.5e9},
    {"observe": [list(KNOWN.named_triples()[0]), ["plate", "in", "e1"]], "upsert": True},
    {"insert": "mug", "facts": [["mug", "on", "e8"]], "upsert": True},
    {"undo": True, "source": "me"},
]  # fmt: skip


def stream() -> str:
    """Answer each line as ``isi live`` does; refused if all lines are.
    A copy of the home must have the same answers.
    """
    replies = list[dict[str, Any]]()
    with quick_choices(of_known=True):
        live = LiveEmbedding(KNOWN)
        for line in Path("requests.jsonl").read_bytes().split(b"\n"):
            whole = answer(live, line)
            assert whole.endswith(b"\n")
            assert whole.count(b"\n") == 1
            replies.append(json.loads(whole))
        assert_same(seen(live), seen(copy(live)))
    errors = [reply["error"] for reply in replies if "error" in reply]
    for error in errors:
        assert error.isprintable()
        assert len(error) < 300
        assert not error.startswith("internal")
    if len(errors) == len(replies):
        raise InputError("requests.jsonl", "", errors[0])
    return TIME.sub("", repr(replies))


class Output(Section):
    """What an output of a command is before the command, and whether it may be replaced."""

    way: Literal[
        "new", "input", "other", "hard link", "link to input", "link to other", "link to new",
        "pipe", "folder", "in a file",
    ]  # fmt: skip
    replace: bool = False


def outputs() -> str:
    """Write outputs as a command does; refused if all are. An input stays, and so do links, pipes
    and, unless they may be replaced, other files.
    """
    path = Path("outputs.json")
    listed = parse_json(list[Output], path.read_bytes(), path)
    results = list[str]()
    for output in listed:
        with tempfile.TemporaryDirectory() as folder:
            results.append(_output_written(Path(folder), output))
    if "written" not in results:
        raise InputError("outputs.json", "", "no output is written")
    return repr(results)


def _output_written(folder: Path, output: Output) -> str:
    given, other, out = folder / "input", folder / "other", folder / "out"
    given.write_text("input", encoding="utf-8")
    other.write_text("other", encoding="utf-8")
    match output.way.split():
        case ["hard", _]:
            out.hardlink_to(given)
        case ["link", _, name]:
            out.symlink_to(name)
        case ["pipe"]:
            os.mkfifo(out)
        case ["folder"]:
            out.mkdir()
        case ["in", *_]:
            out = other / "out"
        case [name]:
            out = folder / name
    is_link, is_pipe = out.is_symlink(), out.is_fifo()
    reader = os.open(out, os.O_RDONLY | os.O_NONBLOCK) if is_pipe else None
    try:
        write_outputs({out: "output"}, [given], output.replace)
        result = "written"
        assert (os.read(reader, 9) if reader else out.read_bytes()) == b"output"
    except InputError:
        result = "refused"
    finally:
        if reader:
            os.close(reader)
    assert given.read_text(encoding="utf-8") == "input"
    assert output.replace or other.read_text(encoding="utf-8") == "other"
    assert (out.is_symlink(), out.is_fifo()) == (is_link, is_pipe)
    return result


OUTPUTS = [
    {"way": way, "replace": replace}
    for way in get_args(Output.model_fields["way"].annotation)
    for replace in (False, True)
]


def package() -> bytes:
    """A recording in the format of the package ``procthor``:
    lists of scenes, of which most are empty.
    """
    scenes = {plans.key: [THINGS, *([[]] * (len(plans.names) - 1))] for plans in ITHOR}
    return json.dumps(scenes).encode()


def recorder() -> bytes:
    """A recording in the format of ``make record``, of two scenes."""
    scenes = [
        {"scene": plan, "spawn": spawn, "objects": THINGS}
        for plan, spawn in (("FloorPlan1", None), ("FloorPlan301", 4))
    ]
    return b"".join(
        gzip.compress(json.dumps(line).encode() + b"\n", mtime=0)
        for line in (FORMAT | HEADER, *scenes)
    )


def small_scene_graph() -> dict[str, Any]:
    """The scene graph of the tests, with only the attributes that mining reads and two more."""
    graph: dict[str, Any] = json.loads(
        (ROOT / "tests" / "scene_graph.json").read_text(encoding="utf-8")
    )
    for node in graph["nodes"]:
        names = ("type", "name", "semantic_label", "position", "metadata")
        node["attributes"] = {
            name: node["attributes"][name] for name in names if name in node["attributes"]
        }
    return graph


def parquet() -> bytes:
    out = io.BytesIO()
    pq.write_table(
        pa.Table.from_pylist([dict(zip(COLUMNS, row, strict=True)) for row in ROWS]), out
    )
    return out.getvalue()


def csv(separator: str) -> bytes:
    return "".join(separator.join(map(str, row)) + "\n" for row in [COLUMNS, *ROWS]).encode()


def triples() -> bytes:
    frame = (
        pd.DataFrame(ROWS, columns=COLUMNS)[COLUMNS[:4]].assign(source="x").sort_values(COLUMNS[:3])
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "triples.parquet"
        TRIPLES.write_file(path, frame, MADE)
        return path.read_bytes()


def tensors() -> bytes:
    values = {"dtype": "F32", "shape": [2, 3], "data_offsets": [0, 24]}
    header = json.dumps({"vectors": values}).encode()
    return struct.pack("<Q", len(header)) + header + struct.pack("<6f", *range(6))


def _source(files: Files, **section: Any) -> Format:
    """A format that is a source, with its section of params."""
    named = {name.removesuffix("_"): value for name, value in section.items()}
    return Format(files, partial(mined, named), OUT, named)


def _formats() -> dict[str, Format]:
    recording = {"sha256": None, "broken": "error", "materials": "simulator"}
    shares = shipped("suncg/material_shares.csv", "suncg/categories.csv")
    names = shipped("thor_u/names.csv", "virtualhome/names.csv", lines=40)
    mp3d = {
        "rooms": {"bedroom": "bedroom", "kitchen": "kitchen"},
        "vocabulary": "data/raw/mp3d/vocabulary.yaml",
    }
    labels = {"b": "bedroom", "k": "kitchen"}
    return {
        "recording of the package": _source(
            {"r.json": package()}, reader="ai2thor", from_="r.json", **recording
        ),
        "recording": _source(
            {"r.jsonl.gz": recorder()}, reader="ai2thor", from_="r.jsonl.gz", **recording
        ),
        "recording, untidy": _source(
            {"r.jsonl.gz": recorder()},
            reader="ai2thor",
            from_="r.jsonl.gz",
            **(recording | {"broken": "drop", "circular": "drop"}),
        ),
        "recording to continue": Format({"r.jsonl.gz": recorder()}, gone_on_with),
        "shares of materials": _source(
            shares | {"r.json": package()},
            reader="ai2thor",
            from_="r.json",
            **(recording | {"materials": "suncg"}),
        ),
        "scene": _source(
            {
                "scene.json": json.dumps(
                    {"metadata": {"sceneName": "FloorPlan1", "objects": THINGS}}
                ).encode()
            },
            reader="ai2thor_scene",
            path="scene.json",
        ),
        "scenes, lines": _source(
            {"scenes.jsonl": b"\n".join(json.dumps(event).encode() for event in EVENTS)},
            reader="ai2thor_scene",
            path="scenes.jsonl",
            room="kitchen",
        ),
        "scenes, list": _source(
            {"scenes.json": json.dumps(EVENTS).encode()}, reader="ai2thor_scene", path="scenes.json"
        ),
        "rooms": _source(
            {"home.json": json.dumps(HOME).encode()}, reader="rooms", path="home.json"
        ),
        "rooms, lines": _source(
            {"home.jsonl": json.dumps(HOME).encode() + b"\n" + json.dumps(HOME).encode()},
            reader="rooms",
            path="home.jsonl",
        ),
        "scene graph": _source(
            {"dsg.json": json.dumps(small_scene_graph()).encode()},
            reader="spark_dsg",
            path="dsg.json",
            rooms={"R(1)": "bedroom"},
        ),
        "VirtualHome": _source(
            {"home.json": json.dumps(ENVIRONMENT).encode()},
            reader="virtualhome_graph",
            path="home.json",
        ),
        "GraphML": _source(
            {"home.graphml": GRAPHML.encode()}, reader="graphml", path="home.graphml"
        ),
        "table without a header": _source(
            {"train.txt": b'mug\tat\tkitchen\n"tv 55"""\tat\thall\n'},
            reader="table",
            path="train.txt",
        ),
        "table of Wikidata": _source(
            {"query.csv": b"itemLabel,propLabel,valueLabel\nmug,at,kitchen\ncup,at,hall\n"},
            reader="table",
            path="query.csv",
        ),
        "table of a benchmark": _source(
            {"train.txt": b"e1\trel\te2\nmug\tat\tkitchen\ncup\tat\tkitchen\n"},
            reader="table",
            path="train.txt",
        ),
        "table of Arrow in Python": Format({"log.parquet": parquet()}, arrow_table),
        "folder of triples": _source(
            {"home/triples.csv": TRIPLES_CSV, "home/entities.csv": ENTITIES.encode()},
            reader="table",
            path="home",
        ),
        "file of any kind": Format(
            {"any.json": json.dumps({"scene": "FloorPlan1", "objects": THINGS}).encode()},
            partial(guessed, "any.json"),
        ),
        "houses of ProcTHOR": Format({"houses.jsonl": _house_lines()}, houses, OUT, PROCTHOR),
        "table, CSV": _source(
            {"log.csv": csv(","), "entities.csv": ENTITIES.encode()},
            reader="table",
            path="log.csv",
            entities="entities.csv",
        ),
        "table, TSV": _source(
            {"log.tsv.gz": gzip.compress(csv("\t"), mtime=0)}, reader="table", path="log.tsv.gz"
        ),
        "table, Parquet": _source({"log.parquet": parquet()}, reader="table", path="log.parquet"),
        "RDF, N-Triples": _source({"log.nt": NT.encode()}, reader="rdf", path="log.nt"),
        "RDF, Turtle": _source({"log.ttl": TTL.encode()}, reader="rdf", path="log.ttl"),
        "houses of Matterport3D": _source(
            {"houses/x.house": HOUSE.encode()} | shipped("mp3d/vocabulary.yaml"),
            reader="mp3d_houses",
            folder="houses",
            category="mpcat40",
            **(mp3d | {"rooms": labels}),
        ),
        "tallies of Matterport3D": _source(
            shipped("mp3d/room_object_counts.csv", lines=60) | shipped("mp3d/vocabulary.yaml"),
            reader="mp3d_tallies",
            **mp3d,
        ),
        "published graph": _source(
            shipped("published/triples.csv", lines=60) | shipped("published/phrases.csv"),
            reader="published",
        ),
        "shipped graph": _source(
            names | shipped("thor_u/triples.csv", lines=40),
            reader="triples_with_ids",
            from_="thor_u",
        ),
        "triples with ids": _source(IDS, reader="triples_with_ids", from_="ids"),
        "BEHAVIOR": _source(
            BEHAVIOR,
            reader="behavior",
            from_="behavior",
            structure=["wall.n.01"],
            names={},
            affordances={"openable": ["open", "close"], "heatSource": ["heat"]},
        ),
        "requests of a stream": Format(
            {"requests.jsonl": "\n".join(map(json.dumps, REQUESTS)).encode()}, stream
        ),
        "outputs of a command": Format({"outputs.json": json.dumps(OUTPUTS).encode()}, outputs),
        "words": Format({"words.txt": b"3 3\n" + GLOVE}, partial(words, "words.txt")),
        "words, GloVe": Format({"glove.txt": GLOVE}, partial(words, "glove.txt")),
        "words, binary": Format({"words.bin": BINARY}, partial(words, "words.bin")),
        "table of the pipeline": Format({"triples.parquet": triples()}, pipeline_table),
        "tensors": Format({"vectors.safetensors": tensors()}, pipeline_tensors),
    }


def _house_lines() -> bytes:
    cup = procthor.thing("Mug|surface|2|1", 1, 1)
    objects = procthor.thing("SideTable|2|0", 1, 1, cup), procthor.thing("small|3|1", 5, 3)
    return "\n".join(json.dumps(procthor.house(each)) for each in objects).encode()


FORMATS = _formats()
