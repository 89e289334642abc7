"""Observations of scene graphs in Spark-DSG's JSON, such as Hydra's:
the labelled rooms and places of objects.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, create_model

from isi.errors import InputError
from isi.names import name_fault
from isi.sources import Mining, Observation, observed, reader
from isi.sources.names import Label, household, phrase
from isi.sources.readers import check_settings, read_json

#: Names of nodes that are no labels: those that Hydra gives, such as ``O(12)``. ``UNKNOWN`` is no
#: label anywhere.
NO_LABEL = re.compile(r"[A-Za-z]\(?[0-9]+\)?")
UNKNOWN = re.compile(r"unknown|\s*", re.IGNORECASE)
UNLABELLED, ROOMLESS = "objects dropped without a label", "objects without a labelled room"
#: Layer and partition by name, in files that do not list them.
LAYERS = {"OBJECTS": "_l2p0", "ROOMS": "_l4p0"}


def _layer(value: Any) -> str:
    """The key of a layer in ``labelspaces``, from its number (in old files) or
    its number and partition.
    """
    parts = value if isinstance(value, dict) else {"layer": value}
    return f"_l{parts.get('layer')}p{parts.get('partition', 0)}"


_Attributes: Any = create_model(
    "Attributes", type=(str, ""), name=(str, ""), semantic_label=(int, -1)
)
_Node: Any = create_model(
    "Node", id=(int, ...), layer=(int, ...), partition=(int, 0), attributes=(_Attributes, ...)
)
_Edge: Any = create_model("Edge", source=(int, ...), target=(int, ...))
_Metadata: Any = create_model("Metadata", labelspaces=(dict[str, list[tuple[int, str]]], {}))
_SceneGraph: Any = create_model(
    "SceneGraph",
    nodes=(list[_Node], ...),
    edges=(list[_Edge], ...),
    metadata=(_Metadata | None, None),
    layer_names=(dict[str, Annotated[str, BeforeValidator(_layer)]], {}),
)


def _above(path: str, nodes: Mapping[int, Any], edges: Iterable[Any]) -> Any:
    """The directed graph of nodes, each with edges to those of higher layers."""
    import networkx as nx  # imported here: few calls need it

    above = nx.DiGraph()
    above.add_nodes_from(nodes)
    for number, edge in enumerate(edges):
        if not {edge.source, edge.target} <= nodes.keys():
            raise InputError(
                path, f"edges.{number}", "expected the ids of two nodes as source and target"
            )
        low, high = sorted((edge.source, edge.target), key=lambda end: nodes[end].layer)
        if nodes[low].layer < nodes[high].layer:
            above.add_edge(low, high)
    return above


@reader("spark_dsg", household, path="path")
def spark_dsg(
    mining: Mining,
    path: str,
    labels: dict[int, Label] | None = None,
    rooms: dict[str, Label] | None = None,
    room: Label | None = None,
) -> Iterator[Observation]:
    """Observations of a scene graph: each object is in the labelled room and places above it.

    A label is that of the file's labelspace, else the node's name unless it is like ``O(12)``.
    ``labels``: labels of objects by number; ``rooms``: labels of rooms by name of the node;
    ``room``: the room of objects without another.
    """
    import networkx as nx  # imported here: few calls need it

    graph = read_json(_SceneGraph, Path(path), "a scene graph")
    layers = LAYERS | graph.layer_names
    spaces = graph.metadata.labelspaces if graph.metadata else {}
    label_of = {layers.get(key, key): dict(pairs) for key, pairs in spaces.items()}
    nodes, located = dict[int, Any](), 0
    for number, node in enumerate(graph.nodes):
        if nodes.setdefault(node.id, node) is not node:
            expected = f"expected each id once, got {node.id} twice"
            raise InputError(path, f"nodes.{number}", expected)
    above = _above(path, nodes, graph.edges)
    numbers = {node.attributes.semantic_label for node in graph.nodes}
    names_of_nodes = {node.attributes.name for node in graph.nodes}
    check_settings(Path(path), "labels", labels or {}, numbers)
    check_settings(Path(path), "rooms", rooms or {}, names_of_nodes)

    def label(node: Any, by_setting: str | None) -> str:
        of_number = label_of.get(_layer(vars(node)), {}).get(node.attributes.semantic_label, "")
        of_node = "" if NO_LABEL.fullmatch(node.attributes.name) else node.attributes.name
        texts = (by_setting or "", "" if UNKNOWN.fullmatch(of_number) else of_number, of_node)
        name = phrase(next(filter(None, texts), ""))
        if name and (fault := name_fault(name)):
            raise InputError(path, f"node {node.id}", fault)
        return name

    objects = [node for node in graph.nodes if _layer(vars(node)) == layers["OBJECTS"]]
    for node in (node for node in objects if node.attributes.type != "AgentNodeAttributes"):
        head = label(node, (labels or {}).get(node.attributes.semantic_label))
        inside = [nodes[end] for end in sorted(nx.descendants(above, node.id))] if head else []
        names = {end.id: label(end, (rooms or {}).get(end.attributes.name)) for end in inside}
        of_rooms = [names.pop(end.id) for end in inside if _layer(vars(end)) == layers["ROOMS"]]
        place, places = next(filter(None, of_rooms), room), [*filter(None, names.values())]
        mining.counts.update([ROOMLESS if head else UNLABELLED] * (not (head and place)))
        if head and (place or places):
            located += 1
            yield from observed(Path(path).stem, place, str(node.id), head, places)
    if not located:
        expected = "expected objects with a label in rooms with one"
        raise InputError(path, "", f"{expected}; settings: labels, rooms, room")
