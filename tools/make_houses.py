"""Sample random houses in the format of ProcTHOR-10K from the databases of the
installed package ``procthor``.

They replace ProcTHOR-10K where it is not available, and are of similar size. The package's
databases determine which objects a room may contain and which objects may lie on or in others; the
id of an object names its room.

python -m tools.make_houses 10000 houses.jsonl.gz
"""

import argparse
import gzip
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from isi.sources.readers import packaged

ROOMS = ("Kitchen", "LivingRoom", "Bedroom", "Bathroom")
MOST_ROOMS = 10
#: Number of objects on the floor of a room, and on its walls.
ON_FLOOR, ON_WALL = 7, 2
#: Minimum distance of objects from the bounds of a room, in metres.
MARGIN = 0.05
#: Added to the package's probability that an object is on or in another one.
BIAS = 0.05

COLOUR = {"b": 0.25882352941176473, "g": 0.26666666666666666, "r": 0.2627450980392157}
#: x and z of two opposite corners.
Rectangle = tuple[float, float, float, float]


@dataclass(frozen=True)
class Catalogue:
    """The package's data on room types and object types."""

    assets: Mapping[str, list[str]]  #: asset ids by object type
    #: weights of types on the floor, by room type, then object type
    floor: Mapping[str, Mapping[str, float]]
    wall: Mapping[str, Mapping[str, float]]  #: weights of types on walls, likewise
    #: probability that an object is on or in another one: by type of the latter, then of the former
    holds: Mapping[str, Mapping[str, float]]
    #: positive weights of all object types, by room type
    fitting: Mapping[str, Mapping[str, float]]


def catalogue() -> Catalogue:
    """Read the databases of the installed package, without importing it."""
    folder = packaged("procthor", "procthor/databases", "what houses are made of")
    assets, places, holds = (
        json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
        for name in ("asset-database", "placement-annotations", "receptacles")
    )
    weights = {
        room: {kind: weight for kind, weight in places[f"in{room}s"].items() if weight}
        for room in ROOMS
    }
    floor, wall = (
        {
            room: {
                kind: weight
                for kind, weight in listed.items()
                if places[place][kind] and kind in assets
            }
            for room, listed in weights.items()
        }
        for place in ("onFloor", "onWall")
    )
    ids = {kind: [asset["assetId"] for asset in listed] for kind, listed in assets.items()}
    likely = {
        kind: {child: way["p"] for child, way in listed.items() if child in assets}
        for kind, listed in holds.items()
    }
    return Catalogue(ids, floor, wall, likely, weights)


def house(known: Catalogue, random: Random) -> dict[str, Any]:
    """A random house with 1 to ``MOST_ROOMS`` rooms in a row (``layout``)."""
    areas = layout(random, random.randint(1, MOST_ROOMS))
    rooms = [(number, random.choice(ROOMS), area) for number, area in enumerate(areas, 2)]
    return {
        "doors": [],
        "windows": [],
        "metadata": {
            "schema": "1.0.0",
            "warnings": {},
            "agent": {"horizon": 30, "position": point(1, 1)},
        },
        "objects": [item for room in rooms for item in furniture(known, random, *room)],
        "proceduralParameters": {
            "skyboxId": "SkyOakland",
            "lights": [
                {
                    "id": f"light_{number}",
                    "intensity": 0.45,
                    "position": point(number, number, 2.4),
                    "range": 15,
                    "type": "point",
                    "layer": "Procedural1",
                    "rgb": COLOUR,
                    "shadow": {
                        "type": "Soft",
                        "strength": 1,
                        "normalBias": 0,
                        "bias": 0.05,
                        "nearPlane": 0.2,
                    },
                }
                for number, _, _ in rooms
            ],
        },
        "rooms": [
            {
                "ceilings": [],
                "children": [],
                "floorMaterial": {"name": "WoodGrains"},
                "id": f"room|{number}",
                "floorPolygon": outline(area),
                "roomType": kind,
                "layer": "Procedural1",
            }
            for number, kind, area in rooms
        ],
        "walls": [
            {
                "color": COLOUR,
                "id": f"wall|{number}|{corner['x']:.2f}|{corner['z']:.2f}",
                "roomId": f"room|{number}",
                "material": {"name": "PureWhite", "color": COLOUR},
                "layer": "Procedural1",
                "polygon": [
                    point(corner["x"] + along, corner["z"], y)
                    for y in (0, 2.6135298900884276)
                    for along in (0, 1)
                ],
            }
            for number, _, area in rooms
            for corner in outline(area)
        ],
    }


def layout(random: Random, number: int) -> list[list[Rectangle]]:
    """``number`` rooms in a row along x: pairs of L-shaped rooms, of two rectangles each;
    a last odd room has one.
    """
    depth, start, areas = round(random.uniform(3, 7), 3), 0.0, []
    for _ in range(number):
        end = round(start + random.uniform(3, 7), 3)
        areas.append([(start, 0.0, end, depth)])
        start = end
    for first, second in zip(areas[::2], areas[1::2], strict=False):
        (begin, _, border, _), (_, _, end, _) = first[0], second[0]
        notch, half = round(border + 1.5, 3), round(depth / 2, 3)
        first[:] = [(begin, 0.0, border, depth), (border, 0.0, notch, half)]
        second[:] = [(notch, 0.0, end, depth), (border, half, notch, depth)]
    return areas


def outline(area: list[Rectangle]) -> list[dict[str, float]]:
    """The corners of a room of one or two rectangles, in order along its walls."""
    x0, z0, x1, z1 = area[0]
    corners = [(x0, z0), (x0, z1), (x1, z1), (x1, z0)]
    for left, below, right, above in area[1:]:
        if below == z0:  # the second rectangle is to the right
            corners[3:] = [(x1, above), (right, above), (right, z0)]
        else:  # to the left
            corners[1:2] = [(x0, below), (left, below), (left, z1)]
    return [point(x, z) for x, z in corners]


def furniture(
    known: Catalogue, random: Random, room: int, kind: str, area: list[Rectangle]
) -> Iterator[dict[str, Any]]:
    """Random objects of a room, each with the objects on or in it as ``children``."""
    drawn: list[str] = []
    for weights, number in ((known.floor[kind], ON_FLOOR), (known.wall[kind], ON_WALL)):
        drawn += random.choices(list(weights), list(weights.values()), k=number) if weights else []
    small = 0
    for place, name in enumerate(drawn):
        thing = item(known, random, f"{name}|{room}|{place}", name, area)
        for child, probability in known.holds.get(name, {}).items():
            if child in known.fitting[kind] and random.random() < probability + BIAS:
                thing["children"].append(
                    item(known, random, f"{child}|surface|{room}|{small}", child, area)
                )
                small += 1
        yield thing


def item(
    known: Catalogue, random: Random, identifier: str, kind: str, area: list[Rectangle]
) -> dict[str, Any]:
    """An object at a random position in a room."""
    x0, z0, x1, z1 = random.choice(area)
    position = point(
        random.uniform(x0 + MARGIN, x1 - MARGIN), random.uniform(z0 + MARGIN, z1 - MARGIN), 0.7
    )
    return {
        "assetId": random.choice(known.assets[kind]),
        "children": [],
        "id": identifier,
        "kinematic": False,
        "position": position,
        "rotation": point(0, 0, 90),
        "layer": "Procedural1",
        "material": None,
    }


def point(x: float, z: float, y: float = 0) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


def write(path: Path, number: int, seed: int = 0) -> None:
    """Write houses of 1 to ``MOST_ROOMS`` rooms as JSON Lines;
    compressed if the path ends in ``.gz``.
    """
    known = catalogue()
    with (
        gzip.open(path, "wb", compresslevel=1) if path.suffix == ".gz" else path.open("wb") as file
    ):
        for place in range(number):
            file.write(json.dumps(house(known, Random(f"{seed} {place}"))).encode() + b"\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("houses", type=int)
    parser.add_argument("file", type=Path, help="JSON Lines; compressed if it ends in .gz")
    given = parser.parse_args()
    write(given.file, given.houses)
