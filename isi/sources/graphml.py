"""Observations of a graph in GraphML, as ``isi export`` and networkx write it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import ParseError

from isi import config
from isi.config import Count
from isi.errors import InputError, at, cut
from isi.sources import Mining, Observation, reader
from isi.sources.names import Name, Naming
from isi.sources.readers import read_text

#: Descriptions of counts.
PREDICTIONS = "edges dropped that are predictions (with a rank)"


@reader("graphml", Naming(), path="path", suffixes=(".graphml",))
def graphml(mining: Mining, path: str) -> Iterator[Observation]:
    """Observations of GraphML, read as a whole: an edge has a ``relation`` and perhaps a ``count``.

    A node is named by its id; its attributes ``kind`` and ``phrase`` are those of the entity.
    """
    import networkx as nx  # imported here: few calls need it

    text = read_text(Path(path), "GraphML, which is read as a whole,")
    try:
        graph: Any = nx.parse_graphml(text, force_multigraph=True)
    except (nx.NetworkXError, ParseError, ValueError, KeyError, TypeError) as error:
        raise InputError(path, "", f"expected GraphML ({cut(str(error), 120)})") from error
    if not graph.is_directed():
        raise InputError(
            path, "graph", "expected edgedefault directed: an edge leads from head to tail"
        )
    mining.name_entities = named = Naming()
    for name, attributes in graph.nodes(data=True):
        for key, given in (("kind", named.kind_of), ("phrase", named.phrase_of)):
            if key in attributes:
                with at(path, f"node {cut(name)}"):
                    given[name] = config.check(attributes[key], Name, key, "")
    for number, (head, tail, attributes) in enumerate(graph.edges(data=True), 1):
        if "rank" in attributes:
            mining.counts[PREDICTIONS] += 1
            continue
        with at(path, f"edge {number}"):
            names = {"head": head, "relation": attributes.get("relation"), "tail": tail}
            for key, name in names.items():
                config.check(name, Name, key, "")
            relation, count = (
                attributes["relation"],
                config.check(attributes.get("count", 1), Count, "count", ""),
            )
        yield None, None, None, head, relation, tail, count
