"""GraphML, as networkx, Gephi and yEd read it."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import networkx as nx

from isi.exports import Outgoing, form


@form("graphml")
def graphml(out: Outgoing, path: Path) -> dict[Path, str | None]:
    """One file: a directed graph with an edge for each triple, and for each prediction, which has no count."""
    graph = nx.MultiDiGraph(name=out.experiment)
    for entity, kind, phrase in out.entities[["entity", "kind", "phrase"]].itertuples(index=False):
        graph.add_node(entity, kind=kind, phrase=phrase)
    for table, values in ((out.triples, ["count"]), (out.predictions, ["score", "rank"])):
        for row in table.to_dict("records"):
            own = {"relation": row["relation"]} | {name: row[name] for name in values}
            graph.add_edge(row["head"], row["tail"], key=graph.number_of_edges(), **own)
    content = BytesIO()
    nx.write_graphml_xml(graph, content)
    return {path: content.getvalue().decode("utf-8")}
