"""The paper against this run: the numbers of both, and the causes of the gap."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from math import nan
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi import config
from isi.config import value_of
from isi.initializers.api import INITIALIZERS
from isi.report import stats
from isi.report.data import Experiment, ModelRuns, Results, VariantRuns
from isi.report.figures import by_epoch, legend, panels
from isi.report.section import Content
from isi.report.sections import choices, queries, run
from isi.report.sections.finetuning import CURVES, interference_percent, table2
from isi.report.stats import mean_of
from isi.report.tables import Column
from isi.report.words import BASELINE, JOINT, TEMPLATES, isi, label

#: The rows of the table of all numbers; the file says how they are written.
ROWS = TEMPLATES / "paper_rows.yaml"
#: A number of this run agrees with the paper's if it differs by at most this share.
AGREES = 0.1
#: Place of a number in the paper, its title, the paper's number, ours (NaN if there is none), and a
#: note on ours.
Row = tuple[str, str, float, float, str]


def paper(results: Results) -> Iterator[Content]:
    """The paper's numbers beside those of each standalone experiment; nothing without one."""
    if not results.standalone:
        return
    first, *others = results.standalone
    columns = {"paper": "", "this run": ""} | {
        experiment.name: experiment.title for experiment in others
    }
    rows = rows_of(results, first)
    ours = [{row[:2]: row[3] for row in rows_of(results, experiment)} for experiment in others]
    compared = [comparison(theirs, of_run) for _, _, theirs, of_run, _ in rows]
    table = [
        {
            "where": where,
            "what": title,
            **{
                Column(name, title=header, form=shown, any_size=True): number
                for (name, header), number in zip(
                    columns.items(),
                    [*numbers, *(values.get((where, title), nan) for values in ours)],
                    strict=True,
                )
            },
            "this run is": word,
            "note": note,
        }
        for (where, title, *numbers, note), word in zip(rows, compared, strict=True)
    ]
    like = [word for word, row in zip(compared, rows, strict=True) if "instead" not in row[1]]
    counts = {word: like.count(word) for word in ("agrees", "larger", "smaller")}
    drawn = _scatter([(where, theirs, of_run) for where, _, theirs, of_run, _ in rows])
    yield Content(
        {"others": others, "counts": counts},
        {"paper_against_this_run": table},
        {"paper_against_this_run": drawn},
    )


def comparison(paper: float, ours: float) -> str:
    """Whether a number agrees with the paper's within ``AGREES`` of it, is larger or smaller;
    empty without both.
    """
    if np.isnan(paper) or np.isnan(ours):
        return ""
    return (
        "agrees"
        if abs(ours - paper) <= AGREES * abs(paper)
        else "larger"
        if ours > paper
        else "smaller"
    )


def _scatter(numbers: Sequence[tuple[str, float, float]]) -> Canvas:
    """The paper's results (across) and ours (up) on logarithmic axes,
    with a colour for each part of the paper.
    """
    canvas, (axes,) = panels(1, 1, 4.4, 6.4)
    for where in dict.fromkeys(where for where, *_ in numbers):
        pairs = np.array([(theirs, ours) for place, theirs, ours in numbers if place == where])
        axes.plot(*pairs.T, ls="", marker="o", ms=4, alpha=0.8, label=where)
    axes.set_xscale("symlog", linthresh=1)
    axes.set_yscale("symlog", linthresh=1)
    axes.axline((1, 1), (10, 10), color="#999999", lw=1)
    axes.set(xlabel="paper", ylabel="this run")
    legend(canvas, [axes])
    return canvas


def own_graph(results: Results) -> Iterator[Content]:
    """The standalone graphs side by side, and where ISI is significantly below the
    mean of an entity's kind.
    """
    graphs = [experiment for experiment in results.standalone if experiment.queries is not None]
    if len(graphs) < 2:
        return
    columns, compared = dict[Any, Any](), []
    for experiment in graphs:
        columns |= {
            Column("all", experiment.title): experiment.immediate_means("all"),
            Column("novel entity given", experiment.title): experiment.given_means,
            Column("mean", experiment.title, title="epochs"): experiment.epochs_means(),
        }
        if "kind_mean" in experiment.initializers and experiment is not graphs[0]:
            cells = experiment.by_grid_point("novel")
            below = {
                name: stats.difference(stats.by_seed(cells[name], cells["kind_mean"]))
                for name in isi(experiment.initializers)
            }
            compared.append(
                (
                    experiment,
                    [name for name, points in below.items() if points.high < 0],
                    "kind_mean",
                )
            )
    models = list(dict.fromkeys(name for experiment in graphs for name in experiment.models))
    yield Content({"compared": compared}, {"standalone_graphs": stats.by_label(models, columns)})


def shown(value: float) -> str:
    """A number as text: whole, with one decimal from 1 up, else with two significant digits."""
    value = round(value, 6)  # a mean may miss a whole number by its last bits
    return (
        f"{value:,.0f}"
        if float(value).is_integer()
        else f"{value:.1f}"
        if abs(value) >= 1
        else f"{value:.2g}"
    )


def rows_of(results: Results, experiment: Experiment) -> list[Row]:
    """All numbers of the paper beside those of one experiment;
    the rows do not depend on what was run.
    """
    source, paper, methods = (
        experiment.settings.graph.source,
        results.paper,
        list(results.paper["indicators"]),
    )
    moved = next(
        (other for other in results.extended if other.settings.graph.source == source), None
    )
    gain, fewer = (
        stats.values(stats.improvements(experiment.immediate, "all")),
        fewer_epochs(experiment),
    )
    means, dropped = (
        (moved.mrr_star, stats.values(interference_percent(moved.immediate))) if moved else ({}, {})
    )
    gained, saved = (
        paper["immediate"]["improvement_over_xavier"],
        paper["convergence"]["fewer_epochs_than_xavier"],
    )
    answers, whose = paper["affordances"], dict.fromkeys(methods, "isi") | {BASELINE: "xavier"}
    theirs = {
        **paper,
        "means": {"gain": mean_of(gained, methods), "fewer": saved.get("mean")},
        "fewer_epochs": {name: saved.get(name) for name in methods},
        "best_indicators": dict.fromkeys(methods, paper["indicators_degrade_after"]),
        "judged": {
            name: answers["judged"][who] | {"affordances": answers[who]}
            for name, who in whose.items()
        },
    }
    ours = {
        "means": {"gain": mean_of(gain, methods), "fewer": mean_of(fewer, methods)},
        "fewer_epochs": fewer,
        "immediate": {"improvement_over_xavier": gain},
        "graph": _graph(results, experiment),
        "settings": {"finetuning_rate": results.params.finetuning.learning_rate},
        **_choices(results, experiment, moved),
        "convergence": {
            "epochs": _epochs(experiment, "all"),
            "heldout": _epochs(experiment, "novel_heldout"),
        },
        "transfer": {
            "all_queries": means.get("all"),
            "novel_queries": means.get("novel"),
            "drop": dropped,
            "epochs": moved and moved.epochs().get("all"),
        },
        "judged": _judged(results, list(whose), experiment, moved),
    }
    labels = {name: label(name) for name in INITIALIZERS.names()}
    filled = {
        "answers": queries.TOP * len(results.params.affordances.entities),
        "first": results.standalone[0].title,
    }
    rows = list[Row]()
    for where, titles, key, *ours_key in config.read(ROWS)["rows"]:
        names = list(value_of(theirs, key)) if isinstance(value_of(theirs, key), dict) else [""]
        parts = titles.items() if isinstance(titles, dict) else [("", titles)]
        for name, (part, title) in product(names, parts):
            place = "".join(f".{step}" for step in (name, part) if step)
            number, value = (
                value_of(theirs, key + place),
                value_of(ours, (*ours_key, key)[0] + place),
            )
            value, note = value if isinstance(value, tuple) else (value, "")
            text = (f"{labels.get(name, name)}: {title}" if name else title).format(**filled)
            rows.append(
                (
                    where,
                    text,
                    *(nan if each is None else float(each) for each in (number, value)),
                    note,
                )
            )
    return rows


def fewer_epochs(experiment: Experiment) -> dict[str, float]:
    """Per cent by which each initializer's mean epochs to convergence are
    below Xavier's (section 6.2).
    """
    epochs = experiment.epochs().get("all", {})
    base = epochs.get(BASELINE)
    return {model: 100 * (1 - mean / base) for model, mean in epochs.items()} if base else {}


def _graph(results: Results, experiment: Experiment) -> dict[str, Any]:
    """The size of the graph, and Table 1."""
    words, entities, triples = results.vocabulary, experiment.entities, experiment.triples
    kinds, bowls = entities["kind"].value_counts(), triples
    for end, names in words["bowls_in_cabinets"].items():
        bowls = bowls[bowls[end].isin(names)]
    observations, counts = (
        results.observed[experiment.settings.graph.source].observations,
        pd.DataFrame(),
    )
    if observations["scene"].notna().any():
        counts = run.table1(
            observations, results.paper["graph"]["median_per_environment"], words["relations"]
        )
        counts.columns = [getattr(column, "name", column) for column in counts.columns]
        counts = counts.set_index("room").rename(columns={"object types": "entities"})
    return {
        "relations": triples["relation"].nunique(),
        "entities": len(entities),
        "unique_triples": len(triples),
        "concepts": kinds.reindex(words["concepts"]).sum(),
        **{kind: kinds.get(kind, 0) for kind in words["kinds"]},
        "observations": triples["count"].sum(),
        "bowls_in_cabinets": bowls["count"].sum(),
        "median_per_environment": counts.to_dict("index"),
    }


def _choices(results: Results, experiment: Experiment, moved: Experiment | None) -> dict[str, Any]:
    """Best settings in cross-validation, each with a note, the rule,
    and the sizes that it picks.
    """
    choice, picked, tops = (
        results.params.settings[0].model_dump(),
        dict[str, int](),
        dict[str, int](),
    )
    models, training = list(results.params.sweep.initializers), dict[str, tuple[float, str]]()
    for _, folds in results.analysis("cross_validation", experiment, moved):
        training = {name: choices.best(folds, choice, name) for name in choice}
    for swept, runs in results.analysis("sweep", experiment, moved):
        means = choices.means_of(
            runs[runs["epoch"] == 0], swept.converged(runs, ["model", "k"]), models
        )
        picked, mrr_star = choices.picked_sizes(means), means[Column("MRR*", "all")].dropna()
        tops = {model: int(mrr_star[model].idxmax()) for model in mrr_star.index.unique("model")}
    return {
        "training": training,
        "indicators": picked,
        "best_indicators": tops,
    }


def _epochs(experiment: Experiment, scope: str) -> dict[Any, Any]:
    """Table 2 in one scope, by model: mean and standard deviation of the epochs to convergence."""
    rows = experiment.convergence[experiment.convergence["scope"] == scope]
    return (
        rows.groupby("model")["epochs"]
        .agg(["mean", "std"])
        .set_axis(["mean", "deviation"], axis=1)
        .to_dict("index")
    )


def _judged(
    results: Results, models: Sequence[str], *experiments: Experiment | None
) -> dict[str, Any]:
    """Table 3 by model: how many of the answers shown are affordances, and how many are plausible,
    unlikely, wrong.
    """
    entities, afforded = results.params.affordances.entities, results.vocabulary["afforded"]
    answers = [
        queries.AffordanceAnswers.of(experiment)
        for experiment, _ in results.analysis("affordances", *experiments)
    ]
    return {
        name: ranked.judged(name, entities, afforded)
        for ranked in answers
        for name in models
        if name in set(ranked.ranks["model"])
    }


#: The name of a row, MRR* over all queries right after insertion, and epochs to convergence, by
#: model.
Line = tuple[str, Mapping[str, float], Mapping[str, float]]


def causes(results: Results) -> Iterator[Content]:
    """Causes of the gap to the paper: a row for each changed setting;
    Figure 3b and Table 2 for full curves.
    """
    variants, first = results.variants_of("causes"), next(iter(results.standalone), None)
    methods = isi(first.finetuned) if first else []
    if (
        not variants
        or not first
        or first.curve_size is None
        or BASELINE not in first.finetuned
        or not methods
    ):
        return
    paper, margin = results.paper["convergence"]["epochs"], results.params.convergence.margin
    xavier, epochs = (
        Column(label(BASELINE), "epochs"),
        {name: numbers["mean"] for name, numbers in paper.items()},
    )
    rows = list[dict[Any, Any]]()
    for name, now, later in _lines(results, first, variants):
        mean, mean_epochs = (
            float(np.mean([values.get(method, nan) for method in methods]))
            for values in (now, later)
        )
        base = now.get(BASELINE, nan)
        rows.append(
            {
                "row": name,
                "joint": now.get(JOINT, nan),
                label(BASELINE): base,
                "ISI": mean,
                "gain %": 100 * (mean / base - 1),
                xavier: later.get(BASELINE, nan),
                Column("ISI", "epochs"): mean_epochs,
            }
        )
    gain = mean_of(results.paper["immediate"]["improvement_over_xavier"], methods)
    theirs = {
        "row": "the paper",
        "gain %": gain,
        xavier: epochs.get(BASELINE, nan),
        Column("ISI", "epochs"): mean_of(epochs, methods),
    }
    most_gain, slowest = (
        pd.DataFrame(rows)[name].fillna(-1).to_numpy().argmax() for name in ("gain %", xavier)
    )
    curves = [runs for runs in variants if runs.variant.full_curves]
    numbers = {
        "methods": methods,
        "curves": curves,
        "gain": [row["gain %"] for row in (theirs, rows[0], rows[most_gain])],
        "of_gain": rows[most_gain]["row"],
        "epochs": [row[xavier] for row in (theirs, rows[0], rows[slowest])],
        "of_epochs": rows[slowest]["row"],
        "isi_epochs": [row[Column("ISI", "epochs")] for row in (rows[slowest], theirs)],
    }
    tables = {
        f"convergence_{runs.id}": table2(runs.convergence, runs.initializers, paper)
        for runs in curves
    }
    figures = {
        f"curves_{runs.id}": by_epoch(runs.runs, runs.initializers, CURVES, margin=margin)
        for runs in curves
    }
    yield Content(numbers, {"causes": [*rows, theirs], **tables}, figures)


def _lines(results: Results, first: Experiment, variants: Sequence[VariantRuns]) -> Iterator[Line]:
    """Lines of the first graph: two sizes, entity MRR*, filter ``true``;
    then of variants and of other graphs.
    """
    size, largest = first.curve_size, max(first.settings.sessions.sizes)
    main = first.of_size(size)
    yield _line(f"this run, {size} novel entities", main)
    if largest != size:
        share = 100 * largest / len(first.entities)
        yield _line(f"{largest} novel entities, {share:.0f} % of all", first.of_size(largest))
    yield "entity prediction alone", _line("", main, "mrr_star_entity")[1], {}
    if main.queries is not None:
        true = main.queries[(main.queries["scope"] == "all") & (main.queries["filter"] == "true")]
        means = stats.means(stats.combined(true, ["model", "size", "seed"]), "mrr_star")
        yield "all true triples left out of the candidates", means, {}
    for runs in variants:
        title, now, later = _line(f"{runs.variant.title} ({runs.title})", runs)
        yield title, now, later if runs.variant.finetuned else {}
    for experiment in results.standalone[1:]:
        if size in experiment.settings.sessions.sizes:
            yield _line(f"{experiment.title}, {size} novel entities", experiment.of_size(size))


def _line(title: str, runs: ModelRuns, column: str = "mrr_star") -> Line:
    now, later = (rows[rows["scope"] == "all"] for rows in (runs.immediate, runs.convergence))
    return title, stats.means(now, column), stats.means(later, "epochs", scale=1)
