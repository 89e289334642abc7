"""A user's RDF files: triples from N-Triples and Turtle, names of entities, and refused input."""

import gzip
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rdflib import Graph, URIRef

from isi.sources.rdf import BLANK, LITERALS, MANY_TYPES, SAME, STRUCTURE, UNUSABLE, local_name
from tests.observing import TRIPLE, observe, refusal, refused, written

HOME = """@prefix : <http://home.example/things#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .

:mug a :Object, owl:NamedIndividual ; :atLocation :kitchen, :side%20table ; :weight 0.3 ;
  rdfs:label "Becher"@de, "Coffee mug"@en .
:kitchen a :Room ; rdfs:label "kitchen" ; :seen [ :by :robot ] .
:claim rdf:subject :mug ; rdf:predicate :atLocation ; rdf:object :bathroom .
"""
EXPECTED = [("mug", "atLocation", "kitchen"), ("mug", "atLocation", "side table")]
NAMES = "http://home.example/things#"


def line(head: str, relation: str, tail: str) -> str:
    return f"<{NAMES}{head}> <{NAMES}{relation}> <{NAMES}{tail}> .\n"


@pytest.fixture
def home(tmp_path: Path) -> Path:
    return written(tmp_path / "home.ttl", HOME)


def test_triples_between_named_things_are_observations_and_the_others_are_counted(
    home: Path,
) -> None:
    observed = observe("rdf", home)
    assert observed.rows("scene", "room", "instance", *TRIPLE, "count") == [
        (None, None, None, *row, 1) for row in EXPECTED
    ]
    assert observed.counts == {LITERALS: 1, BLANK: 2, STRUCTURE: 3}


def test_types_are_kinds_and_english_labels_are_phrases(home: Path) -> None:
    observed = observe("rdf", home)
    assert observed.kind_of() == {"kitchen": "Room", "mug": "Object", "side table": "entity"}
    assert observed.phrase_of() == {
        "kitchen": "kitchen",
        "mug": "coffee mug",
        "side table": "side table",
    }


VOCABULARY = """
:atLocation a owl:ObjectProperty, owl:FunctionalProperty ; rdfs:label "is where\\nsomething is" .
:Object a owl:Class, rdfs:Class ; rdfs:label "{long}" .
<http://home.example/classes#mug> a owl:Class ; rdfs:label "Mugs" .
""".replace("{long}", "o" * 300)


def test_types_and_labels_of_what_is_no_entity_are_not_looked_at(
    home: Path, tmp_path: Path
) -> None:
    expected, observed = (
        observe("rdf", home),
        observe("rdf", written(tmp_path / "more.ttl", HOME + VOCABULARY)),
    )
    assert observed.rows(*TRIPLE) == expected.rows(*TRIPLE)
    assert observed.kinds.equals(expected.kinds)


def test_ntriples_and_compressed_files_give_the_same(home: Path, tmp_path: Path) -> None:
    expected = observe("rdf", home)
    Graph().parse(home).serialize(tmp_path / "home.nt", format="nt", encoding="utf-8")
    packed = written(tmp_path / "home.ttl.gz", gzip.compress(HOME.encode()))
    commented = written(
        tmp_path / "more.nt", "# mine\r\n\r\n" + (tmp_path / "home.nt").read_text(encoding="utf-8")
    )
    for path in (tmp_path / "home.nt", packed, commented):
        observed = observe("rdf", path)
        assert sorted(observed.rows(*TRIPLE)) == EXPECTED, path
        assert observed.kinds.equals(expected.kinds)
        assert observed.counts == expected.counts


def test_a_table_of_entities_goes_before_types_and_labels_and_these_before_relations(
    home: Path, tmp_path: Path
) -> None:
    listed = written(
        tmp_path / "names.csv", "entity,kind,phrase\nmug,cup,beaker\nside table,table,\n"
    )
    observed = observe("rdf", home, entities=str(listed))
    assert observed.kind_of() == {"kitchen": "Room", "mug": "cup", "side table": "table"}
    assert observed.phrase_of()["mug"] == "beaker"
    kinds = {"atLocation": {"head": "thing", "tail": "place"}}
    assert observe("rdf", home, kinds=kinds).kind_of() == {
        "kitchen": "Room",
        "mug": "Object",
        "side table": "place",
    }


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


def test_two_things_of_one_name_are_refused_unless_they_go_by_their_iris(tmp_path: Path) -> None:
    text = line("cup", "r", "tea") + line("tea", "r", "x").replace("#", "/")
    path = written(tmp_path / "log.nt", text)
    refused("rdf", path, ["line 2", "'tea'", f"<{NAMES}tea>", "names: iri"])
    assert len(observe("rdf", path, names="iri").kinds) == 4


@given(st.lists(st.tuples(*[st.sampled_from("abcde")] * 3), min_size=1))
def test_as_many_triples_as_rdflib_finds(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[str, ...]]
) -> None:
    graph = Graph()
    for row in rows:
        graph.add(
            tuple(URIRef(f"urn:{prefix}:{name}") for prefix, name in zip("ere", row, strict=True))
        )
    path = tmp_path_factory.getbasetemp() / "all.nt"
    graph.serialize(path, format="nt", encoding="utf-8")
    assert set(observe("rdf", path).rows(*TRIPLE)) == set(rows)
    assert len(observe("rdf", path).table) == len(graph)


# Vocabulary, types and labels

PREFIXES = """@prefix : <http://home.example/things#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix sh: <http://www.w3.org/ns/shacl#> .
:mug :at :kitchen .
"""


def test_predicates_of_rdfs_owl_and_shacl_are_no_facts_and_are_counted(tmp_path: Path) -> None:
    more = """:at rdfs:domain :Thing ; rdfs:range :Room ; owl:inverseOf :holds ; a \
owl:ObjectProperty .
:Mug rdfs:subClassOf :Thing ; owl:disjointWith :Room ; rdfs:seeAlso :manual . :shape \
sh:targetClass :Mug .
:mug owl:sameAs :cup ; owl:versionInfo "3" .
"""
    observed = observe("rdf", written(tmp_path / "a.ttl", PREFIXES + more))
    assert observed.rows(*TRIPLE) == [("mug", "at", "kitchen")]
    assert observed.counts == {STRUCTURE: 7, SAME: 1, LITERALS: 1}
    message = refusal(
        "rdf", written(tmp_path / "b.ttl", PREFIXES.replace(":mug :at :kitchen .", "") + more)
    )
    assert "7" in message
    assert STRUCTURE[:40] in message


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


def test_spaces_of_labels_are_collapsed_and_unusable_labels_are_counted(tmp_path: Path) -> None:
    more = (
        f'{PREFIXES} :mug rdfs:label " coffee\\n  mug " . :kitchen rdfs:label "", "x\\u0000" . '
        ':at rdfs:label " " .'
    )
    observed = observe("rdf", written(tmp_path / "a.ttl", more))
    assert observed.phrase_of() == {"mug": "coffee mug", "kitchen": "kitchen"}
    assert observed.counts[UNUSABLE] == 2


def test_long_literals_of_ntriples_are_dropped_as_others_are(tmp_path: Path) -> None:
    text = (
        line("mug", "at", "kitchen") + f'<{NAMES}kitchen> <{NAMES}wkt> "{"POLYGON " * 150_000}" .\n'
    )
    observed = observe("rdf", written(tmp_path / "a.nt", text + line("pan", "at", "kitchen")))
    assert observed.rows(*TRIPLE) == [("mug", "at", "kitchen"), ("pan", "at", "kitchen")]
    assert observed.counts == {LITERALS: 1}


def test_a_line_of_ntriples_may_be_too_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("isi.sources.rdf.MOST", 1000)
    text = line("mug", "at", "kitchen") + line("mug", "at", "k" * 1000)
    refused("rdf", written(tmp_path / "a.nt", text), ["a.nt: line 2", "line longer than 1,000"])
