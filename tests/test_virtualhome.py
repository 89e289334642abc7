"""VirtualHome's environment graphs: rooms, containers and affordances of objects."""

import json
from pathlib import Path
from typing import Any

import pytest

from isi.graph.files import guess
from isi.sources.virtualhome import CHARACTERS, OTHER_EDGES, PARTS, ROOMLESS, UNUSED
from tests.observing import TRIPLE, observe, refused, written


def node(
    number: int, name: str, category: str = "", properties: tuple[str, ...] = ()
) -> dict[str, Any]:
    """A node as VirtualHome writes it, with keys that the reader ignores."""
    box = {"center": [0.0, 1.0, 2.0], "size": [1.0, 1.0, 1.0]}
    return {
        "id": number,
        "class_name": name,
        "category": category,
        "properties": list(properties),
        "states": ["CLEAN"],
        "prefab_name": "x",
        "obj_transform": None,
        "bounding_box": box,
    }


def edge(start: int, kind: str, end: int) -> dict[str, Any]:
    return {"from_id": start, "to_id": end, "relation_type": kind}


def home() -> dict[str, Any]:
    return {
        "nodes": [
            node(1, "character", "Characters"),
            node(11, "kitchen", "Rooms"),
            node(12, "livingroom", "Rooms"),
            node(20, "fridge", "Appliances", ("CAN_OPEN", "CONTAINERS")),
            node(21, "milk", "Food", ("DRINKABLE",)),
            node(22, "coffee_table", "Furniture", ("SURFACES",)),
            node(23, "mug", "", ("GRABBABLE",)),
            node(24, "floor", "Floor"),
            node(25, "plate"),
        ],
        "edges": [
            edge(1, "INSIDE", 11),
            edge(20, "INSIDE", 11),
            edge(21, "INSIDE", 20),
            edge(22, "INSIDE", 12),
            edge(22, "ON", 24),
            edge(23, "ON", 22),
            edge(23, "CLOSE", 20),
            edge(1, "HOLDS_RH", 25),
        ],
    }


EXPECTED = {
    ("fridge", "atLocation", "kitchen"),
    ("fridge", "hasAffordance", "open"),
    ("fridge", "hasAffordance", "close"),
    ("milk", "atLocation", "kitchen"),
    ("milk", "atLocation", "fridge"),
    ("milk", "hasAffordance", "drink"),
    ("coffee table", "atLocation", "livingroom"),
    ("mug", "atLocation", "livingroom"),
    ("mug", "atLocation", "coffee table"),
    ("mug", "hasAffordance", "pick up"),
    ("mug", "hasAffordance", "put"),
}


def test_objects_are_in_containers_and_in_the_rooms_of_these(tmp_path: Path) -> None:
    path = written(tmp_path / "home.json", json.dumps(home()))
    assert guess(path) == "virtualhome_graph"
    observed = observe("virtualhome_graph", path)
    assert sorted(observed.rows(*TRIPLE)) == sorted(EXPECTED)
    assert observed.kind_of()["livingroom"] == "room"
    assert observed.kind_of()["fridge"] == "object"
    assert observed.counts == {CHARACTERS: 1, PARTS: 1, OTHER_EDGES: 2, UNUSED: 2, ROOMLESS: 1}


def test_what_several_states_have_counts_once(tmp_path: Path) -> None:
    later = home()
    later["edges"][2] = edge(21, "ON", 22)
    path = written(tmp_path / "home.jsonl", f"{json.dumps(home())}\n{json.dumps(later)}")
    affords = "milk", "hasAffordance", "drink"  # in another room
    moved = [affords, ("milk", "atLocation", "livingroom"), ("milk", "atLocation", "coffee table")]
    assert sorted(observe("virtualhome_graph", path).rows(*TRIPLE)) == sorted([*EXPECTED, *moved])


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"edges": [edge(20, "INSIDE", 99)]}, ["edges.0", "from_id"]),
        ({"nodes": []}, ["nodes"]),
        ({"nodes": [node(1, "mug"), node(1, "cup")]}, ["nodes.1", "twice"]),
        ({"nodes": [node(1, "mu\tg")]}, ["nodes.0.class_name"]),
        ({"edges": None}, ["edges"]),
    ],
)
def test_a_broken_graph_is_refused(
    tmp_path: Path, change: dict[str, Any], expected: list[str]
) -> None:
    refused(
        "virtualhome_graph",
        written(tmp_path / "a.json", json.dumps(home() | change)),
        ["a.json", *expected],
    )
