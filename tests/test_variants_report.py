"""The report on variants and other graphs, against values by hand for a few runs and answers."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from isi.analyses.variants import VARIANT_QUERIES, VARIANT_RUNS
from isi.experiment.insert import FullCurves
from isi.report.data import Results, VariantRuns, read_variants
from isi.report.sections import paper
from isi.report.words import described
from isi.tables import paths
from tests.reports import of_experiment, runs, shown, small_params, small_results, with_settings
from tests.variants import queries_of, variant

GROUPS = {
    "stronger": "baselines",
    "embeddings": "embeddings",
    "n_insert_triples": "insert_triples",
    "other_words": "words",
    "causes": "causes",
}


def results_with(*variants: list[VariantRuns]) -> Results:
    return replace(small_results(["home", "away"], studies=False), variants=list(chain(*variants)))


@pytest.mark.parametrize("section", GROUPS)
def test_nothing_is_said_where_the_second_pipeline_has_not_run(section: str) -> None:
    assert shown(section, small_results(["home"])) == ("", {}, [])


# A variant


def test_entity_prediction_with_the_novel_entity_given_by_hand() -> None:
    columns = [
        "model",
        "seed",
        "relation",
        "hidden",
        "novel",
        "filter",
        "scope",
        "queries",
        "mrr_star",
        "observations",
    ]
    rows = [
        ("es", 0, "on", "tail", "given", "learned", "novel", 1, 0.8, 3),
        ("es", 0, "on", "head", "given", "learned", "novel", 3, 0.4, 3),
        ("es", 0, "in", "tail", "given", "learned", "novel", 5, 0.9, 1),
        *(
            ("es", 0, "in", hidden, novel, name, scope, 5, 0.1, 1)
            for hidden, novel, name, scope in (
                ("tail", "answer", "learned", "novel"),
                ("tail", "both", "learned", "novel"),
                ("relation", "given", "learned", "novel"),
                ("tail", "given", "true", "novel"),
                ("tail", "given", "learned", "novel_heldout"),
            )
        ),
    ]
    queries = pd.DataFrame(rows, columns=columns).assign(experiment="home", size=5)
    (runs,) = variant("insert_triples", {"home": {"es": [0.5]}})
    # on: (0.8 + 3 · 0.4) / 4 = 0.5, three times observed; in: 0.9, once
    rows = replace(runs, queries=queries).directed
    (given,) = rows[rows["scope"] == "given"].to_dict("records")
    assert given["mrr_star_entity"] == pytest.approx((3 * 0.5 + 0.9) / 4)
    assert (given["model"], given["size"], given["seed"]) == ("es", 5, 0)


def test_convergence_is_against_the_joint_model_of_the_variant_and_of_the_session() -> None:
    """The margin is 8 points; the variant sets the maximum number of epochs."""
    later = {
        ("es", 0): [0.5, 0.62, 0.7],
        ("es", 1): [0.5, 0.5, 0.5],
        ("joint", 0): [0.7],
        ("joint", 1): [0.7],
    }

    def heldout(runs: VariantRuns) -> pd.DataFrame:
        epochs = runs.convergence
        return epochs[epochs["scope"] == "novel_heldout"].set_index(["session", "seed"])

    (runs,) = variant("causes", {"home": {"es": [0.5]}}, later=later)
    assert heldout(runs)["epochs"].to_dict() == {(1, 0): 1, (1, 1): 3}
    assert heldout(runs)["converged"].to_dict() == {(1, 0): True, (1, 1): False}
    (longer,) = variant(
        "causes", {"home": {"es": [0.5]}}, later=later, changes={"finetuning.max_epochs": 9}
    )
    assert heldout(longer)["epochs"].tolist() == [1, 9]
    second = runs.runs.assign(
        session=2, mrr_star=runs.runs["mrr_star"].where(runs.runs["model"] != "joint", 0.5)
    )
    both = replace(runs, runs=pd.concat([runs.runs, second]))
    assert heldout(both)["epochs"].to_dict() == {(1, 0): 1, (1, 1): 3, (2, 0): 0, (2, 1): 0}


def test_variants_are_read_as_far_as_they_ran_on_experiments_that_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = variant(
        "baselines",
        {
            "home": {"ers": [0.5, 0.5], "es": [0.5, 0.5], "joint": [0.9, 0.9]},
            "away": {"es": [0.5], "joint": [0.9]},
        },
    )
    # one more than ran, in its order
    listed = ran[0].variant.model_copy(update={"initializers": ["rs", "es", "ers"]})
    paths.BEYOND_PARAMS.parent.mkdir()
    entries = dict.fromkeys(("other", "second", "first", "waiting"), listed.model_dump())
    paths.BEYOND_PARAMS.write_text(
        yaml.safe_dump({"variants": entries}, sort_keys=False), encoding="utf-8"
    )
    order = ["experiment", "model", "size", "seed", "session", "epoch", "scope"]
    for name in ("first", "second", "other"):
        parts = ran[1:] if name == "other" else ran
        rows, queries = (
            pd.concat([getattr(one, table) for one in parts]) for table in ("runs", "queries")
        )
        measures = dict.fromkeys(("mrr_star_entity", "mrr_star_relation", "mrr"), rows["mrr_star"])
        VARIANT_RUNS.write(rows.assign(**measures).sort_values(order), "vary", variant=name)
        VARIANT_QUERIES.write(queries.assign(mrr=0.5, session=1), "vary", variant=name)
    params, titles = (
        small_params(["home", "away"]),
        {"home": "the home graph", "away": "the away graph"},
    )
    assert [runs.id for runs in read_variants(titles, params)] == [
        "other_away",
        "second_home",
        "second_away",
        "first_home",
        "first_away",
    ]
    second, first = read_variants({"home": "the home graph"}, params)
    assert (second.id, first.id, first.models) == (
        "second_home",
        "first_home",
        ["es", "ers", "joint"],
    )
    assert set(first.runs["experiment"]) == set(first.queries["experiment"]) == {"home"}
    pd.testing.assert_frame_equal(first.directed, ran[0].directed, check_dtype=False)
    for section, group in GROUPS.items():
        of_group = replace(first, variant=listed.model_copy(update={"group": group}))
        assert shown(section, results_with([of_group]))[1]


# Stronger initializers


GIVEN = {
    "xavier": (0.1, 0.1),
    "es": (0.5, 0.5),
    "ers": (0.4, 0.6),
    "soft_rs": (0.6, 0.9),
    "joint": (0.95, 0.95),
}


def test_stronger_initializers_are_sorted_and_compared_with_ers_seed_by_seed() -> None:
    immediate = {"xavier": 0.2, "es": 0.3, "ers": 0.4, "soft_rs": 0.6, "joint": 0.8}
    text, found, _ = shown(
        "stronger", results_with(variant("baselines", {"home": GIVEN}, immediate))
    )
    frame = found["strong_home"].set_index("model")
    assert frame.index.tolist() == ["Joint", "Soft RS", "ES", "ERS", "Xavier"]
    assert frame["novel entity given"].tolist() == pytest.approx([95, 75, 50, 50, 10])
    assert frame["all"].tolist() == frame["novel"].tolist() == pytest.approx([80, 60, 30, 40, 20])
    minus = "novel entity given, minus ERS"
    assert frame[minus].tolist() == pytest.approx([45, 25, 0, 0, -40])
    soft = frame.loc[
        "Soft RS",
        ["novel entity given low", "novel entity given high", f"{minus} low", f"{minus} high"],
    ]
    assert soft.tolist() == pytest.approx([60, 90, 20, 30])
    assert "1 initializer has a higher mean than the best of ISI (50.0 points" in text
    assert "The interval of the difference excludes zero for 1 of them." in text
    assert described("soft_rs") in text.splitlines()
    assert described("ers") not in text.splitlines()  # of a main run


def test_without_isi_no_initializer_is_above_it() -> None:
    without = {name: GIVEN[name] for name in ("xavier", "soft_rs", "joint")}
    text, found, _ = shown("stronger", results_with(variant("baselines", {"home": without})))
    assert "than the best" not in text
    assert found["strong_home"]["novel entity given, minus ERS"].isna().all()
    assert found["strong_home"]["model"].tolist() == ["Joint", "Soft RS", "Xavier"]


# Other embeddings


def embedded() -> list[list[VariantRuns]]:
    """Two embedding models on one graph; the first also on another graph,
    on which Xavier equals ISI.
    """
    later = {
        ("es", 0): [0.5, 0.62, 0.7],
        ("es", 1): [0.5, 0.5, 0.5],
        ("xavier", 0): [0.7],
        ("xavier", 1): [0.7],
        ("joint", 0): [0.7],
        ("joint", 1): [0.7],
    }
    one = {"xavier": (0.1, 0.1), "es": (0.2, 0.4), "mean": (0.2, 0.2), "joint": (0.9, 0.9)}
    other = {"xavier": (0.3, 0.3), "es": (0.3, 0.3), "mean": (0.1, 0.1), "joint": (0.9, 0.9)}
    third = {"xavier": (0.1, 0.1), "es": (0.4, 0.6), "mean": (0.7, 0.7), "joint": (0.8, 0.8)}
    immediate = {"xavier": 0.1, "es": 0.25, "mean": 0.2, "joint": 0.5}
    return [
        variant(
            "embeddings", {"home": one, "away": other}, immediate, later=later, title="ANALOGY"
        ),
        variant(
            "embeddings",
            {"home": third},
            immediate,
            later=later,
            title="TransE",
            changes={"finetuning.max_epochs": 9},
        ),
    ]


def test_embedding_models_have_a_row_for_each_graph_that_they_ran_on() -> None:
    text, found, _ = shown("embeddings", results_with(*embedded()))
    rows = [
        ["the home graph", "ANALOGY"],
        ["the home graph", "TransE"],
        ["the away graph", "ANALOGY"],
    ]
    for frame in found.values():
        assert frame[["graph", "embedding"]].to_numpy().tolist() == rows
    about = found["embeddings_novel_given"]
    assert about["ES"].tolist() == pytest.approx([30, 50, 30])
    assert about[["ES low", "ES high"]].to_numpy().ravel().tolist() == pytest.approx(
        [20, 40, 40, 60, 30, 30]
    )
    assert found["embeddings_immediate"]["ES"].tolist() == pytest.approx([25, 25, 25])
    epochs = found["embeddings_epochs"]  # after one; or never, which counts as all of 3 and of 9
    assert epochs["ES"].tolist() == pytest.approx([2, 5, 2])
    assert epochs["Xavier"].tolist() == [0, 0, 0]
    assert "Joint" not in epochs
    # without ties
    assert "the best of ES is above Xavier in 2 of 3 pairs of a model and a graph." in text
    assert "Of all initializers the best is ES in 1, Xavier in 1 and Mean in 1." in text


# The number of insert triples


def test_insert_triples_go_from_the_fewest_to_all() -> None:
    variants = [
        variant(
            "insert_triples",
            {"home": {"xavier": (0.1, 0.1), "ers": (value, value + 0.2), "joint": (0.9, 0.9)}},
            max_insert_triples=number,
        )
        for number, value in ((0, 0.1), (2, 0.3), (None, 0.5))
    ]
    text, tables, (figure,) = shown("n_insert_triples", results_with(*variants))
    frame = tables["n_insert_triples"]
    assert frame["insert triples"].tolist() == ["0", "2", "all"]
    assert frame["ERS"].tolist() == pytest.approx([20, 40, 60])
    assert frame[["ERS low", "ERS high"]].iloc[1].tolist() == pytest.approx([30, 50])
    assert "entity MRR* is 20.0 with 0 and 60.0 with all insert triples for ERS." in text
    assert "lower mean" not in text
    (axes,) = figure.canvas.axes
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["at most 0", "at most 2", "all"]
    dots = {str(drawn.get_label()): np.asarray(drawn[0].get_xydata()) for drawn in axes.containers}
    assert dots["ERS"][:, 0] == pytest.approx([20, 40, 60])
    assert dots["ERS"][:, 1].round().tolist() == [0, 1, 2]  # each in its row


# From this run to the paper


def main_runs(values: Mapping[tuple[str, int], tuple[float, float]], epochs: int) -> pd.DataFrame:
    """Runs in scope all by (model, size): (MRR*, entity half) at epoch 0;
    all converge after ``epochs`` epochs.
    """
    cells = list(values.items())
    rows = runs([(model, "all", size, 0, 0, mrr_star) for (model, size), (mrr_star, _) in cells])
    rows["mrr_star_entity"] = [entity for _, (_, entity) in cells]
    later = runs(
        [(model, "all", size, 0, epochs, 0.95) for (model, size), _ in cells if model != "joint"]
    )
    return pd.concat([rows, later], ignore_index=True)


def compared() -> Results:
    """Results on two graphs; the first has learning curves for size 1, and a query breakdown."""
    results = results_with(
        variant("insert_triples", {"home": {"es": [0.5]}}),
        variant(
            "causes",
            {"home": {"xavier": [0.5], "es": [0.5], "rs": [0.5], "ers": [0.5], "joint": [0.5]}},
            {"xavier": 0.25, "es": 0.5, "rs": 0.25, "ers": 0.75, "joint": 0.9},
            title="another decay",
            finetuned=False,
            later={("es", 0): [0.9], ("joint", 0): [0.9]},
        ),
    )
    results = with_settings(results, "home", full_curves=FullCurves(sizes=[1]))
    home = {
        ("xavier", 1): (0.4, 0.2),
        ("es", 1): (0.5, 0.3),
        ("rs", 1): (0.6, 0.3),
        ("ers", 1): (0.7, 0.6),
        ("joint", 1): (0.9, 0.8),
        ("xavier", 2): (0.2, 0.1),
        ("es", 2): (0.4, 0.3),
        ("rs", 2): (0.5, 0.3),
        ("ers", 2): (0.6, 0.6),
        ("joint", 2): (0.9, 0.8),
    }
    away = {(model, size): (0.5, 0.5) for model in ("xavier", "es", "rs", "ers") for size in (1, 2)}
    away |= {("joint", size): (0.9, 0.9) for size in (1, 2)}
    groups = queries_of("home", {"xavier": [0.5], "es": [0.5]}).assign(size=1)
    true = groups[(groups["novel"] == "given") & (groups["filter"] == "true")].assign(scope="all")
    true["mrr_star"] = np.where(
        true["model"] == "xavier", 0.4, np.where(true["hidden"] == "relation", 0.9, 0.7)
    )
    results = of_experiment(
        results, "home", runs=main_runs(home, 2), queries=pd.concat([groups, true])
    )
    return of_experiment(results, "away", runs=main_runs(away, 3))


def test_each_cause_has_its_gain_over_xavier_and_its_epochs() -> None:
    text, found, _ = shown("causes", compared())
    frame = found["causes"].set_index("row")
    assert frame.index.tolist() == [
        "this run, 1 novel entities",
        "2 novel entities, 50 % of all",
        "entity prediction alone",
        "all true triples left out of the candidates",
        "another decay (the home graph)",
        "the away graph, 1 novel entities",
        "the paper",
    ]
    columns = ["joint", "Xavier", "ISI", "gain %", "epochs: Xavier", "epochs: ISI"]
    expected = {
        "this run, 1 novel entities": [90, 40, 60, 50, 2, 2],
        "2 novel entities, 50 % of all": [90, 20, 50, 150, 2, 2],
        "entity prediction alone": [80, 20, 40, 100, np.nan, np.nan],
        # of ISI, ES alone has a query breakdown, so ISI's mean is NaN; Xavier has 40
        "all true triples left out of the candidates": [np.nan, 40, np.nan, np.nan, np.nan, np.nan],
        # which is not fine-tuned
        "another decay (the home graph)": [90, 25, 50, 100, np.nan, np.nan],
        "the away graph, 1 novel entities": [90, 50, 50, 0, 3, 3],
        "the paper": [
            np.nan,
            np.nan,
            np.nan,
            (41.4 + 37.6 + 42.1) / 3,
            112.6,
            (16.6 + 27.1 + 29.9) / 3,
        ],
    }
    for what, values in expected.items():
        assert frame.loc[what, columns].tolist() == pytest.approx(values, nan_ok=True), what
    assert (
        "the paper's ISI gains 40 % over Xavier and this run's 50 % with 1 novel entities." in text
    )
    assert "The largest gain here is 150 % (2 novel entities, 50 % of all)." in text
    assert (
        "takes 112.6 epochs to converge, this run's 2.0, and 3.0 with the away graph, "
        "1 novel entities."
    ) in text
    assert "ISI takes 3.0 there, and 24.5 in the paper." in text


def test_a_variant_with_full_curves_has_them_and_its_epochs_beside_the_papers() -> None:
    later = {("xavier", 0): [0.1, 0.5, 0.9], ("es", 0): [0.9, 0.9, 0.9], ("joint", 0): [0.9]}
    about = {"home": {"xavier": [0.5], "es": [0.5], "joint": [0.5]}}
    curves = variant("causes", about, later=later, full_curves=True, title="their way", key="paper")
    results = compared()
    _, tables, (figure,) = shown("causes", replace(results, variants=[*results.variants, *curves]))
    assert figure.name == "curves_paper_home"
    (xavier,) = (line for line in figure.canvas.axes[1].lines if line.get_label() == "Xavier")
    assert list(np.asarray(xavier.get_ydata())) == pytest.approx([10, 50, 90])
    rows = tables["convergence_paper_home"].set_index("initializer")
    assert rows["novel_heldout: mean"].tolist() == [2, 0]
    assert rows["paper: mean"].tolist() == [112.6, 16.6]


@pytest.mark.parametrize("missing", [["xavier"], ["es", "rs", "ers"], []])
def test_without_anything_to_compare_nothing_is_said_of_causes(missing: list[str]) -> None:
    results = compared()
    if missing:
        names = [name for name in results.experiments["home"].initializers if name not in missing]
        other = of_experiment(results, "home", initializers=names)
    else:
        other = with_settings(results, "home", full_curves=FullCurves(sizes=[7]))
    assert list(paper.causes(other)) == []
