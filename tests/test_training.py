"""Gradients, negatives, batches, Adagrad, and models that come and go in a stack."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import logsigmoid

from isi import lessons, ranking, training
from isi.embeddings.stack import Embedding, select, uniform
from isi.experiments.cells import Cells
from isi.lessons import Lesson, Lists, Tables
from isi.params import Negatives, Optimizer, Training
from isi.sessions import OUT, TRAIN, Session, joint_session
from tests.graphs import cells_of, dense, graph_of, random_embedding, random_graph

SAMPLED = Negatives(mode="sampled", ratio=3, head_pool="unseen")
EXPECTED = Negatives(mode="expected", ratio=3, head_pool="unseen")
TUNING = Optimizer(batch_size=50, learning_rate=0.05, weight_decay=1e-3, max_epochs=6)


def loss(entity: Tensor, relation: Tensor, positives: Tensor, negatives: Tensor) -> Tensor:
    """Σ -log σ(y · f), written out."""
    maps = torch.stack([torch.stack([dense(row) for row in model]) for model in relation])
    scores = torch.einsum("mhd,mrde,mte->mrht", entity, maps, entity)
    return -(positives * logsigmoid(scores) + negatives * logsigmoid(-scores)).sum()


def one_triple_lesson(head_pool: str, count: int = 2, relations: int = 2, entities: int = 4) -> Lesson:
    """Trains on (0, 0, 1) alone; entity 3 takes no part."""
    graph = graph_of({(0, 0, 1): count, (2, 0, 3): 5}, entities, relations)
    members = torch.tensor([[number != 3 for number in range(entities)]])
    session = Session(graph, members, torch.tensor([[TRAIN, OUT]], dtype=torch.int8))
    return lessons.lesson(session, "test", torch.tensor([[1, 0]]), head_pool)


def observations(lesson: Lesson) -> list[np.ndarray]:
    """All training observations of each model, as one batch."""
    return [np.repeat(np.arange(len(counts)), counts) for counts in lesson.counts.numpy()]


def sampled(lesson: Lesson, ratio: int, root: int, epoch: int) -> Tensor:
    """Corrupted triples of all observations as one batch; shape (M, 1, R, E, E)."""
    lists = lessons.as_lists(lesson, observations(lesson), ratio, root, epoch, 0)
    return lessons.count_negatives(lesson, lists)[:, None]


def dealt_counts(lesson: Lesson, root: int, epoch: int, size: int) -> Tensor:
    """How often each triple stands in each batch; shape (M, B, T)."""
    dealt = lessons.deal(lesson, root, epoch, size)
    return torch.stack([torch.stack([torch.bincount(torch.as_tensor(one, dtype=torch.int64),
                        minlength=lesson.counts.shape[1]) for one in batch]) for batch in dealt], 1)  # fmt: skip


def small_cells(seeds: list[int] | None = None) -> Cells:
    return cells_of(random_graph(13, 3, 80), 2, seeds or [0, 1, 2, 3])


def start_of(cells: Cells, half_range: float = 0.5) -> Embedding:
    return uniform(cells.initial.entities, 3, 12, half_range, 0, cells.keys)


def same(one: Embedding, other: Embedding) -> bool:
    return torch.equal(one.entity, other.entity) and torch.equal(one.relation, other.relation)


def test_loss_gradient_is_that_of_autograd() -> None:
    embedding = random_embedding(2, 4, 3, 8)
    entity, relation = (table.double().requires_grad_() for table in (embedding.entity, embedding.relation))
    generator = torch.Generator().manual_seed(3)
    positives, negatives = (torch.randint(4, (2, 3, 4, 4), generator=generator).double() for _ in range(2))
    by_entity, by_relation = torch.autograd.grad(loss(entity, relation, positives, negatives), (entity, relation))
    found = training.loss_gradient(Embedding(entity.detach(), relation.detach()), Tables(positives, negatives))
    torch.testing.assert_close(found.entity, by_entity)
    torch.testing.assert_close(found.relation, by_relation)


def test_adagrad_is_that_of_torch() -> None:
    begin = random_embedding(1, 5, 2, 8)
    state = training.start(begin)
    tables = [table.clone().requires_grad_() for table in (begin.entity, begin.relation)]
    optimizer = torch.optim.Adagrad(tables, lr=0.1, weight_decay=1e-3, initial_accumulator_value=1e-6, eps=0.0)
    settings = Optimizer(batch_size=1, learning_rate=0.1, weight_decay=1e-3, max_epochs=1)
    generator = torch.Generator().manual_seed(5)
    for _ in range(6):
        positives, negatives = (torch.randint(3, (1, 2, 5, 5), generator=generator).float() for _ in range(2))
        optimizer.zero_grad()
        (loss(*tables, positives, negatives) / positives.sum()).backward()
        optimizer.step()
        gradient = training.loss_gradient(state.embedding, Tables(positives, negatives))
        number = positives.sum((1, 2, 3)).long()
        training.adagrad(state, gradient, number, torch.zeros(1, 5, dtype=torch.bool), settings)
    for found, expected in zip((state.embedding.entity, state.embedding.relation), tables, strict=True):
        torch.testing.assert_close(found, expected.detach(), rtol=1e-4, atol=1e-5)
    assert not torch.allclose(state.embedding.entity, begin.entity, atol=0.1)


def test_start_copies_so_that_training_leaves_its_origin_alone() -> None:
    cells = small_cells([0])
    begin = start_of(cells)
    before = begin.entity.clone(), begin.relation.clone()
    state = training.start(begin)
    training.run_epoch(state, lessons.lesson(cells.initial, "test", cells.keys, "all"), EXPECTED, TUNING, 0, 1)
    assert same(begin, Embedding(*before))
    assert not same(state.embedding, begin)


def test_expected_negatives_by_hand() -> None:
    lesson = one_triple_lesson("unseen")
    found = lessons.expected_negatives(lesson, lessons.place(lesson, observations(lesson)), 9)[0]
    # 2 observations × 9: 18 tails over the entities 0 to 2, 18 heads over those never a head (1, 2), 18 of relation 1
    expected = torch.zeros(2, 4, 4)
    expected[0, 0, :3] = 6
    expected[0, 1:3, 1] = 9
    expected[1, 0, 1] = 18
    torch.testing.assert_close(found, expected)


def test_heads_come_from_everyone_where_asked_or_where_the_pool_is_empty() -> None:
    everyone = torch.tensor([1.0, 1, 1, 0])
    assert torch.equal(one_triple_lesson("all").heads, everyone.expand(1, 2, 4))
    unseen = one_triple_lesson("unseen").heads[0]
    assert torch.equal(unseen, torch.stack([torch.tensor([0.0, 1, 1, 0]), everyone]))
    graph = graph_of({(0, 0, 1): 1, (1, 0, 2): 1, (2, 0, 0): 1}, 3, 1)
    lesson = lessons.lesson(
        joint_session(graph, torch.zeros(1, 3, dtype=torch.int8)), "test", torch.tensor([[0, 0]]), "unseen"
    )
    assert torch.equal(lesson.heads, torch.ones(1, 1, 3))


@pytest.mark.parametrize("head_pool", ["unseen", "all"])
def test_expected_negatives_are_the_mean_of_sampled_ones(head_pool: str) -> None:
    cells, draws, ratio = cells_of(random_graph(6, 3, 20), 1, [0, 1]), 600, 4
    lesson = lessons.lesson(cells.initial, "test", cells.keys, head_pool)
    expected = lessons.expected_negatives(lesson, lessons.place(lesson, observations(lesson)), ratio)
    total = torch.zeros_like(expected)
    for epoch in range(draws):
        total += sampled(lesson, ratio, 0, epoch)[:, 0]
    assert (total[expected == 0] == 0).all()
    assert ((total / draws - expected).abs() <= 5 * (expected / draws).sqrt() + 1e-4).all()


def test_sampled_negatives_are_ratio_times_positives_of_each_kind() -> None:
    lesson = one_triple_lesson("unseen", count=7, relations=3)
    drawn = sampled(lesson, 9, 0, 1)[0, 0]
    heads = drawn[0, :, 1].clone()
    heads[0] = 0  # 0 is a head of relation 0 and not in its pool: a corrupted tail
    assert drawn[0, 0].sum() == 63
    assert heads.sum() == 63
    assert drawn[1:, 0, 1].sum() == 63
    assert drawn.sum() == 3 * 63
    assert (drawn[1:, 0, 1] > 0).all()


def test_sampled_negatives_stay_in_the_session_and_with_their_batch() -> None:
    cells = small_cells()
    lesson = lessons.lesson(cells.initial, "test", cells.keys, "unseen")
    for number, dealt in enumerate(lessons.deal(lesson, 0, 1, 30)):
        drawn = lessons.count_negatives(lesson, lessons.as_lists(lesson, dealt, 3, 0, 1, number))
        assert drawn.sum((1, 2, 3)).tolist() == [9 * len(one) for one in dealt]
        for model in range(4):
            outside = ~lesson.session.entities[model]
            assert drawn[model][..., outside, :].sum() == 0
            assert drawn[model][..., outside].sum() == 0


def test_true_relation_is_never_a_corrupted_one() -> None:
    lesson = one_triple_lesson("unseen", count=50, relations=2, entities=5)
    drawn = sampled(lesson, 9, 0, 1)[0, 0]
    assert drawn[1, 0, 1] == 450
    assert drawn[1].sum() == 450


def test_a_lone_relation_is_not_corrupted() -> None:
    lesson = one_triple_lesson("unseen", count=5, relations=1)
    assert sampled(lesson, 9, 0, 1).sum() == 2 * 45
    assert lessons.expected_negatives(lesson, lessons.place(lesson, observations(lesson)), 9).sum() == pytest.approx(90)


def test_many_negatives_on_one_triple_do_not_overflow() -> None:
    lesson = one_triple_lesson("unseen", count=5000)
    drawn = sampled(lesson, 9, 0, 1)
    assert drawn[0, 0, 1, 0, 1].item() == 45_000


def test_negatives_are_keyed_by_model_purpose_and_epoch() -> None:
    cells = small_cells()
    lesson = lessons.lesson(cells.initial, "test", cells.keys, "unseen")
    drawn = {(root, epoch): sampled(lesson, 3, root, epoch) for root in (0, 1) for epoch in (1, 2)}
    assert torch.equal(drawn[0, 1], sampled(lesson, 3, 0, 1))
    assert not torch.equal(drawn[0, 1], drawn[0, 2])
    assert not torch.equal(drawn[0, 1], drawn[1, 1])
    other = replace(lesson, keys=lesson.keys + torch.tensor([1, 0]))
    assert not torch.equal(drawn[0, 1], sampled(other, 3, 0, 1))
    assert not torch.equal(drawn[0, 1], sampled(replace(lesson, purpose="other"), 3, 0, 1))
    assert torch.equal(drawn[0, 1][2:3], sampled(select(lesson, torch.tensor([2])), 3, 0, 1))


def test_a_batch_has_the_same_gradient_as_lists_and_as_tables() -> None:
    cells = small_cells()
    lesson, embedding = lessons.lesson(cells.initial, "test", cells.keys, "unseen"), start_of(cells)
    dealt = lessons.deal(lesson, 0, 1, 40)[1]
    lists = lessons.as_lists(lesson, dealt, 3, 0, 1, 1)
    assert isinstance(lists, Lists)
    tables = Tables(lessons.place(lesson, dealt), lessons.count_negatives(lesson, lists))
    one, other = (training.loss_gradient(embedding, batch) for batch in (lists, tables))
    torch.testing.assert_close(one.entity, other.entity, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(one.relation, other.relation, rtol=1e-4, atol=1e-5)
    assert one.entity.abs().max() > 0.1


def test_a_graph_too_large_for_tables_learns_the_same_from_lists(monkeypatch: pytest.MonkeyPatch) -> None:
    cells = small_cells()
    lesson = lessons.lesson(cells.initial, "test", cells.keys, "unseen")
    small, large = training.start(start_of(cells)), training.start(start_of(cells))
    training.run_epoch(small, lesson, SAMPLED, TUNING, 0, 1)
    monkeypatch.setattr(lessons, "TABLE_CELLS", 0)
    assert all(isinstance(batch, Lists) for batch, _ in lessons.batches(lesson, EXPECTED, TUNING, 0, 1))
    training.run_epoch(large, lesson, SAMPLED, TUNING, 0, 1)
    torch.testing.assert_close(large.embedding.entity, small.embedding.entity, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("size", [1, 7, 30, 10_000])
def test_batches_hold_each_observation_once_and_are_even(size: int) -> None:
    cells = small_cells()
    lesson = lessons.lesson(cells.initial, "test", cells.keys, "all")
    dealt = dealt_counts(lesson, 0, 1, size)
    assert torch.equal(dealt.sum(1), lesson.counts)
    for model in range(4):
        lengths = dealt[model].sum(1)
        used = lengths[lengths > 0]
        assert used.max() <= size
        assert used.max() - used.min() <= 1
        assert len(used) == -(-int(lesson.counts[model].sum()) // size)
        assert (lengths[: len(used)] > 0).all()


def test_batches_are_keyed_by_model_and_epoch() -> None:
    cells = small_cells()
    lesson = lessons.lesson(cells.initial, "test", cells.keys, "all")
    dealt = dealt_counts(lesson, 0, 1, 10)
    assert torch.equal(dealt, dealt_counts(lesson, 0, 1, 10))
    assert not torch.equal(dealt, dealt_counts(lesson, 0, 2, 10))
    assert not torch.equal(dealt, dealt_counts(lesson, 1, 1, 10))
    other = replace(lesson, keys=lesson.keys + torch.tensor([1, 0]))
    assert not torch.equal(dealt, dealt_counts(other, 0, 1, 10))
    alone = dealt_counts(select(lesson, torch.tensor([3])), 0, 1, 10)
    assert torch.equal(dealt[3:, : alone.shape[1]], alone)


@pytest.mark.parametrize("negatives", [SAMPLED, EXPECTED], ids=["sampled", "expected"])
def test_entities_outside_the_session_stay_zero(negatives: Negatives) -> None:
    cells = small_cells()
    state, members = training.start(start_of(cells)), cells.initial.entities
    lesson = lessons.lesson(cells.initial, "test", cells.keys, "unseen")
    before = state.embedding.entity.clone()
    for epoch in (1, 2):
        training.run_epoch(state, lesson, negatives, TUNING, 0, epoch)
    assert (state.embedding.entity[~members] == 0).all()
    assert (state.embedding.entity != before)[members].all()


def test_weight_decay_acts_on_all_rows_of_the_session() -> None:
    graph = graph_of({(0, 0, 1): 1, (2, 1, 3): 1}, 4, 2)  # 2 and 3 have no training triple
    session = joint_session(graph, torch.tensor([[TRAIN, OUT]], dtype=torch.int8))
    state = training.start(random_embedding(1, 4, 2, 8))
    before = state.embedding.entity.clone()
    nothing = Embedding(torch.zeros(1, 4, 8), torch.zeros(1, 2, 8))
    settings = Optimizer(batch_size=1, learning_rate=1e-4, weight_decay=0.5, max_epochs=1)
    training.adagrad(state, nothing, torch.tensor([1]), ~session.entities, settings)
    assert (state.embedding.entity.abs() < before.abs()).all()


FITTING = Training(
    batch_size=60, learning_rate=0.1, weight_decay=1e-3, max_epochs=30, evaluate_every=2, patience=2
)  # fmt: skip


def fitted(seeds: list[int], settings: Training = FITTING) -> tuple[Embedding, list[training.Look]]:
    cells = small_cells(seeds)
    lesson = lessons.lesson(cells.initial, "test", cells.keys, "unseen")
    valid = ranking.validation(cells.initial)["valid"]
    return training.fit(start_of(cells, 0.01), lesson, valid, SAMPLED, settings, 0)


def looks_of(model: int, looks: list[training.Look]) -> list[tuple[int, float, bool]]:
    """Epoch, MRR* and whether it was kept, of one model."""
    rows = []
    for look in looks:
        for place in torch.nonzero(look.models == model).flatten().tolist():
            rows.append((look.epoch, look.measures[place, 0].item(), bool(look.kept[place])))
    return rows


def test_fit_keeps_the_best_and_respects_patience() -> None:
    best, looks = fitted([0, 1, 2, 3])
    cells = small_cells()
    reached = ranking.evaluate(best, ranking.validation(cells.initial))["valid"].measures[:, 0]
    lengths = set()
    for model in range(4):
        rows = looks_of(model, looks)
        scores = [score for _, score, _ in rows]
        assert [epoch for epoch, _, _ in rows] == [2 * (number + 1) for number in range(len(rows))]
        assert [kept for _, _, kept in rows] == [s > max([-1, *scores[:n]]) for n, s in enumerate(scores)]
        assert reached[model].item() == max(scores)
        since_best = len(scores) - 1 - scores.index(max(scores))
        assert since_best == FITTING.patience or rows[-1][0] == FITTING.max_epochs
        gaps = np.diff([n for n, (_, _, kept) in enumerate(rows) if kept])
        assert (gaps <= FITTING.patience).all()
        lengths.add(len(rows))
    assert len(lengths) > 1  # or nobody left the stack early


def test_fit_looks_at_the_last_epoch_too() -> None:
    settings = FITTING.model_copy(update={"max_epochs": 5, "evaluate_every": 3})
    _, looks = fitted([0], settings)
    assert [look.epoch for look in looks] == [3, 5]


def test_a_plateau_is_no_better_one() -> None:
    _, looks = fitted([0], FITTING.model_copy(update={"learning_rate": 1e-12}))
    assert len({score for _, score, _ in looks_of(0, looks)}) == 1
    assert [kept for _, _, kept in looks_of(0, looks)] == [True, *[False] * FITTING.patience]


@pytest.fixture(params=["tables", "lists"])
def form(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Batches in either form."""
    if request.param == "lists":
        monkeypatch.setattr(lessons, "TABLE_CELLS", 0)


@pytest.mark.usefixtures("form")
def test_fit_in_a_stack_is_fit_alone() -> None:
    together, looks = fitted([0, 1, 2, 3])
    for model in range(4):
        alone, own = fitted([model])
        assert same(select(together, torch.tensor([model])), alone)
        assert looks_of(model, looks) == looks_of(0, own)


def tuned(seeds: list[int], targets: dict[str, Tensor], to_the_end: bool = False) -> list[training.Followed]:
    cells = small_cells(seeds)
    return training.fine_tune(
        start_of(cells),
        lessons.lesson(cells.joint, "test", cells.keys, "unseen"),
        ranking.epoch_scopes(cells.joint, torch.from_numpy(cells.novel)),
        targets,
        SAMPLED,
        TUNING,
        0,
        to_the_end,
    )


def series(followed: list[training.Followed], model: int, scope: str) -> list[list[float]]:
    """Measures of one model by epoch."""
    found = []
    for step in followed:
        for place in torch.nonzero(step.models == model).flatten().tolist():
            found.append(step.results[scope].measures[place].tolist())
    return found


def test_fine_tuning_stops_for_each_model_once_it_has_converged_everywhere() -> None:
    nowhere = {"all": torch.full((4,), torch.nan), "novel_heldout": torch.full((4,), torch.nan)}
    full = tuned([0, 1, 2, 3], nowhere, to_the_end=True)
    assert [step.epoch for step in full] == list(range(TUNING.max_epochs + 1))
    assert all(len(step.models) == 4 for step in full)
    every = {scope: [[row[0] for row in series(full, model, scope)] for model in range(4)] for scope in nowhere}
    # model 0 is there at once, 1 is not asked, 2 never gets there, 3 does on its way in both scopes
    late = [max(every[scope][3][1:]) for scope in ("all", "novel_heldout")]
    targets = {
        "all": torch.tensor([-1.0, torch.nan, 2.0, late[0]], dtype=torch.float64),
        "novel_heldout": torch.tensor([-1.0, torch.nan, -1.0, late[1]], dtype=torch.float64),
    }
    last = max(
        next(epoch for epoch, value in enumerate(every[scope][3]) if value >= target)
        for scope, target in zip(("all", "novel_heldout"), late, strict=True)
    )
    followed = tuned([0, 1, 2, 3], targets)
    for model, epochs in enumerate([0, 0, TUNING.max_epochs, last]):
        for scope in targets:
            assert [row[0] for row in series(followed, model, scope)] == every[scope][model][: epochs + 1]


def test_fine_tuning_in_a_stack_is_fine_tuning_alone() -> None:
    scopes = ("all", "known", "known_closed", "novel_heldout")
    goals = [0.1, 0.45, 0.55, 2.0]
    targets = {"all": torch.tensor(goals), "novel_heldout": torch.full((4,), torch.nan)}
    together = tuned([0, 1, 2, 3], targets)
    lengths = set()
    for model in range(4):
        alone = tuned([model], {scope: target[model : model + 1] for scope, target in targets.items()})
        lengths.add(len(alone))
        for scope in scopes:
            torch.testing.assert_close(
                torch.tensor(series(together, model, scope)),
                torch.tensor(series(alone, 0, scope)),
                rtol=0, atol=0, equal_nan=True,
            )  # fmt: skip
    assert len(lengths) > 1  # or nobody left the stack early


@pytest.mark.parametrize("entities", [11, 12, 13, 30])
def test_loss_gradient_is_bit_identical_whatever_the_stack(entities: int) -> None:
    models, relations = 8, 3
    embedding = random_embedding(models, entities, relations, 12)
    counts = torch.randint(4, (2, models, relations, entities, entities), generator=torch.Generator().manual_seed(1))
    positives, negatives = counts.float()
    together = training.loss_gradient(embedding, Tables(positives, negatives))
    for height in (1, 3):
        for some in torch.arange(models).split(height):
            alone = training.loss_gradient(select(embedding, some), Tables(positives[some], negatives[some]))
            assert same(select(together, some), alone)


@pytest.mark.usefixtures("form")
@pytest.mark.parametrize("models", [[1], [0, 2], [3, 2, 1, 0]])
@pytest.mark.parametrize("entities", [12, 13])
def test_epochs_are_bit_identical_whatever_the_stack(models: list[int], entities: int) -> None:
    cells = cells_of(random_graph(entities, 3, 80), 2, [0, 1, 2, 3])
    lesson = lessons.lesson(cells.initial, "test", cells.keys, "unseen")
    state = training.start(start_of(cells))
    some = select(training.start(start_of(cells)), torch.tensor(models))
    for epoch in range(1, 6):
        training.run_epoch(state, lesson, SAMPLED, TUNING, 0, epoch)
        training.run_epoch(some, select(lesson, torch.tensor(models)), SAMPLED, TUNING, 0, epoch)
    assert same(select(state.embedding, torch.tensor(models)), some.embedding)


def test_lesson_counts_training_observations_alone() -> None:
    cells = small_cells()
    lesson = lessons.lesson(cells.joint, "test", cells.keys, "all")
    train = torch.from_numpy(cells.splits) == TRAIN
    assert torch.equal(lesson.counts, torch.where(train, cells.graph.counts, 0))
    only = replace(lesson, counts=lesson.counts * 0)
    state, before = training.start(start_of(cells)), start_of(cells)
    training.run_epoch(state, only, EXPECTED, TUNING, 0, 1)
    assert same(state.embedding, before)  # no observation, no step
