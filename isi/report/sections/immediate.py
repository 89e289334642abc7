"""MRR* right after insertion: Figure 3a and gains over Xavier (section 6.1),
and the significance of differences.
"""

from collections.abc import Sequence
from itertools import groupby
from math import nan
from operator import attrgetter
from typing import Any

import numpy as np
import pandas as pd

from isi.report import charts, stats
from isi.report.data import Experiment, Results
from isi.report.figures import Chart
from isi.report.section import Content, Tables, of_each_graph
from isi.report.stats import LEVEL, Pair, Values, cells_of, compare, pairs_table, where
from isi.report.tables import Column, Rows
from isi.report.words import (
    BASELINE,
    HALVES,
    JOINT,
    SCOPE,
    SCOPES,
    Names,
    contenders,
    in_order,
    isi,
    label,
    of_role,
)

#: Points of MRR* by which equal rankings may differ: near ties of scores fall either way.
EQUAL = 0.01

_ALL = ("all", "known", "known_closed", "novel", "novel_heldout")
#: Maximum number of pairs without significant difference that a sentence names.
_NAMED = 6


@of_each_graph
def immediate(results: Results, experiment: Experiment) -> Content:
    """Figure 3a, gains over Xavier, and MRR* by size, kind of entity, scope and session."""
    runs, models, initializers = experiment.immediate, experiment.models, experiment.initializers
    paper = results.paper["immediate"]["improvement_over_xavier"]
    gains = {scope: stats.improvements(runs, scope) for scope in ("all", "novel")}
    queried = experiment.inserted[experiment.inserted["queries"] > 0]
    of_kinds = stats.over_seeds(queried, ["kind", "model"], HALVES)
    of_kinds.insert(0, "inserted", queried.groupby(["kind", "model"]).size())
    kinds = in_order(experiment.entities["kind"].unique(), results.vocabulary["kinds"])
    figure = charts.by_size(
        runs,
        models,
        ("all", "novel"),
        ("mrr_star", "mrr_star_entity"),
    )

    def by_scope(by: list[str], scopes: tuple[str, ...] = _ALL) -> pd.DataFrame:
        means = stats.over_seeds(where(runs, scope=scopes), by, HALVES)
        return stats.ordered_rows(means, models, scope=scopes)

    about_new = experiment.mrr_star.get("novel", {})
    if experiment.queries is not None:
        about_new = stats.values(experiment.given_means)
    queries = where(runs, model=initializers[0]).groupby("scope")["queries"].sum()
    numbers = {
        "everything": {JOINT: nan} | experiment.mrr_star.get("all", {}),
        "known": experiment.mrr_star.get("known", {}),
        "strongest": strongest(about_new),
        "gain": stats.values(gains["all"]),
        "known_percent": 100 * float(queries.get("known", 0) / max(queries.get("all", 0), 1)),
    }
    columns = {
        Column(f"scope {scope}", title=SCOPES[scope]): of_models
        for scope, of_models in gains.items()
    }
    others = [name for name in initializers if name != BASELINE]
    tables: Tables = {
        "immediate": stats.by_label(models, stats.halves(runs, "all", "novel")),
        "improvement": stats.by_label(others, {**columns, "paper": paper}, "initializer"),
        "novel_by_kind": stats.ordered_rows(of_kinds, initializers, "initializer", kind=kinds),
        "immediate_by_size": by_scope(["scope", "size", "model"], ("all", "novel")),
        "scopes": _said_once(by_scope(["scope", "model"])),
        "sessions": by_scope(["session", "scope", "model"]),
    }
    return Content(
        numbers,
        tables,
        {"figure3a_immediate": figure, "gain_and_cost": gain_and_cost(runs, initializers)},
    )


def strongest(about_new: Values) -> str | None:
    """The initializer of the highest MRR* about novel entities, if it is neither the paper's nor a
    control; else None.
    """
    others = of_role(about_new, "baseline", "own")
    best = max(contenders(about_new), key=lambda name: about_new[name], default=None)
    return best if best in others else None


def _said_once(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows by scope and model without those that are equal by construction: with known candidates
    alone, a new vector changes nothing.
    """
    closed = (rows[SCOPE] == "known_closed") & (rows["model"] != label(JOINT))
    means = rows.loc[closed].drop(columns=["model", SCOPE]).map(attrgetter("mean"))
    if not len(means) or (means.max() - means.min() > EQUAL).any():
        return rows
    first = means.index[0]
    kept: pd.DataFrame = rows[~closed | (rows.index == first)]
    return kept.assign(model=kept["model"].where(kept.index != first, "Any initializer"))


def gain_and_cost(runs: pd.DataFrame, initializers: Names) -> Chart:
    """MRR* about novel entities against what known triples lose since novel entities
    are candidates; in points.
    """
    means = 100 * runs.pivot_table("mrr_star", "model", "scope", observed=True)
    means = means.reindex(columns=["known", "known_closed", "novel"])
    cost, gain = (means["known_closed"] - means["known"]).to_dict(), means["novel"].to_dict()
    points = {name: (cost[name], gain[name]) for name in initializers if name in gain}
    return charts.named_points(
        points, "MRR* that earlier knowledge loses (points)", "MRR* about novel entities (points)"
    )


@of_each_graph
def differences(results: Results, experiment: Experiment) -> Content | None:
    """Number of significant pairs, ISI against others, all pairs;
    None if no graph has two initializers.
    """
    if all(len(graph.initializers) < 2 for graph in results.standalone):
        return None
    measured = measures(experiment.immediate, experiment.convergence, experiment.initializers)
    pairs = compare(measured, experiment.initializers)
    tables = {
        "differences_isi": differences_isi(pairs, experiment.initializers),
        "differences": pairs_table(pairs),
    }
    return Content({"counts": counts(pairs)}, tables)


def measures(
    immediate: pd.DataFrame, convergence: pd.DataFrame, models: Names
) -> dict[str, pd.DataFrame]:
    """Headline measures (points or epochs) by title: rows (session, size, seed), columns models;
    null: no queries.
    """
    listed = (
        ("immediate MRR*", 100, immediate, "all", "mrr_star"),
        ("immediate MRR*", 100, immediate, "novel", "mrr_star"),
        ("immediate entity prediction", 100, immediate, "novel", "mrr_star_entity"),
        ("epochs to convergence", 1, convergence, "all", "epochs"),
        ("epochs to convergence", 1, convergence, "novel_heldout", "epochs"),
    )
    return {
        f"{title}, {SCOPES[scope]}": scale * cells_of(rows, models, scope, column)
        for title, scale, rows, scope, column in listed
    }


def differences_isi(pairs: Sequence[Pair], initializers: Names) -> Rows:
    """A row for each pair of an initializer of ISI and one outside ISI,
    a column for each measure.
    """
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    for pair in sorted(pairs, key=lambda pair: initializers.index(pair.first)):
        if isi([pair.first]) and not isi([pair.second]):
            sign = "" if pair.significant else " n.s."
            text = "none" if np.isnan(pair.difference.p) else f"{pair.difference:+.2f}{sign}"
            row = rows.setdefault(
                (pair.first, pair.second), {"ISI": label(pair.first), "against": label(pair.second)}
            )
            row[pair.measure] = text if pair.difference.seeds else None
    return list(rows.values())


def counts(pairs: Sequence[Pair]) -> Rows:
    """For each measure with queries: number of pairs and of significant ones; the others, if few;
    seeds, if too few.
    """
    lines = []
    for measure, group in groupby(
        (pair for pair in pairs if pair.difference.seeds), key=lambda pair: pair.measure
    ):
        of_measure = list(group)
        same = [pair for pair in of_measure if not pair.significant]
        differing = max(pair.difference.differing for pair in of_measure)
        smallest_p = 2.0 ** (1 - differing)  # if all n differences have the same sign
        none_can = len(same) == len(of_measure) and len(of_measure) * smallest_p >= LEVEL
        lines.append(
            {
                "measure": measure,
                "number": len(of_measure),
                "significant": len(of_measure) - len(same),
                "too_few_seeds": differing if none_can else None,
                "same": same if len(same) <= _NAMED and not none_can else [],
            }
        )
    return lines
