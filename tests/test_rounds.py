"""New entities that have triples with each other, new relations, and both together."""

from typing import Any

import numpy as np
import scipy.optimize
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import isi
from isi.insertion import relations
from isi.insertion.engine import ROUNDS, layers, schedule
from isi.models.model import make_model
from isi.models.stack import Embedding
from tests.small_embedding import ENTITIES, TRIPLES, call

KNOWN_IDS = 10
#: New entities 10 to 14: 11 is next to a known one, 10 next to 11, 12 next to 10; 13 and 14 have
#: each other alone.
CHAIN = np.array([[11, 0, 3], [10, 1, 11], [12, 0, 10], [13, 1, 14], [12, 0, 12]])


def test_layers_are_distances_from_known_entities() -> None:
    assert layers(CHAIN, KNOWN_IDS, 5).tolist() == [1, 0, 2, 0, 0]


def test_entities_are_inserted_behind_those_on_which_they_depend_and_then_together() -> None:
    steps = [
        (ids.tolist(), np.flatnonzero(seen).tolist())
        for ids, seen in schedule(CHAIN, KNOWN_IDS, 5, False)
    ]
    assert steps[:3] == [([11, 13, 14], [0]), ([10], [1]), ([12], [2])]
    assert steps[3:] == [([10, 11, 12, 13, 14], [0, 1, 2, 3])] * (ROUNDS - 1)


def test_without_triples_between_new_entities_there_is_one_step() -> None:
    ((ids, seen),) = schedule(CHAIN[[0, 4]], KNOWN_IDS, 2, False)
    assert (ids.tolist(), seen.tolist()) == ([10, 11], [True, False])


@given(st.permutations(range(4)))
@settings(max_examples=10, deadline=None)
def test_neither_the_order_of_triples_nor_of_names_matters(order: list[int]) -> None:
    names = ["mug", "cup", "saucer", "spoon"]
    triples = [*TRIPLES, ("saucer", "in", "cup"), ("spoon", "on", "saucer")]
    how = {"initializer": "map"}
    expected = call(new=names, triples=triples, **how)
    ordered = [names[place] for place in order]
    done = call(new=ordered, triples=triples[::-1], **how)
    for row, place in enumerate(order):
        np.testing.assert_allclose(
            done.entities[ENTITIES + row], expected.entities[ENTITIES + place], rtol=1e-3, atol=1e-4
        )


def test_an_entity_that_only_a_new_one_knows_is_inserted_from_it() -> None:
    triples = [*TRIPLES[:3], ("spoon", "in", "mug")]
    done = call(new=["spoon", "mug", "cup"], triples=triples)
    alone = call(new=["spoon", "mug", "cup"], triples=triples[:3], initializer="map")
    spoon, mug, _ = done.entities[ENTITIES:]
    assert not np.allclose(spoon, alone.entities[ENTITIES])

    def score(of: Any, head: np.ndarray) -> float:
        relation = torch.from_numpy(of.relations[0]).float()
        ends = (torch.from_numpy(vector).float() for vector in (head, mug))
        return float(of.details.model.score(next(ends), relation, next(ends)))

    assert score(done, spoon) > score(done, alone.entities[ENTITIES])


def planted(relations: int) -> tuple[Embedding, np.ndarray]:
    """A random DistMult embedding of 40 entities,
    and the 30 triples of each relation with the highest scores.
    """
    generator = torch.Generator().manual_seed(4)
    theta = Embedding(
        torch.randn(1, 40, 6, generator=generator),
        torch.randn(1, relations, 6, generator=generator),
        make_model("distmult", {}, ""),
    )
    triples = []
    for relation in range(relations):
        score = torch.einsum(
            "hd,d,td->ht", theta.entity[0], theta.relation[0, relation], theta.entity[0]
        )
        triples += [(int(i) // 40, relation, int(i) % 40) for i in score.flatten().topk(30).indices]
    return theta, np.array(triples)


def test_a_relation_may_arrive_without_an_entity() -> None:
    theta, triples = planted(5)
    of_new = triples[:, 1] == 4
    done = isi.insert(
        theta.entity[0].numpy(),
        theta.relation[0, :4].numpy(),
        triples[of_new],
        new=0,
        new_relations=1,
        model="distmult",
        known_triples=triples[~of_new],
    )
    assert (done.details.new, done.details.new_relations, done.relations.shape) == ([], [4], (5, 6))
    np.testing.assert_array_equal(done.relations[:4], theta.relation[0, :4])
    assert "new relations: 4" in repr(done)
    assert done.report() == []
    without = done.interference()
    assert (without.h_old, without.above) == (without.h_cur, [])


def test_a_relations_row_is_what_a_general_minimizer_finds() -> None:
    theta, triples = planted(4)
    of_new, known = triples[triples[:, 1] == 3][:4], triples[triples[:, 1] < 3]
    fitted = relations.fit_relations(
        theta, 40, 3, torch.from_numpy(of_new), torch.from_numpy(known), 2.0, 3, 1.5
    )
    entity, rows = theta.entity[0].double().numpy(), theta.relation[0, :3].double()
    precision, mean = np.linalg.inv(relations.covariance(rows).numpy()), rows.mean(0).numpy()
    weighted = [(1.0, head, tail) for head, _, tail in of_new]
    weighted += [(-3 / 40, head, end) for head, _, _ in of_new for end in range(40)]
    weighted += [(-3 / 40, end, tail) for _, _, tail in of_new for end in range(40)]
    weighted += [(-1.5 * 3 * (4 * 3 / 90) / 3, head, tail) for head, _, tail in known]

    def objective(row: np.ndarray) -> float:
        loss = sum(
            abs(w) * np.logaddexp(0, -np.sign(w) * (entity[h] * row) @ entity[t])
            for w, h, t in weighted
        )
        return float(loss + 2.0 / 2 * (row - mean) @ precision @ (row - mean))

    best = scipy.optimize.minimize(objective, mean, method="BFGS", options={"gtol": 1e-6})
    np.testing.assert_allclose(fitted[0], best.x, atol=1e-3)


def test_an_entity_and_a_relation_may_arrive_together() -> None:
    triples = [*TRIPLES, ("mug", "holds", "e3"), ("e5", "holds", "e6"), ("cup", "owns", "e1")]
    done = call(triples=triples, new_relations=["holds", "owns"])
    names = done.details.labels.names
    assert names is not None
    assert [*names[-2:]] == ["holds", "owns"]
    assert done.entities[ENTITIES:].any(1).all()
    assert done.relations[done.details.new_relations].any(1).all()
    assert np.isfinite(done.relations).all()
    without = call()
    assert not np.allclose(done.entities[ENTITIES:], without.entities[ENTITIES:])
    np.testing.assert_array_equal(done.relations[: len(without.relations)], without.relations)
