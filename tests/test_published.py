"""The graph that the paper's first author published: whole, and under names that people read."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from isi.errors import InputError
from isi.graph.graph import GraphTables, MinedSource, build_tables
from isi.sources import published
from isi.sources.names import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL
from isi.tables import paths
from tests.observing import observations_of

PLACES = ["cabinet", "fridge", "hanger", "table", "towel holder"]


@pytest.fixture(scope="module")
def graph() -> GraphTables:
    found = observations_of({"reader": "published"})
    assert found.table[["scene", "room", "instance"]].isna().all(axis=None)
    return build_tables(MinedSource("published", found.table, found.kinds))


def test_it_has_the_triples_and_observations_of_its_authors(graph: GraphTables) -> None:
    assert len(graph.triples) == 352
    assert graph.triples["count"].sum() == 14_759
    assert set(graph.triples["relation"]) == {AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL}


def test_it_has_as_many_affordances_and_materials_as_the_paper_says(graph: GraphTables) -> None:
    assert graph.entities["kind"].value_counts().to_dict() == {"object": 73, "room": 4, "affordance": 17, "material": 7}


def test_bowls_are_in_cabinets_as_often_as_the_paper_says(graph: GraphTables) -> None:
    phrase = dict(zip(graph.entities["entity"], graph.entities["phrase"], strict=True))
    triples = graph.triples.assign(of=graph.triples["head"].map(phrase), where=graph.triples["tail"].map(phrase))
    bowls = triples[(triples["of"] == "bowl") & (triples["where"] == "cabinet")]
    assert bowls[["head", "relation", "tail", "count"]].values.tolist() == [
        ["bowl", AT_LOCATION, "cabinet (place)", 22]
    ]


def test_what_is_a_place_and_a_thing_is_two_entities_of_one_phrase(graph: GraphTables) -> None:
    entities = graph.entities.set_index("entity")
    shared = entities[entities["phrase"].duplicated(keep=False)]
    assert sorted(shared.index) == sorted(name for place in PLACES for name in (place, f"{place} (place)"))
    heads, tails = set(graph.triples["head"]), set(graph.triples["tail"])
    for place in PLACES:
        assert entities.loc[place, "phrase"] == entities.loc[f"{place} (place)", "phrase"]
        assert f"{place} (place)" in tails - heads
        assert place in heads - tails


def test_what_is_found_in_a_room_is_an_object_though_others_be_made_of_it(graph: GraphTables) -> None:
    heads = set(graph.triples["head"])
    made_of = set(graph.triples.loc[graph.triples["relation"] == HAS_MATERIAL, "tail"])
    assert heads & made_of == {"fabric", "mirror"}
    assert set(graph.entities.loc[graph.entities["entity"].isin(heads), "kind"]) == {"object"}


def test_every_phrase_names_a_synset_of_the_triples() -> None:
    listed = published.read_phrases(paths.PUBLISHED_PHRASES)
    triples = pd.read_csv(paths.PUBLISHED_TRIPLES)
    assert sorted(listed["synset"]) == sorted({*triples["head"], *triples["tail"]})
    assert len(listed) == 101


@pytest.mark.parametrize(
    ("content", "place"),
    [
        ("head,relation,tail\nmug.n.04,atLocation,kitchen.l.01\n", "line 1: .*head, relation, tail, count"),
        ("head,relation,tail,count\nmug.n.04,atLocation,cave.l.01,1\n", "line 2: .*'cave.l.01'"),
        ("head,relation,tail,count\n" + 2 * "mug.n.04,atLocation,kitchen.l.01,1\n", "line 3: .*twice"),
    ],
)
def test_broken_triples_are_refused(tmp_path: Path, content: str, place: str) -> None:
    (tmp_path / "triples.csv").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=rf"triples\.csv: {place}"):
        list(published.observations(tmp_path / "triples.csv", {"mug.n.04": "mug", "kitchen.l.01": "kitchen"}))


@pytest.mark.parametrize("twice", ["mug.n.04,cup,cup,object", "cup.n.01,mug,cup,object"])
def test_a_synset_or_an_entity_that_is_named_twice_is_refused(tmp_path: Path, twice: str) -> None:
    path = tmp_path / "phrases.csv"
    path.write_text(f"synset,entity,phrase,kind\nmug.n.04,mug,mug,object\n{twice}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"phrases\.csv: line 3: .*twice"):
        published.read_phrases(path)
