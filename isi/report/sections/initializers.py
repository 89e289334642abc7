"""Initializers beyond the paper's, fewer insert triples, and other words: variants right after insertion."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import numpy as np
import pandas as pd

from isi.report.data import Results
from isi.report.figures import Figure, by_row, legend, panels
from isi.report.models import JOINT, isi, label
from isi.report.section import Content
from isi.report.sections.gain import ZERO
from isi.report.sections.graphs import of_models, rows_of
from isi.report.significance import by_seed, difference
from isi.report.tables import Table
from isi.report.variants import VariantRuns, of_group

#: The others are compared with it, by seed.
REFERENCE = "ers"


def stronger(results: Results) -> Iterator[Content]:
    """Initializers that the paper does not have: a table for each graph."""
    for runs in of_group(results.variants, "baselines").values():
        given = {name: {model: estimate.mean for model, estimate in runs.given_means(name).items()}
                 for name in runs.experiments}  # fmt: skip
        best = {name: max((means[method] for method in isi(runs.initializers)), default=inf)
                for name, means in given.items()}  # fmt: skip
        above = {name: dict(sorted(((model, means[model]) for model in runs.initializers if means[model] > best[name]),
                                   key=lambda item: -item[1])) for name, means in given.items()}  # fmt: skip
        numbers = {
            "rivals": [name for name in runs.initializers if name not in results.params.initializers],
            "size": runs.variant.size, "titles": results.titles, "given": given, "best": best, "above": above,
            "reference": REFERENCE, "joint": JOINT,
        }  # fmt: skip
        yield Content(numbers, [strong_table(runs, experiment) for experiment in runs.experiments])


def strong_table(runs: VariantRuns, experiment: str) -> Table:
    """A row for each model, the best with the novel entity given first."""
    every, novel = (runs.immediate_means(experiment, scope) for scope in ("all", "novel"))
    given = runs.given_means(experiment)
    cells = runs.given_in(experiment).pivot_table("mrr_star_entity", ["seed", "size"], "model")
    reference = 100 * cells[REFERENCE] if REFERENCE in cells else pd.Series(np.nan, cells.index)
    rows = [
        {"model": label(model), "all": every.get(model), "novel": novel.get(model), "novel entity given": given[model],
         f"novel entity given, minus {label(REFERENCE)}": difference(by_seed(100 * cells[model], reference))}
        for model in sorted(runs.models, key=lambda model: -given[model].mean)
    ]  # fmt: skip
    return Table.of(f"strong_{experiment}", rows)


def n_insert_triples(results: Results) -> Iterator[Content]:
    """By the number of insert triples: a figure, and its numbers."""
    found = of_group(results.variants, "insert_triples")
    if not found:
        return
    first = next(iter(found.values()))
    experiment, models = first.experiments[0], first.models
    rows = [runs for runs in found.values() if experiment in runs.experiments]
    numbers = [
        "all" if runs.variant.max_insert_triples is None else str(runs.variant.max_insert_triples) for runs in rows
    ]
    of_rows = [runs.given_means(experiment) for runs in rows]
    given = pd.DataFrame(of_rows)
    means = given.map(lambda estimate: estimate.mean)
    lowest = {name: int(means[name].to_numpy().argmin()) for name in first.initializers}
    canvas, (axes,) = panels(1, columns=1)
    by_row(axes, given, models, numbers)
    axes.set_xlabel("insert triples of each novel entity, at most")
    legend(canvas, [axes])
    yield Content(
        {
            "size": first.variant.size, "initializers": first.initializers, "fewest": means.iloc[0].to_dict(),
            "most": means.iloc[-1].to_dict(), "numbers": numbers, "joint": JOINT,
            "worse": [(name, means[name].iloc[place], numbers[place]) for name, place in lowest.items()
                      if means[name].iloc[0] - means[name].iloc[place] >= ZERO],
        },
        [Figure("n_insert_triples", canvas),
         Table.of("n_insert_triples", [{"insert triples": number, **of_models(row)}
                                       for number, row in zip(numbers, of_rows, strict=True)])],
    )  # fmt: skip


def other_words(results: Results) -> Iterator[Content]:
    """A row for each kind of word vectors and each graph."""
    if found := of_group(results.variants, "words"):
        rows = rows_of(results, found, VariantRuns.given_means, "words")
        yield Content(shown=[Table.of("other_words", rows)])
