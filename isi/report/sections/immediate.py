"""Right after insertion: the answer above all sections, Figure 3a and gains over Xavier (section 6.1)."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan
from typing import Any

import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi.report import stats, words
from isi.report.data import Experiment, Results
from isi.report.figures import Figure, by_size, panels
from isi.report.section import Content, of_each_graph
from isi.report.tables import Column, Estimate, ReportTable
from isi.report.words import BASELINE, HALVES, JOINT, SCOPE, SCOPES, contenders, in_order, isi, label

#: The control that knows an entity's kind and nothing else.
_KIND = "kind_mean"
_ALL = ("all", "known", "known_closed", "novel", "novel_heldout")


def verdict(results: Results) -> Iterator[Content]:
    """What the first graph says of the paper's question; nothing where none of ISI, or not Xavier, was run on it."""
    for experiment in results.standalone[:1]:
        given = novel_entity_given(results, experiment)
        methods = [name for name in isi(experiment.initializers) if name in given]
        if BASELINE not in experiment.initializers or not methods or not {BASELINE, JOINT} <= set(given):
            continue
        best = max(methods, key=lambda model: given[model].mean)
        rivals = sorted(words.of_role(given, "baseline", "own"), key=lambda model: -given[model].mean)
        named = [BASELINE, "iu", _KIND, *methods, *rivals[:1], JOINT]
        drawn = _means_and_intervals({model: given[model] for model in named if model in given}, experiment.models)
        yield Content(
            {
                "experiment": experiment, "best": best, "baseline": BASELINE, "joint": JOINT,
                "collapsed": stats.collapsed(experiment.immediate, experiment.ties, len(experiment.entities)),
                "answer": better_than_baseline(experiment), "methods": isi(experiment.initializers),
                "everything": dict.fromkeys((best, BASELINE, JOINT), nan)
                | stats.mrr_star(experiment.immediate, experiment.models).get("all", {}),
                "given": stats.values(given), "rival": next(iter(rivals), None),
                "kind": _KIND if _KIND in given else None,
                "epochs": stats.epochs(experiment.convergence, experiment.initializers).get("all", {}),
                "paper_epochs": {name: row["mean"] for name, row in results.paper["convergence"]["epochs"].items()},
            },
            [Figure("verdict", drawn)],
        )  # fmt: skip


def novel_entity_given(results: Results, experiment: Experiment) -> dict[str, Estimate]:
    """Entity prediction with the novel entity given; of all entity prediction where no query breakdown was run."""
    queries = experiment.immediate[experiment.immediate["scope"] == "novel"]
    if experiment.name in results.query_breakdown:
        queries = stats.by_direction(results.query_breakdown[experiment.name].queries, ["model", *stats.CELL[1:]])
        queries = queries[queries["scope"] == "given"]
    return stats.by_model(queries, "mrr_star_entity", experiment.models)


def better_than_baseline(experiment: Experiment) -> list[str]:
    """The paper's initializers that gain over Xavier with an interval above zero, over all queries immediately."""
    gains = stats.improvements(experiment.immediate, "all")
    return [name for name in isi(experiment.initializers) if name in gains and gains[name].low > 0]


def _means_and_intervals(estimates: dict[str, Estimate], models: list[str]) -> Canvas:
    """One below the other."""
    canvas, (axes,) = panels(1, 1, 0.5 + 0.33 * len(estimates), width=4.6)
    for place, (model, estimate) in enumerate(estimates.items()):
        color = words.line_style(model, models)["color"]
        axes.plot([0, estimate.mean], [place, place], lw=7, solid_capstyle="butt", alpha=0.35, color=color)
        if pd.notna(estimate.low):
            axes.plot([estimate.low, estimate.high], [place, place], lw=1.6, color=color)
        axes.plot(estimate.mean, place, marker="o", ms=5, color=color)
        end = max(part for part in (*estimate.parts, 0) if pd.notna(part))
        axes.annotate(f"{estimate.mean:.1f}" if pd.notna(estimate.mean) else "–", (end, place), (6, 0),
                      textcoords="offset points", va="center")  # fmt: skip
    axes.set_yticks(range(len(estimates)), [label(model) for model in estimates])
    axes.set(xlim=(0, None), xlabel="MRR* (points)")
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    return canvas


@of_each_graph
def immediate(results: Results, experiment: Experiment) -> Content:
    """Figure 3a, gains over Xavier, and MRR* by size, kind of entity, scope and session."""
    runs, models, initializers = experiment.immediate, experiment.models, experiment.initializers
    paper = results.paper["immediate"]["improvement_over_xavier"]
    gains = {scope: stats.improvements(runs, scope) for scope in ("all", "novel")}
    novel = 100 * runs[runs["scope"] == "novel"].groupby("model")[list(HALVES)].mean()
    queried = experiment.inserted[experiment.inserted["queries"] > 0]
    of_kinds = stats.over_seeds(queried, ["kind", "model"], HALVES)
    of_kinds.insert(0, "inserted", queried.groupby(["kind", "model"]).size())
    kinds = in_order(experiment.entities["kind"].unique(), results.vocabulary["kinds"])
    figure = by_size(runs, models, ("all", "novel"), ("mrr_star", "mrr_star_entity"), len(experiment.entities))
    tables: dict[str, Any] = {
        "immediate": {"model": list(map(label, models)), **stats.halves(runs, models, "all", "novel")},
        "improvement": [
            {"initializer": label(name)}
            | {Column(f"scope {scope}", title=SCOPES[scope]): gains[scope].get(name, nan) for scope in gains}
            | {"paper": paper.get(name)}
            for name in initializers if name != BASELINE
        ],
        "novel_by_kind": stats.ordered_rows(of_kinds, initializers, kind=kinds).rename(
            columns={"model": "initializer"}),
        "immediate_by_size": _by_scope(runs, models, ["scope", "size", "model"], ("all", "novel")),
        "scopes": _by_scope(runs, models, ["scope", "model"], _ALL),
        "sessions": _by_scope(runs, models, ["session", "scope", "model"], _ALL),
    }  # fmt: skip
    queries = runs[runs["model"] == initializers[0]].groupby("scope")["queries"].sum()
    numbers = {
        "experiment": experiment, "tested": contenders(initializers), "methods": isi(initializers), "paper": paper,
        "collapsed": stats.collapsed(runs, experiment.ties, len(experiment.entities)),
        "everything": {JOINT: nan} | stats.mrr_star(runs, models).get("all", {}), "joint": JOINT,
        "gain": stats.values(gains["all"]), "has_baseline": BASELINE in models,
        "known_percent": 100 * float(queries.get("known", 0) / max(queries.get("all", 0), 1)),
        "novel": {half: novel[column].dropna().to_dict() for column, half in HALVES.items()},
        "has_sessions": experiment.settings.sessions.steps > 1,
    }  # fmt: skip
    return Content(numbers, [Figure("figure3a_immediate", figure),
                             *(ReportTable.of(name, rows) for name, rows in tables.items())])  # fmt: skip


def _by_scope(runs: pd.DataFrame, models: list[str], by: list[str], scopes: tuple[str, ...]) -> pd.DataFrame:
    """MRR* in points with its halves, a row for each group."""
    means = stats.over_seeds(runs[runs["scope"].isin(scopes)], by, HALVES)
    return stats.ordered_rows(means, models, scope=scopes).rename(columns={"scope": SCOPE})
