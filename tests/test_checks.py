"""``isi.check_initializer`` and ``isi.check_model``: each check names a fault of its kind."""

from dataclasses import dataclass, replace
from typing import Any

import pytest
import torch
from torch import Tensor

import isi
from isi.checks import initializers, models
from isi.errors import InputError
from isi.initializers.api import (
    INITIALIZERS,
    Initializer,
    InitResult,
    Registered,
    initializer,
    without_weights,
)
from isi.initializers.context import InitContext
from isi.initializers.paper import hybrid_similarity
from isi.initializers.similarity import insert_triple_ends, nearest_by_words, word_similarity
from isi.models.bilinear import DistMult
from isi.models.distance import TransE
from isi.models.model import Model


def nearest(context: InitContext) -> InitResult:
    return nearest_by_words(context, word_similarity(context), 1)


def test_a_function_a_registration_and_a_name_are_checked_alike() -> None:
    names = [check.__name__ for check in initializers.CHECKS]
    assert isi.check_initializer(Registered("own", nearest, "Own", needs=("words",))) == names
    assert isi.check_initializer(hybrid_similarity, {"k": 2}) == names
    for wrong, words in (
        ("er", "did you mean 'ers'"),
        (3, "expected a name, a function"),
    ):
        with pytest.raises(InputError, match=words):
            isi.check_initializer(wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"'ers'.*options\.k: .*'three'"):
        isi.check_initializer("ers", {"k": "three"})


def ones(context: InitContext) -> Tensor:
    return torch.ones(*context.novel.shape, context.theta0.entity.shape[-1])


def flat(context: InitContext) -> InitResult:
    return without_weights(ones(context)[0])


def strange_fallback(context: InitContext) -> InitResult:
    return InitResult(ones(context), torch.full(context.novel.shape, 9))


def drawn_elsewhere(context: InitContext) -> InitResult:
    return without_weights(torch.rand(ones(context).shape))


def written_into_known(context: InitContext) -> InitResult:
    context.theta0.entity[0, 0] += 1
    return without_weights(ones(context))


def numbered_by_place(context: InitContext) -> InitResult:
    place = torch.arange(len(context.novel), dtype=torch.float32)
    return without_weights(ones(context) * place[:, None, None])


def all_triples(context: InitContext) -> InitResult:
    heads = (~context.trained).float() @ context.triples[:, 0].float()
    return without_weights(ones(context) * heads[:, None, None])


def heavy(context: InitContext) -> InitResult:
    result = nearest(context)
    assert result.weights is not None
    return replace(result, weights=2 * result.weights)


def kinds_as_rows(context: InitContext) -> InitResult:
    rows = context.kinds[context.novel]
    if (rows < 0).any():
        raise InputError("", "", "no kind")
    return without_weights(ones(context) * rows[..., None])


def silent(context: InitContext) -> InitResult:
    return replace(nearest(context), fallback=torch.zeros_like(context.novel))


def wordless(context: InitContext) -> InitResult:
    return without_weights(ones(context))


def mapped_ends(context: InitContext) -> InitResult:
    return without_weights(insert_triple_ends(context, context.theta0.model.inverse).mean(2))


WORDS: dict[str, Any] = {"needs": ("words",)}


@pytest.mark.parametrize(
    ("function", "about", "check"),
    [
        (nearest, {**WORDS, "grid": {"k": [1]}}, initializers.listed_options_are_valid),
        (flat, {}, initializers.result_has_its_shapes),
        (strange_fallback, {}, initializers.result_has_its_shapes),
        (drawn_elsewhere, {}, initializers.result_is_the_same_again),
        (written_into_known, {}, initializers.context_stays_as_it_is),
        (numbered_by_place, {}, initializers.stack_has_no_effect),
        (all_triples, {}, initializers.held_out_triples_have_no_effect),
        (heavy, WORDS, initializers.weights_are_of_known_entities),
        (kinds_as_rows, {}, initializers.kinds_may_be_used_or_missing),
        (silent, WORDS, initializers.missing_data_are_replaced),
        (nearest, {}, initializers.needs_are_what_it_uses),
        (wordless, {"needs": ("inverse", "words")}, initializers.missing_data_are_replaced),
        (mapped_ends, {}, initializers.needs_are_what_it_uses),
    ],
)
def test_a_fault_of_an_initializer_is_named_by_its_check(
    function: Initializer, about: dict[str, Any], check: Any
) -> None:
    with pytest.raises(InputError) as failed:
        isi.check_initializer(Registered("broken1", function, "Broken", **about))
    assert f"initializer 'broken1': check {check.__name__}: " in str(failed.value)


@pytest.mark.parametrize(
    ("about", "words"),
    [
        ({"cost": "triples"}, ["cost", "'newton'"]),
        ({"role": "mine"}, ["role", "'own'"]),
        ({"needs": ("word",)}, ["needs", "did you mean 'words'"]),
        ({"need": ("words",)}, ["need", "nexpected"]),
        ({"defaults": [1]}, ["defaults", "[1]"]),
    ],
)
def test_a_registration_refuses_what_does_not_exist(
    about: dict[str, Any], words: list[str]
) -> None:
    before = INITIALIZERS.names()
    with pytest.raises(InputError) as refused:
        initializer("broken1", **about)(nearest)
    for word in ["initializer 'broken1'", *words]:
        assert word in str(refused.value)
    assert INITIALIZERS.names() == before


class Trilinear(Model):
    """f = Σ h r t."""

    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        return (head * relation * tail).sum(-1)

    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return vectors * relation

    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return vectors / relation


@dataclass
class Loose(Trilinear):
    """Its options can change."""


@dataclass(frozen=True)
class Empty(DistMult):
    def width(self, dimension: int) -> int:  # noqa: ARG002
        return 0


@dataclass(frozen=True)
class TwoScores(TransE):
    def score_tails(self, head: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        return 2 * super().score_tails(head, relation, entity)


@dataclass(frozen=True)
class Uphill(TransE):
    def scores(self, entity: Tensor, relation: Tensor, triples: Any) -> Any:
        scores, backward = super().scores(entity, relation, triples)
        return scores, lambda slope: backward(-slope)


@dataclass(frozen=True)
class Directions(Trilinear):
    """f / (‖h‖ ‖t‖), which has no gradient at 0."""

    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        lengths = (head * head).sum(-1) * (tail * tail).sum(-1)
        return super().score(head, relation, tail) / lengths.sqrt()


@dataclass(frozen=True)
class OneWay(TransE):
    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return vectors + relation

    def transform_tail(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return vectors - relation


@dataclass(frozen=True)
class Shrinking(DistMult):
    def constrain(self, vectors: Tensor) -> Tensor:
        return vectors / 2


@dataclass(frozen=True)
class Bent(Trilinear):
    """It says that it is linear."""

    linear = True

    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        return super().score(head, relation, tail).tanh()


@dataclass(frozen=True)
class Marginless(DistMult):
    """It says that it is a distance."""

    linear = False
    distance = True
    margin: float = 1.0


@dataclass(frozen=True)
class ByPlace(Trilinear):
    """Its scores depend on the number of models."""

    def score_tails(self, head: Tensor, relation: Tensor, entity: Tensor) -> Tensor:
        return super().score_tails(head, relation, entity) * (1 + 1e-6 * len(head))


@pytest.mark.parametrize(
    ("model", "check"),
    [
        (Loose(), models.options_are_fields),
        (Empty(), models.width_is_a_number_of_columns),
        (TwoScores(2.0), models.all_ways_to_score_agree),
        (Uphill(2.0), models.gradients_are_those_of_the_score),
        (Directions(), models.zero_vectors_have_finite_gradients),
        (OneWay(2.0), models.maps_undo_each_other),
        (Shrinking(), models.constrained_vectors_stay),
        (Bent(), models.all_ways_to_score_agree),
        (Marginless(), models.distance_has_a_margin),
        (ByPlace(), models.stack_has_no_effect),
    ],
)
def test_a_fault_of_a_model_is_named_by_its_check(model: Model, check: Any) -> None:
    with pytest.raises(InputError) as failed:
        isi.check_model(model)
    assert f"model {type(model).__name__}: check {check.__name__}: " in str(failed.value)


def test_an_error_of_the_subjects_own_is_raised_with_the_name_of_the_check() -> None:
    def unready(_context: InitContext) -> InitResult:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError) as failed:
        isi.check_initializer(unready)
    assert "result_has_its_shapes" in "".join(failed.value.__notes__)


def test_a_model_is_checked_with_its_options_by_name() -> None:
    names = [check.__name__ for check in models.CHECKS]
    assert isi.check_model("transe", {"squared": False}) == isi.check_model(TransE(3.0)) == names
    with pytest.raises(InputError, match=r"options\.margin"):
        isi.check_model("transe", {"margin": -1.0})
    with pytest.raises(InputError, match=r"expected a name or a model .*DistMult"):
        isi.check_model(DistMult)  # type: ignore[arg-type]


def test_checks_compute_with_one_thread_and_restore_their_number() -> None:
    before, seen = torch.get_num_threads(), set[int]()

    def counted(context: InitContext) -> InitResult:
        seen.add(torch.get_num_threads())
        return without_weights(ones(context))

    torch.set_num_threads(4)
    try:
        isi.check_initializer(counted)
        assert seen == {1}
        assert torch.get_num_threads() == 4
    finally:
        torch.set_num_threads(before)
