"""Baselines beyond the paper: against values by hand, SciPy and NumPy,
and at the limits of their options.
"""

from dataclasses import replace

import pytest
import torch
from torch import Tensor
from torch.nn.functional import cosine_similarity

from isi.initializers import similarity
from isi.initializers.context import InitContext
from isi.initializers.paper import permuted_words
from tests.init_contexts import (
    ENTITIES,
    EVERYONE,
    KNOWN,
    fallbacks,
    four_novel,
    model_named,
)
from tests.init_contexts import initialize as insert
from tests.small_graphs import dense


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


def test_an_entity_with_a_key_of_its_own_has_the_same_vector_among_others(of: InitContext) -> None:
    together = replace(of, entity_keys=torch.tensor([[7, 8, 9, 6]]))
    vectors = insert("es_permuted", together, k=2).vectors
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
        (vector,) = insert("es_permuted", alone, k=2).vectors[0]
        torch.testing.assert_close(vector, vectors[0, place])


def test_es_permuted_is_es_with_dealt_words(of: InitContext) -> None:
    """How words are dealt: ``test_purposes``."""
    (dealt,) = permuted_words(of)
    assert not torch.equal(permuted_words(replace(of, root=1))[0], dealt)
    for k in (1, 3):
        result = insert("es_permuted", of, k=k)
        expected = insert("es", replace(of, words=of.words[dealt]), k=k)
        assert torch.equal(result.vectors, expected.vectors)
        assert torch.equal(result.fallback, expected.fallback)


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
    "name", ["soft_es", "soft_rs", "er_avg", "soft_hybrid", "map_own_facts", "map"]
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
