"""MAP: weights of its triples by hand, its minimum against SciPy,
its samples against the whole, its limits.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.nn.functional import cosine_similarity

from isi.checks.sample import sample_context
from isi.config import Option
from isi.initializers import evidence
from isi.initializers import map as maximum
from isi.initializers.context import InitContext
from isi.initializers.evidence import Evidence, evidence_of, spread
from isi.initializers.newton import newton_step, step_size
from isi.models.stack import NotFinite, mapped
from tests.init_contexts import (
    DIMENSION,
    DISTANCES,
    ENTITIES,
    KNOWN,
    LINEAR,
    RELATIONS,
    TRIPLES,
    fallbacks,
    four_novel,
    insertion,
    model_named,
)
from tests.init_contexts import initialize as insert
from tests.small_graphs import ANALOGY, random_embedding

OWN: dict[str, Option] = {"strength": 0.5, "ratio": 3}
#: Options of MAP with a prior at the centroid.
MEAN: dict[str, Option] = {
    "word_weight": 0.0,
    "relation_weight": 0.0,
    **OWN,
    "known_negatives": 2.0,
}


@pytest.fixture
def of() -> InitContext:
    return four_novel()


def mean_of(of: InitContext) -> np.ndarray:
    return of.theta0.entity[0, list(KNOWN)].double().mean(0).numpy()


def dense(weighted: Evidence, weight: Tensor) -> Tensor:
    """Weights of the first model's triples by novel entity, slot, relation and known entity;
    shape (n, 2, R, E).
    """
    table = torch.zeros(weighted.other.shape[1], 2, RELATIONS, ENTITIES, dtype=torch.float64)
    places = (
        torch.arange(len(table))[:, None],
        weighted.is_tail[0].long(),
        weighted.relation[0],
        weighted.other[0],
    )
    return table.index_put(places, weight[0], accumulate=True)


def test_insert_triples_are_positive_cells_and_bring_negatives(of: InitContext) -> None:
    weighted = evidence_of(of, 4, 0.0)
    positive, negative = dense(weighted, weighted.positive), dense(weighted, weighted.negative)
    places = [
        (0, 0, 0, 1),
        (0, 0, 0, 2),
        (0, 0, 2, 3),
        (0, 1, 1, 4),
        (1, 1, 1, 7),
        (3, 0, 1, 2),
        (3, 1, 1, 6),
    ]
    assert positive.nonzero().tolist() == sorted(map(list, places))
    assert positive.sum() == 7
    # novel entities are no ends of corrupted triples
    assert (negative[..., [0, 5, 9, 11]] == 0).all()
    assert negative.sum() == pytest.approx(7 * 2 * 4)
    assert negative[1, 1, 1].tolist() == pytest.approx(
        [4 / 8 * (end in KNOWN) for end in range(ENTITIES)]
    )
    # other relations; other ends
    assert negative[1, 1, :, 7].tolist() == pytest.approx([4 / 2, 4 / 8, 4 / 2])


def test_the_only_relation_is_never_corrupted() -> None:
    one_relation = random_embedding(1, ENTITIES, 1, DIMENSION)
    of = insertion(
        one_relation, [0], [[(1, 0, False), (4, 0, True)]], torch.ones(ENTITIES, 2), [0] * ENTITIES
    )
    assert evidence_of(of, 4, 0.0).negative.sum() == pytest.approx(2 * 4)


def test_known_triples_bring_negatives_by_the_share_of_the_entity_that_is_given(
    of: InitContext,
) -> None:
    weighted = evidence.corrupted_known(of, 1.0)
    table = dense(weighted, weighted.negative)
    assert table.sum((1, 2, 3)).tolist() == pytest.approx(
        [2 * 10 / 8 * share for share in (1, 1 / 2.5, 0, 2 / 2.5)]
    )
    as_head, as_tail = table[0] * 8  # of 8 known entities
    assert as_head[0].nonzero().flatten().tolist() == [1, 2, 3]  # tails of relation 0
    assert as_tail[0].nonzero().flatten().tolist() == [1, 2]  # and its heads
    # (10, 2, 1) and (3, 2, 1); (1, 0, 2), (1, 0, 3)
    assert (as_head[2, 1], as_tail[0, 1], as_tail[2, 3]) == (2, 2, 1)
    untrained = replace(of, trained=torch.zeros_like(of.trained))
    assert evidence.corrupted_known(untrained, 1.0).negative.sum() == 0


@given(st.lists(st.floats(0.01, 5), min_size=2, max_size=40), st.integers(1, 12))
def test_a_sample_has_the_total_and_each_item_as_often_as_its_weight_says(
    listed: list[float], most: int
) -> None:
    weight = torch.tensor([listed], dtype=torch.float64)
    ids, sampled = spread(weight, most)
    assert sampled.sum().item() == pytest.approx(sum(listed))
    number = torch.bincount(ids[0], sampled[0], minlength=len(listed))
    if len(listed) <= most:
        assert number.tolist() == listed
    else:
        assert ((number - weight[0]).abs() <= sampled[0, 0] * (1 + 1e-9)).all()


def test_samples_of_cells_are_near_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, entities = np.random.default_rng(0), 400
    seen = [
        [
            (int(rng.integers(4, entities)), int(rng.integers(RELATIONS)), bool(rng.integers(2)))
            for _ in range(5)
        ]
        for _ in range(4)
    ]
    triples = np.stack(
        [
            rng.integers(4, entities, 3000),
            rng.integers(0, RELATIONS, 3000),
            rng.integers(4, entities, 3000),
        ],
        1,
    )
    of = insertion(
        random_embedding(1, entities, RELATIONS, DIMENSION),
        [0, 1, 2, 3],
        seen,
        torch.zeros(entities, 2),
        [0] * entities,
        list(map(tuple, triples.tolist())),
    )
    near, options = [], MEAN | {"known_negatives": 4.0}
    for sample, known in ((10**6, 10**6), (1200, 1500), (60, 75)):
        monkeypatch.setattr(evidence, "SAMPLE", sample)
        monkeypatch.setattr(evidence, "KNOWN_SAMPLE", known)
        near.append(insert("map", of, **options).vectors[0])
    assert cosine_similarity(near[0], near[1]).min() > 0.95
    assert cosine_similarity(near[0], near[1]).min() > cosine_similarity(near[0], near[2]).min()


def plain_objective(
    of: InitContext,
    place: int,
    mean: np.ndarray,
    ratio: int,
    strength: float,
    known_negatives: float,
) -> Callable[[np.ndarray], float]:
    """The objective of MAP for one novel entity,
    computed from lists of true and corrupted triples.
    """
    theta0 = mapped(of.theta0, Tensor.double)
    # whether it is the tail, relation, other end, ± weight
    weighted: list[tuple[bool, int, int, float]] = []
    for end, label, last, there in zip(
        of.other[0, place].tolist(),
        of.relation[0, place].tolist(),
        of.novel_is_tail[0, place].tolist(),
        of.observed[0, place].tolist(),
        strict=True,
    ):
        if there:
            weighted.append((last, label, end, 1.0))
            weighted += [(last, label, known, -ratio / len(KNOWN)) for known in KNOWN]
            others = [r for r in range(RELATIONS) if r != label]
            weighted += [(last, r, end, -ratio / len(others)) for r in others]
    share = min(1.0, int(of.observed[0, place].sum()) / (2 * len(TRIPLES) / len(KNOWN)))
    of_known = -known_negatives * ratio * share / len(KNOWN)
    for head, label, tail in TRIPLES:
        weighted += [(False, label, tail, of_known), (True, label, head, of_known)]
    sigma = np.cov(theta0.entity[0, list(KNOWN)].numpy().T, bias=True)
    shrinkage = maximum.SHRINKAGE
    sigma = (1 - shrinkage) * sigma + shrinkage * np.trace(sigma) / len(sigma) * np.eye(len(sigma))

    is_tail, relation, other = (
        torch.tensor(part) for part in zip(*(row[:3] for row in weighted), strict=True)
    )
    weight = np.array([row[3] for row in weighted])
    row, end = theta0.relation[0, relation], theta0.entity[0, other]

    def objective(vector: np.ndarray) -> float:
        v = torch.as_tensor(vector).expand_as(end)
        head, tail = torch.where(is_tail[:, None], end, v), torch.where(is_tail[:, None], v, end)
        score = theta0.model.score(head, row, tail).numpy()
        loss = abs(weight) @ np.logaddexp(0, -np.sign(weight) * score)
        apart = vector - mean
        return float(loss + strength / 2 * apart @ np.linalg.solve(sigma, apart))

    return objective


@pytest.mark.parametrize("known_negatives", [0.0, 2.0])
@pytest.mark.parametrize("name", LINEAR)
def test_map_is_what_a_general_minimizer_finds(name: str, known_negatives: float) -> None:
    of = four_novel(model_named(name))
    result, mean = insert("map", of, **MEAN | {"known_negatives": known_negatives}), mean_of(of)
    for place in (0, 1, 3):
        plain = plain_objective(of, place, mean, 3, 0.5, known_negatives)
        best = scipy.optimize.minimize(plain, mean, method="BFGS", options={"gtol": 1e-7})
        np.testing.assert_allclose(result.vectors[0, place], best.x, atol=2e-4)
        assert plain(result.vectors[0, place].double().numpy()) <= best.fun + 1e-6


@pytest.mark.parametrize("constraint", ["sphere", "ball"])
@pytest.mark.parametrize("name", LINEAR)
def test_map_under_a_constraint_is_what_a_general_minimizer_finds_there(
    name: str, constraint: str
) -> None:
    of = four_novel(model_named(name, constraint=constraint))
    model, mean = of.theta0.model, mean_of(of)
    vectors = insert("map", of, **MEAN).vectors[0].double()
    lengths = vectors.norm(dim=-1)
    assert (lengths <= 1 + 1e-6).all()
    if constraint == "sphere":
        torch.testing.assert_close(lengths, torch.ones_like(lengths), rtol=0, atol=1e-6)
    for place in (0, 1, 3):
        plain = plain_objective(of, place, mean, 3, 0.5, 2.0)

        def constrained(
            vector: np.ndarray, objective: Callable[[np.ndarray], float] = plain
        ) -> float:
            return objective(model.constrain(torch.as_tensor(vector)).numpy())

        found = vectors[place].numpy()
        for start in (found, mean):
            best = scipy.optimize.minimize(constrained, start, method="BFGS")
            assert plain(found) <= best.fun + 1e-4
        afterwards = model.constrain(insert("map", four_novel(model_named(name)), **MEAN).vectors)
        assert plain(found) <= plain(afterwards[0, place].double().numpy()) + 1e-6


@pytest.mark.parametrize(("name", "options"), DISTANCES)
def test_no_step_along_the_sphere_makes_map_of_a_distance_better(
    name: str, options: dict[str, Option]
) -> None:
    of = four_novel(model_named(name, **options, constraint="sphere"))
    mean = torch.from_numpy(mean_of(of)).expand(1, 4, -1)
    (problem,) = maximum.problems(of, evidence_of(of, 3, 2.0), mean, 0.5)
    at = insert("map", of, **MEAN).vectors[0].double()
    here = problem.objective(problem.log_odds(at), at)
    for step in torch.randn(50, *at.shape, generator=torch.Generator().manual_seed(0)).double():
        there = of.theta0.model.constrain(at + 0.05 * step)
        assert (problem.objective(problem.log_odds(there), there) > here - 1e-4).all()


SOFT: dict[str, Option] = {"word_weight": 4.0, "relation_weight": 2.0}
PRIORS: list[tuple[str, str, dict[str, Option], dict[str, Option]]] = [
    ("map_own_facts", "soft_hybrid", SOFT, OWN),
    ("map", "soft_hybrid", SOFT, OWN | {"known_negatives": 2.0}),
]


@pytest.mark.parametrize(("name", "prior", "options", "objective"), PRIORS)
def test_map_is_its_prior_where_that_is_strong_or_there_is_no_insert_triple(
    of: InitContext, name: str, prior: str, options: dict[str, Option], objective: dict[str, Option]
) -> None:
    around = insert(prior, of, **options)
    strong = insert(name, of, **options | objective | {"strength": 1e9})
    torch.testing.assert_close(strong.vectors, around.vectors, atol=1e-5, rtol=0)
    weak = insert(name, of, **options | objective)
    assert torch.equal(weak.vectors[0, 2], around.vectors[0, 2])  # it has no insert triple
    assert ((weak.vectors - around.vectors)[0, [0, 1, 3]].norm(dim=-1) > 0.01).all()
    expected = {"map": [None, None, "es", None]}
    assert fallbacks(weak) == expected.get(name, fallbacks(around))


def test_without_known_negatives_map_is_map_of_own_facts(of: InitContext) -> None:
    whole = insert("map", of, **SOFT, **OWN, known_negatives=0.0)
    assert torch.equal(whole.vectors, insert("map_own_facts", of, **SOFT, **OWN).vectors)
    assert not torch.allclose(
        whole.vectors, insert("map", of, **SOFT, **OWN, known_negatives=1.0).vectors
    )


def test_a_fact_counts_as_much_as_it_is_believed(of: InitContext) -> None:
    half = torch.where(of.relation == 0, 0.5, 1.0).double()
    believed = evidence_of(replace(of, confidence=half), 4, 1.0)
    whole = evidence_of(of, 4, 1.0)
    weights = (half * of.observed)[..., None]
    positive = dense(believed, believed.positive)
    assert positive.sum() == pytest.approx(weights.sum())
    # known triples stay; corrupted ones weigh as the fact that they stem from
    fewer = whole.negative.sum() - believed.negative.sum()
    assert fewer == pytest.approx(2 * 4 * (of.observed.sum() - weights.sum()))


def test_entities_are_solved_alike_in_batches_of_any_size(
    of: InitContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = insert("map", of, **MEAN).vectors
    monkeypatch.setattr(maximum, "BUDGET", 1)
    torch.testing.assert_close(insert("map", of, **MEAN).vectors, expected)


def test_an_optimum_does_not_depend_on_where_it_is_sought(of: InitContext) -> None:
    expected = insert("map", of, **MEAN).vectors
    elsewhere = replace(of, start=torch.randn(expected.shape))
    torch.testing.assert_close(insert("map", elsewhere, **MEAN).vectors, expected)


@pytest.mark.parametrize(("name", "options"), DISTANCES)
def test_map_of_a_distance_gains_on_its_prior_and_leaves_little_gradient(
    name: str, options: dict[str, Option]
) -> None:
    of = four_novel(model_named(name, **options))
    around, result = insert("mean", of), insert("map", of, **MEAN)
    (problem,) = maximum.problems(of, evidence_of(of, 3, 2.0), around.vectors, 0.5)
    at = torch.stack([around.vectors[0], result.vectors[0]]).double().requires_grad_()
    before, after = (problem.objective(problem.log_odds(vectors), vectors) for vectors in at)
    assert (after[[0, 1, 3]] < before[[0, 1, 3]]).all()
    assert torch.equal(result.vectors[0, 2], around.vectors[0, 2])
    gradients = torch.autograd.grad(before.sum() + after.sum(), at)[0].abs()
    assert gradients[1].max() < 0.05 * gradients[0].max()


@pytest.mark.parametrize(("name", "options"), [*((name, {}) for name in LINEAR), *DISTANCES])
def test_scores_by_mapped_ends_and_their_slopes_are_those_of_the_model_and_autograd(
    name: str, options: dict[str, Option]
) -> None:
    model, (models, triples) = model_named(name, **options), (4, 30)
    draw = torch.Generator().manual_seed(3)
    other, relation, at = (
        torch.randn(*shape, generator=draw)
        for shape in (
            (models, triples, DIMENSION),
            (models, triples, model.width(DIMENSION)),
            (models, DIMENSION),
        )
    )
    is_tail = torch.rand(models, triples, 1, generator=draw) < 0.5
    novel = at[:, None].repeat(1, triples, 1).requires_grad_()
    scores = model.score(
        torch.where(is_tail, other, novel), relation, torch.where(is_tail, novel, other)
    )
    (slopes,) = torch.autograd.grad(scores.sum(), novel)
    fast = maximum.score_of(model, is_tail, relation, other)
    torch.testing.assert_close(fast.scores(at), scores.detach(), atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(fast.slopes(at), slopes, atol=1e-4, rtol=1e-4)


def test_a_step_is_halved_until_it_makes_nothing_worse() -> None:
    """With a strong prior the objective is nearly a parabola,
    on which n times the Newton step raises it for n > 2.
    """
    of = four_novel(model_named("distmult"))
    (problem,) = maximum.problems(of, evidence_of(of, 3, 0.0), insert("mean", of).vectors, 1000)
    at, score = problem.mean, problem.log_odds(problem.mean)
    step, _ = newton_step(problem, at, score, problem.slopes(at))
    for times, share in ((0, 1), (1, 1), (3, 1 / 2), (6, 1 / 4), (12, 1 / 8)):
        expected = [share, share, 1, share]  # the third has no insert triples, hence a zero step
        shares, decrease = step_size(problem, at, score, times * step)
        assert shares.tolist() == expected
        there = at + shares[:, None] * times * step
        lower = problem.objective(score, at) - problem.objective(problem.log_odds(there), there)
        torch.testing.assert_close(decrease, lower)


def test_known_vectors_that_do_not_differ_name_their_models() -> None:
    of = sample_context(ANALOGY, 4)
    same = torch.isin(torch.arange(4), torch.tensor([1, 3]))[:, None, None]
    with pytest.raises(NotFinite) as failed:
        insert(
            "map",
            replace(of, theta0=replace(of.theta0, entity=of.theta0.entity.masked_fill(same, 0))),
            **MEAN,
        )
    assert failed.value.models == [1, 3]
    assert "no covariance" in failed.value.message
