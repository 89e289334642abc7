"""The paper's results under every reading of its metric:
which fits, what it leaves, and the figures drawn under it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi import config
from isi.evaluation.readings import ASPECTS, Reading, place_of, readings
from isi.report import readings as fits
from isi.report.data import Results
from isi.report.figures import by_epoch, legend, panels, with_band
from isi.report.readings import CaseRuns, Fit, PaperResult
from isi.report.section import Content
from isi.report.stats import ratios
from isi.report.tables import Column, Estimate
from isi.report.words import BASELINE, JOINT, TEMPLATES, isi, label, line_style

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
    listed = [
        result for result in fits.results_of(results.paper) if result.case in results.readings
    ]
    return Fit.of(listed, results.readings, results.paper["settings"]["repeats"])


def allowed(reading: Reading) -> bool:
    """Whether the paper's words allow a reading."""
    return all(ABOUT["words"][aspect][getattr(reading, aspect)] for aspect in ASPECTS)


def in_words(reading: Reading) -> str:
    """The choices of a reading as a phrase."""
    return ", ".join(ABOUT["titles"][aspect][getattr(reading, aspect)] for aspect in ASPECTS)


def quotes_of(reading: Reading) -> dict[str, str]:
    """What the paper's words say about each choice of a reading."""
    choices = {aspect: getattr(reading, aspect) for aspect in ASPECTS}
    return {
        ABOUT["titles"][aspect][choice]: ABOUT["words"][aspect][choice]
        for aspect, choice in choices.items()
    }


def chosen(results: Results) -> Reading:
    """The nearest reading to the paper's results among those that its words allow."""
    every = readings()
    return next(every[place] for place in fit_of(results).order() if allowed(every[place]))


def title_of(result: PaperResult) -> str:
    """The title of a result with the label of its initializer."""
    *words, name = result.title.split()
    if name == "model":
        return result.title.replace("xavier", label("xavier"))
    return " ".join([*words, label(name)])


def paper_results(results: Results) -> Iterator[Content]:
    """Every result beside its value under the chosen reading, and under this project's."""
    if MAIN not in results.readings:
        return
    fit, reading = fit_of(results), chosen(results)
    place, ours = place_of(reading), place_of(fits.OURS)
    orders = same_orders(fit, place)
    rows, words = list[dict[Any, Any]](), list[str]()
    for row, result in enumerate(fit.results):
        word = "within the interval" if fit.within[row, place] else "not explained"
        if word == "not explained" and orders.get((result.case, result.group)):
            word = "same order"
        words.append(word)
        rows.append(
            {
                "where": result.place,
                "what": title_of(result),
                "paper": result.paper,
                "this reading": fit.estimate(row, place),
                "and the paper": word,
                "this project's reading": fit.estimate(row, ours),
            }
        )
    numbers = {
        "reading": in_words(reading),
        "within": int(fit.within[:, place].sum()),
        "number": len(fit.results),
        "ours": int(fit.within[:, ours].sum()),
        "quotes": quotes_of(reading),
        "outside": [
            title_of(result)
            for result, word in zip(fit.results, words, strict=True)
            if word != "within the interval"
        ],
        "never": [
            title_of(result) for row, result in enumerate(fit.results) if not fit.within[row].any()
        ],
        "drawn": results.readings[MAIN].seeds,
        "most": int(fit.within.sum(0).max()),
        "of_most": in_words(readings()[int(fit.within.sum(0).argmax())]),
    }
    counted = {"one allowed by the paper's words": place, "this project's": ours}
    counts = [
        {"reading": title, "within": int(fit.within[:, which].sum()), "results": len(fit.results)}
        for title, which in counted.items()
    ]
    yield Content(numbers, {"paper_results": rows, "readings_within": counts})


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


def which_reading(results: Results) -> Iterator[Content]:
    """The nearest readings, this project's, the choice on one half of the results shown
    on the other, neighbours.
    """
    if MAIN not in results.readings:
        return
    fit, reading, every = fit_of(results), chosen(results), readings()
    order = fit.order()
    places = list(dict.fromkeys([*order[:BEST], place_of(reading), place_of(fits.OURS)]))
    table = [_reading_row(fit, place, order) for place in places]
    halves = [_half(fit, kept) for kept in (0, 1)]
    near = [_reading_row(fit, place_of(other), order) for other in reading.neighbours]
    near.sort(key=lambda row: int(row["rank"]))
    numbers = {
        "reading": in_words(reading),
        "number": len(every),
        "halves": halves,
        "allowed": sum(map(allowed, every)),
        "far": fits.FAR,
    }
    yield Content(numbers, {"nearest_readings": table, "neighbours_of_the_reading": near})


def _reading_row(fit: Fit, place: int, order: Sequence[int]) -> dict[Any, Any]:
    """A reading as a row: its choices, its mean distance,
    and how many results lie within its intervals.
    """
    reading = readings()[place]
    choices = {
        Column(aspect, words=ABOUT["titles"][aspect]): getattr(reading, aspect)
        for aspect in ASPECTS
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
    rows = np.arange(len(fit.results))
    chosen_on, shown_on = rows[rows % 2 == kept], rows[rows % 2 != kept]
    place = next(place for place in fit.order(chosen_on.tolist()) if allowed(readings()[place]))
    rank = fit.order(shown_on.tolist()).index(place) + 1
    return {
        "reading": in_words(readings()[place]),
        "number": len(shown_on),
        "within": int(fit.within[shown_on, place].sum()),
        "rank": rank,
        "chosen_within": int(fit.within[chosen_on, place].sum()),
        "chosen_on": len(chosen_on),
    }


def gaps(results: Results) -> Iterator[Content]:
    """How much of each gap the reading, the conditions and the graph explain."""
    if MAIN not in results.readings:
        return
    fit, reading = fit_of(results), chosen(results)
    run = {case for case, steps in STEPS.items() if set(steps) <= set(results.readings)}
    rows = [_steps(results, result, reading) for result in fit.results if result.case in run]
    yield Content({"reading": in_words(reading)}, {"steps_to_the_paper": rows})


def _steps(results: Results, result: PaperResult, reading: Reading) -> dict[Any, Any]:
    """A result in this project's run, then with one thing after the other as in the paper."""
    batches, today, theirs = (results.readings[name] for name in STEPS[result.case])
    cells = (
        ("this run", batches, fits.OURS),
        ("the reading", batches, reading),
        ("the conditions", today, reading),
        ("the graph", theirs, reading),
    )
    values = {name: _measured(result, runs, of) for name, runs, of in cells}
    return {"what": title_of(result), **values, "paper": result.paper}


def _measured(result: PaperResult, runs: CaseRuns, reading: Reading) -> float:
    """A result under one reading; NaN for epochs where no size was fine-tuned."""
    places = np.array([place_of(fits.about(reading, result.about))])
    weights = np.full((1, runs.seeds), 1 / runs.seeds)
    return float(result.measured(runs, places, weights)[0, 0])


def on_three_graphs(results: Results) -> Iterator[Content]:
    """MRR* right after insertion of every model under named readings on each graph,
    with intervals.
    """
    cases = {name: results.readings[name] for name in GRAPHS if name in results.readings}
    if not cases:
        return
    tables = {
        f"readings_{name}": [
            {
                "reading": title,
                **{
                    label(model): of_model(runs, model, Reading.of(reading))
                    for model in runs.models
                },
            }
            for title, reading in ABOUT["shown"].items()
        ]
        for name, runs in cases.items()
    }
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


def drawn(results: Results) -> Iterator[Content]:
    """The paper's figures and tables under the chosen reading,
    with this project's as the second form.
    """
    if MAIN not in results.readings:
        return
    reading, cases, tables, figures = (
        chosen(results),
        results.readings,
        dict[str, Any](),
        dict[str, Canvas](),
    )
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
    if "extended" in cases and cases["extended"].case.curves:
        known = {title: fits.about(of, "known") for title, of in pairs.items()}
        figures["figure4_readings"] = _by_epoch(results, cases["extended"], known)
    if "decay" in cases and set(cases["decay"].case.finetuned) & set(cases[MAIN].case.finetuned):
        tables["decay_readings"] = _decay(results, cases, reading)
    numbers = {
        "reading": in_words(reading),
        "both": reading.about == "both",
        "cases": cases,
        "parts": _centre(cases, pairs),
        "figures": list(figures),
    }
    yield Content(numbers, tables, figures)


def _by_indicators(runs: CaseRuns, pairs: Mapping[str, Reading]) -> Canvas:
    """Figure 2: MRR* right after insertion, and epochs to convergence, by number of indicators."""
    size, models = runs.sizes[0], list(runs.case.indicators)
    measures = {"MRR* (points)": runs.mrr_star} | (
        {"epochs": runs.epochs} if size in runs.case.finetuned else {}
    )
    canvas, axes = panels(2 * len(measures), 2, 3.2 * len(measures))
    for panel, ((name, values), title) in zip(axes, product(measures.items(), pairs), strict=True):
        for model in models:
            frames = [
                _rows(values[model, k, size], pairs[title]).assign(k=k) for k in runs.swept(model)
            ]
            with_band(
                panel,
                pd.concat(frames),
                "k",
                "value",
                1,
                0.1,
                marker="o",
                ms=3,
                **line_style(model, models),
            )
        panel.set(title=title, xlabel="number of indicators k", ylabel=name)
    legend(canvas, axes)
    return canvas


def _by_size(runs: CaseRuns, pairs: Mapping[str, Reading]) -> Canvas:
    """Figure 3a: MRR* right after insertion by number of novel entities."""
    canvas, axes = panels(len(pairs))
    for panel, (title, reading) in zip(axes, pairs.items(), strict=True):
        for model in runs.models:
            frames = [
                _rows(runs.mrr_star[model, 0, size], reading).assign(size=size)
                for size in runs.sizes
            ]
            with_band(
                panel, pd.concat(frames), "size", "value", 1, 0.1, **line_style(model, runs.models)
            )
        panel.set(title=title, xlabel="novel entities |ξ|", ylabel="MRR* (points)")
    legend(canvas, axes)
    return canvas


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


def _rows(values: np.ndarray, reading: Reading) -> pd.DataFrame:
    """Values under a reading by seed."""
    return pd.DataFrame({"seed": np.arange(len(values)), "value": values[:, place_of(reading)]})


def _table2(results: Results, runs: CaseRuns, pairs: Mapping[str, Reading]) -> list[dict[Any, Any]]:
    """Table 2: epochs to convergence, mean with its interval and deviation, beside the paper's."""
    paper, rows = results.paper["convergence"]["epochs"], list[dict[Any, Any]]()
    for model in runs.case.initializers:
        sizes = [runs.epochs[model, 0, size] for size in sorted(runs.case.finetuned)]
        row: dict[Any, Any] = {"model": label(model)}
        for title, reading in pairs.items():
            every = np.concatenate([of_size[:, place_of(reading)] for of_size in sizes])
            row[Column("mean", title)] = mean_of(sizes, reading)
            decided = every[np.isfinite(every)]
            row[Column("deviation", title)] = (
                float(np.std(decided, ddof=1)) if len(decided) > 1 else np.nan
            )
        numbers = paper.get(model, {})
        row |= {Column(name, "paper"): numbers.get(name) for name in ("mean", "deviation")}
        rows.append(row)
    return rows


def _transfer(
    results: Results, runs: CaseRuns, pairs: Mapping[str, Reading]
) -> list[dict[Any, Any]]:
    """The transfer's MRR* right after insertion, over all queries and about the new entities,
    beside the paper's.
    """
    paper, rows = results.paper["transfer"], list[dict[Any, Any]]()
    for model in runs.models:
        row: dict[Any, Any] = {"model": label(model)}
        for about, key, queries in (
            ("", "all_queries", "all queries"),
            ("novel", "novel_queries", "new entities"),
        ):
            for title, reading in pairs.items():
                row[Column(title, queries)] = of_model(runs, model, fits.about(reading, about))
            row[Column("paper", queries)] = paper[key].get(model)
        rows.append(row)
    return rows


def _decay(
    results: Results, cases: Mapping[str, CaseRuns], reading: Reading
) -> list[dict[Any, Any]]:
    """Epochs to convergence at the sizes of both cases, with each weight decay of fine-tuning."""
    compared = {name: cases[name] for name in (MAIN, "decay")}
    sizes = sorted(set.intersection(*(set(runs.case.finetuned) for runs in compared.values())))
    paper, rows = results.paper["convergence"]["epochs"], list[dict[Any, Any]]()
    for model in cases["decay"].case.initializers:
        row: dict[Any, Any] = {"model": label(model)}
        for runs in compared.values():
            decay = runs.case.changes.get(
                "finetuning.weight_decay", results.params.finetuning.weight_decay
            )
            row[f"weight decay of {decay:g}"] = mean_of(
                [runs.epochs[model, 0, size] for size in sizes], reading
            )
        rows.append(row | {"paper": paper.get(model, {}).get("mean")})
    return rows


def _centre(
    cases: Mapping[str, CaseRuns], pairs: Mapping[str, Reading]
) -> dict[str, dict[str, float]]:
    """By reading, mean MRR* on the paper's graph of Xavier, ISI and the joint model,
    and what the mean has of it.
    """
    runs = cases[MAIN]
    methods = isi(runs.case.initializers)
    gained = dict[str, dict[str, float]]()
    for title, reading in pairs.items():
        base = of_model(runs, BASELINE, reading).mean
        reached = float(np.mean([of_model(runs, method, reading).mean for method in methods]))
        gained[title] = {"base": base, "isi": reached, "joint": of_model(runs, JOINT, reading).mean}
        if "mean" in runs.case.initializers:
            centre = of_model(runs, "mean", reading).mean
            gained[title] |= {"mean": centre, "share": 100 * (centre - base) / (reached - base)}
    return gained
