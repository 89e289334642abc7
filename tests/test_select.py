"""The default of ``isi.insert``: the initializer that is best for hidden known
entities and does no harm.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

import isi
from isi.evaluation.filtered import EndQueries
from isi.graph.graph import HEAD, TAIL
from isi.initializers.api import INITIALIZERS, InitResult, Registered, initializer, without_weights
from isi.initializers.context import InitContext
from isi.insertion.engine import Method
from isi.insertion.hidden import HiddenDraws, HoldOut, Trial
from isi.insertion.request import stack_of_one
from isi.insertion.selection import Selection, net_mrr, selection_among
from isi.models.bilinear import DistMult
from tests.plain_ranks import filtered_rank

ENTITIES, RELATIONS, DIMENSION = 40, 3, 16
RNG = np.random.default_rng(0)
VECTORS = RNG.standard_normal((ENTITIES, DIMENSION)).astype(np.float32)
MAPS = RNG.standard_normal((RELATIONS, DIMENSION)).astype(np.float32)
THETA = stack_of_one(VECTORS, MAPS, DistMult())
#: The triples of the highest scores, so that every filtered rank is 1: the model has learned them
#: perfectly.
SCORES = np.einsum("hd,rd,td->hrt", VECTORS, MAPS, VECTORS)
TRIPLES = np.argwhere(np.quantile(SCORES, 0.9) < SCORES)
FEWER = TRIPLES[::2]  #: Now some that are right are taken for wrong.
NUMBERS = np.array([4, 4])
pytestmark = pytest.mark.usefixtures("registries")
GIVEN = [(ENTITIES, 0, 3), (5, 1, ENTITIES), (ENTITIES, 2, 8)]


def own(name: str, vectors: Callable[[InitContext], Tensor], **about: Any) -> Registered:
    """Register an initializer; the registry is restored after the test."""

    @initializer(name, cost="entities", **about)
    def function(context: InitContext, times: float = 1.0) -> InitResult:
        return without_weights(times * vectors(context))

    return INITIALIZERS.get(name)


def oracle(context: InitContext) -> Tensor:
    """The true vectors of hidden entities, zero for new ones."""
    table = torch.zeros(ENTITIES + 1, DIMENSION)
    table[:ENTITIES] = torch.from_numpy(VECTORS)
    return table[context.novel]


def loud(context: InitContext) -> Tensor:
    return 1e4 * torch.ones(*context.novel.shape, DIMENSION)


def insert(**changed: Any) -> Any:
    given = {"new": 1, "model": "distmult", "known_triples": TRIPLES, "trained_with": "logistic"}
    return isi.insert(VECTORS, MAPS, GIVEN, **given | changed)


def hold_out(
    triples: np.ndarray = TRIPLES, kinds: np.ndarray | None = None, seed: int = 0
) -> HoldOut:
    return HoldOut(THETA, triples, NUMBERS, None, kinds, seed)


def of(*initializers: Registered, harm: float = 0.01, seed: int = 0) -> Selection:
    selection = selection_among(initializers, hold_out(seed=seed), harm)
    assert selection is not None
    return selection


def trial(about: float, harm: float) -> Trial:
    return Trial(
        "", {}, "logistic", known_ends=about, hidden_ends=about, h_old=1.0, h_cur=1.0, harm=harm
    )


@pytest.mark.parametrize(
    ("about", "lost", "harm", "expected"),
    [
        (0.5, 0.0, 0.01, 0.5),
        (0.5, 0.01, 0.01, 0.45),  # 5 times .01
        (0.5, 0.03, 0.01, -0.05),  # 5 times .01, 25 times .02
        (0.5, 0.03, 0.0, -0.25),
        (0.5, 0.03, 0.1, 0.35),
        (0.5, -0.2, 0.0, 0.5),  # no reward
    ],
)
def test_the_net_mrr_of_a_trial_by_hand(
    about: float, lost: float, harm: float, expected: float
) -> None:
    assert net_mrr(trial(about, lost), harm) == pytest.approx(expected)


def test_an_initializer_of_ones_own_takes_part_and_wins_if_it_is_perfect() -> None:
    own("oracle", oracle)
    done = insert()
    assert done.initializer == done.selection.selected.initializer == "oracle"
    assert done.selection.selected.known_ends > max(
        x.known_ends for x in done.selection.trials if x is not done.selection.selected
    )
    assert done.selection.selected.h_old == pytest.approx(done.selection.selected.h_cur)
    assert done.details.why == done.selection.why
    frame = done.selection.to_frame()
    assert set(frame["initializer"]) >= {"oracle", "map", "fold_in", "mean"}
    assert not {"es", "soft_hybrid"} & set(frame["initializer"])  # they need words
    assert frame.loc[frame["selected"], "initializer"].tolist() == ["oracle"]


def test_means_of_a_few_vectors_and_controls_take_no_part() -> None:
    words = RNG.standard_normal((ENTITIES + 1, 5)).astype(np.float32)
    tried = {each.initializer for each in insert(words=words).selection.trials}
    assert tried == {"map", "fold_in", "soft_es", "mean", "soft_rs", "er_avg", "soft_hybrid"}


@pytest.mark.usefixtures("few_initializers")
def test_options_in_calibration_are_candidates_and_the_chosen_ones_are_used() -> None:
    own("scaled", oracle, defaults={"times": 0.01}, calibration=[{"times": -1.0}, {"times": 1.0}])
    done = insert()
    tried = [each.options for each in done.selection.trials if each.initializer == "scaled"]
    assert tried == [{"times": 0.01}, {"times": -1.0}, {"times": 1.0}]
    assert (done.initializer, done.details.options) == ("scaled", {"times": 1.0})


def test_a_loud_vector_is_chosen_with_a_warning_and_only_if_there_is_nothing_else() -> None:
    noisy, quiet = own("loud", loud), INITIALIZERS.get("mean")
    choice = of(noisy, quiet)
    by_name = {each.initializer: each for each in choice.trials}
    assert by_name["loud"].hidden_ends > by_name["mean"].hidden_ends
    assert by_name["loud"].harm > 0.1 > abs(by_name["mean"].harm)
    assert choice.selected is by_name["mean"]
    assert not choice.warnings
    alone = of(noisy)
    (warning,) = alone.warnings
    assert "loud" in warning
    assert f"{alone.selected.harm:.3f} (by triples of training)" in warning


@pytest.mark.usefixtures("few_initializers")
def test_a_model_that_has_not_learned_is_noticed() -> None:
    swapped = RNG.permutation(ENTITIES)[TRIPLES[:, TAIL]]
    with pytest.warns(UserWarning, match="random"):
        insert(known_triples=np.column_stack([TRIPLES[:, :2], swapped]))


def test_initializers_without_finite_vectors_are_no_candidates() -> None:
    broken = own("broken", lambda context: torch.full((*context.novel.shape, DIMENSION), torch.nan))
    assert [each.initializer for each in of(broken, INITIALIZERS.get("mean")).trials] == ["mean"]


@pytest.mark.parametrize(
    "changed",
    [
        {"choose": False},
        {"known_triples": None},
        {"known_triples": TRIPLES[:5]},
        {"initializer": "map_own_facts"},
        {"options": {"strength": 0.3}},
        {"trained_with": "softmax", "choose": False},
        {"trained_with": None, "choose": False},
    ],
)
def test_without_calibration_the_first_of_the_listed_initializers_is_used(
    changed: dict[str, Any],
) -> None:
    done = insert(**{"trained_with": "logistic", **changed})
    assert done.selection is None
    is_logistic = changed.get("trained_with", "logistic") == "logistic"
    preferred = "map" if is_logistic else "fold_in"
    assert done.initializer == changed.get("initializer", preferred)


def test_entities_of_a_large_embedding_are_not_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("isi.insertion.selection.LARGEST", ENTITIES * DIMENSION - 1)
    assert insert().selection is None


def test_hidden_entities_are_inserted_from_as_many_triples_and_queried_on_the_others() -> None:
    draws = hold_out().hide(12)
    assert draws is not None
    context = draws.context
    assert context.novel.shape == (3, 4)  # a tenth of 40 at a time
    assert len(torch.unique(context.novel)) == 12
    known = {tuple(triple) for triple in TRIPLES.tolist()}
    for model, hidden in enumerate(context.novel.tolist()):
        given = set()
        for place, entity in enumerate(hidden):
            rows = context.observed[model, place]
            for end, relation, is_tail in zip(
                *(
                    getattr(context, name)[model, place][rows].tolist()
                    for name in ("other", "relation", "novel_is_tail")
                ),
                strict=True,
            ):
                given.add((end, relation, entity) if is_tail else (entity, relation, end))
                assert end not in hidden
            assert 1 <= rows.sum() <= 4
            assert not context.theta0.entity[model, entity].any()
        queried = {
            tuple(triple)
            for triple in draws.about.triples[model][draws.about.counted[model]].tolist()
        }
        assert given | queried <= known
        assert not given & queried
        assert all((head in hidden) != (tail in hidden) for head, _, tail in queried)
        earlier = draws.earlier.triples[model][draws.earlier.counted[model]].tolist()
        assert not {end for head, _, tail in earlier for end in (head, tail)} & set(hidden)
        assert not context.known[model, hidden].any()
        assert int(context.known[model].sum()) == ENTITIES - 4


def by_loops(draws: HiddenDraws, vectors: np.ndarray) -> list[float]:
    """The four measures of ``Trial``, query by query, in NumPy; ``vectors``: (M, n, d)."""
    measures: dict[str, list[float]] = {"known": [], "hidden": [], "before": [], "after": []}
    known = {tuple(triple) for triple in FEWER.tolist()}
    for model, hidden in enumerate(draws.context.novel.numpy()):
        table = VECTORS.copy()
        table[hidden] = vectors[model]

        def score(head: int, relation: int, tail: int, of: np.ndarray = table) -> float:
            return float((of[head] * MAPS[relation]) @ of[tail])

        listed: list[tuple[str, EndQueries]] = [("about", draws.about), ("earlier", draws.earlier)]
        for name, queries in listed:
            for triple in queries.triples[model][queries.counted[model]].tolist():
                for slot in (HEAD, TAIL):
                    query = score, triple, slot
                    after = filtered_rank(*query, range(ENTITIES), known)
                    if name == "about":
                        kind = "hidden" if triple[slot] in hidden else "known"
                        measures[kind].append(1 / after)
                        continue
                    before = filtered_rank(*query, {*range(ENTITIES)} - {*hidden}, known)
                    measures["before"].append(1 / before)
                    measures["after"].append(1 / (before + draws.share * (after - before)))
    return [float(np.mean(values)) for values in measures.values()]


def test_hidden_entities_have_candidates_of_their_kind() -> None:
    # -1: none; 5: alone
    kinds = np.where(np.arange(ENTITIES) < ENTITIES - 1, np.arange(ENTITIES) % 3 - 1, 5)
    context = hold_out(kinds=kinds).hide(ENTITIES).context  # type: ignore[union-attr]
    assert set(context.kinds[context.novel].flatten().tolist()) == {-1, 0, 1, 5}
    for draw, hidden in enumerate(context.novel.tolist()):
        for place, entity in enumerate(hidden):
            alike = context.eligible[draw] & torch.from_numpy(kinds == kinds[entity])
            expected = context.eligible[draw] if kinds[entity] in (-1, 5) else alike
            assert context.candidates[draw, place].tolist() == expected.tolist()
    free = hold_out().hide(ENTITIES).context  # type: ignore[union-attr]
    assert free.candidates.tolist() == free.eligible[:, None].tolist()


@pytest.mark.parametrize("share", [1.0, 2.5])
def test_measures_are_those_of_a_loop_over_queries(share: float) -> None:
    draws = hold_out(FEWER, seed=1).hide(12)
    assert draws is not None
    draws, scaled = (
        replace(draws, share=share),
        own("scaled", lambda context: 0.5 * oracle(context).flip(1)),
    )
    measured = draws.trial(Method(scaled, {}, ""))
    assert measured is not None
    expected = by_loops(draws, 0.5 * VECTORS[draws.context.novel.flip(1).numpy()])
    figures = [measured.known_ends, measured.hidden_ends, measured.h_old, measured.h_cur]
    np.testing.assert_allclose(figures, expected, rtol=1e-5)
    assert 0 < measured.harm < measured.h_old < 0.9


def test_without_allowed_harm_a_candidate_that_does_none_is_selected() -> None:
    """Zero vectors rank below all right answers, and are useless."""
    own("origin", lambda context: torch.zeros(*context.novel.shape, DIMENSION))
    choice = of(own("loud", loud), INITIALIZERS.get("origin"), harm=0.0)
    assert choice.selected.initializer == "origin"
    assert choice.selected.harm == 0.0
    # whatever it answers, no candidate that harms by .04 is better than one that does no harm
    assert net_mrr(trial(1.0, 0.041), 0.0) < net_mrr(trial(0.0, 0.0), 0.0)


def test_training_starts_in_the_comparison_where_it_starts_in_an_insertion() -> None:
    draws = hold_out().hide(12)
    assert draws is not None
    trained = INITIALIZERS.get("fold_in")
    method = Method(trained, trained.defaults, "")
    first = draws.insert(method)
    assert first is not None
    near = draws.starting_at(torch.randn_like(first[1])).insert(method)
    assert near is not None
    assert torch.equal(first[1], near[1])


def test_harm_is_measured_on_validation_triples_where_there_are_enough() -> None:
    held, rest = TRIPLES[::4], np.delete(TRIPLES, np.s_[::4], 0)
    test = HoldOut(THETA, rest, NUMBERS, None, None, 0, validation=held)
    draws, by_training = test.hide(12), replace(test, validation=held[:5]).hide(12)
    assert draws is not None
    assert by_training is not None
    assert (draws.are_trained, by_training.are_trained) == (False, True)
    asked = {tuple(each) for each in draws.earlier.triples[draws.earlier.counted].tolist()}
    assert asked <= set(map(tuple, held.tolist()))
    noisy = own("loud", loud)
    measured = draws.trial(Method(noisy, {}, ""))
    assert measured is not None
    assert measured.harm == pytest.approx(measured.h_old - measured.h_cur)


@pytest.mark.usefixtures("few_initializers")
def test_harm_is_measured_on_validation_triples() -> None:
    """Triples of training that are left out: the same as if the model had not seen them."""
    trained, left_out = TRIPLES[::2], TRIPLES[1::2]
    selections = []
    for validation in (None, left_out, torch.from_numpy(left_out)):
        done = insert(known_triples=trained, validation=validation, trained_with="logistic")
        assert done.harm == done.selection.selected.harm
        selections.append(done.selection)
    plain, measured, same = selections
    assert plain.measured_on == "triples of training"
    assert measured.measured_on == "validation triples"
    assert measured.trials == same.trials
    expected = replace(hold_out(trained), numbers=np.array([3]), validation=left_out).hide()
    assert expected is not None
    of_mean = expected.trial(Method(INITIALIZERS.get("mean"), {}, ""))
    assert of_mean is not None
    (mean,) = [each for each in measured.trials if each.initializer == "mean"]
    assert mean.h_old == pytest.approx(of_mean.h_old)
    assert mean.harm == pytest.approx(of_mean.harm)
    assert plain.trials != measured.trials
