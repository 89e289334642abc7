"""One scene of AI2-THOR in any of the forms in which it comes."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import pytest

from isi.sources.ai2thor import MISSING, ROOMLESS, mine
from isi.sources.materials import reported_materials
from isi.sources.recordings import locate, read_recording
from tests.observing import TRIPLE, observe, refused

MUG = {
    "objectType": "Mug", "objectId": "Mug|1", "parentReceptacles": ["SideTable|1"], "salientMaterials": ["Ceramic"],
    "breakable": True,
}  # fmt: skip
SCENE = [MUG, {"objectType": "SideTable", "objectId": "SideTable|1"}]
EXPECTED = [
    ("mug", "atLocation", "kitchen"), ("mug", "atLocation", "side table"), ("mug", "hasMaterial", "ceramic"),
    ("mug", "hasAffordance", "break"), ("side table", "atLocation", "kitchen"),
]  # fmt: skip


def scene(path: Path, content: Any) -> Path:
    text = content if isinstance(content, str) else json.dumps(content)
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())
    return path


@pytest.mark.parametrize(
    ("content", "settings"),
    [
        (SCENE, {"room": "kitchen"}),
        ({"scene": "FloorPlan30", "spawn": None, "objects": SCENE}, {}),
        ({"scene": "FloorPlan1#7", "spawn": 7, "objects": SCENE}, {}),
        ({"sceneName": "FloorPlan2_physics", "objects": SCENE, "agent": {}}, {}),
        ({"metadata": {"sceneName": "FloorPlan201_physics", "objects": SCENE}}, {"room": "kitchen"}),
    ],
    ids=["list", "line of a recording", "spawned", "metadata", "event"],
)
@pytest.mark.parametrize("name", ["scene.json", "scene.json.gz"])
def test_all_forms_of_a_scene_give_the_same(tmp_path: Path, content: Any, settings: dict[str, str], name: str) -> None:
    found = observe("ai2thor_scene", scene(tmp_path / name, content), **settings)
    assert found.rows(*TRIPLE) == EXPECTED
    assert set(found.table["room"]) == {"kitchen"}
    assert found.kind_of()["kitchen"] == "room"
    assert not found.counts


def test_a_scene_whose_room_nothing_tells_has_none(tmp_path: Path) -> None:
    for content in (
        SCENE,
        {"scene": "FloorPlan31", "objects": SCENE},
        {"scene": "FloorPlan_Train13_1", "objects": SCENE},
    ):
        found = observe("ai2thor_scene", scene(tmp_path / "scene.json", content))
        assert found.rows(*TRIPLE) == [row for row in EXPECTED if row[2] != "kitchen"]
        assert found.table["room"].isna().all()
        assert found.counts == {ROOMLESS: 2}


def test_a_scene_of_robothor_is_in_an_apartment(tmp_path: Path) -> None:
    found = observe("ai2thor_scene", scene(tmp_path / "scene.json", {"scene": "FloorPlan_Val3_5", "objects": SCENE}))
    assert set(found.table["room"]) == {"apartment"}


def test_a_recorded_scene_gives_what_the_whole_recording_gives_of_it(tmp_path: Path) -> None:
    recording = json.loads(locate("recording").read_bytes())
    alone = observe(
        "ai2thor_scene", scene(tmp_path / "bath.json", {"scene": "FloorPlan407", "objects": recording["bathrooms"][6]})
    )
    (same,) = (one for one in read_recording(locate("recording"), None) if one.name == "FloorPlan407")
    expected = list(mine([same], reported_materials, Path("recording")))
    assert len(expected) > 100
    assert alone.rows("scene", "room", "instance", *TRIPLE, "count") == expected


def test_a_receptacle_that_the_scene_lacks_is_an_error_or_dropped(tmp_path: Path) -> None:
    path = scene(tmp_path / "scene.json", [MUG])
    refused("ai2thor_scene", path, ["scene.json", "Mug|1", "SideTable|1"], room="kitchen")
    assert observe("ai2thor_scene", path, room="kitchen", broken="drop").counts == {MISSING: 1}


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("", ["JSON"]),
        (json.dumps(SCENE)[:-9], ["JSON"]),
        ("[]", ["expected a scene"]),
        ({"kitchens": []}, ["expected a scene"]),
        ([3], ["scene.0: "]),
        ([{"objectId": "Mug|1"}], ["scene.0.objectType: "]),
        ([{**MUG, "salientMaterials": [""]}], ["scene.0.salientMaterials.0: "]),
        ({"scene": "F" * 10_000, "objects": SCENE}, ["scene: ", "at most 200"]),
        ({"sceneName": "../FloorPlan1", "objects": SCENE}, ["scene: ", "'../'"]),
        ({"sceneName": 3, "objects": SCENE}, ["scene: ", "expected a name"]),
    ],
)
def test_what_is_no_scene_is_refused(tmp_path: Path, content: Any, expected: list[str]) -> None:
    refused("ai2thor_scene", scene(tmp_path / "scene.json", content), ["scene.json", *expected], room="kitchen")


@pytest.mark.parametrize("room", ["../kitchen", "kitchen\n", "k" * 201])
def test_a_room_that_is_no_name_is_refused(tmp_path: Path, room: str) -> None:
    refused("ai2thor_scene", scene(tmp_path / "scene.json", SCENE), ["room: expected a name"], room=room)


def test_another_encoding_and_a_missing_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "scene.json").write_bytes(json.dumps(SCENE).encode("utf-16"))
    refused("ai2thor_scene", tmp_path / "scene.json", ["UTF-8"])
    refused("ai2thor_scene", tmp_path / "none.json", ["none.json", "No such file"])
