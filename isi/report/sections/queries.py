"""MRR* by kind of query: the novel entity given or its answer, by relation, and under two filters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import pandas as pd

from isi.report.data import Experiment, Results
from isi.report.figures import Figure, by_size
from isi.report.models import JOINT, contenders, label
from isi.report.section import Content, of_each
from isi.report.sections.immediate import SCOPE
from isi.report.stats import DIRECTIONS, HALVES, by_direction, combined
from isi.report.tables import Column, Estimate, Table
from isi.report.variants import by_model

_PLACES = {"given": "given", "answer": "answer", "both": "both", "any": "any or none"}
_FILTERS = {"learned": "scope's filter", "true": "all true"}
_CELL = ("model", "size", "seed")
_PAIR = ["scope", "relation", "hidden", "novel"]


def query_breakdown(results: Results) -> Iterator[Content]:
    """The same of every experiment with a breakdown."""
    rows = {name: one.queries for name, one in results.query_breakdown.items() if not one.queries.empty}
    broken_down = [experiment for name, experiment in results.experiments.items() if name in rows]
    return of_each(broken_down, lambda experiment: of_experiment(experiment, rows[experiment.name]))


def of_experiment(experiment: Experiment, rows: pd.DataFrame) -> Content:
    """Both directions, relations and directions, and both filters; ``rows``: ``tables.ASKED``."""
    models, cells = experiment.models, by_direction(rows, _CELL)
    given = directions(rows, models)
    pairs, by_filter = by_relation(rows), filters(rows)
    everything = pairs[pairs["scope"] == "all"]
    joint = everything.dropna(subset=JOINT).sort_values(JOINT) if JOINT in pairs else everything.head(0)
    everyone = by_filter["mrr_star"].unstack("filter").reindex(columns=list(_FILTERS)).reset_index("scope")
    immediate = everyone[everyone["scope"] == "all"]
    numbers = {
        "leaders": {direction: leader(means) for direction, means in given.items()},
        "joint": {direction: means[JOINT].mean if JOINT in means else None for direction, means in given.items()},
        "extremes": joint.iloc[[0, -1]][["query", JOINT]].to_numpy().tolist() if len(joint) else [],
        "learned": immediate["learned"].dropna().to_dict(), "all_true": immediate["true"].dropna().to_dict(),
        "models": [*contenders(experiment.initializers), JOINT],
    }  # fmt: skip
    canvas = by_size(cells, models, list(DIRECTIONS), ["mrr_star_entity"], len(experiment.entities))
    for axes, title in zip(canvas.axes, DIRECTIONS.values(), strict=True):
        axes.set(title=title, ylabel="MRR* (points)")
    columns = {model: label(model) for model in models if model in pairs}
    shown: list[Table | Figure] = [
        Table.of("directions", [
            {"model": label(model), **{title: given[name].get(model) for name, title in DIRECTIONS.items()}}
            for model in models
        ]),
        Figure("directions", canvas),
        Table.of("by_relation", pairs[["scope", "query", "novel entity", "queries", *columns]].rename(
            columns=columns | {"scope": SCOPE})),
        Table.of("filters", [
            {SCOPE: scope, "model": label(model)}
            | {Column(title, half): by_filter[column].get((scope, model, name))
               for column, half in HALVES.items() for name, title in _FILTERS.items()}
            for scope in ("all", "novel") for model in models
        ]),
    ]  # fmt: skip
    return Content(numbers, shown)


def directions(rows: pd.DataFrame, models: Sequence[str]) -> dict[str, dict[str, Estimate]]:
    """Entity prediction about novel entities by direction and model: means over sizes and seeds in points."""
    cells = by_direction(rows, _CELL)
    return {name: by_model(cells[cells["scope"] == name], "mrr_star_entity", models) for name in DIRECTIONS}


def leader(means: Mapping[str, Estimate]) -> tuple[str, float, dict[str, float]] | None:
    """The best initializer, its mean, and the means of those under test; None where none has any."""
    values = {name: estimate.mean for name, estimate in means.items() if name != JOINT and not pd.isna(estimate.mean)}
    if not values:
        return None
    best = max(values, key=lambda name: values[name])
    return best, values[best], {name: values[name] for name in contenders(values)}


def by_relation(rows: pd.DataFrame) -> pd.DataFrame:
    """Entity queries by relation and direction: means over cells in points, a column a model, with their number.

    Those of scope novel stand first, by where the novel entity is; both then by relation and direction.
    """
    rows = rows[(rows["filter"] == "learned") & rows["scope"].isin(["all", "novel"]) & (rows["hidden"] != "relation")]
    rows = rows.assign(novel=rows["novel"].where(rows["scope"] == "novel", "any"))
    means = 100 * combined(rows, [*_PAIR, *_CELL]).groupby([*_PAIR, "model"])["mrr_star_entity"].mean()
    queries = rows.groupby([*_PAIR, "model"])["queries"].sum().groupby(_PAIR).first()
    frame = means.unstack("model").assign(queries=queries).sort_index(key=_ordered).reset_index()
    query = [{"head": f"(?, {relation}, t)", "tail": f"(h, {relation}, ?)"}[hidden]
             for relation, hidden in zip(frame["relation"], frame["hidden"], strict=True)]  # fmt: skip
    return frame.assign(query=query, **{"novel entity": frame["novel"].map(_PLACES)})


def _ordered(level: pd.Index) -> pd.Index:
    places = {"scope": ["novel", "all"], "novel": list(_PLACES)}.get(str(level.name))
    return level.map(places.index) if places else level


def filters(rows: pd.DataFrame) -> pd.DataFrame:
    """MRR* with its halves under each filter: means over cells in points, by scope, model and filter."""
    cells = combined(rows[rows["scope"].isin(["all", "novel"])], ["scope", "filter", *_CELL])
    return 100 * cells.groupby(["scope", "model", "filter"])[list(HALVES)].mean()
