"""Observations of a user's RDF graph, in N-Triples or Turtle."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from typing import Literal as Choice
from urllib.parse import unquote

from isi.errors import InputError, cut, extra, short
from isi.names import clean, name_fault
from isi.sources import Mining, Observation, reader
from isi.sources.names import KindsByRelation, Naming
from isi.sources.readers import MOST, open_text, read_text, reading, suffix_of
from isi.sources.triples import Triple, naming

if TYPE_CHECKING:
    from rdflib.term import Node

    Nodes = tuple[Node, Node, Node]

#: Descriptions of counts: triples that give no observation.
LITERALS = "triples dropped that end in a literal"
BLANK = "triples dropped with a blank node"
STRUCTURE = "triples dropped with a predicate of the vocabulary of RDF, RDFS, OWL or SHACL"
SAME = "triples dropped of owl:sameAs, whose two names stay two entities"
MANY_TYPES = (
    "entities of several types, of which the rarest is the kind; the setting entities gives kinds"
)
UNUSABLE = "labels dropped that are empty, too long, or contain control characters"
REPEATED = "triples dropped that repeat an earlier one"
SUFFIXES = (".nt", ".ttl")
SHACL = "http://www.w3.org/ns/shacl#"


@reader("rdf", Naming(), path="path", suffixes=SUFFIXES)
def rdf(
    mining: Mining,
    path: str,
    entities: str | None = None,
    kinds: KindsByRelation | None = None,
    household: bool = False,
    names: Choice["local", "iri"] = "local",
) -> Iterator[Observation]:
    """Observations of an RDF graph (``.nt``, ``.ttl``, perhaps with ``.gz``):
    types are kinds.

    Labels are phrases. The other settings are those of ``table``; the table ``entities`` overrides
    types and labels. ``names``: a name is the ``local`` part of an IRI, or the whole ``iri``.
    Predicates of RDF, RDFS, OWL and SHACL make no facts. InputError for two entities or two
    relations of one name.
    """
    with extra("rdf"):
        import rdflib  # noqa: F401

    logging.getLogger("rdflib").setLevel(logging.ERROR)  # no warnings of invalid IRIs
    mining.name_entities = named = naming(entities, kinds, household, mining.counts)
    graph = _Contents(path, names == "iri", mining.counts)
    for place, nodes in _read_triples(Path(path)):
        triple = graph.fact(place, *nodes)
        if triple:
            yield None, None, None, *triple, 1
    if not graph.facts:
        dropped = ", ".join(f"{number:,} {label}" for label, number in mining.counts.items())
        raise InputError(
            path, "", f"expected triples between entities that have IRIs, got {dropped or 'none'}"
        )
    graph.describe(named)


@dataclass
class _Contents:
    """What the triples of a graph say: facts, and types and labels by IRI."""

    path: str
    whole_iris: bool  #: whether a name is the whole IRI
    counts: Counter[str]
    facts: set[Triple] = field(default_factory=set)  #: in the clean form of names
    #: IRIs by role and name
    iris: dict[str, dict[str, str]] = field(default_factory=lambda: {"entity": {}, "relation": {}})
    types: dict[str, dict[Node, str]] = field(default_factory=dict)  #: places of types by IRI
    above: dict[Node, set[Node]] = field(default_factory=dict)  #: classes above a class
    labels: dict[str, str] = field(default_factory=dict)
    unusable: Counter[str] = field(default_factory=Counter)  #: number of labels by IRI

    def fact(self, place: str, head: Node, relation: Node, tail: Node) -> Triple | None:
        """The names of a triple of entities that is new; None for others, which are noted or
        counted.
        """
        from rdflib import OWL, RDF, RDFS, BNode, Literal

        if isinstance(head, BNode) or isinstance(tail, BNode):
            self.counts[BLANK] += 1
        elif relation == RDF.type:
            if tail not in {OWL.NamedIndividual, OWL.Thing, RDFS.Resource}:
                self.types.setdefault(clean(str(head)), {}).setdefault(tail, place)
        elif relation == RDFS.label and isinstance(tail, Literal):
            if (tail.language or "en").partition("-")[0] == "en":
                self._note_label(clean(str(head)), clean(" ".join(str(tail).split())))
        elif isinstance(tail, Literal):
            self.counts[LITERALS] += 1
        elif relation == OWL.sameAs:
            self.counts[SAME] += 1
        elif str(relation).startswith((str(RDF), str(RDFS), str(OWL), SHACL)):
            self.counts[STRUCTURE] += 1
            if relation == RDFS.subClassOf:
                self.above.setdefault(head, set()).add(tail)
        else:
            ends = self._name_of(place, head, "entity"), self._name_of(place, tail, "entity")
            triple = ends[0], self._name_of(place, relation, "relation"), ends[1]
            form = clean(triple[0]), clean(triple[1]), clean(triple[2])
            if form not in self.facts:
                self.facts.add(form)
                return triple
            self.counts[REPEATED] += 1
        return None

    def _note_label(self, iri: str, label: str) -> None:
        if name_fault(label):
            self.unusable[iri] += 1
        else:
            self.labels.setdefault(iri, label)

    def _name_of(self, place: str, node: Node, role: str = "") -> str:
        iri = str(node)
        name = iri if self.whole_iris else local_name(iri)
        if fault := name_fault(name):
            raise InputError(self.path, place, f"<{cut(iri, 40)}>: {fault}")
        other = self.iris[role].setdefault(clean(name), iri) if role else iri
        if clean(other) != clean(iri):
            also = (
                f"{short(name)} is also the name of <{cut(other)}>; set names: "
                "iri to use whole IRIs as names"
            )
            raise InputError(self.path, place, also)
        return name

    def describe(self, named: Naming) -> None:
        """Give kinds and phrases to the entities of facts; those of relations are ignored."""
        iris = self.iris["entity"]
        types_of = {name: self.types.get(clean(iri), {}) for name, iri in iris.items()}
        entities_of = Counter(node for nodes in types_of.values() for node in nodes)
        listed = set(named.kind_of)
        for name, iri in iris.items():
            types = types_of[name]
            lowest = self._lowest(types)
            if lowest and name not in listed:
                rarest = min(lowest, key=lambda node: (entities_of[node], str(node)))
                named.kind_of[name] = self._name_of(types[rarest], rarest)
                self.counts.update([MANY_TYPES] * (len(lowest) > 1))
            if clean(iri) in self.labels:
                named.phrase_of.setdefault(name, self.labels[clean(iri)].lower())
            if number := self.unusable[clean(iri)]:
                self.counts[UNUSABLE] += number

    def _lowest(self, types: Collection[Node]) -> list[Node]:
        """Types that are above no other of them; all types where each is above another."""
        above = {
            node for node in types if any(_is_above(node, other, self.above) for other in types)
        }
        return [node for node in types if node not in above] or list(types)


def _is_above(node: Node, other: Node, above: Mapping[Node, set[Node]]) -> bool:
    """Whether a class is above another one, directly or through others."""
    reached: set[Node] = set()
    waiting = [other]
    while waiting:
        new = above.get(waiting.pop(), set()) - reached
        reached |= new
        waiting += new
    return node in reached and node != other


def local_name(iri: str) -> str:
    """The part of an IRI after the last ``#`` or ``/`` (in a URN ``:``),
    with percent escapes decoded.
    """
    parts = re.split("[#/]" if re.search("[#/]", iri) else ":", iri.rstrip("#/"))
    return unquote(parts[-1])


def _read_triples(path: Path) -> Iterator[tuple[str, Nodes]]:
    """Yield (place, nodes) of each triple. Turtle is read as a whole:
    its triples are sorted, their places empty.
    """
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
            for number, line in enumerate(iter(lambda: file.readline(MOST + 1), ""), 1):
                if len(line) > MOST:
                    raise InputError(
                        path, f"line {number}", f"line longer than {MOST:,} characters"
                    )
                parser.line = line.rstrip("\r\n")
                triples.clear()
                try:
                    parser.parseline()
                except (ParserError, ValueError, OverflowError) as error:
                    expected = f"expected a triple of N-Triples, got {short(line.strip())}"
                    raise InputError(path, f"line {number}", expected) from error
                yield from ((f"line {number}", triple) for triple in triples)
    elif suffix_of(path) in (".ttl", ""):  # a pipe has no suffix, and N-Triples are Turtle
        text = read_text(path, "Turtle, which is read as a whole,")
        try:
            graph = Graph().parse(data=text, format="turtle", publicID="file:///")
        # truncated or deeply nested text raises errors of any type in the parser
        except Exception as error:
            place, problem = "", f"{type(error).__name__}: {error}"
            if isinstance(error, BadSyntax):
                place, problem = f"line {error.lines + 1}", str(error._why)
            raise InputError(path, place, f"expected Turtle ({cut(problem, 120)})") from error
        yield from (("", triple) for triple in sorted(graph))
    else:
        raise InputError(
            path, "", "expected a file name that ends in .nt or .ttl (or these with .gz)"
        )
