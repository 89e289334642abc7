"""Is a difference a difference? Initializers in pairs: an interval over seeds, and a test."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, groupby

import numpy as np
import pandas as pd
from scipy import stats

from isi.base.streams import stream
from isi.report.models import isi, label
from isi.report.prose import capitalized
from isi.report.results import Experiment, Results
from isi.report.section import Bullets, Content, Section, Table, by_experiment

LEVEL = 0.05
#: How many pairs that are not told apart a sentence names.
_NAMED = 6
_RESAMPLES = 9_999


@dataclass(frozen=True)
class Difference:
    """How far two initializers are apart, over seeds."""

    mean: float
    #: 95 % interval of the mean; null for fewer than two seeds
    low: float
    high: float
    #: null where no seed differs
    p: float
    seeds: int


@dataclass(frozen=True)
class Pair(Difference):
    """The difference of two initializers, first less second, by one measure."""

    measure: str
    first: str
    second: str
    #: p corrected within the measure
    holm: float


def contents(results: Results) -> Iterator[Content]:
    """How it is told, then the same of every graph with anything to compare."""
    if any(len(one.initializers) > 1 for one in results.own):
        yield (
            "Runs are paired by size and seed: all initializers meet the same novel entities, batches and negatives. "
            "Sizes of one seed share their splits, so they are averaged first. Told apart means "
            f"a Holm-corrected p below {LEVEL:g}."
        )
        yield from by_experiment(results, of_experiment)


def of_experiment(results: Results, experiment: Experiment) -> Iterator[Content]:
    """Pairs in words, ISI against the others, every pair."""
    found = measures(experiment.at_once, experiment.convergence, experiment.initializers)
    pairs = compare(found, experiment.initializers, results.params.seed)
    yield f"{experiment.how.sessions.seeds} seeds are compared."
    yield Bullets(sentences(pairs))
    yield differences_isi(pairs, list(found), experiment.initializers)
    yield differences(pairs)


def compare(measured: Mapping[str, pd.DataFrame], initializers: Sequence[str], root: int) -> list[Pair]:
    """Every pair of initializers by every measure.

    A pair of one of ISI and another has ISI first; otherwise the order is that of the params.

    Args:
        measured: by name (see ``measures``).
        root: of the random streams.
    """
    found, methods = [], isi(initializers)
    for measure, cells in measured.items():
        names = [sorted(pair, key=lambda name: name not in methods) for pair in combinations(initializers, 2)]
        apart = [difference(by_seed(cells[first], cells[second]), root) for first, second in names]
        corrected = holm(np.array([one.p for one in apart])).tolist()
        found += [Pair(**vars(one), measure=measure, first=pair[0], second=pair[1], holm=p)
                  for one, pair, p in zip(apart, names, corrected, strict=True)]  # fmt: skip
    return found


def measures(at_once: pd.DataFrame, convergence: pd.DataFrame, initializers: Sequence[str]) -> dict[str, pd.DataFrame]:
    """The headline measures by cell and initializer: MRR* in points, epochs; null without queries."""
    found = {}
    for scope in ("all", "novel"):
        found[f"immediate MRR*, scope {scope}"] = 100 * _cells(at_once, initializers, scope, "mrr_star")
    for scope in ("all", "novel_heldout"):
        found[f"epochs to convergence, scope {scope}"] = _cells(convergence, initializers, scope, "epochs")
    return found


def by_seed(first: pd.Series, second: pd.Series) -> np.ndarray:
    """First less second over the cells that both have, averaged over sizes; shape: (seeds,).

    Rounded to the ninth decimal, so that the order of a sum makes no difference and breaks no tie.
    """
    means: pd.Series = (first - second).dropna().groupby("seed").mean()
    return means.to_numpy(float).round(9) + 0.0  # no -0


def difference(values: np.ndarray, root: int) -> Difference:
    """Of differences by seed: mean, percentile bootstrap interval, and Wilcoxon signed-rank p.

    The percentile method stays defined where differences are nearly constant; BCa does not. All
    pairs resample the same seeds. Seeds without a difference take no part in the ranks.
    """
    if not len(values):
        return Difference(np.nan, np.nan, np.nan, np.nan, 0)
    low = high = np.nan
    if len(values) > 1:
        drawn = stats.bootstrap(
            (values,), np.mean, n_resamples=_RESAMPLES, method="percentile", rng=stream(root, "differences")
        )
        low, high = drawn.confidence_interval
    p = float(stats.wilcoxon(values).pvalue) if values.any() else np.nan
    return Difference(float(values.mean()), float(low), float(high), p, len(values))


def holm(p: np.ndarray) -> np.ndarray:
    """Holm's step-down correction: the i-th smallest of m times (m − i + 1), never falling, at most 1.

    Null, where there is nothing to test, counts as a p of 1 among the m and stays null.
    """
    known = np.nan_to_num(p, nan=1.0)
    order = known.argsort(kind="stable")
    corrected = np.empty(len(p))
    corrected[order] = np.maximum.accumulate(known[order] * np.arange(len(p), 0, -1)).clip(max=1)
    return np.where(np.isnan(p), np.nan, corrected)


def smallest_p(seeds: int) -> float:
    """Of the signed-rank test: where all differences have one sign, of 2ⁿ that are as likely."""
    return 2.0 ** (1 - seeds)


def differences(pairs: Sequence[Pair]) -> Table:
    """Every pair by every measure."""
    columns = ["measure", "first", "second", "difference", "95 % from", "to", "p", "p (Holm)", "seeds"]
    rows = [
        (one.measure, label(one.first), label(one.second), one.mean, one.low, one.high,
         _kept(one.p, one.seeds), _kept(one.holm, one.seeds), one.seeds)
        for one in pairs
    ]  # fmt: skip
    return Table(
        "differences",
        "Every pair of initializers",
        "First less second: differences of means per seed over sizes (MRR* in points; fewer epochs are better), over "
        "the cells that have queries; their mean, its bootstrap 95 % interval over seeds (percentiles), and the p of "
        "Wilcoxon's signed-rank test, as it is and corrected after Holm within a measure. None: no seed differs.",
        pd.DataFrame(rows, columns=columns),
        dict.fromkeys(("difference", "95 % from", "to"), _signed) | dict.fromkeys(("p", "p (Holm)"), _p),
        folded=True,
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
        "First less second, means per seed over sizes (MRR* in points; fewer epochs are better), with the bootstrap "
        f"95 % interval over seeds; n.s.: Holm-corrected p of {LEVEL:g} or more; none: no seed differs.",
        pd.DataFrame(rows, columns=["ISI", "against", *measures]),
    )


def sentences(pairs: Sequence[Pair]) -> list[str]:
    """For each measure that was asked, how many pairs are told apart, and which are not where they are few."""
    said = []
    for measure, group in groupby((one for one in pairs if one.seeds), key=lambda one: one.measure):
        own = list(group)
        same = [f"{label(one.first)} and {label(one.second)}" for one in own if not one.holm < LEVEL]
        text = f"{measure}: {len(own) - len(same)} of {len(own)} pairs are told apart"
        seeds = max(one.seeds for one in own)
        if len(same) == len(own) and len(own) * smallest_p(seeds) >= LEVEL:
            text += f" (with {seeds} seeds none can be)"
        elif 0 < len(same) <= _NAMED:
            text += f", not so {'; '.join(same)}"
        said.append(f"{capitalized(text)}.")
    return said


def _cells(rows: pd.DataFrame, initializers: Sequence[str], scope: str, column: str) -> pd.DataFrame:
    shown = rows[rows["scope"] == scope]
    cell = ["session", "size", "seed"]
    return shown.pivot(index=cell, columns="model", values=column).reindex(columns=list(initializers))


def _kept(p: float, seeds: int) -> float | str:
    """A p to six figures; "none" where no seed differs, null where there is no seed."""
    return "none" if np.isnan(p) and seeds else float(f"{p:.6g}")


def _text(one: Pair) -> str | None:
    if not one.seeds:
        return None
    if np.isnan(one.p):
        return "none"
    interval = "" if np.isnan(one.low) else f" [{_signed(one.low)}, {_signed(one.high)}]"
    return f"{_signed(one.mean)}{interval}{'' if one.holm < LEVEL else ' n.s.'}"


def _signed(value: float) -> str:
    return f"{value:+.2f}"


def _p(value: float) -> str:
    return f"{value:.3f}" if value >= 0.001 else "< 0.001"


SECTION = Section("differences", "Is a difference a difference?", contents)
