"""What is asked: about the novel entity or for it, by which relation, and among which candidates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import nan

import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi.report import parts
from isi.report.figures import by_size
from isi.report.models import JOINT, contenders, label
from isi.report.parts import DIRECTIONS, directed
from isi.report.prose import capitalized, listed
from isi.report.results import Experiment, Results
from isi.report.section import Content, Figure, Heading, Section, Table, belonging
from isi.report.statistics import HALVES, over_seeds

_PLACES = {"given": "given", "answer": "answer", "both": "both", "any": "any or none"}
_FILTERS = {"learned": "scope's filter", "true": "all true"}
#: What tells cells apart.
CELL = ("model", "size", "seed")
_PAIR = ["scope", "relation", "hidden", "novel"]


def contents(results: Results) -> Iterator[Content]:
    """The same of every experiment of which it was asked."""
    asked = [
        one for one in results.experiments.values()
        if one.name in results.asking and not results.asking[one.name].queries.empty
    ]  # fmt: skip
    if asked:
        yield (
            "A query about novel entities gives the novel entity and asks what belongs to it, or gives something else "
            "and has the novel entity for its answer. The second can be won without knowledge, by a vector that scores "
            "high against everything; the first cannot."
        )
    for place, experiment in enumerate(asked):
        if len(asked) > 1:
            yield Heading(capitalized(experiment.title), folded=place > 0)
        for content in of_experiment(experiment, results.asking[experiment.name].queries):
            yield belonging(content, experiment)


def of_experiment(experiment: Experiment, rows: pd.DataFrame) -> Iterator[Content]:
    """Both directions, relations and directions, and both filters; ``rows``: ``tables.ASKED``."""
    models, cells = experiment.models, directed(rows, CELL)
    yield leaders(cells, models)
    yield directions(cells, models)
    yield Figure(
        "asked_about",
        "Asked about the novel entity, and asked for it",
        "MRR* of queries that ask for entities, right after insertion, against the number of novel entities, mean and "
        "95 % interval over seeds.",
        by_direction(cells, models, len(experiment.entities)),
    )
    pairs = by_pair(rows[rows["filter"] == "learned"])
    yield extremes(pairs)
    yield by_relation(pairs, models)
    immediate = by_filter(rows)
    yield what_the_filter_does(immediate, [*contenders(experiment.initializers), JOINT])
    yield filters(immediate, models)


def points(cells: pd.DataFrame, direction: str) -> pd.DataFrame:
    """Mean over sizes and seeds in points, with where its 95 % interval ends, by model."""
    return over_seeds(cells[cells["scope"] == direction], ["model"], {"mrr_star_entity": DIRECTIONS[direction]})


def asked_about(rows: pd.DataFrame, models: Sequence[str]) -> dict[str, float]:
    """What each model answers about novel entities: the entity half of scope novel, in points."""
    means = points(directed(rows, CELL), "given")[DIRECTIONS["given"]]
    return {model: float(means[model]) for model in models if model in means.index}


def leaders(cells: pd.DataFrame, models: Sequence[str]) -> str:
    """Who leads each direction, and what initializers under test have there."""
    told = []
    for direction, start in (("given", "Asked about the novel entity"), ("answer", "Where it is the answer")):
        means = points(cells, direction)[DIRECTIONS[direction]].dropna()
        own = {model: float(means[model]) for model in models if model in means.index}
        joint = own.pop(JOINT, nan)
        if own:
            first = max(own, key=lambda model: own[model])
            told.append(
                f"{start}, {label(first)} leads with {own[first]:.1f} ({listed(own, contenders(own))}; the joint model "
                f"{joint:.1f})."
            )
    return (
        "The half that asks for entities right after insertion, mean over sizes and seeds (the joint model was trained "
        f"on most of these triples). {' '.join(told)}"
    )


def directions(cells: pd.DataFrame, models: Sequence[str]) -> Table:
    """Both directions, with intervals."""
    frame = pd.DataFrame({"model": [label(model) for model in models]})
    for direction in DIRECTIONS:
        found = points(cells, direction).reindex(list(models))
        frame[found.columns] = found.to_numpy()
    return Table(
        "directions",
        "Asked about the novel entity, or for it",
        "MRR* (points) of queries that ask for entities, right after insertion, mean over sizes and seeds, with its 95 "
        "% interval over seeds: of the queries that give the novel entity and ask for another, and of those "
        "that ask for the novel entity. Queries with a novel entity at both ends are in neither. The joint model has "
        "been trained on most of these.",
        frame,
    )


def by_direction(cells: pd.DataFrame, models: Sequence[str], entities: int) -> Canvas:
    """Each direction against the number of novel entities; ``cells``: see ``parts.directed``."""
    canvas = by_size(cells, models, list(DIRECTIONS), ["mrr_star_entity"], entities)
    for axes, name in zip(canvas.axes, DIRECTIONS.values(), strict=True):
        axes.set(title=name, ylabel="MRR* (points)")
    return canvas


def by_pair(learned: pd.DataFrame) -> pd.DataFrame:
    """Entity queries by relation and direction: means over cells in points, a column a model, and how many were asked.

    Those of scope novel stand apart by where the novel entity is.
    """
    rows = learned[learned["scope"].isin(["all", "novel"]) & (learned["hidden"] != "relation")]
    rows = rows.assign(novel=rows["novel"].where(rows["scope"] == "novel", "any"))
    means = 100 * parts.mrr_star(rows, [*_PAIR, *CELL]).groupby([*_PAIR, "model"])["mrr_star_entity"].mean()
    asked = rows.groupby([*_PAIR, "model"])["queries"].sum().groupby(_PAIR).first()
    return means.unstack("model").assign(queries=asked).sort_index(key=_ordered)


def _ordered(level: pd.Index) -> pd.Index:
    """Scope novel first; then by relation, direction and place."""
    places = {"scope": ["novel", "all"], "novel": list(_PLACES)}.get(str(level.name))
    return level.map(places.index) if places else level


def extremes(pairs: pd.DataFrame) -> str:
    """Which queries of scope all the joint model answers worst and best."""
    rows = pairs.reset_index()
    joint = rows[rows["scope"] == "all"].dropna(subset=JOINT).sort_values(JOINT) if JOINT in rows else rows.head(0)
    if joint.empty:
        return "Nothing was asked over all queries."
    names, values = [_query(row) for _, row in joint.iterrows()], joint[JOINT].tolist()
    return (
        "By relation and direction, MRR* of the joint model over all queries goes from "
        f"{values[0]:.1f} for {names[0]} to {values[-1]:.1f} for {names[-1]}."
    )


def by_relation(pairs: pd.DataFrame, models: Sequence[str]) -> Table:
    """MRR* by relation and direction; ``pairs``: see ``by_pair``."""
    rows = pairs.reset_index()
    frame = rows[["scope"]].assign(query=rows.apply(_query, axis=1))
    frame["novel entity"], frame["queries"] = rows["novel"].map(_PLACES), rows["queries"]
    return Table(
        "by_relation",
        "By relation and direction",
        "MRR* (points) right after insertion of the queries for heads, (?, r, t), and for tails, (h, r, ?), of each "
        "relation, mean over sizes and seeds; about novel entities, by where the novel entity is. Queries: how many "
        "each model was asked over all sizes and seeds.",
        frame.assign(**{label(model): rows[model] for model in models if model in rows}),
    )


def _query(row: pd.Series) -> str:
    return {"head": "(?, {}, t)", "tail": "(h, {}, ?)"}[row["hidden"]].format(row["relation"])


def by_filter(rows: pd.DataFrame) -> pd.DataFrame:
    """MRR* with its halves under each filter: means over cells in points, by scope, model and filter."""
    cells = parts.mrr_star(rows[rows["scope"].isin(["all", "novel"])], ["scope", "filter", *CELL])
    return 100 * cells.groupby(["scope", "model", "filter"])[list(HALVES)].mean()


def what_the_filter_does(immediate: pd.DataFrame, models: Sequence[str]) -> str:
    """How MRR* over all queries changes with the filter; ``immediate``: see ``by_filter``."""
    rows = immediate["mrr_star"].reset_index()
    own = [rows[(rows["scope"] == "all") & (rows["filter"] == which)] for which in _FILTERS]
    learned, true = (dict(zip(part["model"], part["mrr_star"], strict=True)) for part in own)
    return (
        "The filter of all queries leaves triples of training and validation out of the candidates; the program of the "
        "paper's authors leaves out every true triple. MRR* over all queries of the same embeddings: "
        f"{listed(learned, models)} with the first, {listed(true, models)} with the second."
    )


def filters(immediate: pd.DataFrame, models: Sequence[str]) -> Table:
    """Both filters side by side; ``immediate``: see ``by_filter``."""
    rows = pd.MultiIndex.from_product([["all", "novel"], models], names=["scope", "model"])
    wide = immediate.unstack("filter").reindex(rows)
    shown = {f"{half}: {what}": wide[column, which] for column, half in HALVES.items()
             for which, what in _FILTERS.items()}  # fmt: skip
    frame = pd.DataFrame(shown).reset_index()
    return Table(
        "filters",
        "Both filters",
        "MRR* (points) right after insertion, mean over sizes and seeds, of the same embeddings with two filters: the "
        "usual one (all queries: training and validation triples; novel entities: those of earlier knowledge, and "
        "insert triples), and all true triples.",
        frame.assign(model=frame["model"].map(label)),
    )


SECTION = Section("asked", "Asked about the new entity, or for it", contents)
