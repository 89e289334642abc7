"""Training by queries and the strategies: losses by hand, which rows move, what a penalty holds."""

from typing import Any

import numpy as np
import pytest
import torch

import isi
from isi.continual.chain import Growth, arrived, extended, first_embedding, grow
from isi.continual.strategies import STRATEGIES, Arrival, Schedule, unpacked
from isi.continual.timeline import Timeline
from isi.continual.training import Facts, Moving, Recipe, Tables, Task, cubed, fit, loss_of
from isi.errors import InputError
from isi.insertion.inverses import unpack
from isi.models.bilinear import ComplEx, DistMult
from isi.models.distance import TransE
from isi.models.stack import Embedding

RECIPE = Recipe(loss="softmax", batch_size=4, learning_rate=0.1, n3=0.01)
MARGIN = Recipe(
    loss="margin", batch_size=4, learning_rate=0.05, negatives=3, margin=1.0, unit_length=True
)


def timeline(seed: int = 0) -> Timeline:
    """Twelve entities and two relations; then three entities; then a relation."""
    rng = np.random.default_rng(seed)

    def triples(number: int, entities: int, relations: int) -> list[tuple[str, str, str]]:
        head, tail = rng.integers(entities, size=(2, number))
        relation = rng.integers(relations, size=number)
        ids = zip(head.tolist(), relation.tolist(), tail.tolist(), strict=True)
        return [(f"e{h}", f"r{r}", f"e{t}") for h, r, t in ids]

    chain = [(f"e{i}", "r0", f"e{(i + 1) % 12}") for i in range(12)]
    first = [*chain, *triples(20, 12, 2)]
    second = [(f"e{12 + i}", "r1", f"e{i}") for i in range(3)] + triples(6, 15, 2)
    third = [("e1", "r2", "e2"), ("e3", "r2", "e4")]
    return Timeline.of([(first, [], triples(5, 12, 2)), (second, [], []), (third, [], [])])


def schedule(recipe: Recipe = RECIPE, base_epochs: int = 3) -> Schedule:
    return Schedule(recipe, base_epochs, epochs=2, half_range=0.3)


def theta(model: Any, entities: int = 5, relations: int = 4, dimension: int = 4) -> Embedding:
    tables = torch.Generator().manual_seed(0)
    entity = torch.randn(1, entities, dimension, generator=tables)
    relation = torch.randn(1, relations, model.width(dimension), generator=tables)
    return Embedding(entity, relation, model)


def arrival(snapshot: int = 1, recipe: Recipe = RECIPE) -> Arrival:
    grown = timeline()
    before = first_embedding(grown, ComplEx(), 4, schedule(recipe), 0)
    for place in range(1, snapshot):
        before, _ = extended(grown, before, Growth("er_avg"), place, None, 0)
    larger, _ = extended(grown, before, Growth("er_avg"), snapshot, None, 0)
    return arrived(grown, before, larger, schedule(recipe), snapshot, 0)


def loss(of: Embedding, task: Task, recipe: Recipe, seed: int = 0) -> float:
    place, rng = torch.arange(len(task.facts.triples)), np.random.default_rng(seed)
    tables = Tables.of(of, task.moving)
    return loss_of(of.model, tables, task, recipe, place, rng).item()


def test_cross_entropy_by_hand() -> None:
    of, triples = theta(DistMult()), torch.tensor([[0, 1, 2], [3, 0, 4]])
    entity, relation = of.entity[0].double().numpy(), of.relation[0].double().numpy()
    expected, weights = 0.0, [1.0, 3.0]
    for (head, kind, tail), weight in zip(triples.tolist(), weights, strict=True):
        scores = entity @ (entity[head] * relation[kind])
        expected += weight * (np.log(np.exp(scores).sum()) - scores[tail]) / sum(weights)
    facts = Facts(triples, torch.tensor(weights))
    assert loss(of, Task(facts), RECIPE.model_copy(update={"n3": 0.0})) == pytest.approx(expected)
    cubes = [np.abs(entity[[0, 3, 2, 4]]) ** 3, np.abs(relation[[1, 0]]) ** 3]
    expected += 0.01 * sum(cube.sum() for cube in cubes) / 2
    assert loss(of, Task(facts), RECIPE) == pytest.approx(expected)


def test_cubes_are_of_moduli_of_complex_numbers() -> None:
    vectors = theta(ComplEx()).entity[0]
    half = vectors.shape[1] // 2
    complex_numbers = torch.complex(vectors[:, :half], vectors[:, half:])
    assert cubed(ComplEx(), vectors).item() == pytest.approx(
        complex_numbers.abs().pow(3).sum().item()
    )


def test_all_entities_as_drawn_answers_are_cross_entropy_nearly() -> None:
    of, triples = theta(DistMult(), 200), torch.tensor([[0, 1, 2]])
    facts = Facts(triples, torch.ones(1))
    exact = RECIPE.model_copy(update={"n3": 0.0})
    drawn = exact.model_copy(update={"negatives": 20_000})
    assert loss(of, Task(facts), drawn) == pytest.approx(loss(of, Task(facts), exact), abs=0.05)


def test_a_margin_by_hand() -> None:
    of, triples = theta(TransE(margin=0.0, squared=True)), torch.tensor([[0, 1, 2]])
    recipe = MARGIN.model_copy(update={"unit_length": False})
    entity, relation = of.entity[0].numpy(), of.relation[0].numpy()
    drawn = np.random.default_rng(0).integers(5, size=3)
    place = entity[0] + relation[1]
    far = ((place - entity[2]) ** 2).sum()
    each = [
        0.0 if wrong == 2 else max(0.0, 1.0 - ((place - entity[wrong]) ** 2).sum() + far)
        for wrong in drawn
    ]
    measured = loss(of, Task(Facts(triples, torch.ones(1))), recipe)
    assert measured == pytest.approx(float(np.mean(each)), rel=1e-5)


def test_drawn_answers_change_their_own_rows_alone() -> None:
    of, triples = theta(DistMult(), 50), torch.tensor([[0, 1, 2]])
    recipe = RECIPE.model_copy(update={"negatives": 4, "n3": 0.0})
    trained = fit(of, Task(Facts(triples, torch.ones(1))), recipe, 1, root=0)
    moved = (trained.entity != of.entity).any(-1).sum()
    assert 2 <= moved <= 6


def test_the_part_in_earlier_facts_by_hand() -> None:
    of = arrival()
    queries, earlier = of.earlier.queries, of.earlier
    facts = Facts(of.new, torch.ones(len(of.new)))
    without = loss(of.theta, Task(facts, of.first_new), RECIPE)
    assert earlier.number == len(of.old)
    measured = [
        loss(of.theta, Task(facts, of.first_new, earlier), RECIPE, seed) - without
        for seed in range(20)
    ]
    new = of.theta.entity[0, of.first_new.entity :].double().numpy()
    total, count = 0.0, queries.answers[0].numpy()
    for place in range(len(queries.given)):
        head = of.theta.entity[:, queries.given[place]]
        relation = of.theta.relation[:, queries.relation[place]]
        mapped = of.theta.model.transform(head, relation)[0].double().numpy()
        odds = np.log(np.exp(new @ mapped).sum()) - queries.log_z[0, place].item()
        total += count[place] * np.log1p(np.exp(odds))
    expected = total / count.sum() * len(of.old) / len(of.new)
    assert np.mean(measured) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("recipe", [RECIPE, MARGIN], ids=["softmax", "margin"])
@pytest.mark.parametrize("name", STRATEGIES)
def test_a_strategy_moves_what_it_says(name: str, recipe: Recipe) -> None:
    of = arrival(recipe=recipe)
    trained = STRATEGIES[name](of)
    first = of.first_new.entity
    assert trained.entity.shape == of.theta.entity.shape
    assert torch.isfinite(trained.entity).all()
    is_frozen = name in {"insert", "new_rows", "new_rows_and_earlier"}
    # with ``unit_length``, frozen rows are divided by their length once more
    same = torch.allclose(trained.entity[:, :first], of.theta.entity[:, :first], atol=1e-6)
    assert same == is_frozen
    moved = not torch.equal(trained.entity[:, first:], of.theta.entity[:, first:])
    assert moved == (name != "insert")
    again = STRATEGIES[name](arrival(recipe=recipe))
    assert torch.equal(trained.entity, again.entity)


@pytest.mark.parametrize("name", ["l2", "ewc"])
def test_a_penalty_holds_earlier_rows(name: str) -> None:
    of = arrival()
    first = of.first_new.entity

    def moved(trained: Embedding) -> float:
        return (trained.entity - of.theta.entity)[:, :first].abs().sum().item()

    free, held = STRATEGIES["finetune"](of), STRATEGIES[name](of, weight=1000.0)
    assert moved(held) < moved(free) / 2


def test_only_new_relations_move_with_a_snapshot_without_new_entities() -> None:
    of = arrival(snapshot=2)
    trained = STRATEGIES["new_rows"](of)
    assert torch.equal(trained.entity, of.theta.entity)
    first = of.first_new.relation
    assert torch.equal(trained.relation[:, :first], of.theta.relation[:, :first])
    assert not torch.equal(trained.relation[:, first:], of.theta.relation[:, first:])


def test_a_chain_has_the_rows_of_each_snapshot_before_and_after_training() -> None:
    grown = timeline()
    first = first_embedding(grown, ComplEx(), 4, schedule(), 0)
    chain = list(grow(grown, first, Growth("er_avg", strategy="new_rows"), schedule()))
    phases = [(each.snapshot, each.phase) for each in chain]
    assert phases == [(1, "inserted"), (1, "trained"), (2, "inserted"), (2, "trained")]
    for each in chain:
        assert each.theta.entity.shape[1] == grown.entities[each.snapshot]
        assert each.theta.relation.shape[1] == grown.relations[each.snapshot]
    begun = [each for each in chain if each.snapshot == 1][-1]
    rest = list(
        grow(grown, begun.theta, Growth("er_avg", strategy="new_rows"), schedule(), start=2)
    )
    assert torch.equal(rest[-1].theta.relation, chain[-1].theta.relation)


def test_training_lowers_the_loss_of_its_facts() -> None:
    grown = timeline()
    facts = Facts(unpacked(grown.snapshots[0].train), torch.ones(2 * len(grown.snapshots[0].train)))
    few, many = (
        unpack(first_embedding(grown, ComplEx(), 4, schedule(base_epochs=epochs), 0))
        for epochs in (1, 20)
    )
    assert loss(many, Task(facts), RECIPE) < loss(few, Task(facts), RECIPE) - 0.2


def test_an_unknown_strategy_is_named() -> None:
    grown = timeline()
    first = first_embedding(grown, ComplEx(), 4, schedule(), 0)
    with pytest.raises(InputError, match=r"strategy.*new_rows"):
        list(grow(grown, first, Growth("er_avg", strategy="newrows"), schedule()))


def test_fixed_rows_stay_the_same_bytes() -> None:
    of = theta(DistMult(), 8)
    facts = Facts(torch.tensor([[6, 1, 2], [3, 0, 7]]), torch.ones(2))
    trained = fit(of, Task(facts, Moving(6, 4)), RECIPE, 2, root=0)
    assert torch.equal(trained.entity[:, :6], of.entity[:, :6])
    assert torch.equal(trained.relation, of.relation)
    assert not torch.equal(trained.entity[:, 6:], of.entity[:, 6:])


def test_a_margin_without_negatives_is_refused_wherever_it_is_given() -> None:
    with pytest.raises(InputError, match=r"training.*negatives"):
        isi.Timeline.of([([("cup", "in", "hall")], [], [])]).run(training={"loss": "margin"})
