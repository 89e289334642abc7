"""Batches of observations, and their corrupted triples."""

import numpy as np
import pytest
import torch
from torch import Tensor

from isi.graph.sessions import OUT, TRAIN, Session, session_of
from isi.training import batches
from stages.grid import GridPoints
from tests.small_graphs import graph_of, points_of, random_graph


def one_triple(count: int = 2, relations: int = 2, entities: int = 4) -> batches.TrainingData:
    """Training data with the triple (0, 0, 1) alone; entity 3 is not in the session."""
    graph = graph_of({(0, 0, 1): count, (2, 0, 3): 5}, entities, relations)
    members = torch.tensor([[number != 3 for number in range(entities)]])
    session = Session(graph, members, torch.tensor([[TRAIN, OUT]], dtype=torch.int8))
    return batches.training_data(session, "test", torch.tensor([[1, 0]]))


def observations(data: batches.TrainingData) -> list[np.ndarray]:
    """All training observations of each model, as one batch."""
    return [np.repeat(np.arange(len(counts)), counts) for counts in data.counts.numpy()]


def sampled(data: batches.TrainingData, ratio: int, root: int, epoch: int) -> Tensor:
    """Counts of the corrupted triples of all observations as one batch; shape (M, R, E, E)."""
    return drawn_for(data, observations(data), ratio, root, epoch, 0)


def drawn_for(
    data: batches.TrainingData, observed: list[np.ndarray], ratio: int, root: int, *number: int
) -> Tensor:
    """Counts of the corrupted triples of a batch; shape (M, R, E, E)."""
    corrupted = batches.corrupt(data, observed, ratio, root, "negatives", *number)
    return batches.count_negatives(data, batches.list_batch(data, corrupted))


def batch_counts(data: batches.TrainingData, root: int, epoch: int, size: int) -> Tensor:
    """Number of observations of each triple in each batch; shape (M, B, T)."""
    batched = batches.shuffle_into_batches(data, root, epoch, size)
    return torch.stack(
        [
            torch.stack(
                [
                    torch.bincount(
                        torch.as_tensor(one, dtype=torch.int64), minlength=data.counts.shape[1]
                    )
                    for one in batch
                ]
            )
            for batch in batched
        ],
        1,
    )


@pytest.fixture
def points() -> GridPoints:
    return points_of(random_graph(13, 3, 80), 2, [0, 1, 2, 3])


@pytest.fixture
def data(points: GridPoints) -> batches.TrainingData:
    return batches.training_data(points.session(0), "test", points.keys())


def test_expected_negatives_by_hand() -> None:
    data = one_triple()
    negatives_of = batches.expected_negatives(
        data, batches.count_positives(data, observations(data)), 9
    )[0]
    # 2 observations × 9: 18 tails over the entities 0 to 2, 18 heads over those never a head
    # (1, 2), 18 of relation 1
    expected = torch.zeros(2, 4, 4)
    expected[0, 0, :3] = 6
    expected[0, 1:3, 1] = 9
    expected[1, 0, 1] = 18
    torch.testing.assert_close(negatives_of, expected)


def test_heads_come_from_everyone_for_lists_or_where_the_pool_is_empty(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    everyone = torch.tensor([1.0, 1, 1, 0])
    unseen = one_triple().head_pool[0]
    assert torch.equal(unseen, torch.stack([torch.tensor([0.0, 1, 1, 0]), everyone]))
    with monkeypatch.context() as patch:
        patch.setattr(batches, "DENSE_LIMIT", 0)
        assert torch.equal(one_triple().head_pool, everyone.expand(1, 2, 4))
    graph = graph_of({(0, 0, 1): 1, (1, 0, 2): 1, (2, 0, 0): 1, (1, 1, 0): 1}, 3, 2)
    data = batches.training_data(
        session_of(graph, torch.zeros(1, 4, dtype=torch.int8)),
        "t",
        torch.tensor([[0, 0]]),
    )
    assert data.head_pool[0].tolist() == [[1, 1, 1], [1, 0, 1]]  # relation 1 keeps its pool


def test_a_single_entity_that_is_never_the_head_is_the_pool() -> None:
    graph = graph_of({(0, 0, 1): 1, (1, 0, 2): 1}, 3, 1)
    session = session_of(graph, torch.zeros(1, 2, dtype=torch.int8))
    data = batches.training_data(session, "t", torch.tensor([[0, 0]]))
    assert data.head_pool[0].tolist() == [[0, 0, 1]]


@pytest.mark.parametrize("limit", [batches.DENSE_LIMIT, 0])
def test_expected_negatives_are_the_mean_of_sampled_ones(
    limit: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batches, "DENSE_LIMIT", limit)
    points, draws, ratio = points_of(random_graph(6, 3, 20), 1, [0, 1]), 600, 4
    data = batches.training_data(points.session(0), "test", points.keys())
    expected = batches.expected_negatives(
        data, batches.count_positives(data, observations(data)), ratio
    )
    total = torch.zeros_like(expected)
    for epoch in range(draws):
        total += sampled(data, ratio, 0, epoch)
    assert (total[expected == 0] == 0).all()
    assert ((total / draws - expected).abs() <= 5 * (expected / draws).sqrt() + 1e-4).all()


def test_sampled_negatives_stay_in_the_session_and_with_their_batch(
    data: batches.TrainingData,
) -> None:
    for number, batched in enumerate(batches.shuffle_into_batches(data, 0, 1, 30)):
        drawn = drawn_for(data, batched, 3, 0, 1, number)
        assert drawn.sum((1, 2, 3)).tolist() == [9 * len(one) for one in batched]
        outside = ~data.session.entities[:, None]
        assert not (drawn.sum(-1)[outside.expand(-1, 3, -1)]).any()
        assert not (drawn.sum(-2)[outside.expand(-1, 3, -1)]).any()


def test_each_epoch_and_batch_samples_its_own_negatives() -> None:
    data = one_triple(count=60, entities=20)  # all batches have the same positives
    sampling = batches.Negatives(mode="sampled", ratio=3)
    epochs = [list(batches.batches(data, sampling, 20, 0, epoch)) for epoch in (1, 2, 1)]
    (first, second, _), (of_next, *_), (again, *_) = (
        [batch.negatives for batch, _ in epoch] for epoch in epochs
    )
    assert torch.equal(first, again)
    assert not torch.equal(first, second)
    assert not torch.equal(first, of_next)


def test_a_lone_relation_is_not_corrupted() -> None:
    data = one_triple(count=5, relations=1)
    assert sampled(data, 9, 0, 1).sum() == 2 * 45
    positives = batches.count_positives(data, observations(data))
    assert batches.expected_negatives(data, positives, 9).sum() == pytest.approx(90)


@pytest.mark.parametrize("size", [1, 7, 30, 10_000])
def test_batches_hold_each_observation_once_and_are_even(
    data: batches.TrainingData, size: int
) -> None:
    batched = batch_counts(data, 0, 1, size)
    assert torch.equal(batched.sum(1), data.counts)
    for model in range(4):
        lengths = batched[model].sum(1)
        used = lengths[lengths > 0]
        assert used.max() <= size
        assert used.max() - used.min() <= 1
        assert len(used) == -(-int(data.counts[model].sum()) // size)
        assert (lengths[: len(used)] > 0).all()


@pytest.mark.parametrize("mode", ["expected", "sampled"])
@pytest.mark.parametrize("fits", [True, False])
@pytest.mark.parametrize("size", [1, 40])
def test_a_batch_has_the_form_that_suits_the_graph(
    data: batches.TrainingData, mode: str, fits: bool, size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each observation is in exactly one batch."""
    monkeypatch.setattr(batches, "DENSE_LIMIT", 3 * 13 * 13 - (not fits))
    total = torch.zeros(4, dtype=torch.int64)
    negatives = batches.Negatives(mode=mode, ratio=3)
    for batch, positives in batches.batches(data, negatives, size, 0, 1):
        total += positives
        if fits:
            assert isinstance(batch, batches.DenseBatch)
            assert torch.equal(batch.positives.sum((1, 2, 3)), positives.float())
        else:
            assert isinstance(batch, batches.ListBatch)
            assert torch.equal(
                torch.bincount(batch.triples.model[batch.positive > 0], minlength=4), positives
            )
    assert torch.equal(total, data.counts.sum(1))


def test_touched_rows_by_hand() -> None:
    positives, negatives = torch.zeros(1, 3, 5, 5), torch.zeros(1, 3, 5, 5)
    positives[0, 0, 1, 2] = negatives[0, 2, 1, 4] = 1
    entities, relations = batches.DenseBatch(positives, negatives).touched()
    assert entities.tolist() == [[False, True, True, False, True]]
    assert relations.tolist() == [[True, False, True]]


def test_both_forms_of_a_batch_touch_the_same_rows(
    data: batches.TrainingData, monkeypatch: pytest.MonkeyPatch
) -> None:
    negatives = batches.Negatives(mode="sampled", ratio=1)
    dense = [batch for batch, _ in batches.batches(data, negatives, 1, 0, 1)]
    monkeypatch.setattr(batches, "DENSE_LIMIT", 0)
    lists = [batch for batch, _ in batches.batches(data, negatives, 1, 0, 1)]
    for table, listed in zip(dense, lists, strict=True):
        for one, other in zip(table.touched(), listed.touched(), strict=True):
            assert torch.equal(one, other)


@pytest.mark.parametrize("count", [50, 5000])  # of which many fall on one triple
def test_true_relation_is_never_a_corrupted_one(count: int) -> None:
    drawn = sampled(one_triple(count=count), 9, 0, 1)[0]
    assert drawn[1, 0, 1] == drawn[1].sum() == 9 * count


def test_data_count_training_observations_alone(points: GridPoints) -> None:
    data = batches.training_data(points.session(1), "test", points.keys())
    train = torch.from_numpy(points.splits) == TRAIN
    assert torch.equal(data.counts, torch.where(train, points.graph.counts, 0))


@pytest.mark.parametrize(
    ("counts", "most", "expected"),
    [
        ([1, 2, 3], 6, [1, 2, 3]),
        ([200_000_000, 4, 1], 1000, [999, 1, 1]),
        ([1, 1, 1], 2, [1, 1, 1]),
        ([2**31, 2**31], 10, [5, 5]),
    ],
)
def test_large_counts_are_scaled_down_and_no_triple_is_lost(
    counts: list[int], most: int, expected: list[int]
) -> None:
    assert batches.scaled_counts(torch.tensor(counts), most).tolist() == expected
