"""The answer of the report: its words follow the numbers, and the parts of the gain sum to it."""

import html
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from isi.report.data import Experiment, Results
from isi.report.page import Page
from isi.report.sections import answer
from isi.report.words import HALVES, label
from tests import committed
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
    more: tuple[str, ...] = (),
) -> Results:
    """Results right after insertion: over all queries, with the novel entity given,
    and about earlier knowledge.

    ``epochs``: those until a model's held-out MRR* is that of the joint model; others are not
    changed. ``more``: further initializers.
    """
    home = base(*more).experiments["home"]
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
    return of_experiment(base(*more), "home", runs=runs, queries=queries)


def said(results: Results) -> list[str]:
    """The items of the answer."""
    part = Page.of("report").answer
    filled = part.filled(results) if part else None
    assert filled
    return filled.blocks[0].text.splitlines()


def lead(item: str) -> str:
    """The bold words at the start of an item, which are a link."""
    return re.sub(r"\[(.*)\]\(.*\)", r"\1", item.split("**")[1])


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
    change = 100 * (even(**better)["es"] / 50 - 1)
    side = "below" if change < 0 else "above"
    assert f"ES is {abs(change):.1f} % {side} Xavier (paper: 41.4 %)." in first


@pytest.mark.parametrize(
    ("everything", "asked", "starts", "then"),
    [
        ((20, 58, 59, 60), (20, 40, 50, 60), "nearly all of ES's gain is", (25, 25)),
        ((20, 40, 50, 55), (20, 40, 50, 55), "most of ES's gain is", (29, 14)),
        ((20, 25, 30, 70), (20, 25, 30, 70), "less than half of ES's gain is", (10, 80)),
        ((20, 50, 45, 60), (20, 50, 45, 60), "the parts of ES's gain have different signs", None),
        ((60, 50, 40, 30), (60, 70, 40, 30), "ES gains nothing", None),
    ],
)
def test_the_gain_is_called_after_its_parts(
    everything: tuple[float, ...],
    asked: tuple[float, ...],
    starts: str,
    then: tuple[int, int] | None,
) -> None:
    both = [
        dict(zip(("xavier", "mean", "kind_mean", "es"), points, strict=True))
        for points in (everything, asked)
    ]
    (item,) = (
        one
        for one in said(results_of(even(**both[0], rs=0), even(**both[1], rs=0)))
        if lead(one).startswith("Over all queries")
    )
    assert lead(item).startswith(f"Over all queries, {starts}")
    if then:
        expected = "its kind, which ES infers, gives {} %, words and facts {} %.".format(*then)
        assert item.endswith(f"About the new entity, {expected}")
    else:
        assert item.endswith(("the parts have different signs.", "it gains nothing."))


def test_parts_that_no_control_tells_apart_are_named_together() -> None:
    found = results_of(even(es=60, mean=55, rs=0), even(es=60, mean=55, rs=0))
    fewer = of_experiment(found, "home", initializers=["xavier", "es", "rs", "mean"])
    (item,) = (one for one in said(fewer) if lead(one).startswith("Over all queries"))
    assert item.endswith("About the new entity, its kind, words and facts give 50 %.")


@pytest.mark.parametrize(
    ("epochs", "saves", "says"),
    [
        ({"xavier": 3, "es": 1, "rs": 2}, True, "50.0 % fewer"),
        ({"xavier": 1, "es": 3, "rs": 3}, False, "200.0 % more"),
        ({"xavier": 2, "es": 2, "rs": 2}, False, "0.0 % fewer"),
    ],
)
def test_training_is_saved_where_it_converges_first(
    epochs: dict[str, float], saves: bool, says: str
) -> None:
    (item,) = (
        one
        for one in said(results_of(even(), even(es=60), epochs=epochs))
        if "training" in lead(one)
    )
    assert ("saves no training" not in lead(item)) is saves
    assert item.endswith(f"It takes {says} epochs than Xavier about the new entity.")


@pytest.mark.parametrize(
    ("es", "rs", "starts"),
    [
        (40, 30, "The name does more than the facts"),
        (30, 40, "The facts do more than the name"),
        (40, 40, "The name does as much as the facts"),
    ],
)
def test_name_and_facts_are_compared_where_all_three_were_run(
    es: float, rs: float, starts: str
) -> None:
    found = results_of(even(), even(es=es, rs=rs, ers=45), more=("ers",))
    (item,) = (one for one in said(found) if "facts" in lead(one))
    assert lead(item) == f"{starts}."
    assert f"entity MRR* is {es:.1f} by name (ES), {rs:.1f} by facts (RS), 45.0 by both" in item
    assert not [one for one in said(results_of(even(), even())) if "facts" in lead(one)]


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
    assert lead(item).startswith(f"{label('map')} is better") is better
    assert ("at a price" in lead(item)) is price
    assert ("not significantly" in lead(item)) is not better
    side = "lose" if known < 50 else "gain"
    assert f"vector has {asked:.1f}; earlier answers {side} {abs(known - 50):.1f} points" in item


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
    gain = 100 * (everything["es"] / everything["xavier"] - 1)
    assert f"{abs(gain):.1f} % {'below' if gain < 0 else 'above'} Xavier" in items[0]
    (parts,) = (one for one in items if lead(one).startswith("Over all queries"))
    centre, whole = (everything[name] - everything["xavier"] for name in ("mean", best))
    if "nearly all" in parts:
        assert 10 * centre >= 9 * whole > 0
    if "most of" in parts:
        assert 0.9 > centre / whole >= 0.5
    assert ("gains nothing" in lead(parts)) == (whole <= 0)
    training = [one for one in items if "training" in lead(one)]
    # with no epochs of Xavier there is nothing to save
    assert len(training) <= (takes["xavier"] > 0)
    for one in training:
        assert re.search(r"(more|fewer) epochs", one)
        mean = (takes["es"] + takes["rs"]) / 2
        assert ("saves no training" in lead(one)) == (mean >= takes["xavier"])
    (other,) = (one for one in items if lead(one).startswith(label("map")))
    assert ("is better" in lead(other)) == (asked["map"] > asked[best])


#: What is asked of the answer: a reader takes it in at once.
MOST_WORDS, MOST_NUMBERS = 90, 12


def test_the_committed_answer_is_short() -> None:
    text = committed.text_of(Path("reports/tables/answer.md"))
    words = [word for word in text.split() if re.search("[A-Za-z]", word)]
    assert len(words) <= MOST_WORDS
    assert len(re.findall(r"\d+(?:\.\d+)?", text)) <= MOST_NUMBERS
    page = committed.text_of(Path("reports/index.html"))
    (shown,) = re.findall(r'<div class="answer">(.*?)</div>', page, re.DOTALL)
    as_text = html.unescape(re.sub(r"<[^>]+>", "", shown))
    unmarked = re.sub(r"^- |\*\*", "", text, flags=re.MULTILINE)
    assert as_text.split() == unmarked.split()


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
    by = f"{asked['es']:.1f} by name (ES), {asked['rs']:.1f} by facts (RS), {asked['ers']:.1f} by"
    assert f"entity MRR* is {by} both (ERS)." in sentences.text
    now = 100 * home.immediate[home.immediate["scope"] == "all"].groupby("model")["mrr_star"].mean()
    best = max(("es", "rs", "ers"), key=lambda name: asked[name])
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
    text, tables, _ = shown("controls", results_of(even(kind_mean=52, es=60), even(es=45, rs=0)))
    parts = "centre +0.0, kind +2.0 and words and facts +8.0."
    assert f"ES gains +10.0 points over Xavier, of them {parts}" in text
    rows = tables["parts_of_the_gain"].set_index(["scope", "part", "what has it", "minus"])
    assert rows.loc[("all", "words and facts", "ES", "Kind mean"), "MRR*"] == pytest.approx(8)
    assert rows.loc[("given", "the whole gain", "ES", "Xavier"), "entity half"] == pytest.approx(-5)
    found = results_of(even(es=60), even(es=60))
    fewer = of_experiment(found, "home", initializers=["xavier", "es", "mean"])
    assert "centre +0.0 and kind and words and facts +10.0." in shown("controls", fewer)[0]
