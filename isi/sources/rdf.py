"""Observations of a user's RDF graph, in N-Triples or Turtle."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from typing import Literal as Choice
from urllib.parse import unquote

from isi.errors import InputError, cut, extra, short
from isi.sources import Mining, Observation, reader
from isi.sources.names import KindsByRelation, Naming, name_fault
from isi.sources.readers import BLOCK, open_text, read_text, reading, suffix_of
from isi.sources.triples import Triple, naming

if TYPE_CHECKING:
    from rdflib.term import Node

    Nodes = tuple[Node, Node, Node]

#: Descriptions of counts: triples that give no observation.
LITERALS = "triples dropped that end in a literal"
BLANK = "triples dropped with a blank node"
STRUCTURE = "triples dropped with a predicate of RDF's own vocabulary"
REPEATED = "triples dropped that repeat an earlier one"
SUFFIXES = (".nt", ".ttl")


@reader("rdf", Naming(), path="path", suffixes=SUFFIXES)
def rdf(
    mining: Mining, path: str, entities: str | None = None, kinds: KindsByRelation | None = None,
    household: bool = False, names: Choice["local", "iri"] = "local",
) -> Iterator[Observation]:  # fmt: skip
    """Observations of an RDF graph (``.nt``, ``.ttl``, or either with ``.gz``): types are kinds, labels are phrases.

    The other settings are those of ``table``; the table ``entities`` overrides types and labels. ``names``: a name is
    the ``local`` part of an IRI, or the whole ``iri``. InputError for two entities or two relations of one name.
    """
    with extra("rdf"):
        from rdflib import OWL, RDF, RDFS, BNode, Literal

    logging.getLogger("rdflib").setLevel(logging.ERROR)  # no warnings of invalid IRIs
    mining.name_entities = named = naming(entities, kinds, household)
    iris: dict[str, dict[str, str]] = {"entity": {}, "relation": {}}  # by role and name
    types: dict[str, list[tuple[str, Node]]] = {}  # by IRI: places and types
    labels = dict[str, tuple[str, str]]()  # by IRI: place and label
    seen = set[Triple]()

    def name_of(place: str, node: Node, role: str = "") -> str:
        iri = str(node)
        name = local_name(iri) if names == "local" else iri
        if fault := name_fault(name):
            raise InputError(path, place, f"<{cut(iri, 40)}>: {fault}")
        if role and (other := iris[role].setdefault(name, iri)) != iri:
            also = f"{short(name)} is also the name of <{cut(other)}>; set names: iri to use whole IRIs as names"
            raise InputError(path, place, also)
        return name

    for place, (head, relation, tail) in _read_triples(Path(path)):
        if isinstance(head, BNode) or isinstance(tail, BNode):
            mining.counts[BLANK] += 1
        elif relation == RDF.type:
            types.setdefault(str(head), []).extend([(place, tail)] * (tail != OWL.NamedIndividual))
        elif relation == RDFS.label and isinstance(tail, Literal):
            if (tail.language or "en").partition("-")[0] == "en":
                labels.setdefault(str(head), (place, str(tail)))
        elif isinstance(tail, Literal):
            mining.counts[LITERALS] += 1
        elif str(relation).startswith(str(RDF)):
            mining.counts[STRUCTURE] += 1
        else:
            ends = name_of(place, head, "entity"), name_of(place, tail, "entity")
            triple = ends[0], name_of(place, relation, "relation"), ends[1]
            if triple in seen:
                mining.counts[REPEATED] += 1
            else:
                seen.add(triple)
                yield None, None, None, *triple, 1
    if not seen:
        raise InputError(path, "", "expected triples between entities that have IRIs, got none")
    listed = set(named.kind_of)
    for name, iri in iris["entity"].items():  # types and labels of relations are ignored
        for place, node in types.get(iri, ()) if name not in listed else ():
            kind = name_of(place, node)
            if (other := named.kind_of.setdefault(name, kind)) != kind:
                got = f"expected one type of {short(name)}, got {cut(kind)} and {cut(other)}"
                raise InputError(path, place, got)
        if iri in labels and name not in named.phrase_of:
            place, label = labels[iri]
            if fault := name_fault(label):
                raise InputError(path, place, f"label: {fault}")
            named.phrase_of[name] = label.lower()


def local_name(iri: str) -> str:
    """The part of an IRI after the last ``#`` or ``/`` (in a URN ``:``), with percent escapes decoded."""
    parts = re.split("[#/]" if re.search("[#/]", iri) else ":", iri.rstrip("#/"))
    return unquote(parts[-1])


def _read_triples(path: Path) -> Iterator[tuple[str, Nodes]]:
    """Yield (place, nodes) of each triple. Turtle is read as a whole: its triples are sorted, their places empty."""
    from rdflib import Graph
    from rdflib.exceptions import ParserError
    from rdflib.plugins.parsers.notation3 import BadSyntax
    from rdflib.plugins.parsers.ntriples import DummySink, W3CNTriplesParser

    if suffix_of(path) == ".nt":
        triples: list[Nodes] = []

        class Sink(DummySink):
            def triple(self, s: Node, p: Node, o: Node) -> None:
                triples.append((s, p, o))

        parser = W3CNTriplesParser(Sink())  # type: ignore[no-untyped-call]
        with reading(path, "RDF in UTF-8 text"), open_text(path) as file:
            for number, line in enumerate(iter(lambda: file.readline(BLOCK), ""), 1):
                parser.line = line.rstrip("\r\n")
                triples.clear()
                try:
                    parser.parseline()
                except (ParserError, ValueError, OverflowError) as error:
                    expected = f"expected a triple of N-Triples, got {short(line.strip())}"
                    raise InputError(path, f"line {number}", expected) from error
                yield from ((f"line {number}", triple) for triple in triples)
    elif suffix_of(path) == ".ttl":
        text = read_text(path, "Turtle, which is read as a whole,")
        try:
            graph = Graph().parse(data=text, format="turtle", publicID="file:///")
        except Exception as error:  # truncated or deeply nested text raises errors of any type in the parser
            place, problem = "", f"{type(error).__name__}: {error}"
            if isinstance(error, BadSyntax):
                place, problem = f"line {error.lines + 1}", str(error._why)
            raise InputError(path, place, f"expected Turtle ({cut(problem, 120)})") from error
        yield from (("", triple) for triple in sorted(graph))
    else:
        raise InputError(path, "", "expected a file name that ends in .nt, .nt.gz, .ttl or .ttl.gz")
