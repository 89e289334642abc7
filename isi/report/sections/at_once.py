"""What is known right after insertion: Figure 3a, and gains over Xavier (section 6.1)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from isi.report import statistics
from isi.report.figures import by_size
from isi.report.models import BASELINE, JOINT, contenders, isi, label
from isi.report.prose import joined, listed
from isi.report.results import Experiment, Results
from isi.report.section import Content, Figure, Section, Table, by_experiment
from isi.report.sections.graph import in_order_of
from isi.report.statistics import HALVES, HIGH, LOW

_SCOPES = ("all", "known", "known_closed", "novel", "novel_heldout")


def contents(results: Results) -> Iterator[Content]:
    """The same of every graph."""
    yield from by_experiment(results, of_experiment)


def of_experiment(results: Results, experiment: Experiment) -> Iterator[Content]:
    """MRR* at once in words, Figure 3a and its tables."""
    at_once, models = experiment.at_once, experiment.models
    stated = results.paper["immediate"]["improvement_over_xavier"]
    yield from collapsed(experiment)
    yield in_words(at_once, experiment.initializers, stated)
    yield about_novel_in_words(at_once, experiment.initializers)
    yield Figure(
        "figure3a_immediate",
        "Figure 3a. MRR* at once",
        "Right after insertion, against the number of novel entities and their share of all: MRR* (above; at the left "
        "the paper's figure) and the half of it that asks for entities (below), over all queries (left) and over the "
        "queries about the novel entities (right), mean and 95 % interval over seeds. The joint model has been trained "
        "on most of what is asked at the right, so it is no bound there. Scales differ.",
        by_size(at_once, models, ("all", "novel"), ("mrr_star", "mrr_star_entity"), len(experiment.entities)),
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


def collapsed(experiment: Experiment) -> Iterator[str]:
    """Who has no opinion, where anyone has none."""
    found = statistics.collapsed(experiment.at_once, experiment.ties, len(experiment.entities))
    if found:
        named = joined(f"{label(model)} (rivals tied with an answer: {number:,.0f})" for model, number in found.items())
        yield (
            f"**Collapsed on {experiment.title}:** {named}. Who gives nearly everything the same score knows nothing, "
            "whatever MRR* it has; a smaller weight decay or learning rate may help (see [the training](#graph))."
        )


def in_words(at_once: pd.DataFrame, initializers: Sequence[str], stated: Mapping[str, float]) -> str:
    """What the models have at once over all queries; ``stated``: the paper's gains."""
    everything, tested = statistics.mrr_star(at_once, [*initializers, JOINT]).get("all", {}), contenders(initializers)
    text = (
        f"MRR* over all queries right after insertion: {listed(everything, tested)}; a joint model, trained on "
        f"everything, has {everything.get(JOINT, np.nan):.1f}"
    )
    gain, methods = statistics.improvement(at_once, "all"), isi(initializers)
    if gain and methods:
        percent = "{:.1f} %"
        text += f". Gain over Xavier: {listed(gain, methods, percent)} (paper: {listed(stated, methods, percent)})"
    return (
        f"{text}. Of all queries {100 * share_about_known(at_once, initializers):.0f} % are about entities that were "
        "known before: what a novel entity's vector does to those is crowding, not knowledge (see "
        "[earlier knowledge](#earlier))."
    )


def about_novel_in_words(at_once: pd.DataFrame, initializers: Sequence[str]) -> str:
    """What they have at once about the novel entities, half by half."""
    means = 100 * at_once[at_once["scope"] == "novel"].groupby("model")[list(HALVES)].mean()
    star, entity, relation = (
        {str(model): float(value) for model, value in means[column].dropna().items()} for column in HALVES
    )
    tested = contenders(initializers)
    return (
        f"About the novel entities alone: {listed(star, tested)}. Half of that asks for relations, which "
        f"is a choice of kind (see [the graph](#graph)): {listed(relation, tested)}. The half that asks for entities: "
        f"{listed(entity, tested)}."
    )


def share_about_known(at_once: pd.DataFrame, initializers: Sequence[str]) -> float:
    """Share of the queries of scope all that are about known entities alone."""
    queries = at_once[at_once["model"] == initializers[0]].groupby("scope")["queries"].sum()
    return float(queries.get("known", 0) / max(queries.get("all", 0), 1))


def immediate(at_once: pd.DataFrame, models: Sequence[str]) -> Table:
    """MRR* at once in scopes all and novel, with its entity and its relation half, over all sizes."""
    return Table(
        "immediate",
        "MRR* at once",
        "MRR* (points) right after insertion, mean over all sizes and seeds with its interval over seeds, with the "
        "half of it that asks for entities and the half that asks for relations, which is a choice of kind. The "
        "joint model has been trained on most of what is asked about novel entities; it is no bound there.",
        statistics.halves_by_model(at_once, models, ("all", "novel")),
    )


def immediate_by_size(at_once: pd.DataFrame, models: Sequence[str]) -> Table:
    """The numbers behind Figure 3a, with their halves."""
    shown = at_once[at_once["scope"].isin(["all", "novel"])]
    means = statistics.over_seeds(shown, ["scope", "size", "model"], HALVES)
    return Table(
        "immediate_by_size",
        "MRR* at once, by number of novel entities",
        "MRR* (points) right after insertion, mean over seeds and its interval.",
        statistics.in_order(means.reset_index(), ["scope", "size", "model"], models),
        folded=True,
    )


def improvement(at_once: pd.DataFrame, initializers: Sequence[str], stated: Mapping[str, float]) -> Table:
    """Improvement over Xavier, beside the paper's (see ``statistics.improvements``)."""
    others = [name for name in initializers if name != BASELINE]
    frame = pd.DataFrame({"initializer": [label(name) for name in others]})
    for scope in ("all", "novel"):
        found = statistics.improvements(at_once, scope).reindex(others)
        for column, end in (("mean", ""), ("low", LOW), ("high", HIGH)):
            frame[f"scope {scope}{end}"] = found[column].to_numpy()
    frame["paper"] = [stated.get(name) for name in others]
    return Table(
        "improvement",
        "Improvement over Xavier",
        "Immediate MRR* against Xavier's, in per cent: the ratio of means at each size, averaged over sizes, with its "
        "interval over seeds (both resampled together).",
        frame,
    )


def novel_by_kind(inserted: pd.DataFrame, kinds: Sequence[str], initializers: Sequence[str]) -> Table:
    """Immediate MRR* of the queries about each inserted entity, by its kind."""
    asked = inserted[inserted["queries"] > 0]
    means = statistics.over_seeds(asked, ["kind", "model"], HALVES)
    means.insert(0, "inserted", asked.groupby(["kind", "model"]).size())
    order = [(kind, model) for kind in kinds for model in initializers if (kind, model) in means.index]
    frame = means.loc[order].reset_index()
    frame["model"] = frame["model"].map(label)
    return Table(
        "novel_by_kind",
        "MRR* at once, by kind of the novel entity",
        "MRR* (points) of the queries that touch an inserted entity, mean over the inserted entities "
        "of a kind and its interval over seeds, with its entity and its relation half.",
        frame.rename(columns={"model": "initializer"}),
        folded=True,
    )


def every_scope(at_once: pd.DataFrame, models: Sequence[str]) -> Table:
    """Every scope at once, over all sizes."""
    return Table(
        "scopes",
        "MRR* at once, whatever is asked",
        "MRR* (points) right after insertion, mean over all sizes and seeds and its interval over seeds, with its "
        "entity and relation halves.",
        statistics.halves_by_scope(at_once, models, _SCOPES),
        folded=True,
    )


def by_session(at_once: pd.DataFrame, models: Sequence[str]) -> Table:
    """Every session that inserts on its own, over all sizes."""
    parts = []
    for session, own in at_once.groupby("session"):
        parts.append(statistics.halves_by_scope(own, models, _SCOPES))
        parts[-1].insert(0, "session", session)
    return Table(
        "sessions",
        "MRR* at once, by session",
        "MRR* (points) right after each session's insertion, mean over all sizes and seeds and its interval over "
        "seeds, with its entity and relation halves.",
        pd.concat(parts, ignore_index=True),
        folded=True,
    )


SECTION = Section("at-once", "How much is known at once", contents, opened=True)
