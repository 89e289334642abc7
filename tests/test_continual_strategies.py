"""The strategies: which rows move, what a penalty and a share hold, and the chain of snapshots."""

import numpy as np
import pytest
import torch

from isi.continual.api import RunnableTimeline
from isi.continual.chain import Growth, arrived, extended, first_embedding, grow
from isi.continual.strategies import STRATEGIES, Arrival, Schedule
from isi.continual.timeline import Timeline
from isi.errors import InputError
from isi.models.bilinear import ComplEx
from isi.models.losses import LOSSES
from isi.models.stack import Embedding
from isi.training.rows import Recipe

RECIPE = Recipe(loss="softmax", batch_size=4, learning_rate=0.1, n3=0.01)
MARGIN = Recipe(
    loss="margin", batch_size=4, learning_rate=0.05, negatives=3, margin=1.0, unit_length=True
)
#: One for each loss.
RECIPES = {
    loss: MARGIN.model_copy(update={"loss": loss, "unit_length": False}) for loss in LOSSES
} | {"softmax": RECIPE, "margin": MARGIN}


def timeline() -> Timeline:
    """Twelve entities and two relations; then three entities; then a relation."""
    rng = np.random.default_rng(0)

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


def arrival(snapshot: int = 1, recipe: Recipe = RECIPE) -> Arrival:
    grown = timeline()
    before = first_embedding(grown, ComplEx(), 4, schedule(recipe), 0)
    for place in range(1, snapshot):
        before, _ = extended(grown, before, Growth("er_avg"), place, None, 0)
    larger, _ = extended(grown, before, Growth("er_avg"), snapshot, None, 0)
    return arrived(grown, before, larger, schedule(recipe), snapshot, 0)


@pytest.mark.parametrize("recipe", RECIPES.values(), ids=list(RECIPES))
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


@pytest.mark.parametrize("recipe", RECIPES.values(), ids=list(RECIPES))
def test_a_share_weighs_the_part_in_earlier_facts(recipe: Recipe) -> None:
    """Without it, new rows are trained as ``new_rows`` does; with more of it, they score less."""

    def vectors(name: str, **options: float) -> torch.Tensor:
        return STRATEGIES[name](arrival(recipe=recipe), **options).entity

    none, more = (vectors("new_rows_and_earlier", share=share) for share in (0.0, 10.0))
    assert torch.equal(none, vectors("new_rows"))
    assert torch.equal(vectors("new_rows_and_earlier"), vectors("new_rows_and_earlier", share=1.0))
    of = arrival(recipe=recipe)
    head, relation, _ = of.old.T
    first = of.first_new.entity
    scores = [
        of.theta.model.score_tails(
            each[:, head], of.theta.relation[:, relation], each[:, first:]
        ).mean()
        for each in (none, more)
    ]
    assert scores[1] < scores[0]
    both = [vectors("new_rows_then_all", share=share) for share in (0.0, 10.0)]
    assert not torch.equal(*both)


def test_a_negative_share_is_refused() -> None:
    with pytest.raises(InputError, match=r"strategy_options.*share"):
        RunnableTimeline.of([([("cup", "in", "hall")], [], [])]).run(
            strategy_options={"share": -1.0}
        )


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
