"""Mistakes in files that are binary, large or made from valid ones; `files.yaml` has the others."""

import gzip
import json

from isi.sources.recordings import FORMAT
from tests.mistakes import (
    LOG,
    LONG,
    SPAWNED,
    Case,
    listed,
    log,
    of_file,
    recording,
    vectors,
)
from tools.fuzz.formats import FORMATS, HOME, THINGS, small_scene_graph

EVENTS = json.loads(FORMATS["scenes, list"].files["scenes.json"])
HOUSE = FORMATS["houses of Matterport3D"].files["houses/x.house"].decode()
NT = FORMATS["RDF, N-Triples"].files["log.nt"].decode()
GLOVE = FORMATS["words, GloVe"].files["glove.txt"]
BINARY = FORMATS["words, binary"].files["words.bin"]

SCENE = json.dumps(THINGS)
of_scene, of_recording = of_file("scene", "scene.json"), of_file("recording", "r.jsonl.gz")
of_lines = of_file("scenes, lines", "scenes.jsonl")
SCENE_CASES = [
    of_scene("UTF-16", SCENE.encode("utf-16")),
    of_scene("cut short", SCENE[:-1]),
    of_scene("lists in lists, 200,000 deep", "[" * 200_000 + "]" * 200_000),
    of_scene("a number of 5,000 digits", "[" + "9" * 5_000 + "]"),
    of_scene("more than a scene", " " * (2**26 + 1)),
    of_scene(
        "half a character (a lone surrogate) in an id", '[{"objectId": "\\ud800"}]', "column 22"
    ),
    of_scene("half a character in a type", SCENE.replace('"Mug"', '"Mug\\ud800"'), "column 67"),
    of_scene("a type of 10,000 characters", SCENE.replace('"Mug"', f'"{LONG}"'), "objectType"),
    of_scene(
        "more objects than any scene has",
        json.dumps([{"objectId": str(number), "objectType": "Mug"} for number in range(100_001)]),
        "scene",
    ),
    of_lines("a line that is no JSON", json.dumps(EVENTS[0]) + "\n{", "line 2"),
    of_lines("a line that is no event", json.dumps(EVENTS[0]) + '\n{"mug": {}}', "line 2"),
    of_file("rooms, lines", "home.jsonl")(
        "a line that is no JSON", json.dumps(HOME) + "\n[", "line 2"
    ),
    of_file("scene graph", "dsg.json")(
        "a number of thousands of digits",
        json.dumps(small_scene_graph()).replace('"id": ', f'"id": {"9" * 5000}', 1),
    ),
]

RECORDING_CASES = [
    of_recording("cut short", recording(SPAWNED)[:-12], "line 2"),
    of_recording("damaged", recording(SPAWNED) + b"????"),
    of_recording("a line that is no JSON", recording("["), "line 2"),
    of_recording(
        "a line in UTF-16", gzip.compress(json.dumps(FORMAT).encode() + b"\n\xff\xfe{\0"), "line 2"
    ),
    of_recording("no scenes", recording()),
    of_recording("a line that is too long", gzip.compress(bytes(2**26 + 1), 1), "line 1"),
    Case(
        "JSON that is too long", "recording of the package", {"r.json": bytes(2**27 + 1)}, "r.json"
    ),
]

of_rdf = of_file("RDF, N-Triples", "log.nt")


TABLE_CASES = [
    log("text in another encoding", LOG + "caf\udce9,atLocation,kitchen\n", "line 3"),
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
    of_rdf("two things of one name", NT + "<urn:x:mug> <urn:x:near> <urn:x:bowl> .\n", "urn:x:mug"),
    of_rdf("a line of five million characters", NT + "x" * 5_000_000, "Invalid line"),
    of_rdf(
        "a thing without a name", NT + "<http://x.org/> <urn:x:near> <urn:x:%20> .\n", "urn:x:%20"
    ),
]


of_matterport = of_file("houses of Matterport3D", "houses/x.house")
MP3D_CASES = [
    of_matterport("cut short", HOUSE[:-60], "line 2"),
    of_matterport("a record of no known kind", HOUSE.replace("L 0", f"{LONG} 0", 1), "line 3"),
    of_matterport(
        "a number of 5,000 digits", HOUSE.replace("O 0 0", f"O {'9' * 5000} 0", 1), "line 8"
    ),
    of_matterport(
        "a category of 10,000 characters", HOUSE.replace("11 towel", f"11 {LONG}", 1), "line 9"
    ),
    Case(
        "a house twice",
        "houses of Matterport3D",
        {"houses/y.house": HOUSE},
        "houses/y.house|house '17DRP5sb8fy'",
    ),
]

WORD_CASES = [
    vectors("no text", b"\xff\xfe1 2\n", ""),
    vectors("a line cut in the middle", GLOVE[:-9], "cut"),
    vectors("a number cut in the middle", GLOVE[:-2], "cut"),
    vectors("what is no number", GLOVE + b"bowl 1 x 2\n", "'x'"),
    vectors("too many numbers", b"3 3\n" + GLOVE.replace(b" 0.1", b" 0.1 4"), "numbers"),
    vectors("a number behind the token", GLOVE + b". 1 2 3 4\n", "numbers"),
    vectors("two spaces", GLOVE + b"bowl  1 2 3\n", "numbers"),
    vectors("numbers of 10¹⁷", GLOVE + b"bowl 1e17 1 1\n", "vector of 'bowl'"),
    vectors("what is not a number (NaN)", GLOVE + b"bowl nan 1 1\n", "vector of 'bowl'"),
    vectors("binary, cut short", BINARY[:-6], "unexpected end", binary=True),
    vectors("binary, of another dimension", BINARY.replace(b"3 3\n", b"3 2\n"), "", binary=True),
]

FILE_CASES = [
    *listed(),
    *SCENE_CASES,
    *RECORDING_CASES,
    *TABLE_CASES,
    *RDF_CASES,
    *MP3D_CASES,
    *WORD_CASES,
]
