"""``isi.pykeen.insert`` against PyKEEN itself: scores, ranks, saving and further training."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import isi

pytest.importorskip("pykeen")

from pykeen.evaluation import RankBasedEvaluator
from pykeen.models import ERModel, model_resolver
from pykeen.predict import predict_target
from pykeen.training import SLCWATrainingLoop
from pykeen.triples import CoreTriplesFactory, TriplesFactory
from torch.optim import SGD, Adam

from isi.pykeen import InteractionModel, read_model

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


@pytest.mark.parametrize("name", ["es", "soft_es", "kind_mean", "mean", "map_mean", "iu"])
def test_a_model_without_inverse_takes_initializers_that_need_none(name: str, factory: Any) -> None:
    words = np.random.default_rng(0).standard_normal((ENTITIES + 2, 5))
    kinds = ["a", "b"] * (ENTITIES // 2 + 1)
    model = model_of("rescal", {}, factory)
    done = isi.pykeen.inserted(model, factory, NEW, words=words, kinds=kinds, initializer=name)
    assert done.initializer == name


@pytest.mark.parametrize(("name", "options"), CLOSED, ids=id_of)
def test_ranks_of_known_triples_are_unchanged_when_new_candidates_are_masked(
    name: str, options: dict[str, Any], factory: Any
) -> None:
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
