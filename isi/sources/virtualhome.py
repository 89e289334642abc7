"""Observations of VirtualHome's environment graphs:
where objects are, and what their properties afford.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from isi.errors import InputError, at
from isi.sources import Mining, Observation, observed, once, reader
from isi.sources.names import Name, household, phrase
from isi.sources.readers import MOST, json_lines, parse_json

#: Actions that an object affords by its property, named as in AI2-THOR where it has the action.
AFFORDANCES: Mapping[str, Sequence[str]] = {
    "CAN_OPEN": ("open", "close"),
    "GRABBABLE": ("pick up", "put"),
    "HAS_SWITCH": ("turn on", "turn off"),
    "HAS_PLUG": ("plug in", "unplug"),
    "RECIPIENT": ("fill", "empty"),
    "CUTTABLE": ("slice",),
    "MOVABLE": ("push", "pull"),
    "POURABLE": ("pour",),
    "DRINKABLE": ("drink",),
    "EATABLE": ("eat",),
    "SITTABLE": ("sit",),
    "LIEABLE": ("lie",),
    "READABLE": ("read",),
    "LOOKABLE": ("look at",),
    "HANGABLE": ("hang",),
    "CLOTHES": ("wear",),
}
LOCATIONS = ("INSIDE", "ON")  #: Types of edges from an object to its container, surface or room.
STRUCTURE = frozenset({"ceiling", "floor", "wall"})  #: Classes of parts of the building.
#: Descriptions of counts.
CHARACTERS, PARTS = "characters dropped", "parts of the building dropped: ceilings, floors, walls"
OTHER_EDGES = "edges dropped of other types than INSIDE and ON"
ROOMLESS = "objects that are in no room"
UNUSED = "properties of objects without an affordance"


class Node(BaseModel):
    """An object, a room or a character."""

    model_config = ConfigDict(strict=True, frozen=True)

    id: int
    class_name: Name
    category: str = ""
    properties: list[str] = Field(default_factory=list)


class Edge(BaseModel):
    """A relation of two nodes."""

    model_config = ConfigDict(strict=True, frozen=True)

    from_id: int
    to_id: int
    relation_type: str


class EnvironmentGraph(BaseModel):
    """The state of a home."""

    model_config = ConfigDict(strict=True, frozen=True)

    nodes: Annotated[list[Node], Field(min_length=1, max_length=100_000)]
    edges: list[Edge]


def _is_environment(value: Any) -> bool:
    nodes = value.get("nodes") if isinstance(value, dict) else None
    return (
        isinstance(nodes, list)
        and bool(nodes)
        and isinstance(nodes[0], dict)
        and "class_name" in nodes[0]
    )


@reader("virtualhome_graph", household, path="path", reads_json=_is_environment)
def virtualhome_graph(mining: Mining, path: str) -> Iterator[Observation]:
    """Observations of an environment graph (JSON), or of each line (JSON Lines):
    the home's state at a time.

    An object is at the nodes that it is ``INSIDE`` or ``ON``, and in the room in which these are,
    directly or through others. What several states have counts once.
    """
    file = Path(path)
    events = (
        _observations(mining.counts, file, f"line {number}" * (number > 1), content)
        for number, content in json_lines(file, None, MOST, "an environment graph")
    )
    return once(events, mining.counts)


def _observations(
    counts: Counter[str], path: Path, place: str, content: bytes
) -> Iterator[Observation]:
    graph = parse_json(EnvironmentGraph, content, path, place)
    nodes: dict[int, Node] = {}
    for number, node in enumerate(graph.nodes):
        if nodes.setdefault(node.id, node) is not node:
            with at(path, place):
                raise InputError("", f"nodes.{number}", f"the id {node.id} is in the graph twice")
    places: dict[int, list[int]] = {}  # by object: what it is inside or on
    for number, edge in enumerate(graph.edges):
        if edge.relation_type not in LOCATIONS:
            counts[OTHER_EDGES] += 1
            continue
        if not {edge.from_id, edge.to_id} <= nodes.keys():
            with at(path, place):
                raise InputError(
                    "", f"edges.{number}", "expected the ids of two nodes as from_id and to_id"
                )
        places.setdefault(edge.from_id, []).append(edge.to_id)
    for node in graph.nodes:
        if node.category == "Rooms":
            continue
        if node.category == "Characters" or node.class_name in STRUCTURE:
            counts[CHARACTERS if node.category == "Characters" else PARTS] += 1
            continue
        room = _room_of(node.id, nodes, places)
        receptacles = {
            phrase(nodes[end].class_name)
            for end in places.get(node.id, ())
            if _is_receptacle(nodes[end])
        }
        actions = [action for name in node.properties for action in AFFORDANCES.get(name, ())]
        counts.update(UNUSED for name in node.properties if name not in AFFORDANCES)
        counts.update([ROOMLESS] * (room is None))
        head = phrase(node.class_name)
        yield from observed(
            path.stem, room, str(node.id), head, sorted(receptacles), affordances=actions
        )


def _is_receptacle(node: Node) -> bool:
    return node.category not in ("Rooms", "Characters") and node.class_name not in STRUCTURE


def _room_of(
    node: int, nodes: Mapping[int, Node], places: Mapping[int, Sequence[int]]
) -> str | None:
    """The nearest room that a node is in, through what it is inside or on; None without one."""
    seen, waiting = {node}, [node]
    while waiting:
        ends = [end for start in waiting for end in places.get(start, ()) if end not in seen]
        rooms = [nodes[end].class_name for end in ends if nodes[end].category == "Rooms"]
        if rooms:
            return phrase(rooms[0])
        seen.update(ends)
        waiting = list(dict.fromkeys(ends))
    return None
