"""Whether a difference is significant: initializers in pairs, with an interval over seeds and a test."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

import numpy as np
import pandas as pd

from isi.report.data import Experiment, Results
from isi.report.models import isi, label
from isi.report.section import Content, of_each
from isi.report.significance import LEVEL, Pair, compare, pairs_table, smallest_p
from isi.report.stats import cells_of
from isi.report.tables import Table
from isi.report.words import SCOPES

#: How many pairs that do not differ significantly a sentence names.
_NAMED = 6


def differences(results: Results) -> Iterator[Content]:
    """The same of every graph, where there is anything to compare."""
    if any(len(one.initializers) > 1 for one in results.standalone):
        yield from of_each(results.standalone, of_experiment)


def of_experiment(experiment: Experiment) -> Content:
    """Pairs that differ, ISI against the others, every pair."""
    found = measures(experiment.immediate, experiment.convergence, experiment.initializers)
    pairs = compare(found, experiment.initializers)
    numbers = {"seeds": experiment.settings.sessions.seeds, "level": LEVEL, "counts": counts(pairs)}
    shown = [differences_isi(pairs, list(found), experiment.initializers), pairs_table("differences", pairs)]
    return Content(numbers, shown)


def measures(
    immediate: pd.DataFrame, convergence: pd.DataFrame, initializers: Sequence[str]
) -> dict[str, pd.DataFrame]:
    """The headline measures by cell and initializer: MRR* in points, epochs; null without queries."""
    found = {}
    for scope in ("all", "novel"):
        found[f"immediate MRR*, {SCOPES[scope]}"] = 100 * cells_of(immediate, initializers, scope, "mrr_star")
    found[f"immediate entity prediction, {SCOPES['novel']}"] = 100 * cells_of(
        immediate, initializers, "novel", "mrr_star_entity"
    )
    for scope in ("all", "novel_heldout"):
        found[f"epochs to convergence, {SCOPES[scope]}"] = cells_of(convergence, initializers, scope, "epochs")
    return found


def differences_isi(pairs: Sequence[Pair], measures: Sequence[str], initializers: Sequence[str]) -> Table:
    """ISI's initializers against every other, a column a measure."""
    methods = isi(initializers)
    texts: dict[tuple[str, str], dict[str, str | None]] = {}
    for pair in pairs:
        if pair.first in methods and pair.second not in methods:
            texts.setdefault((pair.first, pair.second), dict.fromkeys(measures))[pair.measure] = _text(pair)
    order = sorted(texts, key=lambda names: initializers.index(names[0]))
    return Table.of("differences_isi", [
        {"ISI": label(first), "against": label(second), **texts[first, second]}
        for first, second in order
    ])  # fmt: skip


def _text(pair: Pair) -> str | None:
    if not pair.difference.seeds:
        return None
    return "none" if np.isnan(pair.difference.p) else f"{pair.difference:+.2f}{'' if pair.significant else ' n.s.'}"


def counts(pairs: Sequence[Pair]) -> list[dict[str, Any]]:
    """For each measure with queries, how many pairs differ significantly, and which do not where they are few."""
    found = []
    for measure, group in groupby((pair for pair in pairs if pair.difference.seeds), key=lambda pair: pair.measure):
        of_measure = list(group)
        same = [pair for pair in of_measure if not pair.significant]
        differing = max(pair.difference.differing for pair in of_measure)
        none_can = len(same) == len(of_measure) and len(of_measure) * smallest_p(differing) >= LEVEL
        found.append({
            "measure": measure, "number": len(of_measure), "significant": len(of_measure) - len(same),
            "too_few_seeds": differing if none_can else None,
            "same": same if len(same) <= _NAMED and not none_can else [],
        })  # fmt: skip
    return found
