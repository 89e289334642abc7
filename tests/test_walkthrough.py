"""Read this first: a home of seven names, a novel cup, and every number by hand.

A robot knows mugs, bowls, a sofa, two rooms and that one drinks from a mug. It meets a cup that
stands in the kitchen.
"""

import numpy as np
import pandas as pd
import pytest
import torch

from isi.evaluation.query_sets import novel_query_set
from isi.evaluation.ranking import MEASURES, evaluate
from isi.graph.graph import build_graph
from isi.graph.sessions import TEST, TRAIN, session_at
from isi.initializers.api import INITIALIZERS
from isi.insertion.engine import context_in_session
from isi.models.model import make_model
from isi.models.stack import Embedding, uniform
from isi.training.batches import Negatives, training_data
from isi.training.trainer import Optimizer, train

ENTITIES = pd.DataFrame(
    {
        "entity": ["bowl", "cup", "drink", "kitchen", "living room", "mug", "sofa"],
        "kind": ["object", "object", "affordance", "room", "room", "object", "object"],
    }
)
BOWL, CUP, DRINK, KITCHEN, LIVING_ROOM, MUG, SOFA = range(7)
TRIPLES = pd.DataFrame(
    [
        ("bowl", "atLocation", "kitchen", 2),
        # the robot's observation of the cup: its insert triple
        ("cup", "atLocation", "kitchen", 1),
        ("cup", "hasAffordance", "drink", 1),  # a true triple that the robot does not know
        ("mug", "atLocation", "kitchen", 3),
        ("mug", "hasAffordance", "drink", 5),
        ("sofa", "atLocation", "living room", 1),
    ],
    columns=["head", "relation", "tail", "count"],
)
OBSERVED, HIDDEN = 1, 2
# relations are numbered by the alphabet: atLocation 0, hasAffordance 1
GRAPH = build_graph(ENTITIES, TRIPLES)
SPLITS = torch.tensor([[TRAIN, TRAIN, TEST, TRAIN, TRAIN, TRAIN]], dtype=torch.int8)
NOVEL = torch.tensor([[CUP]])
D0, D1 = (session_at(GRAPH, SPLITS, NOVEL[:, None], number) for number in (0, 1))

#: Cup, mug and sofa have similar word vectors, bowl a less similar one; rooms and drink have none.
WORDS = torch.tensor(
    [[0.8, 0.6], [1.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [1.0, 0.1], [1.0, 0.2]]
)
#: DistMult in two dimensions: f(h, r, t) = Σ h · r · t.
DISTMULT = make_model("distmult", {}, "models.distmult")
THETA0 = Embedding(
    entity=torch.tensor(
        [[[0.8, 0.2], [0.0, 0.0], [1.0, 0.0], [1.2, -0.2], [-0.2, 1.2], [1.1, 0.1], [0.1, 1.0]]]
    ),
    relation=torch.tensor([[[1.0, 1.0], [2.0, 0.0]]]),
    model=DISTMULT,
)
SIZE_AND_SEED = torch.tensor([[1, 0]])


def test_the_session_before_has_all_but_the_cup_and_its_triples() -> None:
    assert D0.entities.tolist() == [[True, False, True, True, True, True, True]]
    assert D0.members(TRAIN).tolist() == [[True, False, False, True, True, True]]
    assert D1.members(TEST).nonzero().tolist() == [[0, HIDDEN]]


def test_theta0_is_trained_until_what_it_knows_scores_above_what_it_does_not() -> None:
    start = uniform(
        D0.entities,
        relations=2,
        model=DISTMULT,
        dimension=8,
        half_range=0.01,
        root=0,
        keys=SIZE_AND_SEED,
    )
    data = training_data(D0, "training", SIZE_AND_SEED)
    optimizer = Optimizer(batch_size=4, learning_rate=0.1, weight_decay=0.0, max_epochs=100)
    negatives = Negatives(mode="expected", ratio=2)
    theta0 = train(
        start, data, negatives, optimizer, root=0, watch=lambda _epoch, _theta, models: models >= 0
    )
    rooms = theta0.score_tails(torch.tensor([[MUG]]), torch.tensor([[0]]))[0, 0]
    assert rooms[KITCHEN] > rooms[LIVING_ROOM]
    assert not theta0.entity[0, CUP].any(), "rows of novel entities stay zero"


def insert(initializer: str, **options: int) -> torch.Tensor:
    """The vector that an initializer gives to the cup; shape (1, 1, 2)."""
    triples = torch.tensor([[0, 0, OBSERVED]])
    context = context_in_session(THETA0, D0, NOVEL, triples, WORDS, root=0, keys=SIZE_AND_SEED)
    return INITIALIZERS.get(initializer, "initializers").function(context, **options).vectors


def test_es_takes_the_names_that_are_most_similar_a_sofa_among_them() -> None:
    mug_and_sofa = [(1.1 + 0.1) / 2, (0.1 + 1.0) / 2]
    assert insert("es", k=2).flatten().tolist() == pytest.approx(mug_and_sofa)


def test_ers_takes_of_these_the_ones_that_stand_in_kitchens() -> None:
    """(cup, atLocation, kitchen) puts a head at the kitchen's vector times W⁻¹ = (1.2, -0.2).

    The cosine with it is .995 for the mug, .91 for the bowl and -.07 for the sofa.
    """
    mug_and_bowl = [(1.1 + 0.8) / 2, (0.1 + 0.2) / 2]
    assert insert("ers", k=2, candidates=3).flatten().tolist() == pytest.approx(mug_and_bowl)


def test_mrr_star_of_the_inserted_cup() -> None:
    """The one triple that touches the cup and was not observed is (cup, hasAffordance, drink):
    three queries.

    The cup is at (.95, .15), and hasAffordance multiplies first coordinates by 2.

    - Tail, (cup, hasAffordance, ?): kitchen 2.28, mug 2.09, drink 1.9, cup 1.8, ...: rank 3, and 1
      would be right.
    - Head, (?, hasAffordance, drink): kitchen 2.4, mug 2.2 (left out: known to be right), drink
      2.0, cup 1.9: rank 3 again, and 1 would be right among those that are left.
    - Relation, (cup, ?, drink): hasAffordance 1.9, atLocation .95: rank 1.

    MRR* is 1 / (|true rank - predicted rank| + 1): 1/3 for entities, 1 for relations, and their
    mean.
    """
    vector = insert("ers", k=2, candidates=3)
    theta1 = Embedding(THETA0.entity.clone(), THETA0.relation, DISTMULT)
    theta1.entity[:, CUP] = vector[:, 0]
    observed = torch.zeros(1, len(TRIPLES), dtype=torch.bool)
    observed[0, OBSERVED] = True
    result = evaluate(theta1, novel_query_set(D1, NOVEL, observed))["novel"]
    measured = dict(zip(MEASURES, result.measures[0].tolist(), strict=True))
    assert measured["mrr_star_entity"] == pytest.approx(1 / 3)
    assert measured["mrr_star_relation"] == pytest.approx(1)
    assert measured["mrr_star"] == pytest.approx(2 / 3)
    assert result.queries.tolist() == [1]
    assert np.isfinite(result.measures.numpy()).all()
