"""Read this first: a home of seven names, a novel cup, and every number by hand.

A robot knows mugs, bowls, a sofa, two rooms and that one drinks from a mug. It meets a cup that
stands in the kitchen.
"""

import pandas as pd
import pytest
import torch

from isi.evaluation.query_sets import query_sets, with_weighted
from isi.evaluation.ranking import evaluate, measure_rows
from isi.graph.graph import build_graph
from isi.graph.sessions import TEST, TRAIN, session_at
from isi.initializers.api import INITIALIZERS
from isi.initializers.context import context_in_session
from isi.models.model import make_model
from isi.models.stack import Embedding, uniform
from isi.training.batches import Negatives, training_data
from isi.training.trainer import Optimizer, train
from stages.grid import GridPoints, known_shares

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
        ("bowl", "hasAffordance", "drink", 1),  # true, but held out
        # the robot's observation of the cup: its insert triple
        ("cup", "atLocation", "kitchen", 1),
        ("cup", "atLocation", "living room", 2),  # learned after insertion
        ("cup", "hasAffordance", "drink", 1),  # true, but held out
        ("mug", "atLocation", "kitchen", 3),
        ("mug", "hasAffordance", "drink", 5),
        ("sofa", "atLocation", "living room", 1),
    ],
    columns=["head", "relation", "tail", "count"],
)
OBSERVED = 2
# relations are numbered by the alphabet: atLocation 0, hasAffordance 1
GRAPH = build_graph(ENTITIES, TRIPLES)
SPLITS = torch.tensor([[TRAIN, TEST, TRAIN, TRAIN, TEST, TRAIN, TRAIN, TRAIN]], dtype=torch.int8)
NOVEL = torch.tensor([[CUP]])
D0, D1 = (session_at(GRAPH, SPLITS, NOVEL, number) for number in (0, 1))

#: Cup, mug and sofa have similar word vectors, bowl a less similar one; rooms and drink have none.
WORDS = torch.tensor(
    [[0.8, 0.6], [1.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [1.0, 0.1], [1.0, 0.2]]
)
#: DistMult in two dimensions: f(h, r, t) = Σ h · r · t.
DISTMULT = make_model("distmult", {}, "models.distmult")
THETA0 = Embedding(
    entity=torch.tensor(
        [[[0.8, 0.2], [0.0, 0.0], [1.0, 0.0], [1.2, -0.2], [0.3, 1.2], [1.1, 0.1], [0.1, 1.0]]]
    ),
    relation=torch.tensor([[[1.0, 1.0], [2.0, 0.0]]]),
    model=DISTMULT,
)
SIZE_AND_SEED = torch.tensor([[1, 0]])


def test_the_session_before_has_all_but_the_cup_and_its_triples() -> None:
    assert D0.entities.tolist() == [[True, False, True, True, True, True, True]]
    assert D0.members(TRAIN, TEST)[0].nonzero().flatten().tolist() == [0, 1, 5, 6, 7]


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


def test_the_measure_right_after_the_cup_is_inserted() -> None:
    """The cup is at (.95, .15), and hasAffordance multiplies first coordinates by 2. A query's term
    is 1 / rank, where candidates that are true, too, are left out.

    Known: the test triple (bowl, hasAffordance, drink).

    - Tail: kitchen 1.92, mug 1.76, drink 1.6, ...: rank 3. Head: kitchen 2.4, mug (true), drink 2,
      cup (true), bowl 1.6: rank 3. Relation: 1.6 beside .8: rank 1.
    - (1/3 + 1) / 2: half entity prediction, half relation prediction.

    Novel: all that touches the cup and was not observed: (cup, atLocation, living room), twice,
    and (cup, hasAffordance, drink).

    - Living room as tail: kitchen (true), mug 1.06, drink .95, cup .925, bowl .79, living room
      .465: rank 5. Cup as head: living room 1.53, sofa (true), bowl .48, cup .465: rank 3.
      Relation: hasAffordance has .57: rank 2.
    - Drink as tail: kitchen, mug, drink 1.9: rank 3. Cup as head: kitchen, mug (true), drink, cup
      1.9: rank 3. Relation: 1.9 beside .95: rank 1.
    - Entities: atLocation is observed 9 times, hasAffordance 7 times. Relations: 1/2 counts twice.

    Weighted: known has one triple, and 3 unique triples touch the cup.

    MRR* compares a rank with that by counts, and leaves out only what was learned of known entities
    and candidates of equal count: living room as tail has rank 6, behind the kitchen.
    """
    vector = insert("ers", k=2, candidates=3)
    theta1 = Embedding(THETA0.entity.clone(), THETA0.relation, DISTMULT)
    theta1.entity[:, CUP] = vector[:, 0]
    observed = torch.zeros(1, len(TRIPLES), dtype=torch.bool)
    observed[0, OBSERVED] = True
    results = evaluate(theta1, query_sets(D1, NOVEL, observed))
    measured = measure_rows(results).assign(size=1, seed=0)
    points = GridPoints("home", GRAPH, 1, [0], SPLITS.numpy(), NOVEL.numpy())
    rows = with_weighted(measured, known_shares([points])).set_index("scope")
    entities = (9 * (1 / 5 + 1 / 3) / 2 + 7 * 1 / 3) / 16
    novel = (entities + (2 * 1 / 2 + 1) / 3) / 2
    assert rows["mrr"]["known"] == pytest.approx((1 / 3 + 1) / 2)
    assert rows["mrr_entity"]["novel"] == pytest.approx(entities)
    assert rows["mrr"]["novel"] == pytest.approx(novel)
    assert rows["mrr"]["weighted"] == pytest.approx(1 / 4 * (1 / 3 + 1) / 2 + 3 / 4 * novel)
    by_counts = (9 * (1 / 6 + 1 / 3) / 2 + 7 * 1 / 3) / 16
    assert rows["mrr_star_entity"]["novel"] == pytest.approx(by_counts)
    assert rows["queries"][["known", "novel", "weighted"]].tolist() == [1, 2, 3]
