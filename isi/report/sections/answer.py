"""The answer of the report, and what the gain of ISI over Xavier consists of."""

from collections.abc import Mapping
from math import nan
from typing import Any

from isi.evaluation.query_sets import CONVERGING
from isi.report import stats, words
from isi.report.charts import BASE, INK, ISI, MUTE, Bar, waterfall
from isi.report.data import Experiment, ModelRuns, Results
from isi.report.figures import Chart
from isi.report.section import Content, Contents, Numbers, of_each_graph
from isi.report.stats import Difference, Values, by_seed, difference, mean_of, signed
from isi.report.tables import Column, Estimate
from isi.report.words import BASELINE, HALVES, JOINT, SCOPE, Names, isi, joined, label, of_role

#: Points of MRR* below which a number is shown as 0.0.
ZERO = 0.05
#: The parts of the gain from Xavier on, each with the control that has it; an initializer of ISI
#: has the last, too.
_STEPS = (("centre", "mean"), ("kind", "kind_mean"))
SEMANTICS = "words and facts"
WHOLE = "the whole gain"
#: A property, an initializer of ISI, and the control that differs from it in this property alone.
_TWINS = (("words", "es", "es_permuted"), ("words within a kind", "es", "es_permuted_kinds"))
#: What a vector is computed from: the name, the facts, both.
SIDES = {"es": "name", "rs": "facts", "ers": "both"}
#: A part of a gain, the model with it, and the model without it.
Step = tuple[str, str, str]
#: The gain of each step, in points.
Gains = dict[Step, Difference]


def answer(results: Results) -> Contents:
    """The answer from the first standalone experiment;
    nothing unless Xavier and an initializer of ISI were run.
    """
    for experiment in results.standalone[:1]:
        scopes = ("all", "given" if experiment.queries is not None else "novel")
        methods = isi(experiment.initializers)
        means = {scope: _means(experiment, scope) for scope in scopes}
        about_new = means[scopes[1]]
        measured = set(means["all"]) & set(about_new)
        if not {BASELINE, JOINT} <= measured or not {*methods} & measured:
            continue
        best = max((name for name in methods if name in measured), key=lambda name: about_new[name])
        others = sorted(of_role(about_new, "baseline", "own"), key=lambda name: -about_new[name])
        gains = {scope: parts(experiment, scope) for scope in scopes}
        wholes = {name: gains["all"].get((WHOLE, name, BASELINE)) for name in methods}
        # the abstract's gain is that of ES
        first = "es" if "es" in methods else best
        numbers: Numbers = {
            "experiment": experiment,
            "best": best,
            "scopes": scopes,
            "about_new": about_new,
            "methods": methods,
            "better": [name for name, gain in wholes.items() if gain and gain.low > 0],
            "first": first,
            "gain": stats.values(stats.improvements(experiment.immediate, "all")).get(first, nan),
            "paper_gain": results.paper["immediate"]["improvement_over_xavier"].get(first, nan),
            "fewer": {
                scope: mean_of(experiment.fewer_epochs(scope), methods) for scope in CONVERGING
            },
            "paper_fewer": results.paper["convergence"]["fewer_epochs_than_xavier"].get(
                "mean", nan
            ),
            "parts": [composition(gains[scope], best) for scope in scopes],
            "sides": _sides(experiment, scopes[1]),
            "other": None,
        }
        if others:
            changes = {
                scope: _changed(experiment, scope, others[0], best)
                for scope in (scopes[1], "known")
            }
            numbers["other"] = {"name": others[0], "changes": changes}
        marked = (*others[:1], JOINT)
        marks = {
            scope: {name: means[scope][name] for name in marked if name in means[scope]}
            for scope in scopes
        }
        yield Content(numbers, figures={"answer": _drawn(experiment, gains, [best], marks)})


def _changed(experiment: ModelRuns, scope: str, first: str, second: str) -> Difference:
    """The immediate MRR* (points) of ``first`` minus that of ``second``."""
    cells = experiment.by_grid_point(scope)
    return difference(by_seed(cells[first], cells[second]))


def _sides(experiment: ModelRuns, scope: str) -> Difference | None:
    """MRR* (points) from the name alone (ES) minus that from the facts alone (RS);
    None unless ERS, which has both, was run, too.
    """
    if not set(SIDES) <= set(experiment.initializers):
        return None
    changed = _changed(experiment, scope, "es", "rs")
    return changed if changed.seeds else None


def _means(experiment: ModelRuns, scope: str) -> Values:
    """Mean MRR* (points) right after insertion, by model that has queries."""
    means = experiment.by_grid_point(scope).mean().dropna()
    return {str(name): float(mean) for name, mean in means.items()}


@of_each_graph
def controls(results: Results, experiment: Experiment) -> Content | None:
    """What the gain consists of, with a description of each control; None if no control was run."""
    ran = dict.fromkeys(name for graph in results.standalone for name in graph.initializers)
    names, methods = words.controls(ran), isi(experiment.initializers)
    if not names or BASELINE not in experiment.initializers or not methods:
        return None
    measures = [(scope, half) for scope in ("all", "novel") for half in HALVES]
    last = "novel"
    if experiment.queries is not None:
        measures.append(("given", "mrr_star_entity"))
        last = "given"
    gains = {of: parts(experiment, *of) for of in measures}
    rows = dict[tuple[str, ...], dict[Any, Any]]()
    for (scope, half), of_steps in gains.items():
        for (part, first, second), points in of_steps.items():
            key = scope, part, label(first), label(second)
            named = dict(zip((SCOPE, "part", "what has it", "minus"), key, strict=True))
            rows.setdefault(key, named)[Column(HALVES[half], form=signed)] = points
    half = "mrr_star_entity" if last == "given" else "mrr_star"
    shown = {"all": gains["all", "mrr_star"], last: gains[last, half]}
    means = _means(experiment, last)
    best = max(methods, key=lambda name: means.get(name, -1))
    numbers: Numbers = {
        "names": names,
        "best": best,
        "parts": {scope: composition(of_scope, best) for scope, of_scope in shown.items()},
        "permuted": None,
    }
    if _TWINS[0] in shown[last] and (WHOLE, "es", BASELINE) in shown[last]:
        numbers["permuted"] = {
            "scope": last,
            "points": shown[last][_TWINS[0]].mean,
            "gain": shown[last][WHOLE, "es", BASELINE].mean,
        }
    drawn = _drawn(experiment, shown, methods, {})
    return Content(numbers, {"parts_of_the_gain": rows.values()}, {"parts_of_the_gain": drawn})


def steps(method: str, models: Names) -> list[Step]:
    """Steps from Xavier over the controls that were run to ``method``:
    part, model with it, model without it.
    """
    path, names, before = [], [], BASELINE
    for name, model in (*_STEPS, (SEMANTICS, method)):
        names.append(name)
        if model in models:
            path.append((joined(names), model, before))
            names, before = [], model
    return path


def parts(experiment: ModelRuns, scope: str, half: str = "mrr_star") -> Gains:
    """Gains (points) of each step to an initializer of ISI, of its steps together,
    and of ``_TWINS``.
    """
    cells, models = experiment.by_grid_point(scope, half), experiment.initializers
    pairs = [step for method in isi(models) for step in steps(method, models)]
    pairs += [(WHOLE, method, BASELINE) for method in isi(models)]
    # Xavier may not be run
    pairs = [pair for pair in dict.fromkeys([*pairs, *_TWINS]) if {*pair[1:]} <= set(models)]
    differences = {pair: difference(by_seed(cells[pair[1]], cells[pair[2]])) for pair in pairs}
    return {pair: points for pair, points in differences.items() if points.seeds}


def composition(gains: Gains, method: str) -> dict[str, Any] | None:
    """A gain over Xavier with its parts; ``share``: per cent of the last part if none is negative;
    None without one.
    """
    whole = gains.get((WHOLE, method, BASELINE))
    models = sorted({name for pair in gains for name in pair[1:]})
    made = [(step[0], gains[step]) for step in steps(method, models) if step in gains]
    if not whole or len(made) < 2:
        return None
    shared = whole.mean >= ZERO and min(points.mean for _, points in made) >= 0
    return {
        "gain": whole.mean,
        "parts": [(part, points.mean) for part, points in made],
        "last": made[-1][1],
        "share": 100 * made[-1][1].mean / whole.mean if shared else None,
    }


def _drawn(
    experiment: Experiment,
    gains: Mapping[str, Gains],
    methods: Names,
    marks: Mapping[str, Values],
) -> Chart:
    """For each query set Xavier's MRR*, then the parts of each method's gain;
    ``marks``: further models.
    """
    groups = dict[str, list[Bar]]()
    for scope, of_scope in gains.items():
        means = experiment.given_means if scope == "given" else experiment.immediate_means(scope)
        now = _means(experiment, scope)
        if BASELINE not in now:
            continue
        bars = {
            (BASELINE, ""): Bar(label(BASELINE), 0, now[BASELINE], f"{now[BASELINE]:.1f}", BASE)
        }
        for name in (name for name in methods if name in now):
            bars |= _bars(name, of_scope, now, means.get(name), len(methods) > 1)
        shown = dict(marks.get(scope, {}))
        if len(methods) == 1:
            shown = {name: now[name] for name in methods if name in now} | shown
        others = [
            Bar(
                label(name),
                value,
                value,
                f"{value:.1f}",
                ISI if isi([name]) else INK if name == JOINT else MUTE,
                mark=True,
            )
            for name, value in shown.items()
        ]
        groups[words.SCOPES[scope]] = [*bars.values(), *others]
    return waterfall(groups, only_narrow=len(methods) == 1)


def _bars(
    method: str, gains: Gains, now: Values, mean: Estimate | None, several: bool
) -> dict[tuple[str, str], Bar]:
    """The parts of a method's gain, by model and part: equal ones of several methods are one."""
    made, bars, end = composition(gains, method), dict[tuple[str, str], Bar](), now[BASELINE]
    listed = made["parts"] if made else [("", now[method] - end)]
    for number, (part, points) in enumerate(listed):
        last = number == len(listed) - 1
        name = ", ".join(filter(None, [label(method), part])) if several and last else part
        name = name or label(method)
        text = f"{points:+.1f}".replace("-", "\N{MINUS SIGN}")
        key = (method if last else "", part)
        color = ISI if last else MUTE
        bars[key] = Bar(name, end, end + points, text, color, mean if last else None)
        end += points
    return bars
