"""The three graphs that ship as triples (`read_files.yaml` has files of ids)."""

import pandas as pd
import pytest

from isi.graph.graph import GraphTables, MinedSource, build_tables
from isi.sources.names import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL
from isi.sources.triples import KINDS_BY_SUFFIX, shipped_names
from tests.observing import observations_of


def mined(from_: str, triples: list[str] | None = None) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Observations and kinds of a folder of triples."""
    observed = observations_of({"reader": "triples_with_ids", "from": from_, "triples": triples})
    return observed.table, observed.kinds


@pytest.mark.parametrize(
    ("name", "triples", "observed", "relations", "kinds"),
    [
        (
            "virtualhome",
            4_240,
            350_895,
            11,
            {"object": 182, "location": 40, "action": 34, "state": 16, "room": 4},
        ),
        (
            "thor_u",
            1_964,
            1_964,
            15,
            {"object": 113, "location": 39, "action": 27, "state": 14, "material": 13, "room": 4},
        ),
    ],
)
def test_a_graph_that_ships_is_that_of_its_authors(
    name: str, triples: int, observed: int, relations: int, kinds: dict[str, int]
) -> None:
    observations, of_kinds = mined(name)
    assert len(observations) == triples
    assert observations["count"].sum() == observed
    assert observations["relation"].nunique() == relations
    assert of_kinds["kind"].value_counts().to_dict() == kinds


def test_rooms_and_locations_are_where_their_relations_lead() -> None:
    observations, kinds = mined("thor_u")
    kind = dict(zip(kinds["entity"], kinds["kind"], strict=True))
    ends = set(
        zip(
            observations["relation"],
            *(observations[end].map(kind) for end in ("head", "tail")),
            strict=True,
        )
    )
    expected = {
        ("ObjInRoom", "object", "room"),
        ("LocInRoom", "location", "room"),
        ("ObjOnLoc", "object", "location"),
        ("HasMat", "object", "material"),
        ("HasEffect", "action", "state"),
    }
    assert {row for row in ends if row[0] in {relation for relation, *_ in expected}} == expected


def test_names_of_the_graphs_agree_and_are_unique() -> None:
    names = shipped_names()
    assert not names["name"].duplicated().any()
    of_kind = names.assign(kind=names["name"].str.rpartition(".")[2].map(KINDS_BY_SUFFIX))
    described = of_kind[["entity", "phrase", "kind"]].drop_duplicates()
    assert not described["entity"].duplicated().any()
    plain = described["entity"].str.replace(r" \((place|action|state|material)\)$", "", regex=True)
    assert (plain == described["phrase"]).all()


# The paper's own

PLACES = ["cabinet", "fridge", "hanger", "table", "towel holder"]


@pytest.fixture(scope="module")
def graph() -> GraphTables:
    observed = observations_of({"reader": "published"})
    assert observed.table[["scene", "room", "instance"]].isna().all(axis=None)
    return build_tables(MinedSource("published", observed.table, observed.kinds))


def test_the_papers_graph_has_the_triples_and_entities_that_the_paper_names(
    graph: GraphTables,
) -> None:
    assert len(graph.triples) == 352
    assert graph.triples["count"].sum() == 14_759
    assert set(graph.triples["relation"]) == {AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL}
    assert graph.entities["kind"].value_counts().to_dict() == {
        "object": 73,
        "room": 4,
        "affordance": 17,
        "material": 7,
    }
    bowls = graph.triples[
        (graph.triples["head"] == "bowl") & graph.triples["tail"].str.startswith("cabinet")
    ]
    assert bowls[["relation", "tail", "count"]].values.tolist() == [
        [AT_LOCATION, "cabinet (place)", 22]
    ]


def test_what_is_a_place_and_a_thing_is_two_entities_of_one_phrase(graph: GraphTables) -> None:
    entities = graph.entities.set_index("entity")
    shared = entities[entities["phrase"].duplicated(keep=False)]
    assert sorted(shared.index) == sorted(
        name for place in PLACES for name in (place, f"{place} (place)")
    )
    heads, tails = set(graph.triples["head"]), set(graph.triples["tail"])
    for place in PLACES:
        assert entities.loc[place, "phrase"] == entities.loc[f"{place} (place)", "phrase"]
        assert f"{place} (place)" in tails - heads
        assert place in heads - tails


def test_what_is_found_in_a_room_is_an_object_though_others_be_made_of_it(
    graph: GraphTables,
) -> None:
    heads = set(graph.triples["head"])
    made_of = set(graph.triples.loc[graph.triples["relation"] == HAS_MATERIAL, "tail"])
    assert heads & made_of == {"fabric", "mirror"}
    assert set(graph.entities.loc[graph.entities["entity"].isin(heads), "kind"]) == {"object"}
