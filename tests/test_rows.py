"""The trainer of rows: losses by hand and by PyKEEN, the part in earlier facts by loops, which rows
move and what holds them.
"""

from collections import defaultdict
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from isi.graph.graph import HEAD, RELATION, TAIL
from isi.models.bilinear import ComplEx, DistMult
from isi.models.distance import RotatE, TransE
from isi.models.losses import LOSSES, Loss, TrainingLoss
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.training import rows
from isi.training.rows import (
    Earlier,
    Facts,
    KnownQueries,
    Objective,
    Recipe,
    Tables,
    Task,
    fit,
    known_queries,
)

#: Of entities and relations, of which the last are new.
ENTITIES, RELATIONS, DIMENSION = 9, 4, 6
NEW = 6, 3
FACTS = torch.tensor([[6, 0, 1], [2, 1, 7], [6, 3, 8], [0, 2, 3], [6, 0, 4], [5, 0, 6], [6, 0, 1]])
WEIGHTS = torch.tensor([1.0, 3.0, 0.5, 1.0, 2.0, 1.0, 1.5])
EARLIER = torch.tensor([[0, 0, 1], [0, 0, 2], [3, 1, 4], [5, 2, 1], [5, 2, 3], [5, 2, 4]])


def recipe(loss: Loss, negatives: int | None = 7, **options: Any) -> Recipe:
    margin = 0.0 if loss == "softmax" else 0.6
    settings = {"loss": loss, "negatives": negatives, "margin": margin, "temperature": 0.7}
    return Recipe(**{**settings, "batch_size": 4, "learning_rate": 0.1, **options})


EXACT = recipe("softmax", None)
RECIPES = {
    "softmax": EXACT,
    "softmax of a sample": recipe("softmax"),
    "margin": recipe("margin"),
    "self-adversarial": recipe("self-adversarial"),
    "logistic": recipe("logistic"),
}
every_recipe = pytest.mark.parametrize("name", RECIPES)
every_way = pytest.mark.parametrize("tails_only", [True, False], ids=["tails", "both sides"])


def theta(model: Model | None = None, entities: int = ENTITIES) -> Embedding:
    chosen = model or ComplEx()
    draws = torch.Generator().manual_seed(0)
    entity = torch.randn(1, entities, DIMENSION, generator=draws)
    relation = torch.randn(1, RELATIONS, chosen.width(DIMENSION), generator=draws)
    return Embedding(entity, relation, chosen)


def tables_of(of: Embedding, first: tuple[int, int] = NEW) -> Tables:
    """Tables whose rows are new from the first such entity and relation on."""
    parts = []
    for table, number in zip((of.entity[0], of.relation[0]), first, strict=True):
        parts += [table[:number], table[number:].clone().requires_grad_()]
    return Tables(*parts)


def objective(of: Embedding, task: Task, recipe: Recipe, first: tuple[int, int] = NEW) -> Objective:
    return Objective(of.model, tables_of(of, first), task, recipe)


def loss(of: Embedding, task: Task, recipe: Recipe, first: tuple[int, int] = NEW) -> float:
    place, rng = torch.arange(len(task.facts.triples)), np.random.default_rng(0)
    return objective(of, task, recipe, first).of(place, rng).item()


def fitted(
    of: Embedding, task: Task, recipe: Recipe, epochs: int, first: tuple[int, int] = NEW
) -> Embedding:
    tables = tables_of(of, first)
    fit(of.model, tables, task, recipe, epochs, np.random.default_rng(0))
    entity = torch.cat([tables.fixed_entity, tables.entity.detach()])
    relation = torch.cat([tables.fixed_relation, tables.relation.detach()])
    return Embedding(entity[None], relation[None], of.model)


class ByHand:
    """Scores and losses of an embedding of ComplEx, one by one, in double precision."""

    def __init__(self, of: Embedding, recipe: Recipe) -> None:
        self.recipe = recipe
        self.entity = self.complex_numbers(of.entity[0])
        self.relation = self.complex_numbers(of.relation[0])

    def complex_numbers(self, table: Tensor) -> np.ndarray:
        vectors = table.double().numpy()
        half = DIMENSION // 2
        return vectors[:, :half] + 1j * vectors[:, half:]

    def score(self, triple: list[int]) -> float:
        head, relation, tail = triple
        product = self.entity[head] * self.relation[relation] * self.entity[tail].conj()
        return float(product.real.sum())

    def of_answer(self, triple: list[int], slot: int, answer: int) -> float:
        """The score of the triple with another answer."""
        return self.score([*triple[:slot], answer, *triple[slot + 1 :]])

    def of_fact(self, triple: list[int], slot: int, drawn: list[int] | None) -> float:
        """The loss of a query; by all entities, or by drawn ones."""
        candidates = range(ENTITIES) if drawn is None else drawn
        wrong = [
            self.of_answer(triple, slot, answer) for answer in candidates if answer != triple[slot]
        ]
        right, odds = self.score(triple), 1.0 if drawn is None else ENTITIES / len(drawn)
        if self.recipe.loss == "softmax":
            return float(np.log1p(odds * np.exp(np.array(wrong) - right).sum()))
        shares = np.exp(self.recipe.temperature * np.array(wrong))
        own = 0.0 if self.recipe.loss == "margin" else softplus(-right - self.recipe.margin)
        return own + sum(
            self.of_wrong(right, score, share / shares.sum())
            for score, share in zip(wrong, shares, strict=True)
        )

    def of_wrong(self, right: float, wrong: float, share: float) -> float:
        """What a wrong answer adds; ``share`` is its weight among others, if the loss has one."""
        if self.recipe.loss == "margin":
            assert self.recipe.negatives
            return max(0.0, self.recipe.margin + wrong - right) / self.recipe.negatives
        weight = share if self.recipe.loss == "self-adversarial" else 1.0
        return weight * softplus(wrong + self.recipe.margin)

    def of_earlier(self, slot: int, rng: np.random.Generator) -> float:
        """The sum over earlier facts of what new entities add."""
        answers, facts = defaultdict[tuple[int, ...], list[float]](list), EARLIER.tolist()
        for triple in facts:
            answers[query(triple, slot)].append(self.score(triple))
        number = self.recipe.negatives
        beside = [] if self.recipe.loss == "softmax" else rng.integers(ENTITIES, size=number - 1)
        total = 0.0
        for triple in facts:
            new = [self.of_answer(triple, slot, entity) for entity in range(NEW[0], ENTITIES)]
            if self.recipe.loss == "softmax":
                known = np.exp(answers[query(triple, slot)]).sum()
                total += float(np.log1p(np.exp(new).sum() / known))
                continue
            others = [self.of_answer(triple, slot, entity) for entity in beside]
            rest = np.exp(self.recipe.temperature * np.array(others)).sum()
            for score in new:
                own = np.exp(self.recipe.temperature * score)
                added = self.of_wrong(self.score(triple), score, own / (own + rest))
                total += number / ENTITIES * added
        return total


def query(triple: list[int], slot: int) -> tuple[int, ...]:
    return triple[RELATION], triple[HEAD + TAIL - slot]


def softplus(value: float) -> float:
    return float(np.log1p(np.exp(value)))


def slots(tails_only: bool) -> tuple[int, ...]:
    return (TAIL,) if tails_only else (TAIL, HEAD)


@every_way
@every_recipe
@pytest.mark.parametrize("first", [(1, 1), NEW, (9, 3), (6, 4)])
def test_a_loss_by_hand(name: str, tails_only: bool, first: tuple[int, int]) -> None:
    chosen, of, rng = RECIPES[name], theta(), np.random.default_rng(0)
    by_hand, expected = ByHand(of, chosen), 0.0
    for slot in slots(tails_only):
        drawn = chosen.negatives and rng.integers(ENTITIES, size=chosen.negatives).tolist()
        for triple, weight in zip(FACTS.tolist(), WEIGHTS.tolist(), strict=True):
            expected += weight * by_hand.of_fact(triple, slot, drawn) / WEIGHTS.sum().item()
    task = Task(Facts(FACTS, WEIGHTS), tails_only=tails_only)
    assert loss(of, task, chosen, first) == pytest.approx(expected, rel=1e-5)


@every_way
@every_recipe
def test_the_part_in_earlier_facts_is_a_sum_over_them_and_new_entities(
    name: str, tails_only: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def each(known: KnownQueries, _: np.random.Generator, most: int) -> Tensor:  # noqa: ARG001
        number = known.total.diff(prepend=torch.zeros(1)).long()
        return torch.arange(len(number)).repeat_interleave(number)

    monkeypatch.setattr(KnownQueries, "draw", each)
    chosen, of = RECIPES[name], theta()
    facts, share = Facts(FACTS, WEIGHTS), 0.3
    without = Task(facts, tails_only=tails_only)
    task = Task(facts, Earlier(EARLIER, share), tails_only=tails_only)
    by_hand, rng = ByHand(of, chosen), np.random.default_rng(0)
    for _ in slots(tails_only) if chosen.negatives else ():
        rng.integers(ENTITIES, size=chosen.negatives)  # those of the facts
    total = sum(by_hand.of_earlier(slot, rng) for slot in slots(tails_only))
    expected = share * total / WEIGHTS.sum().item()
    measured = loss(of, task, chosen) - loss(of, without, chosen)
    assert measured == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("earlier", [None, Earlier(EARLIER, 0.0), Earlier(EARLIER[:0])])
def test_no_part_in_earlier_facts(earlier: Earlier | None) -> None:
    assert not objective(theta(), Task(Facts(FACTS, WEIGHTS), earlier), EXACT).known
    task = Task(Facts(FACTS, WEIGHTS), Earlier(EARLIER))
    assert not objective(theta(), task, EXACT, (ENTITIES, 3)).known


@pytest.mark.parametrize("chosen", [EXACT, recipe("margin")], ids=["softmax", "margin"])
def test_earlier_facts_are_drawn_alike(chosen: Recipe) -> None:
    known = known_queries(ComplEx(), tables_of(theta()), EARLIER, TAIL, chosen)
    drawn = torch.cat([known.draw(np.random.default_rng(seed), 100) for seed in range(2000)])
    assert len(drawn) == 2000 * len(known.end)
    of_fact = torch.stack([known.relation, known.end], 1)[drawn]
    for triple in EARLIER.tolist():
        head, relation = triple[HEAD], triple[RELATION]
        same = (EARLIER[:, [RELATION, HEAD]] == torch.tensor([relation, head])).all(1)
        share = (of_fact == torch.tensor([relation, head])).all(1).double().mean().item()
        assert share == pytest.approx(same.double().mean().item(), abs=0.02)


def test_of_many_earlier_facts_a_sample_knows_all_its_answers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rows, "MOST_EARLIER", 2)
    known = known_queries(ComplEx(), tables_of(theta()), EARLIER, TAIL, EXACT)
    by_hand, facts = ByHand(theta(), EXACT), EARLIER.tolist()
    assert known.number == len(facts)
    assert list(zip(known.relation.tolist(), known.end.tolist(), strict=True)) == [(0, 0), (2, 5)]
    for asked, right in zip([(0, 0), (2, 5)], known.right.tolist(), strict=True):
        scores = [by_hand.score(triple) for triple in facts if query(triple, TAIL) == asked]
        assert right == pytest.approx(np.log(np.exp(scores).sum()), rel=1e-5)


@every_way
def test_fixed_answers_that_are_kept_give_the_gradients_of_all_answers(tails_only: bool) -> None:
    facts, place = Facts(FACTS, WEIGHTS), torch.arange(len(FACTS))
    gradients = []
    for first_new in ((1, 1), NEW):
        each = objective(theta(), Task(facts, tails_only=tails_only), EXACT, first_new)
        trained = each.tables.trained
        of_rows = torch.autograd.grad(each.of(place, np.random.default_rng(0)), trained)
        new = zip(of_rows, NEW, (ENTITIES, RELATIONS), strict=True)
        gradients.append([table[first - number :] for table, first, number in new])
    for of_all, of_new in zip(*gradients, strict=True):
        torch.testing.assert_close(of_new, of_all)


def test_a_penalty_is_added() -> None:
    def penalty(tables: Tables) -> Tensor:
        return 2 * tables.entity[1].sum() + tables.relation[0].sum()

    facts = Facts(FACTS, WEIGHTS)
    more = penalty(tables_of(theta())).item()
    assert loss(theta(), Task(facts, penalty=penalty), EXACT) == pytest.approx(
        loss(theta(), Task(facts), EXACT) + more, rel=1e-5
    )


@pytest.mark.parametrize("name", LOSSES)
def test_a_query_whose_drawn_answers_are_all_right_has_a_finite_loss(name: Loss) -> None:
    """Of two entities, the only drawn answer is the right one of one of both facts."""
    of, task = (
        theta(DistMult(), 2),
        Task(Facts(torch.tensor([[0, 1, 1], [1, 0, 0]]), torch.ones(2))),
    )
    assert np.isfinite(loss(of, task, recipe(name, 1), (1, 1)))
    assert torch.isfinite(fitted(of, task, recipe(name, 1), 20, (1, 1)).entity).all()


@pytest.mark.parametrize(
    ("chosen", "theirs", "options", "factor"),
    [
        (TrainingLoss("margin", 0.6), "MarginRankingLoss", {"margin": 0.6}, 1.0),
        (
            TrainingLoss("self-adversarial", 0.6, 0.7),
            "NSSALoss",
            {"margin": 0.6, "adversarial_temperature": 0.7},
            1 / 2,
        ),
        (TrainingLoss("logistic"), "SoftplusLoss", {}, 1 / 9),
    ],
)
def test_losses_are_those_of_pykeen(
    chosen: TrainingLoss, theirs: str, options: dict[str, float], factor: float
) -> None:
    losses = pytest.importorskip("pykeen.losses")
    draws = torch.Generator().manual_seed(0)
    right, wrong = (
        torch.randn(5, 1, generator=draws, requires_grad=True),
        torch.randn(5, 8, generator=draws, requires_grad=True),
    )
    expected = getattr(losses, theirs)(**options).process_slcwa_scores(right, wrong)
    ours = chosen.of_right(right[:, 0]) + chosen.of_wrong(right[:, 0], wrong).sum(1)
    measured = factor * ours.mean()
    assert measured.item() == pytest.approx(expected.item(), rel=1e-5)
    by_each = [torch.autograd.grad(each, (right, wrong)) for each in (measured, expected)]
    for own, other in zip(*by_each, strict=True):
        torch.testing.assert_close(own, other)


@every_recipe
def test_rows_that_stay_are_the_same_numbers(name: str) -> None:
    of, chosen = theta(), RECIPES[name]
    task, (entity, relation) = Task(Facts(FACTS, WEIGHTS), Earlier(EARLIER), tails_only=False), NEW
    trained = fitted(of, task, chosen, 2)
    assert torch.equal(trained.entity[:, :entity], of.entity[:, :entity])
    assert torch.equal(trained.relation[:, :relation], of.relation[:, :relation])
    assert (trained.entity != of.entity)[:, entity:].any(-1).all()
    assert (trained.relation != of.relation)[:, relation:].any(-1).all()
    assert torch.equal(trained.entity, fitted(of, task, chosen, 2).entity)


@pytest.mark.parametrize(
    "model",
    [TransE(margin=2.0, constraint="sphere"), RotatE(margin=2.0, constraint="ball")],
    ids=["sphere", "ball"],
)
def test_trained_entities_keep_the_constraint_of_the_model(model: Model) -> None:
    of, (first, _) = theta(model), NEW
    trained = fitted(of, Task(Facts(FACTS, WEIGHTS)), EXACT, 2)
    vectors = trained.entity[:, first:]
    torch.testing.assert_close(vectors, model.constrain(vectors))
    assert torch.equal(trained.entity[:, :first], of.entity[:, :first])
    assert not torch.equal(vectors, of.entity[:, first:])


@every_recipe
def test_training_lowers_the_loss_of_its_facts(name: str) -> None:
    of, task = theta(), Task(Facts(FACTS, WEIGHTS))
    after = fitted(of, task, RECIPES[name], 20, (1, 1))
    assert loss(after, task, RECIPES[name]) < 0.8 * loss(of, task, RECIPES[name])


def test_the_step_is_that_of_pytorchs_adagrad() -> None:
    of, task, settings = (
        theta(),
        Task(Facts(FACTS, WEIGHTS)),
        recipe("softmax", batch_size=len(FACTS)),
    )
    tables, other = tables_of(of), tables_of(of)
    fit(of.model, tables, task, settings, 3, np.random.default_rng(0))
    optimizer, rng = (
        torch.optim.Adagrad(other.trained, lr=settings.learning_rate),
        np.random.default_rng(0),
    )
    loss = Objective(of.model, other, task, settings)
    for _ in range(3):
        for place in loss.batches(rng):
            optimizer.zero_grad()
            loss.of(place, rng).backward()  # type: ignore[no-untyped-call]
            optimizer.step()
    assert torch.equal(tables.entity, other.entity)
    assert torch.equal(tables.relation, other.relation)


@pytest.mark.parametrize("model", [ComplEx(), DistMult()])
def test_n3_is_the_mean_of_the_cubes_of_the_facts_in_a_batch(model: Model) -> None:
    of = theta(model)
    task = Task(Facts(FACTS, WEIGHTS))
    added = loss(of, task, recipe("softmax", None, n3=0.5)) - loss(of, task, EXACT)
    expected = 0.0
    for (head, relation, tail), weight in zip(FACTS.tolist(), WEIGHTS.tolist(), strict=True):
        for row in (of.entity[0, head], of.relation[0, relation], of.entity[0, tail]):
            numbers = row.double().numpy()
            if isinstance(model, ComplEx):
                numbers = numbers[:3] + 1j * numbers[3:]
            expected += 0.5 * weight * (np.abs(numbers) ** 3).sum() / WEIGHTS.sum().item()
    assert added == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("settings", [EXACT, recipe("softmax"), recipe("logistic")])
def test_all_rows_may_be_new(settings: Recipe) -> None:
    """The loss is that of a part of the rows, whichever that part is."""
    of, task = theta(), Task(Facts(FACTS, WEIGHTS), tails_only=False)
    of_all = loss(of, task, settings, (0, 0))
    assert of_all == pytest.approx(loss(of, task, settings), rel=1e-5)
    assert of_all == pytest.approx(loss(of, task, settings, (ENTITIES, RELATIONS)), rel=1e-5)
