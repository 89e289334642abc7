"""Baselines beyond the paper: against values by hand, SciPy and NumPy, and at the limits of their options."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.nn.functional import cosine_similarity

from isi.config import Option
from isi.errors import InputError
from isi.initializers import map as evidence
from isi.initializers import similarity
from isi.initializers.api import FALLBACKS, InitContext, InitResult
from isi.initializers.paper import DEAD, alive, permuted_words, standard_normal
from isi.models.model import Model, make_model
from isi.models.stack import NotFinite, mapped
from tests.init_contexts import DIMENSION, ENTITIES, four_novel, insertion, stacked
from tests.init_contexts import initialize as insert
from tests.small_graphs import dense, random_embedding, score_all

LINEAR = ("analogy", "complex", "distmult")
DISTANCES: list[tuple[str, dict[str, Option]]] = [
    ("transe", {"margin": 2.0, "squared": True}), ("transe", {"margin": 2.0, "squared": False}),
    ("rotate", {"margin": 4.0, "squared": True}), ("rotate", {"margin": 4.0, "squared": False}),
]  # fmt: skip
MAP = {"strength": 0.5, "ratio": 3}


def model_named(name: str, **options: Option) -> Model:
    return make_model(name, options, f"models.{name}")


def fallbacks(result: InitResult) -> list[str | None]:
    return [FALLBACKS[code] for code in result.fallback[0].tolist()]


def mean_of(of: InitContext, *entities: int) -> Tensor:
    return of.theta0.entity[0, list(entities)].mean(0)


KNOWN = (1, 2, 3, 4, 6, 7, 8, 10)


@pytest.fixture
def of() -> InitContext:
    return four_novel()


def test_kind_mean_is_the_centroid_of_the_known_of_the_kind(of: InitContext) -> None:
    result = insert("kind_mean", of)
    expected = [mean_of(of, 1, 2, 3), mean_of(of, 4, 6, 7), mean_of(of, 8), mean_of(of, 10)]
    torch.testing.assert_close(result.vectors[0], torch.stack(expected))
    assert fallbacks(result) == [None] * 4
    alone = replace(of, kinds=torch.where(torch.arange(ENTITIES) == 5, 7, of.kinds))
    result = insert("kind_mean", alone)
    assert fallbacks(result) == [None, "centroid", None, None]
    torch.testing.assert_close(result.vectors[0, 1], mean_of(of, *KNOWN))


@pytest.mark.parametrize(
    ("name", "kinds"),
    [("es_permuted_kinds", [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 3, 4]), ("es_permuted", [0] * 11 + [4])],  # 11 has no word
)
def test_es_permuted_is_es_with_words_dealt_evenly_within_kinds_or_all_entities(
    of: InitContext, name: str, kinds: list[int]
) -> None:
    together = of.kinds if name == "es_permuted_kinds" else torch.zeros_like(of.kinds)
    keys = torch.tensor([[5, seed] for seed in range(400)])
    many = replace(of, novel=of.novel.expand(400, -1), keys=keys)
    permuted = permuted_words(many, name, together)
    assert (permuted.sort(1).values == torch.arange(ENTITIES)).all()
    chances = (torch.tensor(kinds)[:, None] == torch.tensor(kinds)).float()
    chances /= chances.sum(1)
    shares = (permuted[..., None] == torch.arange(ENTITIES)).float().mean(0)
    assert ((shares - chances).abs() <= 5 * (chances * (1 - chances) / 400) ** 0.5).all()
    assert torch.equal(permuted_words(replace(many, keys=keys.flip(0)), name, together).flip(0), permuted)
    assert (permuted_words(replace(many, root=1), name, together) != permuted).any(1).sum() > 300
    (dealt,) = permuted_words(of, name, together)
    for k in (1, 3):
        result = insert(name, of, k=k)
        expected = insert("es", replace(of, words=of.words[dealt]), k=k)
        assert torch.equal(result.vectors, expected.vectors)
        assert torch.equal(result.fallback, expected.fallback)


def test_neighbour_mean_counts_an_end_as_often_as_it_is_named(of: InitContext) -> None:
    result = insert("neighbour_mean", of)
    expected = [mean_of(of, 1, 2, 3, 4), mean_of(of, 7), mean_of(of, *KNOWN), mean_of(of, 2, 6)]
    torch.testing.assert_close(result.vectors[0], torch.stack(expected))
    assert fallbacks(result) == [None, None, "centroid", None]
    twice = insertion(of.theta0, [0], [[(1, 0, False), (1, 2, False), (4, 1, True)]], of.words, of.kinds.tolist())
    expected_mean = (2 * of.theta0.entity[0, 1] + of.theta0.entity[0, 4]) / 3
    torch.testing.assert_close(insert("neighbour_mean", twice).vectors[0, 0], expected_mean)


def test_er_avg_takes_known_ends_through_their_relations(of: InitContext) -> None:
    entity, maps = of.theta0.entity[0], [dense(row) for row in of.theta0.relation[0]]
    result = insert("er_avg", of)
    as_head = maps[0] @ entity[1] + maps[0] @ entity[2] + maps[2] @ entity[3]  # W t
    torch.testing.assert_close(result.vectors[0, 0], (as_head + entity[4] @ maps[1]) / 4)
    torch.testing.assert_close(result.vectors[0, 1], entity[7] @ maps[1])
    torch.testing.assert_close(result.vectors[0, 2], mean_of(of, *KNOWN))
    assert fallbacks(result) == [None, None, "centroid", None]
    step = four_novel(model_named("transe", margin=1.0, squared=True))
    entity, relation = step.theta0.entity[0], step.theta0.relation[0]
    mean = (entity[1] - relation[0] + entity[2] - relation[0] + entity[3] - relation[2] + entity[4] + relation[1]) / 4
    torch.testing.assert_close(insert("er_avg", step).vectors[0, 0], mean)


def test_class_noise_is_the_kind_mean_and_its_deviation(of: InitContext) -> None:
    centre, drawn = insert("kind_mean", of), standard_normal(of)
    assert torch.equal(insert("class_noise", of, fraction=0.0).vectors, centre.vectors)
    result = insert("class_noise", of, fraction=0.5)
    deviation = of.theta0.entity[0, [1, 2, 3]].numpy().std(0)
    expected = centre.vectors[0, 0].numpy() + 0.5 * deviation * drawn[0, 0].numpy()
    np.testing.assert_allclose(result.vectors[0, 0], expected, atol=1e-5)
    assert torch.equal(result.vectors[0, 2], centre.vectors[0, 2])  # of a kind with one known entity
    other = insert("class_noise", replace(of, keys=of.keys + 1), fraction=0.5)
    assert (other.vectors[0, 0] != result.vectors[0, 0]).all()


def test_projection_is_ridge_regression_on_unit_word_vectors(of: InitContext) -> None:
    result = insert("projection", of, penalty=0.7)
    words = of.words.double().numpy()
    words /= np.maximum(np.linalg.norm(words, axis=1, keepdims=True), 1e-12)
    entity, known = of.theta0.entity[0].double().numpy(), list(KNOWN)
    inputs, outputs = words[known] - words[known].mean(0), entity[known] - entity[known].mean(0)
    rows = np.concatenate([inputs, np.sqrt(0.7) * np.eye(6)]), np.concatenate([outputs, np.zeros((6, DIMENSION))])
    slopes = np.linalg.lstsq(*rows, rcond=None)[0]
    expected = entity[known].mean(0) + (words[[0, 5, 9]] - words[known].mean(0)) @ slopes
    np.testing.assert_allclose(result.vectors[0, :3], expected, atol=1e-5)
    assert fallbacks(result) == [None, None, None, "centroid"]
    torch.testing.assert_close(result.vectors[0, 3], mean_of(of, *KNOWN))
    far = insert("projection", of, penalty=1e9).vectors[0, :3]
    torch.testing.assert_close(far, mean_of(of, *KNOWN).expand(3, -1), atol=1e-5, rtol=0)


def test_the_mean_relational_score_is_a_mean_over_the_relations_seen(of: InitContext) -> None:
    entity, maps = of.theta0.entity[0], [dense(row) for row in of.theta0.relation[0]]
    there, back = entity[4] @ maps[1], [entity[1] @ torch.linalg.inv(maps[0]), entity[2] @ torch.linalg.inv(maps[0])]
    alphas = [(back[0] + back[1]) / 2, there, entity[3] @ torch.linalg.inv(maps[2])]
    expected = torch.stack([cosine_similarity(alpha, entity) for alpha in alphas]).mean(0)
    result = similarity.mean_relational_score(of)[0]
    torch.testing.assert_close(result[0], expected, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(result[1], cosine_similarity(entity[7] @ maps[1], entity), atol=1e-5, rtol=1e-4)
    assert (result[2] == 0).all()


def test_the_soft_hybrid_with_one_weight_is_that_similarity_alone(of: InitContext) -> None:
    words = insert("soft_hybrid", of, word_weight=5.0, relation_weight=0.0)
    torch.testing.assert_close(words.vectors[0, :3], insert("soft_es", of, temperature=0.2).vectors[0, :3])
    relations = insert("soft_hybrid", of, word_weight=0.0, relation_weight=5.0)
    torch.testing.assert_close(relations.vectors[0, :2], insert("soft_rs", of, temperature=0.2).vectors[0, :2])
    both = insert("soft_hybrid", of, word_weight=5.0, relation_weight=3.0)
    logits = 5 * cosine_similarity(of.words[0], of.words) + 3 * similarity.mean_relational_score(of)[0, 0]
    weight = torch.softmax(logits[list(KNOWN)], 0)
    torch.testing.assert_close(both.vectors[0, 0], weight @ of.theta0.entity[0, list(KNOWN)])


def test_soft_similarities_fall_back_to_what_there_is(of: InitContext) -> None:
    by_words, by_relations = (insert(name, of, temperature=0.2) for name in ("soft_es", "soft_rs"))
    assert fallbacks(by_words) == [None, None, None, "rs"]
    assert fallbacks(by_relations) == [None, None, "centroid", None]
    torch.testing.assert_close(by_words.vectors[0, 3], by_relations.vectors[0, 3])
    both = insert("soft_hybrid", of, word_weight=5.0, relation_weight=5.0)
    assert fallbacks(both) == [None, None, "es", "rs"]
    torch.testing.assert_close(both.vectors[0, 2], by_words.vectors[0, 2])
    torch.testing.assert_close(both.vectors[0, 3], by_relations.vectors[0, 3])


SOFT: dict[str, Option] = {"word_weight": 3.0, "relation_weight": 3.0}


@pytest.mark.parametrize(
    ("name", "options"),
    [("soft_es", {"temperature": 0.2}), ("soft_rs", {"temperature": 0.2}), ("neighbour_mean", {}), ("er_avg", {}),
     ("soft_hybrid", SOFT), ("projection", {"penalty": 1.0}), ("ridge", MAP), ("map_mean", MAP),
     ("map_ers", {"k": 2, "candidates": 4, **MAP}), ("map_soft_hybrid", SOFT | MAP), ("rs_alive", {"k": 2})],
)  # fmt: skip
def test_without_words_triples_or_eligible_entities_it_is_the_centroid(
    of: InitContext, name: str, options: dict[str, Option]
) -> None:
    bare = replace(of, words=torch.zeros_like(of.words), observed=torch.zeros_like(of.observed))
    contexts = [bare] + [replace(of, eligible=torch.zeros_like(of.eligible))] * name.startswith("soft")
    for context in contexts:
        result = insert(name, context, **options)
        assert fallbacks(result) == ["centroid"] * 4
        torch.testing.assert_close(result.vectors[0], mean_of(of, *KNOWN).expand(4, -1))


def test_dead_coordinates_take_no_part_in_rs() -> None:
    of = four_novel(model_named("distmult"))
    assert torch.equal(insert("rs_alive", of, k=3).vectors, insert("rs", of, k=3).vectors)
    relation = of.theta0.relation.clone()
    relation[0, 0, 3] = DEAD / 2  # a dead coordinate, whose inverse would dominate α
    dead = replace(of, theta0=replace(of.theta0, relation=relation))
    assert (~alive(dead.theta0)).nonzero().tolist() == [[0, 0, 3]]
    only = insertion(dead.theta0, [0], [[(1, 0, False)]], of.words, of.kinds.tolist())
    alpha = only.theta0.entity[0, 1] / relation[0, 0]
    alpha[3] = 0
    (nearest,) = insert("rs_alive", only, k=1).indicators[0, 0].nonzero().flatten().tolist()  # type: ignore[index]
    others = cosine_similarity(alpha, only.theta0.entity[0]) * only.known[0]
    assert nearest == int(others.argmax())
    assert not torch.equal(insert("rs", only, k=1).vectors, insert("rs_alive", only, k=1).vectors)


def test_dead_blocks_are_dead_in_both_coordinates_and_translations_and_rotations_never_die() -> None:
    theta0 = random_embedding(1, 3, 2, DIMENSION)
    theta0.relation[0, 1, [4, 6]] = DEAD / 3  # a block's x and y: its places are 4 and 6
    assert (~alive(theta0)).nonzero().tolist() == [[0, 1, 4], [0, 1, 6]]
    theta0 = random_embedding(1, 3, 2, DIMENSION, model=model_named("distmult"))
    theta0.relation[0, 1, 4] = DEAD  # just alive
    assert alive(theta0).all()
    for name, options in DISTANCES:
        with pytest.raises(InputError, match="linear"):
            insert("ridge", four_novel(model_named(name, **options)), **MAP)
        assert alive(random_embedding(1, 3, 2, DIMENSION, model=model_named(name, **options))).all()


def test_insert_triples_lie_in_cells_and_bring_negatives(of: InitContext) -> None:
    positive = similarity.insert_triple_table(of)
    cells = [(0, 0, 0, 1), (0, 0, 0, 2), (0, 0, 2, 3), (0, 1, 1, 4), (1, 1, 1, 7), (3, 0, 1, 2), (3, 1, 1, 6)]
    assert positive[0].nonzero().tolist() == sorted(map(list, cells))
    assert positive.sum() == 7
    negative = evidence.expected_negatives(of, positive, ratio=4)[0]
    assert (negative[..., [0, 5, 9, 11]] == 0).all()  # novel entities are no ends of corrupted triples
    assert negative.sum() == pytest.approx(7 * 2 * 4)
    one_relation = random_embedding(1, ENTITIES, 1, DIMENSION)  # which is never corrupted
    of = insertion(one_relation, [0], [[(1, 0, False), (4, 0, True)]], torch.ones(ENTITIES, 2), [0] * ENTITIES)
    assert evidence.expected_negatives(of, similarity.insert_triple_table(of), 4).sum() == pytest.approx(2 * 4)


@pytest.mark.parametrize("name", LINEAR)
def test_anchors_are_what_a_novel_vector_is_multiplied_with(name: str) -> None:
    theta0 = random_embedding(2, 5, 3, 8, model=model_named(name))
    assert theta0.model.linear
    at = torch.randn(2, 1, 8, generator=torch.Generator().manual_seed(3))
    cells = (at @ similarity.alpha_of_all_triples(theta0).mT)[:, 0].view(2, 2, 3, 5)
    scores = score_all(replace(theta0, entity=torch.cat([at, theta0.entity], 1)))
    torch.testing.assert_close(cells, torch.stack([scores[:, :, 0, 1:], scores[:, :, 1:, 0]], 1))
    torch.testing.assert_close(evidence.score_gradients(theta0, at), similarity.alpha_of_all_triples(theta0))


def plain_objective(
    of: InitContext, place: int, mean: np.ndarray, ratio: int, strength: float
) -> Callable[[np.ndarray], float]:
    """The objective of MAP for one novel entity, computed triple by triple from lists of true and corrupted triples."""
    theta0 = mapped(of.theta0, Tensor.double)
    known = [e for e in range(of.known.shape[1]) if of.known[0, e]]
    weighted: list[tuple[bool, int, int, float]] = []  # whether it is the tail, relation, other end, ± weight
    for other, relation, is_tail, there in zip(
        of.other[0, place].tolist(), of.relation[0, place].tolist(), of.novel_is_tail[0, place].tolist(),
        of.observed[0, place].tolist(), strict=True,
    ):  # fmt: skip
        if there:
            weighted.append((is_tail, relation, other, 1.0))
            weighted += [(is_tail, relation, end, -ratio / len(known)) for end in known]
            others = [r for r in range(theta0.relation.shape[1]) if r != relation]
            weighted += [(is_tail, r, other, -ratio / len(others)) for r in others]
    sigma = np.cov(theta0.entity[0, known].numpy().T, bias=True)
    share = evidence.SHRINKAGE
    sigma = (1 - share) * sigma + share * np.trace(sigma) / len(sigma) * np.eye(len(sigma))

    def objective(vector: np.ndarray) -> float:
        v, total = torch.as_tensor(vector), 0.0
        for is_tail, relation, other, weight in weighted:
            row, end = theta0.relation[0, relation], theta0.entity[0, other]
            score = float(theta0.model.score(end, row, v) if is_tail else theta0.model.score(v, row, end))
            total += abs(weight) * np.logaddexp(0, -score if weight > 0 else score)
        return total + strength / 2 * float((vector - mean) @ np.linalg.solve(sigma, vector - mean))

    return objective


@pytest.mark.parametrize("name", LINEAR)
def test_map_is_what_a_general_minimizer_finds(name: str) -> None:
    of = four_novel(model_named(name))
    result = insert("map_mean", of, **MAP)
    mean = mean_of(of, *KNOWN).double().numpy()
    for place in (0, 1, 3):
        plain = plain_objective(of, place, mean, 3, 0.5)
        best = scipy.optimize.minimize(plain, mean, method="BFGS", options={"gtol": 1e-7})
        np.testing.assert_allclose(result.vectors[0, place], best.x, atol=2e-4)
        assert plain(result.vectors[0, place].double().numpy()) <= best.fun + 1e-6


PRIORS: list[tuple[str, str, dict[str, Option]]] = [
    ("map_mean", "mean", {}), ("map_ers", "ers", {"k": 2, "candidates": 5}),
    ("map_soft_hybrid", "soft_hybrid", {"word_weight": 4.0, "relation_weight": 2.0}),
]  # fmt: skip


@pytest.mark.parametrize(("name", "prior", "options"), PRIORS)
def test_map_is_its_prior_where_that_is_strong_or_there_is_no_insert_triple(
    of: InitContext, name: str, prior: str, options: dict[str, Option]
) -> None:
    around = insert(prior, of, **options)
    strong = insert(name, of, **options, strength=1e9, ratio=3)
    torch.testing.assert_close(strong.vectors, around.vectors, atol=1e-5, rtol=0)
    weak = insert(name, of, **options, **MAP)
    assert torch.equal(weak.vectors[0, 2], around.vectors[0, 2])  # it has no insert triple
    assert ((weak.vectors - around.vectors)[0, [0, 1, 3]].norm(dim=-1) > 0.01).all()
    if prior != "mean":
        assert torch.equal(weak.fallback, around.fallback)
    else:
        assert fallbacks(weak) == [None, None, "centroid", None]


@pytest.mark.parametrize(("name", "options"), DISTANCES)
def test_map_of_a_distance_gains_on_its_prior_and_leaves_little_gradient(name: str, options: dict[str, Option]) -> None:
    of = four_novel(model_named(name, **options))
    around, result = insert("mean", of), insert("map_mean", of, **MAP)
    known, theta0 = evidence.evidence(of, around.vectors, 0.5, 3), mapped(of.theta0, Tensor.double)
    at = torch.stack([around.vectors, result.vectors]).double().requires_grad_()
    before, after = (evidence.objective(known, theta0, vectors)[0] for vectors in at)
    assert (after[[0, 1, 3]] < before[[0, 1, 3]]).all()
    assert torch.equal(result.vectors[0, 2], around.vectors[0, 2])
    gradients = torch.autograd.grad(before.sum() + after.sum(), at)[0].abs()
    assert gradients[1].max() < 0.05 * gradients[0].max()


def test_a_step_is_halved_until_it_makes_nothing_worse() -> None:
    """With a strong prior the objective is nearly a parabola, on which n times the Newton step raises it for n > 2."""
    of = four_novel(model_named("distmult"))
    theta0 = mapped(of.theta0, Tensor.double)
    known = evidence.evidence(of, insert("mean", of).vectors, 1000, 3)
    step, _ = evidence.newton(known, theta0, known.mean, similarity.alpha_of_all_triples(theta0))
    for times, share in ((0, 1), (1, 1), (3, 1 / 2), (6, 1 / 4), (12, 1 / 8)):
        expected = [share, share, 1, share]  # the third has no insert triples, hence a zero step
        assert evidence.step_size(known, theta0, known.mean, times * step)[0].tolist() == expected


def test_products_of_cells_are_the_same_in_parts_of_a_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    generator = torch.Generator().manual_seed(2)
    slopes, weight = torch.randn(2, 9, 4, generator=generator), torch.rand(2, 5, 9, generator=generator)
    expected = torch.einsum("mnk,mkd,mke->mnde", weight, slopes, slopes)
    for budget in (1, 72, 108, evidence.BUDGET):  # of one, two, three and all novel entities
        monkeypatch.setattr(evidence, "BUDGET", budget)
        torch.testing.assert_close(evidence.gram(slopes, weight), expected)


def test_ridge_is_weighted_least_squares_with_the_prior_as_further_rows(of: InitContext) -> None:
    result = insert("ridge", of, strength=0.4, ratio=3)
    mean, theta0 = mean_of(of, *KNOWN).double().numpy(), mapped(of.theta0, Tensor.double)
    sigma = evidence.covariance(of)[0].numpy()
    positive = similarity.insert_triple_table(of)
    negative = evidence.expected_negatives(of, positive, 3)
    root = np.linalg.cholesky(np.linalg.inv(sigma)).T * np.sqrt(0.4)
    for place in (0, 1, 3):
        rows, values = [root], [root @ mean]
        for weights, value in ((positive, 1.0), (negative, 0.0)):
            for end, relation, other in weights[0, place].nonzero().tolist():
                scale = float(weights[0, place, end, relation, other]) ** 0.5
                matrix, vector = dense(theta0.relation[0, relation]), theta0.entity[0, other]
                rows.append(scale * (vector @ matrix if end else matrix @ vector).numpy()[None])
                values.append(np.array([scale * value]))
        expected = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0]
        np.testing.assert_allclose(result.vectors[0, place], expected, atol=1e-4)
    assert fallbacks(result) == [None, None, "centroid", None]


@pytest.mark.parametrize("name", ["map_mean", "ridge"])
def test_known_vectors_that_do_not_differ_name_their_models(name: str) -> None:
    of = stacked(4)
    same = torch.isin(torch.arange(4), torch.tensor([1, 3]))[:, None, None]
    with pytest.raises(NotFinite) as failed:
        insert(name, replace(of, theta0=replace(of.theta0, entity=of.theta0.entity.masked_fill(same, 0))), **MAP)
    assert failed.value.models == [1, 3]
    assert "no covariance" in failed.value.message


@pytest.mark.parametrize("name", ["soft_es", "soft_rs"])
def test_soft_similarities_are_the_mean_at_high_and_the_nearest_at_low_temperature(of: InitContext, name: str) -> None:
    hot, cold = (insert(name, of, temperature=temperature).vectors[0, :2] for temperature in (1e6, 1e-4))
    torch.testing.assert_close(hot, mean_of(of, *KNOWN).expand(2, -1), atol=1e-5, rtol=0)
    torch.testing.assert_close(cold, insert(name.removeprefix("soft_"), of, k=1).vectors[0, :2])


@given(st.integers(0, 1000))
@settings(max_examples=10)
def test_the_covariance_is_that_of_the_known_shrunk_to_a_sphere(seed: int) -> None:
    of = four_novel(seed=seed)
    known = of.theta0.entity[0, list(KNOWN)].double().numpy()
    plain = np.cov(known.T, bias=True)
    result = evidence.covariance(of)[0].numpy()
    assert np.trace(result) == pytest.approx(np.trace(plain))
    away = result - (1 - evidence.SHRINKAGE) * plain
    np.testing.assert_allclose(away, np.eye(DIMENSION) * away[0, 0], atol=1e-12)
    assert np.linalg.eigvalsh(result).min() > 0
