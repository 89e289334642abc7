"""Right after insertion: the answer above all sections, Figure 3a and gains over Xavier (section 6.1)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import nan
from typing import Any

import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi.report import stats
from isi.report.data import Experiment, Results
from isi.report.figures import by_size, panels
from isi.report.section import Content, of_each_graph
from isi.report.tables import Column, Estimate
from isi.report.words import BASELINE, HALVES, JOINT, SCOPE, SCOPES, colour, in_order, isi, label, of_role

#: The control that knows an entity's kind and nothing else.
_KIND = "kind_mean"
_ALL = ("all", "known", "known_closed", "novel", "novel_heldout")


def verdict(results: Results) -> Iterator[Content]:
    """What the first graph says of the paper's question; nothing where none of ISI, or not Xavier, was run on it."""
    for experiment in results.standalone[:1]:
        given, initializers = novel_entity_given(experiment), experiment.initializers
        methods = [name for name in isi(initializers) if name in given]
        if BASELINE not in initializers or not methods or not {BASELINE, JOINT} <= set(given):
            continue
        best = max(methods, key=lambda model: given[model].mean)
        rivals = sorted(of_role(given, "baseline", "own"), key=lambda model: -given[model].mean)
        named = [BASELINE, "iu", _KIND, *methods, *rivals[:1], JOINT]
        numbers = {
            "experiment": experiment, "best": best, "answer": better_than_baseline(experiment),
            "everything": dict.fromkeys((best, BASELINE, JOINT), nan) | experiment.mrr_star.get("all", {}),
            "given": stats.values(given), "rival": next(iter(rivals), None), "kind": _KIND if _KIND in given else None,
            "epochs": experiment.epochs().get("all", {}),
        }  # fmt: skip
        drawn = _means_and_intervals({model: given[model] for model in named if model in given}, experiment.models)
        yield Content(numbers, figures={"verdict": drawn})


def novel_entity_given(experiment: Experiment) -> Mapping[str, Estimate]:
    """Entity prediction with the novel entity given; of all entity prediction where no query breakdown was run."""
    if experiment.queries is not None:
        return experiment.given_means
    novel = experiment.immediate[experiment.immediate["scope"] == "novel"]
    return stats.by_model(novel, "mrr_star_entity", experiment.models)


def better_than_baseline(experiment: Experiment) -> list[str]:
    """The paper's initializers that gain over Xavier with an interval above zero, over all queries immediately."""
    gains = stats.improvements(experiment.immediate, "all")
    return [name for name in isi(experiment.initializers) if name in gains and gains[name].low > 0]


def _means_and_intervals(estimates: Mapping[str, Estimate], models: list[str]) -> Canvas:
    """One below the other."""
    canvas, (axes,) = panels(1, 1, 0.5 + 0.33 * len(estimates), width=4.6)
    for place, (model, estimate) in enumerate(estimates.items()):
        color = colour(model, models)
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

    def by_scope(by: list[str], scopes: tuple[str, ...] = _ALL) -> pd.DataFrame:
        means = stats.over_seeds(runs[runs["scope"].isin(scopes)], by, HALVES)
        return stats.ordered_rows(means, models, scope=scopes).rename(columns={"scope": SCOPE})

    queries = runs[runs["model"] == initializers[0]].groupby("scope")["queries"].sum()
    numbers = {
        "everything": {JOINT: nan} | experiment.mrr_star.get("all", {}), "gain": stats.values(gains["all"]),
        "known_percent": 100 * float(queries.get("known", 0) / max(queries.get("all", 0), 1)),
        "novel": {half: novel[column].dropna().to_dict() for column, half in HALVES.items()},
    }  # fmt: skip
    columns = {Column(f"scope {scope}", title=SCOPES[scope]): of_models for scope, of_models in gains.items()}
    others = [name for name in initializers if name != BASELINE]
    tables: dict[str, Any] = {
        "immediate": {"model": list(map(label, models)), **stats.halves(runs, models, "all", "novel")},
        "improvement": stats.by_label(others, {**columns, "paper": paper}, "initializer"),
        "novel_by_kind": stats.ordered_rows(of_kinds, initializers, kind=kinds).rename(
            columns={"model": "initializer"}),
        "immediate_by_size": by_scope(["scope", "size", "model"], ("all", "novel")),
        "scopes": by_scope(["scope", "model"]),
        "sessions": by_scope(["session", "scope", "model"]),
    }  # fmt: skip
    return Content(numbers, tables, {"figure3a_immediate": figure})
