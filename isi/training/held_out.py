"""Measures of a trained model on triples that leave training, and which triples may leave it."""

from collections.abc import Sequence
from typing import Any

import networkx as nx
import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.evaluation.filtered import EndQueries, end_queries, random_ranks
from isi.graph.graph import HEAD, RELATION, TAIL, Graph
from isi.graph.sessions import TEST, TRAIN, split
from isi.models.stack import Embedding

FEWEST = 50  #: Test triples, unless they are over a fifth of all; of a large graph a tenth.
#: Maximum number of test triples, and this number times E.
MOST_HELD_OUT, MOST_SCORES = 1000, 2**25
#: Two relations repeat each other if they share more than this share of the pairs of either, and
#: this number.
REPEATED, FEWEST_REPEATED = 0.8, 5
#: Standard errors by which the reciprocal ranks of a model that has learned exceed others.
CLEARLY = 2.0


def repeated_relations(graph: Graph) -> list[list[int]]:
    """Relations that have the same pairs of entities, as they are or swapped;
    a symmetric one may stand alone.

    A model answers triples of the one from triples of the other without any knowledge of the
    entities.
    """
    head, relations, tail = graph.triples.numpy().T
    number = len(graph.entities)
    pairs = pd.DataFrame(
        {"relation": relations, "pair": head * number + tail, "swapped": tail * number + head}
    )
    pairs = pairs[head != tail]
    sizes = pairs["relation"].value_counts()
    repeats = nx.Graph()
    for column in ("pair", "swapped"):
        both = pairs.merge(pairs, left_on="pair", right_on=column)
        for (relation, other), shared in both[["relation_x", "relation_y"]].value_counts().items():
            enough = shared >= FEWEST_REPEATED and shared > REPEATED * min(
                sizes[relation], sizes[other]
            )
            if enough and (relation != other or column == "swapped"):
                repeats.add_edge(relation, other)
    return sorted(map(sorted, nx.connected_components(repeats)))


def groups_of(graph: Graph, repeated: Sequence[Sequence[int]]) -> np.ndarray:
    """The first triple, an id, that has the two entities of each triple and a relation
    that repeats its own; (T,).
    """
    head, relation, tail = graph.triples.numpy().T
    together = np.arange(len(graph.relations))
    is_repeated = np.zeros(len(graph.relations), dtype=bool)
    for relations in repeated:
        together[list(relations)] = relations[0]
        is_repeated[list(relations)] = True
    triples = np.arange(len(relation))
    alone = np.where(is_repeated[relation], -1, triples)
    keys = np.stack(
        [together[relation], np.minimum(head, tail), np.maximum(head, tail), alone], axis=1
    )
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return first[group.reshape(-1)]


def held_out(graph: Graph, groups: np.ndarray, seed: int) -> np.ndarray:
    """A split, (T,), int8, in which every name is in train. Triples of a group, (T,), have the same
    split.
    """
    number, most = len(graph.triples), MOST_SCORES // len(graph.entities)
    tests = min(max(number // 10, min(FEWEST, number // 5)), most, MOST_HELD_OUT)
    splits = split_groups(graph, groups, np.arange(number), seed, 0, 0.0, tests / number)
    rest, share = np.flatnonzero(splits == TRAIN), min(0.1, tests / number)
    splits[rest] = split_groups(graph, groups, rest, seed, 1, share, 0.0)
    return splits


def split_groups(
    graph: Graph,
    groups: np.ndarray,
    triples: np.ndarray,
    root: int,
    seed: int,
    valid: float,
    test: float,
) -> np.ndarray:
    """``split`` of some triples, ids (N,), in which those of a group have
    the same split; (N,), int8.
    """
    wholes, group = np.unique(groups[triples], return_inverse=True)
    splits = split(graph.part(wholes), root, seed, valid, test)[group]
    relation = graph.triples[:, RELATION].numpy()[triples]
    for lost in np.setdiff1d(relation, relation[splits == TRAIN]):
        splits[group == group[relation == lost][0]] = TRAIN
    return splits


def with_few_facts(
    graph: Graph,
    groups: np.ndarray,
    entities: np.ndarray,
    facts: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """A mask of triples, (T,), in which each of some entities, ids (N,), has about so many
    ``facts``, (N,), and every other name at least one.

    An entity loses one relation after the other, at random, so that what is left is of few.
    Triples of a group, (T,), stay together.
    """
    stays, ends = np.ones(len(groups), dtype=bool), graph.triples[:, [HEAD, TAIL]].numpy()
    relation = graph.triples[:, RELATION].numpy()
    left, left_of_relation = np.bincount(ends.ravel()), np.bincount(relation)
    least = np.ones(len(left), dtype=np.int64)
    least[entities] = facts
    loses = np.isin(ends, entities)
    touching = rng.permutation(np.flatnonzero(loses.any(1)))
    entity = np.where(loses[:, 0], ends[:, 0], ends[:, 1])[touching]
    turn = rng.random((len(left), len(left_of_relation)))[entity, relation[touching]]
    in_turn = groups[touching[np.argsort(turn)]]
    for group in dict.fromkeys(in_turn.tolist()):
        triples = touching[groups[touching] == group]
        fewer = left - np.bincount(ends[triples].ravel(), minlength=len(left))
        fewer_of_relation = left_of_relation - np.bincount(
            relation[triples], minlength=len(left_of_relation)
        )
        if (fewer[ends[triples]] >= least[ends[triples]]).all() and fewer_of_relation.all():
            stays[triples], left, left_of_relation = False, fewer, fewer_of_relation
    return stays


def held_out_measures(
    graph: Graph, groups: np.ndarray, splits: np.ndarray, theta: Embedding
) -> dict[str, Any]:
    """The last fields of a ``TrainingSummary``, for an embedding that was not trained on the test
    triples of splits, (T,).

    Triples of a group, (T,), count as one where errors are estimated.
    """
    names, is_test = ("mrr", "frequency", "chance"), torch.from_numpy(splits == TEST)
    number = int(is_test.sum())
    if not number:
        nothing = (
            "no triple can leave training, since each entity and relation needs one: "
            "quality is unknown"
        )
        return {"test_triples": 0, **dict.fromkeys(names), "warning": nothing}
    queries = end_queries(graph, is_test.nonzero().T)
    ranks = torch.stack(
        [
            reciprocal_ranks(queries, queries.scores(theta, theta.entity)),
            reciprocal_ranks(queries, frequencies(graph, ~is_test, queries)),
            random_ranks(~queries.right, queries),
        ]
    )
    gains = ranks[0] - ranks[1:]
    independent = gains.shape[1] * len(np.unique(groups[splits == TEST])) / number
    clear = bool((gains.mean(1) > CLEARLY * gains.std(1) / independent**0.5).all())
    nothing = (
        "the model has learned nothing that shows: it ranks answers about as "
        "their frequency or chance does"
    )
    measures = dict(zip(names, ranks.mean(1).tolist(), strict=True))
    return {"test_triples": number, **measures, "warning": None if clear else nothing}


def reciprocal_ranks(queries: EndQueries, scores: Tensor) -> Tensor:
    """Filtered reciprocal ranks of the answers by scores of all entities, (2, M, Q, E);
    one number for each query.
    """
    return (1 / queries.ranks(scores))[:, queries.counted].double().flatten()


def frequencies(graph: Graph, trained: Tensor, queries: EndQueries) -> Tensor:
    """Each entity's number of triples in a mask, (T,), in the slot and relation of each query;
    shape (2, M, Q, E).
    """
    numbers = torch.zeros(2, len(graph.relations), len(graph.entities))
    for number, slot in zip(numbers, (HEAD, TAIL), strict=True):
        number.index_put_(
            tuple(graph.triples[trained][:, [RELATION, slot]].T), torch.ones(()), accumulate=True
        )
    return numbers[:, queries.triples[..., RELATION]]
