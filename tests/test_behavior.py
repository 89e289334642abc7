"""BEHAVIOR-1K's scenes: from a small folder in its format, from the package if it is installed,
and from bad files.
"""

import json
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

import pytest

from isi.config import read as read_params
from isi.extras.behavior import CATEGORIES, PROPERTIES, SCENES, STEPS
from isi.tables import paths
from tests.observing import TRIPLE, Observations, observations_of

ROOT = Path(__file__).parent.parent
SETTINGS: dict[str, Any] = {
    "structure": ["wall.n.01"],
    "names": {"cabinet.n.03": "locker", "childs_room": "child's room"},
    "affordances": {
        "openable": ["open", "close"],
        "flammable": ["burn"],
        "heatSource": ["heat"],
        "fire": ["burn"],
    },
}
SCENE: dict[str, Any] = {
    "kitchen_0": {
        "stove-abcdef": 1,
        "bottom_cabinet-ghijkl": 2,
        "locker-aaaaaa": 1,
        "walls-bbbbbb": 4,
    },
    "childs_room_1": {"bottom_cabinet-ghijkl": 1, "bottom_cabinet-mnopqr": 1},
}
MAPPED = (
    "category,synset\nstove,stove.n.01\nbottom_cabinet,cabinet.n.01\nlocker,cabinet.n.03\n"
    "walls,wall.n.01\n"
)
PROPERTIES_OF: dict[str, Any] = {
    "stove.n.01": {"heatSource": {}, "dustyable": {}},
    "cabinet.n.01": {"openable": {}, "flammable": {}, "fire": {}},
    "cabinet.n.03": {},
    "wall.n.01": {},
}


def folder_of(
    path: Path, scenes: object = None, mapped: str = MAPPED, properties: object = PROPERTIES_OF
) -> Path:
    """Write the files of the package; by default with one scene."""
    content = {"success": True, "scenes": {"House_0": SCENE}} if scenes is None else scenes
    (path / SCENES).write_text(
        content if isinstance(content, str) else json.dumps(content), encoding="utf-8"
    )
    (path / CATEGORIES).write_text(mapped, encoding="utf-8")
    (path / PROPERTIES).write_text(json.dumps(properties), encoding="utf-8")
    return path


def mined(folder: Path | str, **changes: object) -> Observations:
    return observations_of({"reader": "behavior", "from": str(folder), **SETTINGS, **changes})


def test_each_object_is_in_its_room_and_has_the_affordances_of_its_properties_once(
    tmp_path: Path,
) -> None:
    observed = mined(folder_of(tmp_path))
    assert set(observed.table["scene"]) == {"House_0"}
    cabinets = [
        ("kitchen", "kitchen_0/bottom_cabinet-ghijkl", 2),
        ("child's room", "childs_room_1/bottom_cabinet-ghijkl", 1),
        ("child's room", "childs_room_1/bottom_cabinet-mnopqr", 1),
    ]
    expected = [
        ("kitchen", "kitchen_0/stove-abcdef", "stove", "atLocation", "kitchen", 1),
        ("kitchen", "kitchen_0/stove-abcdef", "stove", "hasAffordance", "heat", 1),
        ("kitchen", "kitchen_0/locker-aaaaaa", "locker", "atLocation", "kitchen", 1),
    ]
    for room, instance, count in cabinets:
        expected.append((room, instance, "cabinet", "atLocation", room, count))
        expected += [
            (room, instance, "cabinet", "hasAffordance", does, count)
            for does in ("burn", "close", "open")
        ]
    assert sorted(observed.rows("room", "instance", *TRIPLE, "count")) == sorted(expected)
    assert observed.counts == dict(zip(STEPS, (10, 6), strict=True))
    assert observed.kind_of() == {
        "burn": "affordance",
        "cabinet": "object",
        "child's room": "room",
        "close": "affordance",
        "heat": "affordance",
        "kitchen": "room",
        "locker": "object",
        "open": "affordance",
        "stove": "object",
    }


@pytest.mark.skipif(
    ("bddl", "3.6.0") not in {(package.name, package.version) for package in distributions()},
    reason="needs the package bddl 3.6.0",
)
def test_the_package_read_as_shipped_has_51_scenes_and_all_their_instances() -> None:
    shipped = read_params(ROOT / paths.BEYOND_PARAMS)["graphs"]["behavior"]["source"]
    settings = {key: value for key, value in shipped.items() if key not in ("reader", "from")}
    assert (shipped["reader"], shipped["from"], set(settings)) == (
        "behavior",
        "package",
        set(SETTINGS),
    )
    observed = mined("package", **settings)
    observations, kinds = observed.table, observed.kinds
    assert observations["scene"].nunique() == 51
    assert observed.counts == dict(zip(STEPS, (36_164, 34_950), strict=True))
    assert observations.loc[observations["relation"] == "atLocation", "count"].sum() == 34_950
    assert kinds["kind"].value_counts().to_dict() == {"object": 522, "room": 39, "affordance": 25}
