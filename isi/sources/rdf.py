"""Triples of one's own, from RDF: N-Triples or Turtle."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Literal as Choice
from urllib.parse import unquote

import pyarrow as pa
from rdflib import OWL, RDF, RDFS, BNode, Graph, Literal
from rdflib.exceptions import ParserError
from rdflib.plugins.parsers.notation3 import BadSyntax
from rdflib.plugins.parsers.ntriples import DummySink, W3CNTriplesParser
from rdflib.term import Node

from isi.errors import InputError, cut, short
from isi.sources import Mining, part, source
from isi.sources._naming import Kinds, Naming, fault
from isi.sources._rows import LINE, UNREADABLE, form_of, open_text, read_text
from isi.sources.table import CHUNK, naming

#: What becomes of triples that are no observations, as they are counted.
LITERALS = "triples dropped that end in a literal"
BLANK = "triples dropped with a node that has no name"
STRUCTURE = "triples dropped of RDF's own structures"
REPEATED = "triples dropped that are there already"

#: A triple, and where it stands; empty where that is not known.
Placed = tuple[str, Node, Node, Node]
Names = Choice["local", "iri"]


@source("rdf", entities=Naming())
def rdf(
    mining: Mining,
    path: str,
    entities: str | None = None,
    kinds: Kinds | None = None,
    household: bool = False,
    names: Names = "local",
) -> Iterator[pa.Table]:
    """Observations of an RDF graph, each triple one. Types are kinds, labels are phrases.

    Args:
        mining: is told how entities are named, and counts the triples that are left out.
        path: of a file whose name ends in ``.nt`` or ``.ttl``, either with ``.gz`` behind it.
        entities: path of a table of entities, as the source ``table`` has it; what it says goes before the file.
        kinds: of entities without a type, by relation, as of the source ``table``.
        household: the same; a room is what has the type ``room``, since no column tells rooms.
        names: what entities and relations go by: the ``local`` part of their IRI, or all of it.

    Raises:
        InputError: where the file is broken, an entity has two types, or two IRIs have one name.
    """
    logging.getLogger("rdflib").setLevel(logging.ERROR)  # it warns of IRIs that are none
    told = naming(entities, kinds, household)
    reading = _Reading(Path(path), mining, told, names == "local", kept=frozenset(told.kind_of))
    mining.entities = told
    rest = reading.observations()
    while chunk := list(islice(rest, CHUNK)):
        yield part([(None, None, None, *triple, 1) for triple in chunk])


@dataclass
class _Reading:
    path: Path
    mining: Mining
    naming: Naming
    local: bool
    #: entities whose kind a table gives
    kept: frozenset[str]
    #: IRI of each name, of entities and of relations
    entity_iris: dict[str, str] = field(default_factory=dict)
    relation_iris: dict[str, str] = field(default_factory=dict)
    #: types of each IRI, and where they stand; its first label, likewise
    types: dict[str, dict[Node, str]] = field(default_factory=dict)
    labels: dict[str, tuple[str, str]] = field(default_factory=dict)
    seen: set[tuple[str, str, str]] = field(default_factory=set)

    def observations(self) -> Iterator[tuple[str, str, str]]:
        """Head, relation and tail of each triple that is an observation, once."""
        left = self.mining.left
        for place, head, relation, tail in read_triples(self.path):
            if isinstance(head, BNode) or isinstance(tail, BNode):
                left[BLANK] += 1
            elif relation == RDF.type and tail == OWL.NamedIndividual:
                continue
            elif relation == RDF.type:
                self.types.setdefault(str(head), {}).setdefault(tail, place)
            elif relation == RDFS.label and isinstance(tail, Literal):
                if (tail.language or "en").partition("-")[0] == "en":
                    self.labels.setdefault(str(head), (place, str(tail)))
            elif isinstance(tail, Literal):
                left[LITERALS] += 1
            elif str(relation).startswith(str(RDF)):
                left[STRUCTURE] += 1
            else:
                ends = (self._name(place, node, self.entity_iris) for node in (head, tail))
                triple = next(ends), self._name(place, relation, self.relation_iris), next(ends)
                if triple in self.seen:
                    left[REPEATED] += 1
                else:
                    self.seen.add(triple)
                    yield triple
        if not self.seen:
            raise InputError(self.path, "", "expected triples between entities that have IRIs, got none")
        self._tell()

    def _tell(self) -> None:
        """Kinds and phrases of the entities; what else has a type or a label, such as relations, is not looked at."""
        kind_of, phrase_of = self.naming.kind_of, self.naming.phrase_of
        for name, iri in self.entity_iris.items():
            types = {} if name in self.kept else self.types.get(iri, {})
            for kind, place in ((self._called(place, of), place) for of, place in types.items()):
                if kind_of.setdefault(name, kind) != kind:
                    expected = f"expected one type of {short(name)}, got {cut(kind)} beside {cut(kind_of[name])}"
                    raise InputError(self.path, place, expected)
            if iri in self.labels and name not in phrase_of:
                place, label = self.labels[iri]
                wrong = fault(label)
                if wrong:
                    raise InputError(self.path, place, f"label: {wrong}")
                phrase_of[name] = label.lower()

    def _name(self, place: str, node: Node, iris: dict[str, str]) -> str:
        name = self._called(place, node)
        if iris.setdefault(name, str(node)) != str(node):
            expected = f"{short(name)} is also the name of <{cut(iris[name])}>; the setting names: iri keeps them apart"
            raise InputError(self.path, place, expected)
        return name

    def _called(self, place: str, node: Node) -> str:
        name = local_name(str(node)) if self.local else str(node)
        wrong = fault(name)
        if wrong:
            raise InputError(self.path, place, f"<{cut(str(node), 40)}>: {wrong}")
        return name


def local_name(iri: str) -> str:
    """What stands behind an IRI's last ``#`` or ``/`` (of a URN, behind its last ``:``), without percent signs."""
    parts = re.split("[#/]" if re.search("[#/]", iri) else ":", iri.rstrip("#/"))
    return unquote(parts[-1])


def read_triples(path: Path) -> Iterator[Placed]:
    """The triples of an RDF file; those of N-Triples line by line, those of Turtle all at once and in order.

    Raises:
        InputError: where the file is missing, of another form, or broken.
    """
    form = form_of(path)
    if form not in (".nt", ".ttl"):
        raise InputError(path, "", "expected a name that ends in .nt or .ttl (.gz behind it or not)")
    try:
        yield from _of_lines(path) if form == ".nt" else _of_turtle(path)
    except UNREADABLE as error:
        raise InputError(path, "", f"expected RDF in UTF-8 text ({error})") from error


def _of_lines(path: Path) -> Iterator[Placed]:
    sink = _Last()
    parser = W3CNTriplesParser(sink)
    with open_text(path) as file:
        for number, line in enumerate(iter(lambda: file.readline(LINE), ""), 1):
            parser.line, sink.triples = line.rstrip("\r\n"), []
            try:
                parser.parseline()
            except (ParserError, ValueError, OverflowError) as error:
                expected = f"expected a triple of N-Triples, got {short(line.strip())}"
                raise InputError(path, f"line {number}", expected) from error
            yield from ((f"line {number}", *triple) for triple in sink.triples)


class _Last(DummySink):
    """Keeps what the parser finds in a line."""

    def __init__(self) -> None:
        self.triples: list[tuple[Node, Node, Node]] = []

    def triple(self, s: Node, p: Node, o: Node) -> None:
        self.triples.append((s, p, o))


def _of_turtle(path: Path) -> Iterator[Placed]:
    text = read_text(path, "Turtle, which is read as a whole,")
    try:
        graph = Graph().parse(data=text, format="turtle", publicID="file:///")
    except Exception as error:  # text that ends too early, or is too deep, makes the parser stumble in any way
        place, what = "", f"{type(error).__name__}: {error}"
        if isinstance(error, BadSyntax):
            place, what = f"line {error.lines + 1}", str(error._why)
        raise InputError(path, place, f"expected Turtle ({cut(what, 120)})") from error
    yield from (("", *triple) for triple in sorted(graph))
