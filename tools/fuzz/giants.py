"""Files of extreme size or depth, for each format that allows them."""

import gzip
import json
import struct
from collections.abc import Callable

from isi.sources.recordings import FORMAT
from tests import procthor
from tools.fuzz.formats import HEADER, HOUSE
from tools.fuzz.mutations import Files

MANY, DEEP = 1_000_000, 1_000_000


def things(number: int) -> bytes:
    """Objects of a scene as JSON; each object is in the previous one."""
    rows = (
        f'{{"objectId":"{n}","objectType":"Mug","parentReceptacles":["{n - 1}"]}}'
        for n in range(1, number)
    )
    return ('[{"objectId":"0","objectType":"Mug"},' + ",".join(rows) + "]").encode()


def crossing(number: int) -> bytes:
    """Objects of a scene as JSON; each object is in all others."""
    ids = [str(n) for n in range(number)]
    others = {name: [other for other in ids if other != name] for name in ids}
    return json.dumps(
        [
            {
                "objectId": name,
                "objectType": "Mug",
                "parentReceptacles": rest,
                "receptacleObjectIds": rest,
            }
            for name, rest in others.items()
        ]
    ).encode()


def line(objects: bytes) -> bytes:
    """A recording of one scene with these objects."""
    head = json.dumps(FORMAT | dict(HEADER)).encode()
    return gzip.compress(
        head + b'\n{"scene": "FloorPlan1", "spawn": null, "objects": ' + objects + b"}\n",
        1,
        mtime=0,
    )


def house(objects: int, corners: int) -> bytes:
    """A house of one room, with these numbers of objects and of corners of the floor."""
    made = procthor.house()
    made["rooms"] = [
        made["rooms"][0] | {"floorPolygon": [{"x": n % 7, "z": n % 5} for n in range(corners)]}
    ]
    text = json.dumps(made)
    rows = (f'{{"id":"Mug|{n}","assetId":"A","position":{{"x":1,"z":1}}}}' for n in range(objects))
    return text.replace('"objects": []', f'"objects": [{",".join(rows)}]').encode()


def nested_house(depth: int) -> bytes:
    """A house with objects in objects, to this depth."""
    item = '{"id":"Mug|1","assetId":"A","position":{"x":1,"z":1},"children":['
    return (
        json.dumps(procthor.house())
        .replace('"objects": []', f'"objects": [{item * depth}{"]}" * depth}]')
        .encode()
    )


def rows(number: int, separator: bytes = b",") -> bytes:
    """A table of ``number`` triples, each with a new entity."""
    lines = (b"e%d%snear%se%d\n" % (n, separator, separator, n * 7 % number) for n in range(number))
    return separator.join([b"head", b"relation", b"tail"]) + b"\n" + b"".join(lines)


def deep(opening: bytes, closing: bytes) -> bytes:
    return opening * DEEP + closing * DEEP


#: By title: the format, and a function that makes the files.
GIANTS: dict[str, tuple[str, Callable[[], Files]]] = {
    "a scene of a million objects": ("scene", lambda: {"scene.json": things(MANY)}),
    "a scene of 100,000 objects": ("scene", lambda: {"scene.json": things(100_000)}),
    "a recorded scene of a million objects": (
        "recording",
        lambda: {"r.jsonl.gz": line(things(MANY))},
    ),
    "a recorded scene of 100,000 objects": (
        "recording",
        lambda: {"r.jsonl.gz": line(things(100_000))},
    ),
    "a chain of 100,000 receptacles, looked at for circles": (
        "recording, untidy",
        lambda: {"r.jsonl.gz": line(things(100_000))},
    ),
    "1,000 objects in each other": (
        "recording, untidy",
        lambda: {"r.jsonl.gz": line(crossing(1_000))},
    ),
    "a house of a million objects": (
        "houses of ProcTHOR",
        lambda: {"houses.jsonl": house(MANY, 4)},
    ),
    "a house of 10,000 objects": (
        "houses of ProcTHOR",
        lambda: {"houses.jsonl": house(10_000, 1_000)},
    ),
    "a floor of a million corners": (
        "houses of ProcTHOR",
        lambda: {"houses.jsonl": house(10, MANY)},
    ),
    "objects in objects, a hundred deep": (
        "houses of ProcTHOR",
        lambda: {"houses.jsonl": nested_house(100)},
    ),
    "objects in objects, a million deep": (
        "houses of ProcTHOR",
        lambda: {"houses.jsonl": nested_house(100_000)},
    ),
    "lists in lists in a scene, a million deep": (
        "scene",
        lambda: {"scene.json": deep(b"[", b"]")},
    ),
    "lists in lists of any kind, a million deep": (
        "file of any kind",
        lambda: {"any.json": deep(b"[", b"]")},
    ),
    "mappings in mappings, a million deep": (
        "recording of the package",
        lambda: {"r.json": deep(b'{"kitchens":', b"}")},
    ),
    "lists in lists in a recording": (
        "recording",
        lambda: {"r.jsonl.gz": gzip.compress(deep(b"[", b"]"), 1)},
    ),
    "lists in lists in BEHAVIOR": (
        "BEHAVIOR",
        lambda: {"behavior/combined_room_object_list.json": deep(b'{"scenes":', b"}")},
    ),
    "lists in lists in Turtle": (
        "RDF, Turtle",
        lambda: {"log.ttl": b"<a:b> <a:c> " + deep(b"(", b")") + b" ."},
    ),
    "a table of 100,000 triples": (
        "table, TSV",
        lambda: {"log.tsv.gz": gzip.compress(rows(100_000, b"\t"), 1)},
    ),
    "a line of 60 million characters": (
        "table, CSV",
        lambda: {"log.csv": b"head,relation,tail\n" + b"x" * 60_000_000},
    ),
    "a gigabyte of zeros, compressed": (
        "table, TSV",
        lambda: {"log.tsv.gz": gzip.compress(bytes(2**30), 1)},
    ),
    "a recording of a gigabyte of zeros": (
        "recording",
        lambda: {"r.jsonl.gz": gzip.compress(bytes(2**30), 1)},
    ),
    "a recording of zeros to go on with": (
        "recording to continue",
        lambda: {"r.jsonl.gz": gzip.compress(bytes(2**30), 1)},
    ),
    "a house of a million records": (
        "houses of Matterport3D",
        lambda: {"houses/x.house": (HOUSE + "V 0 0 - 1 2 3\n" * MANY).encode()},
    ),
    "a number of a million digits": ("scene", lambda: {"scene.json": b"[" + b"9" * MANY + b"]"}),
    "counts of a million digits": (
        "table, CSV",
        lambda: {"log.csv": b"head,relation,tail,count\na,b,c," + b"9" * 100_000 + b"\n"},
    ),
    "vectors of 100,000 numbers": (
        "words, GloVe",
        lambda: {"glove.txt": b"mug" + b" 0.5" * 100_000 + b"\n"},
    ),
    "a million vectors": (
        "words, GloVe",
        lambda: {"glove.txt": b"".join(b"w%d 0.5 0.25 1\n" % n for n in range(MANY))},
    ),
    "a header that promises a billion vectors": (
        "words, binary",
        lambda: {"words.bin": b"999999999 1000\nmug " + struct.pack("<f", 1.0) * 1_000},
    ),
}
