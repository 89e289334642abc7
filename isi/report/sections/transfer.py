"""From simulation to the real: entities of another source in an embedding that never saw them (section 6.3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from isi.graph.graph import MinedSource, new_entities
from isi.report import statistics
from isi.report.models import BASELINE, JOINT, contenders, label
from isi.report.paired import Pair
from isi.report.prose import capitalized, joined, listed, reached
from isi.report.results import Experiment, Results
from isi.report.section import Content, Figure, Heading, Section, Table
from isi.report.sections import earlier
from isi.report.sections.epochs import summarized
from isi.report.statistics import HALVES, HIGH, LOW


def contents(results: Results) -> Iterator[Content]:
    """Every experiment that inserts entities of another source."""
    for experiment in results.extended:
        yield Heading(capitalized(experiment.title))
        yield from of_experiment(results, experiment)


def of_experiment(results: Results, experiment: Experiment) -> Iterator[Content]:
    """What was inserted, what is known of it at once, and what that costs earlier knowledge."""
    extend, (size, *_) = experiment.how.graph.extend, experiment.how.sessions.sizes
    if extend is None:
        return
    base = results.source_title(experiment.how.graph.source)
    stated = results.paper["transfer"]
    yield at_once_in_words(experiment, base, extend.source, stated)
    left = dict(results.mined[extend.source].itertuples(index=False, name=None))
    drawn = Drawn(experiment.entities, experiment.triples, results.seen[extend.source])
    yield mined(experiment.name, left, drawn, base, extend.min_observations, experiment.how.sessions.steps * size)
    yield immediate(experiment.name, experiment.at_once, experiment.convergence, experiment.models, stated)
    yield earlier_in_words(experiment, base, stated["drop"])
    if experiment.curve_size is not None:
        yield from to_the_end(results, experiment, base)


def to_the_end(results: Results, experiment: Experiment, base: str) -> Iterator[Content]:
    """What training does to earlier knowledge: paired differences at its end, and Figure 4."""
    runs = earlier.with_nothing(results, experiment)
    pairs = earlier.at_the_end(runs)
    yield f"{earlier.at_the_end_in_words(pairs)}{order_against(results, experiment, pairs)}"
    yield Figure(
        f"figure4_{experiment.name}",
        "Figure 4. Earlier knowledge while new entities are learned",
        f"MRR* of queries about the entities of {base} alone by epoch of further training on D¹, with "
        f"{experiment.curve_size} new entities inserted, less what Θ⁰ had before: paired by repeat, mean and (but for "
        f"controls) 95 % interval, {earlier.CAPTION} The paper's figure is the left one, in MRR* itself.",
        earlier.drawn(runs, experiment.models),
    )
    yield earlier.differences_at_the_end(pairs, f"{experiment.name}_at_the_end")


def order_against(results: Results, experiment: Experiment, pairs: Sequence[Pair]) -> str:
    """Whether ISI ends on the same side of Xavier as where this graph's own entities were inserted."""
    source = experiment.how.graph.source
    own = next((one for one in results.own if one.how.graph.source == source and one.curve_size is not None), None)
    if own is None:
        return ""
    here, there = (earlier.against(found, "known_closed", BASELINE)
                   for found in (pairs, earlier.at_the_end(own.curves)))  # fmt: skip
    both = [name for name in here if name in there]
    turned = [name for name in both if here[name].mean * there[name].mean < 0]
    if not both:
        return ""
    order = "reversed" if turned == both else f"reversed for {joined(map(label, turned))}" if turned else "the same"
    if not any(found[name].told_apart for found in (here, there) for name in both):
        order += ", though nothing is told apart in either"
    return (
        f" Where entities of {own.title} itself were inserted, earlier knowledge by itself against Xavier is "
        f"{earlier.named({name: there[name] for name in both})}: the order is {order}."
    )


@dataclass(frozen=True)
class Drawn:
    """What another source adds to a graph."""

    #: of the experiment (``tables.ENTITIES`` and ``tables.TRIPLES``)
    entities: pd.DataFrame
    triples: pd.DataFrame
    #: by the other source
    seen: MinedSource

    @property
    def unknown(self) -> pd.Series[int]:
        """How often each head was observed that the graph had not before."""
        return new_entities(self.seen, self.entities[self.entities["source"] != self.seen.source])

    @property
    def candidates(self) -> int:
        return int((self.entities["source"] == self.seen.source).sum())

    @property
    def added(self) -> pd.DataFrame:
        """The triples that came with the new entities."""
        return self.triples[self.triples["source"] == self.seen.source]


def at_once_in_words(experiment: Experiment, base: str, source: str, stated: Mapping[str, Mapping[str, float]]) -> str:
    """What is told of how many new entities, and what is known of them at once, beside the paper's."""
    how, initializers = experiment.how.sessions, experiment.initializers
    now, tested = statistics.mrr_star(experiment.at_once, initializers), contenders(initializers)
    told = joined(sorted(experiment.triples.loc[experiment.triples["source"] == source, "relation"].unique()))
    epochs = statistics.epochs(experiment.convergence, initializers).get("all", {})
    never = statistics.unconverged(experiment.convergence, initializers).get("all", {})
    return (
        f"Θ⁰ is learned from all of {base}; then {how.sizes[0]} entities that only the other source has "
        f"are inserted, about which only {told} is told, {how.seeds} times. MRR* over all queries right after "
        f"insertion: {listed(now.get('all', {}), tested)} (paper: {listed(stated['all_queries'], tested)}), and about "
        f"the new entities: {listed(now.get('novel', {}), tested)} (paper: {listed(stated['novel_queries'], tested)}). "
        f"Mean number of epochs to convergence over all queries: {reached(epochs, never, tested)}."
    )


def earlier_in_words(experiment: Experiment, base: str, stated: Mapping[str, float]) -> str:
    """What the new entities cost earlier knowledge, beside the paper's."""
    tested = contenders(experiment.initializers)
    dropped = listed(drop(experiment.at_once), tested, "{:.1f} %")
    text = f"By how much MRR* over the entities of {base} alone is lower right after insertion than before: {dropped}"
    if BASELINE in stated:
        text += f" (paper: {stated[BASELINE]} % with Xavier, and no number for the others)"
    return (
        f"{text}. That is crowding alone: with the new entities left out of the candidates all have what Θ⁰ had, by "
        "definition (see [earlier knowledge](#earlier))."
    )


def mined(name: str, left: Mapping[str, int], drawn: Drawn, base: str, minimum: int, inserted: int) -> Table:
    """What the other source adds to the graph.

    Args:
        left: instances after each step of mining.
    """
    unknown = drawn.unknown
    lines = dict(left) | {
        f"{'of these, of' if left else 'instances of'} objects that {base} has not": int(unknown.sum()),
        "kinds of such objects": len(unknown),
        f"of these, with at least {minimum} observations": int((unknown >= minimum).sum()),
        "drawn as candidates": drawn.candidates,
        "unique triples of the candidates": len(drawn.added),
        "inserted in a repeat": inserted,
    }
    told = joined(sorted(drawn.added["relation"].unique()))
    return Table(
        f"{name}_mined",
        "From what was mined to novel entities",
        f"Counts left at each step. What is told of the candidates: {told}.",
        pd.DataFrame({"": list(lines), "count": list(lines.values())}),
    )


def immediate(
    name: str,
    at_once: pd.DataFrame,
    convergence: pd.DataFrame,
    models: Sequence[str],
    stated: Mapping[str, Mapping[str, float]],
) -> Table:
    """MRR* right after insertion, epochs to convergence, and the drop on earlier knowledge, beside the paper's."""
    frame = pd.DataFrame({"model": [label(model) for model in models]})

    def add(name: str, found: Mapping[str, float] | pd.Series) -> None:
        frame[name] = pd.Series([found.get(model, np.nan) for model in models], dtype=float)

    for scope, paper in (("all", "all_queries"), ("novel", "novel_queries")):
        found = statistics.over_seeds(at_once[at_once["scope"] == scope], ["model"], HALVES)
        for column in found:
            add(f"{scope}: {column}", found[column])
        add(f"{scope}: paper", stated[paper])
    dropped = drops(at_once)
    for column, end in (("mean", ""), ("low", LOW), ("high", HIGH)):
        add(f"drop %{end}", dropped[column])
    add("drop %: paper", stated["drop"])
    for scope in ("all", "novel_heldout"):
        own = summarized(convergence[convergence["scope"] == scope], ["model"])
        for column in own.drop(columns="std"):
            add(f"epochs, {scope}: {column}", own[column])
    add("epochs: paper", stated["epochs"])
    heldout = at_once[(at_once["scope"] == "novel_heldout") & (at_once["model"] == JOINT)]
    return Table(
        f"{name}_immediate",
        "New entities inserted into an embedding of the other source",
        "MRR* (points) right after insertion, with its entity and its relation half, over all queries and over those "
        "about the new entities; by how much MRR* over the earlier entities alone is lower with the new ones among the "
        "candidates than without, in per cent; epochs to convergence, as in Table 2. Of "
        f"their held-out triples there are {heldout['queries'].mean():.1f} a repeat to ask about, and none in "
        f"{int((heldout['queries'] == 0).sum())} of {len(heldout)} repeats. Intervals are over repeats.",
        frame,
    )


def drop(at_once: pd.DataFrame) -> dict[str, float]:
    """By how much each model's MRR* in ``known`` is below that in ``known_closed`` at once, in per cent."""
    return {str(model): float(value) for model, value in drops(at_once)["mean"].items()}


def drops(at_once: pd.DataFrame) -> pd.DataFrame:
    """The same with its interval over repeats: columns mean, low and high, by initializer.

    Without the new entities among the candidates nothing has changed for earlier knowledge, so this is
    what inserting them costs.
    """

    def lost(means: np.ndarray) -> np.ndarray:
        share: np.ndarray = 100 * (1 - means[..., 0] / means[..., 1])
        return share

    found = {}
    for model, own in at_once[at_once["scope"].isin(earlier.SCOPES)].groupby("model"):
        cells = own.pivot_table("mrr_star", "seed", "scope").reindex(columns=list(earlier.SCOPES))
        found[str(model)] = statistics.of_means(lost, cells)
    frame = pd.DataFrame.from_dict(found, orient="index", columns=["mean", "low", "high"]).dropna(subset="mean")
    return frame.drop(index=JOINT, errors="ignore")


def known_closed_at_the_end(runs: pd.DataFrame, last: int) -> dict[str, float]:
    """MRR* (points) of the earlier entities among themselves after the last epoch."""
    own = runs[(runs["scope"] == "known_closed") & (runs["epoch"] == last)]
    return {str(model): float(value) for model, value in (100 * own.groupby("model")["mrr_star"].mean()).items()}


SECTION = Section("transfer", "From simulation to the real", contents)
