"""``Inserted.probability``: calibrated on hidden known entities,
against loops over the queries and known answers.
"""

from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

import isi
from isi.errors import InputError
from isi.evaluation import platt
from isi.evaluation.platt import PlattCurve, fit_platt
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.initializers.api import INITIALIZERS, InitResult, initializer, without_weights
from isi.initializers.context import InitContext
from isi.insertion.hidden import HiddenDraws
from isi.insertion.probability import LEAST_RIGHT
from isi.insertion.result import Inserted

KNOWN, RELATIONS, DIMENSION, NEW = 40, 3, 16, 40
RNG = np.random.default_rng(0)
#: The last is the best of the new entity.
VECTORS = RNG.standard_normal((KNOWN + 1, DIMENSION)).astype(np.float32)
MAPS = RNG.standard_normal((RELATIONS, DIMENSION)).astype(np.float32)
SCORES = np.einsum("hd,rd,td->hrt", VECTORS, MAPS, VECTORS)
TRUE = np.argwhere(np.quantile(SCORES, 0.9) < SCORES)
OF_KNOWN = TRUE[(TRUE[:, [HEAD, TAIL]] < KNOWN).all(1)]
OF_NEW = TRUE[(TRUE[:, [HEAD, TAIL]] == NEW).sum(1) == 1]
MAP = INITIALIZERS.get("map")
ALL_OF_NEW = np.array(
    [row for row in np.ndindex(SCORES.shape) if (row[HEAD] == NEW) != (row[TAIL] == NEW)]
)


@pytest.fixture(autouse=True)
def oracle(few_initializers: None) -> None:  # noqa: ARG001
    """An initializer that knows the best vectors."""

    @initializer("oracle", cost="entities")
    def function(context: InitContext) -> InitResult:
        return without_weights(torch.from_numpy(VECTORS)[context.novel])


def insert(triples: Any = OF_NEW[:4], **changed: Any) -> Inserted:
    given = {"new": 1, "model": "distmult", "known_triples": OF_KNOWN, **changed}
    return isi.insert(VECTORS[:KNOWN], MAPS, triples, **given)


def cells(draws: HiddenDraws, vectors: np.ndarray) -> Iterator[tuple[int, float, bool]]:
    """Relation, score and truth of each answer, in loops over the queries;
    ``vectors``: (M, n, d).
    """
    true, context = set(map(tuple, OF_KNOWN.tolist())), draws.context
    for model, hidden in enumerate(context.novel.tolist()):
        table, answers = VECTORS[:KNOWN].copy(), set()
        table[hidden] = vectors[model]
        for triple in draws.about.triples[model][draws.about.counted[model]].tolist():
            for slot in (HEAD, TAIL):
                for entity in range(KNOWN):
                    answer = [*triple[:slot], entity, *triple[slot + 1 :]]
                    if (answer[HEAD] in hidden) != (answer[TAIL] in hidden):
                        answers.add(tuple(answer))
        for place, entity in enumerate(hidden):
            rows = context.observed[model, place]
            ends, labels, is_tail = (
                getattr(context, name)[model, place][rows].tolist()
                for name in ("other", "relation", "novel_is_tail")
            )
            for end, relation, last in zip(ends, labels, is_tail, strict=True):
                answers.discard((end, relation, entity) if last else (entity, relation, end))
        for head, relation, tail in answers:
            yield (
                relation,
                float(table[head] @ (MAPS[relation] * table[tail])),
                (head, relation, tail) in true,
            )


def test_curves_go_through_the_answers_about_hidden_entities() -> None:
    done = insert()
    draws = done.details.test.hide()
    assert draws is not None
    assert draws.context.novel.numel() == done.selection.hidden
    vectors = (
        INITIALIZERS.get(done.initializer, "")
        .initialize(draws.context, done.details.options)
        .vectors.numpy()
    )
    by_relation = defaultdict[int, list[tuple[float, bool]]](list)
    for relation, score, right in cells(draws, vectors):
        by_relation[relation].append((score, right))
    assert set(by_relation) == set(range(RELATIONS))
    for relation, answers in by_relation.items():
        scores, right = map(np.array, zip(*answers, strict=True))
        assert int(right.sum()) >= LEAST_RIGHT
        expected = fit_platt(scores, right)
        triples = ALL_OF_NEW[ALL_OF_NEW[:, RELATION] == relation]
        theta = done.details.embedding.entity[0].numpy()
        of_triples = (theta[triples[:, HEAD]] * MAPS[relation] * theta[triples[:, TAIL]]).sum(1)
        np.testing.assert_allclose(
            done.probability(triples), expected(of_triples), rtol=1e-3, atol=1e-5
        )


def test_with_perfect_vectors_true_triples_are_probable_and_others_are_not() -> None:
    done = insert()
    assert done.initializer == "oracle"
    probabilities, score = done.probability(ALL_OF_NEW), SCORES[tuple(ALL_OF_NEW.T)]
    is_true, near = score > np.quantile(SCORES, 0.9), abs(score - np.quantile(SCORES, 0.9)) < 1
    assert probabilities[is_true & ~near].min() > 0.9
    assert probabilities[~is_true & ~near].max() < 0.1


@pytest.mark.parametrize("named", [None, "soft_rs", "mean"])
def test_of_one_relation_a_higher_score_is_as_probable_or_more(named: str | None) -> None:
    done = insert(initializer=named)
    vectors = done.details.embedding.entity[0].numpy()
    for relation in range(RELATIONS):
        triples = ALL_OF_NEW[ALL_OF_NEW[:, RELATION] == relation]
        score = (vectors[triples[:, HEAD]] * MAPS[relation] * vectors[triples[:, TAIL]]).sum(1)
        probability = done.probability(triples)[np.argsort(score)]
        assert (np.diff(probability) >= -1e-6).all()
        assert ((probability > 0) & (probability < 1)).all()


def test_names_ids_and_tables_of_triples_give_the_same_in_their_order_with_duplicates() -> None:
    entities, labels = [f"e{row}" for row in range(KNOWN)], ["near", "like", "part of"]
    done = insert(new=["lamp"], entity_names=entities, relation_names=labels)
    triples = np.array([[NEW, 0, 3], [5, 2, NEW], [NEW, 0, 3], [NEW, 1, NEW]])
    entities = [*entities, "lamp"]
    named = [
        (entities[head], labels[relation], entities[tail])
        for head, relation, tail in triples.tolist()
    ]
    expected = done.probability(triples)
    assert expected.shape == (4,)
    assert expected[0] == pytest.approx(expected[2])
    for form in (named, triples.tolist(), torch.from_numpy(triples), pd.DataFrame(named)):
        np.testing.assert_array_equal(done.probability(form), expected)
    assert done.probability({"lamp": {"near": "e3"}}) == pytest.approx(expected[0])
    assert done.probability([]).shape == (0,)


@pytest.mark.parametrize("changed", [{"choose": False}, {"initializer": "map"}])
def test_without_a_choice_the_same_known_entities_are_hidden(changed: dict[str, Any]) -> None:
    INITIALIZERS.register("map", MAP)
    given = changed, {}, {"initializer": "map"}
    done, chosen, named = (insert(trained_with="logistic", **each) for each in given)
    assert done.selection is None
    draws, others = (
        done.details.test.hide(),
        chosen.details.test.hide(),
    )
    assert draws is not None
    assert others is not None
    assert torch.equal(draws.context.novel, others.context.novel)
    np.testing.assert_array_equal(done.probability(ALL_OF_NEW), named.probability(ALL_OF_NEW))
    perfect = insert(initializer="oracle", trained_with="logistic")
    np.testing.assert_array_equal(perfect.probability(OF_NEW), chosen.probability(OF_NEW))


def test_relations_with_few_right_answers_and_new_ones_share_a_curve() -> None:
    rare = np.array([[0, 3, 1], [2, 3, 3], [4, 3, 5]])
    done = isi.insert(
        VECTORS[:KNOWN],
        np.concatenate([MAPS, MAPS[:1]]),
        [*OF_NEW[:4].tolist(), [NEW, 4, 3]],
        new=1,
        new_relations=1,
        model="distmult",
        known_triples=np.concatenate([OF_KNOWN, rare]),
    )
    assert set(done.details.curves.of_relation) == {0, 1, 2}
    triples = np.array([[NEW, relation, 7] for relation in (3, 4)])
    score = done.details.embedding.score(*torch.from_numpy(triples).T[:, None])[0].numpy()
    np.testing.assert_array_equal(done.probability(triples), done.details.curves.of_all(score))
    assert isinstance(done.details.curves.of_all, PlattCurve)


def test_some_of_many_unknown_answers_represent_all(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    known = np.arange(4040) < 40
    scores = rng.normal(np.where(known, 2.0, 0.0))
    whole = fit_platt(scores, known)
    monkeypatch.setattr(platt, "MOST_UNKNOWN", 500)
    thinned = fit_platt(scores, known)
    assert thinned != whole
    assert thinned.slope == pytest.approx(whole.slope, rel=0.02)
    assert thinned.offset == pytest.approx(whole.offset, rel=0.02)


def test_what_cannot_have_a_probability_is_refused() -> None:
    with pytest.raises(InputError, match="triple 1") as refused:
        insert().probability([(NEW, 0, 3), (4, 0, 5)])
    assert refused.value.file == "argument 'triples'"
    for few in (None, OF_KNOWN[:5]):
        with pytest.raises(InputError) as refused:
            insert(known_triples=few).probability([(NEW, 0, 3)])
        assert refused.value.file == "argument 'known_triples'"


def test_an_initializer_without_finite_vectors_of_hidden_entities_gives_no_probability() -> None:
    @initializer("broken", cost="entities")
    def function(context: InitContext) -> InitResult:
        novel = torch.where(context.novel[..., None] == NEW, 1.0, torch.nan)
        return without_weights(novel.expand(-1, -1, DIMENSION))

    with pytest.raises(InputError, match="broken"):
        insert(initializer="broken").probability(OF_NEW)
