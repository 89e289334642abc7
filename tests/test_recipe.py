"""The recipe of training: batches and epochs by the size of a graph, the choice of the rate, and
large graphs.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from isi.graph.graph import Graph
from isi.graph.sessions import TEST, TRAIN, VALID
from isi.models.stack import Embedding, NotFinite
from isi.training import recipe
from isi.training.recipe import RATES, better_rate, epochs_for, recipe_for, train_on
from tests.small_graphs import random_graph

GRAPH = random_graph(12, 3, 60)


def with_triples(number: int) -> Graph:
    return replace(GRAPH, triples=GRAPH.triples[:1].expand(number, -1))


@pytest.mark.parametrize(
    ("triples", "batch", "epochs"),
    [(1, 1, 50), (60, 12, 50), (5120, 1024, 50), (2**18, 1024, 16), (10**7, 1024, 10)],
)
def test_batches_and_epochs_follow_from_the_number_of_triples(
    triples: int, batch: int, epochs: int
) -> None:
    graph = with_triples(triples)
    assert (recipe_for(graph, 0.1).batch_size, epochs_for(graph)) == (batch, epochs)


@pytest.mark.parametrize("most_entities", [12, 11], ids=["all entities", "a sample"])
def test_triples_that_are_trained_on_rank_first(
    monkeypatch: pytest.MonkeyPatch, most_entities: int
) -> None:
    monkeypatch.setattr(recipe, "MOST_ENTITIES", most_entities)
    monkeypatch.setattr(recipe, "N3", 0.0)
    every = torch.ones(60, dtype=torch.bool)
    theta = train_on(GRAPH, every, 0.1, 24, 0)
    known = set(map(tuple, GRAPH.triples.tolist()))
    for head, relation, tail in GRAPH.triples.tolist():
        scores = theta.score_tails(torch.tensor([[head]]), torch.tensor([[relation]]))[0, 0]
        wrong = [end for end in range(12) if (head, relation, end) not in known]
        assert scores[tail] > scores[wrong].max()


def test_triples_outside_the_mask_and_their_counts_change_nothing() -> None:
    mask = torch.arange(60) % 5 != 0
    other = replace(GRAPH, triples=GRAPH.triples.clone(), counts=GRAPH.counts + 7)
    other.triples[~mask] = other.triples[~mask].roll(1, 0)
    first, second = (train_on(each, mask, 0.1, 4, 3) for each in (GRAPH, other))
    assert torch.equal(first.entity, second.entity)
    assert not torch.equal(first.entity, train_on(GRAPH, mask, 0.1, 4, 4).entity)


@pytest.mark.parametrize("better", RATES)
def test_the_rate_with_the_better_validation_triples_is_taken(
    monkeypatch: pytest.MonkeyPatch, better: float
) -> None:
    """The better one has seen them."""
    splits = np.full(60, TRAIN, np.int8)
    splits[:8], splits[8:16] = VALID, TEST

    def trained(graph: Graph, mask: torch.Tensor, rate: float, *rest: int) -> Embedding:
        assert mask.tolist() == [False] * 16 + [True] * 44
        seen = torch.ones_like(mask) if rate == better else mask
        return train_on(graph, seen, 0.1, *rest)

    monkeypatch.setattr(recipe, "train_on", trained)
    assert better_rate(GRAPH, splits, 24, 0) == better


def test_a_rate_with_which_training_diverges_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    splits = np.full(60, TRAIN, np.int8)
    assert better_rate(GRAPH, splits, 4, 0) == RATES[0]
    splits[:8] = VALID
    monkeypatch.setattr(recipe, "RATES", (1e14, 0.1))
    assert better_rate(GRAPH, splits, 4, 0) == 0.1
    with pytest.raises(NotFinite):
        train_on(GRAPH, torch.ones(60, dtype=torch.bool), 1e14, 4, 0)
