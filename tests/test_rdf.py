"""A user's RDF files: local names, kinds of several types, and long lines
(`read_files.yaml` has the others).
"""

from pathlib import Path

import pytest

from isi.sources.rdf import LITERALS, MANY_TYPES, local_name
from tests.observing import TRIPLE, observe, written

NAMES = "http://home.example/things#"


def line(head: str, relation: str, tail: str) -> str:
    return f"<{NAMES}{head}> <{NAMES}{relation}> <{NAMES}{tail}> .\n"


@pytest.mark.parametrize(
    ("iri", "name"),
    [
        ("http://a.example/b#c", "c"),
        ("http://a.example/b/", "b"),
        ("http://a.example/b/c:d", "c:d"),
        ("urn:isi:x:entity:side%20table", "side table"),
        ("http://a.example/M%C3%B6bel", "Möbel"),
    ],
)
def test_the_name_is_the_local_part_of_an_iri(iri: str, name: str) -> None:
    assert local_name(iri) == name


# Vocabulary, types and labels

PREFIXES = """@prefix : <http://home.example/things#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
:mug :at :kitchen .
"""


@pytest.mark.parametrize(
    ("types", "kind", "counted"),
    [
        (":Mug, owl:Thing, owl:NamedIndividual", "Mug", 0),
        ("rdfs:Resource, :Mug", "Mug", 0),
        (":Thing, :Mug", "Mug", 0),
        (":Artifact, :Mug, :Thing", "Mug", 0),
        (":Cup, :Mug", "Mug", 1),
        (":Same, :Mug", "Mug", 1),
        ("owl:Thing", "entity", 0),
    ],
)
def test_of_several_types_the_lowest_and_rarest_is_the_kind(
    tmp_path: Path, types: str, kind: str, counted: int
) -> None:
    more = f"""{PREFIXES} :mug a {types} . :kitchen a :Room . :cup :at :kitchen ; a :Cup .
:Mug rdfs:subClassOf :Artifact, :Same . :Same rdfs:subClassOf :Mug . :Artifact rdfs:subClassOf \
:Thing .
"""
    observed = observe("rdf", written(tmp_path / "a.ttl", more))
    assert observed.kind_of() == {"mug": kind, "kitchen": "Room", "cup": "Cup"}
    assert observed.counts[MANY_TYPES] == counted
    assert "entities" in MANY_TYPES  # the setting


def test_long_literals_of_ntriples_are_dropped_as_others_are(tmp_path: Path) -> None:
    text = (
        line("mug", "at", "kitchen") + f'<{NAMES}kitchen> <{NAMES}wkt> "{"POLYGON " * 150_000}" .\n'
    )
    observed = observe("rdf", written(tmp_path / "a.nt", text + line("pan", "at", "kitchen")))
    assert sorted(observed.rows(*TRIPLE)) == [("mug", "at", "kitchen"), ("pan", "at", "kitchen")]
    assert observed.counts == {LITERALS: 1}
