"""From observations to the graph: counts, entities, ids and the ground truth."""

from __future__ import annotations

import pickle
from pathlib import Path

import pandas as pd
import pytest
import torch

from isi import graph, tables
from isi.errors import InputError
from isi.tables import Provenance

ROOMS = {"kitchen", "bedroom"}
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


def name_entities(*seen: tuple[str, str, str]) -> pd.DataFrame:
    triples = graph.count_triples(observations([(*triple, 1) for triple in seen]), "ai2thor")
    return graph.name_entities(triples, ROOMS, "ai2thor")


def test_observations_of_a_triple_add_up() -> None:
    triples = graph.count_triples(observations(), "ai2thor")
    assert list(triples[tables.TRIPLES.names].itertuples(index=False, name=None)) == [
        ("cabinet", "atLocation", "kitchen", 1, "ai2thor"),
        ("mug", "atLocation", "cabinet", 1, "ai2thor"),
        ("mug", "atLocation", "kitchen", 5, "ai2thor"),
        ("mug", "hasAffordance", "fill", 1, "ai2thor"),
        ("mug", "hasMaterial", "wood", 1, "ai2thor"),
    ]


def test_columns_with_categories_count_like_plain_ones() -> None:
    encoded = observations().astype({"head": "category", "relation": "category", "tail": "category"})
    encoded = encoded[encoded["head"] == "mug"]  # leaves a category without rows
    triples = graph.count_triples(encoded, "ai2thor")
    assert len(triples) == 4
    assert triples["count"].sum() == 8


@pytest.mark.parametrize(("min_count", "kept"), [(1, 5), (2, 1), (5, 1), (6, 0)])
def test_triples_below_the_minimum_count_are_dropped_and_those_at_it_stay(min_count: int, kept: int) -> None:
    triples = graph.count_triples(observations(), "ai2thor", min_count)
    assert len(triples) == kept
    assert triples.index.tolist() == list(range(kept))


def test_an_entity_whose_triples_were_all_dropped_is_gone() -> None:
    triples = graph.count_triples(observations(), "ai2thor", 2)
    assert graph.name_entities(triples, ROOMS, "ai2thor")["entity"].tolist() == ["kitchen", "mug"]


def test_entities_are_in_alphabetical_order_with_their_kind_and_one_row_a_name() -> None:
    entities = graph.name_entities(graph.count_triples(observations(), "ai2thor"), ROOMS, "ai2thor")
    assert list(entities[tables.ENTITIES.names].itertuples(index=False, name=None)) == [
        ("cabinet", "object", "ai2thor", "cabinet"),  # both a head and a location
        ("fill", "affordance", "ai2thor", "fill"),
        ("kitchen", "room", "ai2thor", "kitchen"),
        ("mug", "object", "ai2thor", "mug"),
        ("wood", "material", "ai2thor", "wood"),
    ]


@pytest.mark.parametrize(
    ("triples", "name", "kinds"),
    [
        ([("mug", "hasMaterial", "glass"), ("glass", "atLocation", "kitchen")], "glass", "material and object"),
        ([("mug", "hasMaterial", "dirty"), ("mug", "hasAffordance", "dirty")], "dirty", "affordance and material"),
        ([("mug", "atLocation", "kitchen"), ("kitchen", "hasMaterial", "wood")], "kitchen", "object and room"),
        ([("mug", "atLocation", "kitchen"), ("mug", "hasMaterial", "kitchen")], "kitchen", "material and room"),
    ],
)
def test_an_entity_of_two_kinds_is_refused(triples: list[tuple[str, str, str]], name: str, kinds: str) -> None:
    with pytest.raises(InputError, match=f"'{name}'.*{kinds}"):
        name_entities(*triples)


@pytest.fixture
def tiny() -> graph.Graph:
    """Entities in an order that is not alphabetical: mug 0, kitchen 1, cabinet 2, wood 3, fill 4."""
    entities = pd.DataFrame({"entity": ["mug", "kitchen", "cabinet", "wood", "fill"]})
    return graph.build(entities, graph.count_triples(observations(), "ai2thor"))


def test_entity_ids_are_rows_and_relation_ids_follow_the_alphabet(tiny: graph.Graph) -> None:
    assert tiny.entities == ["mug", "kitchen", "cabinet", "wood", "fill"]
    assert tiny.relations == ["atLocation", "hasAffordance", "hasMaterial"]
    assert tiny.triples.tolist() == [[2, 0, 1], [0, 0, 2], [0, 0, 1], [0, 1, 4], [0, 2, 3]]  # triple ids: rows, too
    assert tiny.counts.tolist() == [1, 1, 5, 1, 1]


def test_triples_that_are_the_same_but_for_one_slot_are_found(tiny: graph.Graph) -> None:
    # 0: cabinet at kitchen, 1: mug at cabinet, 2: mug at kitchen, 3: mug hasAffordance fill, 4: mug hasMaterial wood
    def found(slot: int) -> list[set[int]]:
        lists = tiny.same_but(slot, torch.arange(5)).tolist()
        return [{triple for triple in triples if triple >= 0} for triples in lists]

    assert found(graph.HEAD) == [{0, 2}, {1}, {0, 2}, {3}, {4}]
    assert found(graph.TAIL) == [{0}, {1, 2}, {1, 2}, {3}, {4}]
    assert found(graph.RELATION) == [{0}, {1}, {2}, {3}, {4}]


def test_tables_read_from_parquet_give_the_same_graph(tiny: graph.Graph, tmp_path: Path) -> None:
    made = Provenance("build_graph", {})
    entities = pd.DataFrame({"entity": tiny.entities, "kind": "object", "source": "x", "phrase": tiny.entities})
    tables.write(tmp_path / "entities", entities, tables.ENTITIES, made)
    tables.write(tmp_path / "triples", graph.count_triples(observations(), "x"), tables.TRIPLES, made)
    read = graph.build(
        tables.read(tmp_path / "entities", tables.ENTITIES), tables.read(tmp_path / "triples", tables.TRIPLES)
    )
    assert (read.entities, read.relations) == (tiny.entities, tiny.relations)
    assert torch.equal(read.triples, tiny.triples)
    assert torch.equal(read.counts, tiny.counts)


def test_a_triple_of_an_unknown_entity_is_refused() -> None:
    entities = pd.DataFrame({"entity": ["mug", "kitchen", "cabinet", "wood"]})
    with pytest.raises(InputError, match="entities"):
        graph.build(entities, graph.count_triples(observations(), "ai2thor"))


def test_a_graph_travels_between_processes_unchanged(tiny: graph.Graph) -> None:
    arrived = pickle.loads(pickle.dumps(tiny))  # noqa: S301 (its own bytes)
    assert (arrived.entities, arrived.relations) == (tiny.entities, tiny.relations)
    assert torch.equal(arrived.triples, tiny.triples)
    assert torch.equal(arrived.counts, tiny.counts)
