"""What is known right after insertion: Figure 3a, and gains over Xavier (section 6.1)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from isi.report import statistics
from isi.report.figures import by_size
from isi.report.models import BASELINE, JOINT, contenders, isi, label
from isi.report.prose import listed
from isi.report.results import Experiment, Results
from isi.report.section import Content, Figure, Section, Table, by_experiment
from isi.report.sections.graph import in_order_of
from isi.report.statistics import HALVES

_SCOPES = ("all", "known", "known_closed", "novel", "novel_heldout")


def contents(results: Results) -> Iterator[Content]:
    """The same of every graph."""
    yield from by_experiment(results, of_experiment)


def of_experiment(results: Results, experiment: Experiment) -> Iterator[Content]:
    """MRR* at once in words, Figure 3a and its tables."""
    at_once, models = experiment.at_once, experiment.models
    stated = results.paper["immediate"]["improvement_over_xavier"]
    yield in_words(at_once, experiment.initializers, stated)
    yield Figure(
        "figure3a_immediate",
        "Figure 3a. Immediate MRR*",
        "MRR* right after insertion against the number of novel entities, mean and 95 % interval over seeds: over "
        "all queries (left, the paper's figure) and over the queries about the novel entities (right; the joint model "
        "has been trained on most of these, so it is no bound there).",
        by_size(at_once, models, ("all", "novel")),
    )
    yield immediate(at_once, models)
    if BASELINE in models:
        yield improvement(at_once, experiment.initializers, stated)
    kinds = in_order_of(experiment.entities["kind"].unique(), results.vocabulary["kinds"])
    yield novel_by_kind(experiment.inserted, kinds, experiment.initializers)
    yield immediate_by_size(at_once, models)
    yield every_scope(at_once, models)
    if experiment.how.sessions.steps > 1:
        yield by_session(at_once, models)


def in_words(at_once: pd.DataFrame, initializers: Sequence[str], stated: Mapping[str, float]) -> str:
    """What the models have at once, and how much of that is about novel entities; ``stated``: the paper's gains."""
    now, tested = statistics.mrr_star(at_once, [*initializers, JOINT]), contenders(initializers)
    everything = now.get("all", {})
    text = (
        f"MRR* over all queries right after insertion: {listed(everything, tested)}; a joint model, trained on "
        f"everything, has {everything.get(JOINT, np.nan):.1f}"
    )
    gain, methods = statistics.improvement(at_once, "all"), isi(initializers)
    if gain and methods:
        percent = "{:.1f} %"
        text += f". Gain over Xavier: {listed(gain, methods, percent)} (paper: {listed(stated, methods, percent)})"
    return (
        f"{text}. About the novel entities alone (scope novel): {listed(now.get('novel', {}), tested)}. Of all queries "
        f"{100 * share_about_known(at_once, initializers):.0f} % are about entities that were known before: what a "
        "novel entity's vector does to those is crowding, not knowledge (see [earlier knowledge](#earlier))."
    )


def share_about_known(at_once: pd.DataFrame, initializers: Sequence[str]) -> float:
    """Share of the queries of scope all that are about known entities alone."""
    queries = at_once[at_once["model"] == initializers[0]].groupby("scope")["queries"].sum()
    return float(queries.get("known", 0) / max(queries.get("all", 0), 1))


def immediate(at_once: pd.DataFrame, models: Sequence[str]) -> Table:
    """MRR* at once in scopes all and novel, with its entity and its relation half, over all sizes."""
    return Table(
        "immediate",
        "Immediate MRR*",
        "MRR* (points) right after insertion, mean over all sizes and seeds, with the half of it that asks for "
        "entities and the half that asks for relations, of which there are few. The joint model has been "
        "trained on most of the queries of scope novel; it is no bound there.",
        statistics.halves_by_model(at_once, models, ("all", "novel")),
    )


def immediate_by_size(at_once: pd.DataFrame, models: Sequence[str]) -> Table:
    """The numbers behind Figure 3a, with their halves."""
    shown = at_once[at_once["scope"].isin(["all", "novel"])]
    means = 100 * shown.groupby(["scope", "size", "model"])[list(HALVES)].mean().rename(columns=HALVES)
    return Table(
        "immediate_by_size",
        "Immediate MRR* by size",
        "MRR* (points) right after insertion, mean over seeds.",
        statistics.in_order(means.reset_index(), ["scope", "size", "model"], models),
        folded=True,
    )


def improvement(at_once: pd.DataFrame, initializers: Sequence[str], stated: Mapping[str, float]) -> Table:
    """Improvement over Xavier, beside the paper's (see ``statistics.improvement``)."""
    others = [name for name in initializers if name != BASELINE]
    frame = pd.DataFrame({"initializer": [label(name) for name in others]})
    for scope in ("all", "novel"):
        ratios = statistics.improvement(at_once, scope)
        frame[f"scope {scope}"] = [ratios.get(name, np.nan) for name in others]
    frame["paper"] = [stated.get(name) for name in others]
    return Table(
        "improvement",
        "Improvement over Xavier",
        "Immediate MRR* against Xavier's, in per cent: the ratio of means at each size, averaged over sizes.",
        frame,
    )


def novel_by_kind(inserted: pd.DataFrame, kinds: Sequence[str], initializers: Sequence[str]) -> Table:
    """Immediate MRR* of the queries about each inserted entity, by its kind."""
    asked = inserted[inserted["queries"] > 0]
    groups = asked.groupby(["kind", "model"])
    means = 100 * groups[list(HALVES)].mean().rename(columns=HALVES)
    means["std"] = 100 * groups["mrr_star"].std(ddof=1)
    means.insert(0, "inserted", groups.size())
    order = [(kind, model) for kind in kinds for model in initializers if (kind, model) in means.index]
    frame = means.loc[order].reset_index()
    frame["model"] = frame["model"].map(label)
    return Table(
        "novel_by_kind",
        "Immediate MRR* by kind of the novel entity",
        "MRR* (points) in scope novel of the queries that touch an inserted entity, mean and standard deviation over "
        "the inserted entities of a kind, with its entity and its relation half.",
        frame.rename(columns={"model": "initializer"}),
        folded=True,
    )


def every_scope(at_once: pd.DataFrame, models: Sequence[str]) -> Table:
    """Every scope at once, over all sizes."""
    return Table(
        "scopes",
        "Immediate MRR* in every scope",
        "MRR* (points) right after insertion, mean over all sizes and seeds, with its entity and relation halves.",
        statistics.halves_by_model(at_once, models, _SCOPES),
        folded=True,
    )


def by_session(at_once: pd.DataFrame, models: Sequence[str]) -> Table:
    """Every session that inserts on its own, over all sizes."""
    parts = []
    for session, own in at_once.groupby("session"):
        parts.append(statistics.halves_by_model(own, models, _SCOPES))
        parts[-1].insert(0, "session", session)
    return Table(
        "sessions",
        "Immediate MRR* by session",
        "MRR* (points) right after each session's insertion, mean over all sizes and seeds, with its entity and "
        "relation halves.",
        pd.concat(parts, ignore_index=True),
        folded=True,
    )


SECTION = Section("at-once", "What is known at once", contents)
