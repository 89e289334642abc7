"""Recordings of either form, read."""

from __future__ import annotations

import gzip
import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from isi.errors import InputError
from isi.sources import _recording
from isi.sources._materials import Object
from isi.sources._recording import FORMAT, ITHOR, ROBOTHOR, Plans, Scene, read_recording

KEYS = ("kitchens", "living_rooms", "bedrooms", "bathrooms")
MUG: Object = {
    "objectId": "Mug|1", "objectType": "Mug", "parentReceptacles": ["Shelf|1"], "receptacleObjectIds": None,
    "salientMaterials": ["Ceramic"], "pickupable": True, "openable": False, "position": {"x": 1.0},
}  # fmt: skip
#: What mining reads of it.
READ = {
    "objectId": "Mug|1", "objectType": "Mug", "parentReceptacles": ["Shelf|1"], "salientMaterials": ["Ceramic"],
    "pickupable": True,
}  # fmt: skip
SIMULATOR = {"build": "thor-1", "package": "5.0.0"}
HEADER = FORMAT | SIMULATOR


def package() -> dict[str, Any]:
    """As the package has it: thirty scenes a room, empty but for one, and RoboTHOR's 75."""
    scenes: dict[str, Any] = {key: [[] for _ in range(30)] for key in KEYS}
    scenes["kitchens"][4] = [dict(MUG)]
    return scenes | {"robothor": [[] for _ in range(74)] + [[dict(MUG)]]}


def read(path: Path, content: object, plans: tuple[Plans, ...] = ITHOR) -> list[Scene]:
    """Write the recording of a package (JSON, or text as it is) and read it with its own hash."""
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return list(read_recording(path, hashlib.sha256(path.read_bytes()).hexdigest(), plans))


def read_lines(path: Path, *lines: object, plans: tuple[Plans, ...] = ITHOR) -> list[Scene]:
    """Write a recording of the recorder (JSON, or bytes as they are) and read it."""
    encoded = [line if isinstance(line, bytes) else json.dumps(line).encode() for line in lines]
    path.write_bytes(gzip.compress(b"\n".join(encoded)))
    return list(read_recording(path, None, plans))


def scene(name: str = "FloorPlan5", spawn: object = None, objects: object = ()) -> dict[str, object]:
    return {"scene": name, "spawn": spawn, "objects": list(objects) if isinstance(objects, tuple) else objects}


# As the package has it


def test_scenes_of_the_package_bear_the_numbers_of_their_floor_plans_and_only_what_mining_reads(tmp_path: Path) -> None:
    scenes = read(tmp_path / "recording.json", package())
    assert len(scenes) == 120
    ends = [(scenes[place].name, scenes[place].room) for place in (0, 29, 30, 59, 60, 89, 90, 119)]
    assert ends == [
        ("FloorPlan1", "kitchen"), ("FloorPlan30", "kitchen"), ("FloorPlan201", "living room"),
        ("FloorPlan230", "living room"), ("FloorPlan301", "bedroom"), ("FloorPlan330", "bedroom"),
        ("FloorPlan401", "bathroom"), ("FloorPlan430", "bathroom"),
    ]  # fmt: skip
    assert all(scene.name == f"FloorPlan{scene.number}" for scene in scenes)
    assert scenes[4] == Scene("FloorPlan5", 5, "kitchen", [READ])


def test_a_missing_recording_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.json"):
        read_recording(tmp_path / "nowhere.json", "0" * 64)


@pytest.mark.parametrize("text", [json.dumps(package())[:-40], "a photograph, not JSON", "", "[" * 100_000])
def test_a_truncated_or_non_json_recording_says_that_json_is_expected(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match=r"recording\.json: expected JSON: "):
        read(tmp_path / "recording.json", text)


def test_a_recording_of_another_hash_is_refused_with_both_hashes(tmp_path: Path) -> None:
    path = tmp_path / "recording.json"
    read(path, package())
    got = hashlib.sha256(path.read_bytes()).hexdigest()
    with pytest.raises(InputError, match=rf"recording\.json.*{'0' * 64}.*sha256.*{got}"):
        read_recording(path, "0" * 64)


@pytest.mark.parametrize("number", [29, 31])
def test_a_scene_list_of_another_length_is_named_with_both_lengths(tmp_path: Path, number: int) -> None:
    with pytest.raises(InputError, match=rf"recording\.json.*living_rooms.*30.*{number}"):
        read(tmp_path / "recording.json", package() | {"living_rooms": [[]] * number})


@pytest.mark.parametrize("content", [{"kitchens": [[]] * 30}, [], 3])
def test_a_recording_without_a_room_is_refused_by_its_key(tmp_path: Path, content: object) -> None:
    with pytest.raises(InputError, match=r"recording\.json.*(kitchens|living_rooms).*30 scenes"):
        read(tmp_path / "recording.json", content)


@pytest.mark.parametrize(
    ("thing", "place"),
    [
        ({**MUG, "objectType": None}, r"object Mug\|1: expected its objectType"),
        ({key: value for key, value in MUG.items() if key != "objectType"}, r"object Mug\|1: expected its objectType"),
        ({**MUG, "objectType": "../../Mug"}, r"object Mug\|1: expected its objectType.*'\.\./\.\./Mug'"),
        ({**MUG, "objectType": "Mug\x1b[2J"}, r"object Mug\|1: expected its objectType.*\\x1b"),
        ({**MUG, "objectType": "M" * 10_000}, r"object Mug\|1: expected its objectType.{0,120}$"),
        ({key: value for key, value in MUG.items() if key != "objectId"}, "object 0: .*objectId"),
        ({**MUG, "objectId": 7}, "object 0: .*objectId"),
        ({**MUG, "objectId": "Mug\n"}, "object 0: .*objectId"),
        ({**MUG, "objectId": "M" * 10_000}, "object 0: .*objectId"),
        ({**MUG, "parentReceptacles": "Shelf|1"}, r"object Mug\|1: .*parentReceptacles"),
        ({**MUG, "parentReceptacles": [["Shelf|1"]]}, r"object Mug\|1: .*parentReceptacles"),
        ({**MUG, "receptacleObjectIds": {"Fork|1": 1}}, r"object Mug\|1: .*receptacleObjectIds"),
        ({**MUG, "salientMaterials": "Metal"}, r"object Mug\|1: .*salientMaterials"),
        ({**MUG, "salientMaterials": [""]}, r"object Mug\|1: .*salientMaterials"),
        ({**MUG, "salientMaterials": ["m" * 201]}, r"object Mug\|1: salientMaterials: expected .*at most 200"),
        ({**MUG, "salientMaterials": ["../etc"]}, r"object Mug\|1: salientMaterials: expected .*'\.\./etc'"),
        ({**MUG, "objectType": "Mug "}, r"object Mug\|1: expected its objectType to be a name, got 'Mug '"),
        ({**MUG, "parentReceptacles": ["Shelf|1", "Shelf|1"]}, r"object Mug\|1: .*parentReceptacles to name each once"),
        ({**MUG, "objectId": "Mug\ud800"}, "object 0: .*objectId"),
        ({**MUG, "objectType": "Mug\ud800"}, r"object Mug\|1: expected its objectType"),
        ({**MUG, "openable": "false"}, r"object Mug\|1: expected openable to be true or false, got 'false'"),
        ({**MUG, "pickupable": "1"}, r"object Mug\|1: expected pickupable"),
        ("Mug", "object 0: "),
    ],
)  # fmt: skip
def test_a_malformed_object_is_named_with_its_scene_in_one_line_in_either_form(
    tmp_path: Path, thing: object, place: str
) -> None:
    broken = package()
    broken["kitchens"][4] = [thing]
    with pytest.raises(InputError, match=rf"recording: FloorPlan5, {place}") as refused:
        read(tmp_path / "recording", broken)
    assert str(refused.value).isprintable()
    with pytest.raises(InputError, match=rf"recording: FloorPlan5, {place}"):
        read_lines(tmp_path / "recording", HEADER, scene(objects=[thing]))


def test_an_id_that_is_in_its_scene_twice_is_refused_whatever_its_types(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"FloorPlan5, object Mug\|1: is in its scene twice"):
        read_lines(tmp_path / "r", HEADER, scene(objects=[MUG, {**MUG, "objectType": "Cup"}]))


def test_a_scene_of_more_objects_than_any_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_recording, "MOST_OBJECTS", 2)
    with pytest.raises(InputError, match="FloorPlan5: expected a list of objects, of at most 2, got 3"):
        read_lines(tmp_path / "r", HEADER, scene(objects=[{**MUG, "objectId": name} for name in "abc"]))


def test_a_byte_order_mark_is_no_part_of_a_recording_of_either_form(tmp_path: Path) -> None:
    mark = "\ufeff"
    assert read(tmp_path / "r.json", mark + json.dumps(package()))[4].objects == [READ]
    assert read_lines(tmp_path / "r", (mark + json.dumps(HEADER)).encode(), scene(objects=(MUG,)))[0].objects == [READ]


@pytest.mark.parametrize("objects", [None, {}, "Mug"])
def test_a_scene_without_a_list_of_objects_is_named(tmp_path: Path, objects: object) -> None:
    with pytest.raises(InputError, match="FloorPlan5: expected a list of objects"):
        read_lines(tmp_path / "recording", HEADER, scene(objects=objects))


# As the recorder writes it


def test_scenes_of_the_recorder_come_in_its_order_with_their_layouts(tmp_path: Path) -> None:
    lines = [scene("FloorPlan201", objects=(MUG,)), scene("FloorPlan1", 7), scene("FloorPlan1")]
    assert read_lines(tmp_path / "r", HEADER, *lines) == [
        Scene("FloorPlan201", 201, "living room", [READ]),
        Scene("FloorPlan1#7", 1, "kitchen", []),
        Scene("FloorPlan1", 1, "kitchen", []),
    ]


def test_apartments_are_told_by_name_or_in_the_package_by_place(tmp_path: Path) -> None:
    recorded = read_lines(
        tmp_path / "r", HEADER, scene("FloorPlan_Train2_1"), scene("FloorPlan_Val3_5"), plans=ROBOTHOR
    )
    assert [(scene.name, scene.number, scene.room) for scene in recorded] == [
        ("FloorPlan_Train2_1", 506, "apartment"), ("FloorPlan_Val3_5", 575, "apartment"),
    ]  # fmt: skip
    packaged = read(tmp_path / "r.json", package(), ROBOTHOR)
    assert len(packaged) == 75
    assert packaged[-1] == Scene("RoboTHOR75", 575, "apartment", [READ])


def test_scenes_of_the_recorder_are_read_one_by_one(tmp_path: Path) -> None:
    path = tmp_path / "r"
    path.write_bytes(b"".join(gzip.compress(json.dumps(line).encode() + b"\n") for line in (HEADER, scene())) + b"junk")
    scenes = read_recording(path, None)
    assert next(scenes).name == "FloorPlan5"
    with pytest.raises(InputError, match="gzip"):
        next(scenes)


def test_the_hash_of_a_recording_is_that_of_the_file(tmp_path: Path) -> None:
    read_lines(tmp_path / "r", HEADER, scene())
    own = hashlib.sha256((tmp_path / "r").read_bytes()).hexdigest()
    assert len(list(read_recording(tmp_path / "r", own))) == 1
    with pytest.raises(InputError, match="sha256"):
        read_recording(tmp_path / "r", "0" * 64)


@pytest.mark.parametrize(
    ("lines", "place"),
    [
        ([], "line 1: expected a header"),
        ([scene()], "line 1: expected a header"),
        ([[]], "line 1: expected a header"),
        ([HEADER | {"version": 2}], "line 1: .*'version': 2"),
        ([HEADER | {"version": "1"}], "line 1: .*'version': '1'"),
        ([HEADER | {"simulator": "gibson"}], "line 1: .*gibson"),
        (["x" * 10_000], "line 1: .{0,400}$"),
        ([HEADER], "expected scenes behind the header, got none"),
        ([HEADER, b"{"], "line 2: expected JSON"),
        ([HEADER, scene(), b"\xff\xfe"], "line 3: expected JSON"),
        ([HEADER, b"[" * 100_000], "line 2: expected JSON: .*too deep"),
        ([HEADER, b"[" + b"9" * 5_000 + b"]"], "line 2: expected JSON: a number has more than 4,300 digits"),
        ([HEADER, b""" """], "line 2: expected JSON"),
        ([HEADER, 3], "line 2: expected a scene"),
        ([HEADER, {"scene": "FloorPlan5"}], "line 2: expected a scene"),
        ([HEADER, scene(spawn="3")], "line 2: expected a scene"),
        ([HEADER, scene(spawn=True)], "line 2: expected a scene"),
        ([HEADER, scene("FloorPlan999")], "line 2: expected one of .*FloorPlan1, got 'FloorPlan999'"),
        ([HEADER, scene("FloorPlan_Train1_1")], "line 2: .*got 'FloorPlan_Train1_1'"),
        ([HEADER, scene("../" * 5000)], "line 2: .{0,200}$"),
        ([HEADER, scene(spawn=10**300)], "line 2: expected a name of at most 200"),
        ([HEADER, scene(spawn=1), scene(), scene(spawn=1)], "line 4: FloorPlan5#1 is there twice"),
    ],
)
def test_a_line_that_is_not_what_it_must_be_is_refused_by_its_number(
    tmp_path: Path, lines: list[object], place: str
) -> None:
    with pytest.raises(InputError, match=rf"/r: {place}") as refused:
        read_lines(tmp_path / "r", *lines)
    assert str(refused.value).isprintable()


def test_a_line_that_is_too_long_is_refused_before_it_is_held(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_recording, "MOST_BYTES", 300)
    with pytest.raises(InputError, match="line 2: expected at most 300 bytes"):
        read_lines(tmp_path / "r", HEADER, scene(objects=[MUG] * 3))


def test_json_that_is_too_large_is_refused_before_it_is_held(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_recording, "MOST_BYTES_WHOLE", 300)
    with pytest.raises(InputError, match=r"recording\.json: expected at most 300 bytes"):
        read(tmp_path / "recording.json", package())
