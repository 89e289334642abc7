"""ProcTHOR's houses: each object is in the room that contains it,
and has the recorded properties of its type.
"""

import gzip
import hashlib
import json
from collections import Counter
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from isi.errors import InputError
from isi.sources import READERS, Mining
from isi.sources import procthor_houses as procthor
from isi.sources.recordings import Scene, SceneObject
from tests.observing import observations_of
from tests.procthor import house, thing

#: An object of each type that was recorded.
RECORDED = {
    name: [SceneObject("", name, affordances=affordances)]
    for name, affordances in {
        "mug": ("pick up", "put"),
        "counter top": (),
        "pen": ("break",),
        "sofa": ("heat",),
        "painting": (),
    }.items()
}


@pytest.fixture(autouse=True)
def _recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(procthor, "recorded_types", lambda _scenes: RECORDED)


def observed(path: Path, *lines: dict[str, Any]) -> tuple[list[tuple[object, ...]], Counter[str]]:
    """Observations of a file of houses, and the counts of mining."""
    path.write_text("\n".join(map(json.dumps, lines)), encoding="utf-8")
    mining = Mining(0)
    rows = READERS.get("procthor_houses").read(
        mining, path=str(path), sha256=None, materials="simulator"
    )
    return list(rows), +mining.counts


def test_objects_are_in_the_room_whose_floor_holds_them_and_children_in_their_parents(
    tmp_path: Path,
) -> None:
    counter = thing(
        "CounterTop|2|0", 1, 1, thing("Mug|surface|2|0", 1.2, 1, thing("Pen|surface|2|1", 1.2, 1))
    )
    rows, left = observed(tmp_path / "x.jsonl", house(counter, thing("Sofa|3|0", 5, 3)))
    assert rows == [
        ("House1", "kitchen", "CounterTop|2|0", "counter top", "atLocation", "kitchen", 1),
        ("House1", "kitchen", "Mug|surface|2|0", "mug", "atLocation", "kitchen", 1),
        ("House1", "kitchen", "Mug|surface|2|0", "mug", "atLocation", "counter top", 1),
        ("House1", "kitchen", "Mug|surface|2|0", "mug", "hasAffordance", "pick up", 1),
        ("House1", "kitchen", "Mug|surface|2|0", "mug", "hasAffordance", "put", 1),
        ("House1", "kitchen", "Pen|surface|2|1", "pen", "atLocation", "kitchen", 1),
        ("House1", "kitchen", "Pen|surface|2|1", "pen", "atLocation", "mug", 1),
        ("House1", "kitchen", "Pen|surface|2|1", "pen", "hasAffordance", "break", 1),
        ("House1", "living room", "Sofa|3|0", "sofa", "atLocation", "living room", 1),
        ("House1", "living room", "Sofa|3|0", "sofa", "hasAffordance", "heat", 1),
    ]
    assert left == {procthor.INSTANCES: 4}


@pytest.mark.parametrize(
    ("identifier", "x", "z", "room", "counted"),
    [
        ("Sofa|2|0", 5, 1, "kitchen", None),  # in the corner
        ("Sofa|3|0", 5, 3, "living room", None),  # beside it
        ("Sofa|2|0", 5, 3, "living room", procthor.ELSEWHERE),
        ("Sofa|7|0", 5, 3, "living room", procthor.UNNAMED),
        ("Sofa", 5, 3, "living room", procthor.UNNAMED),
        ("Sofa|3|0", 9.0005, 3, "living room", None),  # corners are rounded to a millimetre
        ("Sofa|3|0", 9.0, 4.0, "living room", None),
        ("Sofa|3|0", 9.0015, 3, None, procthor.OUTSIDE),
        ("Sofa|3|0", -20, 3, None, procthor.OUTSIDE),
        ("WashingMachine|3|0", 5, 3, "living room", f"{procthor.UNRECORDED}washing machine"),
    ],
)
def test_what_is_odd_is_counted_and_what_stands_in_no_room_is_dropped(
    tmp_path: Path, identifier: str, x: float, z: float, room: str | None, counted: str | None
) -> None:
    rows, left = observed(tmp_path / "x.jsonl", house(thing(identifier, x, z)))
    assert [row[5] for row in rows if row[4] == "atLocation"] == [room] * bool(room)
    assert left == {procthor.INSTANCES: 1, **({counted: 1} if counted else {})}


def test_of_two_objects_of_the_same_id_the_first_counts_but_other_houses_may_have_it_too(
    tmp_path: Path,
) -> None:
    twice = [thing("Painting|2|0", 1, 1), thing("Painting|2|0", 8, 1)]
    rows, left = observed(tmp_path / "x.jsonl", house(*twice), house(*twice[:1]))
    assert [(row[0], row[1]) for row in rows] == [("House1", "kitchen"), ("House2", "kitchen")]
    assert left == {procthor.INSTANCES: 3, procthor.TAKEN: 1}


def test_an_object_whose_id_names_no_type_is_of_the_type_of_its_asset(tmp_path: Path) -> None:
    assert procthor.asset_types()["Mug_1"] == "Mug"
    objects = [thing("2|0", 1, 1, thing("small|2|0", 1, 1, asset="Pen_2"), asset="Mug_1")]
    rows, _ = observed(tmp_path / "x.jsonl", house(*objects, metadata={"schema": "0.0.1"}))
    assert [row[3:6] for row in rows if row[4] == "atLocation"] == [
        ("mug", "atLocation", "kitchen"),
        ("pen", "atLocation", "kitchen"),
        ("pen", "atLocation", "mug"),
    ]


# What was recorded


RECORDED_TYPES = procthor.recorded_types


def recording() -> procthor.RecordedTypes:
    held, opened, broken = ("pick up", "put"), ("open", "close"), ("break",)
    mugs = [
        SceneObject("1", "mug", materials=["ceramic", "metal"], affordances=[*opened, *held]),
        SceneObject("2", "mug", materials=["glass"], affordances=[*opened, *held, *broken]),
        SceneObject("3", "mug", affordances=[*opened, *held, *broken]),
        SceneObject("4", "mug", materials=["glass"], affordances=held),
    ]
    return RECORDED_TYPES(
        [Scene("FloorPlan1", 1, "kitchen", mugs[:2]), Scene("FloorPlan2", 2, "kitchen", mugs[2:])]
    )


def test_a_type_affords_what_more_than_half_of_its_recorded_objects_do() -> None:
    affordances = {name: procthor.affordances_of(objects) for name, objects in recording().items()}
    assert affordances == {"mug": ["open", "close", "pick up", "put"]}


def test_materials_are_those_of_a_recorded_object_of_the_type_as_often_as_there_are_such() -> None:
    drawn = procthor.recorded_materials(recording(), 0)
    cart, things = SceneObject("5", "cart"), [SceneObject("6", "mug")] * 4_000
    counts = Counter(map(tuple, drawn(7, [*things, cart])[:-1]))
    assert set(counts) == {("ceramic", "metal"), ("glass",), ()}
    assert counts["glass",] == pytest.approx(2_000, abs=130)  # four standard deviations
    assert counts[()] == pytest.approx(1_000, abs=110)
    assert drawn(7, things) == drawn(7, things) != drawn(8, things)
    assert drawn(7, [cart]) == [()]


@pytest.mark.parametrize("materials", ["suncg", "simulator"])
def test_the_source_mines_a_file_with_what_the_real_recording_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, materials: str
) -> None:
    monkeypatch.setattr(procthor, "recorded_types", RECORDED_TYPES)
    switch, cup = thing("LightSwitch|2|0", 1, 1), thing("Mug|surface|3|1", 5, 3)
    lines = [json.dumps(house(switch, thing("SideTable|3|0", 5, 3, cup)))] * 3
    (tmp_path / "x.jsonl").write_text("\n".join(lines), encoding="utf-8")
    given = {
        "reader": "procthor_houses",
        "path": str(tmp_path / "x.jsonl"),
        "sha256": None,
        "materials": materials,
    }
    mined = observations_of(given)
    frame = mined.table.astype(str)
    assert {"atLocation", "hasMaterial", "hasAffordance"} == set(frame["relation"])
    assert mined.counts[procthor.INSTANCES] == len(frame[["scene", "instance"]].drop_duplicates())
    odd = (procthor.OUTSIDE, procthor.TAKEN, procthor.UNNAMED, procthor.ELSEWHERE)
    # listed, though there are none
    assert {step: mined.counts.get(step) for step in odd} == dict.fromkeys(odd, 0)
    switches = frame[(frame["head"] == "light switch") & (frame["relation"] == "hasAffordance")]
    assert set(switches["tail"]) == {"turn on", "turn off"}


def test_houses_are_read_one_by_one(tmp_path: Path) -> None:
    path = tmp_path / "x.jsonl"
    path.write_text(json.dumps(house(thing("Sofa|2|0", 1, 1))) + "\nbroken", encoding="utf-8")
    rows = iter(
        READERS.get("procthor_houses").read(
            Mining(0), path=str(path), sha256=None, materials="simulator"
        )
    )
    assert [row[5] for row in islice(rows, 2)] == ["kitchen", "heat"]
    with pytest.raises(InputError, match="line 2"):
        next(rows)


# Files of houses


@pytest.mark.parametrize("indent", [None, 2])
@pytest.mark.parametrize("packed", [False, True])
def test_a_house_may_be_a_line_or_a_file_plain_or_packed(
    tmp_path: Path, indent: int | None, packed: bool
) -> None:
    content = json.dumps(house(thing("Mug|2|0", 1, 1)), indent=indent).encode()
    content = content if indent else b"\n" + content + b"\n\n"
    path = tmp_path / f"x.json{'' if indent else 'l'}{'.gz' if packed else ''}"
    path.write_bytes(gzip.compress(content) if packed else content)
    [(line, read, _)] = procthor.read_houses(path, hashlib.sha256(path.read_bytes()).hexdigest())
    assert line == (1 if indent else 2)
    assert [item.id for item in read.objects or ()] == ["Mug|2|0"]


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
    assert procthor.type_and_room(identifier) == (kind, room)


@given(st.floats(0.001, 8.999), st.floats(0.001, 3.999))
def test_each_point_of_a_floor_plan_is_in_the_one_room_that_contains_it(x: float, z: float) -> None:
    """The rooms have the shape of an L each."""
    rooms = [procthor.Room.model_validate(room) for room in house()["rooms"]]
    (room,) = procthor.rooms_of(
        rooms, [(SceneObject("Mug|7|0", "mug"), procthor.Point(x=x, z=z), None)]
    )
    assert room is not None
    is_in_kitchen = x < 4 or (x < 6 and z < 2)
    distance = min(abs(x - 4), abs(x - 6), abs(z - 2))
    assert distance < 0.01 or rooms.index(room) == (0 if is_in_kitchen else 1)
