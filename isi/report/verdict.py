"""The answer above all sections: what the first graph says of the paper's question, in numbers and one figure."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan

import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi.report import stats
from isi.report.data import Experiment, Results
from isi.report.figures import Figure, single
from isi.report.models import BASELINE, JOINT, isi, label, line_style, of_role
from isi.report.section import Content, Section
from isi.report.stats import CELL, by_direction, improvements
from isi.report.tables import Estimate
from isi.report.variants import by_model

#: The control that knows an entity's kind and nothing else.
_KIND = "kind_mean"


def contents(results: Results) -> Iterator[Content]:
    """The answer of the first graph of its own; nothing where none of ISI, or not Xavier, was run on it."""
    for experiment in results.standalone[:1]:
        given = novel_entity_given(results, experiment)
        methods = [name for name in isi(experiment.initializers) if name in given]
        if BASELINE not in experiment.initializers or not methods or not {BASELINE, JOINT} <= set(given):
            continue
        best = max(methods, key=lambda model: given[model].mean)
        rivals = sorted(of_role(given, "baseline", "own"), key=lambda model: -given[model].mean)
        named = [BASELINE, "iu", _KIND, *methods, *rivals[:1], JOINT]
        yield Content(
            {
                "experiment": experiment, "best": best, "baseline": BASELINE, "joint": JOINT,
                "collapsed": stats.collapsed(experiment.immediate, experiment.ties, len(experiment.entities)),
                "answer": better_than_baseline(experiment), "methods": isi(experiment.initializers),
                "everything": dict.fromkeys((best, BASELINE, JOINT), nan)
                | stats.mrr_star(experiment.immediate, experiment.models).get("all", {}),
                "given": {model: estimate.mean for model, estimate in given.items()},
                "kind": _KIND if _KIND in given else None, "rival": next(iter(rivals), None),
                "epochs": stats.epochs(experiment.convergence, experiment.initializers).get("all", {}),
                "paper_epochs": {name: row["mean"] for name, row in results.paper["convergence"]["epochs"].items()},
            },
            [Figure("verdict", drawn({model: given[model] for model in named if model in given}, experiment.models))],
        )  # fmt: skip


def novel_entity_given(results: Results, experiment: Experiment) -> dict[str, Estimate]:
    """Entity prediction with the novel entity given; of all entity prediction where no query breakdown was run."""
    if experiment.name in results.query_breakdown:
        cells = by_direction(results.query_breakdown[experiment.name].queries, ["model", *CELL[1:]])
        cells = cells[cells["scope"] == "given"]
    else:
        cells = experiment.immediate[experiment.immediate["scope"] == "novel"]
    return by_model(cells, "mrr_star_entity", experiment.models)


def better_than_baseline(experiment: Experiment) -> list[str]:
    """The paper's initializers that gain over Xavier with an interval above zero, over all queries immediately."""
    gains = improvements(experiment.immediate, "all")
    return [name for name in isi(experiment.initializers) if name in gains and gains[name].low > 0]


def drawn(estimates: dict[str, Estimate], models: list[str]) -> Canvas:
    """Means with their intervals, one below the other."""
    canvas, axes = single(width=4.6, height=0.5 + 0.33 * len(estimates))
    for place, (model, estimate) in enumerate(estimates.items()):
        color = line_style(model, models)["color"]
        axes.plot([0, estimate.mean], [place, place], lw=7, solid_capstyle="butt", alpha=0.35, color=color)
        if pd.notna(estimate.low):
            axes.plot([estimate.low, estimate.high], [place, place], lw=1.6, color=color)
        axes.plot(estimate.mean, place, marker="o", ms=5, color=color)
        known = pd.notna(estimate.mean)
        end = max(part for part in (*estimate.parts, 0) if pd.notna(part))
        axes.annotate(f"{estimate.mean:.1f}" if known else "–", (end, place), (6, 0), textcoords="offset points",
                      va="center")  # fmt: skip
    axes.set_yticks(range(len(estimates)), [label(model) for model in estimates])
    axes.set(xlim=(0, None), xlabel="MRR* (points)")
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    return canvas


VERDICT = Section("verdict", contents)
