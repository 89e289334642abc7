"""The graph that an experiment's tables give: ids, groups of triples, and its way to other processes."""

from __future__ import annotations

import pandas as pd
import pytest
import torch

from isi.errors import InputError
from isi.graph import graph

#: As the table of triples.
TRIPLES = pd.DataFrame(
    [("cabinet", "atLocation", "kitchen", 1), ("mug", "atLocation", "cabinet", 1), ("mug", "atLocation", "kitchen", 5),
     ("mug", "hasAffordance", "fill", 1), ("mug", "hasMaterial", "wood", 1)],
    columns=["head", "relation", "tail", "count"],
).assign(source="x").astype({"count": "int32"})  # fmt: skip
KINDS = ["object", "room", "object", "material", "affordance"]


@pytest.fixture
def tiny() -> graph.Graph:
    """Entities in an order that is not alphabetical: mug 0, kitchen 1, cabinet 2, wood 3, fill 4."""
    entities = pd.DataFrame({"entity": ["mug", "kitchen", "cabinet", "wood", "fill"], "kind": KINDS})
    return graph.build_graph(entities, TRIPLES)


def test_entity_ids_are_rows_and_relation_ids_follow_the_alphabet(tiny: graph.Graph) -> None:
    assert tiny.entities == ["mug", "kitchen", "cabinet", "wood", "fill"]
    assert tiny.relations == ["atLocation", "hasAffordance", "hasMaterial"]
    assert tiny.triples.tolist() == [[2, 0, 1], [0, 0, 2], [0, 0, 1], [0, 1, 4], [0, 2, 3]]  # triple ids: rows, too
    assert tiny.counts.tolist() == [1, 1, 5, 1, 1]
    assert tiny.kinds.tolist() == [2, 3, 2, 1, 0]  # by the alphabet: affordance, material, object, room


def test_triples_that_are_the_same_but_for_one_slot_are_found(tiny: graph.Graph) -> None:
    # 0: cabinet at kitchen, 1: mug at cabinet, 2: mug at kitchen, 3: mug hasAffordance fill, 4: mug hasMaterial wood
    def same_but(slot: int) -> list[set[int]]:
        lists = tiny.same_but(slot, torch.arange(5)).tolist()
        return [{triple for triple in triples if triple >= 0} for triples in lists]

    assert same_but(graph.HEAD) == [{0, 2}, {1}, {0, 2}, {3}, {4}]
    assert same_but(graph.TAIL) == [{0}, {1, 2}, {1, 2}, {3}, {4}]
    assert same_but(graph.RELATION) == [{0}, {1}, {2}, {3}, {4}]


def test_a_triple_of_an_unknown_entity_is_refused() -> None:
    entities = pd.DataFrame({"entity": ["mug", "kitchen", "cabinet", "wood"], "kind": "object"})
    with pytest.raises(InputError, match="entities"):
        graph.build_graph(entities, TRIPLES)
