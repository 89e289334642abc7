"""Observations of a graph in GraphML, as networkx writes it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import ParseError, fromstring

from isi import config
from isi.config import Count
from isi.errors import InputError, at, cut, short
from isi.names import clean
from isi.process import quiet
from isi.sources import Mining, Observation, reader
from isi.sources.names import Label, Naming
from isi.sources.readers import read_text

#: Descriptions of counts.
PREDICTIONS = "edges dropped that are predictions (with a rank)"
SHARED = "nodes that share a label, named as LABEL (ID)"
#: Attributes that name a node, in any case; yEd, igraph, Gephi, Neo4j and RDF tools write one.
LABELS = ("label", "name", "title", "uri", "description")
USED = ("kind", "phrase")  #: Other attributes of a node.
USED_OF_EDGES = ("relation", "label", "count", "rank", "id")


@reader("graphml", Naming(), path="path", suffixes=(".graphml",))
def graphml(mining: Mining, path: str, names: str | None = None) -> Iterator[Observation]:
    """Observations of GraphML, read as a whole by networkx: an edge has a ``relation``, else a
    ``label``, and perhaps a ``count``.

    ``names``: the attribute of nodes that names them, or ``id``; None: the first of ``LABELS`` that
    a node has. A node without it is named by its id, and nodes that share a name by both.
    Attributes ``kind`` and ``phrase`` are those of the entity. Others are counted, and not used: a
    weight of an edge is no count.
    """
    graph = _read(path)
    mining.name_entities = named = Naming()
    nodes: dict[str, dict[str, Any]] = dict(graph.nodes(data=True))
    if names not in (None, "id") and not any(names in attributes for attributes in nodes.values()):
        raise InputError(path, f"names {names}", "expected an attribute of nodes of this file")
    sought = () if names == "id" else (names,) if names else LABELS
    labels = {node: _label(attributes, sought) or node for node, attributes in nodes.items()}
    number = Counter(labels.values())
    name_of = {
        node: label if number[label] == 1 or label == node else f"{label} ({node})"
        for node, label in labels.items()
    }
    if len(set(name_of.values())) < len(name_of):
        raise InputError(path, "", "a label is the name of another node, too (names=id)")
    for node, attributes in nodes.items():
        name = name_of[node]
        if name != labels[node]:
            named.phrase_of[name] = labels[node]
            mining.counts[SHARED] += 1
        for key, by_name in (("kind", named.kind_of), ("phrase", named.phrase_of)):
            if key in attributes:
                with at(path, f"node {cut(name)}"):
                    by_name[name] = config.check(attributes[key], Label, key, "")
    edges = [attributes for *_, attributes in graph.edges(data=True)]
    mining.counts.update(_not_used("nodes", nodes.values(), {*map(str.casefold, sought), *USED}))
    mining.counts.update(_not_used("edges", edges, USED_OF_EDGES))
    for place, (head, tail, attributes) in enumerate(graph.edges(data=True), 1):
        if "rank" in attributes:
            mining.counts[PREDICTIONS] += 1
            continue
        with at(path, f"edge {place}"):
            relation = _label(attributes, ("relation", "label"))
            config.check(relation, Label, "relation", "")
            count = attributes.get("count", 1)
            if isinstance(count, float) and count.is_integer():  # as igraph and Gephi write it
                count = int(count)
            config.check(count, Count, "count", "")
        yield None, None, None, name_of[head], relation, name_of[tail], count


def _not_used(
    things: str, attributes: Iterable[dict[str, Any]], used: Collection[str]
) -> Counter[str]:
    """The number of values of each attribute of nodes or edges that is not used, described."""
    names = (name for values in attributes for name in values)
    return Counter(f"{name} of {things}, not used" for name in names if name.casefold() not in used)


def _read(path: str) -> Any:
    """The graph of a file; InputError unless it is GraphML with directed edges, and each id of a
    node once.
    """
    import networkx as nx  # imported here: few calls need it

    text = read_text(Path(path), "GraphML, which is read as a whole,")
    try:
        with quiet:  # of attributes without a type
            graph: Any = nx.parse_graphml(text, force_multigraph=True)
        nodes = fromstring(text).findall(".//{*}node")  # noqa: S314  # networkx has parsed it just so
        ids = Counter(node.get("id") for node in nodes)
    except (nx.NetworkXError, ParseError, ValueError, KeyError, TypeError) as error:
        raise InputError(path, "", f"expected GraphML ({cut(str(error), 120)})") from error
    for node, number in ids.items():
        if number > 1:
            raise InputError(path, f"node {short(node)}", "expected each id of a node once")
    if not graph.is_directed():
        expected = "expected edgedefault directed: an edge leads from head to tail"
        raise InputError(path, "graph", expected)
    return graph


def _label(attributes: dict[str, Any], names: Sequence[str]) -> str:
    """The first attribute that is there, in any case and in one line; yEd's labels may have
    several.
    """
    values = {name.casefold(): value for name, value in reversed(attributes.items())}
    sought = (str(values[name.casefold()]) for name in names if name.casefold() in values)
    texts = (clean(" ".join(text.split())) for text in sought)
    return next(filter(None, texts), "")
