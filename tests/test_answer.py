"""The answer of the report: its words follow the numbers, and the parts of the gain sum to it."""

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from isi.report.data import Experiment, Results
from isi.report.page import Page
from isi.report.sections import answer
from isi.report.words import HALVES, label
from tests.reports import EPOCHS, ROOT, of_experiment, shown, small_results

SHIPPED = yaml.safe_load((ROOT / "params.yaml").read_text("utf-8"))["initializers"]
MODELS = ["xavier", "es", "rs", "mean", "kind_mean", "map", "joint"]
#: MRR* (points) by model, the same for every seed and size.
Points = Mapping[str, float]


@cache
def base(*more: str) -> Results:
    models = {name: SHIPPED[name] for name in (*MODELS[:-1], *more)}
    return small_results(["home"], initializers=models, **{"sweep.initializers": {"es": {}}})


def results_of(
    everything: Points = {},  # noqa: B006
    asked: Points = {},  # noqa: B006
    known: Points = {},  # noqa: B006
    epochs: Points = {},  # noqa: B006
) -> Results:
    """Results right after insertion: over all queries, with the novel entity given,
    and about earlier knowledge.

    ``epochs``: those until a model's held-out MRR* is that of the joint model; others are not
    changed.
    """
    home = base().experiments["home"]
    runs, queries = home.runs.copy(), home.queries
    assert queries is not None
    queries = queries.copy()
    for scope, points in (("all", everything), ("known", known)):
        for model, value in points.items():
            chosen = (runs["epoch"] == 0) & (runs["scope"] == scope) & (runs["model"] == model)
            runs.loc[chosen, list(HALVES)] = value / 100
    for model, value in asked.items():
        chosen = (
            (queries["novel"] == "given")
            & (queries["hidden"] != "relation")
            & (queries["scope"] == "novel")
        )
        queries.loc[chosen & (queries["model"] == model), "mrr_star"] = value / 100
    if epochs:
        heldout = runs["scope"] == "novel_heldout"
        first = runs["model"].map({"joint": 0, **epochs})
        runs.loc[heldout, "mrr_star"] = np.where(runs["epoch"] >= first, 0.9, 0.1)[heldout]
    return of_experiment(base(), "home", runs=runs, queries=queries)


def said(results: Results) -> list[str]:
    """The items of the answer."""
    part = Page.of("report").answer
    filled = part.filled(results) if part else None
    assert filled
    return filled.blocks[0].text.splitlines()


def lead(item: str) -> str:
    """The bold words at the start of an item."""
    return item.split("**")[1]


def even(**points: float) -> dict[str, float]:
    """50 points for all models that are not named."""
    return dict.fromkeys(MODELS, 50.0) | points


@pytest.mark.parametrize(
    ("better", "starts"),
    [
        ({"es": 60, "rs": 55}, "Yes"),
        ({"es": 60, "rs": 45}, "In part: ES is"),
        ({"es": 40, "rs": 30}, "No"),
        ({}, "No"),
        ({"es": 40, "rs": 60}, "In part: RS is"),
    ],
)
def test_a_start_is_better_where_its_metric_is(better: dict[str, float], starts: str) -> None:
    first = said(results_of(even(**better), even(es=70, xavier=33)))[0]
    assert lead(first).startswith(starts)
    assert f"is {even(**better)['es']:.1f} for ES and 50.0 for Xavier" in first
    assert "entity MRR* is 70.0, 33.0 and 50.0" in first


@pytest.mark.parametrize(
    ("everything", "asked", "starts"),
    [
        ((20, 40, 50, 55), (20, 40, 50, 55), "Most of the gain is not semantics"),
        ((20, 25, 30, 70), (20, 25, 30, 70), "Most of the gain is semantics"),
        (
            (20, 40, 50, 55),
            (20, 25, 30, 70),
            "Semantics is most of the gain with the novel entity given only",
        ),
        ((20, 25, 30, 70), (20, 40, 50, 55), "Semantics is most of the gain over all queries only"),
        ((20, 50, 45, 60), (20, 25, 30, 70), "The parts of the gain have different signs"),
        ((60, 50, 40, 30), (20, 25, 30, 70), "There is no gain over all queries"),
        ((20, 25, 30, 70), (60, 70, 40, 30), "There is no gain with the novel entity given"),
        ((60, 50, 40, 30), (60, 50, 40, 30), "There is no gain"),
    ],
)
def test_the_gain_is_called_after_its_parts(
    everything: tuple[float, ...], asked: tuple[float, ...], starts: str
) -> None:
    both = [
        dict(zip(("xavier", "mean", "kind_mean", "es"), points, strict=True))
        for points in (everything, asked)
    ]
    second = said(results_of(even(**both[0], rs=0), even(**both[1], rs=0)))[1]
    assert lead(second) == f"{starts}."
    for points in both:
        steps = np.diff([points[name] for name in ("xavier", "mean", "kind_mean", "es")])
        assert f"{points['es'] - points['xavier']:+.1f} points from Xavier" in second
        assert "centre {:+.1f}, kind {:+.1f} and words and facts {:+.1f}".format(*steps) in second


@pytest.mark.parametrize(
    ("epochs", "saves"),
    [
        ({"xavier": 3, "es": 1}, True),
        ({"xavier": 1, "es": 3}, False),
        ({"xavier": 2, "es": 2}, False),
    ],
)
def test_training_is_saved_where_it_converges_first(epochs: dict[str, float], saves: bool) -> None:
    (item,) = (
        one
        for one in said(results_of(even(), even(es=60), epochs=epochs))
        if "training" in lead(one)
    )
    assert ("saves no training" not in lead(item)) is saves
    assert f"takes {epochs['xavier']:.1f} epochs from Xavier and {epochs['es']:.1f} from ES" in item


@pytest.mark.parametrize(
    ("asked", "known", "better", "price"),
    [
        (60, 40, True, True),
        (60, 50, True, False),
        (60, 55, True, False),
        (50, 40, False, False),
        (40, 60, False, False),
    ],
)
def test_another_initializer_is_better_only_if_it_is_and_has_its_price(
    asked: float, known: float, better: bool, price: bool
) -> None:
    results = results_of(even(), even(map=asked, rs=0), even(map=known))
    (item,) = (one for one in said(results) if lead(one).startswith(label("map")))
    assert lead(item).startswith(f"{label('map')} is better about the novel entity") is better
    assert ("at a price" in lead(item)) is price
    assert ("not significantly" in lead(item)) is not better
    assert f"is {asked:.1f} for {label('map')} and 50.0 for ES" in item
    assert f"MRR* is {known:.1f} and 50.0;" in item


@settings(max_examples=15, deadline=None)
@given(
    st.lists(st.integers(10, 90), min_size=12, max_size=12),
    st.lists(st.integers(0, EPOCHS), min_size=3, max_size=3),
)
@example([80, 20, 30, 70, 60, 10, 80, 20, 30, 70, 60, 10], (0, 3, 3))
def test_no_sentence_says_the_contrary_of_the_numbers(
    points: list[int], epochs: tuple[int, int, int]
) -> None:
    everything, asked = (
        dict(zip(MODELS, [*six, 50], strict=True)) for six in (points[:6], points[6:])
    )
    results = results_of(
        everything, asked, even(), dict(zip(("xavier", "es", "rs"), epochs, strict=True))
    )
    items, takes = said(results), dict(zip(("xavier", "es", "rs"), epochs, strict=True))
    best = max(("es", "rs"), key=lambda name: asked[name])
    above = [label(name) for name in ("es", "rs") if everything[name] > everything["xavier"]]
    start = lead(items[0])
    assert [start.startswith("No"), start.startswith("In part"), start.startswith("Yes")][
        len(above)
    ]
    assert all(name in start for name in above if len(above) == 1)
    semantics, gains = (
        [scope[best] - scope[base] for scope in (everything, asked)]
        for base in ("kind_mean", "xavier")
    )
    if "Most of the gain is semantics" in items[1]:
        assert all(2 * part >= gain > 0 for part, gain in zip(semantics, gains, strict=True))
    if "Most of the gain is not semantics" in items[1]:
        assert all(0 <= 2 * part < gain for part, gain in zip(semantics, gains, strict=True))
    assert lead(items[1]).startswith("There is no gain") == (min(gains) <= 0)
    (training,) = (one for one in items if "training" in lead(one))
    assert ("saves no training" in lead(training)) == (takes[best] >= takes["xavier"])
    (other,) = (one for one in items if lead(one).startswith(label("map")))
    assert ("is better about the novel entity" in lead(other)) == (asked["map"] > asked[best])
    mean = 100 * np.mean([everything[name] / everything["xavier"] - 1 for name in ("es", "rs")])
    assert f" and {mean:.0f} % here" in items[-1]
    theirs = (41.4 + 37.6) / 2
    assert lead(items[-1]).startswith(
        f"The paper's gain is {'larger' if theirs > mean else 'smaller'}"
    )


def test_the_answer_is_in_numbers_of_the_first_graph() -> None:
    results = small_results(["home", "away"])
    home, part = results.experiments["home"], Page.of("report").answer
    filled = part.filled(results) if part else None
    assert filled
    sentences, figure = filled.blocks
    assert home.queries is not None
    rows = home.queries[(home.queries["scope"] == "novel") & (home.queries["filter"] == "learned")]
    rows = rows[(rows["novel"] == "given") & (rows["hidden"] != "relation")]
    # each row has the same number of queries
    asked = 100 * rows.groupby("model")["mrr_star"].mean()
    best = max(("es", "rs", "ers"), key=lambda name: asked[name])
    assert (
        f"entity MRR* is {asked[best]:.1f}, {asked['xavier']:.1f} and {asked['joint']:.1f}"
        in sentences.text.splitlines()[0]
    )
    now = 100 * home.immediate[home.immediate["scope"] == "all"].groupby("model")["mrr_star"].mean()
    assert (
        f"is {now[best]:.1f} for {label(best)} and {now['xavier']:.1f} for Xavier"
        in sentences.text.splitlines()[0]
    )
    of_all, of_given = figure.content.chart.words.split(". (b)")
    for text, means in ((of_all, now), (of_given, asked)):
        assert f"Xavier {means['xavier']:.1f}, " in text
        assert f"{label(best)} {means[best]:.1f}, Joint {means['joint']:.1f}" in text


def test_there_is_no_answer_where_there_is_nothing_to_compare() -> None:
    part = Page.of("report").answer
    assert part
    assert part.filled(small_results(["moved"])) is None
    home = small_results(["home"])
    assert part.filled(of_experiment(home, "home", initializers=["xavier", "iu"])) is None


# Parts of the gain


@pytest.mark.parametrize(
    ("models", "expected"),
    [
        (
            ["xavier", "es", "mean", "kind_mean"],
            [
                ("centre", "mean", "xavier"),
                ("kind", "kind_mean", "mean"),
                ("words and facts", "es", "kind_mean"),
            ],
        ),
        (
            ["xavier", "es", "mean"],
            [("centre", "mean", "xavier"), ("kind and words and facts", "es", "mean")],
        ),
        (
            ["xavier", "es", "kind_mean"],
            [("centre and kind", "kind_mean", "xavier"), ("words and facts", "es", "kind_mean")],
        ),
        (["xavier", "es"], [("centre, kind and words and facts", "es", "xavier")]),
    ],
)
def test_steps_go_over_the_controls_that_were_run(
    models: list[str], expected: list[tuple[str, str, str]]
) -> None:
    assert answer.steps("es", models) == expected


def of_halves(models: Mapping[str, tuple[float, float]]) -> Experiment:
    """An experiment with entity and relation halves right after insertion, the same for every seed,
    in scope novel.
    """
    results = base("es_permuted")
    runs = results.experiments["home"].runs
    chosen = (runs["scope"] == "novel") & runs["model"].isin([*models])
    rows = runs[chosen].assign(
        **{
            half: [models[name][place] for name in runs.loc[chosen, "model"]]
            for place, half in enumerate(("mrr_star_entity", "mrr_star_relation"))
        }
    )
    rows["mrr_star"] = rows[["mrr_star_entity", "mrr_star_relation"]].mean(axis=1)
    return of_experiment(results, "home", runs=rows, initializers=[*models]).experiments["home"]


def test_parts_are_computed_half_by_half() -> None:
    home = of_halves(
        {"xavier": (0.3, 0.5), "es": (0.5, 0.9), "mean": (0.2, 0.8), "es_permuted": (0.4, 0.6)}
    )
    found = {half: answer.parts(home, "novel", half) for half in HALVES}
    points = {
        (half, part): round(gain.mean, 6)
        for half, gains in found.items()
        for (part, *_), gain in gains.items()
    }
    last = "kind and words and facts"
    assert points == {
        ("mrr_star", "centre"): 10,
        ("mrr_star", last): 20,
        ("mrr_star", "the whole gain"): 30,
        ("mrr_star", "words"): 20,
        ("mrr_star_entity", "centre"): -10,
        ("mrr_star_entity", last): 30,
        ("mrr_star_entity", "the whole gain"): 20,
        ("mrr_star_entity", "words"): 10,
        ("mrr_star_relation", "centre"): 30,
        ("mrr_star_relation", last): 10,
        ("mrr_star_relation", "the whole gain"): 40,
        ("mrr_star_relation", "words"): 30,
    }
    whole, entities, relations = (answer.composition(found[half], "es") or {} for half in HALVES)
    assert [(part, pytest.approx(gain)) for part, gain in (("centre", 10), (last, 20))] == whole[
        "parts"
    ]
    assert (whole["gain"], whole["share"]) == (pytest.approx(30), pytest.approx(200 / 3))
    assert entities["share"] is None  # the centre loses there
    assert relations["last"].parts == pytest.approx((10, 10, 10))


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(0, 1), min_size=4, max_size=4))
def test_parts_sum_to_the_gain_and_a_share_is_one_of_parts_that_are_none_negative(
    halves: list[float],
) -> None:
    names = ("xavier", "mean", "kind_mean", "es")
    home = of_halves({name: (value, value) for name, value in zip(names, halves, strict=True)})
    made = answer.composition(answer.parts(home, "novel"), "es")
    assert made
    steps = 100 * np.diff(halves)
    assert [gain for _, gain in made["parts"]] == pytest.approx(steps, abs=1e-6)
    assert made["gain"] == pytest.approx(100 * (halves[3] - halves[0]), abs=1e-6)
    if made["share"] is None:
        assert made["gain"] < 0.05 or steps.min() < 0
    else:
        assert made["share"] == pytest.approx(100 * steps[2] / steps.sum(), rel=1e-4, abs=1e-4)
        assert 0 <= made["share"] <= 100 + 1e-6


def test_there_is_no_composition_of_a_gain_in_one_step() -> None:
    home = of_halves({"xavier": (0.3, 0.5), "es": (0.5, 0.9)})
    assert answer.composition(answer.parts(home, "novel"), "es") is None
    assert answer.composition({}, "es") is None


def test_what_the_controls_have_is_named_as_far_as_controls_were_run() -> None:
    text, tables, _ = shown("controls", results_of(even(kind_mean=52, es=60), even(es=45)))
    assert "words and facts give ES +8.0 of +10.0 points" in text
    rows = tables["parts_of_the_gain"].set_index(["scope", "part", "what has it", "minus"])
    assert rows.loc[("all", "words and facts", "ES", "Kind mean"), "MRR*"] == pytest.approx(8)
    assert rows.loc[("given", "the whole gain", "ES", "Xavier"), "entity half"] == pytest.approx(-5)
    fewer = of_experiment(results_of(even(es=60)), "home", initializers=["xavier", "es", "mean"])
    assert "kind and words and facts give ES +10.0 of +10.0 points" in shown("controls", fewer)[0]
