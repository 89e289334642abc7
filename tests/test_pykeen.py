"""``isi.pykeen.insert`` against PyKEEN itself: scores, ranks, saving and further training."""

import warnings
from dataclasses import dataclass
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
from pykeen.regularizers import Regularizer
from pykeen.training import SLCWATrainingLoop
from pykeen.triples import CoreTriplesFactory, TriplesFactory, TriplesNumericLiteralsFactory
from pykeen.utils import clamp_norm
from torch.optim import SGD, Adam

from isi.initializers.api import INITIALIZERS
from isi.initializers.inverses import both_ways, unpack_first
from isi.insertion.engine import Method
from isi.insertion.probability import fit_curves
from isi.models.model import Model, register_model
from isi.pykeen import InteractionModel, read_model
from tests.small_pykeen import DIMENSION, ENTITIES, RELATIONS, model_of, ring, tables_of

#: Models that are read in different ways, with their options.
CLOSED: list[tuple[str, dict[str, Any]]] = [
    *(("transe", {"scoring_fct_norm": norm}) for norm in (1, 2)),
    ("transe", {"scoring_fct_norm": 2, "power_norm": True}),
    *((name, {}) for name in ("distmult", "complex", "rotate")),
]
OTHERS: list[tuple[str, dict[str, Any]]] = [
    ("tucker", {"relation_dim": 4}),
    ("transe", {"scoring_fct_norm": 3}),
    ("rescal", {}),
]
#: The models of PyKEEN that people use, with options that make them small.
MODELS: dict[str, dict[str, Any]] = {
    **{name: {} for name in (
        "ComplEx", "DistMult", "TransE", "RotatE", "RESCAL", "HolE", "PairRE", "TransH", "QuatE",
        "DistMA", "ERMLP", "SE", "ProjE", "SimplE", "BoxE", "MuRE", "TransD", "KG2E", "UM",
    )},
    "AutoSF": {"num_components": 4}, "CP": {"rank": 3}, "NTN": {"num_slices": 2},
    "TransR": {"relation_dim": 5}, "TuckER": {"relation_dim": 4},
    "ConvE": {**dict.fromkeys(("embedding_width", "kernel_height", "kernel_width"), 2),
              "embedding_height": 4},
}  # fmt: skip
NEW = [("cup", "r0", "e1"), ("e3", "r1", "cup"), ("mug", "r2", "e2"), ("cup", "r1", "mug")]


def id_of(case: Any) -> str:
    return str(case) if isinstance(case, str) else "-".join(map(str, case.values()))


@pytest.fixture(scope="module")
def factory() -> TriplesFactory:
    return ring()


@pytest.fixture(scope="module")
def inverse() -> TriplesFactory:
    """The same triples for models that learn their inverses, too."""
    return ring(inverse=True)


with_and_without_inverses = pytest.mark.parametrize(
    "factory", [ring(), ring(inverse=True)], ids=["", "inverse"]
)


def scores(model: ERModel, triples: torch.Tensor) -> torch.Tensor:
    with torch.no_grad():
        return model.eval().score_hrt(triples)[:, 0]


@pytest.mark.parametrize(("name", "options"), CLOSED + OTHERS, ids=id_of)
def test_a_model_scores_in_our_terms_what_it_scores_itself(
    name: str, options: dict[str, Any], factory: Any
) -> None:
    model = model_of(name, factory, 100, **options)
    read = read_model(model, factory.mapped_triples, None)
    assert isinstance(read.model, InteractionModel) == ((name, options) in OTHERS)
    head, relation, tail = factory.mapped_triples.T[:, None]
    ours, theirs = read.score(head, relation, tail)[0], scores(model, factory.mapped_triples)
    torch.testing.assert_close(ours - ours.mean(), theirs - theirs.mean(), rtol=1e-4, atol=1e-5)
    if not read.model.linear:  # the margin is between true and corrupted triples
        assert ours.mean() > 0 > read.score_tails(head, relation).mean()


@dataclass(frozen=True)
class Rescal(Model):
    """A user's model: f = hᵀRt, with R as a row of d² numbers."""

    def width(self, dimension: int) -> int:
        return dimension**2

    def score(self, head: torch.Tensor, relation: torch.Tensor, tail: torch.Tensor) -> torch.Tensor:
        return (self.transform(head, relation) * tail).sum(-1)

    def transform(self, vectors: torch.Tensor, relation: torch.Tensor) -> torch.Tensor:
        return (vectors[..., None, :] @ self.matrix(relation))[..., 0, :]

    def inverse(self, vectors: torch.Tensor, relation: torch.Tensor) -> torch.Tensor:
        return torch.linalg.solve(self.matrix(relation), vectors[..., None, :], left=False)[
            ..., 0, :
        ]

    def matrix(self, relation: torch.Tensor) -> torch.Tensor:
        return relation.unflatten(-1, (round(relation.shape[-1] ** 0.5), -1))


@pytest.mark.usefixtures("registries")
def test_a_model_of_a_users_own_serves_where_it_scores_as_pykeens(factory: Any) -> None:
    register_model("rescal")(Rescal)
    model = model_of("rescal", factory)
    read = read_model(model, factory.mapped_triples, None)
    assert read.model == Rescal()
    ours = read.score(*factory.mapped_triples.T[:, None])[0]
    torch.testing.assert_close(ours, scores(model, factory.mapped_triples), rtol=1e-4, atol=1e-5)


@with_and_without_inverses
@pytest.mark.parametrize("name", MODELS)
def test_a_model_of_any_tables_scores_as_before_and_predicts_with_new_entities(
    name: str, factory: Any
) -> None:
    model = model_of(name, factory, **MODELS[name])
    read, (head, relation, tail) = (
        read_model(model, factory.mapped_triples, None),
        factory.mapped_triples.T[:, None],
    )
    theirs = (
        model.predict_t(factory.mapped_triples[:, :2]),
        model.predict_h(factory.mapped_triples[:, 1:]),
    )
    if factory.create_inverse_triples:
        ours = read.score_tails(head, 2 * relation)[0], read.score_tails(tail, 2 * relation + 1)[0]
    else:
        ours = read.score_tails(head, relation)[0], read.score_heads(relation, tail)[0]
    before = {key: value.clone() for key, value in model.state_dict().items()}
    margin = (ours[0] - theirs[0]).mean()
    for mine, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(mine - margin, other, rtol=1e-4, atol=1e-4)
    larger, more = isi.pykeen.insert(model, factory, NEW, initializer="mean")
    assert [more.entity_to_id[label] for label in ("e0", "e19", "cup", "mug")] == [0, 19, 20, 21]
    assert more.num_triples == factory.num_triples + len(NEW)
    for key, value in model.state_dict().items():
        known = larger.state_dict()[key][: len(value)] if value.ndim else larger.state_dict()[key]
        assert torch.equal(known, value)
        assert torch.equal(before[key], value)
    for query in ({"head": "cup"}, {"tail": "mug"}):
        named = predict_target(model=larger, relation="r0", triples_factory=more, **query).df
        assert len(named) == ENTITIES + 2
        assert np.isfinite(named["score"]).all()


@with_and_without_inverses
@pytest.mark.parametrize("name", MODELS)
def test_what_is_measured_is_what_pykeen_gets(name: str, factory: Any) -> None:
    """Rows of new entities, and of hidden ones, are under PyKEEN's constraints from the start."""
    model = model_of(name, factory, 0 if factory.create_inverse_triples else 10, **MODELS[name])
    how = {"initializer": "map", "options": {"strength": 0.01}}
    inserted = isi.pykeen.insert(model, factory, NEW, **how)  # type: ignore[arg-type]
    (larger, more), done = inserted, inserted.rows
    for _ in range(2):
        read = read_model(larger, more.mapped_triples, None)
        rows = read.entity[0, ENTITIES:].numpy()
        np.testing.assert_allclose(rows, done.entities[ENTITIES:], rtol=1e-5, atol=1e-6)
        larger.post_parameter_update()
    draws = done.details.test.hide()
    assert draws is not None
    hidden = draws.insert(done.details.method)
    assert hidden is not None
    torch.testing.assert_close(done.details.model.constrain(hidden[1]), hidden[1])
    fitted = inserted.train(epochs=3).model
    rows = read_model(fitted, more.mapped_triples, None).entity[0].numpy()
    fitted.post_parameter_update()
    again = read_model(fitted, more.mapped_triples, None).entity[0].numpy()
    np.testing.assert_allclose(rows, again, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("constrainer", "options", "constraint"),
    [
        (None, None, "none"),
        (torch.nn.functional.normalize, None, "sphere"),
        (clamp_norm, {"maxnorm": 1.0, "p": 2, "dim": -1}, "ball"),
        (clamp_norm, {"maxnorm": 2.0, "p": 2, "dim": -1}, None),
        (clamp_norm, {"maxnorm": 1.0, "p": 1, "dim": -1}, None),
        (torch.clamp, {"min": -0.1, "max": 0.1}, None),
    ],
)
@pytest.mark.parametrize("interaction", ["transe", "complex"])
def test_a_constraint_of_pykeens_is_read_and_another_one_is_kept_as_it_is(
    interaction: str, constrainer: Any, options: Any, constraint: str | None, factory: Any
) -> None:
    if interaction == "complex" and constrainer is torch.clamp:
        return  # which complex numbers do not have
    of_table = {
        "shape": DIMENSION,
        "dtype": torch.cfloat if interaction == "complex" else torch.float,
    }
    model = ERModel(
        triples_factory=factory,
        interaction=interaction,
        interaction_kwargs={"p": 2} if interaction == "transe" else {},
        entity_representations_kwargs={
            **of_table,
            "constrainer": constrainer,
            "constrainer_kwargs": options,
        },
        relation_representations_kwargs=of_table,
        random_seed=0,
    )
    read = read_model(model, factory.mapped_triples, None)
    assert getattr(read.model, "constraint", None) == constraint
    assert isinstance(read.model, InteractionModel) == (constraint is None)
    table = model.entity_representations[0]
    table._embeddings.weight.data *= 9
    rows = read_model(model, factory.mapped_triples, None).entity[0]
    model.post_parameter_update()
    expected = read_model(model, factory.mapped_triples, None).entity[0]
    torch.testing.assert_close(read.model.constrain(rows), expected, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["CompGCN", "NodePiece"])
def test_a_model_that_computes_vectors_says_what_to_do(name: str, inverse: Any) -> None:
    with pytest.raises(InputError, match=f"argument 'model': {name}: .*train_on"):
        isi.pykeen.insert(model_of(name, inverse), inverse, NEW)


@pytest.mark.parametrize("initializer", ["soft_rs", "map"])
def test_a_triple_counts_in_both_directions_if_the_model_has_inverses(
    initializer: str, inverse: Any
) -> None:
    """PyKEEN's rows 2r and 2r + 1 are those of relation r and of its inverse."""
    model = model_of("transe", inverse)
    how = {"initializer": initializer, "trained_with": "logistic"}
    inserted = isi.pykeen.insert(model, inverse, NEW, margin=1.0, **how)
    (larger, more), done = inserted, inserted.rows
    assert [(entity.insert_triples, entity.between) for entity in done.report()] == [(2, 1), (1, 1)]
    assert (more.num_triples, more.create_inverse_triples) == (inverse.num_triples + len(NEW), True)
    assert larger.num_relations == 2 * RELATIONS
    ids = [
        (more.entity_to_id[h], int(r[1]), more.entity_to_id[t]) for h, r, t in NEW
    ] + inverse.mapped_triples.tolist()
    triples = np.array([(h, 2 * r, t) for h, r, t in ids] + [(t, 2 * r + 1, h) for h, r, t in ids])
    of_known = (triples[:, [0, 2]] < ENTITIES).all(1)
    tables = [table.numpy() for table in tables_of(model)]
    expected = isi.insert(
        *tables,
        triples[~of_known],
        new=2,
        model="transe_l1",
        model_options={"margin": 1.0, "constraint": "sphere"},
        known_triples=triples[of_known],
        **how,
    )
    np.testing.assert_allclose(done.entities, expected.entities, rtol=1e-4, atol=1e-5)
    assert done.relations.shape == (RELATIONS, 2 * DIMENSION)


@pytest.mark.usefixtures("few_initializers")
@pytest.mark.filterwarnings("ignore:the model ranks its own triples almost at random")
def test_no_inverse_of_a_query_is_inserted_in_the_calibration() -> None:
    """Random triples and vectors: nothing but its own inverse, which scores alike here,
    predicts a triple.
    """
    entities = 60
    triples = np.unique(
        np.random.default_rng(0).integers((entities, 2, entities), size=(300, 3)), axis=0
    )
    known = CoreTriplesFactory(torch.from_numpy(triples), entities, 2, create_inverse_triples=True)
    model = model_resolver.make("distmult", triples_factory=known, embedding_dim=64, random_seed=0)
    rows = model.relation_representations[0]._embeddings.weight.data
    rows[1::2] = rows[::2]
    new = np.array([(entities, 0, end) for end in range(8)])
    tables = [table.numpy() for table in tables_of(model)]
    apart = [both_ways(torch.from_numpy(ids)).numpy() for ids in (new, triples)]
    facts_once = isi.pykeen.insert(model, known, new, new=1).rows
    facts_twice = isi.insert(
        *tables,
        apart[0],
        new=1,
        model="distmult",
        model_options={"constraint": "sphere"},
        known_triples=apart[1],
    )
    once, twice = (
        next(each.known_ends for each in done.selection.trials if each.initializer == "soft_rs")
        for done in (facts_once, facts_twice)
        if done.selection
    )
    assert twice > 1.2 * facts_twice.selection.random_mrr  # type: ignore[union-attr]
    assert once < 1.1 * facts_once.selection.random_mrr  # type: ignore[union-attr]


@pytest.mark.parametrize("name", ["complex", "transe", "ConvE"])
def test_interference_ranks_as_pykeen_does(name: str, factory: Any, inverse: Any) -> None:
    for of in (factory, inverse):
        model = model_of(name, of, **MODELS.get(name, {}))
        done = isi.pykeen.insert(model, of, NEW, initializer="mean")
        larger, more = done
        metrics = RankBasedEvaluator().evaluate(
            larger,
            of.mapped_triples,
            additional_filter_triples=more.mapped_triples,
            use_tqdm=False,
            batch_size=32,
        )
        assert done.rows.interference().h_cur == pytest.approx(metrics.get_metric("mrr"), abs=1e-4)


@pytest.mark.parametrize("name", ["soft_es", "kind_mean"])
def test_a_model_without_inverse_takes_initializers_that_need_none(name: str, factory: Any) -> None:
    words = np.random.default_rng(0).standard_normal((ENTITIES + 2, 5))
    kinds = ["a", "b"] * (ENTITIES // 2 + 1)
    model = model_of("rescal", factory)
    done = isi.pykeen.insert(model, factory, NEW, words=words, kinds=kinds, initializer=name)
    assert done.initializer == name


def test_an_optimizer_goes_on_from_what_it_knows(factory: Any) -> None:
    model = model_of("complex", factory)
    larger, more = isi.pykeen.insert(model, factory, NEW, initializer="mean")
    before = larger.entity_representations[0]._embeddings.weight.detach().clone()
    for optimizer in (
        Adam(larger.parameters(), lr=1e-6),
        SGD(larger.parameters(), lr=1e-6, momentum=0.9),
    ):
        loop = SLCWATrainingLoop(
            model=larger.train(), triples_factory=more, optimizer=isi.pykeen.warm(optimizer)
        )
        losses = loop.train(
            more, num_epochs=2, batch_size=32, use_tqdm=False, continue_training=True
        )
        assert np.isfinite(losses).all()
    after = larger.entity_representations[0]._embeddings.weight
    assert (after[-2:] != before[-2:]).any()
    torch.testing.assert_close(after, before, rtol=0, atol=1e-3)  # not initialized again


# New relations


@with_and_without_inverses
@pytest.mark.parametrize("name", [name for name in MODELS if name != "UM"])
def test_new_relations_get_the_next_rows_of_every_table(name: str, factory: Any) -> None:
    """PyKEEN's rows 2r and 2r + 1 are those of relation r and of its inverse."""
    model, ways = model_of(name, factory, **MODELS[name]), 1 + factory.create_inverse_triples
    triples = [*NEW, ("cup", "near", "e1"), ("e2", "near", "e3")]
    done = isi.pykeen.insert(
        model, factory, triples, new_relations=["near", "bare"], initializer="mean"
    )
    larger, more = done
    assert more.relation_to_id == {"r0": 0, "r1": 1, "r2": 2, "near": 3, "bare": 4}
    assert (larger.num_real_relations, larger.num_relations) == (
        RELATIONS + 2,
        ways * (RELATIONS + 2),
    )
    assert more.num_triples == factory.num_triples + len(triples)
    for before, after in zip(
        model.relation_representations, larger.relation_representations, strict=True
    ):
        known, rows = (table._embeddings.weight.detach() for table in (before, after))
        assert (after.max_id, len(rows)) == (larger.num_relations, larger.num_relations)
        assert torch.equal(rows[: len(known)], known)
    near = torch.tensor([[0, 3], [20, 3], [5, 1]])
    ours = (
        done.rows.details.embedding.score_tails(*near.T[:, None])[0],
        done.rows.details.embedding.score_heads(near.T[None, 1], near.T[None, 0])[0],
    )
    theirs = larger.predict_t(near), larger.predict_h(near.flip(1))
    for mine, other in zip(ours, theirs, strict=True):
        difference = mine - other  # the margin
        torch.testing.assert_close(
            difference, difference.mean().expand_as(difference), rtol=0, atol=1e-3
        )
    larger.post_parameter_update()  # the rows are under PyKEEN's constraints already
    for mine, other in zip(
        theirs, (larger.predict_t(near), larger.predict_h(near.flip(1))), strict=True
    ):
        torch.testing.assert_close(mine, other, rtol=1e-4, atol=1e-4)


def test_a_relation_and_its_inverse_are_fitted_as_two_relations(inverse: Any) -> None:
    model = model_of("complex", inverse, 50)
    triples = [("e1", "near", "e2"), ("e5", "near", "e2"), ("e7", "near", "e3")]
    larger = isi.pykeen.insert(model, inverse, triples, new_relations=["near"]).model
    tables = [torch.cat([rows.real, rows.imag], 1).numpy() for rows in tables_of(model)]
    ids = torch.tensor([(1, 3, 2), (5, 3, 2), (7, 3, 3)])
    known, new = both_ways(inverse.mapped_triples), both_ways(ids)
    expected = isi.insert(
        *tables, new.numpy(), new=0, new_relations=2, model="complex", known_triples=known.numpy()
    )
    rows = tables_of(larger)[1][-2:]
    np.testing.assert_allclose(
        torch.cat([rows.real, rows.imag], 1), expected.relations[-2:], rtol=1e-4, atol=1e-5
    )
    assert torch.equal(tables_of(larger)[0], tables_of(model)[0])


def test_what_is_new_is_saved_loaded_and_trained_on(tmp_path: Path, inverse: Any) -> None:
    triples = [*NEW, ("e1", "near", "e2")]
    larger, more = isi.pykeen.insert(
        model_of("rotate", inverse),
        inverse,
        triples,
        new_relations=["near"],
        initializer="map",
    )
    larger.save_state(tmp_path / "model.pt")
    more.to_path_binary(tmp_path / "factory")
    again = TriplesFactory.from_path_binary(tmp_path / "factory")
    loaded = model_of("rotate", again)
    loaded.load_state(tmp_path / "model.pt")
    assert torch.equal(*(scores(model, more.mapped_triples) for model in (loaded, larger)))
    for loop in ("slcwa", "lcwa"):
        before = tables_of(larger)[1].clone()
        isi.pykeen.train_on(larger, again, 5, training_loop=loop, batch_size=32)
        after = tables_of(larger)[1]
        assert (after != before).any(1).all()
        torch.testing.assert_close(after.abs(), torch.ones(after.shape))


def test_what_is_new_goes_by_ids_in_a_factory_without_labels(factory: Any) -> None:
    plain, triples = factory.to_core_triples_factory(), [(1, 3, 2), (20, 4, 1), (21, 2, 2)]
    larger, more = isi.pykeen.insert(
        model_of("distmult", plain),
        plain,
        torch.tensor(triples),
        new=2,
        new_relations=2,
        choose=False,
    )
    named, _ = isi.pykeen.insert(
        model_of("distmult", factory),
        factory,
        [("e1", "a", "e2"), ("cup", "b", "e1"), ("mug", "r2", "e2")],
        new_relations=["a", "b"],
        choose=False,
    )
    assert (more.num_entities, more.num_relations) == (22, 5)
    for key, value in larger.state_dict().items():
        assert torch.equal(value, named.state_dict()[key])


def test_a_model_that_cannot_have_new_relations_says_why(factory: Any) -> None:
    shared = ERModel(
        triples_factory=factory,
        interaction="distmult",
        entity_representations_kwargs={"shape": 4},
        relation_representations="LowRank",
        relation_representations_kwargs={"shape": 4, "num_bases": 2},
    )
    wide = model_resolver.make("rescal", triples_factory=factory, embedding_dim=65)
    for model, reason in ((shared, "LowRank"), (wide, "4,096")):
        with pytest.raises(InputError, match=f"argument 'new_relations': .*{reason}"):
            isi.pykeen.insert(model, factory, [("e1", "near", "e2")], new_relations=["near"])


# What a user gives


def test_the_result_of_a_pipeline_stands_for_model_and_factory(factory: Any) -> None:
    model = model_of("distmult", factory)
    result = PipelineResult(
        random_seed=0,
        model=model,
        training=factory,
        training_loop=None,
        losses=[],
        metric_results=None,
        train_seconds=0.0,
        evaluate_seconds=0.0,
    )
    expected, more = isi.pykeen.insert(model, factory, NEW, choose=False)
    for larger, enlarged in (
        isi.pykeen.insert(result, NEW, choose=False),
        isi.pykeen.insert(result, triples=NEW, choose=False),
    ):
        assert enlarged == more
        assert torch.equal(*(tables_of(one)[0] for one in (larger, expected)))


@pytest.mark.parametrize(
    "form",
    [
        pd.DataFrame(NEW),
        {"cup": {"r0": "e1", "r1": ["mug"]}, "e3": {"r1": ["cup"]}, "mug": {"r2": "e2"}},
        TriplesFactory.from_labeled_triples(np.array(NEW)),
        np.array(NEW),
        iter(NEW),
    ],
    ids=["frame", "facts", "factory", "array", "iterator"],
)
def test_triples_come_in_the_forms_that_a_user_has(form: Any, factory: Any) -> None:
    model = model_of("distmult", factory)
    how = {"initializer": "map"}
    done, expected = (isi.pykeen.insert(model, factory, each, **how) for each in (form, NEW))
    by_name = dict(zip(done.rows.entity_names[ENTITIES:], done.vectors, strict=True))
    for name, row in zip(("cup", "mug"), expected.vectors, strict=True):
        np.testing.assert_allclose(by_name[name], row, rtol=1e-4)


def test_a_label_that_is_nearly_known_is_named(factory: Any) -> None:
    labels = {f"thing {2 * chr(97 + row)}": row for row in range(ENTITIES)}
    named = TriplesFactory(factory.mapped_triples, labels, factory.relation_to_id)
    model = model_of("distmult", named)
    slip = [("cup", "r0", "Thing-aa")]  # which no triple joins to a known entity
    with pytest.raises(InputError, match=r"^argument 'triples': .*'Thing-aa'.*'thing aa'"):
        isi.pykeen.insert(model, named, slip)
    larger, _ = isi.pykeen.insert(model, named, slip, new=["cup", "Thing-aa"], initializer="mean")
    assert larger.num_entities == ENTITIES + 2
    triples = [("cup", "r0", "thing bb"), ("thing_aa", "r1", "thing cc")]
    with pytest.warns(UserWarning, match="'thing_aa': did you mean 'thing aa'"):
        isi.pykeen.insert(model, named, triples, choose=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        isi.pykeen.insert(model, named, triples, new=["cup", "thing_aa"], choose=False)


def test_ids_beside_labels_and_facts_of_known_entities_are_told_what_to_do(factory: Any) -> None:
    model = model_of("distmult", factory)
    with pytest.raises(InputError, match=f"triple 1.*no entity has the id {ENTITIES}.*'new'"):
        isi.pykeen.insert(model, factory, torch.tensor([[0, 0, 1], [ENTITIES, 0, 1]]))
    ids = torch.tensor([[ENTITIES, 0, 1]])
    larger, _ = isi.pykeen.insert(model, factory, ids, new=["cup"], initializer="mean")
    assert larger.num_entities == ENTITIES + 1
    with pytest.raises(InputError, match=r"got 7$"):
        isi.pykeen.insert(model, factory, torch.tensor([[ENTITIES, 7, 1]]), new=["cup"])
    for facts, new in (([("e1", "r0", "e2")], None), ([("e1", "r0", "e2")], ["cup"])):
        with pytest.raises(InputError, match=r"known already.*train_on.*from_pykeen"):
            isi.pykeen.insert(model, factory, facts, new=new)


@pytest.mark.parametrize("name", ["ComplEx", "TransH", "ConvE", "NTN"])
def test_a_model_that_has_just_been_read_in_training_is_copied(name: str, factory: Any) -> None:
    """Regularizers keep a term with its gradient until the next update."""
    model = model_of(name, factory, **MODELS[name]).train()
    for part in (*model.entity_representations, *model.relation_representations):
        part()
    model.cache = [model.score_hrt(factory.mapped_triples)]  # another tensor with a graph
    terms = [part.regularization_term for part in model.modules() if isinstance(part, Regularizer)]
    inserted = isi.pykeen.insert(model, factory, NEW, initializer="mean")
    larger, trained = inserted.model, inserted.train(epochs=1).model
    for copy in (larger, trained):
        kept = [part for part in copy.modules() if isinstance(part, Regularizer)]
        assert len(kept) == len(terms)
        assert all(not part.updated and not part.regularization_term.any() for part in kept)
        assert not copy.cache[0].requires_grad
    after = [part.regularization_term for part in model.modules() if isinstance(part, Regularizer)]
    assert all(one is other for one, other in zip(terms, after, strict=True))
    assert model.training


def test_numeric_literals_stay_and_those_of_new_entities_are_zero(factory: Any) -> None:
    literals = np.arange(2.0 * ENTITIES, dtype=np.float32).reshape(ENTITIES, 2)
    known = TriplesNumericLiteralsFactory(
        mapped_triples=factory.mapped_triples,
        entity_to_id=factory.entity_to_id,
        relation_to_id=factory.relation_to_id,
        numeric_literals=literals,
        literals_to_id={"height": 0, "weight": 1},
    )
    _, more = isi.pykeen.insert(model_of("distmult", known), known, NEW, choose=False)
    np.testing.assert_array_equal(
        more.numeric_literals, np.concatenate([literals, np.zeros((2, 2))])
    )
    assert more.literals_to_id == {"height": 0, "weight": 1}


# Training afterwards


@pytest.mark.parametrize(
    ("name", "factory"), [("complex", ring()), ("transe", ring(True)), ("ConvE", ring(True))]
)
def test_new_rows_alone_are_trained(name: str, factory: Any) -> None:
    model = model_of(name, factory, **MODELS.get(name, {}))
    inserted = isi.pykeen.insert(model, factory, NEW, initializer="mean")
    larger = inserted.model
    before = {key: value.clone() for key, value in larger.state_dict().items()}
    again = inserted.train(epochs=20)
    trained = again.model
    for key, value in larger.state_dict().items():
        assert torch.equal(value, before[key])
        assert not value.ndim or torch.equal(trained.state_dict()[key][:ENTITIES], value[:ENTITIES])
    assert (again.vectors != inserted.vectors).any(1).all()
    assert (again.initializer, again.harm) == ("mean", None)


def test_a_larger_model_is_made_on_first_use(factory: Any) -> None:
    done = isi.pykeen.insert(model_of("distmult", factory), factory, NEW, initializer="mean")
    assert not {"model", "factory"} & vars(done).keys()
    assert tuple(done) == (done.model, done.factory)


@pytest.mark.usefixtures("few_initializers")
def test_harm_is_measured_on_validation_triples_in_any_form(factory: Any) -> None:
    model = model_of("distmult", factory, 50)
    known, held_out = factory.split([0.7, 0.3], random_state=0)
    labels = held_out.triples
    for form in (held_out, labels, held_out.mapped_triples):
        done = isi.pykeen.insert(model, known, NEW, validation=form)
        selection = done.rows.selection
        assert selection is not None
        assert selection.measured_on == "validation triples"
        assert done.harm == selection.selected.harm
    with pytest.raises(InputError, match="argument 'validation'"):
        isi.pykeen.insert(model, known, NEW, validation=[("e1", "r0", "cup")])


@pytest.mark.parametrize(
    ("name", "factory", "loop"), [("SimplE", ring(), "slcwa"), ("ConvE", ring(True), "lcwa")]
)
def test_training_goes_on_from_the_vectors_as_they_are(name: str, factory: Any, loop: str) -> None:
    larger, more = isi.pykeen.insert(
        model_of(name, factory, **MODELS[name]), factory, NEW, initializer="mean"
    )
    before = [table().detach().clone() for table in larger.entity_representations]
    losses = isi.pykeen.train_on(
        larger, more, 2, training_loop=loop, learning_rate=1e-5, batch_size=32
    )
    assert len(losses) == 2
    assert np.isfinite(losses).all()
    after = [table().detach() for table in larger.entity_representations]
    assert all((old != new).any() for old, new in zip(before, after, strict=True))
    torch.testing.assert_close(after, before, rtol=0, atol=1e-3)


def test_probabilities_with_inverses_are_fitted_to_entities_inserted_as_the_new_one(
    inverse: Any,
) -> None:
    model = model_of("distmult", inverse)
    how = {"initializer": "map", "options": {"strength": 0.2}}
    done = isi.pykeen.insert(model, inverse, NEW, **how).rows
    draws = done.details.test.hide()
    assert draws is not None
    plain = INITIALIZERS.get("map")
    both_ways = Method(unpack_first(plain, done.details.model), done.details.options, why="")
    assert done.details.curves == fit_curves(draws, both_ways)
    assert done.details.curves != fit_curves(draws, Method(plain, done.details.options, why=""))


def test_a_model_in_wrappers_is_taken_out_of_them(factory: Any) -> None:
    def wrap(model: ERModel) -> Any:
        return torch.compile(torch.nn.DataParallel(model))

    model = model_of("distmult", factory)
    expected, _ = isi.pykeen.insert(model, factory, NEW, initializer="mean")
    larger, more = isi.pykeen.insert(wrap(model), factory, NEW, initializer="mean")
    assert isinstance(larger, ERModel)
    for name, values in expected.state_dict().items():
        torch.testing.assert_close(larger.state_dict()[name], values)
    before = [values.clone() for values in larger.state_dict().values()]
    isi.pykeen.train_on(wrap(larger), more, epochs=1)  # in place
    assert any(
        not torch.equal(*pair) for pair in zip(before, larger.state_dict().values(), strict=True)
    )
    assert (
        set(isi.from_pykeen(wrap(model), factory).base.entity_names) == factory.entity_to_id.keys()
    )
    assert read_model(wrap(model), factory.mapped_triples, None).entity.shape[1] == ENTITIES


def test_a_wrapper_of_another_model_is_refused(factory: Any) -> None:
    with pytest.raises(InputError, match="expected a model with vectors"):
        isi.pykeen.insert(torch.nn.DataParallel(torch.nn.Linear(2, 2)), factory, NEW)
