"""ES, RS and ERS against plain loops; fallbacks, ties, ranges, controls;
no initializer sees held-out triples.
"""

import json
import subprocess
import sys
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest
import torch

import isi
from isi.config import Count, read
from isi.graph.sessions import TRAIN
from isi.initializers.api import (
    FALLBACKS,
    INITIALIZERS,
    InitResult,
    initializer,
    options_of,
    without_weights,
)
from isi.initializers.context import InitContext, context_in_session
from isi.tables import paths
from stages.pipeline import BEYOND_PARAMS
from tests.environment import ENVIRONMENT
from tests.init_contexts import EVERYONE
from tests.init_contexts import initialize as insert
from tests.small_graphs import dense, generator, points_of, random_embedding, random_graph
from tests.small_insertion import (
    DIMENSION,
    ENTITIES,
    NOVEL,
    World,
    insertion,
    seen,
    world,
)

RANDOM = ("xavier", "iu", "gaussian")

#: An insert triple: its known end, its relation, and whether the novel entity is the tail.
Observed = tuple[int, int, bool]


CENTROIDS = ("es", "rs", "ers", "mean", "es_permuted", "kind_mean")


def initial(name: str, given: InitContext) -> InitResult:
    return insert(name, given, **EVERYONE[name])


class Plain:
    """Section 4 of the paper for one novel entity of one model, with dictionaries and loops."""

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
        own = [
            triples[triple]
            for m, p, triple in of.insert_triples.tolist()
            if (m, p) == (model, place)
        ]
        self.observed: list[Observed] = [
            (h, r, True) if t == self.entity else (t, r, False) for h, r, t in own
        ]

    def similar(self) -> dict[int, float]:
        return {
            e: cosine(self.words[self.entity], self.words[e])
            for e in self.eligible
            if e in self.words
        }

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
        """The indicators, and the fallback (None: not used)."""
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
    """Check that an initializer agrees with ``Plain`` for all novel entities;
    returns the set of fallbacks.
    """
    result = insert(name, seen(of), **options)
    fallbacks = set()
    for model in range(len(NOVEL)):
        for place in range(NOVEL.shape[1]):
            plain = Plain(of, model, place)
            indicators, fallback = plain.expected(name, **options)
            np.testing.assert_allclose(
                result.vectors[model, place].numpy(), plain.mean(indicators), atol=1e-5
            )
            assert result.indicators is not None
            assert result.indicators[model, place].nonzero().flatten().tolist() == sorted(
                indicators
            )
            assert FALLBACKS[result.fallback[model, place]] == fallback
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


@pytest.mark.parametrize(
    ("name", "options", "lowest"),
    [
        ("es", {"k": 3}, [[1, 2, 3]] * 2),
        ("rs", {"k": 3}, [[1, 2, 3]] * 2),
        ("ers", {"k": 3, "candidates": 99}, [[1, 2, 3]] * 2),
        ("ers", {"k": 4, "candidates": 4}, [[1, 2, 3, 5], [1, 2, 3, 4]]),
    ],
)
def test_equal_scores_go_to_the_lower_id(
    name: str, options: dict[str, int], lowest: list[list[int]]
) -> None:
    given = replace(insertion(), words=torch.ones(ENTITIES, 6))
    # of one direction, so that cosines are equal and means are not
    lengths = 2.0 ** torch.arange(ENTITIES)
    entity = given.theta0.entity[:1, 1:2] * lengths[:, None] * given.known[..., None]
    result = insert(name, replace(given, theta0=replace(given.theta0, entity=entity)), **options)
    for model in range(2):
        torch.testing.assert_close(
            result.vectors[model], entity[model, lowest[model]].mean(0).expand(3, -1)
        )


@pytest.mark.parametrize("name", ["xavier", "iu", "gaussian"])
def test_random_vectors_are_draws_of_their_own_stream_in_the_range_or_spread_of_the_known(
    name: str,
) -> None:
    given, bound = insertion(), 6 / DIMENSION**0.5
    for model in range(2):
        known = given.theta0.entity[model, given.known[model]].double().numpy()
        rng, shape = generator(name, *given.keys[model].tolist()), (3, DIMENSION)
        low = -bound if name == "xavier" else known.min(0)
        high = bound if name == "xavier" else known.max(0)
        if name == "gaussian":
            expected = known.mean(0) + known.std(0) * rng.standard_normal(shape)
        else:
            expected = low + (high - low) * rng.random(shape)
        vectors = initial(name, given).vectors[model]
        np.testing.assert_allclose(vectors, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", EVERYONE)
def test_random_initializers_are_keyed_by_root_and_grid_point_and_no_other_draws(name: str) -> None:
    given = insertion()
    first, drawn = initial(name, given).vectors, name in RANDOM
    assert torch.equal(first, initial(name, given).vectors)
    others = [
        replace(given, root=1),
        *(replace(given, keys=given.keys + torch.tensor(by)) for by in ([1, 0], [0, 9])),
    ]
    if name != "es_permuted":  # which deals words: test_baselines
        assert all((initial(name, other).vectors != first).all() == drawn for other in others)
        assert all(torch.equal(initial(name, other).vectors, first) != drawn for other in others)
    theta0 = replace(given.theta0, entity=given.theta0.entity[:1].expand(2, -1, -1))
    # the models differ in their keys alone
    alike = replace(given, theta0=theta0, known=given.known[:1].expand(2, -1))
    if drawn:
        swapped = initial(name, replace(alike, keys=given.keys.flip(0))).vectors
        assert torch.equal(swapped.flip(0), initial(name, alike).vectors)


@pytest.mark.usefixtures("registries")
def test_options_come_from_the_signature_and_the_label_is_the_name() -> None:
    @initializer("constant")
    def constant(insertion: InitContext, at: float, times: Count = 2) -> InitResult:
        return without_weights(torch.full((*insertion.novel.shape, DIMENSION), at * times))

    options = options_of("constant", {"at": 1.5}, "initializers.constant")
    assert options == {"at": 1.5, "times": 2}
    assert (insert("constant", insertion(), **options).vectors == 3).all()
    registered = INITIALIZERS.get("constant", "initializers")
    assert (registered.label, registered.role) == ("constant", "own")


def test_the_params_list_all_that_ship_with_their_options() -> None:
    beyond = read(BEYOND_PARAMS)["variants"]["baselines"]["options"]
    listed = {**read(paths.PARAMS)["initializers"], **beyond}
    assert set(listed) == set(EVERYONE)
    assert set(listed) <= set(INITIALIZERS.names())
    for name, options in listed.items():
        assert options_of(name, options, f"initializers.{name}") == options
    registered = [INITIALIZERS.get(name, "initializers") for name in listed]
    assert len({each.label for each in registered}) == len(EVERYONE)


@pytest.mark.parametrize("name", EVERYONE)
def test_all_that_ship_pass_the_checks(
    name: str,
) -> None:
    isi.check_initializer(name, EVERYONE[name])
    if dict(INITIALIZERS.get(name).defaults) != EVERYONE[name]:
        isi.check_initializer(name)


@pytest.mark.parametrize("name", EVERYONE)
def test_a_mean_of_indicators_is_a_mean_and_map_moves_away_from_one(name: str) -> None:
    given = insertion()
    result = initial(name, given)
    assert (result.indicators is not None) == (name in CENTROIDS)
    if result.weights is None:
        assert name in (*RANDOM, "er_avg")
        return
    mean = (result.weights.float() @ given.theta0.entity).allclose(result.vectors, atol=1e-6)
    assert mean == ("strength" not in EVERYONE[name])


def digests() -> dict[str, str]:
    """A digest of the vectors that each initializer of params.yaml gives in a small session."""
    points = points_of(random_graph(60, 4, 400), 6, [5, 6])
    words = np.random.default_rng(1).normal(size=(60, 20)).astype(np.float32)
    theta0 = random_embedding(2, 60, 4, 20)
    given = context_in_session(
        replace(theta0, entity=theta0.entity * points.session(0).entities[..., None]),
        points.session(0),
        points.novel_ids,
        torch.as_tensor(points.insert_triples),
        torch.as_tensor(words),
        0,
        points.keys(),
    )
    found = dict[str, str]()
    for name, options in read(paths.PARAMS)["initializers"].items():
        vectors = insert(name, given, **options).vectors
        found[name] = sha256(vectors.numpy().tobytes()).hexdigest()
    return found


def test_vectors_are_the_same_bytes_on_processors_of_other_width() -> None:
    """Instructions of 256 bits, as on processors with AVX2 alone, and those of this one."""
    script = (
        "import json; from tests.test_initializers import digests; print(json.dumps(digests()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=ENVIRONMENT | {"ATEN_CPU_CAPABILITY": "avx2"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert json.loads(done.stdout) == digests()
