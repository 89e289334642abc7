"""What the report says of what lies beyond the paper, against a handful of runs and answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from isi.analyses.variants import VARIANT_QUERIES, VARIANT_RUNS
from isi.experiment.insert import FullCurves
from isi.report.data import BreakdownTables, Results, VariantRuns, read_variants
from isi.report.figures import Figure
from isi.report.sections import paper
from isi.report.tables import ReportTable
from isi.report.words import described
from isi.tables import paths
from tests.reports import runs, shown, small_params, small_results
from tests.variants import queries_of, variant

GROUPS = {"stronger": "baselines", "embeddings": "embeddings", "n_insert_triples": "insert_triples",
          "other_words": "words", "causes": "causes"}  # fmt: skip


def results_with(**found: VariantRuns) -> Results:
    return replace(small_results(["home", "away"], studies=False), variants=found)


@pytest.mark.parametrize("section", GROUPS)
def test_nothing_is_said_where_the_second_pipeline_has_not_run(section: str) -> None:
    assert shown(section, small_results(["home"])) == ("", {}, [])


# A variant


def test_entity_prediction_with_the_novel_entity_given_by_hand() -> None:
    columns = ["model", "seed", "relation", "hidden", "novel", "filter", "scope", "queries", "mrr_star", "observations"]
    rows = [
        ("es", 0, "on", "tail", "given", "learned", "novel", 1, 0.8, 3),
        ("es", 0, "on", "head", "given", "learned", "novel", 3, 0.4, 3),
        ("es", 0, "in", "tail", "given", "learned", "novel", 5, 0.9, 1),
        ("es", 0, "in", "tail", "answer", "learned", "novel", 5, 0.1, 1),
        ("es", 0, "in", "tail", "both", "learned", "novel", 5, 0.1, 1),
        ("es", 0, "in", "relation", "given", "learned", "novel", 5, 0.1, 1),
        ("es", 0, "in", "tail", "given", "true", "novel", 5, 0.1, 1),
        ("es", 0, "in", "tail", "given", "learned", "novel_heldout", 5, 0.1, 1),
    ]
    asked = pd.DataFrame(rows, columns=columns).assign(experiment="home", size=5)
    one = replace(variant("insert_triples", {"home": {"es": [0.5]}}), queries=asked)
    # on: (0.8 + 3 · 0.4) / 4 = 0.5, three times observed; in: 0.9, once
    (found,) = one.given_in("home").to_dict("records")
    assert found["mrr_star_entity"] == pytest.approx((3 * 0.5 + 0.9) / 4)
    assert (found["model"], found["size"], found["seed"]) == ("es", 5, 0)
    assert one.given_in("away").empty


def test_convergence_is_against_the_joint_model_of_the_variant_and_of_the_session() -> None:
    """Within 8 points of it; the variant says how many epochs there are at most."""
    later = {("es", 0): [0.5, 0.62, 0.7], ("es", 1): [0.5, 0.5, 0.5], ("joint", 0): [0.7], ("joint", 1): [0.7]}
    one = variant("causes", {"home": {"es": [0.5]}}, later=later)
    params = small_results(["home"], studies=False).params
    found = one.convergence("home", params)
    heldout = found[found["scope"] == "novel_heldout"].set_index("seed")
    assert heldout["epochs"].to_dict() == {0: 1, 1: 3}
    assert heldout["converged"].to_dict() == {0: True, 1: False}
    longer = variant("causes", {"home": {"es": [0.5]}}, later=later, changes={"finetuning.max_epochs": 9})
    again = longer.convergence("home", params)
    assert again[again["scope"] == "novel_heldout"]["epochs"].tolist() == [1, 9]
    second = one.runs.assign(session=2, mrr_star=one.runs["mrr_star"].where(one.runs["model"] != "joint", 0.5))
    both = replace(one, runs=pd.concat([one.runs, second])).convergence("home", params)
    of_both = both[both["scope"] == "novel_heldout"].set_index(["session", "seed"])["epochs"]
    assert of_both.to_dict() == {(1, 0): 1, (1, 1): 3, (2, 0): 0, (2, 1): 0}


def test_of_a_variant_that_lists_more_by_now_there_is_what_ran() -> None:
    one = variant("baselines", {"home": {"es": [0.5, 0.5], "ers": [0.4, 0.4], "joint": [0.9, 0.9]}})
    listed = one.variant.model_copy(
        update={"experiments": ["away", "home"], "initializers": ["rs", "soft_es", "ers", "es"]}
    )
    later = replace(one, variant=listed)
    assert later.experiments == ["home"]
    assert later.models == ["ers", "es", "joint"]
    for section, group in GROUPS.items():
        of_group = replace(later, variant=listed.model_copy(update={"group": group}))
        _, found, _ = shown(section, results_with(own=of_group))
        assert found


def test_variants_are_read_as_far_as_they_ran_on_experiments_that_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    one = variant(
        "insert_triples", {"home": {"es": [0.5, 0.5], "joint": [0.9, 0.9]}, "away": {"es": [0.5], "joint": [0.9]}}
    )
    paths.BEYOND_PARAMS.parent.mkdir()
    listed = dict.fromkeys(("elsewhere", "second", "first", "waiting"), one.variant.model_dump())
    paths.BEYOND_PARAMS.write_text(yaml.safe_dump({"variants": listed}, sort_keys=False), encoding="utf-8")
    order = ["experiment", "model", "size", "seed", "session", "epoch", "scope"]
    for name in ("first", "second", "elsewhere"):
        whole = dict.fromkeys(("mrr_star_entity", "mrr_star_relation", "mrr"), one.runs["mrr_star"])
        ran, asked = one.runs.assign(**whole).sort_values(order), one.queries.assign(mrr=0.5, session=1)
        if name == "elsewhere":
            ran, asked = (frame[frame["experiment"] == "away"] for frame in (ran, asked))
        VARIANT_RUNS.write(ran, "vary", variant=name)
        VARIANT_QUERIES.write(asked, "vary", variant=name)
    found = read_variants(["home"], small_params(["home", "away"]))
    assert list(found) == ["second", "first"]
    assert found["first"].experiments == ["home"]
    assert set(found["first"].runs["experiment"]) == set(found["first"].queries["experiment"]) == {"home"}
    pd.testing.assert_frame_equal(found["first"].given_in("home"), one.given_in("home"), check_dtype=False)
    assert list(read_variants(["home", "away"], small_params(["home", "away"]))) == ["elsewhere", "second", "first"]


# Stronger initializers


GIVEN = {"xavier": (0.1, 0.1), "es": (0.5, 0.5), "ers": (0.4, 0.6), "soft_rs": (0.6, 0.9), "joint": (0.95, 0.95)}


def test_stronger_initializers_are_sorted_and_compared_with_ers_seed_by_seed() -> None:
    immediate = {"xavier": 0.2, "es": 0.3, "ers": 0.4, "soft_rs": 0.6, "joint": 0.8}
    text, found, _ = shown("stronger", results_with(own=variant("baselines", {"home": GIVEN}, immediate)))
    frame = found["strong_home"].set_index("model")
    assert frame.index.tolist() == ["Joint", "Soft RS", "ES", "ERS", "Xavier"]
    assert frame["novel entity given"].tolist() == pytest.approx([95, 75, 50, 50, 10])
    assert frame["all"].tolist() == frame["novel"].tolist() == pytest.approx([80, 60, 30, 40, 20])
    minus = "novel entity given, minus ERS"
    assert frame[minus].tolist() == pytest.approx([45, 25, 0, 0, -40])
    soft = frame.loc["Soft RS", ["novel entity given low", "novel entity given high", f"{minus} low", f"{minus} high"]]
    assert soft.tolist() == pytest.approx([60, 90, 20, 30])
    assert "the best of ISI here has 50.0; above it: Soft RS 75.0. The joint model" in text
    assert described("soft_rs") in text.splitlines()
    assert described("ers") not in text.splitlines()  # of a main run


def test_without_isi_no_initializer_is_above_it() -> None:
    without = {name: GIVEN[name] for name in ("xavier", "soft_rs", "joint")}
    text, found, _ = shown("stronger", results_with(own=variant("baselines", {"home": without})))
    assert "above it" not in text
    assert found["strong_home"]["novel entity given, minus ERS"].isna().all()
    assert found["strong_home"]["model"].tolist() == ["Joint", "Soft RS", "Xavier"]


# Other embeddings


def embedded() -> dict[str, VariantRuns]:
    """Two embedding models on one graph, the first of them on another, too; on that, Xavier is as good as ISI."""
    later = {("es", 0): [0.5, 0.62, 0.7], ("es", 1): [0.5, 0.5, 0.5], ("xavier", 0): [0.7], ("xavier", 1): [0.7],
             ("joint", 0): [0.7], ("joint", 1): [0.7]}  # fmt: skip
    one = {"xavier": (0.1, 0.1), "es": (0.2, 0.4), "mean": (0.2, 0.2), "joint": (0.9, 0.9)}
    other = {"xavier": (0.3, 0.3), "es": (0.3, 0.3), "mean": (0.1, 0.1), "joint": (0.9, 0.9)}
    third = {"xavier": (0.1, 0.1), "es": (0.4, 0.6), "mean": (0.7, 0.7), "joint": (0.8, 0.8)}
    immediate = {"xavier": 0.1, "es": 0.25, "mean": 0.2, "joint": 0.5}
    return {
        "analogy": variant("embeddings", {"home": one, "away": other}, immediate, later=later, title="ANALOGY"),
        "transe": variant("embeddings", {"home": third}, immediate, later=later, title="TransE",
                          changes={"finetuning.max_epochs": 9}),
    }  # fmt: skip


def test_embedding_models_have_a_row_for_each_graph_that_they_ran_on() -> None:
    text, found, _ = shown("embeddings", results_with(**embedded()))
    rows = [["the home graph", "ANALOGY"], ["the home graph", "TransE"], ["the away graph", "ANALOGY"]]
    for frame in found.values():
        assert frame[["graph", "embedding"]].to_numpy().tolist() == rows
    about = found["embeddings_novel_given"]
    assert about["ES"].tolist() == pytest.approx([30, 50, 30])
    assert about[["ES low", "ES high"]].to_numpy().ravel().tolist() == pytest.approx([20, 40, 40, 60, 30, 30])
    assert found["embeddings_immediate"]["ES"].tolist() == pytest.approx([25, 25, 25])
    epochs = found["embeddings_epochs"]  # after one; or never, which counts as all of 3 and of 9
    assert epochs["ES"].tolist() == pytest.approx([2, 5, 2])
    assert epochs["Xavier"].tolist() == [0, 0, 0]
    assert "Joint" not in epochs
    assert (
        "the best of ES is above Xavier in 2 of 3 pairs of an embedding model and a graph." in text
    )  # a tie is not above
    assert "First of all initializers: ES in 1, Xavier in 1 and Mean in 1." in text


# The number of insert triples


def test_insert_triples_go_from_the_fewest_to_all() -> None:
    found = {
        name: variant("insert_triples", {"home": {"xavier": (0.1, 0.1), "es": (value, value + 0.2),
                                                  "joint": (0.9, 0.9)}}, max_insert_triples=number)
        for name, number, value in (("told_0", 0, 0.1), ("told_2", 2, 0.3), ("told_all", None, 0.5))
    }  # fmt: skip
    text, tabled, (figure,) = shown("n_insert_triples", results_with(**found))
    frame = tabled["n_insert_triples"]
    assert frame["insert triples"].tolist() == ["0", "2", "all"]
    assert frame["ES"].tolist() == pytest.approx([20, 40, 60])
    assert frame[["ES low", "ES high"]].iloc[1].tolist() == pytest.approx([30, 50])
    assert "with 0 and with all of its insert triples: Xavier 10.0 and 10.0 and ES 20.0 and 60.0" in text
    (axes,) = figure.canvas.axes
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["0", "2", "all"]
    heights = {str(line.get_label()): list(np.asarray(line.get_ydata())) for line in axes.lines}
    assert heights["ES"] == pytest.approx([20, 40, 60])


# From this run to the paper


def main_runs(values: Mapping[tuple[str, int], tuple[float, float]], epochs: int) -> pd.DataFrame:
    """Runs in scope all by (model, size): MRR* and its entity half at once; all converge after so many epochs."""
    cells = list(values.items())
    rows = runs([(model, "all", size, 0, 0, mrr_star) for (model, size), (mrr_star, _) in cells])
    rows["mrr_star_entity"] = [entity for _, (_, entity) in cells]
    later = runs([(model, "all", size, 0, epochs, 0.95) for (model, size), _ in cells if model != "joint"])
    return pd.concat([rows, later], ignore_index=True)


def compared() -> Results:
    """Of two graphs; the first with curves of size 1, and with what was asked."""
    results = results_with(
        told=variant("insert_triples", {"home": {"es": [0.5]}}),
        decay=variant(
            "causes", {"home": {"xavier": [0.5], "es": [0.5], "ers": [0.5], "joint": [0.5]}},
            {"xavier": 0.25, "es": 0.5, "ers": 0.75, "joint": 0.9}, title="another decay", finetuned=False,
        ),
    )  # fmt: skip
    how = results.params.experiments["home"].model_copy(update={"full_curves": FullCurves(sizes=[1])})
    params = results.params.model_copy(update={"experiments": results.params.experiments | {"home": how}})
    home = {("xavier", 1): (0.4, 0.2), ("es", 1): (0.5, 0.3), ("rs", 1): (0.6, 0.3), ("ers", 1): (0.7, 0.6),
            ("joint", 1): (0.9, 0.8), ("xavier", 2): (0.2, 0.1), ("es", 2): (0.4, 0.3), ("rs", 2): (0.5, 0.3),
            ("ers", 2): (0.6, 0.6), ("joint", 2): (0.9, 0.8)}  # fmt: skip
    away = {(model, size): (0.5, 0.5) for model in ("xavier", "es", "rs", "ers") for size in (1, 2)}
    away |= {("joint", size): (0.9, 0.9) for size in (1, 2)}
    experiments = {
        name: replace(results.experiments[name], params=params, runs=main_runs(values, epochs))
        for name, values, epochs in (("home", home, 2), ("away", away, 3))
    }
    groups = queries_of("home", {"xavier": [0.5], "es": [0.5]}).assign(size=1)
    true = groups[(groups["novel"] == "given") & (groups["filter"] == "true")].assign(scope="all")
    true["mrr_star"] = np.where(true["model"] == "xavier", 0.4, np.where(true["hidden"] == "relation", 0.9, 0.7))
    breakdown = {"home": BreakdownTables(pd.concat([groups, true]), pd.DataFrame())}
    return replace(results, params=params, experiments=experiments, query_breakdown=breakdown)


def test_each_cause_has_its_gain_over_xavier_and_its_epochs() -> None:
    text, found, _ = shown("causes", compared())
    frame = found["causes"].set_index("row")
    assert frame.index.tolist() == [
        "this run, 1 novel entities", "2 novel entities, 50 % of all", "entity prediction alone",
        "all true triples left out of the candidates", "another decay (the home graph)",
        "the away graph, 2 novel entities",
        "the paper",
    ]  # fmt: skip
    columns = ["joint", "Xavier", "ISI", "gain %", "epochs: Xavier", "epochs: ISI"]
    expected = {
        "this run, 1 novel entities": [90, 40, 60, 50, 2, 2],
        "2 novel entities, 50 % of all": [90, 20, 50, 150, 2, 2],
        "entity prediction alone": [80, 20, 40, 100, np.nan, np.nan],
        # of whom ES alone was asked: halves of 70 and 90 against 40
        "all true triples left out of the candidates": [np.nan, 40, np.nan, np.nan, np.nan, np.nan],
        "the away graph, 2 novel entities": [90, 50, 50, 0, 3, 3],
        "the paper": [np.nan, np.nan, np.nan, (41.4 + 37.6 + 42.1) / 3, 112.6, (16.6 + 27.1 + 29.9) / 3],
    }
    for what, values in expected.items():
        assert frame.loc[what, columns].tolist() == pytest.approx(values, nan_ok=True), what
    assert "The paper's ISI gains 40 % over Xavier, this run's 50 %" in text
    assert "the largest gain in the table is 150 %, with 2 novel entities, 50 % of all." in text
    assert "takes 112.6 epochs to converge, this run's 2.0, and 3.0 with the away graph, 2 novel entities:" in text


def test_a_variant_that_is_not_finetuned_has_no_epochs_and_its_gain_is_of_those_who_ran() -> None:
    line, _ = paper.of_variants(compared(), {"decay": compared().variants["decay"]})
    found = paper.cause_row(*line, ["es", "ers"])
    assert [found[name] for name in ("joint", "Xavier", "ISI", "gain %")] == pytest.approx([90, 25, 62.5, 150])
    assert np.isnan(list(found.values())[-2:]).all()


def test_a_variant_that_was_followed_has_its_curves_and_its_epochs_beside_the_papers() -> None:
    later = {("xavier", 0): [0.1, 0.5, 0.9], ("es", 0): [0.9, 0.9, 0.9], ("joint", 0): [0.9]}
    about = {"home": {"xavier": [0.5], "es": [0.5], "joint": [0.5]}}
    one = variant("causes", about, later=later, full_curves=True, title="their way")
    figure, table = paper.full_curves(results_with(paper=one), "paper", one, "home")
    assert isinstance(figure, Figure)
    assert isinstance(table, ReportTable)
    assert (figure.name, table.name) == ("curves_paper_home", "convergence_paper_home")
    (xavier,) = (line for line in figure.canvas.axes[1].lines if line.get_label() == "Xavier")
    assert list(np.asarray(xavier.get_ydata())) == pytest.approx([10, 50, 90])
    rows = table.frame.set_index("initializer")
    assert rows["novel_heldout: mean"].tolist() == [2, 0]
    assert rows["paper: mean"].tolist() == [112.6, 16.6]


@pytest.mark.parametrize("gone", ["xavier", "isi", "curves"])
def test_without_anything_to_compare_nothing_is_said_of_causes(gone: str) -> None:
    results = compared()
    home = results.experiments["home"]
    if gone == "curves":
        how = home.settings.model_copy(update={"full_curves": FullCurves(sizes=[7])})
        params = results.params.model_copy(update={"experiments": results.params.experiments | {"home": how}})
        other = replace(home, params=params)
    else:
        names = {"xavier"} if gone == "xavier" else {"es", "rs", "ers"}
        other = replace(home, initializers=[name for name in home.initializers if name not in names])
    assert list(paper.causes(replace(results, experiments=results.experiments | {"home": other}))) == []
