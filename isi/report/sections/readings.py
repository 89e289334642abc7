"""The paper's results under every reading of its metric:
which fits, what it leaves, and the figures drawn under it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from isi import config
from isi.evaluation.readings import Reading, place_of, readings
from isi.report import readings as fits
from isi.report.data import Results
from isi.report.figures import by_epoch, legend, panels, with_band
from isi.report.readings import CaseRuns, Fit, PaperResult
from isi.report.section import Content, Contents, Figures, Tables
from isi.report.stats import Values, by_label, ratios
from isi.report.stats import mean_of as mean_over
from isi.report.tables import Column, Estimate, Rows
from isi.report.words import BASELINE, JOINT, TEMPLATES, isi, labelled, line_style

#: What the paper's words say, and the readings of the table of graphs.
ABOUT = config.read(TEMPLATES / "readings.yaml")
BEST = 10  #: Readings in the table of the best.
MAIN = "published"  #: The case without which there is no page.
#: Cases from this project's run to the paper's, by that of the result: its conditions on today's
#: graph, the paper's conditions there, the paper's graph.
STEPS = {
    "published": ("ai2thor_batches", "ai2thor", "published"),
    "extended": ("transfer_batches", "transfer", "extended"),
}
GRAPHS = ("published", "extended", "ai2thor")


@cache
def fit_of(results: Results) -> Fit:
    """Every result of the paper whose case was run, under every reading."""
    every = fits.results_of(results.paper)
    listed = [result for result in every if result.case in results.readings]
    return Fit.of(listed, results.readings, results.paper["settings"]["repeats"])


def quotes_of(reading: Reading) -> dict[str, str]:
    """What the paper's words say about each choice of a reading."""
    choices = vars(reading).items()
    return {
        ABOUT["titles"][aspect][choice]: ABOUT["words"][aspect][choice]
        for aspect, choice in choices
    }


def allowed(reading: Reading) -> bool:
    """Whether the paper's words allow a reading."""
    return all(quotes_of(reading).values())


def in_words(reading: Reading) -> str:
    """The choices of a reading as a phrase."""
    return ", ".join(quotes_of(reading))


def nearest(fit: Fit, rows: Sequence[int] | slice = slice(None)) -> Reading:
    """The nearest reading to some of the paper's results among those that its words allow."""
    every = (readings()[place] for place in fit.order(rows))
    return next(filter(allowed, every))


def chosen(results: Results) -> Reading:
    """The nearest reading to all results."""
    return nearest(fit_of(results))


def of_the_papers_graph(
    contents: Callable[[Results], Content],
) -> Callable[[Results], Contents]:
    """Decorate a section's function: without the case ``MAIN``, the section has no content."""
    return lambda results: iter([contents(results)] if MAIN in results.readings else [])


@of_the_papers_graph
def paper_results(results: Results) -> Content:
    """Every result beside its value under the chosen reading, and under this project's."""
    fit, reading = fit_of(results), chosen(results)
    place, ours = place_of(reading), place_of(fits.OURS)
    orders = same_orders(fit, place)
    rows = Rows()
    for row, result in enumerate(fit.results):
        word = "not explained"
        if fit.within[row, place]:
            word = "within the interval"
        elif orders.get((result.case, result.group)):
            word = "same order"
        rows.append(
            {
                "where": result.place,
                "what": result.title,
                "paper": result.paper,
                "this reading": fit.estimate(row, place),
                "and the paper": word,
                "this project's reading": fit.estimate(row, ours),
            }
        )
    within = fit.within.sum(0)
    never = np.flatnonzero(~fit.within.any(1))
    numbers = {
        "reading": in_words(reading),
        "within": within[place],
        "number": len(rows),
        "ours": within[ours],
        "quotes": quotes_of(reading),
        "outside": [row["what"] for row in rows if row["and the paper"] != "within the interval"],
        "never": [rows[row]["what"] for row in never],
        "drawn": results.readings[MAIN].seeds,
        "most": within.max(),
        "of_most": in_words(readings()[within.argmax()]),
    }
    counted = {"one allowed by the paper's words": place, "this project's": ours}
    counts = [
        {"reading": title, "within": int(within[which]), "results": len(rows)}
        for title, which in counted.items()
    ]
    return Content(numbers, {"paper_results": rows, "readings_within": counts})


def same_orders(fit: Fit, place: int) -> dict[tuple[str, str], bool]:
    """For each case and group of results, whether the values rank the
    initializers as the paper does.
    """
    groups: dict[tuple[str, str], list[int]] = {}
    for row, result in enumerate(fit.results):
        if result.group:
            groups.setdefault((result.case, result.group), []).append(row)
    return {
        group: bool((np.argsort(fit.paper[rows, 0]) == np.argsort(fit.values[rows, place])).all())
        for group, rows in groups.items()
    }


@of_the_papers_graph
def which_reading(results: Results) -> Content:
    """The nearest readings, this project's, the choice on one half of the results shown
    on the other, neighbours.
    """
    fit, reading, every = fit_of(results), chosen(results), readings()
    order = fit.order()
    places = dict.fromkeys([*order[:BEST], place_of(reading), place_of(fits.OURS)])
    near = [_reading_row(fit, place_of(other), order) for other in reading.neighbours]
    near.sort(key=lambda row: int(row["rank"]))
    numbers = {
        "reading": in_words(reading),
        "number": len(every),
        "halves": [_half(fit, kept) for kept in (0, 1)],
        "allowed": sum(map(allowed, every)),
        "far": fits.FAR,
    }
    table = [_reading_row(fit, place, order) for place in places]
    return Content(numbers, {"nearest_readings": table, "neighbours_of_the_reading": near})


def _reading_row(fit: Fit, place: int, order: Sequence[int]) -> dict[Any, Any]:
    """A reading as a row: its choices, its mean distance,
    and how many results lie within its intervals.
    """
    reading = readings()[place]
    choices = {
        Column(aspect, words=ABOUT["titles"][aspect]): choice
        for aspect, choice in vars(reading).items()
    }
    return {
        "rank": str(1 + order.index(place)),
        **choices,
        "allowed": "yes" if allowed(reading) else "no",
        Column("distance", form="{:.2f}".format): float(fit.distance[:, place].mean()),
        "within": int(fit.within[:, place].sum()),
    }


def _half(fit: Fit, kept: int) -> dict[str, Any]:
    """The nearest allowed reading by every other result,
    and how it does on the results that did not choose it.
    """
    rows = range(len(fit.results))
    chosen_on, shown_on = rows[kept::2], rows[1 - kept :: 2]
    reading = nearest(fit, chosen_on)
    within = fit.within[:, place_of(reading)]
    return {
        "reading": in_words(reading),
        "number": len(shown_on),
        "within": within[shown_on].sum(),
        "rank": fit.order(shown_on).index(place_of(reading)) + 1,
        "chosen_within": within[chosen_on].sum(),
        "chosen_on": len(chosen_on),
    }


@of_the_papers_graph
def gaps(results: Results) -> Content:
    """How much of each gap the reading, the conditions and the graph explain."""
    cases, reading = results.readings, chosen(results)
    rows = Rows()
    for result in fit_of(results).results:
        batches, today, theirs = (cases.get(name) for name in STEPS.get(result.case, [""] * 3))
        if batches and today and theirs:
            rows.append(
                {
                    "what": result.title,
                    "this run": _measured(result, batches, fits.OURS),
                    "the reading": _measured(result, batches, reading),
                    "the conditions": _measured(result, today, reading),
                    "the graph": _measured(result, theirs, reading),
                    "paper": result.paper,
                }
            )
    return Content({"reading": in_words(reading)}, {"steps_to_the_paper": rows})


def _measured(result: PaperResult, runs: CaseRuns, reading: Reading) -> float:
    """A result under one reading; NaN for epochs where no size was fine-tuned."""
    places = np.array([place_of(fits.about(reading, result.about))])
    weights = np.full((1, runs.seeds), 1 / runs.seeds)
    return float(result.measured(runs, places, weights)[0, 0])


def on_three_graphs(results: Results) -> Contents:
    """MRR* right after insertion of every model under named readings on each graph,
    with intervals.
    """
    cases = {name: results.readings[name] for name in GRAPHS if name in results.readings}
    if not cases:
        return
    tables = Tables()
    for name, runs in cases.items():
        tables[f"readings_{name}"] = [
            {"reading": title}
            | labelled({model: of_model(runs, model, Reading.of(reading)) for model in runs.models})
            for title, reading in ABOUT["shown"].items()
        ]
    yield Content({"cases": cases}, tables)


def of_model(runs: CaseRuns, model: str, reading: Reading) -> Estimate:
    """Mean MRR* right after insertion over sizes and seeds, with its interval over seeds."""
    return mean_of([runs.mrr_star[model, 0, size] for size in runs.sizes], reading)


def mean_of(parts: Sequence[np.ndarray], reading: Reading) -> Estimate:
    """The mean over sizes and seeds under a reading, with its interval over seeds;
    ``parts``: (seeds, readings).
    """
    values = np.stack([part[:, place_of(reading)] for part in parts])
    if np.isinf(values).any():  # a run ended before it was decided
        return Estimate(np.nan)
    present = ~np.isnan(values)
    totals, numbers = np.where(present, values, 0.0).sum(0), present.sum(0).astype(float)
    kept = numbers > 0
    return (
        Estimate(*ratios(totals[None, kept], numbers[None, kept])[0].tolist())
        if kept.any()
        else Estimate(np.nan)
    )


@of_the_papers_graph
def drawn(results: Results) -> Content:
    """The paper's figures and tables under the chosen reading,
    with this project's as the second form.
    """
    reading, cases = chosen(results), results.readings
    tables, figures = Tables(), Figures()
    pairs = {"the chosen reading": reading, "this project's": fits.OURS}
    if "sweep" in cases:
        figures["figure2_readings"] = _by_indicators(cases["sweep"], pairs)
    for name in (MAIN, "ai2thor"):
        if name in cases:
            figures[f"figure3a_readings_{name}"] = _by_size(cases[name], pairs)
        if name in cases and cases[name].case.finetuned:
            tables[f"table2_readings_{name}"] = _table2(results, cases[name], pairs)
        if name in cases and cases[name].case.curves:
            figures[f"figure3b_readings_{name}"] = _by_epoch(results, cases[name], pairs)
    if "extended" in cases:
        tables["transfer_readings"] = _transfer(results, cases["extended"], pairs)
        if cases["extended"].case.curves:
            known = {title: fits.about(of, "known") for title, of in pairs.items()}
            figures["figure4_readings"] = _by_epoch(results, cases["extended"], known)
    if "decay" in cases and set(cases["decay"].case.finetuned) & set(cases[MAIN].case.finetuned):
        tables["decay_readings"] = _decay(results, cases, reading)
    numbers = {
        "reading": in_words(reading),
        "both": reading.about == "both",
        "cases": cases,
        "parts": _centre(cases[MAIN], pairs),
        "figures": list(figures),
    }
    return Content(numbers, tables, figures)


def _by_indicators(runs: CaseRuns, pairs: Mapping[str, Reading]) -> Canvas:
    """Figure 2: MRR* right after insertion, and epochs to convergence, by number of indicators."""
    size, swept = runs.sizes[0], runs.case.indicators
    measures = {"MRR* (points)": runs.mrr_star}
    if size in runs.case.finetuned:
        measures["epochs"] = runs.epochs
    canvas, axes = panels(2 * len(measures), 2, 3.2 * len(measures))
    for panel, (measure, title) in zip(axes, product(measures, pairs), strict=True):
        for model, numbers in swept.items():
            values = {k: measures[measure][model, k, size] for k in numbers}
            style = line_style(model, list(swept)) | {"marker": "o", "ms": 3}
            _line(panel, values, pairs[title], style)
        panel.set(title=title, xlabel="number of indicators k", ylabel=measure)
    legend(canvas, axes)
    return canvas


def _by_size(runs: CaseRuns, pairs: Mapping[str, Reading]) -> Canvas:
    """Figure 3a: MRR* right after insertion by number of novel entities."""
    canvas, axes = panels(len(pairs))
    for panel, (title, reading) in zip(axes, pairs.items(), strict=True):
        for model in runs.models:
            values = {size: runs.mrr_star[model, 0, size] for size in runs.sizes}
            _line(panel, values, reading, line_style(model, runs.models))
        panel.set(title=title, xlabel="novel entities |ξ|", ylabel="MRR* (points)")
    legend(canvas, axes)
    return canvas


def _line(
    panel: Axes, values: Mapping[int, np.ndarray], reading: Reading, style: dict[str, Any]
) -> None:
    """Draw values under a reading, (seeds, readings), by their keys, with a band."""
    frames = [
        pd.DataFrame({"x": x, "value": of_seeds[:, place_of(reading)]}).rename_axis("seed")
        for x, of_seeds in values.items()
    ]
    with_band(panel, pd.concat(frames).reset_index(), "x", "value", 1, 0.1, **style)


def _by_epoch(results: Results, runs: CaseRuns, pairs: Mapping[str, Reading]) -> Canvas:
    """Figures 3b and 4: MRR* by epoch of fine-tuning."""
    frames, size = list[pd.DataFrame](), runs.case.curves[0]
    for title, reading in pairs.items():
        place = place_of(reading)
        curves = {
            model: runs.curves[f"{model}.size={size:02d}"][:, :, place]
            for model in runs.case.initializers
        }
        curves[JOINT] = runs.mrr_star[JOINT, 0, size][:, [place]] / 100
        for model, curve in curves.items():
            seeds, epochs = np.indices(curve.shape)
            columns = {
                "seed": seeds.ravel(),
                "epoch": epochs.ravel(),
                "mrr_star": curve.ravel().astype(float),
            }
            frames.append(pd.DataFrame(columns).assign(model=model, scope=title))
    rows = pd.concat(frames)
    rows["mrr_star"] = rows["mrr_star"].mask(rows["mrr_star"] < 0)  # no queries
    return by_epoch(rows, runs.case.initializers, list(pairs), results.params.convergence.margin)


def _table2(results: Results, runs: CaseRuns, pairs: Mapping[str, Reading]) -> dict[Any, Any]:
    """Table 2: epochs to convergence, mean with its interval and deviation, beside the paper's."""
    columns, models = dict[Any, Any](), runs.case.initializers
    epochs = {
        model: [runs.epochs[model, 0, size] for size in sorted(runs.case.finetuned)]
        for model in models
    }
    for title, reading in pairs.items():
        columns[Column("mean", title)] = {
            model: mean_of(sizes, reading) for model, sizes in epochs.items()
        }
        columns[Column("deviation", title)] = {
            model: _deviation(np.concatenate(sizes)[:, place_of(reading)])
            for model, sizes in epochs.items()
        }
    for name in ("mean", "deviation"):
        paper = results.paper["convergence"]["epochs"].items()
        columns[Column(name, "paper")] = {model: numbers[name] for model, numbers in paper}
    return by_label(models, columns)


def _deviation(values: np.ndarray) -> float:
    """The standard deviation of the decided values; NaN of fewer than two."""
    decided = values[np.isfinite(values)]
    return float(np.std(decided, ddof=1)) if len(decided) > 1 else np.nan


def _transfer(results: Results, runs: CaseRuns, pairs: Mapping[str, Reading]) -> dict[Any, Any]:
    """The transfer's MRR* right after insertion, over all queries and about the new entities,
    beside the paper's.
    """
    columns = dict[Any, Any]()
    for about, key, queries in (
        ("", "all_queries", "all queries"),
        ("novel", "novel_queries", "new entities"),
    ):
        for title, reading in pairs.items():
            under = fits.about(reading, about)
            columns[Column(title, queries)] = {
                model: of_model(runs, model, under) for model in runs.models
            }
        columns[Column("paper", queries)] = results.paper["transfer"][key]
    return by_label(runs.models, columns)


def _decay(results: Results, cases: Mapping[str, CaseRuns], reading: Reading) -> dict[Any, Any]:
    """Epochs to convergence at the sizes of both cases, with each weight decay of fine-tuning."""
    models, columns = cases["decay"].case.initializers, dict[str, Any]()
    sizes = sorted({*cases[MAIN].case.finetuned} & {*cases["decay"].case.finetuned})
    for runs in (cases[MAIN], cases["decay"]):
        usual = results.params.finetuning.weight_decay
        decay = runs.case.changes.get("finetuning.weight_decay", usual)
        columns[f"weight decay of {decay:g}"] = {
            model: mean_of([runs.epochs[model, 0, size] for size in sizes], reading)
            for model in models
        }
    paper = results.paper["convergence"]["epochs"].items()
    return by_label(models, columns | {"paper": {name: numbers["mean"] for name, numbers in paper}})


def _centre(runs: CaseRuns, pairs: Mapping[str, Reading]) -> dict[str, Values]:
    """By reading, mean MRR* on the paper's graph of Xavier, ISI and the joint model,
    and what the mean has of it.
    """
    gained = dict[str, Values]()
    for title, reading in pairs.items():
        means = {model: of_model(runs, model, reading).mean for model in runs.models}
        base, reached = means[BASELINE], mean_over(means, isi(means))
        gained[title] = {"base": base, "isi": reached, "joint": means[JOINT]}
        if "mean" in means:
            share = 100 * (means["mean"] - base) / (reached - base)
            gained[title] |= {"mean": means["mean"], "share": share}
    return gained
