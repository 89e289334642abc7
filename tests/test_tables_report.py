"""Tables of the main report, and places and colours of its figures: a few runs by hand."""

import types
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb

from isi.report import charts
from isi.report.tables import method, paper, results
from isi.report.tables.data import Experiment, Models
from isi.report.tables.estimates import HALVES

NAN = float("nan")


class SimpleNamespace(types.SimpleNamespace):
    """Values by name that are told apart as objects, as results are."""

    __hash__ = object.__hash__


LABELS = {
    "xavier": "Xavier",
    "mean": "Mean",
    "es": "ES",
    "rs": "RS",
    "es_permuted": "Permuted ES",
    "joint": "Joint",
    "finetune_only": "Nothing inserted",
}
MODELS = Models(LABELS, dict.fromkeys(("es", "rs"), "isi") | {"xavier": "paper"})
ENTITIES = pd.DataFrame(
    [
        ("shelf", "object", "home"),
        ("open", "affordance", "home"),
        ("push", "affordance", "home"),
        ("kitchen", "room", "home"),
        ("fan", "object", "shop"),
    ],
    columns=["entity", "kind", "source"],
)
#: A model, a scope, a seed, an epoch and MRR*.
Row = tuple[str, str, int, int, float]


def runs(rows: Sequence[Row]) -> pd.DataFrame:
    frame = pd.DataFrame(rows, columns=["model", "scope", "seed", "epoch", "mrr_star"])
    halves = {"mrr_star_entity": frame["mrr_star"], "mrr_star_relation": frame["mrr_star"]}
    return frame.assign(size=5, session=1, queries=4, **halves)


def home(rows: pd.DataFrame, **cached: Any) -> Experiment:
    """The runs as an experiment; ``cached``: in place of what it would read."""
    names = [name for name in LABELS if name in set(rows["model"])]
    names = [name for name in names if name not in {"joint", "finetune_only"}]
    sides: dict[str, Any] = {
        "margin": 0.08,
        "max_epochs": 9,
        "queries": cached.pop("queries", None),
    }
    made = Experiment("home", "the home", MODELS, names, rows, finetuned=names, **sides)
    made.__dict__.update(cached)
    return made


def of(*experiments: Any, **more: Any) -> Any:
    """Results with these experiments."""
    return SimpleNamespace(
        experiments=experiments, standalone=experiments, extended=experiments, models=MODELS, **more
    )


def frame(made: Any, name: str = "") -> pd.DataFrame:
    """A frame that a table's function made, or the one of this name."""
    found = made[name] if name else made
    assert isinstance(found, pd.DataFrame)
    return found


# Right after insertion


def test_rows_follow_the_order_of_models_and_scopes() -> None:
    rows = [(model, scope, 0, 0, 0.5) for model in ("joint", "es", "xavier") for scope in "ab"]
    experiment = home(runs(rows))
    means = runs(rows).groupby(["scope", "model"])[["mrr_star"]].mean()
    table = results.in_rows(means, MODELS, experiment.rows, scope=["b", "a"])
    assert table[["scope", "model"]].to_numpy().tolist() == [
        [scope, label] for scope in "ba" for label in ("Xavier", "ES", "Joint")
    ]
    shown = results.by_label(
        MODELS, ["es", "rs"], {"n": {"rs": 2}, "g": means.loc["a"], "": means.loc["b"]}, "who"
    )
    assert list(shown) == ["who", "n", "g: mrr_star", "mrr_star"]
    assert shown["who"].tolist() == ["ES", "RS"]
    assert shown["n"].isna().tolist() == [True, False]


@pytest.mark.parametrize(("es", "number"), [(0.7, 2), (0.8, 3)])
def test_one_row_says_what_all_initializers_share(es: float, number: int) -> None:
    values = {"xavier": 0.7, "es": es, "joint": 0.9}
    rows = runs([(name, "known_closed", 0, 0, value) for name, value in values.items()])
    table = frame(results.scopes(of(home(rows), suffix="")), "scopes")
    assert len(table) == number
    assert table["model"].iloc[-1] == "Joint"


@pytest.mark.parametrize(
    ("models", "expected"),
    [
        (
            ["xavier", "es", "mean", "kind_mean"],
            {"centre": "mean", "kind": "kind_mean", "words and facts": "es"},
        ),
        (["xavier", "es", "mean"], {"centre": "mean", "kind and words and facts": "es"}),
        (["xavier", "es", "kind_mean"], {"centre and kind": "kind_mean", "words and facts": "es"}),
        (["xavier", "es"], {"centre and kind and words and facts": "es"}),
    ],
)
def test_steps_go_over_the_controls_that_were_run(
    models: list[str], expected: dict[str, str]
) -> None:
    steps = results.steps("es", models)
    assert {part: model for part, model, _ in steps} == expected
    assert [before for *_, before in steps] == ["xavier", *list(expected.values())[:-1]]


def test_parts_sum_to_the_gain() -> None:
    values = {"xavier": 0.4, "es": 0.7, "mean": 0.5, "es_permuted": 0.5}
    rows = runs(
        [(name, "novel", seed, 0, value) for name, value in values.items() for seed in (0, 1)]
    )
    bars = frame(results.answer_parts(of(home(rows))))
    bars = bars[bars["scope"] == "novel"].set_index("part")
    assert bars.loc["centre", ["start", "end"]].tolist() == pytest.approx([40, 50])
    assert bars["end"].iloc[2] == pytest.approx(bars.loc["ES", "end"])


QUERIES = pd.DataFrame(
    [
        (model, seed, hidden, novel, queries, value)
        for model, first in (("xavier", 0.1), ("es", 0.5), ("joint", 0.9))
        for seed in (0, 1)
        for hidden, novel, queries, value in (
            ("tail", "given", 2, first + seed / 20),
            ("head", "answer", 1, 1 - first),
            ("tail", "both", 9, 0.99),
            ("relation", "given", 3, 0.98),
        )
    ],
    columns=["model", "seed", "hidden", "novel", "queries", "mrr_star"],
).assign(scope="novel", filter="learned", relation="on", size=5, observations=1)


def test_each_direction_has_the_queries_of_entities_with_it() -> None:
    rows = runs([(model, "all", 0, 0, 0.5) for model in ("xavier", "es", "joint")])
    other = QUERIES.assign(filter="true", mrr_star=0.0)
    experiment = home(rows, queries=pd.concat([QUERIES, other]))
    table = frame(results.directions(of(experiment)), "directions").set_index("model")
    assert table["novel entity given"].to_dict() == pytest.approx(
        {"Xavier": 12.5, "ES": 52.5, "Joint": 92.5}
    )
    assert table["novel entity is the answer"].tolist() == pytest.approx([90, 50, 10])
    assert results.best_method(experiment) == "es"


# Fine-tuning

EARLIER = runs(
    [
        (model, scope, seed, epoch, value + seed / 10)
        for model, scope, values in (
            ("xavier", "known", (0.3, 0.6)),
            ("xavier", "known_closed", (0.7, 0.7)),
            ("es", "known", (0.5, 0.75)),
            ("es", "known_closed", (0.7, 0.8)),
            ("joint", "known", (0.85,)),
            ("joint", "known_closed", (0.85,)),
            ("finetune_only", "known_closed", (0.7, 0.75)),
        )
        for seed in (0, 1)
        for epoch, value in enumerate(values)
    ]
)


def test_earlier_knowledge_is_compared_with_before_and_with_nothing_inserted() -> None:
    changed = results.since_before(EARLIER).groupby(["model", "scope", "epoch"])["mrr_star"].mean()
    # of seeds that had 0.7 and 0.8
    assert changed["es", "known"].tolist() == pytest.approx([-0.2, 0.05])
    assert changed["finetune_only", "known_closed"].tolist() == pytest.approx([0, 0.05])
    assert changed["joint", "known"].tolist() == pytest.approx([0.15])
    experiment = home(EARLIER, curves=EARLIER)
    table = frame(results.forgetting(of(experiment)), "forgetting").set_index(["model", "scope"])
    values = table[["lowest MRR*", "immediately: MRR*", "at the end: MRR*"]]
    assert values.loc["ES", "known"].tolist() == pytest.approx([55, 55, 80])
    lines = frame(results.curves(of(experiment)), "curves").set_index(["model", "scope", "epoch"])
    assert lines.loc[("ES", "known", 1), ["MRR*", "change"]].tolist() == pytest.approx([80, 5])


# Table 3


def answers(orders: Mapping[tuple[str, int], Sequence[int]], afforded: Mapping[str, Any]) -> Any:
    """Ranked answers about the fan; ``orders``: those of an initializer and a seed."""
    ranks = pd.DataFrame(
        [
            (model, seed, 4, answer, rank)
            for (model, seed), order in orders.items()
            for rank, answer in enumerate(order, 1)
        ],
        columns=["initializer", "seed", "entity", "answer", "rank"],
    )
    triples = pd.DataFrame({"relation": ["hasAffordance", "in"], "tail": ["open", "kitchen"]})
    experiment = SimpleNamespace(
        analysis=lambda _: ranks,
        entities=ENTITIES,
        triples=triples,
        settings=SimpleNamespace(graph=SimpleNamespace(source="home")),
        models=MODELS,
        initializers=["es", "rs"],
        methods=["es"],
    )
    params = SimpleNamespace(relation="hasAffordance", entities=["fan"])
    theirs = {"affordances": {"answers": {"ES": {"stove": ["× shelf", "open"]}}}}
    return of(
        experiment,
        params=SimpleNamespace(affordances=params),
        vocabulary={"afforded": afforded},
        paper=theirs,
    )


ORDERS = {("es", 0): [1, 0, 2, 3, 4], ("es", 3): [2, 1, 4, 0, 3], ("rs", 0): [3, 4, 2, 1, 0]}


@pytest.mark.parametrize(
    ("afforded", "marked"),
    [
        ({"fan": ["open"]}, "? push"),
        ({}, "push"),  # nobody judged the fan
    ],
)
def test_answers_go_by_mean_rank_and_those_of_another_kind_are_marked(
    afforded: Mapping[str, Any], marked: str
) -> None:
    made = answers(ORDERS, afforded)
    found = results.answers_of(made)
    # means: open 1.5, push 2, shelf 3, kitchen 4.5; the fan is of the other source and no answer
    kinds = {"open": "affordance", "push": "affordance", "shelf": "object", "kitchen": "room"}
    assert found.top("es", "fan") == list(kinds.items())
    assert found.top("rs", "fan")[0] == ("kitchen", "room")
    assert found.top("es", "stove") == []
    table = frame(results.table3_affordances(made))
    assert table["ES"].tolist() == ["open", marked, "× shelf", "× kitchen"]
    assert table["paper: ES"].tolist() == ["× shelf", "open", "–", "–"]


# The paper's numbers


@pytest.mark.parametrize(
    ("theirs", "ours", "found"),
    [
        (10, 11, "agrees"),
        (10, 9, "agrees"),
        (10, 11.1, "larger"),
        (10, 8.9, "smaller"),
        (0, 0, "agrees"),
        (0, 1, "larger"),
        (-10, -10.5, "agrees"),
        (-10, -20, "smaller"),
        (NAN, 1, ""),
        (1, NAN, ""),
    ],
)
def test_a_number_agrees_within_a_tenth_of_the_papers(
    theirs: float, ours: float, found: str
) -> None:
    assert paper.comparison(theirs, ours) == found


# Graphs and choices


def test_table_1_has_the_rooms_and_relations_of_its_source() -> None:
    rows = [
        ("s1", "cellar", "wine", "liesIn"),
        ("s1", "cellar", "rack", "atLocation"),
        ("s2", "kitchen", "cup", "atLocation"),
        ("s2", "kitchen", "jug", "atLocation"),
        ("s3", "kitchen", "cup", "atLocation"),
        (None, None, "sun", "atLocation"),
    ]
    seen = pd.DataFrame(rows, columns=["scene", "room", "head", "relation"])
    theirs = {"kitchen": {"location": 59.5, "entities": 40}}
    table = method.table1(seen, theirs, {"relations": {"atLocation": "location"}}).set_index("room")
    assert list(table.index) == ["kitchen", "cellar", "all"]
    names = ["location", "location (paper)", "liesIn", "object types", "entities (paper)", "rooms"]
    assert table.loc["kitchen", names].tolist() == [1.5, 59.5, 0, 1.5, 40, 2]
    assert table.loc["cellar", ["location", "liesIn", "rooms"]].tolist() == [1, 1, 1]
    assert "liesIn (paper)" not in table


CHOICE = {"dimension": 100, "rate": 0.1}
SETTINGS = [CHOICE, CHOICE | {"rate": 0.2}, CHOICE | {"dimension": 40}]


def folds(*values: Sequence[float]) -> pd.DataFrame:
    """MRR* of each setting by fold."""
    rows = [
        setting | dict.fromkeys(HALVES, value) | {"epoch": 20}
        for setting, of_setting in zip(SETTINGS, values, strict=True)
        for value in of_setting
    ]
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    ("second", "lead", "beyond"), [((0.6, 0.7), 10, "no"), ((0.9, 0.91), 35.5, "yes")]
)
def test_cross_validation_marks_the_choices_and_gives_the_spread_over_folds(
    second: Sequence[float], lead: float, beyond: str
) -> None:
    rows = folds((0.4, 0.7), second, (0.5, 0.5))
    dumped = [SimpleNamespace(model_dump=lambda setting=setting: setting) for setting in SETTINGS]
    made = of(
        SimpleNamespace(analysis=lambda _: rows),
        params=SimpleNamespace(settings=dumped),
        paper={"training": SETTINGS[1]},
    )
    ours, other, _ = frame(method.cross_validation(made)).to_dict("records")
    assert (ours["choice of"], other["choice of"]) == ("this run", "paper")
    assert [ours["MRR*"], ours["std"]] == pytest.approx([55, 100 * 0.3 / 2**0.5])
    assert other["from the choice"] == pytest.approx(lead)
    # the folds of the choice deviate by 21 points
    column = "beyond the folds' deviation"
    assert (ours[column], other[column]) == ("", beyond)


def test_the_rule_picks_from_what_is_about_novel_entities() -> None:
    index = pd.MultiIndex.from_product([["es", "rs"], [1, 2, 3, 4, 5]], names=["model", "k"])
    values = {"novel: MRR*": [60, 62, 62, 55, 70], "novel_heldout: epochs": [30, 20, 10, 5, 0]}
    means = pd.DataFrame({name: 2 * value for name, value in values.items()}, index)
    # epochs decrease throughout; MRR* at size 4 is 7 points below the best smaller size
    assert method.picked_sizes(means) == {"es": 3, "rs": 3}


# Figures


@pytest.mark.parametrize(
    ("heights", "placed"),
    [
        ([0.1, 0.5, 0.9], [0.1, 0.5, 0.9]),
        ([0.1, 0.12, 0.5], [0.06, 0.16, 0.5]),
        ([0.3, 0.3, 0.3], [0.2, 0.3, 0.4]),
        ([0.0, 0.0, 0.0], [0.0, 0.1, 0.2]),  # no lower than the bottom
        ([0.2, 0.95, 0.97], [0.2, 0.9, 1.0]),  # no higher than the top
    ],
)
def test_names_lie_near_what_they_name(heights: list[float], placed: list[float]) -> None:
    assert charts.spread(np.array(heights), 0.1) == pytest.approx(placed)


def luminance(colour: str) -> float:
    """Relative luminance (WCAG)."""
    parts = np.array(to_rgb(colour))
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("page", ["#ffffff", "#15181c"])
def test_every_colour_can_be_told_from_the_page(page: str) -> None:
    own = [f"own {number}" for number in range(6)]
    for name in [*charts.PALETTE["models"], *own]:
        colour = charts.style_of(name, own)["color"]
        dark, light = sorted([luminance(colour), luminance(page)])
        # the style of the page sets the colour of ink
        assert colour == charts.INK or (light + 0.05) / (dark + 0.05) >= 3, name


def test_a_name_has_one_colour_and_others_get_spare_ones() -> None:
    first, second = ["own", "ES", "another"], ["ES", "Xavier"]
    assert charts.style_of("ES", first) == charts.style_of("ES", second) == charts.style_of("ES")
    known = {colour for colour, *_ in charts.PALETTE["models"].values()}
    spare = [charts.style_of(name, first)["color"] for name in ("own", "another")]
    assert len({*spare} - known) == 2
