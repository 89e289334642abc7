"""Recordings of both formats are read."""

import gzip
import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from isi.errors import InputError
from isi.sources.recordings import (
    FORMAT,
    ITHOR,
    ROBOTHOR,
    FloorPlans,
    Scene,
    SceneObject,
    read_recording,
)

ROOT = Path(__file__).parent.parent
KEYS = ("kitchens", "living_rooms", "bedrooms", "bathrooms")
MUG = {
    "objectId": "Mug|1",
    "objectType": "Mug",
    "parentReceptacles": ["Shelf|1"],
    "receptacleObjectIds": None,
    "salientMaterials": ["Ceramic"],
    "pickupable": True,
    "openable": False,
    "position": {"x": 1.0},
}
#: What mining reads of it.
READ = SceneObject("Mug|1", "mug", ["Shelf|1"], [], ["ceramic"], ["pick up", "put"])
SIMULATOR = {"build": "thor-1", "package": "5.0.0"}
HEADER = FORMAT | SIMULATOR


def package() -> dict[str, Any]:
    """A recording in the package's format: thirty scenes per room and RoboTHOR's 75,
    empty except one.
    """
    scenes: dict[str, Any] = {key: [[] for _ in range(30)] for key in KEYS}
    scenes["kitchens"][4] = [dict(MUG)]
    return scenes | {"robothor": [[] for _ in range(74)] + [[dict(MUG)]]}


def read(path: Path, content: object, plans: tuple[FloorPlans, ...] = ITHOR) -> list[Scene]:
    """Write a recording of the package (JSON, or text unchanged), and read it with its SHA-256."""
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return list(read_recording(path, hashlib.sha256(path.read_bytes()).hexdigest(), plans))


def read_lines(path: Path, *lines: object, plans: tuple[FloorPlans, ...] = ITHOR) -> list[Scene]:
    """Write a recording of the recorder (JSON, or bytes unchanged), and read it."""
    encoded = [line if isinstance(line, bytes) else json.dumps(line).encode() for line in lines]
    path.write_bytes(gzip.compress(b"\n".join(encoded)))
    return list(read_recording(path, None, plans))


def scene(
    name: str = "FloorPlan5", spawn: object = None, objects: object = ()
) -> dict[str, object]:
    return {
        "scene": name,
        "spawn": spawn,
        "objects": list(objects) if isinstance(objects, tuple) else objects,
    }


# As the package has it


def test_scenes_of_the_package_bear_the_numbers_of_their_floor_plans_and_only_what_mining_reads(
    tmp_path: Path,
) -> None:
    scenes = read(tmp_path / "recording.json", package())
    assert len(scenes) == 120
    ends = [(scenes[place].name, scenes[place].room) for place in (0, 29, 30, 59, 60, 89, 90, 119)]
    assert ends == [
        ("FloorPlan1", "kitchen"),
        ("FloorPlan30", "kitchen"),
        ("FloorPlan201", "living room"),
        ("FloorPlan230", "living room"),
        ("FloorPlan301", "bedroom"),
        ("FloorPlan330", "bedroom"),
        ("FloorPlan401", "bathroom"),
        ("FloorPlan430", "bathroom"),
    ]
    assert all(scene.name == f"FloorPlan{scene.number}" for scene in scenes)
    assert scenes[4] == Scene("FloorPlan5", 5, "kitchen", [READ])


# As the recorder writes it


def test_scenes_of_the_recorder_come_in_its_order_with_their_layouts(tmp_path: Path) -> None:
    lines = [scene("FloorPlan201", objects=(MUG,)), scene("FloorPlan1", 7), scene("FloorPlan1")]
    assert read_lines(tmp_path / "r", HEADER, *lines) == [
        Scene("FloorPlan201", 201, "living room", [READ]),
        Scene("FloorPlan1#7", 1, "kitchen", []),
        Scene("FloorPlan1", 1, "kitchen", []),
    ]


def test_apartments_have_their_names_or_in_the_package_their_places(tmp_path: Path) -> None:
    recorded = read_lines(
        tmp_path / "r",
        HEADER,
        scene("FloorPlan_Train2_1"),
        scene("FloorPlan_Val3_5"),
        plans=ROBOTHOR,
    )
    assert [(scene.name, scene.number, scene.room) for scene in recorded] == [
        ("FloorPlan_Train2_1", 506, "apartment"),
        ("FloorPlan_Val3_5", 575, "apartment"),
    ]
    packaged = read(tmp_path / "r.json", package(), ROBOTHOR)
    assert len(packaged) == 75
    assert packaged[-1] == Scene("RoboTHOR75", 575, "apartment", [READ])


def test_scenes_of_the_recorder_are_read_one_by_one(tmp_path: Path) -> None:
    path = tmp_path / "r"
    path.write_bytes(
        b"".join(gzip.compress(json.dumps(line).encode() + b"\n") for line in (HEADER, scene()))
        + b"junk"
    )
    scenes = read_recording(path, None)
    assert next(scenes).name == "FloorPlan5"
    with pytest.raises(InputError, match="gzip"):
        next(scenes)
