"""``isi.insert``: its documented behaviour on a user's embedding,
and agreement with the pipeline's functions.
"""

import gc
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import isi
from isi import config
from isi.errors import InputError
from isi.initializers.api import INITIALIZERS, InitResult, Registered, initializer, without_weights
from isi.initializers.context import InitContext
from isi.insertion.arguments import triples_of
from isi.insertion.engine import FEW, Method, NovelEntities, batches, insert
from isi.models.bilinear import DistMult
from isi.models.distance import RotatE
from isi.models.losses import Loss
from isi.random import stream
from isi.tables import paths
from isi.vocabulary import Vocabulary
from tests.init_contexts import insertion
from tests.small_embedding import (
    BETWEEN,
    ENTITIES,
    KNOWN,
    KNOWN_TRIPLES,
    NEW,
    TRIPLES,
    call,
    tables,
    words,
)
from tests.small_graphs import dense, random_embedding

RELATIONS, DIMENSION = len(BETWEEN), 8
#: The triples in columns of other names and another order, and a column that is none of them.
MIXED = pd.DataFrame(TRIPLES, columns=["from", "rel", "to"])[["to", "from", "rel"]].assign(count=1)


def by_hand() -> InitContext:
    """The input of initializers for the same insertion, as the pipeline builds it."""
    stack, new = random_embedding(1, ENTITIES, RELATIONS, DIMENSION), [ENTITIES, ENTITIES + 1]
    theta0 = replace(stack, entity=torch.cat([stack.entity, torch.zeros(1, 2, DIMENSION)], 1))
    seen = [[(1, 0, False), (3, 1, True)], [(2, 2, False)]]
    ids = {name: number for number, name in enumerate(KNOWN)}
    known = [
        (ids[head], BETWEEN.index(relation), ids[tail]) for head, relation, tail in KNOWN_TRIPLES
    ]
    of = insertion(theta0, new, seen, torch.from_numpy(words()), [0] * (ENTITIES + 2), known)
    return replace(
        of, eligible=of.known & (torch.arange(ENTITIES + 2) < 8), keys=torch.tensor([[0]])
    )


@pytest.mark.parametrize("name", INITIALIZERS.names())
def test_vectors_are_those_of_the_pipelines_initializers(name: str) -> None:
    registered = INITIALIZERS.get(name, "")
    expected = registered.initialize(by_hand(), registered.defaults)
    done = call(initializer=name, words=words(), triples=TRIPLES[:3])
    torch.testing.assert_close(
        torch.from_numpy(done.entities[ENTITIES:]), expected.vectors[0], rtol=0, atol=0
    )
    if expected.indicators is not None:
        assert done.details.indicators == [
            row.nonzero()[:, 0].tolist() for row in expected.indicators[0]
        ]


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.float16])
def test_known_rows_are_the_same_bytes_and_new_ones_of_their_type_come_behind(
    dtype: type[np.floating[Any]],
) -> None:
    given, copies = tables(dtype=dtype), tables(dtype=dtype)
    kinds = dict.fromkeys((KNOWN[1], KNOWN[3], "cup"), "a") | {KNOWN[2]: "b", "mug": "b"}
    done = call(**given, initializer="kind_mean", kinds=kinds, triples=TRIPLES[:3])
    for table in (done.entities[:ENTITIES], given["entities"]):
        assert table.tobytes() == copies["entities"].tobytes()
    assert done.relations.tobytes() == copies["relations"].tobytes()
    assert (done.entity_names, done.details.new) == ([*KNOWN, *NEW], [ENTITIES, ENTITIES + 1])
    single = given["entities"].astype(np.float32)
    expected = np.stack([(single[1] + single[3]) / 2, single[2]]).astype(dtype)
    assert done.vectors.tobytes() == done.entities[ENTITIES:].tobytes() == expected.tobytes()


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16, torch.float32])
def test_tables_may_be_tensors_with_gradients_and_of_short_types(dtype: torch.dtype) -> None:
    given = {
        name: torch.nn.Parameter(torch.from_numpy(table).to(dtype))
        for name, table in tables().items()
    }
    arrays = {name: table.detach().float().numpy() for name, table in given.items()}
    done, same = call(**given), call(**arrays)
    np.testing.assert_array_equal(done.entities[:ENTITIES], arrays["entities"])
    np.testing.assert_allclose(done.entities, same.entities, rtol=1e-2, atol=1e-2)
    trained = done.train(epochs=1)
    np.testing.assert_array_equal(trained.entities[:ENTITIES], arrays["entities"])


def test_ids_do_what_names_do() -> None:
    ids = {name: number for number, name in enumerate([*KNOWN, *NEW])}
    triples = np.array(
        [[ids[head], BETWEEN.index(relation), ids[tail]] for head, relation, tail in TRIPLES]
    )
    known = np.array(
        [[ids[head], BETWEEN.index(relation), ids[tail]] for head, relation, tail in KNOWN_TRIPLES]
    )
    done = call(triples=triples, new=2, entity_names=None, relation_names=None, known_triples=known)
    np.testing.assert_array_equal(done.entities, call().entities)
    assert [entity.name for entity in done.report()] == [12, 13]
    mixed = [("cup", 0, 1), (3, "on", 12), ("mug", np.int64(2), "e2"), (12, 1, "mug")]
    for same in (mixed, np.array(TRIPLES), np.array(mixed, object), map(list, TRIPLES)):
        np.testing.assert_array_equal(call(triples=same).entities, done.entities)


@pytest.mark.parametrize(
    "form",
    [
        pd.DataFrame(TRIPLES),
        pd.DataFrame(TRIPLES, columns=["head", "relation", "tail"])[["tail", "head", "relation"]],
        np.array(TRIPLES),
        {"cup": {"in": "e1", "on": ["mug"]}, "e3": {"on": ["cup"]}, "mug": {"has": [2]}},
        torch.tensor([[12, 0, 1], [3, 1, 12], [13, 2, 2], [12, 1, 13]]),
        pd.DataFrame([[12, 0, 1], [3, 1, 12], [13, 2, 2], [12, 1, 13]]),
        MIXED.rename(columns=str.upper),
        MIXED.rename(columns={"from": "source", "to": "target", "rel": "label"}),
    ],
    ids=[
        "frame",
        "named columns",
        "array",
        "facts",
        "tensor",
        "frame of ids",
        "from, to, rel",
        "networkx",
    ],
)
def test_triples_come_in_many_forms(form: Any) -> None:
    done = call(triples=form)
    np.testing.assert_allclose(done.entities, call().entities, rtol=1e-4)
    assert (len(done.details.insert_triples), len(done.details.between)) == (3, 1)


def test_triples_come_from_an_iterator() -> None:
    np.testing.assert_array_equal(call(triples=iter(TRIPLES)).entities, call().entities)


@given(
    st.lists(
        st.tuples(
            st.sampled_from([0, 1, 2**31 - 1]), st.integers(0, 2), st.sampled_from([0, 2**31 - 1])
        )
    )
)
def test_triples_keep_the_order_of_their_first_occurrence(
    triples: list[tuple[int, int, int]],
) -> None:
    # R · E² > 2⁶³
    entities, relations = Vocabulary("entity", None, 2**31), Vocabulary("relation", None, 3)
    array = np.array(triples, np.int32).reshape(-1, 3)
    for given_as in (triples, array):
        ids = triples_of(given_as, "triples", entities, relations)
        assert (ids.dtype, list(map(tuple, ids.tolist()))) == (
            np.int64,
            list(dict.fromkeys(triples)),
        )


def test_triples_between_new_entities_are_counted() -> None:
    done = call(triples=[*TRIPLES, ("mug", "in", "mug")])
    assert [(entity.insert_triples, entity.between) for entity in done.report()] == [(2, 1), (1, 2)]


def test_only_known_entities_with_a_triple_are_indicators() -> None:
    done = call(initializer="rs", options={"k": 12})
    assert done.details.indicators == [list(range(8)), list(range(8))]
    everyone = call(initializer="rs", options={"k": 12}, known_triples=None)
    assert everyone.details.indicators == [list(range(12)), list(range(12))]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, "map"),
        ({"words": words()}, "map"),
        ({"words": words() * (np.arange(14) < 12)[:, None]}, "map"),  # the new ones have none
        ({"words": words() * (np.arange(14) >= 12)[:, None]}, "map"),  # the known ones have none
        (
            {
                "new": np.int64(2),
                "triples": [(12, 0, 1), (3, 1, 13)],
                "entity_names": None,
                "known_triples": None,
            },
            "map",
        ),
        ({"words": words(), "triples": []}, "soft_es"),
        ({"words": words(), "initializer": "ers"}, "ers"),
    ],
)
def test_the_default_is_the_best_for_what_is_known_and_says_why(
    given: dict[str, Any], expected: str
) -> None:
    done = call(**{"trained_with": "logistic", **given})
    assert done.initializer == expected
    assert ("as named" in done.details.why) == ("initializer" in given)


def test_an_embedding_may_be_too_large_for_pairs_of_words() -> None:
    entities, vectors = np.eye(24_000, 4, dtype=np.float32), np.ones((24_001, 2), np.float32)
    with pytest.raises(
        InputError,
        match=r"argument 'initializer': the embedding is too large for es_permuted, which",
    ):
        isi.insert(
            entities,
            entities[:2],
            [(24_000, 1, 2)],
            new=1,
            model="distmult",
            words=vectors,
            initializer="es_permuted",
        )


def test_an_entity_without_triples_or_words_falls_back_and_says_to_what() -> None:
    vectors = words()
    vectors[ENTITIES] = 0
    done = call(words=vectors, triples=TRIPLES[:2], initializer="ers")
    assert done.details.fallback == ["rs", "es"]
    assert [one.fallback for one in done.report()] == done.details.fallback


def test_words_may_be_tensors_vectors_or_texts_by_name() -> None:
    vectors = torch.from_numpy(words()).bfloat16().requires_grad_()
    rows = vectors.detach().float()
    by_name = {name: rows[row] for row, name in enumerate([*KNOWN, *NEW])}
    texts = {name: f"text of {name}" for name in by_name}

    def embed(of: Any) -> torch.Tensor:
        return torch.stack([by_name[text.removeprefix("text of ")] for text in of])

    expected = call(words=rows.numpy()).entities
    for listed in (vectors, by_name):
        np.testing.assert_array_equal(call(words=listed).entities, expected)
    for listed in (texts, {**by_name, "cup": "text of cup"}):
        done = call(words=listed, embedder=embed)
        np.testing.assert_array_equal(done.entities, expected)


class OneWay(DistMult):
    """A model whose relations cannot be mapped back, so that triples alone serve no new entity."""

    invertible = False


@pytest.mark.parametrize(
    ("worded", "named"),
    [
        ([], "'cup'"),
        (["cup"], "'mug'"),  # the first new entity has words
        (["cup", "mug"], "words"),  # what lacks is the words of known entities
    ],
)
def test_what_lacks_words_is_named_where_triples_do_not_serve(
    worded: list[str], named: str
) -> None:
    given = {name: [1.0, 2.0] for name in worded}
    with pytest.raises(InputError) as raised:
        call(model=OneWay(), words=given, initializer="es", triples=TRIPLES[:3], known_triples=None)
    assert named in raised.value.file


def test_kinds_may_be_listed_or_named() -> None:
    listed = ["a"] * 6 + ["b"] * 6 + ["a", "b"]
    done = call(kinds=listed, initializer="kind_mean", known_triples=None)
    assert done.details.indicators == [list(range(6)), list(range(6, 12))]
    by_name = dict(zip([*KNOWN, *NEW], listed, strict=True))
    same = call(kinds=by_name, initializer="kind_mean", known_triples=None)
    assert same.details.indicators == done.details.indicators


@pytest.mark.parametrize(
    "kinds",
    [
        np.array([0, *[-1] * 11, 0, 1]),
        ["a", *[None] * 11, "a", "b"],
        ["a", *[""] * 11, "a", "b"],
        {"e0": "a", "cup": "a", "e1": None, "mug": "b"},
    ],
    ids=["-1", "None", "empty", "missing"],
)
def test_an_entity_without_a_kind_is_of_no_kind(kinds: Any) -> None:
    done = call(kinds=kinds, initializer="es", words=words(), known_triples=None)
    assert done.details.indicators is not None
    assert (done.details.indicators[0], len(done.details.indicators[1])) == ([0], 8)


@pytest.mark.parametrize("name", INITIALIZERS.names())
def test_indicators_are_of_the_kind_of_each_new_entity(name: str) -> None:
    """Kind a has eligible entities, b an entity that is in no known triple, c no known one."""
    known = KNOWN_TRIPLES[:4]
    seen = {end for head, _, tail in known for end in (head, tail)}
    alone = next(entity for entity in KNOWN if entity not in seen)
    of_kind = [entity for entity in sorted(seen)[1:] if entity in seen]
    kinds = dict.fromkeys(of_kind, "a") | {alone: "b", "cup": "a"}

    def weights(kind: str | None, **others: str) -> np.ndarray | None:
        given = None if kind is None else kinds | {"mug": kind} | others
        facts = {"triples": TRIPLES[:3], "known_triples": known}
        return call(kinds=given, initializer=name, words=words(), **facts).details.weights

    free = weights(None)
    if free is None or name == "kind_mean":
        return  # no mean, or one of its kind by definition
    for kind in ("", "b", "c"):  # without an eligible entity of its kind, all count
        both = weights(kind)
        assert both is not None
        np.testing.assert_allclose(both[1], free[1], atol=1e-6)
        assert {KNOWN[row] for row in np.flatnonzero(both[0])} <= set(of_kind)
        np.testing.assert_allclose(both[0].sum(), 1, atol=1e-5)


def test_batches_are_of_similar_numbers_of_triples_and_of_limited_size(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    number = [5, 3, 100, 0, 40, 33, 70]
    triples = np.array(
        [(10 + place, 0, 1) for place, times in enumerate(number) for _ in range(times)]
    )
    assert [part.tolist() for part in batches(torch.arange(10, 17), triples, 2, 1)] == [
        [10, 11],
        [13],
        [14, 15],
        [12, 16],
    ]
    monkeypatch.setattr("isi.insertion.engine.BUDGET", 3 * 64 * 8)
    assert [len(part) for part in batches(torch.arange(10, 17), triples, 9, 8)] == [3, 2, 1, 1]


def test_vectors_of_a_batch_fit_into_its_budget_where_entities_are_wider_than_relations(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known, new, dimension = 40, 16, 8
    monkeypatch.setattr("isi.insertion.engine.BUDGET", 4 * FEW * dimension)
    sizes = list[int]()

    def measured(context: InitContext) -> InitResult:
        sizes.append(context.other.numel() * dimension)
        return without_weights(torch.zeros(*context.novel.shape, dimension))

    novel = NovelEntities(
        theta=random_embedding(1, known + new, 1, dimension, model=RotatE(margin=1.0)),
        known=known,
        number=new,
        known_relations=1,
        triples=np.array([(known + row, 0, end) for row in range(new) for end in range(FEW)]),
        known_triples=np.zeros((0, 3), np.int64),
        words=None,
        kinds=None,
        seed=0,
    )
    insert(novel, Method(Registered("measured", measured, "Measured"), {}, ""))
    assert sizes == [4 * FEW * dimension] * 4


@pytest.mark.parametrize(("name", "loss"), [("map", "logistic"), ("fold_in", "softmax")])
def test_facts_are_weighed_by_their_confidence(name: str, loss: Loss) -> None:
    how = {"initializer": name, "trained_with": loss}
    sure = call(**how)
    number = len(sure.details.checked.novel.triples)
    same = call(**how, confidence=np.ones(number))
    assert np.array_equal(same.vectors, sure.vectors)
    doubtful = call(**how, confidence=np.linspace(0.1, 1, number))
    assert not np.allclose(doubtful.vectors, sure.vectors)


@pytest.mark.parametrize(("constant", "value"), [("BUDGET", 1), ("FEW", 1)])
@pytest.mark.parametrize("model", ["analogy", "rotate"])
def test_vectors_are_the_same_in_batches_of_any_size(
    model: str, constant: str, value: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``FEW``: so that the first, of two triples, follows the second, of one."""
    given: dict[str, Any] = {"model": model, "words": words(), "triples": TRIPLES[:3][::-1]}
    if model == "rotate":
        given["model_options"] = {"margin": 1.0}
        given["relations"] = tables()["relations"][:, : DIMENSION // 2]
    names = ("es", "rs", "ers", "soft_rs", "soft_hybrid", "map")
    together = {name: call(initializer=name, **given) for name in names}
    monkeypatch.setattr(f"isi.insertion.engine.{constant}", value)
    for name, expected in together.items():
        apart = call(initializer=name, **given)
        np.testing.assert_allclose(apart.entities, expected.entities, rtol=1e-4, atol=1e-6)
        assert apart.details.fallback == expected.details.fallback
        if expected.details.weights is not None:
            assert apart.details.weights is not None
            np.testing.assert_allclose(apart.details.weights, expected.details.weights, atol=1e-6)
    drawn = call(initializer="iu").entities[ENTITIES:]
    assert not np.allclose(drawn[0], drawn[1])


@pytest.mark.parametrize("name", ["es", "ers", "soft_es", "soft_hybrid", "map"])
def test_words_of_a_large_graph_are_compared_with_the_new_alone(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    of_all = call(initializer=name, words=words()).entities
    monkeypatch.setattr("isi.initializers.similarity.WHOLE", 0)
    np.testing.assert_allclose(
        call(initializer=name, words=words()).entities, of_all, rtol=1e-5, atol=1e-6
    )


def test_new_entities_of_a_call_draw_from_one_stream_in_their_order() -> None:
    drawn = stream(7, "xavier", 0).random((len(NEW), DIMENSION))
    bound = 6 / DIMENSION**0.5
    np.testing.assert_allclose(
        call(initializer="xavier", seed=7).entities[ENTITIES:], (2 * drawn - 1) * bound, rtol=1e-5
    )


def test_options_are_those_of_params_where_it_has_them() -> None:
    for name, options in config.read(paths.PARAMS)["initializers"].items():
        assert INITIALIZERS.get(name, name).defaults == options


def test_public_names_are_found_where_they_are_defined() -> None:
    assert (isi.insert.__module__, isi.open.__module__) == (
        "isi.insertion.api",
        "isi.home.home",
    )
    with pytest.raises(AttributeError, match="has no attribute 'inser'"):
        isi.inser  # noqa: B018


def test_type_checkers_see_the_public_names() -> None:
    """The stub file, which they read, defines each name as the package does."""
    stub = dict[str, Any]()
    exec(Path(isi.__file__).with_suffix(".pyi").read_text(encoding="utf-8"), stub)  # noqa: S102
    assert stub["__all__"] == isi.__all__
    for name in {*isi._WHERE, *isi._PACKAGES}:
        assert stub[name] is getattr(isi, name)


@pytest.mark.usefixtures("registries")
@pytest.mark.parametrize("flushed", [True, False])
def test_denormal_numbers_are_flushed_during_a_call_alone(flushed: bool) -> None:
    """Known rows with denormal numbers stay, and so does the setting of the caller,
    after an error, too.
    """

    def are_flushed() -> bool:
        return not bool((torch.full((1,), 1e-40) * 1).any())

    entities, relations = np.full((5, 4), 1e-40, np.float32), np.ones((1, 4), np.float32)
    entities[:, 0] = range(5)
    seen = list[bool]()

    @initializer("watching", cost="entities")
    def watching(context: InitContext) -> InitResult:
        seen.append(are_flushed())
        return without_weights(torch.zeros(*context.novel.shape, 4))

    torch.set_flush_denormal(flushed)
    try:
        done = isi.insert(
            entities, relations, [(5, 0, 1)], new=1, model="distmult", initializer="watching"
        )
        with pytest.raises(InputError):
            isi.insert(entities, relations, [(5, 0, 9)], new=1, model="distmult")
        assert are_flushed() == flushed
    finally:
        torch.set_flush_denormal(False)
    assert seen == [True]
    assert done.entities[:5].tobytes() == entities.tobytes()


def test_the_table_of_known_entities_is_joined_with_new_vectors_on_first_use() -> None:
    """An embedding of 2,003 entities stands for one of a million."""
    rows, width, rng = 2003, 13, np.random.default_rng(0)
    table = rng.standard_normal((rows, width)).astype(np.float32)
    relations = rng.standard_normal((2, width)).astype(np.float32)
    facts = [(5, 0, rows), (rows + 1, 1, 7), (8, 1, rows)]
    done = isi.insert(table, relations, facts, new=2, model="distmult", initializer="map")
    shapes = [(rows, width), (rows + 2, width)]
    gc.collect()
    tables = [
        tensor
        for tensor in gc.get_objects()
        if isinstance(tensor, torch.Tensor) and tensor.shape[-2:] in shapes
    ]
    assert {tensor.data_ptr() for tensor in tables} == {table.ctypes.data}
    repr(done)
    done.report()
    assert "entities" not in vars(done)
    assert done.details.new == [rows, rows + 1]
    assert done.vectors.shape == (2, width)
    assert done.entities is done.entities
    assert done.entities[:rows].tobytes() == table.tobytes()
    assert done.entities[rows:].tobytes() == done.vectors.tobytes()


NUMBERED = [str(row) for row in (7, 3, 0, 1, 2, 4, 5, 6, 8, 9, 10, 11)]


@pytest.mark.parametrize(
    "changed",
    [
        {"triples": [("mug", "in", 7)]},
        {"triples": [("mug", "in", np.int64(7))]},
        {"words": {7: np.ones(2)}},
        {"kinds": {7: "room"}},
    ],
)
def test_a_number_that_is_another_rows_name_is_refused(changed: dict[str, Any]) -> None:
    about = {"triples": [("mug", "in", "7")], "new": ["mug"], "entity_names": NUMBERED}
    how = {"known_triples": None, "initializer": "er_avg"}
    done = call(**about, **how)
    maps, ends = (torch.from_numpy(tables()[name]) for name in ("relations", "entities"))
    expected = dense(maps[0]) @ ends[0]  # of row 0, whose name is 7
    np.testing.assert_allclose(done.vectors[0], expected, rtol=1e-4, atol=1e-6)
    with pytest.raises(InputError, match="7 is an id, and the name of another row"):
        call(**(about | how | changed))
    assert call(**(about | how | {"triples": [("mug", "in", 8)]})).vectors.shape == (1, 8)


@pytest.mark.parametrize("form", [np.array, torch.tensor, pd.DataFrame])
def test_an_array_of_numbers_holds_ids_and_says_so_beside_names_that_are_numbers(form: Any) -> None:
    about = {"triples": [("mug", "in", "7")], "new": ["mug"], "entity_names": NUMBERED}
    with pytest.warns(UserWarning, match="known_triples.*ids"):
        done = call(**about, known_triples=form([(7, 0, 3)]), initializer="mean")
    assert done.details.checked.novel.known_triples.tolist() == [[7, 0, 3]]


@pytest.mark.parametrize("number", [np.int64, np.uint8, np.array, torch.tensor])
def test_numbers_of_numpy_and_of_torch_are_numbers(number: Any) -> None:
    """Whole ones; ``half`` is one with a fraction."""
    half = number(0.5) if number in (np.array, torch.tensor) else np.float32(0.5)
    entities, relations = tables().values()
    facts = {"model": "analogy", "new": number(1)}
    how = {"seed": number(3), "harm": half}
    done = isi.insert(
        entities,
        relations,
        [(number(ENTITIES), number(0), number(3))],
        **facts,  # type: ignore[arg-type]
        **how,  # type: ignore[arg-type]
        initializer="rs",
        options={"k": number(2)},
        known_triples=[(0, 0, 1)],
    )
    assert len(done.report(nearest=number(2))[0].nearest) == 2
    assert done.interference(most=number(1), seed=number(1), original=number(ENTITIES)).queries
    assert done.train(number(2)).entities.shape == done.entities.shape


# Names of arguments and of what a result shows


def test_arguments_are_spelt_out_and_a_typo_names_the_function() -> None:
    named = {"initializer", "options", "trained_with", "harm", "choose", "validation", "seed"}
    named |= {"new_relations", "embedder", "confidence"}
    assert named <= signature(isi.insert).parameters.keys()
    with pytest.raises(TypeError, match=r"^insert\(\) got an unexpected .*'initialiser'"):
        call(initialiser="mean")


def test_new_rows_are_trained_further_alone() -> None:
    done = call(initializer="mean")
    trained = done.train(epochs=3)
    assert trained.entities[:ENTITIES].tobytes() == done.entities[:ENTITIES].tobytes()
    assert (trained.vectors != done.vectors).any(1).all()
    assert (trained.initializer, trained.harm) == ("mean", None)
    with pytest.raises(InputError, match="argument 'epochs'"):
        done.train(0)
