"""The report's numbers, against values by hand for a few runs."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import pytest
import scipy.stats
from matplotlib.colors import to_hex

from isi.evaluation.query_sets import epochs_to_convergence
from isi.report import charts, figures, stats
from isi.report.sections import choices, finetuning, insertions, run
from isi.report.tables import Column, Estimate, ReportTable, csv, number
from isi.report.words import colour, label
from tests.reports import INITIALIZERS, frame_of, of_experiment, runs, small_params, small_results


def converged(rows: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Epochs to convergence for joint models with MRR* 0.7."""
    cells = rows[["scope", "size", "seed"]].drop_duplicates().assign(mrr_star=0.7)
    return epochs_to_convergence(rows, cells, 0.08, 150, by)


def test_improvement_is_the_ratio_of_means_at_each_size_averaged_over_sizes() -> None:
    immediate = runs(
        [
            ("xavier", "all", 1, 0, 0, 0.2),
            ("xavier", "all", 1, 1, 0, 0.6),
            ("xavier", "all", 2, 0, 0, 0.5),
            ("es", "all", 1, 0, 0, 0.6),
            ("es", "all", 1, 1, 0, 0.6),
            ("es", "all", 2, 0, 0, 0.5),
        ]
    )
    # size 1: 0.6 / 0.4 = 1.5; size 2: 0.5 / 0.5 = 1: a quarter on average (the ratio of all means
    # is another)
    assert stats.improvements(immediate, "all")["es"].mean == pytest.approx(25)
    assert stats.improvements(immediate[immediate["model"] == "es"], "all") == {}


def test_fewer_epochs_is_against_the_mean_of_xavier() -> None:
    cells = [
        ("xavier", 0, 8),
        ("xavier", 1, 12),
        ("es", 0, 2),
        ("es", 1, 3),
        ("joint", 0, 0),
        ("joint", 1, 0),
    ]
    results = small_results(["home"], studies=False, **{"finetuning.max_epochs": 20})
    home = of_experiment(
        results,
        "home",
        runs=runs([(model, "all", 1, seed, epoch, 0.7) for model, seed, epoch in cells]),
    ).experiments["home"]
    assert home.fewer_epochs("all") == pytest.approx({"xavier": 0, "es": 75})
    assert home.of_size(2).fewer_epochs("all") == {}


def of_seeds(**seeds: Sequence[float]) -> pd.DataFrame:
    """Rows of one group, with the values of each seed."""
    rows = [(0, seed, value) for seed, values in enumerate(seeds.values()) for value in values]
    return pd.DataFrame(rows, columns=["group", "seed", "value"])


def test_a_mean_is_over_all_rows_and_its_interval_resamples_whole_seeds() -> None:
    found = stats.over_seeds(of_seeds(a=[1, 2], b=[6]), ["group"], {"value": "v"}, scale=1)
    # a resample has seed a twice with ¼ (mean 1.5), seed b twice with ¼ (mean 6), else both
    assert found["v"][0] == Estimate(3, 1.5, 6)
    alone = stats.over_seeds(of_seeds(a=[1, 2]), ["group"], {"value": "v"}, scale=100)
    assert alone["v"][0].mean == 150
    assert np.isnan(alone["v"][0].parts[1:]).all()
    nothing = stats.over_seeds(
        of_seeds(a=[1, 2], b=[np.nan], c=[3]), ["group"], {"value": "v"}, scale=1
    )
    assert nothing["v"][0] == Estimate(2, 1.5, 3)  # seed b has nothing to resample


def test_intervals_are_those_of_scipys_bootstrap() -> None:
    values = np.random.default_rng(3).gamma(2, size=30)
    found = stats.over_seeds(
        of_seeds(**{str(n): [v] for n, v in enumerate(values)}), ["group"], {"value": "v"}, 1
    )
    low, high = scipy.stats.bootstrap(
        (values,), np.mean, n_resamples=20_000, method="percentile", rng=0
    ).confidence_interval
    assert list(found["v"][0].parts[1:]) == pytest.approx([low, high], abs=0.03 * (high - low))


def test_improvement_resamples_both_sides_together() -> None:
    rows = [
        ("xavier", "all", size, seed, 0, value)
        for size in (1, 2)
        for seed, value in enumerate((0.2, 0.4))
    ]
    rows += [
        ("es", "all", size, seed, 0, 1.5 * value)
        for size in (1, 2)
        for seed, value in enumerate((0.2, 0.4))
    ]
    found = stats.improvements(runs(rows), "all")
    assert found["es"].parts == pytest.approx((50, 50, 50))  # whichever seeds are drawn
    assert found["xavier"].parts == pytest.approx((0, 0, 0))


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        ("a box that slides open", "open"),
        ("an open-topped box", "open"),
        ("an oven that heats food", "heat"),
        ("used for cutting bread", "cut"),
        ("slicing bread", "slice"),
        ("a lamp on a desk", "desk"),
        ("a lamp that is turned on by hand", "turn on"),
    ],
)
def test_definitions_name_what_they_say_in_regular_inflections(text: str, phrase: str) -> None:
    assert run.names(text, phrase)
    for other, part in (
        ("the kitchenette of a flat", "kitchen"),
        ("unbroken", "break"),
        ("at breakfast", "break"),
    ):
        assert not run.names(other, part)


def test_numbers_are_shown_as_people_read_them() -> None:
    frame = pd.DataFrame(
        {"whole": [1.0, np.nan, 1234.0], "part": [0.05, 1.25, 12.0], "text": ["a", "b", "c"]}
    )
    shown = ReportTable.of("name", frame).shown
    assert shown["whole"].tolist() == ["1", "–", "1,234"]
    assert shown["part"].tolist() == ["0.1", "1.2", "12.0"]
    assert shown["text"].tolist() == ["a", "b", "c"]
    assert ReportTable.of("name", pd.DataFrame({"x": [-0.01, 1.5]})).shown["x"].tolist() == [
        "0.0",
        "1.5",
    ]


def test_an_estimate_is_one_cell_for_people_and_three_columns_in_files() -> None:
    table = ReportTable.of(
        "name",
        [
            {
                "model": "a",
                Column("x", "all"): Estimate(1, 0.5, 2),
                Column("n", form="{:+.2f}".format): -0.01,
            },
            {
                "model": "b",
                Column("x", "all"): Estimate(2),
                Column("n", form="{:+.2f}".format): 3.0,
            },
        ],
    )
    assert table.shown.to_dict("list") == {
        "model": ["a", "b"],
        "all: x": ["1.0 [0.5, 2.0]", "2.0"],
        "n": ["-0.01", "+3.00"],
    }
    assert table.files["csv"].splitlines() == [
        "model,all: x,all: x low,all: x high,n",
        "a,1,0.5,2,-0.01",
        "b,2,,,3",
    ]
    assert "| 1.0 [0.5, 2.0] |" in table.files["md"]
    assert r"\toprule" in table.files["tex"]
    assert f"{Estimate(1.25, 0.5, 2):+.1f}" == "+1.2 [+0.5, +2.0]"


def test_a_table_without_rows_can_be_written() -> None:
    assert all(isinstance(text, str) for text in ReportTable.of("name", []).files.values())
    assert ReportTable.of("name", {"size": [], "mean": []}).files["csv"] == "size,mean\n"


def test_numbers_of_files_have_two_decimals_or_four_digits() -> None:
    frame = pd.DataFrame(
        {"a": [1.23456, None, -0.001], "p": ["none", 1.86265e-9, 0.123456], "n": [1, 2, 3]}
    )
    assert csv(frame, ["p"]) == "a,p,n\n1.23,none,1\n,1.863e-09,2\n0,0.1235,3\n"
    counts = pd.DataFrame({"p": [24941.0, 14759.0, 77.00000001, 12345.678]})
    assert csv(counts, ["p"]) == "p\n24941\n14759\n77\n12345.68\n"
    assert str(number(-0.004)) == "0.0"


def test_the_rule_picks_from_what_is_about_novel_entities() -> None:
    novel, epochs = {1: 0.60, 2: 0.62, 3: 0.62, 4: 0.55, 5: 0.70}, {1: 30, 2: 20, 3: 10, 4: 5, 5: 0}
    models = ["es", "rs", "ers"]
    swept = pd.DataFrame(
        [
            (model, k, scope, 5, 0, epoch, mrr_star, 4)
            for model in models
            for k in novel
            for scope, epoch, mrr_star in (
                ("novel", 0, novel[k]),
                ("all", 0, 0.7),
                ("novel_heldout", 0, 0.1),
                ("novel_heldout", epochs[k], 0.7),
            )
        ],
        columns=["model", "k", "scope", "size", "seed", "epoch", "mrr_star", "queries"],
    )
    found = choices.means_of(swept[swept["epoch"] == 0], converged(swept, ["model", "k"]), models)
    chosen = choices.chosen_sizes(found, {"es": {"k": 4}, "rs": {}}, {"es": 8, "ers": 9})
    table = frame_of(choices.indicator_sizes(found, chosen)).set_index("initializer")
    # epochs decrease throughout; MRR* at size 4 is 7 points below the best smaller size
    assert table["picked by the rule"].to_dict() == {"ES": 3, "RS": 3, "ERS": 3}
    assert table["paper"].dropna().to_dict() == {"ES": 8, "ERS": 9}
    assert table["this run"].dropna().to_dict() == {"ES": 4}
    assert table.loc[
        "ES",
        [
            "at the picked number: MRR*",
            "at the picked number: epochs",
            "best MRR*",
            "best at",
        ],
    ].tolist() == [
        62,
        10,
        70,
        5,
    ]


def test_cross_validation_marks_the_choices_and_gives_the_spread_over_folds() -> None:
    settings = [setting.model_dump() for setting in small_params(["home"]).settings]
    rows = [
        setting
        | {
            "fold": fold,
            "mrr_star": value,
            "mrr_star_entity": 0.5,
            "mrr_star_relation": 0.9,
            "mrr": 0.4,
            "epoch": 20,
        }
        for setting in settings
        for fold, value in enumerate((0.6, 0.7))
    ]
    rows[0]["mrr_star"] = 0.4
    theirs = {"dimension": 100, "ratio": 9, "learning_rate": 0.2, "weight_decay": 0.001}
    table = frame_of(choices.cross_validation_table(pd.DataFrame(rows), settings, theirs))
    assert len(table) == 13
    ours, other = table.iloc[0], table[table["learning rate"] == "0.2"].iloc[0]
    assert (ours["choice of"], other["choice of"]) == ("this run", "paper")
    assert ours["MRR*"] == pytest.approx(55)
    assert ours["std"] == pytest.approx(100 * 0.3 / 2**0.5)
    assert other["MRR*"] == pytest.approx(65)
    assert other["from the choice"] == pytest.approx(10)
    # the folds of the choice deviate by 21 points
    assert (ours["beyond the folds' deviation"], other["beyond the folds' deviation"]) == ("", "no")
    sure = [
        row | {"mrr_star": 0.9 + 0.01 * row["fold"]} if row["learning_rate"] == 0.2 else row
        for row in rows
    ]
    clear = frame_of(choices.cross_validation_table(pd.DataFrame(sure), settings, theirs))
    assert clear.loc[clear["learning rate"] == "0.2", "beyond the folds' deviation"].tolist() == [
        "yes"
    ]
    assert choices.best(pd.DataFrame(rows), settings[0], "learning_rate")[1] == (
        "+10.0 points from the choice of this run, less than the folds deviate"
    )


def test_the_best_value_of_a_factor_has_the_others_as_chosen() -> None:
    settings = [setting.model_dump() for setting in small_params(["home"]).settings]
    rows = [setting | {"fold": fold, "mrr_star": 0.5} for setting in settings for fold in (0, 1)]
    table, choice = pd.DataFrame(rows), settings[0]
    table = table.sort_values(["dimension", "ratio", "learning_rate", "weight_decay"])
    table.loc[table["dimension"] == 40, "mrr_star"] = [0.9, 0.4]
    table.loc[table["learning_rate"] == 0.2, "mrr_star"] = [0.6, 0.6]
    assert choices.best(table, choice, "dimension")[0] == 40
    assert choices.best(table, choice, "learning_rate")[0] == 0.2
    # equals: the choice, which is first
    assert choices.best(table, choice, "ratio") == (choice["ratio"], "")


def test_embedding_models_stand_with_the_options_that_were_chosen_for_them() -> None:
    columns = [
        "model",
        "seed",
        "mrr_star",
        "mrr_star_entity",
        "mrr_star_relation",
        "mrr",
        "valid_mrr_star",
        "epochs",
    ]
    rows = pd.DataFrame(
        [
            ("transe", 0, 0.5, 0.1, 0.9, 0.3, 0.6, 40),
            ("transe", 1, 0.7, 0.3, 1.0, 0.5, 0.8, 60),
            ("complex", 0, 0.9, 0.8, 1.0, 0.7, 0.9, 20),
        ],
        columns=columns,
    )
    chosen = {
        "transe": {"learning_rate": 0.1, "margin": 4.0, "squared": False},
        "complex": {"learning_rate": 0.05},
    }
    shown = ReportTable.of("table", choices.embedding_table(rows, chosen)).shown
    assert shown[["embedding", "MRR*", "epochs"]].to_numpy().tolist() == [
        ["TransE", "60 [50, 70]", "50"],
        ["ComplEx", "90", "20"],
    ]
    assert shown[["learning rate", "margin", "squared"]].to_numpy().tolist() == [
        ["0.1", "4", "no"],
        ["0.05", "–", "–"],
    ]


def test_initializers_are_ordered_at_every_rate() -> None:
    def cells(es: int, rs: int) -> pd.DataFrame:
        """Epochs to convergence with three factors on the rate; ``es`` and ``rs``:
        epochs with the last factor.
        """
        rows = [
            ("es", finetuning.AS_CHOSEN, 3),
            ("rs", finetuning.AS_CHOSEN, 4),
            ("es", 0.5, 6),
            ("rs", 0.5, 8),
            ("es", 2, es),
            ("rs", 2, rs),
        ]
        frame = pd.DataFrame(rows, columns=["model", "factor", "epoch"])
        return converged(
            frame.assign(mrr_star=0.7, scope="all", size=5, seed=0, queries=4), ["model", "factor"]
        )

    same, tied, models = cells(1, 2), cells(1, 1), ["es", "rs"]
    assert set(finetuning.orders(same, models, "all").values()) == {"ES, RS"}
    assert finetuning.orders(tied, models, "all") == {0.5: "ES, RS", 1: "ES, RS", 2: "ES = RS"}
    assert finetuning.orders(tied, models, "novel_heldout") == {}
    table = frame_of(finetuning.by_rate(tied, models)).set_index("initializer")
    assert table.loc["RS", ["×0.5: mean", "×1: mean", "×2: mean"]].tolist() == [8, 4, 1]


def test_interference_is_what_is_lost_with_the_novel_entities_alone() -> None:
    rows = runs(
        [
            ("es", "known", 5, seed, epoch, value - seed / 10)
            for seed in (0, 1)
            for epoch, value in enumerate((0.7, 0.5, 0.8))
        ]
        + [("es", "known_closed", 5, 0, 0, 0.9)]
    )
    frame = frame_of(
        finetuning.interference(
            rows.assign(mrr_star_entity=0.1, mrr_star_relation=1.0), ["es", "rs"]
        )
    )
    assert frame[["model", "scope"]].to_numpy().tolist() == [
        ["ES", "known"],
        ["ES", "known_closed"],
    ]
    values = frame[["lowest MRR*", "immediately: MRR*", "at the end: MRR*"]].to_numpy()
    assert values == pytest.approx(np.array([[45, 65, 75], [90, 90, 90]]))


def test_earlier_knowledge_is_compared_with_before_and_with_nothing_inserted() -> None:
    values = {"xavier": (0.3, 0.6), "es": (0.5, 0.75)}
    rows = [
        (model, "known", 5, seed, epoch, value + seed / 10)
        for model, both in values.items()
        for seed in (0, 1)
        for epoch, value in enumerate(both)
    ]
    rows += [
        (model, "known_closed", 5, seed, epoch, 0.7 + epoch * gain + seed / 10)
        for model, gain in (("xavier", 0), ("es", 0.1))
        for seed in (0, 1)
        for epoch in (0, 1)
    ]
    rows += [
        ("joint", scope, 5, seed, 0, 0.9) for scope in ("known", "known_closed") for seed in (0, 1)
    ]
    nothing = runs(
        [
            ("finetune_only", "known_closed", 5, seed, epoch, 0.7 + 0.05 * epoch + seed / 10)
            for seed in (0, 1)
            for epoch in (0, 1)
        ]
    )
    every = pd.concat([runs(rows), nothing], ignore_index=True)
    changed = finetuning.since_before(every).groupby(["model", "scope", "epoch"])["mrr_star"].mean()
    # of seeds that had 0.7 and 0.8
    assert changed["es", "known"].tolist() == pytest.approx([-0.2, 0.05])
    assert changed["es", "known_closed"].tolist() == pytest.approx([0, 0.1])
    assert changed["finetune_only", "known_closed"].tolist() == pytest.approx([0, 0.05])
    assert changed["joint", "known"].tolist() == pytest.approx([0.15])
    pairs = finetuning.at_the_end(every)
    differences = {
        (scope, pair.first, pair.second): pair.difference.mean
        for scope in pairs
        for pair in pairs[scope]
    }
    assert differences == pytest.approx(
        {
            ("known", "es", "xavier"): 15,
            ("known_closed", "es", "xavier"): 10,
            ("known_closed", "es", "finetune_only"): 5,
            ("known_closed", "xavier", "finetune_only"): -5,
        }
    )
    lines = ["xavier", "es", "finetune_only"]
    canvas = figures.by_epoch(finetuning.since_before(every), lines, finetuning.EARLIER)
    names = [line.get_label() for line in canvas.axes[1].lines]
    assert names == ["Xavier", "ES", "Nothing inserted", "Joint"]
    ended = {
        (scope, model): of_model for scope, model, of_model in finetuning.end_comparisons(pairs)
    }
    (es,) = ended["known_closed", "finetune_only"]
    assert es.difference.parts == pytest.approx((5, 5, 5))
    assert not es.significant


def test_the_plane_is_that_of_the_covariances_first_eigenvectors() -> None:
    vectors = np.random.default_rng(0).normal(size=(30, 6)) * [1, 5, 1, 1, 3, 1] + 7
    centre, axes, share = insertions.plane(vectors.astype(np.float32))
    values, eigenvectors = np.linalg.eigh(np.cov(vectors.T))
    assert np.allclose(centre, vectors.mean(0), atol=1e-5)
    assert np.allclose(np.abs(axes @ eigenvectors[:, :-3:-1]), np.eye(2), atol=1e-4)
    assert np.allclose(axes @ axes.T, np.eye(2), atol=1e-6)
    assert share == pytest.approx(values[-2:].sum() / values.sum(), abs=1e-4)
    assert (axes.max(1) == np.abs(axes).max(1)).all()


def test_curves_have_bands_but_for_controls() -> None:
    rows = [
        (model, "all", 5, seed, epoch, 0.5 + 0.1 * seed)
        for model in ("es", "mean", "joint")
        for seed in (0, 1)
        for epoch in (0, 1)
    ]
    canvas = figures.by_epoch(runs(rows), ["es", "mean"], ("all", "all"), margin=0.08)
    bands = [to_hex(band.get_facecolor()[0]) for band in canvas.axes[0].collections]
    assert bands == [colour("es", ["es", "mean"])]
    es, mean, *levels = canvas.axes[0].lines
    assert (es.get_linestyle(), mean.get_linestyle()) == ("-", "--")
    assert mean.get_linewidth() < es.get_linewidth()
    heights = [float(np.asarray(level.get_ydata())[0]) for level in levels]
    assert heights == pytest.approx([55, 47])  # of the joint model, and that of convergence


def test_sessions_of_a_seed_are_averaged_before_the_interval() -> None:
    rows = runs(
        [
            ("es", "all", 1, seed, 0, value)
            for seed in (0, 1)
            for value in (0.2 + seed / 2, 0.4 + seed / 2)
        ]
    )
    canvas = figures.by_epoch(rows, ["es"], ("all", "novel"))
    # of seeds with 30 and 80 points
    heights = canvas.axes[0].collections[0].get_paths()[0].vertices[:, 1]
    assert heights.max() == pytest.approx(80)  # where a resample has the second seed alone


def test_a_long_legend_has_two_rows_that_are_read_one_after_the_other() -> None:
    models = [*INITIALIZERS, "gaussian", "gaussian_centred", "joint"]
    rows = runs([(model, scope, 1, 0, 0, 0.5) for model in models for scope in ("all", "novel")])
    canvas = figures.by_epoch(rows, models[:-1], ("all", "novel"))
    assert [axes.get_title() for axes in canvas.axes] == ["(a) all queries", "(b) novel entities"]
    canvas.draw_without_rendering()
    places = {text.get_text(): text.get_window_extent() for text in canvas.legends[0].get_texts()}
    rows_of = sorted({round(place.y0) for place in places.values()}, reverse=True)
    assert len(rows_of) == 2
    read = sorted(places, key=lambda name: (rows_of.index(round(places[name].y0)), places[name].x0))
    assert read == [label(model) for model in models]


@pytest.mark.parametrize(
    ("heights", "placed"),
    [
        ([0.1, 0.5, 0.9], [0.1, 0.5, 0.9]),
        ([0.1, 0.12, 0.5], [0.06, 0.16, 0.5]),
        ([0.3, 0.3, 0.3], [0.2, 0.3, 0.4]),
        ([0.0, 0.0, 0.0], [0.0, 0.1, 0.2]),  # no lower than the bottom
        ([0.2, 0.95, 0.97], [0.2, 0.9, 1.0]),  # no higher than the top
        ([], []),
    ],
)
def test_names_lie_a_gap_apart_and_near_what_they_name(
    heights: list[float], placed: list[float]
) -> None:
    assert charts.spread(np.array(heights), 0.1) == pytest.approx(placed)


def test_what_is_lost_after_the_best_epoch_has_its_interval() -> None:
    rows = runs(
        [
            ("es", "novel_heldout", 5, seed, epoch, value + seed / 10)
            for seed in (0, 1)
            for epoch, value in enumerate((0.5, 0.7, 0.6))
        ]
    )
    ((model, best, epoch, end, last, change),) = finetuning.best_epochs(
        rows, ["xavier", "es", "rs"]
    )
    assert (model, best, epoch, end, last) == ("es", pytest.approx(75), 1, pytest.approx(65), 2)
    assert change.parts == pytest.approx((-10, -10, -10))
    assert finetuning.best_epochs(rows, ["xavier"]) == []


def test_convergence_has_means_medians_and_shares() -> None:
    cells = pd.DataFrame(
        {
            "scope": "all",
            "model": "es",
            "seed": [0, 0, 1, 1],
            "epochs": [1, 2, 3, 150],
            "converged": [True, True, True, False],
        }
    )
    found = stats.epochs_summary(cells, ["scope", "model"]).loc["all", "es"]
    estimates = (Estimate(39, 1.5, 76.5), 2.5, Estimate(25, 0, 50))
    assert (found["mean"], found["median"], found["unconverged %"]) == estimates
