"""Graphs published as triples: hand-written files of ids, bad files,
and the three shipped graphs.
"""

from collections import Counter
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isi.errors import InputError
from isi.graph.graph import GraphTables, MinedSource, build_tables
from isi.sources.names import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL
from isi.sources.triples import KINDS_BY_SUFFIX, read_ids, shipped_names
from tests.observing import observations_of

FILES = {
    "entity2id.txt": "4\nalarmclock.o\t0\ndesk.l\t2\nwall_lamp.o\t1\ntown hall\t3\n",
    "relation2id.txt": "2\nObjOnLoc\t0\nknows\t1\n",
    "gt2id.txt": "4\n0 2 0\n1,2,0\n0\t2\t0\r\n3 0 1\n",
}


def folder_of(path: Path, **changes: str | None) -> Path:
    """A folder with the files; ``changes``: other contents by name, None: missing."""
    for name, content in {
        **FILES,
        **{f"{key}.txt": content for key, content in changes.items()},
    }.items():
        if content is not None:
            (path / name).write_bytes(content.encode("utf-8", "surrogateescape"))
    return path


def mined(from_: str, triples: list[str] | None = None) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Observations and kinds of a folder of triples."""
    observed = observations_of({"reader": "triples_with_ids", "from": from_, "triples": triples})
    return observed.table, observed.kinds


def test_ids_are_head_tail_and_relation_and_repeats_are_observations(tmp_path: Path) -> None:
    observations, kinds = mined(str(folder_of(tmp_path)))
    assert observations[["scene", "room", "instance"]].isna().all(axis=None)
    assert observations[["head", "relation", "tail", "count"]].to_numpy().tolist() == [
        ["alarmclock.o", "ObjOnLoc", "desk.l", 2],
        ["town hall", "knows", "alarmclock.o", 1],
        ["wall_lamp.o", "ObjOnLoc", "desk.l", 1],
    ]
    assert kinds.to_numpy().tolist() == [
        ["alarmclock.o", "object", "alarmclock"],
        ["desk.l", "location", "desk"],
        ["town hall", "entity", "town hall"],
        ["wall_lamp.o", "object", "wall lamp"],
    ]


def test_names_of_the_graphs_that_ship_say_nothing_of_a_folder(tmp_path: Path) -> None:
    names, triples = "3\nbowl.o\t0\nbowl\t1\nalarm clock\t2\n", "2\n0 1 1\n2 0 0\n"
    observations, kinds = mined(str(folder_of(tmp_path, entity2id=names, gt2id=triples)))
    assert observations[["head", "tail"]].to_numpy().tolist() == [
        ["alarm clock", "bowl.o"],
        ["bowl.o", "bowl"],
    ]
    assert kinds.to_numpy().tolist() == [
        ["alarm clock", "entity", "alarm clock"],
        ["bowl", "entity", "bowl"],
        ["bowl.o", "object", "bowl"],
    ]


def test_several_files_of_triples_are_one_graph(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, train2id="1\n0 2 0\n", test2id="2\n0 2 0\n1 2 0\n")
    observations, _ = mined(str(folder), ["train2id.txt", "test2id.txt"])
    assert observations["count"].tolist() == [2, 1]


def test_a_file_of_triples_that_is_listed_twice_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"triples.*once"):
        mined(str(folder_of(tmp_path)), ["gt2id.txt", "gt2id.txt"])


@given(
    st.lists(
        st.tuples(st.integers(0, 3), st.integers(0, 3), st.integers(0, 1)), min_size=1, max_size=30
    )
)
def test_every_line_is_counted_once(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[int, int, int]]
) -> None:
    lines = [f"{len(rows)}", *(f"{head} {tail} {relation}" for head, tail, relation in rows), ""]
    folder = folder_of(tmp_path_factory.mktemp("ids"), gt2id="\n".join(lines))
    names, relations = ["alarmclock.o", "wall_lamp.o", "desk.l", "town hall"], ["ObjOnLoc", "knows"]
    expected = Counter(
        (names[head], relations[relation], names[tail]) for head, tail, relation in rows
    )
    assert read_ids(folder, ["gt2id.txt"]) == expected


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
