"""Random streams: their purposes and keys determine every result, and must not change."""

import numpy as np
import pytest
import torch

from isi.graph.sessions import TEST, TRAIN, VALID, folds, split
from isi.initializers.paper import permuted_words
from isi.training.batches import corrupt, sample_epoch, shuffle_into_batches, training_data
from tests.init_contexts import four_novel
from tests.small_graphs import generator, points_of, random_graph

#: As ``generator`` has it.
ROOT = 0
POINTS = points_of(random_graph(12, 3, 60), 2, [5, 6])
DATA = training_data(POINTS.session(0), "test", POINTS.keys())


def may_leave_train(order: np.ndarray, triples: list[list[int]]) -> list[int]:
    """The triples, in an order, that are not the first with one of their
    entities or their relation.
    """
    entities, relations, free = set[int](), set[int](), []
    for triple in order.tolist():
        head, relation, tail = triples[triple]
        if {head, tail} <= entities and relation in relations:
            free.append(triple)
        entities |= {head, tail}
        relations.add(relation)
    return free


def test_folds_are_parts_of_a_random_order_of_what_may_leave_train() -> None:
    graph = random_graph(12, 3, 60)
    free = may_leave_train(
        generator("folds").permutation(len(graph.triples)), graph.triples.tolist()
    )
    splits = folds(graph, ROOT, 4)
    assert splits.dtype == np.int8
    for own, fold in zip(splits, np.array_split(free, 4), strict=True):
        assert np.flatnonzero(own == VALID).tolist() == sorted(fold.tolist())
        assert (own[own != VALID] == TRAIN).all()


def test_a_split_is_the_first_of_such_an_order() -> None:
    graph, seed = random_graph(12, 3, 60), 3
    free = may_leave_train(
        generator("splits", seed).permutation(len(graph.triples)), graph.triples.tolist()
    )
    tests, valids = round(0.2 * len(graph.triples)), round(0.1 * len(graph.triples))
    splits = split(graph, ROOT, seed, valid=0.1, test=0.2)
    assert splits.dtype == np.int8
    assert np.flatnonzero(splits == TEST).tolist() == sorted(free[:tests])
    assert np.flatnonzero(splits == VALID).tolist() == sorted(free[tests : tests + valids])


@pytest.mark.parametrize("within", ["es_permuted", "es_permuted_kinds"])
def test_words_are_permuted_for_the_purpose_of_each_control(within: str) -> None:
    of, rng = four_novel(), generator(within, 2, 0)
    groups = torch.zeros_like(of.kinds) if within == "es_permuted" else of.kinds
    batched = np.arange(len(of.words))
    for group in sorted(set(groups.tolist())):
        wordy = [
            entity
            for entity in range(len(of.words))
            if groups[entity] == group and of.words[entity].any()
        ]
        batched[wordy] = np.array(wordy)[rng.permutation(len(wordy))]
    dealt = permuted_words(of, within, groups)
    assert dealt[0].tolist() == batched.tolist()


def shuffled(model: int, epoch: int) -> np.ndarray:
    """The observations of a model, as triple ids, in the order of an epoch."""
    counts = DATA.counts[model].numpy()
    observations = np.repeat(np.arange(len(counts)), counts)
    generator("test batches", *DATA.keys[model].tolist(), epoch).shuffle(observations)
    return observations


def test_batches_are_drawn_from_a_stream_of_model_and_epoch() -> None:
    for epoch in (1, 2):
        batched = shuffle_into_batches(DATA, ROOT, epoch, 20)
        for model in range(2):
            assert (
                np.concatenate([batch[model] for batch in batched]).tolist()
                == shuffled(model, epoch).tolist()
            )


@pytest.mark.parametrize(
    ("purpose", "number"), [("negatives", (3, 1)), ("negatives in turn", (3,))]
)
def test_negatives_are_drawn_from_a_stream_of_their_own(
    purpose: str, number: tuple[int, ...]
) -> None:
    """The first numbers of the stream are for tails."""
    ratio, epoch = 2, 3
    if len(number) == 1:
        drawn = sample_epoch(DATA, ratio, ROOT, epoch)
    else:
        drawn = corrupt(
            DATA, shuffle_into_batches(DATA, ROOT, epoch, 10**6)[0], ratio, ROOT, purpose, *number
        )
    positives, tails = [part.triples for part in drawn], [part.replacements[0] for part in drawn]
    for model in range(2):
        assert torch.equal(positives[model], DATA.session.graph.triples[shuffled(model, epoch)])
        pool = np.flatnonzero(DATA.tail_pool[model].numpy())
        random = generator(f"test {purpose}", *DATA.keys[model].tolist(), *number).random(
            (len(positives[model]), ratio)
        )
        assert tails[model].tolist() == pool[(random * len(pool)).astype(int)].tolist()
