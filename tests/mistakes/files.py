"""Mistakes in files that are binary, large or made from valid ones; `files.yaml` has the others."""

import gzip
import json

from isi.sources.recordings import FORMAT
from tests import procthor
from tests.mistakes import (
    LOG,
    LONG,
    MUG,
    SHELF,
    Case,
    changed,
    house,
    listed,
    log,
    mug,
    of_file,
    recording,
    scene,
    spawned,
    vectors,
)
from tools.fuzz.formats import FORMATS, HOME, THINGS, small_scene_graph

EVENTS = json.loads(FORMATS["scenes, list"].files["scenes.json"])
HOUSE = FORMATS["houses of Matterport3D"].files["houses/x.house"].decode()
NT = FORMATS["RDF, N-Triples"].files["log.nt"].decode()
GLOVE = FORMATS["words, GloVe"].files["glove.txt"]
BINARY = FORMATS["words, binary"].files["words.bin"]

of_scene, of_recording = of_file("scene", "scene.json"), of_file("recording", "r.jsonl.gz")
of_houses, MUG_ID = of_file("houses of ProcTHOR", "houses.jsonl"), MUG["objectId"]
SCENE_CASES = [
    of_scene("UTF-16", scene().encode("utf-16")),
    of_scene("cut short", scene()[:-1]),
    of_scene("lists in lists, 200,000 deep", "[" * 200_000 + "]" * 200_000),
    of_scene("a number of 5,000 digits", "[" + "9" * 5_000 + "]"),
    of_scene("more than a scene", " " * (2**26 + 1)),
    of_scene("a name that is none", json.dumps({"sceneName": "a\tb", "objects": THINGS}), "scene"),
    of_scene(
        "half a character (a lone surrogate) in an id",
        scene(MUG | {"objectId": "\ud800"}),
        "column 22",
    ),
    of_scene(
        "an id twice, with another type",
        scene(SHELF, SHELF | {"objectType": "Desk"}),
        "scene, object Shelf|1",
    ),
    of_scene(
        "more objects than any scene has",
        json.dumps([{"objectId": str(number), "objectType": "Mug"} for number in range(100_001)]),
        "scene",
    ),
    mug("a type that is no name", "scene.0|objectType|'../Mug'", objectType="../Mug"),
    of_scene("half a character in a type", scene(MUG | {"objectType": "Mug\ud800"}), "column 67"),
    mug("a type of 10,000 characters", "scene.0|objectType", objectType=LONG),
    mug("no list where one is read", "scene.0|parentReceptacles", parentReceptacles="Shelf|1"),
    mug(
        "the same receptacle twice",
        "scene.0|parentReceptacles",
        parentReceptacles=["Shelf|1", "Shelf|1"],
    ),
    mug("a material that is blank", "scene.0|salientMaterials", salientMaterials=[" "]),
    mug("a flag that is text", "scene.0|openable|'false'", openable="false"),
    mug(
        "a receptacle that the scene lacks",
        f"{MUG_ID}|'Desk|1'",
        parentReceptacles=["Shelf|1", "Desk|1"],
    ),
    mug("an object in itself", f"{MUG_ID}|", parentReceptacles=["Shelf|1", MUG_ID]),
    mug("contents that are not there", f"{MUG_ID}|'Pea|1'", receptacleObjectIds=["Pea|1"]),
    mug("contents that lie elsewhere", f"{MUG_ID}|'Fork|1'", receptacleObjectIds=["Fork|1"]),
]

of_lines, of_list = of_file("scenes, lines", "scenes.jsonl"), of_file("scenes, list", "scenes.json")
of_rooms, of_states = of_file("rooms", "home.json"), of_file("rooms, lines", "home.jsonl")
of_graph = of_file("scene graph", "dsg.json")


def graph(*keys: str | int, value: object) -> str:
    """A scene graph with another value at these keys, as JSON."""
    changed = part = small_scene_graph()
    for key in keys[:-1]:
        part = part[key]  # type: ignore[index]
    part[keys[-1]] = value  # type: ignore[index]
    return json.dumps(changed)


def hall(*objects: object) -> str:
    return json.dumps({"rooms": [{"name": "hall", "objects": objects}]})


EVENT_CASES = [
    of_lines("a line that is no JSON", json.dumps(EVENTS[0]) + "\n{", "line 2"),
    of_lines("a line that is no event", json.dumps(EVENTS[0]) + '\n{"mug": {}}', "line 2"),
    of_list("an event that is none", json.dumps([*EVENTS, 3]), "event 3"),
    of_list(
        "a type that is no name",
        json.dumps([*EVENTS, {"objects": [MUG | {"objectType": "../Mug"}]}]),
        "event 3, scene.0.objectType|'../Mug'",
    ),
    of_states("a line that is no JSON", json.dumps(HOME) + "\n[", "line 2"),
    of_graph("an edge to a node that is missing", graph("edges", 0, "target", value=5), "edges.0"),
    of_graph("a layer that is text", graph("nodes", 1, "layer", value="ROOMS"), "nodes.1.layer"),
    of_graph(
        "a number of thousands of digits",
        graph("nodes", 0, "id", value=0).replace("0", "9" * 5000, 1),
    ),
    of_graph(
        "a label that is no text",
        graph("metadata", "labelspaces", "_l2p0", 0, value=[5, 3]),
        "_l2p0.0",
    ),
    of_graph(
        "a label that is no name",
        graph("metadata", "labelspaces", "_l2p0", 0, value=[5, "a\x1bb"]),
        "node ",
    ),
    of_graph("no label", graph("metadata", value={}), "labels"),
]

RECORDING_CASES = [
    of_recording("cut short", recording(spawned())[:-12], "line 2"),
    of_recording("damaged", recording(spawned()) + b"????"),
    of_recording("another header", recording(spawned(), header=FORMAT | {"version": 2}), "line 1"),
    of_recording("a line that is no JSON", recording("["), "line 2"),
    of_recording(
        "a line in UTF-16", gzip.compress(json.dumps(FORMAT).encode() + b"\n\xff\xfe{\0"), "line 2"
    ),
    of_recording("a line that is no scene", recording(spawned(spawn="3")), "line 2"),
    of_recording("objects that are no list", recording(spawned(objects={})), "FloorPlan1"),
    of_recording(
        "another simulator's floor plan", recording(spawned("FloorPlan_Train1_1")), "line 2"
    ),
    of_recording("a layout twice", recording(spawned(spawn=1), spawned(spawn=1)), "line 3"),
    of_recording("no scenes", recording()),
    of_recording("scenes without objects", recording(spawned(objects=[]))),
    of_recording("a line that is too long", gzip.compress(bytes(2**26 + 1), 1), "line 1"),
    Case(
        "JSON that is too long", "recording of the package", {"r.json": bytes(2**27 + 1)}, "r.json"
    ),
]

HOUSE_CASES = [
    of_houses("a line that is no JSON", house() + "\n{", "line 2"),
    of_houses("half a character", house(procthor.thing("Mug\ud800", 1, 1)), "line 1"),
    of_houses(
        "a floor at infinity",
        house(procthor.thing("Mug|2|0", float("inf"), 1)),
        "line 1, objects.0.position.x",
    ),
    of_houses("two rooms of one id", house(rooms=procthor.house()["rooms"][:1] * 2), "line 1"),
    of_houses(
        "floors of more corners than any has",
        house(rooms=[procthor.house()["rooms"][0] | {"floorPolygon": [{"x": 0, "z": 0}] * 2_001}]),
        "line 1",
    ),
    of_houses(
        "more objects than any house has",
        house(*[procthor.thing("Mug|2|0", 1, 1)] * 10_001),
        "line 1",
    ),
    of_houses(
        "an object of no known type",
        house(procthor.thing("small|2|0", 1, 1, asset="Gizmo")),
        "line 1",
    ),
    of_houses("a line that is too long", bytes(2**24 + 1), "line 1"),
    of_houses("no object in a room", house(procthor.thing("Mug|2|0", 99, 1))),
]

of_rdf = of_file("RDF, N-Triples", "log.nt")


TABLE_CASES = [
    log("text in another encoding", LOG + "caf\udce9,atLocation,kitchen\n", "line 3|UTF-8"),
    log("a name of 10,000 characters", LOG + f"{LONG},atLocation,kitchen\n", "line 3"),
    log("a name with a control character", LOG + "a\x1b[2J,atLocation,kitchen\n", "line 3"),
    log(
        "a count of 5,000 digits", "head,relation,tail,count\na,b,c," + "9" * 5_000 + "\n", "line 2"
    ),
    Case(
        "a compressed file that is cut short",
        "table, TSV",
        {"log.tsv.gz": gzip.compress(LOG.encode())[:-9]},
        "log.tsv.gz",
    ),
]

RDF_CASES = [
    of_rdf("two things of one name", NT + "<urn:x:mug> <urn:x:near> <urn:x:bowl> .\n", "line 7"),
    of_rdf("a thing without a name", NT + "<http://x.org/> <urn:x:near> <urn:x:%20> .\n", "line 7"),
]


def house_of_matterport(what: str, old: str, new: str, line: int) -> Case:
    """A case with a mistake in a line of a house of Matterport3D; ``new`` replaces ``old``."""
    return changed(
        what, "houses of Matterport3D", "houses/x.house", old, new, f"houses/x.house|line {line}"
    )


MP3D_CASES = [
    Case(
        "cut short",
        "houses of Matterport3D",
        {"houses/x.house": HOUSE[:-60]},
        "houses/x.house|line 2",
    ),
    house_of_matterport("a record of no known kind", "L 0", f"{LONG} 0", 3),
    house_of_matterport("a number of 5,000 digits", "O 0 0", f"O {'9' * 5000} 0", 8),
    house_of_matterport("a category of 10,000 characters", "11 towel", f"11 {LONG}", 9),
    Case(
        "a house twice",
        "houses of Matterport3D",
        {"houses/y.house": HOUSE},
        "houses/y.house|house '17DRP5sb8fy'",
    ),
]

WORD_CASES = [
    vectors("no text", b"\xff\xfe1 2\n", ""),
    vectors("a line cut in the middle", GLOVE[:-9], "line 3"),
    vectors("a number cut in the middle", GLOVE[:-2], "line 3|line end"),
    vectors("what is no number", GLOVE + b"bowl 1 x 2\n", "'x'"),
    vectors("too many numbers", b"3 3\n" + GLOVE.replace(b" 0.1", b" 0.1 4"), "line 2"),
    vectors("a number behind the token", GLOVE + b". 1 2 3 4\n", "line 4"),
    vectors("two spaces", GLOVE + b"bowl  1 2 3\n", "line 4"),
    vectors("no token", GLOVE + b" 1 2 3\n", "line 4"),
    vectors("numbers of 10¹⁷", GLOVE + b"bowl 1e17 1 1\n", "vector of 'bowl'"),
    vectors("what is not a number (NaN)", GLOVE + b"bowl nan 1 1\n", "vector of 'bowl'"),
    vectors("binary, cut short", BINARY[:-6], "unexpected end", binary=True),
    vectors("binary, of another dimension", BINARY.replace(b"3 3\n", b"3 2\n"), "", binary=True),
]

FILE_CASES = [
    *listed(),
    *SCENE_CASES,
    *EVENT_CASES,
    *RECORDING_CASES,
    *HOUSE_CASES,
    *TABLE_CASES,
    *RDF_CASES,
    *MP3D_CASES,
    *WORD_CASES,
]
