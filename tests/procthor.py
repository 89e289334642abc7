"""A house of two rooms in ProcTHOR's format, with any objects."""

from typing import Any

#: An L-shaped kitchen: the house is 4 m deep; the short leg spans x from 4 to 6 and z from 0 to 2,
#: in metres.
KITCHEN = [(0, 0), (0, 4), (4, 4), (4, 2), (6, 2), (6, 0)]
LIVING_ROOM = [(6, 0), (6, 2), (4, 2), (4, 4), (9, 4), (9, 0)]


def floor(corners: list[tuple[float, float]]) -> list[dict[str, float]]:
    return [{"x": x, "y": 0, "z": z} for x, z in corners]


def thing(
    identifier: str, x: float, z: float, *children: object, asset: str = "Asset_1"
) -> dict[str, Any]:
    position = {"x": x, "y": 0.7, "z": z}
    return {
        "id": identifier,
        "assetId": asset,
        "position": position,
        "children": list(children),
        "layer": "L",
    }


def house(*objects: object, **others: object) -> dict[str, Any]:
    rooms = [
        {"id": "room|2", "roomType": "Kitchen", "floorPolygon": floor(KITCHEN), "ceilings": []},
        {"id": "room|3", "roomType": "LivingRoom", "floorPolygon": floor(LIVING_ROOM)},
    ]
    return {
        "rooms": rooms,
        "objects": list(objects),
        "walls": [],
        "metadata": {"schema": "1.0.0"},
        **others,
    }
