"""Observations of a user's RDF graph, in N-Triples or Turtle, which rdflib parses."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Iterator
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING
from typing import Literal as Choice
from urllib.parse import unquote

from isi.errors import InputError, cut, extra, short
from isi.names import clean, name_fault
from isi.sources import Mining, Observation, reader
from isi.sources.names import KindsByRelation, Naming
from isi.sources.readers import read_text, suffix_of
from isi.sources.triples import naming

if TYPE_CHECKING:
    from rdflib import Graph
    from rdflib.term import Node

#: Descriptions of counts: triples that give no observation.
LITERALS = "triples dropped that end in a literal"
BLANK = "triples dropped with a blank node"
STRUCTURE = "triples dropped with a predicate of the vocabulary of RDF, RDFS, OWL or SHACL"
SAME = "triples dropped of owl:sameAs, whose two names stay two entities"
MANY_TYPES = (
    "entities of several types, of which the rarest is the kind; the setting entities gives kinds"
)
UNUSABLE = "labels dropped that are empty, too long, or contain control characters"
FORMS = {".nt": "nt", ".ttl": "turtle", "": "turtle"}  #: A pipe has no suffix.
SHACL = "http://www.w3.org/ns/shacl#"


@reader("rdf", Naming(), path="path", suffixes=(".nt", ".ttl"))
def rdf(
    mining: Mining,
    path: str,
    entities: str | None = None,
    kinds: KindsByRelation | None = None,
    household: bool = False,
    names: Choice["local", "iri"] = "local",
) -> Iterator[Observation]:
    """Observations of an RDF graph (``.nt``, ``.ttl``, perhaps with ``.gz``): types are kinds.

    Labels are phrases. The other settings are those of ``table``; the table ``entities`` overrides
    types and labels. ``names``: a name is the ``local`` part of an IRI, or the whole ``iri``.
    Predicates of RDF, RDFS, OWL and SHACL make no facts. InputError for two entities or two
    relations of one name.
    """
    graph = _parsed(Path(path))
    mining.name_entities = named = naming(entities, kinds, household, mining.counts)
    node_of: dict[str, dict[str, Node]] = {"entity": {}, "relation": {}}  # by role and name

    def name(node: Node) -> str:
        chosen = str(node) if names == "iri" else local_name(str(node))
        if fault := name_fault(chosen):
            raise InputError(path, f"<{cut(str(node))}>", fault)
        return chosen

    def only_name(node: Node, role: str) -> str:
        chosen = name(node)
        other = node_of[role].setdefault(clean(chosen), node)
        if clean(str(other)) != clean(str(node)):
            raise _two_of_one_name(path, chosen, node, other)
        return chosen

    for head, relation, tail in sorted(graph):
        reason = _no_fact(head, relation, tail)
        if reason is None:
            ends = only_name(head, "entity"), only_name(tail, "entity")
            yield None, None, None, ends[0], only_name(relation, "relation"), ends[1], 1
        elif reason:
            mining.counts[reason] += 1
    if not node_of["entity"]:
        dropped = ", ".join(f"{number:,} {label}" for label, number in mining.counts.items())
        expected = "expected triples between entities that have IRIs"
        raise InputError(path, "", f"{expected}, got {dropped or 'none'}")
    of_table = set(named.kind_of)
    for entity, node in node_of["entity"].items():
        kind = None if entity in of_table else _kind(graph, node, mining.counts)
        if kind is not None:
            named.kind_of[entity] = name(kind)
        if label := _label(graph, node, mining.counts):
            named.phrase_of.setdefault(entity, label.lower())


def _two_of_one_name(path: str, name: str, node: Node, other: Node) -> InputError:
    also = f"{short(name)} is also the name of <{cut(str(other))}>"
    remedy = "set names: iri to use whole IRIs as names"
    return InputError(path, f"<{cut(str(node))}>", f"{also}; {remedy}")


def _no_fact(head: Node, relation: Node, tail: Node) -> str | None:
    """Why a triple is no fact, as a description of a count;
    None for a fact, empty for types and labels.
    """
    from rdflib import OWL, RDF, RDFS, BNode, Literal

    if relation in (RDF.type, RDFS.label):
        return ""
    if isinstance(head, BNode) or isinstance(tail, BNode):
        return BLANK
    if isinstance(tail, Literal):
        return LITERALS
    if relation == OWL.sameAs:
        return SAME
    of_vocabulary = str(relation).startswith((str(RDF), str(RDFS), str(OWL), SHACL))
    return STRUCTURE if of_vocabulary else None


def _kind(graph: Graph, node: Node, counts: Counter[str]) -> Node | None:
    """The type of an entity; of several, the rarest of those that are above no other one."""
    from rdflib import OWL, RDF, RDFS

    types = set(graph.objects(node, RDF.type)) - {OWL.NamedIndividual, OWL.Thing, RDFS.Resource}
    above = {
        higher
        for lower in types
        for higher in graph.transitive_objects(lower, RDFS.subClassOf)
        if higher != lower
    }
    lowest = types - above or types
    counts.update([MANY_TYPES] * (len(lowest) > 1))
    numbers = [(len(list(graph.subjects(RDF.type, each))), str(each), each) for each in lowest]
    return min(numbers)[2] if numbers else None


def _label(graph: Graph, node: Node, counts: Counter[str]) -> str | None:
    """The first usable English label of an entity."""
    from rdflib import RDFS

    for label in sorted(graph.objects(node, RDFS.label), key=str):
        text = clean(" ".join(str(label).split()))
        if (getattr(label, "language", None) or "en").casefold().partition("-")[0] != "en":
            continue
        if not name_fault(text):
            return text
        counts[UNUSABLE] += 1
    return None


def local_name(iri: str) -> str:
    """The part of an IRI after the last ``#`` or ``/`` (in a URN ``:``),
    with percent escapes decoded.
    """
    parts = re.split("[#/]" if re.search("[#/]", iri) else ":", iri.rstrip("#/"))
    return unquote(parts[-1])


class _ByLine(StringIO):
    """Text that is read line by line, since rdflib's time to find the end of a line in what it has
    read grows with the square of its length.
    """

    def read(self, _size: int | None = -1, /) -> str:
        return self.readline()


def _parsed(path: Path) -> Graph:
    """The graph of a file, which is read as a whole."""
    with extra("rdf"):
        from rdflib import Graph
        from rdflib.parser import InputSource
        from rdflib.plugins.parsers.notation3 import BadSyntax

    logging.getLogger("rdflib").setLevel(logging.ERROR)  # no warnings of invalid IRIs
    form = FORMS.get(suffix_of(path))
    if form is None:
        expected = "expected a file name that ends in .nt or .ttl (or these with .gz)"
        raise InputError(path, "", expected)
    text = read_text(path, "RDF, which is read as a whole,")
    try:
        if form == "nt":
            source = InputSource()
            source.setCharacterStream(_ByLine(text, newline=None))
            return Graph().parse(source, format=form)
        return Graph().parse(data=text, format=form, publicID="file:///")
    # truncated or deeply nested text raises errors of any type in the parser
    except Exception as error:
        place, problem = "", f"{type(error).__name__}: {error}"
        if isinstance(error, BadSyntax):
            place, problem = f"line {error.lines + 1}", str(error._why)
        raise InputError(path, place, f"expected RDF ({cut(problem, 120)})") from error
