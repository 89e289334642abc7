"""A graph as RDF: its unique triples and, on request, labels and predictions."""

from __future__ import annotations

from urllib.parse import quote

from rdflib import RDF, RDFS, Graph, Literal, Namespace, URIRef

from isi.exports import Outgoing


def rdf_of(out: Outgoing) -> Graph:
    """One triple of RDF for each of the graph; a prediction is a statement (five triples), and said to be none."""
    own = Namespace(f"urn:isi:{out.experiment}:")
    graph = Graph(bind_namespaces="none")
    graph.bind("rdf", RDF)
    for prefix in ("entity", "relation", "kind", "prediction"):
        graph.bind(prefix, own[f"{prefix}:"])

    def named(what: str, name: str) -> URIRef:
        return own[f"{what}:{quote(name, safe='')}"]

    for head, relation, tail in out.triples[["head", "relation", "tail"]].itertuples(index=False):
        graph.add((named("entity", head), named("relation", relation), named("entity", tail)))
    if out.labels:
        graph.bind("rdfs", RDFS)
        for entity, kind, phrase in out.entities[["entity", "kind", "phrase"]].itertuples(index=False):
            graph.add((named("entity", entity), RDF.type, named("kind", kind)))
            graph.add((named("entity", entity), RDFS.label, Literal(phrase)))
    for number, (head, relation, tail, score, rank) in enumerate(out.predictions.itertuples(index=False), 1):
        statement = named("prediction", str(number))
        graph.add((statement, RDF.subject, named("entity", head)))
        graph.add((statement, RDF.predicate, named("relation", relation)))
        graph.add((statement, RDF.object, named("entity", tail)))
        graph.add((statement, named("prediction", "score"), Literal(score)))
        graph.add((statement, named("prediction", "rank"), Literal(rank)))
    return graph
