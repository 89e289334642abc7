"""The graph of an experiment: counts of observations, entities of a second source, and ids."""

from collections import Counter

import pandas as pd
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from isi.config import check
from isi.errors import InputError
from isi.graph.graph import (
    HEAD,
    RELATION,
    TAIL,
    GraphTables,
    MinedSource,
    build_graph,
    build_tables,
)
from isi.tables.table import Table
from stages import build_graph as graphs
from stages import files
from stages.build_graph import Extension, GraphOf

#: (head, relation, tail, how many observations), in the order in which they were seen.
SEEN = [
    ("mug", "hasMaterial", "wood", 1),
    ("mug", "atLocation", "kitchen", 2),
    ("cabinet", "atLocation", "kitchen", 1),
    ("mug", "hasAffordance", "fill", 1),
    ("mug", "atLocation", "cabinet", 1),
    ("mug", "atLocation", "kitchen", 3),
]


def observations(seen: list[tuple[str, str, str, int]] = SEEN) -> pd.DataFrame:
    return pd.DataFrame(seen, columns=["head", "relation", "tail", "count"])


def kinds_of(**kinds: str) -> pd.DataFrame:
    """A table of kinds."""
    names = list(kinds)
    return pd.DataFrame(
        {"entity": names, "kind": list(kinds.values()), "phrase": [f"a {name}" for name in names]}
    )


#: In an order that is not alphabetical.
KINDS = kinds_of(mug="object", wood="material", kitchen="room", fill="affordance", cabinet="object")


def rows(table: pd.DataFrame, schema: Table) -> list[tuple[object, ...]]:
    return list(table[list(schema.columns)].itertuples(index=False, name=None))


def triples_of(seen: pd.DataFrame) -> pd.DataFrame:
    return build_tables(MinedSource("home", seen, KINDS)).triples


def test_observations_of_a_triple_add_up() -> None:
    assert rows(triples_of(observations()), files.TRIPLES) == [
        ("cabinet", "atLocation", "kitchen", 1, "home"),
        ("mug", "atLocation", "cabinet", 1, "home"),
        ("mug", "atLocation", "kitchen", 5, "home"),
        ("mug", "hasAffordance", "fill", 1, "home"),
        ("mug", "hasMaterial", "wood", 1, "home"),
    ]


def test_columns_with_categories_count_like_plain_ones() -> None:
    encoded = observations().astype(
        {"head": "category", "relation": "category", "tail": "category"}
    )
    encoded = encoded[encoded["head"] == "mug"]  # leaves a category without rows
    triples = triples_of(encoded)
    assert len(triples) == 4
    assert triples["count"].sum() == 8


def test_entities_are_in_alphabetical_order_with_the_kinds_and_phrases_of_their_source() -> None:
    graph = build_tables(MinedSource("home", observations(), KINDS))
    assert rows(graph.entities, files.ENTITIES) == [
        ("cabinet", "object", "home", "a cabinet"),
        ("fill", "affordance", "home", "a fill"),
        ("kitchen", "room", "home", "a kitchen"),
        ("mug", "object", "home", "a mug"),
        ("wood", "material", "home", "a wood"),
    ]


def test_an_entity_without_a_kind_is_refused() -> None:
    with pytest.raises(InputError, match=r"home.*'wood'"):
        build_tables(MinedSource("home", observations(), KINDS[KINDS["entity"] != "wood"]))


# With ids


def test_entity_ids_are_rows_and_relation_and_kind_ids_follow_the_alphabet() -> None:
    graph = build_graph(KINDS, triples_of(observations()))
    assert graph.entities == ["mug", "wood", "kitchen", "fill", "cabinet"]
    assert graph.relations == ["atLocation", "hasAffordance", "hasMaterial"]
    # triple ids are rows, too
    assert graph.triples.tolist() == [[4, 0, 2], [0, 0, 4], [0, 0, 2], [0, 1, 3], [0, 2, 1]]
    assert graph.counts.tolist() == [1, 1, 5, 1, 1]
    assert graph.kinds.tolist() == [2, 1, 3, 0, 2]


@pytest.mark.parametrize(
    ("slot", "same"),
    [
        (HEAD, [{0, 2}, {1}, {0, 2}, {3}, {4}]),
        (TAIL, [{0}, {1, 2}, {1, 2}, {3}, {4}]),
        (RELATION, [{0}, {1}, {2}, {3}, {4}]),
    ],
)
def test_triples_that_are_the_same_but_for_one_slot_are_found(
    slot: int, same: list[set[int]]
) -> None:
    lists = build_graph(KINDS, triples_of(observations())).same_but(slot, torch.arange(5)).tolist()
    assert [{triple for triple in triples if triple >= 0} for triples in lists] == same


def test_a_triple_of_an_unknown_entity_is_refused() -> None:
    with pytest.raises(InputError, match="entities"):
        build_graph(KINDS[KINDS["entity"] != "fill"], triples_of(observations()))


# Extended

ENTITIES = pd.DataFrame(
    [
        ("bedroom", "room"),
        ("fabric", "material"),
        ("kitchen", "room"),
        ("lamp", "object"),
        ("open", "affordance"),
        ("wood", "material"),
    ],
    columns=["entity", "kind"],
).assign(source="home", phrase=lambda table: table["entity"])
TRIPLES = pd.DataFrame(
    [("lamp", "atLocation", "kitchen", 2), ("lamp", "hasMaterial", "wood", 3)],
    columns=["head", "relation", "tail", "count"],
).assign(source="home")
LETTERS = ["kitchen", "bedroom", "fan", "stove", "bucket", "purse"]


def seen_elsewhere(*seen: tuple[str, str, int]) -> MinedSource:
    """Observations (object, atLocation, room, count) of a second source ``shop``."""
    frame = observations([(head, "atLocation", room, count) for head, room, count in seen])
    kinds = {room: "room" for _, room, _ in seen} | {head: "object" for head, _, _ in seen}
    return MinedSource("shop", frame, kinds_of(**kinds))


SHOP = seen_elsewhere(
    ("stove", "kitchen", 5),
    ("lamp", "kitchen", 9),
    ("fan", "kitchen", 2),
    ("fan", "bedroom", 4),
    ("stove", "kitchen", 1),
    ("purse", "bedroom", 5),
)


def test_heads_that_the_graph_lacks_are_counted_over_their_triples() -> None:
    new = graphs.new_entities(SHOP, ENTITIES)
    assert new.to_dict() == {"fan": 6, "purse": 5, "stove": 6}
    assert graphs.frequent(new, SHOP, ENTITIES, 6).to_dict() == {"fan": 6, "stove": 6}
    assert list(graphs.frequent(new, SHOP, ENTITIES, 5).index) == ["fan", "purse", "stove"]


@pytest.mark.parametrize(
    ("name", "kind"), [("wood", "material"), ("open", "affordance"), ("bedroom", "room")]
)
def test_an_object_is_not_merged_with_an_entity_of_another_kind(name: str, kind: str) -> None:
    seen = seen_elsewhere((name, "kitchen", 6))
    new = graphs.new_entities(seen, ENTITIES)
    assert graphs.frequent(new, seen, ENTITIES, 7).empty
    with pytest.raises(InputError, match=rf"shop: object '{name}': .* {kind}.*source"):
        graphs.frequent(new, seen, ENTITIES, 6)


@pytest.mark.parametrize("room", ["bathroom", "lamp"])
def test_a_room_that_the_graph_lacks_is_refused(room: str) -> None:
    with pytest.raises(InputError, match=rf"shop: room '{room}'"):
        graphs.new_entities(seen_elsewhere(("fan", room, 6)), ENTITIES)


def test_new_entities_and_their_triples_come_behind_those_of_the_graph() -> None:
    encoded = TRIPLES.astype(
        {"head": "category", "relation": "category", "tail": "category", "source": "category"}
    )
    extended = graphs.extend(GraphTables(ENTITIES, encoded), SHOP, ["fan", "stove"])
    pd.testing.assert_frame_equal(
        extended.entities.iloc[: len(ENTITIES)], ENTITIES, check_dtype=False
    )
    assert rows(extended.entities.iloc[len(ENTITIES) :], ENTITIES) == [
        ("fan", "object", "shop", "a fan"),
        ("stove", "object", "shop", "a stove"),
    ]
    assert rows(extended.triples, TRIPLES) == [
        ("lamp", "atLocation", "kitchen", 2, "home"),  # none of the nine that the other source saw
        ("lamp", "hasMaterial", "wood", 3, "home"),
        ("fan", "atLocation", "bedroom", 4, "shop"),
        ("fan", "atLocation", "kitchen", 2, "shop"),
        ("stove", "atLocation", "kitchen", 6, "shop"),
    ]


def test_a_triple_between_two_newcomers_joins_when_both_do() -> None:
    between = [
        ("fan", "standsOn", "stove", 6),
        ("stove", "standsOn", "fan", 6),
        ("fan", "atLocation", "kitchen", 1),
    ]
    seen = MinedSource(
        "shop", observations(between), kinds_of(fan="object", stove="object", kitchen="room")
    )
    assert list(graphs.new_entities(seen, ENTITIES).index) == ["fan", "stove"]
    home = GraphTables(ENTITIES, TRIPLES)
    alone, both = (
        graphs.extend(home, seen, added).triples.iloc[len(TRIPLES) :]
        for added in (["fan"], ["fan", "stove"])
    )
    assert list(alone["tail"]) == ["kitchen"]
    assert list(both["tail"]) == ["kitchen", "stove", "fan"]


def extension(candidates: int, *always: str) -> Extension:
    return Extension(source="shop", min_observations=6, candidates=candidates, always=list(always))


@given(
    st.lists(st.text("abcxyz ", min_size=1), min_size=1, max_size=30, unique=True),
    st.integers(1, 40),
    st.integers(0, 5),
    st.data(),
)
def test_as_many_as_there_are_or_as_params_say_are_drawn_and_some_always(
    names: list[str], number: int, root: int, data: st.DataObject
) -> None:
    always = data.draw(st.lists(st.sampled_from(names), unique=True, max_size=number))
    enough = pd.Series(6, index=sorted(names))
    drawn = graphs.sample_candidates(enough, extension(number, *always), "key", root)
    assert len(drawn) == min(number, len(names))
    assert set(always) <= set(drawn) <= set(names)
    assert drawn == sorted(drawn)
    assert drawn == graphs.sample_candidates(enough, extension(number, *always[::-1]), "key", root)


def test_every_entity_is_as_likely_to_be_drawn() -> None:
    enough = pd.Series(6, index=sorted(LETTERS))
    times = Counter(
        name
        for root in range(400)
        for name in graphs.sample_candidates(enough, extension(3, "fan"), "key", root)
    )
    assert times.pop("fan") == 400
    assert set(times) == set(LETTERS) - {"fan"}
    assert all(120 < number < 200 for number in times.values())  # 160 expected, deviation 10


def test_an_entity_that_cannot_be_drawn_is_refused_by_its_param() -> None:
    with pytest.raises(
        InputError, match=r"^params\.yaml: experiments\.x\.graph\.extend\.always: 'bottle': "
    ):
        graphs.sample_candidates(
            pd.Series(6, index=LETTERS), extension(3, "bottle"), "experiments.x.graph.extend", 0
        )


@pytest.mark.parametrize("always", [["fan", "stove"], ["fan", "fan"]])
def test_more_entities_that_are_always_drawn_than_are_drawn_are_refused(always: list[str]) -> None:
    values = {"source": "shop", "min_observations": 6, "candidates": 1, "always": always}
    with pytest.raises(
        InputError, match=r"^params\.yaml: experiments\.x\.graph\.extend[.:].*always"
    ):
        check({"source": "home", "extend": values}, GraphOf, "experiments.x.graph")
