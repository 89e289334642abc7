"""ES, RS and ERS against a plain loop; fallbacks, ties, ranges, controls; and what no initializer may see."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pkgutil import iter_modules

import numpy as np
import pytest
import torch

from isi import initializers
from isi.config import Count, Option, read
from isi.errors import InputError
from isi.experiment.insert import with_vectors
from isi.graph.sessions import TEST, TRAIN, VALID
from isi.initializers import similarity
from isi.initializers.api import (
    FALLBACKS,
    INITIALIZERS,
    RS,
    InitContext,
    InitResult,
    initializer,
    options_of,
    without_weights,
)
from isi.initializers.controls import permuted_words
from isi.tables import paths
from tests.small_graphs import dense
from tests.worlds import (
    DIMENSION,
    ENTITIES,
    NOVEL,
    ORPHAN,
    RELATIONS,
    WORDLESS,
    World,
    insertion,
    seen,
    world,
)

EVERYONE: dict[str, dict[str, Option]] = {
    "xavier": {},
    "iu": {},
    "es": {"k": 3},
    "rs": {"k": 4},
    "ers": {"k": 2, "candidates": 5},
    "mean": {},
    "gaussian": {},
    "gaussian_centred": {},
    "es_permuted": {"k": 3},
    "kind_mean": {},
    "es_permuted_kinds": {"k": 3},
    "rs_alive": {"k": 4},
    "neighbour_mean": {},
    "er_avg": {},
    "class_noise": {"fraction": 0.5},
    "projection": {"penalty": 0.3},
    "soft_es": {"temperature": 0.2},
    "soft_rs": {"temperature": 0.1},
    "soft_hybrid": {"word_weight": 4.0, "relation_weight": 6.0},
    "ridge": {"strength": 0.5, "ratio": 3},
    "map_mean": {"strength": 0.5, "ratio": 3},
    "map_ers": {"k": 2, "candidates": 5, "strength": 0.5, "ratio": 3},
    "map_soft_hybrid": {"word_weight": 4.0, "relation_weight": 6.0, "strength": 0.5, "ratio": 3},
}
CENTROIDS = ("es", "rs", "ers", "mean", "es_permuted", "kind_mean", "es_permuted_kinds", "rs_alive")

#: Plain Python: α of an insert triple needs its known end, relation, and whether the novel entity is the tail.
Observed = tuple[int, int, bool]


def insert(name: str, given: InitContext, **options: Option) -> InitResult:
    return INITIALIZERS.get(name, "initializers").initialize(given, options)


def initial(name: str, given: InitContext) -> InitResult:
    return insert(name, given, **EVERYONE[name])


class Plain:
    """Section 4 for one novel entity of one model, with dictionaries and loops."""

    def __init__(self, of: World, model: int, place: int) -> None:
        self.novel = set(NOVEL[model].tolist())
        self.entity = int(NOVEL[model, place])
        self.vectors = [row.astype(float) for row in of.theta0.entity[model].numpy()]
        self.maps = [dense(row).double().numpy() for row in of.theta0.relation[model]]
        self.words = {e: row.astype(float) for e, row in enumerate(of.words) if row.any()}
        triples = of.graph.triples.tolist()
        self.known = [e for e in range(ENTITIES) if e not in self.novel]
        trained = set()
        for (head, _, tail), split in zip(triples, of.splits[model], strict=True):
            if split == TRAIN and not {head, tail} & self.novel:
                trained |= {head, tail}
        self.eligible = sorted(trained)
        own = [triples[triple] for m, p, triple in of.insert_triples.tolist() if (m, p) == (model, place)]
        self.observed: list[Observed] = [(h, r, True) if t == self.entity else (t, r, False) for h, r, t in own]

    def similar(self) -> dict[int, float]:
        return {e: cosine(self.words[self.entity], self.words[e]) for e in self.eligible if e in self.words}

    def related(self) -> dict[int, float]:
        score = dict.fromkeys(self.eligible, 0.0)
        for relation in {r for _, r, _ in self.observed}:
            alphas = []
            for other, r, novel_is_tail in self.observed:
                if r == relation:
                    matrix = self.maps[r] if novel_is_tail else np.linalg.inv(self.maps[r])
                    alphas.append(self.vectors[other] @ matrix)
            mean = sum(alphas) / len(alphas)
            for e in score:
                score[e] += cosine(self.vectors[e], mean)
        return score

    def mean(self, entities: list[int]) -> np.ndarray:
        return np.mean([self.vectors[e] for e in entities], axis=0)

    def expected(self, name: str, k: int, candidates: int = 0) -> tuple[list[int], str | None]:
        """The indicators, and what the initializer fell back to."""
        word, seen = self.entity in self.words, bool(self.observed)
        if name == "es" and word:
            return best(self.similar(), k), None
        if name == "ers" and word and seen:
            related = self.related()
            return best({e: related[e] for e in best(self.similar(), candidates)}, k), None
        if seen:
            return best(self.related(), k), None if name == "rs" else "rs"
        if name == "ers" and word:
            return best(self.similar(), k), "es"
        return self.known, "centroid"


def cosine(one: np.ndarray, other: np.ndarray) -> float:
    return float(one @ other / (np.linalg.norm(one) * np.linalg.norm(other)))


def best(score: dict[int, float], k: int) -> list[int]:
    return sorted(score, key=lambda e: (-score[e], e))[:k]


def agree(of: World, name: str, **options: int) -> set[str | None]:
    """See that an initializer gives what the plain loop does; what it fell back to, over all novel entities."""
    found = insert(name, seen(of), **options)
    fallbacks = set()
    for model in range(len(NOVEL)):
        for place in range(NOVEL.shape[1]):
            plain = Plain(of, model, place)
            indicators, fallback = plain.expected(name, **options)
            np.testing.assert_allclose(found.vectors[model, place].numpy(), plain.mean(indicators), atol=1e-5)
            assert found.indicators is not None
            assert found.indicators[model, place].nonzero().flatten().tolist() == sorted(indicators)
            assert FALLBACKS[found.fallback[model, place]] == fallback
            fallbacks.add(fallback)
    return fallbacks


@pytest.mark.parametrize("k", [1, 3, 8, 40])
def test_es_rs_and_ers_are_the_plain_loop(k: int) -> None:
    of = world()
    assert agree(of, "es", k=k) == {None, "rs"}  # 9 has no word vector
    assert agree(of, "rs", k=k) == {None}
    assert agree(of, "ers", k=k, candidates=5) == {None, "rs"}
    assert agree(of, "ers", k=k, candidates=40) == {None, "rs"}


def test_fallbacks_are_the_plain_loop_with_the_k_of_the_one_that_fell_back() -> None:
    of = world()
    rows = of.insert_triples  # of the first model, the novel 0 and the wordless novel 9 lose theirs
    bare = replace(of, insert_triples=rows[(rows[:, 0] != 0) | (rows[:, 1] == 1)])
    assert agree(bare, "es", k=2) == {None, "centroid"}
    assert agree(bare, "rs", k=5) == {None, "centroid"}
    assert agree(bare, "ers", k=2, candidates=6) == {None, "es", "centroid"}
    wordless = replace(of, words=np.zeros_like(of.words))
    assert agree(wordless, "es", k=2) == {"rs"}
    assert agree(wordless, "ers", k=3, candidates=6) == {"rs"}
    nothing = replace(wordless, insert_triples=rows[:0])
    assert agree(nothing, "es", k=2) == agree(nothing, "rs", k=2) == {"centroid"}
    assert agree(nothing, "ers", k=2, candidates=6) == {"centroid"}


def test_centroid_is_over_all_known_entities_and_no_novel_one() -> None:
    given = seen(replace(world(), insert_triples=np.zeros((0, 3), dtype=np.int64)))
    found = initial("rs", given)
    for model in range(2):
        known = [e for e in range(ENTITIES) if e not in NOVEL[model]]
        centroid = given.theta0.entity[model, known].mean(0)
        torch.testing.assert_close(found.vectors[model], centroid.expand(3, -1))


@pytest.mark.parametrize(("name", "wordless_serve"), [("es", False), ("rs", True), ("ers", False)])
def test_neither_novel_nor_orphaned_nor_wordless_entities_are_indicators(name: str, wordless_serve: bool) -> None:
    of = world()
    given = seen(of)
    options = {"k": 99} | ({"candidates": 99} if name == "ers" else {})
    found = insert(name, given, **options)
    for model, place in ((0, 0), (0, 1), (1, 0), (1, 1), (1, 2)):
        barred = {*NOVEL[model].tolist(), ORPHAN} | (set() if wordless_serve else set(WORDLESS))
        others = [e for e in range(ENTITIES) if e not in barred]
        assert set(Plain(of, model, place).eligible) - set(WORDLESS) == set(others) - set(WORDLESS)
        torch.testing.assert_close(found.vectors[model, place], given.theta0.entity[model, others].mean(0))


def test_equal_word_similarities_go_to_the_lower_id() -> None:
    given = replace(insertion(), words=torch.ones(ENTITIES, 6))
    found = insert("es", given, k=3)
    for model, lowest in enumerate([[1, 2, 3], [1, 2, 3]]):
        torch.testing.assert_close(found.vectors[model], given.theta0.entity[model, lowest].mean(0).expand(3, -1))


@pytest.mark.parametrize(("name", "options"), [("rs", {"k": 3}), ("ers", {"k": 3, "candidates": 99})])
def test_equal_relational_scores_go_to_the_lower_id(name: str, options: dict[str, int]) -> None:
    given = replace(insertion(), words=torch.ones(ENTITIES, 6))
    lengths = 2.0 ** torch.arange(ENTITIES)  # of one direction, so that cosines are equal and means are not
    entity = given.theta0.entity[:1, 1:2] * lengths[:, None] * given.known[..., None]
    found = insert(name, replace(given, theta0=replace(given.theta0, entity=entity)), **options)
    for model in range(2):
        torch.testing.assert_close(found.vectors[model], entity[model, [1, 2, 3]].mean(0).expand(3, -1))


def test_word_similarity_is_the_same_where_there_are_too_many_for_a_table(monkeypatch: pytest.MonkeyPatch) -> None:
    given = insertion()
    whole = similarity.word_similarity(given)
    monkeypatch.setattr(similarity, "WHOLE", len(given.words) ** 2 - 1)
    torch.testing.assert_close(similarity.word_similarity(given), whole)
    assert not torch.equal(whole[0, 0], whole[0, 1])


def test_ers_candidates_go_to_the_lower_id() -> None:
    given = replace(insertion(), words=torch.ones(ENTITIES, 6))
    found = insert("ers", given, k=4, candidates=4)
    for model, lowest in enumerate([[1, 2, 3, 5], [1, 2, 3, 4]]):
        torch.testing.assert_close(found.vectors[model], given.theta0.entity[model, lowest].mean(0).expand(3, -1))


def rewired(of: World) -> World:
    """The same, but with other validation and test triples, or with those two exchanged."""
    triples, counts = of.graph.triples.clone(), of.graph.counts.clone()
    out = torch.from_numpy((of.splits != TRAIN).all(0))  # held out in both models
    triples[out] = (triples[out] + torch.tensor([1, 1, 2])) % torch.tensor([ENTITIES, RELATIONS, ENTITIES])
    counts[out] += 17
    exchanged = np.select([of.splits == VALID, of.splits == TEST], [TEST, VALID], of.splits).astype(np.int8)
    assert int(out.sum()) > 3
    return replace(of, graph=replace(of.graph, triples=triples, counts=counts), splits=exchanged)


@pytest.mark.parametrize("name", EVERYONE)
def test_no_validation_or_test_triple_reaches_an_initializer(name: str) -> None:
    before, after = (initial(name, seen(of)) for of in (world(), rewired(world())))
    assert torch.equal(before.vectors, after.vectors)
    assert torch.equal(before.fallback, after.fallback)


def test_an_insertion_holds_the_insert_triples_and_no_other() -> None:
    of = world()
    given = seen(of)
    for model in range(2):
        for place in range(3):
            listed = [
                (other, relation, is_tail)
                for other, relation, is_tail, there in zip(
                    given.other[model, place].tolist(), given.relation[model, place].tolist(),
                    given.novel_is_tail[model, place].tolist(), given.observed[model, place].tolist(), strict=True,
                ) if there
            ]  # fmt: skip
            assert sorted(listed) == sorted(Plain(of, model, place).observed)


@pytest.mark.parametrize("name", EVERYONE)
def test_each_model_is_initialized_as_if_alone(name: str) -> None:
    given = insertion()
    together = initial(name, given)
    per_model = {"known", "eligible", "novel", "other", "relation", "novel_is_tail", "observed", "keys"}
    for model in range(2):
        alone = replace(given, **{field: getattr(given, field)[model : model + 1] for field in per_model})
        theta0 = replace(
            given.theta0, entity=given.theta0.entity[model, None], relation=given.theta0.relation[model, None]
        )
        found = initial(name, replace(alone, theta0=theta0))
        assert torch.equal(found.vectors[0], together.vectors[model])
        if found.indicators is not None and together.indicators is not None:
            assert torch.equal(found.indicators[0], together.indicators[model])


@pytest.mark.parametrize("name", EVERYONE)
def test_indicators_are_told_where_a_centroid_was_taken(name: str) -> None:
    given = insertion()
    found = initial(name, given)
    assert (found.indicators is not None) == (name in CENTROIDS)
    if found.indicators is not None:
        for model in range(2):
            for place in range(3):
                own = given.theta0.entity[model, found.indicators[model, place]]
                torch.testing.assert_close(found.vectors[model, place], own.mean(0))


def wide(dimension: int = 400) -> InitContext:
    """Many coordinates, in [2, 3] + the number of the coordinate; rows of novel entities are zero."""
    given = insertion()
    entity = (
        torch.rand(2, ENTITIES, dimension, generator=torch.Generator().manual_seed(0)) + 2 + torch.arange(dimension)
    )
    return replace(given, theta0=replace(given.theta0, entity=entity * given.known[..., None]))


def test_xavier_fills_its_range_and_no_more() -> None:
    vectors = initial("xavier", wide()).vectors
    bound = 6 / 400**0.5
    assert vectors.shape == (2, 3, 400)
    assert vectors.abs().max() <= bound
    assert vectors.max() > 0.98 * bound
    assert vectors.min() < -0.98 * bound
    assert abs(vectors.mean()) < 5 * bound / (3 * vectors.numel()) ** 0.5


def test_iu_fills_the_range_of_each_coordinate_over_the_known_vectors() -> None:
    given = wide()
    vectors = initial("iu", given).vectors
    for model in range(2):
        known = given.theta0.entity[model, given.known[model]]
        low, high = known.min(0).values, known.max(0).values
        share = (vectors[model] - low) / (high - low)
        assert share.min() >= -1e-3  # rounding: coordinates are as large as 400
        assert share.max() <= 1 + 1e-3
        assert share.min() < 0.01
        assert share.max() > 0.99
        assert abs(share.mean() - 0.5) < 5 / (12 * share.numel()) ** 0.5


@pytest.mark.parametrize("name", ["xavier", "iu", "gaussian", "gaussian_centred"])
def test_random_initializers_are_keyed_by_root_and_cell(name: str) -> None:
    given = insertion()
    first = initial(name, given).vectors
    assert torch.equal(first, initial(name, given).vectors)
    others = [replace(given, root=1), replace(given, keys=given.keys + torch.tensor([1, 0])),
              replace(given, keys=given.keys + torch.tensor([0, 9]))]  # fmt: skip
    assert all((initial(name, other).vectors != first).all() for other in others)
    theta0 = replace(given.theta0, entity=given.theta0.entity[:1].expand(2, -1, -1))
    alike = replace(given, theta0=theta0, known=given.known[:1].expand(2, -1))  # nothing but keys tells models apart
    swapped = initial(name, replace(alike, keys=given.keys.flip(0))).vectors
    assert torch.equal(swapped.flip(0), initial(name, alike).vectors)


def test_xavier_and_iu_draw_from_streams_of_their_own() -> None:
    given = insertion()
    unit = given.known[..., None] * torch.linspace(-1, 1, ENTITIES)[:, None].expand(ENTITIES, DIMENSION)
    low, high = unit[0].min(), unit[0].max()
    given = replace(given, theta0=replace(given.theta0, entity=unit.contiguous()))
    bound = 6 / DIMENSION**0.5
    uniform = (initial("xavier", given).vectors[0] + bound) / (2 * bound)
    assert not torch.allclose((initial("iu", given).vectors[0] - low) / (high - low), uniform, atol=0.01)


def test_mean_is_the_plain_mean_of_the_known_vectors() -> None:
    given = insertion()
    found = initial("mean", given)
    for model in range(2):
        total, number = np.zeros(DIMENSION), 0
        for entity in range(ENTITIES):
            if entity not in NOVEL[model]:  # the orphan is known, too
                total += given.theta0.entity[model, entity].double().numpy()
                number += 1
        np.testing.assert_allclose(found.vectors[model], np.tile(total / number, (3, 1)), rtol=1e-5)
    assert not found.fallback.any()


@pytest.mark.parametrize("name", ["gaussian", "gaussian_centred"])
def test_gaussians_have_the_moments_of_the_known_vectors_in_each_coordinate(name: str) -> None:
    given, draws = insertion(), 20_000
    given = replace(given, theta0=replace(given.theta0, entity=given.theta0.entity * 3 + given.known[..., None] * 5))
    vectors = initial(name, replace(given, novel=given.novel[:, :1].expand(-1, draws))).vectors.double().numpy()
    for model in range(2):
        known = given.theta0.entity[model, given.known[model]].double().numpy()
        centre = known.mean(0) if name == "gaussian" else np.zeros(DIMENSION)
        deviation = np.sqrt(((known - known.mean(0)) ** 2).mean(0))
        assert (abs(vectors[model].mean(0) - centre) < 5 * deviation / draws**0.5).all()
        assert (abs(vectors[model].std(0) / deviation - 1) < 5 / (2 * draws) ** 0.5).all()
        within = (abs(vectors[model] - centre) < deviation).mean(0)  # of the normal: 68.27 %
        assert (abs(within - 0.6827) < 5 * (0.6827 * 0.3173 / draws) ** 0.5).all()
        assert abs(np.corrcoef(vectors[model].T) - np.eye(DIMENSION)).max() < 5 / draws**0.5


def test_the_gaussians_differ_in_the_centre_alone() -> None:
    given = insertion()
    apart = initial("gaussian", given).vectors - initial("gaussian_centred", given).vectors
    torch.testing.assert_close(apart, initial("mean", given).vectors, atol=1e-5, rtol=0)


def test_es_permuted_is_the_plain_es_under_the_permuted_words() -> None:
    of = world()
    given = seen(of)
    dealt, fallbacks = permuted_words(given).numpy(), set()
    for k in (1, 3, 8, 40):
        found = insert("es_permuted", given, k=k)
        assert found.indicators is not None
        for model in range(2):
            permuted = replace(of, words=of.words[dealt[model]])
            for place in range(3):
                indicators, fallback = Plain(permuted, model, place).expected("es", k)
                assert found.indicators[model, place].nonzero().flatten().tolist() == sorted(indicators)
                assert FALLBACKS[found.fallback[model, place]] == fallback
                fallbacks.add(fallback)
    assert fallbacks == {None, "rs"}  # 9 has no word vector, and is dealt none


def test_words_are_dealt_out_among_those_that_have_one_by_model() -> None:
    given = insertion()
    keys = torch.tensor([[size, seed] for size in range(20) for seed in range(50)])
    many = replace(given, novel=given.novel[:1].expand(len(keys), -1), keys=keys)
    dealt = permuted_words(many).numpy()
    worded = [e for e in range(ENTITIES) if e not in WORDLESS]
    assert (dealt[:, WORDLESS] == WORDLESS).all()
    assert (np.sort(dealt[:, worded], axis=1) == worded).all()
    shares = np.array([[(dealt[:, e] == other).mean() for other in worded] for e in worded])
    chance = 1 / len(worded)
    assert abs(shares - chance).max() < 5 * (chance / len(keys)) ** 0.5  # each gets each as often
    other_way = permuted_words(replace(many, keys=keys.flip(0))).numpy()
    assert (other_way[::-1] == dealt).all()
    assert (permuted_words(replace(many, root=1)).numpy() != dealt).any(1).all()


def test_es_permuted_falls_back_where_es_does() -> None:
    of = world()
    for words in (of.words, np.zeros_like(of.words)):
        for rows in (of.insert_triples, of.insert_triples[:0]):
            given = seen(replace(of, words=words, insert_triples=rows))
            assert torch.equal(initial("es_permuted", given).fallback, initial("es", given).fallback)
    alike = replace(insertion(), words=torch.ones(ENTITIES, 6))  # nothing to tell the permuted words by
    assert torch.equal(initial("es_permuted", alike).vectors, initial("es", alike).vectors)


def test_put_replaces_the_rows_of_novel_entities_alone() -> None:
    given = insertion()
    vectors = torch.arange(2 * 3 * DIMENSION).view(2, 3, DIMENSION).float()
    theta1 = with_vectors(given.theta0, given.novel, vectors)
    for model in range(2):
        assert torch.equal(theta1.entity[model, given.novel[model]], vectors[model])
    assert torch.equal(theta1.entity[given.known], given.theta0.entity[given.known])
    assert torch.equal(theta1.relation, given.theta0.relation)


@pytest.mark.parametrize(
    ("name", "options", "says"),
    [
        ("glorot", {}, ["initializers.glorot", "'glorot'", "es, es_permuted, es_permuted_kinds, gaussian"]),
        ("es", {"k": 3, "neighbours": 2}, ["initializers.es.neighbours"]),
        ("es", {"neighbours": 2}, ["initializers.es"]),
        ("es", {}, ["initializers.es.k"]),
        ("es", {"k": 0}, ["initializers.es.k", "0"]),
        ("ers", {"k": 3, "candidates": "many"}, ["initializers.ers.candidates", "'many'"]),
        ("xavier", {"k": 3}, ["initializers.xavier.k"]),
    ],
)
def test_options_that_an_initializer_does_not_take_are_refused_in_one_line(
    name: str, options: dict[str, Option], says: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        options_of(name, options, f"initializers.{name}")
    message = str(caught.value)
    assert "\n" not in message
    assert all(part in message for part in ["params.yaml", *says])


@pytest.fixture
def _of_ones_own() -> Iterator[None]:
    """What a test registers goes with it."""
    before = INITIALIZERS._registered.keys() | {module.name for module in iter_modules(initializers.__path__)}
    yield
    for name in INITIALIZERS._registered.keys() - before:
        del INITIALIZERS._registered[name]


@pytest.mark.usefixtures("_of_ones_own")
def test_options_come_from_the_signature_with_its_defaults() -> None:
    @initializer("constant")
    def constant(insertion: InitContext, at: float, times: Count = 2) -> InitResult:
        return without_weights(torch.full((*insertion.novel.shape, DIMENSION), at * times))

    given = options_of("constant", {"at": 1.5}, "initializers.constant")
    assert given == {"at": 1.5, "times": 2}
    found = insert("constant", insertion(), **given)
    assert (found.vectors == 3).all()
    assert not found.fallback.any()


@pytest.mark.usefixtures("_of_ones_own")
def test_one_of_ones_own_is_shown_by_its_name_unless_it_says_otherwise() -> None:
    initializer("plain")(without_weights)
    initializer("fancy", label="Fancy", role="isi", colour="#123456")(without_weights)
    plain, fancy = (INITIALIZERS.get(name, "initializers") for name in ("plain", "fancy"))
    assert (plain.label, plain.role, plain.colour) == ("plain", "own", None)
    assert (fancy.label, fancy.role, fancy.colour) == ("Fancy", "isi", "#123456")


def test_the_params_list_all_that_ship_with_their_options() -> None:
    beyond = read(paths.BEYOND_PARAMS)["variants"]["baselines"]["options"]
    listed = {**read(paths.PARAMS)["initializers"], **beyond}
    assert set(listed) == set(EVERYONE)
    assert set(listed) <= set(INITIALIZERS.names())
    for name, options in listed.items():
        assert options_of(name, options, f"initializers.{name}") == options
    shown = [INITIALIZERS.get(name, "initializers") for name in listed]
    assert len({one.label for one in shown}) == len({one.colour for one in shown}) == len(EVERYONE)
    assert Counter(one.role for one in shown) == {"paper": 2, "isi": 3, "control": 7, "baseline": 11}
    assert all(one.description.endswith(".") for one in shown)


@pytest.mark.parametrize("name", EVERYONE)
def test_weights_are_of_known_entities_and_make_the_vector_of_whoever_takes_a_mean(name: str) -> None:
    given = insertion()
    result = initial(name, given)
    assert (result.indicators is not None) == (name in CENTROIDS)
    if result.weights is None:
        assert name in ("xavier", "iu", "gaussian", "gaussian_centred", "er_avg", "class_noise", "projection")
        return
    torch.testing.assert_close(result.weights.sum(-1), torch.ones(2, 3, dtype=result.weights.dtype))
    assert not result.weights.masked_select(~given.known[:, None].expand_as(result.weights)).any()
    mean = (result.weights.float() @ given.theta0.entity).allclose(result.vectors, atol=1e-6)
    assert mean != (name in ("ridge", "map_mean", "map_ers", "map_soft_hybrid"))


@pytest.mark.parametrize("name", EVERYONE)
def test_what_an_initializer_needs_and_its_defaults_are_those_of_its_function(name: str) -> None:
    registered, given = INITIALIZERS.get(name, "initializers"), insertion()
    assert options_of(name, registered.defaults, name) == registered.defaults
    whole = initial(name, given)
    wordless = initial(name, replace(given, words=torch.zeros_like(given.words)))
    alone = initial(name, replace(given, observed=torch.zeros_like(given.observed)))
    assert torch.equal(wordless.vectors, whole.vectors) == ("words" not in registered.needs)
    if not (whole.fallback == RS).any():
        assert torch.equal(alone.vectors, whole.vectors) == ("insert_triples" not in registered.needs)
