"""Is a difference a difference? Initializers in pairs: an interval over seeds, and a test."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np
import pandas as pd

from isi.report import wording
from isi.report.models import isi, label
from isi.report.paired import LEVEL, Pair, compare, smallest_p
from isi.report.prose import capitalized
from isi.report.results import Experiment, Results
from isi.report.section import Bullets, Content, Section, Table, by_experiment
from isi.report.statistics import HIGH, LOW

DIFFERENCE = "difference"
#: How many pairs that are not told apart a sentence names.
_NAMED = 6


def contents(results: Results) -> Iterator[Content]:
    """How it is told, then the same of every graph with anything to compare."""
    if any(len(one.initializers) > 1 for one in results.own):
        yield (
            "Runs are paired by size and seed: all initializers meet the same novel entities, batches and negatives. "
            "Sizes of one seed share their splits, so they are averaged first. Intervals, here and in brackets all "
            "over this page, are 95 % bootstrap intervals over seeds (percentiles). The test is exact: p is the share "
            "of all ways to flip the signs of the seeds' differences that make a mean at least as far from zero. Told "
            f"apart means a Holm-corrected p below {LEVEL:g}. Seeds split one graph again and again and draw other "
            "novel entities from it, so intervals and tests speak of this graph, and of no other."
        )
        yield from by_experiment(results, of_experiment)


def of_experiment(_results: Results, experiment: Experiment) -> Iterator[Content]:
    """Pairs in words, ISI against the others, every pair."""
    found = measures(experiment.at_once, experiment.convergence, experiment.initializers)
    pairs = compare(found, experiment.initializers)
    yield f"{experiment.how.sessions.seeds} seeds are compared."
    yield Bullets(sentences(pairs))
    yield differences_isi(pairs, list(found), experiment.initializers)
    yield differences(pairs)


def measures(at_once: pd.DataFrame, convergence: pd.DataFrame, initializers: Sequence[str]) -> dict[str, pd.DataFrame]:
    """The headline measures by cell and initializer: MRR* in points, epochs; null without queries."""
    found = {}
    for scope in ("all", "novel"):
        found[f"immediate MRR*, scope {scope}"] = 100 * cells_of(at_once, initializers, scope, "mrr_star")
    found["immediate entity half, scope novel"] = 100 * cells_of(at_once, initializers, "novel", "mrr_star_entity")
    for scope in ("all", "novel_heldout"):
        found[f"epochs to convergence, scope {scope}"] = cells_of(convergence, initializers, scope, "epochs")
    return found


def differences(pairs: Sequence[Pair]) -> Table:
    """Every pair by every measure."""
    return every_pair(
        "differences",
        "Every pair of initializers",
        "First less second: differences of means per seed over sizes (MRR* in points; fewer epochs are better), over "
        "the cells that have queries.",
        pairs,
    )


def every_pair(name: str, title: str, caption: str, pairs: Sequence[Pair]) -> Table:
    """Pairs with their intervals and tests."""
    columns = ["measure", "first", "second", DIFFERENCE, DIFFERENCE + LOW, DIFFERENCE + HIGH, "p", "p (Holm)",
               "seeds", "of these differ"]  # fmt: skip
    rows = [
        (one.measure, label(one.first), label(one.second), one.mean, one.low, one.high,
         _kept(one.p, one.seeds), _kept(one.holm, one.seeds), one.seeds, one.differing)
        for one in pairs
    ]  # fmt: skip
    return Table(
        name,
        title,
        f"{caption} Mean and interval over seeds, the p of the exact sign-flip test, as it is and corrected after Holm "
        "within a measure, and how many seeds differ at all: with n of them no p is below 2 to the power of 1 − n. "
        "None: no seed differs.",
        pd.DataFrame(rows, columns=columns),
        {DIFFERENCE: signed} | dict.fromkeys(("p", "p (Holm)"), _p),
        folded=True,
        of_any_size=("p", "p (Holm)"),
    )


def differences_isi(pairs: Sequence[Pair], measures: Sequence[str], initializers: Sequence[str]) -> Table:
    """ISI's initializers against every other, a column a measure."""
    methods = isi(initializers)
    texts: dict[tuple[str, str], dict[str, str | None]] = {}
    for one in pairs:
        if one.first in methods and one.second not in methods:
            texts.setdefault((one.first, one.second), {})[one.measure] = _text(one)
    order = sorted(texts, key=lambda pair: initializers.index(pair[0]))
    rows = [{"ISI": label(first), "against": label(second), **texts[first, second]} for first, second in order]
    return Table(
        "differences_isi",
        "ISI against the others",
        "First less second, means per seed over sizes (MRR* in points; fewer epochs are better), with the interval "
        f"over seeds; n.s.: Holm-corrected p of {LEVEL:g} or more; none: no seed differs.",
        pd.DataFrame(rows, columns=["ISI", "against", *measures]),
    )


def sentences(pairs: Sequence[Pair]) -> list[str]:
    """For each measure that was asked, how many pairs are told apart, and which are not where they are few."""
    said = []
    for measure, group in groupby((one for one in pairs if one.seeds), key=lambda one: one.measure):
        own = list(group)
        same = [f"{label(one.first)} and {label(one.second)}" for one in own if not one.told_apart]
        text = f"{wording.spoken(measure)}: {len(own) - len(same)} of {len(own)} pairs are told apart"
        differing = max(one.differing for one in own)
        if len(same) == len(own) and len(own) * smallest_p(differing) >= LEVEL:
            text += f" (with at most {differing} seeds that differ none can be)"
        elif 0 < len(same) <= _NAMED:
            text += f", not so {'; '.join(same)}"
        said.append(f"{capitalized(text)}.")
    return said


def cells_of(rows: pd.DataFrame, models: Sequence[str], scope: str, column: str) -> pd.DataFrame:
    """A column of runs in one scope: a row for each cell, a column for each model."""
    shown = rows[rows["scope"] == scope]
    cell = ["session", "size", "seed"]
    return shown.pivot(index=cell, columns="model", values=column).reindex(columns=list(models))


def _kept(p: float, seeds: int) -> float | str:
    """A p; "none" where no seed differs, null where there is no seed."""
    return "none" if np.isnan(p) and seeds else p


def _text(one: Pair) -> str | None:
    if not one.seeds:
        return None
    return "none" if np.isnan(one.p) else f"{one}{'' if one.told_apart else ' n.s.'}"


def signed(value: float) -> str:
    """A difference, as people read it."""
    return f"{value:+.2f}"


def _p(value: float) -> str:
    return f"{value:.3f}" if value >= 0.001 else "< 0.001"


SECTION = Section("differences", "Is a difference a difference?", contents)
