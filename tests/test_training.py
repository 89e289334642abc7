"""Adagrad, the loop over epochs, and models that leave a stack when they stop."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch
from torch import Tensor
from torch.nn.functional import logsigmoid

from isi.evaluation.query_sets import GROUPS, query_sets, validation
from isi.evaluation.ranking import evaluate
from isi.graph.sessions import OUT, TRAIN, session_of
from isi.models.model import make_model
from isi.models.stack import Embedding, select, uniform
from isi.training.batches import DenseBatch, ListBatch, Negatives, batches, training_data
from isi.training.trainer import (
    ConvergenceWatch,
    Optimizer,
    Target,
    Training,
    adagrad,
    loss_gradient,
    run_epoch,
    start,
    train,
    train_until_best,
)
from stages.grid import GridPoints
from tests.small_graphs import ANALOGY, graph_of, points_of, random_embedding, random_graph

SAMPLED = Negatives(mode="sampled", ratio=3)
EXPECTED = Negatives(mode="expected", ratio=3)
TUNING = Optimizer(batch_size=50, learning_rate=0.05, weight_decay=1e-3, max_epochs=6)


def loss(entity: Tensor, relation: Tensor, positives: Tensor, negatives: Tensor) -> Tensor:
    """Σ -log σ(y · f)."""
    scores = ANALOGY.score(
        entity[:, None, :, None], relation[:, :, None, None], entity[:, None, None]
    )
    return -(positives * logsigmoid(scores) + negatives * logsigmoid(-scores)).sum()


def small_points(seeds: list[int] | None = None) -> GridPoints:
    return points_of(random_graph(13, 3, 80), 2, seeds or [0, 1, 2, 3])


def start_of(points: GridPoints, half_range: float = 0.5) -> Embedding:
    return uniform(points.session(0).entities, 3, ANALOGY, 12, half_range, 0, points.keys())


def same(one: Embedding, other: Embedding) -> bool:
    return torch.equal(one.entity, other.entity) and torch.equal(one.relation, other.relation)


def test_loss_gradient_is_that_of_autograd() -> None:
    embedding = random_embedding(2, 4, 3, 8)
    entity, relation = (
        table.double().requires_grad_() for table in (embedding.entity, embedding.relation)
    )
    generator = torch.Generator().manual_seed(3)
    positives, negatives = (
        torch.randint(4, (2, 3, 4, 4), generator=generator).double() for _ in range(2)
    )
    by_entity, by_relation = torch.autograd.grad(
        loss(entity, relation, positives, negatives), (entity, relation)
    )
    result = loss_gradient(
        Embedding(entity.detach(), relation.detach(), ANALOGY), DenseBatch(positives, negatives)
    )
    torch.testing.assert_close(result.entity, by_entity)
    torch.testing.assert_close(result.relation, by_relation)


def test_adagrad_is_that_of_torch() -> None:
    begin = random_embedding(1, 5, 2, 8)
    state = start(begin)
    tables = [table.clone().requires_grad_() for table in (begin.entity, begin.relation)]
    optimizer = torch.optim.Adagrad(
        tables, lr=0.1, weight_decay=1e-3, initial_accumulator_value=1e-6, eps=0.0
    )
    settings = Optimizer(batch_size=1, learning_rate=0.1, weight_decay=1e-3, max_epochs=1)
    generator = torch.Generator().manual_seed(5)
    for _ in range(6):
        positives, negatives = (
            torch.randint(3, (1, 2, 5, 5), generator=generator).float() for _ in range(2)
        )
        optimizer.zero_grad()
        (loss(*tables, positives, negatives) / positives.sum()).backward()
        optimizer.step()
        gradient = loss_gradient(state.embedding, DenseBatch(positives, negatives))
        number = positives.sum((1, 2, 3)).long()
        adagrad(state, gradient, number, torch.zeros(1, 5, dtype=torch.bool), settings)
    for result, expected in zip(
        (state.embedding.entity, state.embedding.relation), tables, strict=True
    ):
        torch.testing.assert_close(result, expected.detach(), rtol=1e-4, atol=1e-5)
    assert not torch.allclose(state.embedding.entity, begin.entity, atol=0.1)


def test_a_graph_too_large_for_tables_learns_the_same_from_lists(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    points = small_points()
    data = training_data(points.session(0), "test", points.keys())
    small, large = start(start_of(points)), start(start_of(points))
    run_epoch(small, data, SAMPLED, TUNING, 0, 1)
    monkeypatch.setattr("isi.training.batches.DENSE_LIMIT", 0)
    assert all(
        isinstance(batch, ListBatch)
        for batch, _ in batches(data, EXPECTED, TUNING.batch_size, 0, 1)
    )
    run_epoch(large, data, SAMPLED, TUNING, 0, 1)
    torch.testing.assert_close(large.embedding.entity, small.embedding.entity, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("negatives", [SAMPLED, EXPECTED], ids=["sampled", "expected"])
def test_entities_outside_the_session_stay_zero(negatives: Negatives) -> None:
    points = small_points()
    state, members = start(start_of(points)), points.session(0).entities
    data = training_data(points.session(0), "test", points.keys())
    before = state.embedding.entity.clone()
    for epoch in (1, 2):
        run_epoch(state, data, negatives, TUNING, 0, epoch)
    assert (state.embedding.entity[~members] == 0).all()
    assert (state.embedding.entity != before)[members].all()


FITTING = Training(
    batch_size=60, learning_rate=0.1, weight_decay=1e-3, max_epochs=30, evaluate_every=2, patience=2
)


def fitted(seeds: list[int], settings: Training = FITTING) -> tuple[Embedding, pd.DataFrame]:
    points = small_points(seeds)
    data = training_data(points.session(0), "test", points.keys())
    best, looks = train_until_best(start_of(points, 0.01), data, SAMPLED, settings, 0)
    return best, pd.concat(looks)


def validations_of(model: int, looks: pd.DataFrame) -> list[tuple[int, float, bool]]:
    """Rows (epoch, MRR*, whether it was the best) of one model."""
    return list(
        looks.loc[looks["place"] == model, ["epoch", "mrr_star", "kept"]].itertuples(
            index=False, name=None
        )
    )


def test_fit_keeps_the_best_and_respects_patience() -> None:
    best, validations = fitted([0, 1, 2, 3])
    points = small_points()
    reached = evaluate(best, validation(points.session(0)))["valid"].measures[:, 0]
    lengths = set()
    for model in range(4):
        rows = validations_of(model, validations)
        scores = [score for _, score, _ in rows]
        assert [epoch for epoch, _, _ in rows] == [2 * (number + 1) for number in range(len(rows))]
        assert [is_best for _, _, is_best in rows] == [
            s > max([-1, *scores[:n]]) for n, s in enumerate(scores)
        ]
        assert reached[model].item() == max(scores)
        since_best = len(scores) - 1 - scores.index(max(scores))
        assert since_best == FITTING.patience or rows[-1][0] == FITTING.max_epochs
        gaps = np.diff([n for n, (_, _, is_best) in enumerate(rows) if is_best])
        assert (gaps <= FITTING.patience).all()
        lengths.add(len(rows))
    assert len(lengths) > 1  # or no model left the stack early


@pytest.fixture(params=["tables", "lists"])
def form(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Set the form of batches: tables or lists."""
    if request.param == "lists":
        monkeypatch.setattr("isi.training.batches.DENSE_LIMIT", 0)


Targets = dict[str, list[list[float]]]  #: By name: of both groups, of each model.
NAN = [float("nan")] * 4


def tuned(targets: Targets, trained: list[bool] | None = None, full: bool = False) -> pd.DataFrame:
    """Measures of four models by epoch until they reach the targets."""
    points = small_points()
    watch = ConvergenceWatch(
        [query_sets(points.session(1), points.novel_ids, points.insert_mask)],
        {
            name: [
                Target(group, "mrr", torch.tensor(values, dtype=torch.float64))
                for group, values in zip(GROUPS, of_groups, strict=True)
            ]
            for name, of_groups in targets.items()
        },
        None if trained is None else torch.tensor(trained),
        full,
    )
    data = training_data(points.session(1), "test", points.keys())
    train(start_of(points), data, SAMPLED, TUNING, 0, watch)
    return pd.concat(watch.looks).set_index(["place", "scope", "epoch"])["mrr"].sort_index()


def test_fine_tuning_stops_for_each_model_at_the_first_epoch_at_which_both_groups_converge() -> (
    None
):
    full = tuned({"none": [NAN, NAN]}, full=True)
    assert full.groupby("epoch").size().to_dict() == dict.fromkeys(range(7), 4 * 5)
    known, novel = ([full[model, group].tolist() for model in range(4)] for group in GROUPS)
    # 0 converges at once, 1 too, with no target of novel entities, 2 never, and 3 where both are
    # highest
    both = [min(pair) for pair in zip(known[3], novel[3], strict=True)]
    assert both.index(max(both)) > 0
    late = max(both)
    targets = [[-1.0, -1.0, -1.0, late], [-1.0, float("nan"), 2.0, late]]
    curves = tuned({"none": targets})
    ends = [0, 0, TUNING.max_epochs, both.index(late)]
    for model, end in enumerate(ends):
        for group, own in zip(GROUPS, (known, novel), strict=True):
            assert curves[model, group].tolist() == own[model][: end + 1]
    # every change of the measure has to converge, each at an epoch of its own
    prolonged = tuned({"none": targets, "other": [[2.0, -1.0, -1.0, -1.0], NAN]})
    assert prolonged[0, "known"].tolist() == known[0]
    assert prolonged[3, "known"].tolist() == known[3][: ends[3] + 1]
    chosen = tuned({"none": targets}, [False, True, False, True], full=True)
    assert chosen.groupby("place").size().to_dict() == {0: 5, 1: 5 * 7, 2: 5, 3: 5 * 7}


def test_training_gives_each_model_as_it_was_when_it_left() -> None:
    points = small_points()
    data, stays = (
        training_data(points.session(0), "test", points.keys()),
        torch.tensor([0, 3, 1, 6]),
    )

    def watch(epoch: int, _: Embedding, models: Tensor) -> Tensor:
        return stays[models] > epoch

    left = train(start_of(points), data, EXPECTED, TUNING, 0, watch)
    for model, epochs in enumerate(stays.tolist()):
        state, own = (
            start(select(start_of(points), torch.tensor([model]))),
            select(data, torch.tensor([model])),
        )
        for epoch in range(1, epochs + 1):
            run_epoch(state, own, EXPECTED, TUNING, 0, epoch)
        assert same(select(left, torch.tensor([model])), state.embedding)


def tables(embedding: Embedding) -> tuple[Tensor, Tensor]:
    return embedding.entity, embedding.relation


def test_weight_decay_acts_on_all_rows_of_the_session() -> None:
    graph = graph_of({(0, 0, 1): 1, (2, 1, 3): 1}, 4, 2)  # 2 and 3 have no training triple
    session = session_of(graph, torch.tensor([[TRAIN, OUT]], dtype=torch.int8))
    state = start(random_embedding(1, 4, 2, 8))
    before = state.embedding.entity.clone()
    zero = Embedding(torch.zeros(1, 4, 8), torch.zeros(1, 2, 8), ANALOGY)
    settings = Optimizer(batch_size=2, learning_rate=1e-4, weight_decay=0.5, max_epochs=1)
    adagrad(state, zero, torch.tensor([1]), ~session.entities, settings)
    assert (state.embedding.entity.abs() < before.abs()).all()


def first_alone(counts: Tensor) -> Tensor:
    """One observation of the first triple that has any; shapes: (M, T)."""
    observed = counts > 0
    return (observed & (observed.cumsum(1) == 1)).long()


@pytest.mark.usefixtures("form")
@pytest.mark.parametrize("kind", ["analogy", "transe"])
def test_updates_by_one_observation_decay_by_the_dimension_and_on_touched_rows_alone(
    kind: str,
) -> None:
    """With so large a decay, a touched row's gradient is γ / d times the row."""
    points = small_points([0])
    model = make_model(kind, {"margin": 2.0, "squared": True} if kind == "transe" else {}, kind)
    data = training_data(points.session(0), "test", points.keys())
    data = replace(data, counts=first_alone(data.counts))
    embedding = random_embedding(1, 13, 3, 12, model=model)
    settings = Optimizer(batch_size=1, learning_rate=1e-2, weight_decay=12e6, max_epochs=1)
    state = start(embedding)
    run_epoch(state, data, SAMPLED, settings, 0, 1, compiled=False)
    (batch,) = [batch for batch, _ in batches(data, SAMPLED, 1, 0, 1)]
    for table, squares, old, touched in zip(
        tables(state.embedding),
        tables(state.squares),
        tables(embedding),
        batch.touched(),
        strict=True,
    ):
        assert touched.sum() > 0
        assert torch.equal(table[~touched], old[~touched])
        assert torch.equal(squares[~touched], torch.full_like(squares[~touched], 1e-6))
        torch.testing.assert_close(
            squares[touched].sqrt(), 1e6 * old[touched].abs(), rtol=1e-2, atol=1e3
        )


def test_fit_validates_the_last_epoch_too_and_a_plateau_is_no_better() -> None:
    _, validations = fitted([0], FITTING.model_copy(update={"max_epochs": 5, "evaluate_every": 3}))
    assert validations["epoch"].tolist() == [3, 5]
    _, validations = fitted([0], FITTING.model_copy(update={"learning_rate": 1e-12}))
    assert len({score for _, score, _ in validations_of(0, validations)}) == 1
    assert [is_best for _, _, is_best in validations_of(0, validations)] == [
        True,
        *[False] * FITTING.patience,
    ]


@pytest.mark.usefixtures("form")
def test_no_observation_is_no_step() -> None:
    points = small_points()
    data = training_data(points.session(1), "test", points.keys())
    only = replace(data, counts=data.counts * 0)
    state, before = start(start_of(points)), start_of(points)
    run_epoch(state, only, EXPECTED, TUNING, 0, 1)
    assert same(state.embedding, before)
