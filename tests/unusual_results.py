"""Valid but unusual results: no queries, no rows, all scores tied."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import pandas as pd

from isi.report.data import Experiment, Results
from isi.report.paper_values import VALUES, VOCABULARY

#: Columns of measures.
MEASURES = ["mrr_star", "mrr_star_entity", "mrr_star_relation", "mrr"]
Frames = Callable[[pd.DataFrame], pd.DataFrame]


def of_frames(value: Any, change: Frames) -> Any:
    """``value`` with every table of measures in it changed:
    a frame, a mapping, or an experiment with its analyses.
    """
    if isinstance(value, pd.DataFrame):
        return change(value) if {*MEASURES, "x"} & set(value) else value
    if isinstance(value, Experiment):
        return replace(
            value,
            **{one.name: of_frames(getattr(value, one.name), change) for one in fields(value)},
        )
    return (
        {name: of_frames(part, change) for name, part in value.items()}
        if isinstance(value, dict)
        else value
    )


def changed(results: Results, change: Frames) -> Results:
    """Results with every table of measures changed."""
    return of_experiments(results, lambda experiment: of_frames(experiment, change))


def without_queries(*scopes: str, half: str = "") -> Frames:
    """A change: no queries in these scopes; with ``half``, none in this half of MRR*."""

    def change(frame: pd.DataFrame) -> pd.DataFrame:
        if not {"scope", "mrr_star"} <= set(frame):
            return frame
        own = frame["scope"].isin(scopes)
        columns = [
            name for name in MEASURES if name in frame and (not half or name in (half, "mrr_star"))
        ]
        empty = frame.assign(**{name: frame[name].mask(own) for name in columns})
        return empty if half else empty.assign(queries=empty["queries"].mask(own, 0))

    return change


def of_experiments(results: Results, change: Callable[[Experiment], Experiment]) -> Results:
    """Results with every experiment changed."""
    return replace(
        results, experiments={name: change(one) for name, one in results.experiments.items()}
    )


def one_seed(results: Results) -> Results:
    """Results with the first seed alone, except in the explorer."""
    first = changed(
        results,
        lambda frame: frame[frame["seed"] == 0] if {"seed", "mrr_star"} <= set(frame) else frame,
    )
    return of_experiments(
        first,
        lambda one: replace(
            one,
            **{
                name: frame[frame["seed"] == 0]
                for name in ("novel", "splits", "insert_triples", "ties")
                if "seed" in (frame := getattr(one, name))
            },
        ),
    )


def uncovered(experiment: Experiment) -> Experiment:
    """An experiment in which no entity has a word vector, insert triples or a fallback."""
    return replace(
        experiment,
        coverage=experiment.coverage.assign(served_by=None),
        insert_triples=experiment.insert_triples.head(0),
        inserted=experiment.inserted.assign(fallback=None),
    )


def without_rooms(results: Results) -> Results:
    """Results whose observations have no room."""
    observed = {
        name: replace(one, observations=one.observations.assign(room=None))
        for name, one in results.observed.items()
    }
    return replace(results, observed=observed)


def empty_analyses(experiment: Experiment) -> Experiment:
    """An experiment whose query breakdown, cross-validation and comparison of models, if run,
    have no rows.
    """
    empty = {
        name: experiment.analyses[name].head(0)
        for name in ("cross_validation", "compare_models")
        if name in experiment.analyses
    }
    queries = None if experiment.queries is None else experiment.queries.head(0)
    return replace(experiment, queries=queries, analyses={**experiment.analyses, **empty})


def tied(experiment: Experiment) -> Experiment:
    """An experiment with 10,000 ties per run, which counts as collapsed."""
    return replace(experiment, ties=experiment.ties.assign(ties=10_000))


def without(*scopes: str) -> Frames:
    """A change: no rows of these scopes."""
    return lambda frame: (
        frame[~frame["scope"].isin(scopes)] if {"scope", "mrr_star"} <= set(frame) else frame
    )


def everywhere(value: float) -> Frames:
    """A change: all measures have one value, as for a collapsed model."""
    return lambda frame: frame.assign(**{name: value for name in MEASURES if name in frame})


EVERY_SCOPE = ("all", "novel", "novel_heldout", "known", "known_closed")
#: Changes of measures by title, ...
FRAMES: dict[str, Frames] = {
    "no query is about novel entities": without_queries("novel", "novel_heldout"),
    "no query is held out": without_queries("novel_heldout"),
    "no query is about earlier knowledge": without_queries("known", "known_closed"),
    "no query is over all": without_queries("all"),
    "there are no queries": without_queries(*EVERY_SCOPE),
    "no relation prediction": without_queries("all", "novel", half="mrr_star_relation"),
    "no entity prediction": without_queries("all", "novel", half="mrr_star_entity"),
    "no row is about novel entities": without("novel", "novel_heldout"),
    "no row is about earlier knowledge": without("known", "known_closed"),
    "no row is over all": without("all"),
    "all is zero": everywhere(0.0),
    "all is one": everywhere(1.0),
}
#: ... and all changes of results by title.
STRANGE: dict[str, Callable[[Results], Results]] = {
    **{name: lambda one, change=change: changed(one, change) for name, change in FRAMES.items()},  # type: ignore[misc]
    "all scores are tied": lambda one: of_experiments(one, tied),
    "one seed": one_seed,
    "one relation": lambda one: of_experiments(
        one,
        lambda experiment: replace(
            experiment, triples=experiment.triples.assign(relation="atLocation")
        ),
    ),
    "nothing to go by": lambda one: of_experiments(one, uncovered),
    "no rooms": without_rooms,
    "studies without rows": lambda one: of_experiments(one, empty_analyses),
    "a paper that states nothing": lambda one: replace(one, paper=VALUES().model_dump()),
    "a vocabulary without words": lambda one: replace(one, vocabulary=VOCABULARY().model_dump()),
}
