"""Files of extreme size or depth, for each format that allows them."""

import gzip
import json
import struct
from collections.abc import Callable
from typing import Any

from isi.sources.recordings import FORMAT
from tools.fuzz.formats import FORMATS, HEADER, Files

MANY, DEEP, HUGE = 1_000_000, 1_000_000, 2**30
HOUSE = FORMATS["houses of Matterport3D"].files["houses/x.house"]


def joined(*parts: tuple[bytes, int]) -> bytes:
    """Each text as often as its number says."""
    return b"".join(text * number for text, number in parts)


def things(number: int) -> bytes:
    """Objects of a scene as JSON; each object is in the previous one."""
    rows = (
        f'{{"objectId":"{n}","objectType":"Mug","parentReceptacles":["{n - 1}"]}}'
        for n in range(1, number)
    )
    return ('[{"objectId":"0","objectType":"Mug"},' + ",".join(rows) + "]").encode()


def crossing(number: int) -> bytes:
    """Objects of a scene as JSON; each object is in all others."""
    ids = {str(n) for n in range(number)}
    others = {name: sorted(ids - {name}) for name in sorted(ids)}
    alike = {"objectType": "Mug"}
    return json.dumps(
        [
            alike | {"objectId": name, "parentReceptacles": rest, "receptacleObjectIds": rest}
            for name, rest in others.items()
        ]
    ).encode()


def recording(make: Callable[[int], bytes], number: int) -> bytes:
    """A recording of one scene with the objects of ``make``."""
    scene = b'\n{"scene": "FloorPlan1", "spawn": null, "objects": ' + make(number) + b"}\n"
    return json.dumps(FORMAT | dict(HEADER)).encode() + scene


def triples(number: int) -> bytes:
    """A table of ``number`` triples, each with a new entity."""
    rows = (b"e%d\tnear\te%d\n" % (n, n * 7 % number) for n in range(number))
    return b"head\trelation\ttail\n" + b"".join(rows)


def vectors(number: int) -> bytes:
    return b"".join(b"w%d 0.5 0.25 1\n" % n for n in range(number))


SCENE, RECORDING, UNTIDY = ("scene", "scene.json"), ("recording", "r.jsonl.gz"), "recording, untidy"
CSV, TSV = ("table, CSV", "log.csv"), ("table, TSV", "log.tsv.gz")
LISTS = (b"[", DEEP), (b"]", DEEP)
SCENES = (b'{"scenes":', DEEP), (b"}", DEEP)
#: By title: the format, the file, the function that makes the file, and its arguments.
GIANTS: dict[str, tuple[Any, ...]] = {
    "a scene of a million objects": (*SCENE, things, MANY),
    "a scene of 100,000 objects": (*SCENE, things, 100_000),
    "a recorded scene of a million objects": (*RECORDING, recording, things, MANY),
    "a recorded scene of 100,000 objects": (*RECORDING, recording, things, 100_000),
    "a chain of 100,000 receptacles, looked at for circles": (
        UNTIDY, "r.jsonl.gz", recording, things, 100_000,
    ),
    "1,000 objects in each other": (UNTIDY, "r.jsonl.gz", recording, crossing, 1_000),
    "lists in lists in a scene, a million deep": (*SCENE, joined, *LISTS),
    "lists in lists of any kind, a million deep": (
        "file of any kind", "any.json", joined, *LISTS,
    ),
    "mappings in mappings, a million deep": (
        "recording of the package", "r.json", joined, (b'{"kitchens":', DEEP), (b"}", DEEP),
    ),
    "lists in lists in a recording": (*RECORDING, joined, *LISTS),
    "mappings in mappings in BEHAVIOR": (
        "BEHAVIOR", "behavior/combined_room_object_list.json", joined, *SCENES,
    ),
    "lists in lists in Turtle": (
        "RDF, Turtle", "log.ttl", joined,
        (b"<a:b> <a:c> ", 1), (b"(", DEEP), (b")", DEEP), (b" .", 1),
    ),
    "a table of 100,000 triples": (*TSV, triples, 100_000),
    "a line of 60 million characters": (
        *CSV, joined, (b"head,relation,tail\n", 1), (b"x", 60_000_000),
    ),
    "a gigabyte of zeros, compressed": (*TSV, bytes, HUGE),
    "a recording of a gigabyte of zeros": (*RECORDING, bytes, HUGE),
    "a recording of zeros to go on with": ("recording to continue", "r.jsonl.gz", bytes, HUGE),
    "a house of a million records": (
        "houses of Matterport3D", "houses/x.house", joined,
        (HOUSE, 1), (b"V 0 0 - 1 2 3\n", MANY),
    ),
    "a number of a million digits": (*SCENE, joined, (b"[", 1), (b"9", MANY), (b"]", 1)),
    "counts of 100,000 digits": (
        *CSV, joined, (b"head,relation,tail,count\na,b,c,", 1), (b"9", 100_000), (b"\n", 1),
    ),
    "vectors of 100,000 numbers": (
        "words, GloVe", "glove.txt", joined, (b"mug", 1), (b" 0.5", 100_000), (b"\n", 1),
    ),
    "a million vectors": ("words, GloVe", "glove.txt", vectors, MANY),
    "a header that promises a billion vectors": (
        "words, binary", "words.bin", joined,
        (b"999999999 1000\nmug ", 1), (struct.pack("<f", 1.0), 1_000),
    ),
}  # fmt: skip


def giant(title: str) -> tuple[str, Files]:
    """The format and the files of a giant."""
    name, file, make, *arguments = GIANTS[title]
    content = make(*arguments)
    packed = gzip.compress(content, 1, mtime=0) if file.endswith(".gz") else content
    return name, FORMATS[name].files | {file: packed}
