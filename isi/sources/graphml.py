"""Observations of a graph in GraphML, as ``isi export`` and networkx write it."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
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
SHARED = "nodes that share a label, named as LABEL (ID)"
LABELS = ("label", "name")  #: Attributes that name a node; yEd, igraph, Gephi and Neo4j write one.


@reader("graphml", Naming(), path="path", suffixes=(".graphml",))
def graphml(mining: Mining, path: str, names: str | None = None) -> Iterator[Observation]:
    """Observations of GraphML, read as a whole: an edge has a ``relation``, else a ``label``, and
    perhaps a ``count``.

    ``names``: the attribute of nodes that names them; None: the first of ``LABELS`` that a node
    has. A node without it is named by its id, and nodes that share a name by both. Attributes
    ``kind`` and ``phrase`` are those of the entity.
    """
    import networkx as nx  # imported here: few calls need it

    text = read_text(Path(path), "GraphML, which is read as a whole,")
    try:
        with warnings.catch_warnings(action="ignore"):  # of attributes without a type
            graph: Any = nx.parse_graphml(text, force_multigraph=True)
    except (nx.NetworkXError, ParseError, ValueError, KeyError, TypeError) as error:
        raise InputError(path, "", f"expected GraphML ({cut(str(error), 120)})") from error
    if not graph.is_directed():
        raise InputError(
            path, "graph", "expected edgedefault directed: an edge leads from head to tail"
        )
    mining.name_entities = named = Naming()
    if names and not any(names in attributes for _, attributes in graph.nodes(data=True)):
        raise InputError(path, f"names {names}", "expected an attribute of nodes of this file")
    labels = {
        node: _label(attributes, [names] if names else LABELS) or node
        for node, attributes in graph.nodes(data=True)
    }
    number_of = Counter(labels.values())
    name_of = dict(labels)
    for node, label in labels.items():
        if number_of[label] > 1 and label != node:
            name_of[node] = f"{label} ({node})"
            named.phrase_of[name_of[node]] = label
            mining.counts[SHARED] += 1
    for node, attributes in graph.nodes(data=True):
        name = name_of[node]
        for key, given in (("kind", named.kind_of), ("phrase", named.phrase_of)):
            if key in attributes:
                with at(path, f"node {cut(name)}"):
                    given[name] = config.check(attributes[key], Name, key, "")
    for number, (head, tail, attributes) in enumerate(graph.edges(data=True), 1):
        if "rank" in attributes:
            mining.counts[PREDICTIONS] += 1
            continue
        with at(path, f"edge {number}"):
            relation = attributes.get("relation") or _label(attributes, ["label"]) or None
            triple = {"head": name_of[head], "relation": relation, "tail": name_of[tail]}
            for key, name in triple.items():
                config.check(name, Name, key, "")
            count = config.check(attributes.get("count", 1), Count, "count", "")
        yield None, None, None, *triple.values(), count


def _label(attributes: dict[str, Any], names: Sequence[str]) -> str:
    """The first attribute that is there, in one line; yEd's labels may have several."""
    texts = (" ".join(str(attributes[name]).split()) for name in names if name in attributes)
    return next(filter(None, texts), "")
