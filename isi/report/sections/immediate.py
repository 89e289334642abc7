"""MRR* right after insertion: summary, Figure 3a and gains (section 6.1), parts of the gain, significance."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby, product
from math import nan
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi.report import stats, words
from isi.report.data import Experiment, Results
from isi.report.figures import by_size, legend, panels
from isi.report.section import Content, of_each_graph
from isi.report.stats import LEVEL, Difference, Pair, by_seed, cells_of, compare, difference, pairs_table, signed
from isi.report.tables import Column, Estimate
from isi.report.words import BASELINE, HALVES, JOINT, SCOPE, SCOPES, colour, in_order, isi, joined, label, of_role

#: The control that uses an entity's kind and nothing else.
_KIND = "kind_mean"
_ALL = ("all", "known", "known_closed", "novel", "novel_heldout")
#: Maximum number of pairs without significant difference that a sentence names.
_NAMED = 6
#: Points of MRR* below which a number is shown as 0.0.
ZERO = 0.05
#: Parts of the gain from Xavier on, each with the control that adds it; an initializer of ISI adds the last part.
_STEPS = (("centre", "mean"), ("kind", "kind_mean"))
WHOLE = "all of it"
#: A property, an initializer of ISI, and the control that differs from it in this property alone.
_TWINS = (("words", "es", "es_permuted"), ("words within a kind", "es", "es_permuted_kinds"))


def verdict(results: Results) -> Iterator[Content]:
    """The summary, from the first standalone experiment; nothing unless Xavier and an initializer of ISI were run."""
    for experiment in results.standalone[:1]:
        initializers, runs = experiment.initializers, experiment.immediate
        novel = runs[runs["scope"] == "novel"]  # used without a query breakdown
        given = (stats.by_model(novel, "mrr_star_entity", experiment.models) if experiment.queries is None
                 else experiment.given_means)  # fmt: skip
        methods, gains = [name for name in isi(initializers) if name in given], stats.improvements(runs, "all")
        if BASELINE not in initializers or not methods or not {BASELINE, JOINT} <= set(given):
            continue
        best = max(methods, key=lambda model: given[model].mean)
        others = sorted(of_role(given, "baseline", "own"), key=lambda model: -given[model].mean)
        named = [BASELINE, "iu", _KIND, *methods, *others[:1], JOINT]
        numbers = {
            "experiment": experiment, "best": best,
            "answer": [name for name in isi(initializers) if name in gains and gains[name].low > 0],
            "everything": dict.fromkeys((best, BASELINE, JOINT), nan) | experiment.mrr_star.get("all", {}),
            "given": stats.values(given), "other": next(iter(others), None), "kind": _KIND if _KIND in given else None,
            "epochs": experiment.epochs().get("all", {}),
        }  # fmt: skip
        drawn = _means_and_intervals({model: given[model] for model in named if model in given}, experiment.models)
        yield Content(numbers, figures={"verdict": drawn})


def _means_and_intervals(estimates: Mapping[str, Estimate], models: list[str]) -> Canvas:
    """A row for each model, with its mean and interval."""
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
        return stats.ordered_rows(means, models, scope=scopes)

    queries = runs[runs["model"] == initializers[0]].groupby("scope")["queries"].sum()
    numbers = {
        "everything": {JOINT: nan} | experiment.mrr_star.get("all", {}), "gain": stats.values(gains["all"]),
        "known_percent": 100 * float(queries.get("known", 0) / max(queries.get("all", 0), 1)),
        "novel": {half: novel[column].dropna().to_dict() for column, half in HALVES.items()},
    }  # fmt: skip
    columns = {Column(f"scope {scope}", title=SCOPES[scope]): of_models for scope, of_models in gains.items()}
    others = [name for name in initializers if name != BASELINE]
    tables: dict[str, Any] = {
        "immediate": stats.by_label(models, stats.halves(runs, "all", "novel")),
        "improvement": stats.by_label(others, {**columns, "paper": paper}, "initializer"),
        "novel_by_kind": stats.ordered_rows(of_kinds, initializers, "initializer", kind=kinds),
        "immediate_by_size": by_scope(["scope", "size", "model"], ("all", "novel")),
        "scopes": by_scope(["scope", "model"]),
        "sessions": by_scope(["session", "scope", "model"]),
    }  # fmt: skip
    return Content(numbers, tables, {"figure3a_immediate": figure, "gain_and_cost": gain_and_cost(runs, initializers)})


def gain_and_cost(runs: pd.DataFrame, initializers: Sequence[str]) -> Canvas:
    """MRR* about novel entities against what known triples lose since novel entities are candidates; in points."""
    means = 100 * runs.pivot_table("mrr_star", "model", "scope", observed=True)
    means = means.reindex(columns=["known", "known_closed", "novel"])
    canvas, axes = panels(1, 1, 4.4)
    cost, gain = (means["known_closed"] - means["known"]).to_dict(), means["novel"].to_dict()
    for model in (name for name in initializers if name in gain):
        axes[0].plot(cost[model], gain[model], marker="o", ls="", color=colour(model, initializers), label=label(model))
    axes[0].set(xlabel="loss of MRR*, known entities", ylabel="MRR*, novel entities")
    legend(canvas, axes)
    return canvas


@of_each_graph
def differences(results: Results, experiment: Experiment) -> Content | None:
    """Number of significant pairs, ISI against others, all pairs; None if no graph has two initializers."""
    if all(len(graph.initializers) < 2 for graph in results.standalone):
        return None
    measured = measures(experiment.immediate, experiment.convergence, experiment.initializers)
    pairs = compare(measured, experiment.initializers)
    tables = {"differences_isi": differences_isi(pairs, experiment.initializers), "differences": pairs_table(pairs)}
    return Content({"counts": counts(pairs)}, tables)


def measures(immediate: pd.DataFrame, convergence: pd.DataFrame, models: Sequence[str]) -> dict[str, pd.DataFrame]:
    """Headline measures (points or epochs) by title: rows (session, size, seed), columns models; null: no queries."""
    listed = (
        ("immediate MRR*", 100, immediate, "all", "mrr_star"), ("immediate MRR*", 100, immediate, "novel", "mrr_star"),
        ("immediate entity prediction", 100, immediate, "novel", "mrr_star_entity"),
        ("epochs to convergence", 1, convergence, "all", "epochs"),
        ("epochs to convergence", 1, convergence, "novel_heldout", "epochs"),
    )  # fmt: skip
    return {f"{title}, {SCOPES[scope]}": scale * cells_of(rows, models, scope, column)
            for title, scale, rows, scope, column in listed}  # fmt: skip


def differences_isi(pairs: Sequence[Pair], initializers: Sequence[str]) -> list[dict[str, Any]]:
    """A row for each pair of an initializer of ISI and one outside ISI, a column for each measure."""
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    for pair in sorted(pairs, key=lambda pair: initializers.index(pair.first)):
        if isi([pair.first]) and not isi([pair.second]):
            sign = "" if pair.significant else " n.s."
            text = "none" if np.isnan(pair.difference.p) else f"{pair.difference:+.2f}{sign}"
            row = rows.setdefault((pair.first, pair.second), {"ISI": label(pair.first), "against": label(pair.second)})
            row[pair.measure] = text if pair.difference.seeds else None
    return list(rows.values())


def counts(pairs: Sequence[Pair]) -> list[dict[str, Any]]:
    """For each measure with queries: number of pairs and of significant ones; the others, if few; seeds, if too few."""
    lines = []
    for measure, group in groupby((pair for pair in pairs if pair.difference.seeds), key=lambda pair: pair.measure):
        of_measure = list(group)
        same = [pair for pair in of_measure if not pair.significant]
        differing = max(pair.difference.differing for pair in of_measure)
        smallest_p = 2.0 ** (1 - differing)  # if all n differences have the same sign
        none_can = len(same) == len(of_measure) and len(of_measure) * smallest_p >= LEVEL
        lines.append({
            "measure": measure, "number": len(of_measure), "significant": len(of_measure) - len(same),
            "too_few_seeds": differing if none_can else None,
            "same": same if len(same) <= _NAMED and not none_can else [],
        })  # fmt: skip
    return lines


#: A part of a gain, the model with it, and the model without it.
Step = tuple[str, str, str]
#: The gain of each step, in points.
Gains = dict[Step, Difference]


@of_each_graph
def controls(results: Results, experiment: Experiment) -> Content | None:
    """Parts and shares of the gain, with a description of each control; None if no control was run."""
    names = list(dict.fromkeys(name for graph in results.standalone for name in words.controls(graph.initializers)))
    if not names:
        return None
    immediate, initializers = experiment.immediate, experiment.initializers
    gains, shares = parts(immediate, initializers), shares_of_the_gain(immediate, initializers)
    rows = dict[tuple[str, ...], dict[Any, Any]]()
    for (scope, half), of_steps in gains.items():
        for (part, first, second), points in of_steps.items():
            key = scope, part, label(first), label(second)
            row = rows.setdefault(key, dict(zip((SCOPE, "part", "what has it", "minus"), key, strict=True)))
            row[Column(HALVES[half], form=signed)] = points
    centre = [gains["novel", half].get(("centre", "mean", BASELINE)) for half in HALVES]
    sentences = [(scope, method, [composition(gains[scope, half], method) for half in HALVES])
                 for scope in dict.fromkeys(key[0] for key in rows) for method in isi(initializers)]  # fmt: skip
    numbers = {"names": names, "shares": shares, "centre": [*filter(None, centre)], "sentences": sentences}
    return Content(numbers, {"parts_of_the_gain": rows.values(), "shares_of_the_gain": shares})


def steps(method: str, models: Sequence[str]) -> list[Step]:
    """Steps from Xavier over the controls that were run to ``method``: part, model with it, model without it."""
    path, names, before = [], [], BASELINE
    for name, model in (*_STEPS, ("meaning", method)):
        names.append(name)
        if model in models:
            path.append((joined(names), model, before))
            names, before = [], model
    return path


def parts(immediate: pd.DataFrame, models: Sequence[str]) -> dict[tuple[str, str], Gains]:
    """By scope and half: gains of each step to an initializer of ISI, of its steps together, and of ``_TWINS``."""
    pairs = [step for method in isi(models) for step in steps(method, models)]
    pairs += [(WHOLE, method, BASELINE) for method in isi(models)]
    pairs = [pair for pair in dict.fromkeys([*pairs, *_TWINS]) if {*pair[1:]} <= set(models)]  # Xavier may not be run
    gains = dict[tuple[str, str], Gains]()
    for scope, half in product(("all", "novel"), HALVES):
        cells = 100 * cells_of(immediate, models, scope, half)
        differences = {pair: difference(by_seed(cells[pair[1]], cells[pair[2]])) for pair in pairs}
        gains[scope, half] = {pair: points for pair, points in differences.items() if points.seeds}
    return gains


def shares_of_the_gain(immediate: pd.DataFrame, models: Sequence[str]) -> list[dict[Any, Any]]:
    """Each control's share of each gain of ISI over Xavier (NaN: gain < ``ZERO``), and the rest; [] without Xavier."""
    rows = []
    for scope, half in product(("all", "novel") if BASELINE in models else (), HALVES):
        cells = 100 * cells_of(immediate, models, scope, half)
        for method, control in product(isi(models), words.controls(models)):
            three = cells[[BASELINE, method, control]].dropna()
            gain, other = (by_seed(three[name], three[BASELINE]) for name in (method, control))
            if len(gain):
                share = 100 * stats.ratios(other[None], gain[None])[0] if gain.mean() >= ZERO else [np.nan]
                rows.append({
                    SCOPE: scope, Column("of", words=words.WORDS): HALVES[half], "ISI": label(method),
                    "gain over Xavier": difference(gain), "control": label(control),
                    "control's gain": difference(other), "share %": Estimate(*map(float, share)),
                    "rest": difference(by_seed(three[method], three[control])),
                })  # fmt: skip
    return rows


def composition(gains: Gains, method: str) -> dict[str, Any] | None:
    """A gain over Xavier with its parts, and their per cent if none is negative; None without a gain or parts."""
    whole, models = gains.get((WHOLE, method, BASELINE)), sorted({name for pair in gains for name in pair[1:]})
    made = [(step[0], gains[step]) for step in steps(method, models) if step in gains]
    if not whole or not made:
        return None
    shared = whole.mean >= ZERO and min(points.mean for _, points in made) >= 0
    shares = [(part, points, 100 * points.mean / whole.mean if shared else None) for part, points in made]
    return {"gain": whole.mean, "parts": shares, "last": made[-1][1]}
