"""Tables of the main report, and colours of its figures: a few runs by hand."""

import subprocess
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from matplotlib.colors import to_rgb

from isi.errors import InputError
from stages.report import charts
from stages.report.tables import affordances, claims, headlines, method, paper, registry, results
from stages.report.tables.data import Experiment, ModelLabels
from stages.report.tables.estimates import MEASURES
from stages.report.tables.statistics import ISI, Statistics, best_indicators

NAN = float("nan")
ROOT = Path(__file__).parent.parent


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
MODELS = ModelLabels(LABELS, dict.fromkeys(("es", "rs"), "isi") | {"xavier": "paper"})
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
#: A model, a scope, a seed, an epoch and MRR.
Row = tuple[str, str, int, int, float]


def runs(rows: Sequence[Row], size: int = 5) -> pd.DataFrame:
    frame = pd.DataFrame(rows, columns=["model", "scope", "seed", "epoch", "mrr"])
    others = dict.fromkeys(list(MEASURES)[1:], frame["mrr"])
    return frame.assign(size=size, queries=4, **others)


def home(rows: pd.DataFrame, **cached: Any) -> Experiment:
    """The runs as an experiment; ``cached``: in place of what it would read."""
    names = [name for name in LABELS if name in set(rows["model"])]
    names = [name for name in names if name not in {"joint", "finetune_only"}]
    sides: dict[str, Any] = {
        "margin": 0.08,
        "max_epochs": 9,
        "queries": cached.pop("queries", None),
    }
    finetuned = cached.pop("finetuned", names)
    made = Experiment("home", "the home", MODELS, names, rows, finetuned=finetuned, **sides)
    made.__dict__.update(cached)
    return made


def of(*experiments: Any, **more: Any) -> Any:
    """Results with these experiments, the first on the paper's graph."""
    first = experiments[0]
    made = {"standalone": experiments, "extended": experiments, "models": MODELS} | more

    def on(papers: bool, extended: bool = False) -> Any:
        return first if papers and not extended else None

    return SimpleNamespace(experiments=experiments, on=on, **made)


def frame(made: Any) -> pd.DataFrame:
    """A frame that a table's function made."""
    assert isinstance(made, pd.DataFrame)
    return made


# Right after insertion


def test_rows_follow_the_order_of_models_and_scopes() -> None:
    rows = [(model, scope, 0, 0, 0.5) for model in ("joint", "es", "xavier") for scope in "ab"]
    experiment = home(runs(rows))
    means = runs(rows).groupby(["scope", "model"])[["mrr"]].mean()
    table = MODELS.in_rows(means, experiment.rows, scope=["b", "a"])
    assert table[["scope", "model"]].to_numpy().tolist() == [
        [scope, label] for scope in "ba" for label in ("Xavier", "ES", "Joint")
    ]
    shown = MODELS.by_label(
        ["es", "rs"], {"n": {"rs": 2}, "g": means.loc["a"], "": means.loc["b"]}, "who"
    )
    assert list(shown) == ["who", "n", "g: mrr", "mrr"]
    assert shown["who"].tolist() == ["ES", "RS"]
    assert shown["n"].isna().tolist() == [True, False]


@pytest.mark.parametrize(("es", "number"), [(0.7, 2), (0.8, 3)])
def test_one_row_says_what_all_initializers_share(es: float, number: int) -> None:
    values = {"xavier": 0.7, "es": es, "joint": 0.9}
    rows = runs([(name, "known_closed", 0, 0, value) for name, value in values.items()])
    table = frame(results.scopes(of(home(rows))))
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
    assert bars.loc["centre", ["start", "end", "adds"]].tolist() == pytest.approx([40, 50, 10])
    assert np.isnan(bars.loc["ES", "adds"])
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
    columns=["model", "seed", "hidden", "novel", "queries", "mrr"],
).assign(scope="novel", relation="on", size=5, observations=1)


def test_each_direction_has_the_queries_of_entities_with_it() -> None:
    now = {"xavier": 0.5, "es": 0.6, "joint": 0.9}
    rows = runs([(model, "novel", 0, 0, value) for model, value in now.items()])
    other = QUERIES.assign(scope="held_out", mrr=0.0)
    experiment = home(rows, queries=pd.concat([QUERIES, other]))
    table = frame(results.directions(of(experiment))).set_index("model")
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
    changed = results.since_before(EARLIER).groupby(["model", "scope", "epoch"])["mrr"].mean()
    # of seeds that had 0.7 and 0.8
    assert changed["es", "known"].tolist() == pytest.approx([-0.2, 0.05])
    assert changed["finetune_only", "known_closed"].tolist() == pytest.approx([0, 0.05])
    assert changed["joint", "known"].tolist() == pytest.approx([0.15])
    experiment = home(EARLIER, curves=EARLIER)
    lines = frame(results.curves(of(experiment))).set_index(["model", "scope", "epoch"])
    assert lines.loc[("ES", "known", 1), ["MRR", "change"]].tolist() == pytest.approx([80, 5])


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
        name="home",
        title="the home",
        affordances=ranks,
        entities=ENTITIES,
        triples=triples,
        settings=SimpleNamespace(graph=SimpleNamespace(source="home")),
        models=MODELS,
        initializers=["es", "rs"],
        methods=["es"],
    )
    params = SimpleNamespace(relation="hasAffordance", entities={"home": ["fan"]})
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
    found = affordances.answers_of(made, made.experiments[0])
    assert found
    # means: open 1.5, push 2, shelf 3, kitchen 4.5; the fan is of the other source and no answer
    kinds = {"open": "affordance", "push": "affordance", "shelf": "object", "kitchen": "room"}
    assert found.top("es", "fan") == list(kinds.items())
    assert found.top("rs", "fan")[0] == ("kitchen", "room")
    assert found.top("es", "stove") == []
    table = frame(affordances.table3_affordances(made))
    assert table["ES"].tolist() == ["open", marked, "× shelf", "× kitchen"]
    assert table["paper: ES"].tolist() == ["× shelf", "open", "–", "–"]
    (row,) = frame(affordances.table3_by_entity(made)).to_dict("records")
    assert row["ES"] == f"open, {marked}, × shelf, × kitchen"


# The paper's numbers


def statistics(values: Mapping[str, Mapping[str, Sequence[float]]], **epochs: Any) -> Statistics:
    """Values by model and scope for each seed of size 5; ``epochs``: by model for each seed."""
    immediate = pd.DataFrame(
        [
            (model, scope, 5, seed, value)
            for model, of_model in values.items()
            for scope, of_scope in of_model.items()
            for seed, value in enumerate(of_scope)
        ],
        columns=["model", "scope", "size", "seed", "value"],
    )
    rows = [
        (model, 5, seed, value, value < 150)
        for model, of in epochs.items()
        for seed, value in enumerate(of)
    ]
    columns = ["model", "size", "seed", "epochs", "converged"]
    return Statistics(immediate, pd.DataFrame(rows, columns=columns))


#: 97.5 % quantile of Student's t for two seeds.
T2 = 12.7062047


def test_gains_are_of_the_means_over_sizes_and_of_each_size() -> None:
    rows = [
        ("xavier", 1, 0, 50.0), ("xavier", 1, 1, 50.0), ("xavier", 2, 0, 25.0),
        ("xavier", 2, 1, 25.0), ("es", 1, 0, 50.0), ("es", 1, 1, 50.0), ("es", 2, 0, 50.0),
        ("es", 2, 1, 100.0),
    ]  # fmt: skip
    immediate = pd.DataFrame(rows, columns=["model", "size", "seed", "value"])
    found = Statistics(immediate.assign(scope="weighted"), pd.DataFrame())
    # means over seeds: 50 and 25 against 50 and 75
    gain, low, high = found.gain("es")
    assert gain == pytest.approx(100 * (125 / 75 - 1))
    # without the one seed 150 / 75, without the other 100 / 75
    around = T2 * (2 - 4 / 3) / 2 * 100
    assert [low, high] == pytest.approx([gain - around, gain + around])
    assert found.gain_by_size("es")[0] == pytest.approx(100 * (0 + 2) / 2)
    assert np.isnan(found.gain("rs")[0])


def test_a_set_without_a_value_is_left_out_of_its_mean() -> None:
    found = statistics({"es": {"weighted": [40.0, NAN, 60.0]}})
    assert found.weighted("es")[0] == pytest.approx(50)


def test_the_drop_is_below_the_mean_of_the_other_four() -> None:
    values = {"xavier": 40.0, "iu": 60.0, "es": 80.0, "rs": 100.0, "ers": 80.0}
    found = statistics({name: {"known": [value] * 2} for name, value in values.items()})
    assert found.drop("xavier") == pytest.approx((50, 50, 50))
    both = statistics({"es": {"known": [80.0, 80.0], "novel": [40.0, 40.0]}})
    assert both.by_papers_share("es")[0] == pytest.approx(70)


def test_epochs_have_means_deviations_and_are_fewer_than_xaviers() -> None:
    found = statistics({}, xavier=[100, 140], es=[30, 42], rs=[60, 60], ers=[0, 24])
    # no epochs are below 0
    assert found.mean_epochs("xavier") == pytest.approx((120, 0, 120 + T2 * 20), rel=1e-5)
    assert found.mean_epochs("es")[1:] == pytest.approx((0, 36 + T2 * 6), rel=1e-5)
    assert found.deviation("xavier")[0] == pytest.approx(np.std([100, 140], ddof=1))
    assert found.fewer_epochs("es")[0] == pytest.approx(70)
    limited = statistics({}, xavier=[50, 70, 150], es=[30, 30, 150])
    assert limited.mean_epochs("xavier")[0] == pytest.approx(90)
    assert limited.ended.mean_epochs("xavier")[0] == pytest.approx(60)
    assert limited.ended.fewer_epochs("es")[0] == pytest.approx(50)
    assert found.fewer_epochs(ISI)[0] == pytest.approx((70 + 50 + 90) / 3)


def test_the_best_number_of_indicators_has_an_interval_of_numbers_that_were_run() -> None:
    rows = [(k, seed, value) for seed in range(30) for k, value in ((1, 50), (4, 60), (9, 55))]
    sweep = pd.DataFrame(rows, columns=["k", "seed", "value"])
    assert best_indicators(sweep) == (4, 4, 4)
    noise = np.where(sweep["k"] == 9, 10.5 * (sweep["seed"] % 2), 0)
    best, low, high = best_indicators(sweep.assign(value=sweep["value"] + noise))
    assert (best, low, high) == (9, 4, 9)


@pytest.mark.parametrize(
    ("theirs", "ours", "found"),
    [
        (41.4, (42.5, 40.6, 44.9), "yes"),
        (37.6, (40.3, 38.3, 42.3), "no"),
        (38.2, (40.3, 38.24, 42.3), "yes"),  # 38.24 would be printed as 38.2
        (0, (0, 0, 0), "yes"),
        (1, (0, NAN, NAN), ""),
        (NAN, (0, 0, 1), ""),
    ],
)
def test_a_result_is_inside_to_the_digit_that_is_printed(
    theirs: float, ours: tuple[float, float, float], found: str
) -> None:
    assert paper.inside(theirs, ours) == found


PRINTED = {
    "immediate": {"improvement_over_xavier": {"es": 41.4}},
    "convergence": {
        "epochs": {"xavier": {"mean": 100.0, "deviation": 40.0}},
        "fewer_epochs_than_xavier": {"es": 85.3, "mean": 78.2},
    },
    "indicators_degrade_after": 4,
    "transfer": {
        "all_queries": {"xavier": 50.6},
        "novel_queries": {"es": 85.7},
        "drop": {"xavier": 37.0},
        "epochs": {"xavier": 90.0, "es": 0},
    },
}


def test_each_result_of_the_paper_has_a_row_and_what_is_outside_is_listed() -> None:
    values = {"xavier": 0.4, "iu": 0.5, "es": 0.6, "rs": 0.5, "ers": 0.5, "joint": 0.9}
    rows = runs(
        [
            (name, scope, seed, epoch, value + seed / 100 + (epoch > 2) * 0.5)
            for name, value in values.items()
            for scope in ("known", "novel", "weighted")
            for seed in (0, 1)
            for epoch in (range(5) if name != "joint" else [0])
        ]
    )
    labels = ModelLabels({**LABELS, "iu": "IU", "ers": "ERS"}, MODELS.roles)
    experiment = home(rows, finetuned=["xavier", "es"])
    params = SimpleNamespace(sweep=SimpleNamespace(initializers={}))
    made = of(experiment, params=params, paper=PRINTED, models=labels)
    experiment.__dict__.update(sweep=None)
    table = frame(paper.paper_results(made)).set_index(["kind", "whose"])
    assert len(table) == 1 + 1 + 1 + 2 + 3 + 1 + 1 + 1 + 2
    none = table.loc["transfer: epochs to convergence", "ES"]
    assert np.isnan(none["paper"])
    assert none["inside"] == ""
    gain = table.loc["gain over Xavier (%)", "ES"]
    assert gain[["paper", "ours"]].tolist() == pytest.approx([41.4, 100 * (0.605 / 0.405 - 1)])
    assert table.loc[("epochs to convergence", "Xavier"), ["ours", "inside"]].tolist() == [3, "no"]
    assert table["today's graph"].isna().all()
    counts = frame(paper.inside_by_kind(made)).set_index("results")
    listed = frame(paper.unexplained(made))
    # no number of ES's epochs after transfer is printed, and one number of indicators is of all
    assert counts.loc["all", "number"] == len(table) - 1 - 2
    outside = (table["inside"] == "no") & (table["inside in it"] != "yes")
    assert len(listed) == outside.sum()
    forms = table["other form"].groupby("kind").first()
    assert forms[
        ["transfer: weighted", "epochs to convergence", "gain over Xavier (%)"]
    ].tolist() == [
        "by the paper's weights",
        "runs that end",
        "mean of the sizes' gains",
    ]
    apart = listed.set_index(["kind", "whose"]).loc[("epochs to convergence", "Xavier")]
    assert apart[["ours minus the paper's", "half-widths away"]].tolist() == [-97, 97 / 0.05]


# What the paper claims


def printed_results(**ours: tuple[float, float, float]) -> pd.DataFrame:
    """Gains as rows of ``paper_results``: ours with their bounds, by label; the paper's is 40."""
    rows = [("gain over Xavier (%)", name, 40.0, *values) for name, values in ours.items()]
    columns = ["kind", "whose", "paper", "ours", "ours low", "ours high"]
    made = pd.DataFrame(rows, columns=columns)
    within = (made["ours low"] <= made["paper"]) & (made["paper"] <= made["ours high"])
    inside = within.map({True: "yes", False: "no"})
    return made.assign(**{"inside": inside, "inside in it": "", "today's graph": 3.25})


def paired(**bounds: tuple[float, float]) -> pd.DataFrame:
    """Paired differences of each name from Xavier, and of Xavier from IU, as ``differences``."""
    rows = [("MRR, weighted", name, "Xavier", *ends) for name, ends in bounds.items()]
    rows += [("MRR, weighted", "IU", name, -2.0, -1.0) for name in bounds]
    return pd.DataFrame(
        rows, columns=["measure", "first", "second", "difference low", "difference high"]
    )


@pytest.mark.parametrize(
    ("es", "minus", "order", "numbers", "verdict"),
    [
        ((41.0, 39.0, 43.0), (1.0, 2.0), "6 of 6", "3 of 3", "repeated"),
        ((20.0, 10.0, 30.0), (1.0, 2.0), "6 of 6", "2 of 3", "partly"),
        ((41.0, 39.0, 43.0), (-1.0, 2.0), "5 of 6", "3 of 3", "partly"),
    ],
)
def test_a_claim_has_a_verdict_by_its_orders_and_numbers(
    es: tuple[float, float, float],
    minus: tuple[float, float],
    order: str,
    numbers: str,
    verdict: str,
) -> None:
    both = dict.fromkeys(("RS", "ERS"), (40.0, 39.0, 41.0))
    pairs = paired(ES=minus, RS=(1.0, 2.0), ERS=(1.0, 2.0))
    seeds = {"experiments.paper.sessions.seeds": "30", "experiments.ai2thor.sessions.seeds": "5"}
    (row,) = frame(claims.judged(printed_results(ES=es, **both), pairs, seeds)).to_dict("records")
    assert [row["order"], row["numbers"], row["verdict"]] == [order, numbers, verdict]
    assert [row["method"], row["paper"], row["seeds"]] == ["ES, RS, ERS", "40, 40, 40", "30"]
    assert row["the paper's graph"] == f"{es[0]:.0f}, 40, 40"
    assert row["today's graph"] == "3.2, 3.2, 3.2"


def test_an_open_claim_has_no_row() -> None:
    assert claims.judged(printed_results(ES=(40.0, 39.0, 41.0))) is None


@pytest.mark.parametrize(
    ("order", "numbers", "found"),
    [
        ([True, None], [True], "partly"),
        ([None, None], [True, False], "undecided"),
        ([None, False], [False], "not repeated"),
        ([False], [], "not repeated"),
        ([], [True], "repeated"),
        ([True], [False], "partly"),
    ],
)
def test_a_verdict_is_open_if_no_pair_has_either_order(
    order: list[bool | None], numbers: list[bool], found: str
) -> None:
    assert claims.verdict(order, numbers) == found


def test_a_pair_has_its_order_by_the_paired_interval_or_else_by_both() -> None:
    names = ["ES", "RS", "IU"]
    of_kind = pd.DataFrame({"ours low": [3, 1, 0.0], "ours high": [4, 3.5, 0.5]}, names)
    assert claims.standing(("ES", "IU"), of_kind, {}) is True
    assert claims.standing(("IU", "ES"), of_kind, {}) is False
    assert claims.standing(("ES", "RS"), of_kind, {}) is None
    assert claims.standing((5.0, "ES"), of_kind, {}) is True
    assert claims.standing(("ES", "none"), of_kind, {}) is None
    bounds = claims.bounds_of(paired(RS=(1.0, 2.0)), "MRR, weighted")
    assert claims.standing(("RS", "Xavier"), of_kind, bounds) is True
    assert claims.standing(("Xavier", "RS"), of_kind, bounds) is False
    assert claims.bounds_of(None, "MRR, weighted") == {}


def test_one_number_of_all_methods_counts_once() -> None:
    names = ["Xavier", "ES", "RS", "ERS"]
    values = {"inside": ["no", "yes", "no", "yes"], "inside in it": ["yes", "", "", ""]}
    of_kind = pd.DataFrame(values, names)
    assert claims.within(of_kind) == [True, True, False, True]
    assert claims.within(of_kind, once=True) == [True, False]


def test_a_count_is_inside_if_it_is_equal_and_answers_have_the_papers_counts() -> None:
    keys = [(claims.PICKED, "ES"), (claims.PICKED, "RS"), (claims.RIGHT, "ES")]
    ours = {name: [8.0, 2.0, 12.0] for name in ("ours", "ours low", "ours high")}
    rows = pd.DataFrame(keys, columns=["kind", "whose"]).assign(**ours, paper=NAN, inside="")
    theirs = {
        "immediate": {"improvement_over_xavier": {"es": 41.4}},
        "indicators": {"es": 8, "rs": 18},
        "affordances": {"isi": 12, "xavier": 5},
    }
    found = claims.printed(rows, theirs)
    assert found["paper"].tolist() == [8, 18, 12]
    assert found["inside"].tolist() == ["yes", "no", ""]


def with_bounds(name: str, values: Mapping[str, float]) -> pd.DataFrame:
    """An estimate of each initializer, 1 to both sides of it."""
    columns = {name: 0, f"{name} low": -1, f"{name} high": 1}
    rows = [
        {"initializer": label} | {column: value + shift for column, shift in columns.items()}
        for label, value in values.items()
    ]
    return pd.DataFrame(rows)


def test_bounds_of_what_is_computed_for_a_claim_are_those_of_its_parts() -> None:
    gained = with_bounds("gain, %", {"ES": 40, "RS": 20, "ERS": 60, "Mean": 20})
    mean = claims.mean_gain(gained).loc["as printed", ["ours", "ours low", "ours high"]]
    assert mean.tolist() == [40, 39, 41]
    assert claims.mean_gain(gained.head(1))["ours"].isna().all()
    parts = [
        with_bounds("epochs", {"ES": epochs, "RS": 4}).assign(indicators=number)
        for number, epochs in ((1, 99), (claims.FEW, 30), (9, 1), (claims.MOST, 10))
    ]
    swept = pd.concat(parts)
    fewer = claims.fewer_with_more(swept)
    assert fewer.loc["ES", ["ours", "ours low", "ours high"]].tolist() == [20, 18, 22]
    assert fewer.loc["RS", "ours"] == 0
    sizes = pd.DataFrame({"initializer": ["ES", "RS"], "picked by the rule": [8, 2]})
    assert claims.picked(sizes)["ours"].tolist()[:2] == [8, 2]
    moved = with_bounds("known: drop, %", {"ES": 2, "Xavier": 30})
    moved = moved.rename(columns={"initializer": "model"})
    assert claims.drops(moved).loc["ES", ["ours", "ours low", "ours high"]].tolist() == [2, 1, 3]
    answers = pd.DataFrame({"ES": ["open", "? push"], "Xavier": ["× shelf", "open"]})
    right = claims.right_answers(answers)["ours"]
    assert right[["ES", "Xavier"]].tolist() == [2, 1]
    assert right[["RS", "ERS"]].isna().all()
    assert claims.right_answers(answers.head(0))["ours"].isna().all()
    assert claims.fewer_with_more(swept.head(0))["ours"].isna().all()


def test_the_measure_decides_by_one_change_at_a_time() -> None:
    values = {"xavier": 0.4, "es": 0.6, "rs": 0.5, "ers": 0.8, "joint": 0.9}
    known = runs(
        [
            (name, scope, seed, epoch, value + epoch / 10)
            for name, value in values.items()
            for scope in ("known", "novel", "weighted")
            for seed in (0, 1)
            for epoch in (range(6) if name != "joint" else [0])
        ]
    )
    rows = known.rename(columns={"mrr": "value"})[
        ["model", "size", "seed", "epoch", "scope", "value"]
    ]
    one = rows[rows["scope"] == "weighted"]
    changes = pd.concat(
        [
            rows.assign(change="none"),
            rows.assign(change="counts", value=rows["value"] / 2),
            one.assign(change="one_group"),
        ]
    )
    experiment = home(known, changes=changes, finetuned=["xavier", "es", "rs", "ers"])
    # 0.9 less the margin of 0.08
    assert paper.changed(experiment, "none").mean_epochs("xavier")[0] == 5
    assert paper.changed(experiment, "one_group").mean_epochs("es")[0] == 3
    assert paper.changed(experiment, "none").gain("ers")[0] == pytest.approx(100)
    assert paper.changed(experiment, "counts").gain("ers")[0] == pytest.approx(100)
    # half of everything, and the whole margin: 0.45 less 0.08
    assert paper.changed(experiment, "counts").mean_epochs("xavier")[0] == 4


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
    """The measure of each setting by fold."""
    rows = [
        setting | dict.fromkeys(MEASURES, value) | {"epoch": 20}
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
        SimpleNamespace(folds=rows),
        params=SimpleNamespace(settings=dumped),
        paper={"training": SETTINGS[1]},
    )
    ours, other, _ = frame(method.cross_validation(made)).to_dict("records")
    assert (ours["choice of"], other["choice of"]) == ("this run", "paper")
    assert [ours["MRR"], ours["std"]] == pytest.approx([55, 100 * 0.3 / 2**0.5])
    assert other["from the choice"] == pytest.approx(lead)
    # the folds of the choice deviate by 21 points
    column = "beyond the folds' deviation"
    assert (ours[column], other[column]) == ("", beyond)


def test_the_rule_grows_the_set_while_epochs_fall_and_little_is_lost() -> None:
    # epochs decrease throughout; MRR at size 4 is 7 points below the best smaller size
    values, epochs = [0.6, 0.62, 0.62, 0.55, 0.7], [60, 40, 20, 10, 0]
    assert method.select_size([1, 2, 3, 4, 5], values, epochs) == 3


def git(*arguments: str) -> None:
    command = ("git", *arguments)
    subprocess.run(command, check=True)


def test_a_run_has_the_commit_that_changed_its_code_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert method.commit_of_code() == {}

    def commit(file: str) -> dict[str, str]:
        (tmp_path / file).write_text(file, encoding="utf-8")
        git("add", file)
        git("-c", "user.name=a", "-c", "user.email=a", "commit", "--quiet", "-m", file)
        return method.commit_of_code()

    git("init", "--quiet")
    first = commit("params.yaml")
    assert set(first) == {"commit", "date"}
    assert commit("results.csv") == first
    (tmp_path / "params.yaml").write_text("changed", encoding="utf-8")
    assert method.commit_of_code() == {}
    shown = method.described({"seed": 0}).set_index("name")["value"]
    assert shown["seed"] == "0"
    assert "commit" not in shown


def test_the_plots_of_dvc_are_written_whichever_experiments_there_are() -> None:
    listed = yaml.safe_load((ROOT / "dvc.yaml").read_text("utf-8"))["plots"]
    named = [Path(file).stem for each in listed for plot in each.values() for file in plot["y"]]
    assert set(named) == set(headlines.PLOTS)
    params = SimpleNamespace(initializers={"es": {}})
    made = headlines.plots(SimpleNamespace(params=params, experiments=[], standalone=[]))
    assert list(made["immediate_novel_paper"]) == ["size", "es"]


# Figures


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


def test_a_second_table_of_a_name_is_refused() -> None:
    with pytest.raises(InputError, match=r"'gains': .*stages\.report\.tables\.results\.gains"):
        registry.table("report", "gains")(headlines.metrics)
