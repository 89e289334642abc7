"""Files of houses in ProcTHOR's format: what is read of them, and what is refused."""

from __future__ import annotations

import gzip
import hashlib
import json
import re
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from isi.errors import InputError
from isi.sources import _houses as reading
from isi.sources._houses import Point, Room, houses, named_by
from isi.sources.procthor_houses import numbered
from tests.procthor import KITCHEN, floor, house, thing
from tools import make_houses


@pytest.mark.parametrize("indent", [None, 2])
@pytest.mark.parametrize("packed", [False, True])
def test_a_house_may_be_a_line_or_a_file_plain_or_packed(tmp_path: Path, indent: int | None, packed: bool) -> None:
    content = json.dumps(house(thing("Mug|2|0", 1, 1)), indent=indent).encode()
    content = content if indent else b"\n" + content + b"\n\n"
    path = tmp_path / f"x.json{'' if indent else 'l'}{'.gz' if packed else ''}"
    path.write_bytes(gzip.compress(content) if packed else content)
    [(line, read)] = houses(path, hashlib.sha256(path.read_bytes()).hexdigest())
    assert line == (1 if indent else 2)
    assert [item.id for item in read.objects or ()] == ["Mug|2|0"]


def broken(key: str, value: object) -> bytes:
    """A house with another value at a dotted key, or without it."""
    whole: Any = house(thing("Mug|2|0", 1, 1, thing("Pen|2|1", 1, 1)))
    *way, last = [int(step) if step.isdigit() else step for step in key.split(".")]
    at = whole
    for step in way:
        at = at[step]
    at[last] = value
    if value is None:
        del at[last]
    return json.dumps(whole).encode()


LINE = json.dumps(house(thing("Mug|2|0", 1, 1))).encode() + b"\n"
SENTENCE = r"[^\x00-\x1f\x7f]{1,400}"


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "expected houses, found none"),
        (b"\n\n", "expected houses, found none"),
        (LINE + LINE[:-30], "line 2: expected a house: Invalid JSON"),
        (gzip.compress(LINE * 99)[:-30], "line .*: expected a house as JSON .*ended"),
        (gzip.compress(LINE)[:15] + b"\0" * 40, "line 1: expected a house as JSON"),
        (LINE.decode().encode("utf-16"), "line 1: expected a house: Invalid JSON"),
        (LINE + LINE.replace(b"Mug", b"M\xfcg"), "line 2: expected a house: Invalid JSON"),
        (b"head,relation,tail\nmug,atLocation,kitchen\n", "line 1: expected a house"),
        (b'{"kitchens": []}', "line 1, rooms: expected a house: Field required"),
        (b"[" * 100_000, "line 1: expected a house"),
        (b"[[]]", "line 1: expected a house: .*object"),
        (broken("metadata.schema", "2.0.0"), "line 1, metadata.schema: .*'2.0.0'"),
        (broken("rooms", []), "line 1, rooms: .*at least 1"),
        (broken("rooms.1.id", "room|2"), "line 1: two rooms have the same id"),
        (broken("rooms.1.roomType", "a\nb"), r"line 1, rooms.1.roomType: .*'a\\nb'"),
        (broken("rooms.1.floorPolygon", floor(KITCHEN[:2])), "rooms.1.floorPolygon: .*at least 3"),
        (broken("rooms.0.floorPolygon.2.x", "4.0"), "rooms.0.floorPolygon.2.x: .*number, got '4.0'"),
        (broken("objects.0.position.z", True), "objects.0.position.z: .*number"),
        (broken("objects.0.position.z", float("nan")), "objects.0.position.z: .*finite"),
        (broken("objects.0.position.x", 10**400), "objects.0.position.x"),
        (broken("objects.0.children.0.position", None), "objects.0.children.0.position: .*required"),
        (broken("objects.0.children.0.id", None), "objects.0.children.0.id: .*required"),
        (broken("objects.0.id", "Mug\0|2|0"), r"objects.0.id: .*'Mug\\x00"),
        (broken("objects.0.id", "M" * 10_000), r"objects.0.id: .*at most 200.*\.\.\."),
        (broken("objects.0.id", "../../etc"), r"line 1: object '\.\./\.\./etc': expected an id such as 'Bed"),
        (broken("objects.0.id", "small|2|0"), "object 'small.2.0': .*or a known asset, got 'Asset_1'"),
        (broken("objects", "none"), "line 1, objects: .*'none'"),
    ],
    ids=lambda value: value[:30] if isinstance(value, str) else "",
)
def test_what_is_no_house_is_told_in_one_line_with_its_place(tmp_path: Path, content: bytes, told: str) -> None:
    path = tmp_path / "x.jsonl"
    path.write_bytes(content)
    with pytest.raises(InputError, match=told) as refused:
        list(numbered(path, None))
    line = str(refused.value)
    assert line.startswith(f"{path}: ")
    assert re.fullmatch(SENTENCE, line)


def test_files_that_are_missing_folders_too_long_or_others_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x.jsonl"
    with pytest.raises(InputError, match=r"x\.jsonl: .*No such file"):
        list(houses(path, None))
    with pytest.raises(InputError, match="directory"):
        list(houses(tmp_path, None))
    path.write_bytes(LINE)
    with pytest.raises(InputError, match=f"expected {'0' * 64} as its sha256, got "):
        list(houses(path, "0" * 64))
    monkeypatch.setattr(reading, "LONGEST", 100)
    with pytest.raises(InputError, match="line 1: longer than 100 bytes"):
        list(houses(path, None))


@pytest.mark.parametrize(
    ("identifier", "kind", "room"),
    [
        ("Bed|2|0", "Bed", "room|2"),
        ("Pillow|2|0|1", "Pillow", "room|2"),
        ("Book|surface|12|3", "Book", "room|12"),
        ("small|4|0", None, "room|4"),
        ("4|0|1", None, "room|4"),
        ("Bed", "Bed", None),
        ("sofa-0 (living room)", None, None),
    ],
)
def test_ids_of_both_versions_name_a_type_or_none_and_a_room(
    identifier: str, kind: str | None, room: str | None
) -> None:
    assert named_by(identifier) == (kind, room)


@given(st.integers(0, 10_000), st.integers(1, 10), st.floats(0.001, 0.999), st.floats(0.001, 0.999))
def test_each_point_of_a_floor_plan_is_in_the_one_room_that_it_was_cut_into(
    seed: int, number: int, along: float, across: float
) -> None:
    areas = make_houses.layout(Random(seed), number)
    width = max(x1 for area in areas for _, _, x1, _ in area)
    depth = max(z1 for area in areas for _, _, _, z1 in area)
    x, z = along * width, across * depth
    cut = [any(x0 < x < x1 and z0 < z < z1 for x0, z0, x1, z1 in area) for area in areas]
    rooms = [
        Room.model_validate({"id": "room|1", "roomType": "Kitchen", "floorPolygon": make_houses.outline(area)})
        for area in areas
    ]
    held = [room.holds(Point(x=x, z=z)) for room in rooms]
    assert sum(held) == 1
    assert held == cut or not any(cut)  # on a border between rectangles
