"""Does it hold on other graphs? All graphs side by side, what they share, and what ISI gains on each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi.report.figures import legend, panels
from isi.report.models import BASELINE, label
from isi.report.paired import Difference, by_seed, difference
from isi.report.prose import joined
from isi.report.results import Experiment, Results
from isi.report.section import Content, Figure, Section, Table
from isi.report.sections.differences import signed
from isi.report.sections.embeddings import Cells, about, epochs, lines, novel
from isi.report.sections.graph import relations_by_kind
from isi.report.statistics import HIGH, LOW
from isi.report.varied import Varied

#: Who is compared with whom, asked about the novel entity.
_PAIRS = (("ers", BASELINE), ("ers", "kind_mean"), ("es", "es_permuted_kinds"), ("soft_hybrid", "ers"),
          ("map_soft_hybrid", "soft_hybrid"))  # fmt: skip


def contents(results: Results) -> Iterator[Content]:
    """Sizes, what is shared, and the same runs on each."""
    if not results.explored:
        return
    graphs = {one.title: (one.entities, one.triples) for one in results.own}
    graphs |= {one.ran.how.title: (one.entities, one.triples) for one in results.explored.values()}
    yield Table(
        "graphs",
        "Graphs side by side",
        "Told by kind: share of the unique triples whose relation is the most frequent one of triples with a tail of "
        "that kind; the higher it is, the more of the half that asks for relations is a choice of kind.",
        sizes(graphs),
    )
    yield Table(
        "graphs_shared",
        "Entities that graphs share",
        "Entities of the graph of a row that that of a column has by the same phrase.",
        shared(graphs),
    )
    ran = {one.ran.how.title: one.ran for one in results.explored.values()}
    first = next(iter(ran.values()))
    both = {one.title: at_size(one, results, first) for one in results.own if one.name in results.asking} | ran
    yield in_words(both)
    yield Figure(
        "graphs",
        "Other graphs: asked about the novel entity",
        "Entity half of MRR* (points) of the queries that give a novel entity and ask what belongs to it, right after "
        f"insertion at |ξ| = {first.how.size}, by graph.",
        drawn(both, first.models),
    )
    for name, what, cells in (
        ("at_once", "MRR* (points) about novel entities at once, mean over seeds and its interval.", novel),
        ("asked_about", "What the figure shows, with the interval over seeds.", about),
        ("gains", "Paired differences in what the figure shows (points), with intervals over seeds.", gains),
        ("epochs", "Mean epochs until MRR* about held-out triples of the novel entities is within the margin of the "
                   "joint model; those that never get there count as all epochs.", partial(later, results)),
    ):  # fmt: skip
        title = f"Other graphs: {name.replace('_', ' ')}"
        frame = rows(both, cells)
        yield Table(
            f"graphs_{name}", title, what, frame, dict.fromkeys(frame.columns[1:], signed) if cells is gains else {}
        )


def sizes(graphs: Mapping[str, tuple[pd.DataFrame, pd.DataFrame]]) -> pd.DataFrame:
    """A row for each graph; of each its entities and triples (``tables.ENTITIES`` and ``tables.TRIPLES``)."""
    lines = []
    for title, (entities, triples) in graphs.items():
        told = relations_by_kind(entities, triples).max(axis=1).sum() / len(triples)
        kinds = entities["kind"].value_counts()
        lines.append(
            {"graph": title, "observations": int(triples["count"].sum()), "unique triples": len(triples),
             "relations": triples["relation"].nunique(), "entities": len(entities),
             "kinds": ", ".join(f"{number} {kind}" for kind, number in kinds.items()), "told by kind %": 100 * told}
        )  # fmt: skip
    return pd.DataFrame(lines)


def shared(graphs: Mapping[str, tuple[pd.DataFrame, pd.DataFrame]]) -> pd.DataFrame:
    """How many entities each two graphs share, by phrase."""
    phrases = {title: set(entities["phrase"]) for title, (entities, _) in graphs.items()}
    return pd.DataFrame(
        {"graph": title, **{other: len(own & theirs) for other, theirs in phrases.items()}}
        for title, own in phrases.items()
    )


def at_size(one: Experiment, results: Results, like: Varied) -> Varied:
    """A main experiment as if it were a variant, at another's size."""
    runs, asked = (frame[frame["size"] == like.how.size] for frame in (one.runs, results.asking[one.name].queries))
    how = like.how.model_copy(update={"title": one.title, "experiments": [one.name], "changes": {}})
    return Varied(how, runs.assign(experiment=one.name), asked.assign(experiment=one.name))


def rows(both: Mapping[str, Varied], cells: Cells) -> pd.DataFrame:
    """A row for each graph; ``cells`` gives the rest of it."""
    return pd.DataFrame(
        {"graph": title, **cells(one, one.experiments[0])} for title, one in both.items() if one.experiments
    )


def differences(one: Varied, experiment: str) -> dict[tuple[str, str], Difference]:
    """Of each pair that was run, what the first has more than the second."""
    cells = 100 * one.about_in(experiment).pivot_table("mrr_star_entity", ["seed", "size"], "model")
    return {
        (first, second): difference(by_seed(cells[first], cells[second]))
        for first, second in _PAIRS
        if first in cells and second in cells
    }


def gains(one: Varied, experiment: str) -> dict[str, float]:
    """The same as part of a row."""
    return {
        f"{label(first)} less {label(second)}{end}": value
        for (first, second), points in differences(one, experiment).items()
        for end, value in (("", points.mean), (LOW, points.low), (HIGH, points.high))
    }


def later(results: Results, one: Varied, experiment: str) -> dict[str, float]:
    """Epochs to convergence of those that were fine-tuned."""
    main = results.experiments.get(experiment)
    left = main.how.immediate_only if main else []
    return epochs(results, replace(one, runs=one.runs[~one.runs["model"].isin(left)]), experiment)


def in_words(both: Mapping[str, Varied]) -> str:
    """On how many graphs each comparison comes out above nothing, with its interval."""
    found: dict[tuple[str, str], list[Difference]] = {}
    for one in both.values():
        for pair, points in differences(one, one.experiments[0]).items() if one.experiments else ():
            found.setdefault(pair, []).append(points)
    told_of = joined(
        f"{label(first)} is above {label(second)} on {sum(one.low > 0 for one in points)} of {len(points)} "
        f"(and below on {sum(one.high < 0 for one in points)})"
        for (first, second), points in found.items()
    )
    return f"Asked about the novel entity right after insertion, with intervals that exclude zero: {told_of}."


def drawn(both: Mapping[str, Varied], models: Sequence[str]) -> Canvas:
    """A line for each model over the graphs."""
    canvas, (axes,) = panels(1, columns=1)
    frame = rows(both, about)
    lines(axes, frame, models, frame["graph"].tolist())
    legend(canvas, [axes])
    return canvas


SECTION = Section("graphs", "Other graphs", contents)
