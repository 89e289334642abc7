"""Baselines beyond the paper: against values by hand, SciPy and NumPy,
and at the limits of their options.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import cosine_similarity

from isi.errors import InputError
from isi.initializers import similarity
from isi.initializers.api import InitContext
from isi.initializers.paper import DEAD, alive, permuted_words, standard_normal
from tests.init_contexts import (
    DIMENSION,
    DISTANCES,
    ENTITIES,
    EVERYONE,
    KNOWN,
    fallbacks,
    four_novel,
    insertion,
    model_named,
)
from tests.init_contexts import initialize as insert
from tests.small_graphs import dense, random_embedding


@pytest.fixture
def of() -> InitContext:
    return four_novel()


def mean_of(of: InitContext, *entities: int) -> Tensor:
    return of.theta0.entity[0, list(entities)].mean(0)


def test_kind_mean_is_the_centroid_of_the_known_of_the_kind(of: InitContext) -> None:
    result = insert("kind_mean", of)
    expected = [mean_of(of, 1, 2, 3), mean_of(of, 4, 6, 7), mean_of(of, 8), mean_of(of, 10)]
    torch.testing.assert_close(result.vectors[0], torch.stack(expected))
    assert fallbacks(result) == [None] * 4
    alone = replace(of, kinds=torch.where(torch.arange(ENTITIES) == 5, 7, of.kinds))
    result = insert("kind_mean", alone)
    assert fallbacks(result) == [None, "centroid", None, None]
    torch.testing.assert_close(result.vectors[0, 1], mean_of(of, *KNOWN))


@pytest.mark.parametrize("name", ["es_permuted", "es_permuted_kinds"])
def test_an_entity_with_a_key_of_its_own_has_the_same_vector_among_others(
    of: InitContext, name: str
) -> None:
    together = replace(of, entity_keys=torch.tensor([[7, 8, 9, 6]]))
    vectors = insert(name, together, k=2).vectors
    for place, entity in enumerate(of.novel[0].tolist()):
        others = [other for other in of.novel[0].tolist() if other != entity]
        alone = replace(
            together,
            novel=of.novel[:, [place]],
            words=of.words.index_fill(0, torch.tensor(others), 0.0),
            other=of.other[:, [place]],
            relation=of.relation[:, [place]],
            novel_is_tail=of.novel_is_tail[:, [place]],
            observed=of.observed[:, [place]],
            entity_keys=together.entity_keys[:, [place]],  # type: ignore[index]
        )
        torch.testing.assert_close(insert(name, alone, k=2).vectors[0, 0], vectors[0, place])


@pytest.mark.parametrize("name", ["es_permuted_kinds", "es_permuted"])
def test_es_permuted_is_es_with_words_dealt_within_kinds_or_all_entities(
    of: InitContext, name: str
) -> None:
    """How words are dealt: ``test_purposes``."""
    together = of.kinds if name == "es_permuted_kinds" else torch.zeros_like(of.kinds)
    (dealt,) = permuted_words(of, name, together)
    assert not torch.equal(permuted_words(replace(of, root=1), name, together)[0], dealt)
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
    twice = insertion(
        of.theta0, [0], [[(1, 0, False), (1, 2, False), (4, 1, True)]], of.words, of.kinds.tolist()
    )
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
    mean = (
        entity[1]
        - relation[0]
        + entity[2]
        - relation[0]
        + entity[3]
        - relation[2]
        + entity[4]
        + relation[1]
    ) / 4
    torch.testing.assert_close(insert("er_avg", step).vectors[0, 0], mean)


def test_class_noise_is_the_kind_mean_and_its_deviation(of: InitContext) -> None:
    centre, drawn = insert("kind_mean", of), standard_normal(of)
    assert torch.equal(insert("class_noise", of, fraction=0.0).vectors, centre.vectors)
    result = insert("class_noise", of, fraction=0.5)
    deviation = of.theta0.entity[0, [1, 2, 3]].numpy().std(0)
    expected = centre.vectors[0, 0].numpy() + 0.5 * deviation * drawn[0, 0].numpy()
    np.testing.assert_allclose(result.vectors[0, 0], expected, atol=1e-5)
    # of a kind with one known entity
    assert torch.equal(result.vectors[0, 2], centre.vectors[0, 2])
    other = insert("class_noise", replace(of, keys=of.keys + 1), fraction=0.5)
    assert (other.vectors[0, 0] != result.vectors[0, 0]).all()


def test_projection_is_ridge_regression_on_unit_word_vectors(of: InitContext) -> None:
    result = insert("projection", of, penalty=0.7)
    words = of.words.double().numpy()
    words /= np.maximum(np.linalg.norm(words, axis=1, keepdims=True), 1e-12)
    entity, known = of.theta0.entity[0].double().numpy(), list(KNOWN)
    inputs, outputs = words[known] - words[known].mean(0), entity[known] - entity[known].mean(0)
    rows = (
        np.concatenate([inputs, np.sqrt(0.7) * np.eye(6)]),
        np.concatenate([outputs, np.zeros((6, DIMENSION))]),
    )
    slopes = np.linalg.lstsq(*rows, rcond=None)[0]
    expected = entity[known].mean(0) + (words[[0, 5, 9]] - words[known].mean(0)) @ slopes
    np.testing.assert_allclose(result.vectors[0, :3], expected, atol=1e-5)
    assert fallbacks(result) == [None, None, None, "centroid"]
    torch.testing.assert_close(result.vectors[0, 3], mean_of(of, *KNOWN))
    far = insert("projection", of, penalty=1e9).vectors[0, :3]
    torch.testing.assert_close(far, mean_of(of, *KNOWN).expand(3, -1), atol=1e-5, rtol=0)


def test_the_mean_relational_score_is_a_mean_over_the_relations_seen(of: InitContext) -> None:
    entity, maps = of.theta0.entity[0], [dense(row) for row in of.theta0.relation[0]]
    there, back = (
        entity[4] @ maps[1],
        [entity[1] @ torch.linalg.inv(maps[0]), entity[2] @ torch.linalg.inv(maps[0])],
    )
    alphas = [(back[0] + back[1]) / 2, there, entity[3] @ torch.linalg.inv(maps[2])]
    expected = torch.stack([cosine_similarity(alpha, entity) for alpha in alphas]).mean(0)
    result = similarity.mean_relational_score(of)[0]
    torch.testing.assert_close(result[0], expected, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(
        result[1], cosine_similarity(entity[7] @ maps[1], entity), atol=1e-5, rtol=1e-4
    )
    assert (result[2] == 0).all()


def test_the_soft_hybrid_with_one_weight_is_that_similarity_alone(of: InitContext) -> None:
    words = insert("soft_hybrid", of, word_weight=5.0, relation_weight=0.0)
    torch.testing.assert_close(
        words.vectors[0, :3], insert("soft_es", of, temperature=0.2).vectors[0, :3]
    )
    relations = insert("soft_hybrid", of, word_weight=0.0, relation_weight=5.0)
    torch.testing.assert_close(
        relations.vectors[0, :2], insert("soft_rs", of, temperature=0.2).vectors[0, :2]
    )
    both = insert("soft_hybrid", of, word_weight=5.0, relation_weight=3.0)
    logits = (
        5 * cosine_similarity(of.words[0], of.words)
        + 3 * similarity.mean_relational_score(of)[0, 0]
    )
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


@pytest.mark.parametrize(
    "name",
    [
        *("soft_es", "soft_rs", "neighbour_mean", "er_avg", "soft_hybrid", "projection"),
        *("ridge", "map_mean", "map_ers", "map_own_facts", "map", "rs_alive"),
    ],
)
def test_without_words_triples_or_eligible_entities_it_is_the_centroid(
    of: InitContext, name: str
) -> None:
    bare = replace(of, words=torch.zeros_like(of.words), observed=torch.zeros_like(of.observed))
    without = replace(of, eligible=torch.zeros_like(of.eligible))
    for context in [bare, *[without] * name.startswith("soft")]:
        result = insert(name, context, **EVERYONE[name])
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


def test_dead_blocks_are_dead_in_both_coordinates_and_translations_never_die() -> None:
    theta0 = random_embedding(1, 3, 2, DIMENSION)
    theta0.relation[0, 1, [4, 6]] = DEAD / 3  # a block's x and y: its places are 4 and 6
    assert (~alive(theta0)).nonzero().tolist() == [[0, 1, 4], [0, 1, 6]]
    theta0 = random_embedding(1, 3, 2, DIMENSION, model=model_named("distmult"))
    theta0.relation[0, 1, 4] = DEAD  # just alive
    assert alive(theta0).all()
    for name, options in DISTANCES:
        with pytest.raises(InputError, match="linear"):
            insert("ridge", four_novel(model_named(name, **options)), **EVERYONE["ridge"])
        assert alive(random_embedding(1, 3, 2, DIMENSION, model=model_named(name, **options))).all()
