"""Formats in which a graph and predictions leave: which files a format makes, and what they hold."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import quote

import networkx as nx
import pandas as pd
from rdflib import RDF, RDFS, Graph, Literal, Namespace, URIRef

TRIPLE = ["head", "relation", "tail"]
#: Headers of Neo4j's importer, by column.
NODES = {"entity": ":ID", "phrase": "phrase", "kind": ":LABEL"}
EDGES = {
    "head": ":START_ID", "tail": ":END_ID", "relation": ":TYPE", "count": "count:int", "score": "score:float",
    "rank": "rank:int",
}  # fmt: skip


@dataclass(frozen=True)
class GraphExport:
    """What is exported; names are printable text."""

    experiment: str
    #: columns entity, kind, phrase
    entities: pd.DataFrame
    #: columns head, relation, tail, count
    triples: pd.DataFrame
    #: columns head, relation, tail, score, rank; no rows where none are asked for
    predictions: pd.DataFrame
    #: whether RDF has kinds and phrases of entities, too: two more triples for each
    labels: bool = False


def graphml(export: GraphExport, path: Path) -> dict[Path, str | None]:
    """GraphML, for networkx, Gephi and yEd: an edge for each triple, and for each prediction, which has no count."""
    graph = nx.MultiDiGraph(name=export.experiment)
    for entity, kind, phrase in export.entities[["entity", "kind", "phrase"]].itertuples(index=False):
        graph.add_node(entity, kind=kind, phrase=phrase)
    for table, values in ((export.triples, ["count"]), (export.predictions, ["score", "rank"])):
        for row in table.to_dict("records"):
            attributes = {name: row[name] for name in ("relation", *values)}
            graph.add_edge(row["head"], row["tail"], key=graph.number_of_edges(), **attributes)
    content = BytesIO()
    nx.write_graphml_xml(graph, content)
    return {path: content.getvalue().decode("utf-8")}


def turtle(export: GraphExport, path: Path) -> dict[Path, str | None]:
    """RDF in Turtle."""
    return {path: _rdf(export).serialize(format="turtle")}


def jsonld(export: GraphExport, path: Path) -> dict[Path, str | None]:
    """RDF in JSON-LD, expanded, in order."""
    nodes = json.loads(_rdf(export).serialize(format="json-ld"))
    return {path: json.dumps(_in_order(nodes), indent=1, sort_keys=True, ensure_ascii=False) + "\n"}


def _in_order(value: Any) -> Any:
    """The same with sorted lists; rdflib orders them by hashes, which differ between processes."""
    if isinstance(value, dict):
        return {key: _in_order(part) for key, part in value.items()}
    if isinstance(value, list):
        return sorted(map(_in_order, value), key=lambda part: json.dumps(part, sort_keys=True))
    return value


def _rdf(export: GraphExport) -> Graph:
    """One RDF triple for each triple; a prediction is a reified statement (five triples), which asserts nothing."""
    base = Namespace(f"urn:isi:{export.experiment}:")
    graph = Graph(bind_namespaces="none")
    graph.bind("rdf", RDF)
    for prefix in ("entity", "relation", "kind", "prediction"):
        graph.bind(prefix, base[f"{prefix}:"])

    def node(what: str, name: str) -> URIRef:
        return base[f"{what}:{quote(name, safe='')}"]

    for head, relation, tail in export.triples[TRIPLE].itertuples(index=False):
        graph.add((node("entity", head), node("relation", relation), node("entity", tail)))
    if export.labels:
        graph.bind("rdfs", RDFS)
        for entity, kind, phrase in export.entities[["entity", "kind", "phrase"]].itertuples(index=False):
            graph.add((node("entity", entity), RDF.type, node("kind", kind)))
            graph.add((node("entity", entity), RDFS.label, Literal(phrase)))
    for number, (head, relation, tail, score, rank) in enumerate(export.predictions.itertuples(index=False), 1):
        statement = node("prediction", str(number))
        graph.add((statement, RDF.subject, node("entity", head)))
        graph.add((statement, RDF.predicate, node("relation", relation)))
        graph.add((statement, RDF.object, node("entity", tail)))
        graph.add((statement, node("prediction", "score"), Literal(score)))
        graph.add((statement, node("prediction", "rank"), Literal(rank)))
    return graph


def property_csv(export: GraphExport, path: Path) -> dict[Path, str | None]:
    """CSV for property graphs: a folder with ``nodes.csv``, ``edges.csv`` and, for predictions, ``predictions.csv``."""

    def csv(table: pd.DataFrame, headers: dict[str, str]) -> str:
        columns = [column for column in headers if column in table.columns]
        return str(table[columns].rename(columns=headers).to_csv(index=False, lineterminator="\n"))

    return {
        path / "nodes.csv": csv(export.entities, NODES),
        path / "edges.csv": csv(export.triples, EDGES),
        path / "predictions.csv": csv(export.predictions, EDGES) if len(export.predictions) else None,
    }


def pykeen_tsv(export: GraphExport, path: Path) -> dict[Path, str | None]:
    """TSV without a header, for PyKEEN's ``TriplesFactory.from_path``; predictions stand in a second file."""

    def tsv(table: pd.DataFrame) -> str:
        return str(table.to_csv(sep="\t", header=False, index=False, lineterminator="\n"))

    second = path.with_name(f"{path.stem}.predictions{path.suffix}")
    return {
        path: tsv(export.triples[TRIPLE]), second: tsv(export.predictions) if len(export.predictions) else None
    }  # fmt: skip


#: Each gives the text of files by path; null: an earlier file of that path is removed.
FORMATS: dict[str, Callable[[GraphExport, Path], dict[Path, str | None]]] = {
    "graphml": graphml, "jsonld": jsonld, "property-csv": property_csv, "pykeen-tsv": pykeen_tsv, "turtle": turtle
}  # fmt: skip
