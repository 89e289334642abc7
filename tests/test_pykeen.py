"""``isi.pykeen.insert`` against PyKEEN itself: scores, ranks, saving and further training."""

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

import isi
from isi.errors import InputError

pytest.importorskip("pykeen")

from pykeen.evaluation import RankBasedEvaluator
from pykeen.models import ERModel, model_resolver
from pykeen.pipeline import PipelineResult
from pykeen.predict import predict_target
from pykeen.training import SLCWATrainingLoop
from pykeen.triples import CoreTriplesFactory, TriplesFactory, TriplesNumericLiteralsFactory
from torch.nn.functional import softplus
from torch.optim import SGD, Adam

from isi.pykeen import InteractionModel, read_model
from isi.pykeen.insertion import nearly_known
from isi.pykeen.reading import both_ways

#: Models that are read in different ways, with their options.
CLOSED: list[tuple[str, dict[str, Any]]] = [
    *(("transe", {"scoring_fct_norm": norm}) for norm in (1, 2)),
    ("transe", {"scoring_fct_norm": 2, "power_norm": True}),
    *((name, {}) for name in ("distmult", "complex", "rotate")),
]
OTHERS: list[tuple[str, dict[str, Any]]] = [
    ("tucker", {"relation_dim": 4}), ("transe", {"scoring_fct_norm": 3}),
    *((name, {}) for name in ("rescal", "hole", "quate", "transh", "crosse")),
]  # fmt: skip
#: The models of PyKEEN that people use, with options that make them small.
MODELS: dict[str, dict[str, Any]] = {
    **{name: {} for name in (
        "ComplEx", "DistMult", "TransE", "RotatE", "RESCAL", "HolE", "PairRE", "TransH", "QuatE", "DistMA", "ERMLP",
        "SE", "ProjE", "SimplE", "BoxE", "MuRE", "TransD", "KG2E", "UM",
    )},
    "AutoSF": {"num_components": 4}, "CP": {"rank": 3}, "NTN": {"num_slices": 2}, "TransR": {"relation_dim": 5},
    "TuckER": {"relation_dim": 4},
    "ConvE": {**dict.fromkeys(("embedding_width", "kernel_height", "kernel_width"), 2), "embedding_height": 4},
}  # fmt: skip
ENTITIES, RELATIONS, DIMENSION = 20, 3, 8
NEW = [("cup", "r0", "e1"), ("e3", "r1", "cup"), ("mug", "r2", "e2"), ("cup", "r1", "mug")]


def id_of(case: Any) -> str:
    return str(case) if isinstance(case, str) else "-".join(map(str, case.values()))


@pytest.fixture(scope="module")
def factory() -> TriplesFactory:
    """A ring with all relations, and random triples; ids are not in the order of labels."""
    rng = np.random.default_rng(0)
    triples = {(e, e % RELATIONS, (e + 1) % ENTITIES) for e in range(ENTITIES)}
    triples |= {tuple(row) for row in rng.integers((ENTITIES, RELATIONS, ENTITIES), size=(60, 3)).tolist()}
    return TriplesFactory(
        torch.tensor(sorted(triples)), {f"e{row}": row for row in range(ENTITIES)[::-1]},
        {f"r{row}": row for row in range(RELATIONS)},
    )  # fmt: skip


@pytest.fixture(scope="module")
def inverse(factory: TriplesFactory) -> TriplesFactory:
    """The same triples for models that learn their inverses, too."""
    return TriplesFactory(
        factory.mapped_triples, factory.entity_to_id, factory.relation_to_id, create_inverse_triples=True
    )


def model_of(name: str, options: dict[str, Any], factory: CoreTriplesFactory, steps: int = 0) -> ERModel:
    made = model_resolver.make(name, triples_factory=factory, embedding_dim=DIMENSION, random_seed=0, **options)
    made.post_parameter_update()
    learn(made, factory.mapped_triples, steps)
    return made.eval()


def learn(model: ERModel, triples: torch.Tensor, steps: int) -> None:
    """Some steps on a margin loss; for few triples this is faster than PyKEEN's loop."""
    rng, optimizer = torch.Generator().manual_seed(0), torch.optim.Adam(model.parameters(), lr=0.05)
    for step in range(steps):
        other = triples.clone()
        other[:, 2 * (step % 2)] = torch.randint(ENTITIES, (len(triples),), generator=rng)
        optimizer.zero_grad()
        torch.relu(1 - model.score_hrt(triples) + model.score_hrt(other)).mean().backward()
        optimizer.step()
        model.post_parameter_update()


def scores(model: ERModel, triples: torch.Tensor) -> torch.Tensor:
    with torch.no_grad():
        return model.eval().score_hrt(triples)[:, 0]


@pytest.mark.parametrize(("name", "options"), CLOSED + OTHERS, ids=id_of)
def test_a_model_scores_in_our_terms_what_it_scores_itself(name: str, options: dict[str, Any], factory: Any) -> None:
    model = model_of(name, options, factory, steps=100)
    read = read_model(model, factory.mapped_triples, None)
    assert isinstance(read.model, InteractionModel) == ((name, options) in OTHERS)
    head, relation, tail = factory.mapped_triples.T[:, None]
    ours, theirs = read.score(head, relation, tail)[0], scores(model, factory.mapped_triples)
    torch.testing.assert_close(ours - ours.mean(), theirs - theirs.mean(), rtol=1e-4, atol=1e-5)
    if not read.model.linear:  # the margin is between true and corrupted triples
        assert ours.mean() > 0 > read.score_tails(head, relation).mean()


@pytest.mark.parametrize(("name", "options"), CLOSED + OTHERS, ids=id_of)
def test_what_is_known_stays_and_new_rows_come_behind(name: str, options: dict[str, Any], factory: Any) -> None:
    model = model_of(name, options, factory)
    before = {key: value.clone() for key, value in model.state_dict().items()}
    larger, more = isi.pykeen.insert(model, factory, NEW)
    assert larger.num_entities == more.num_entities == ENTITIES + 2
    assert [more.entity_to_id[label] for label in ("e0", "e19", "cup", "mug")] == [0, 19, 20, 21]
    assert more.num_triples == factory.num_triples + len(NEW)
    for key, value in model.state_dict().items():
        torch.testing.assert_close(value, before[key], rtol=0, atol=0)
        known = larger.state_dict()[key][: len(value)] if value.ndim else larger.state_dict()[key]
        torch.testing.assert_close(known, value, rtol=0, atol=0)
    torch.testing.assert_close(scores(larger, factory.mapped_triples), scores(model, factory.mapped_triples))
    assert torch.isfinite(scores(larger, more.mapped_triples)).all()


@pytest.mark.parametrize("of", ["factory", "inverse"])
@pytest.mark.parametrize("name", MODELS)
def test_a_model_of_any_tables_scores_as_before_and_predicts_with_new_entities(
    name: str, of: str, request: pytest.FixtureRequest
) -> None:
    factory = request.getfixturevalue(of)
    model = model_of(name, MODELS[name], factory)
    read, (head, relation, tail) = read_model(model, factory.mapped_triples, None), factory.mapped_triples.T[:, None]
    theirs = model.predict_t(factory.mapped_triples[:, :2]), model.predict_h(factory.mapped_triples[:, 1:])
    heads = read.score_tails(tail, relation + RELATIONS) if of == "inverse" else read.score_heads(relation, tail)
    ours = read.score_tails(head, relation)[0], heads[0]
    margin = (ours[0] - theirs[0]).mean()
    for mine, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(mine - margin, other, rtol=1e-4, atol=1e-4)
    larger, more = isi.pykeen.insert(model, factory, NEW, initializer="mean")
    for key, value in model.state_dict().items():
        known = larger.state_dict()[key][: len(value)] if value.ndim else larger.state_dict()[key]
        torch.testing.assert_close(known, value, rtol=0, atol=0)
    for query in ({"head": "cup"}, {"tail": "mug"}):
        named = predict_target(model=larger, relation="r0", triples_factory=more, **query).df
        assert len(named) == ENTITIES + 2
        assert np.isfinite(named["score"]).all()


@pytest.mark.parametrize("name", ["RGCN", "CompGCN", "NodePiece"])
def test_a_model_that_computes_vectors_says_what_to_do(name: str, factory: Any, inverse: Any) -> None:
    known = factory if name == "RGCN" else inverse
    with pytest.raises(InputError, match=f"argument 'model': {name}: .*train_on"):
        isi.pykeen.insert(model_of(name, {}, known), known, NEW)


def test_a_triple_counts_in_both_directions_if_the_model_has_inverses(inverse: Any) -> None:
    """PyKEEN's rows 2r and 2r + 1 are those of relation r and of its inverse."""
    model = model_of("transe", {}, inverse)
    done = isi.pykeen.inserted(model, inverse, NEW, initializer="soft_rs", margin=1.0)
    assert [(entity.insert_triples, entity.between) for entity in done.report()] == [(2, 1), (1, 1)]
    larger, more = isi.pykeen.enlarge(model, inverse, done)
    assert (more.num_triples, more.create_inverse_triples) == (inverse.num_triples + len(NEW), True)
    assert larger.num_relations == 2 * RELATIONS
    ids = [(more.entity_to_id[h], int(r[1]), more.entity_to_id[t]) for h, r, t in NEW] + inverse.mapped_triples.tolist()
    triples = np.array([(h, 2 * r, t) for h, r, t in ids] + [(t, 2 * r + 1, h) for h, r, t in ids])
    of_known = (triples[:, [0, 2]] < ENTITIES).all(1)
    tables = [
        table()[:].detach().numpy() for (table,) in (model.entity_representations, model.relation_representations)
    ]
    expected = isi.insert(
        *tables, triples[~of_known], new=2, model="transe_l1", model_options={"margin": 1.0}, initializer="soft_rs",
        known_triples=triples[of_known],
    )  # fmt: skip
    unit = expected.entities / np.linalg.norm(expected.entities, axis=1, keepdims=True)  # as TransE's vectors are
    np.testing.assert_allclose(done.entities, unit, rtol=1e-5, atol=1e-6)
    assert done.relations.shape == (RELATIONS, 2 * DIMENSION)


@pytest.mark.parametrize("name", ["complex", "transe", "ConvE"])
def test_interference_ranks_as_pykeen_does(name: str, factory: Any, inverse: Any) -> None:
    for of in (factory, inverse):
        done = isi.pykeen.inserted(model_of(name, MODELS.get(name, {}), of), of, NEW, initializer="mean")
        larger, more = isi.pykeen.enlarge(model_of(name, MODELS.get(name, {}), of), of, done)
        metrics = RankBasedEvaluator().evaluate(
            larger, of.mapped_triples, additional_filter_triples=more.mapped_triples, use_tqdm=False, batch_size=32
        )
        assert done.interference().h_cur == pytest.approx(metrics.get_metric("mrr"), abs=1e-4)


@pytest.mark.parametrize("name", ["es", "soft_es", "kind_mean", "mean", "map_mean", "iu"])
def test_a_model_without_inverse_takes_initializers_that_need_none(name: str, factory: Any) -> None:
    words = np.random.default_rng(0).standard_normal((ENTITIES + 2, 5))
    kinds = ["a", "b"] * (ENTITIES // 2 + 1)
    model = model_of("rescal", {}, factory)
    done = isi.pykeen.inserted(model, factory, NEW, words=words, kinds=kinds, initializer=name)
    assert done.initializer == name


@pytest.mark.parametrize(("name", "options"), CLOSED, ids=id_of)
@pytest.mark.parametrize("of", ["factory", "inverse"])
def test_ranks_of_known_triples_are_unchanged_when_new_candidates_are_masked(
    name: str, options: dict[str, Any], of: str, request: pytest.FixtureRequest
) -> None:
    factory = request.getfixturevalue(of)
    model = model_of(name, options, factory)
    larger, more = isi.pykeen.insert(model, factory, NEW)
    ranked = []
    for one, own in ((model, factory), (larger, more)):
        evaluator = RankBasedEvaluator(clear_on_finalize=False)
        evaluator.evaluate(
            one, factory.mapped_triples, batch_size=8, additional_filter_triples=own.mapped_triples,
            restrict_entities_to=range(ENTITIES), pre_filtered_triples=True, use_tqdm=False,
        )  # fmt: skip
        ranked.append({key: np.concatenate(values) for key, values in evaluator.ranks.items()})
    for key, ranks in ranked[0].items():
        np.testing.assert_array_equal(ranks, ranked[1][key])


def test_saved_and_loaded_it_is_the_same(tmp_path: Path, factory: Any) -> None:
    larger, more = isi.pykeen.insert(model_of("complex", {}, factory), factory, NEW)
    larger.save_state(tmp_path / "model.pt")
    more.to_path_binary(tmp_path / "factory")
    again = TriplesFactory.from_path_binary(tmp_path / "factory")
    assert again.entity_to_id == more.entity_to_id
    torch.testing.assert_close(again.mapped_triples, more.mapped_triples)
    loaded = model_of("complex", {}, again)
    loaded.load_state(tmp_path / "model.pt")
    known, expected = (scores(model, more.mapped_triples) for model in (loaded, larger))
    torch.testing.assert_close(known, expected, rtol=0, atol=0)


@pytest.mark.parametrize("name", ["complex", "transe", "transh"])
def test_it_predicts_and_trains_on_from_what_it_knows(name: str, factory: Any) -> None:
    larger, more = isi.pykeen.insert(model_of(name, {}, factory), factory, NEW)
    named = predict_target(model=larger, head="cup", relation="r0", triples_factory=more)
    assert len(named.df) == ENTITIES + 2
    before = larger.entity_representations[0]._embeddings.weight.detach().clone()
    for optimizer in (Adam(larger.parameters(), lr=1e-6), SGD(larger.parameters(), lr=1e-6, momentum=0.9)):
        loop = SLCWATrainingLoop(model=larger.train(), triples_factory=more, optimizer=isi.pykeen.warm(optimizer))
        losses = loop.train(more, num_epochs=2, batch_size=32, use_tqdm=False, continue_training=True)
        assert np.isfinite(losses).all()
    after = larger.entity_representations[0]._embeddings.weight
    assert (after[-2:] != before[-2:]).any()
    torch.testing.assert_close(after, before, rtol=0, atol=1e-3)  # not initialized again


def test_a_factory_without_labels_goes_by_ids(factory: Any) -> None:
    plain = factory.to_core_triples_factory()
    model = model_of("distmult", {}, plain)
    triples = torch.tensor([[20, 0, 1], [3, 1, 20], [21, 2, 2], [20, 1, 21]])
    larger, more = isi.pykeen.insert(model, plain, triples, new=2)
    named, _ = isi.pykeen.insert(model, factory, NEW)
    for key, value in larger.state_dict().items():
        torch.testing.assert_close(value, named.state_dict()[key], rtol=0, atol=0)
    assert more.num_entities == 22


# What a user gives


def test_the_result_of_a_pipeline_stands_for_model_and_factory(factory: Any) -> None:
    model = model_of("distmult", {}, factory)
    result = PipelineResult(
        random_seed=0, model=model, training=factory, training_loop=None, losses=[], metric_results=None,
        train_seconds=0.0, evaluate_seconds=0.0,
    )  # fmt: skip
    expected, more = isi.pykeen.insert(model, factory, NEW)
    for larger, enlarged in (isi.pykeen.insert(result, NEW), isi.pykeen.insert(result, triples=NEW)):
        assert enlarged == more
        assert torch.equal(*(one.entity_representations[0]() for one in (larger, expected)))


@pytest.mark.parametrize("form", [
    pd.DataFrame(NEW), {"cup": {"r0": "e1", "r1": ["mug"]}, "e3": {"r1": ["cup"]}, "mug": {"r2": "e2"}},
    TriplesFactory.from_labeled_triples(np.array(NEW)), np.array(NEW), iter(NEW),
], ids=["frame", "facts", "factory", "array", "iterator"])  # fmt: skip
def test_triples_come_in_the_forms_that_a_user_has(form: Any, factory: Any) -> None:
    model = model_of("distmult", {}, factory)
    done, expected = (isi.pykeen.inserted(model, factory, triples) for triples in (form, NEW))
    by_name = dict(zip(map(done.names.of, done.new), done.entities[ENTITIES:], strict=True))
    for name, row in zip(("cup", "mug"), expected.entities[ENTITIES:], strict=True):
        np.testing.assert_allclose(by_name[name], row, rtol=1e-4)


@pytest.mark.parametrize(("new", "known", "expected"), [
    ("disease_or_syndrom", "disease_or_syndrome", True), ("Kitchen", "kitchen", True), ("forks", "fork", True),
    ("living-room", "living room", True), ("kithcen", "kitchen", True), ("kitchan", "kitchen", True),
    ("kitten", "kitchen", False), ("entity 12", "entity 13", False), ("entity 1", "entity 12", False),
    ("mug", "mud", False),
])  # fmt: skip
def test_a_slip_of_the_pen_is_told_from_another_label(new: str, known: str, expected: bool) -> None:
    assert nearly_known([new, "espresso"], ["bed", known, "counter"]) == ({new: known} if expected else {})


def test_a_label_that_is_nearly_known_is_named(factory: Any) -> None:
    labels = {f"thing {2 * chr(97 + row)}": row for row in range(ENTITIES)}
    named = TriplesFactory(factory.mapped_triples, labels, factory.relation_to_id)
    model = model_of("distmult", {}, named)
    with pytest.warns(UserWarning, match=r"'Thing-aa': did you mean 'thing aa'"):
        isi.pykeen.insert(model, named, [("cup", "r0", "Thing-aa")])
    triples = [("cup", "r0", "thing bb"), ("thing_aa", "r1", "thing cc")]
    with pytest.warns(UserWarning, match="'thing_aa': did you mean 'thing aa'"):
        isi.pykeen.insert(model, named, triples)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        isi.pykeen.insert(model, named, triples, new=["cup", "thing_aa"], calibrate=False)


def test_numeric_literals_stay_and_those_of_new_entities_are_zero(factory: Any) -> None:
    literals = np.arange(2.0 * ENTITIES, dtype=np.float32).reshape(ENTITIES, 2)
    known = TriplesNumericLiteralsFactory(
        mapped_triples=factory.mapped_triples, entity_to_id=factory.entity_to_id,
        relation_to_id=factory.relation_to_id, numeric_literals=literals, literals_to_id={"height": 0, "weight": 1},
    )  # fmt: skip
    _, more = isi.pykeen.insert(model_of("distmult", {}, known), known, NEW)
    np.testing.assert_array_equal(more.numeric_literals, np.concatenate([literals, np.zeros((2, 2))]))
    assert more.literals_to_id == {"height": 0, "weight": 1}


# Training afterwards


@pytest.mark.parametrize(("name", "of"), [("complex", "factory"), ("transe", "inverse"), ("ConvE", "inverse")])
def test_new_rows_alone_are_trained(name: str, of: str, request: pytest.FixtureRequest) -> None:
    factory = request.getfixturevalue(of)
    larger, more = isi.pykeen.insert(model_of(name, MODELS.get(name, {}), factory), factory, NEW, initializer="mean")
    before = {key: value.clone() for key, value in larger.state_dict().items()}
    trained = isi.pykeen.fit_new(larger, more, NEW, epochs=30)
    for key, value in larger.state_dict().items():
        assert torch.equal(value, before[key])
        assert not value.ndim or torch.equal(trained.state_dict()[key][:ENTITIES], value[:ENTITIES])
    told = more.mapped_triples[-len(NEW) :]
    head, relation, tail = (told if of == "factory" else both_ways(told, RELATIONS)).T[:, None]
    score = read_model(larger, more.mapped_triples, None).model

    def loss(model: ERModel) -> float:
        """Of a triple, and of 9 times its corrupted heads, tails and relations."""
        read = replace(read_model(model, more.mapped_triples, None), model=score)
        others = read.score_heads(relation, tail), read.score_relations(head, tail), read.score_tails(head, relation)
        return (softplus(-read.score(head, relation, tail)).mean() + 9 * sum(softplus(f).mean() for f in others)).item()

    assert loss(trained) < loss(larger)
    for new in (["cup", "mug"], [ENTITIES, "mug"], 2):
        again = isi.pykeen.fit_new(larger, more, new=new, epochs=30)
        for key, value in trained.state_dict().items():
            assert torch.equal(again.state_dict()[key], value)


def test_any_entity_can_be_trained_as_new(factory: Any) -> None:
    model = model_of("distmult", {}, factory)
    trained = isi.pykeen.fit_new(model, factory, new=["e4"], epochs=5)
    before, after = (one.entity_representations[0]().detach() for one in (model, trained))
    assert (before != after).any(1).nonzero().flatten().tolist() == [4]
    for new in ([], 0, ENTITIES, ["cup"]):
        with pytest.raises(InputError, match="argument 'new'"):
            isi.pykeen.fit_new(model, factory, new=new)


@pytest.mark.parametrize(("name", "of", "loop"), [("SimplE", "factory", "slcwa"), ("ConvE", "inverse", "lcwa")])
def test_training_goes_on_from_the_vectors_as_they_are(
    name: str, of: str, loop: str, request: pytest.FixtureRequest
) -> None:
    factory = request.getfixturevalue(of)
    larger, more = isi.pykeen.insert(model_of(name, MODELS[name], factory), factory, NEW, initializer="mean")
    before = [table().detach().clone() for table in larger.entity_representations]
    losses = isi.pykeen.train_on(larger, more, 2, training_loop=loop, learning_rate=1e-5, batch_size=32)
    assert len(losses) == 2
    assert np.isfinite(losses).all()
    after = [table().detach() for table in larger.entity_representations]
    assert all((old != new).any() for old, new in zip(before, after, strict=True))
    torch.testing.assert_close(after, before, rtol=0, atol=1e-3)
