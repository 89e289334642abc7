"""From simulation to the real: entities of another source in an embedding that never saw them (section 6.3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from isi.building import Seen, newcomers
from isi.report import statistics
from isi.report.figures import by_epoch
from isi.report.models import BASELINE, JOINT, contenders, label
from isi.report.prose import capitalized, joined, listed, reached
from isi.report.results import Experiment, Results
from isi.report.section import Content, Figure, Heading, Section, Table
from isi.report.statistics import HALVES

_SCOPES = ("known", "known_closed")


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
    stated, initializers = results.paper["transfer"], experiment.initializers
    yield at_once_in_words(experiment, base, extend.source, stated)
    left = dict(results.mined[extend.source].itertuples(index=False, name=None))
    drawn = Drawn(experiment.entities, experiment.triples, results.seen[extend.source])
    yield mined(experiment.name, left, drawn, base, extend.min_observations, experiment.how.sessions.steps * size)
    yield immediate(experiment.name, experiment.at_once, experiment.convergence, experiment.models, stated)
    yield earlier_in_words(experiment, base, stated["drop"])
    if experiment.curve_size is not None:
        yield figure4(experiment.name, experiment.curves, initializers, experiment.curve_size, base)


@dataclass(frozen=True)
class Drawn:
    """What another source adds to a graph."""

    #: of the experiment (``tables.ENTITIES`` and ``tables.TRIPLES``)
    entities: pd.DataFrame
    triples: pd.DataFrame
    #: by the other source
    seen: Seen

    @property
    def unknown(self) -> pd.Series[int]:
        """How often each head was observed that the graph had not before."""
        return newcomers(self.seen, self.entities[self.entities["source"] != self.seen.source])

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
    end = known_closed_at_the_end(experiment.curves, experiment.params.finetuning.max_epochs)
    text = f"By how much MRR* over the entities of {base} alone is lower right after insertion than before: {dropped}"
    if BASELINE in stated:
        text += f" (paper: {stated[BASELINE]} % with Xavier, nothing to speak of with the others)"
    if end:
        now = statistics.mrr_star(experiment.at_once, experiment.initializers).get("known_closed", {})
        first = next(iter(now.values()), float("nan"))
        text += (
            f". With the new entities left out of the candidates, at the end of training: {listed(end, tested)}; at "
            f"once it was {first:.1f} for all"
        )
    return f"{text}."


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
    means = 100 * at_once.groupby(["model", "scope"])[list(HALVES)].mean()
    dropped = drop(at_once)
    epochs = convergence.groupby(["model", "scope"])["epochs"].mean()
    never = 1 - convergence.groupby(["model", "scope"])["converged"].mean()
    heldout = at_once[(at_once["scope"] == "novel_heldout") & (at_once["model"] == JOINT)]
    lines = []
    for model in models:
        line: dict[str, object] = {"model": label(model)}
        for scope, paper in (("all", "all_queries"), ("novel", "novel_queries")):
            for column, half in HALVES.items():
                line[f"{scope}: {half}"] = means[column].get((model, scope), np.nan)
            line[f"{scope}: paper"] = stated[paper].get(model, np.nan)
        line["drop %"], line["drop %: paper"] = dropped.get(model, np.nan), stated["drop"].get(model, np.nan)
        for scope in ("all", "novel_heldout"):
            line[f"epochs, {scope}"] = epochs.get((model, scope), np.nan)
            line[f"unconverged %, {scope}"] = 100 * never.get((model, scope), np.nan)
        line["epochs: paper"] = stated["epochs"].get(model, np.nan)
        lines.append(line)
    return Table(
        f"{name}_immediate",
        "New entities inserted into an embedding of the other source",
        "MRR* (points) right after insertion, with its entity and its relation half, over all queries and over those "
        "about the new entities; by how much MRR* over the earlier entities alone is lower with the new ones among the "
        "candidates than without (known against known_closed), in per cent; epochs to convergence, as in Table 2. In "
        f"scope novel_heldout there are {heldout['queries'].mean():.1f} triples a repeat to ask about, and none in "
        f"{int((heldout['queries'] == 0).sum())} of {len(heldout)} repeats.",
        pd.DataFrame(lines),
    )


def drop(at_once: pd.DataFrame) -> dict[str, float]:
    """By how much each model's MRR* in ``known`` is below that in ``known_closed`` at once, in per cent.

    Without the new entities among the candidates nothing has changed for earlier knowledge, so this is
    what inserting them costs.
    """
    means = at_once.groupby(["model", "scope"])["mrr_star"].mean().unstack("scope").reindex(columns=list(_SCOPES))
    lost = (100 * (1 - means["known"] / means["known_closed"])).dropna()
    return {str(model): float(value) for model, value in lost.items() if model != JOINT}


def known_closed_at_the_end(runs: pd.DataFrame, last: int) -> dict[str, float]:
    """MRR* (points) of the earlier entities among themselves after the last epoch."""
    own = runs[(runs["scope"] == "known_closed") & (runs["epoch"] == last)]
    return {str(model): float(value) for model, value in (100 * own.groupby("model")["mrr_star"].mean()).items()}


def figure4(name: str, runs: pd.DataFrame, initializers: Sequence[str], size: int, base: str) -> Figure:
    """Figure 4: MRR* over the earlier entities alone, by epoch of further training, in runs of one size."""
    return Figure(
        f"figure4_{name}",
        "Figure 4. Earlier knowledge while new entities are learned",
        f"MRR* of queries about the entities of {base} alone by epoch of further training on D¹, with {size} new "
        "entities inserted, mean and (but for controls) 95 % interval over repeats: the new entities "
        "among the candidates (left, the paper's figure) and not (right). What is lost on the left alone is "
        "crowding. Scales differ.",
        by_epoch(runs, initializers, _SCOPES),
    )


SECTION = Section("transfer", "From simulation to the real", contents)
