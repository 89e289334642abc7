"""From this run to the paper: what each difference between them changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from isi.report import parts, varied
from isi.report.models import BASELINE, JOINT, isi, label
from isi.report.prose import joined, mean
from isi.report.results import Experiment, Results
from isi.report.section import Content, Section, Table
from isi.report.sections.epochs import curves, table2
from isi.report.varied import Varied

#: MRR* over all queries at once, and epochs to convergence, by model.
Line = tuple[str, Mapping[str, float], Mapping[str, float]]


def contents(results: Results) -> Iterator[Content]:
    """One table, where the second pipeline has run and there is something to set against Xavier."""
    found, first = varied.group(results.beyond, "causes"), next(iter(results.own), None)
    if not found or first is None or first.curve_size is None or BASELINE not in first.finetuned:
        return
    methods = isi(first.finetuned)
    if not methods:
        return
    lines = (*of_main(results, first), *of_variants(results, found), *of_others(results))
    frame = pd.DataFrame([*(row(line, methods) for line in lines), stated(results.paper, methods)])
    yield in_words(frame)
    yield Table(
        "causes",
        "From this run to the paper",
        "MRR* (points) over all queries right after insertion and mean epochs to convergence over all queries, of the "
        f"joint model, Xavier and the mean of {joined(map(label, methods))}; at the size of the learning curves but "
        "where another is named. Each row changes one thing of the first, or all that its name says.",
        frame,
    )
    for name, one in found.items():
        if one.how.full_curves:
            yield from followed(results, name, one)


def followed(results: Results, name: str, one: Varied) -> Iterator[Content]:
    """Figure 3b and Table 2 under the conditions of a variant that was followed to the end."""
    margin, most, stated = results.params.convergence.margin, one.most(results.params), results.paper["convergence"]
    for experiment in one.experiments:
        title = f"{one.how.title}, {results.experiments[experiment].title}"
        runs = one.runs[one.runs["experiment"] == experiment]
        figure = curves(runs, one.initializers, one.how.size, margin)
        yield replace(figure, name=f"curves_{name}_{experiment}", title=f"Learning curves: {title}")
        cells = one.convergence(experiment, results.params)
        table = table2(cells, one.initializers, stated["epochs"], margin, most)
        yield replace(table, name=f"convergence_{name}_{experiment}", title=f"Epochs to convergence: {title}")


def of_main(results: Results, first: Experiment) -> Iterator[Line]:
    """The main runs as they are, at their largest size, by their entity half, and with another filter."""
    size, largest = first.curve_size, max(first.how.sessions.sizes)
    yield f"this run, {size} novel entities", at_once(first, size), epochs(first, size)
    share = 100 * largest / len(first.entities)
    if largest != size:
        yield f"{largest} novel entities, {share:.0f} % of all", at_once(first, largest), epochs(first, largest)
    yield "the half that asks for entities alone", at_once(first, size, "mrr_star_entity"), {}
    asked = results.asking.get(first.name)
    if asked is not None:
        rows = asked.queries[(asked.queries["scope"] == "all") & (asked.queries["size"] == size)]
        cells = parts.mrr_star(rows[rows["filter"] == "true"], ["model", "size", "seed"])
        yield "all true triples left out of the candidates", means(cells, "mrr_star"), {}


def of_variants(results: Results, found: Mapping[str, Varied]) -> Iterator[Line]:
    """The variants that were run for this."""
    for one in found.values():
        for experiment in one.experiments:
            cells = one.convergence(experiment, results.params)
            later = means(cells[cells["scope"] == "all"], "epochs", scale=1) if one.how.finetuned else {}
            title = f"{one.how.title} ({results.experiments[experiment].title})"
            yield title, means(one.at_once(experiment, "all"), "mrr_star"), later


def of_others(results: Results) -> Iterator[Line]:
    """The other graphs, as they are."""
    for one in results.own[1:]:
        if one.curve_size:
            yield (
                f"{one.title}, {one.curve_size} novel entities",
                at_once(one, one.curve_size),
                epochs(one, one.curve_size),
            )


def at_once(experiment: Experiment, size: int | None, column: str = "mrr_star") -> dict[str, float]:
    """Each model's mean in scope all at one size, in points."""
    runs = experiment.at_once
    return means(runs[(runs["size"] == size) & (runs["scope"] == "all")], column)


def means(cells: pd.DataFrame, column: str, scale: float = 100) -> dict[str, float]:
    """By model, in points unless another scale is given."""
    return {str(model): scale * float(value) for model, value in cells.groupby("model")[column].mean().items()}


def epochs(experiment: Experiment, size: int | None) -> dict[str, float]:
    """Mean epochs to convergence in scope all at one size."""
    cells = experiment.convergence
    return means(cells[(cells["size"] == size) & (cells["scope"] == "all")], "epochs", scale=1)


def row(line: Line, methods: list[str]) -> dict[str, Any]:
    """A line as a row of the table."""
    what, now, later = line
    own = float(np.mean([now.get(name, np.nan) for name in methods]))
    base = now.get(BASELINE, np.nan)
    return {
        "what": what, "joint": now.get(JOINT, np.nan), label(BASELINE): base, "ISI": own,
        "gain %": 100 * (own / base - 1), f"epochs: {label(BASELINE)}": later.get(BASELINE, np.nan),
        "epochs: ISI": float(np.mean([later.get(name, np.nan) for name in methods])),
    }  # fmt: skip


def stated(paper: Mapping[str, Any], methods: list[str]) -> dict[str, Any]:
    """What the paper says."""
    gains = paper["immediate"]["improvement_over_xavier"]
    later = {name: numbers["mean"] for name, numbers in paper["convergence"]["epochs"].items()}
    return {
        "what": "the paper", "gain %": mean(gains, methods), f"epochs: {label(BASELINE)}": later.get(BASELINE, np.nan),
        "epochs: ISI": mean(later, methods),
    }  # fmt: skip


def in_words(frame: pd.DataFrame) -> str:
    """Where the gain and the epochs of the paper come nearest."""
    ours, paper = frame.iloc[:-1], frame.iloc[-1]
    column = f"epochs: {label(BASELINE)}"
    gain, slow = (ours.sort_values(name, ascending=False).iloc[0] for name in ("gain %", column))
    return (
        f"The paper's ISI gains {paper['gain %']:.0f} % over Xavier, this run's {frame['gain %'].iloc[0]:.0f} %; the "
        f"largest gain in the table is {gain['gain %']:.0f} %, with {gain['what']}. The paper's Xavier takes "
        f"{paper[column]:.1f} epochs to converge, this run's {frame[column].iloc[0]:.1f}, and {slow[column]:.1f} with "
        f"{slow['what']}: how many epochs are needed is a matter of how large a step an epoch is."
    )


SECTION = Section("causes", "Why not the paper's numbers", contents)
