"""How much must be seen of a novel entity before its vector is worth something?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi.report import varied
from isi.report.figures import legend, panels
from isi.report.models import JOINT, label
from isi.report.prose import joined
from isi.report.results import Results
from isi.report.section import Content, Figure, Section, Table
from isi.report.sections.controls import NOTHING
from isi.report.sections.embeddings import about, lines
from isi.report.varied import Varied


def contents(results: Results) -> Iterator[Content]:
    """By the number of insert triples that are told: a figure, and its numbers."""
    found = varied.group(results.beyond, "told")
    if not found:
        return
    first = next(iter(found.values()))
    frame = by_number(found, first.experiments[0])
    yield in_words(frame, first)
    yield Figure(
        "told",
        "How much must be seen",
        "Entity half of MRR* (points) of the queries that give a novel entity, right after insertion "
        f"at |ξ| = {first.how.size}, against how many of its insert triples are told, at most. The same is asked each "
        "time.",
        drawn(frame, first.models),
    )
    yield Table(
        "told",
        "How much must be seen",
        "What the figure shows, mean over seeds and its interval. All: every insert triple, half of an entity's "
        "training triples.",
        frame,
    )


def by_number(found: Mapping[str, Varied], experiment: str) -> pd.DataFrame:
    """A row for each number of insert triples."""
    return pd.DataFrame(
        {
            "told": "all" if one.how.max_insert_triples is None else str(one.how.max_insert_triples),
            **about(one, experiment),
        }
        for one in found.values()
        if experiment in one.experiments
    )


def in_words(frame: pd.DataFrame, first: Varied) -> str:
    """What each has with the fewest and with all that is told, and who has less with some."""
    names, fewest, most = [label(name) for name in first.initializers], frame.iloc[0], frame.iloc[-1]
    told = joined(f"{name} {fewest[name]:.1f} and {most[name]:.1f}" for name in names)
    lowest = {name: frame.iloc[int(frame[name].to_numpy().argmin())] for name in names}
    worse = [f"{name} {row[name]:.1f} with {row['told']}" for name, row in lowest.items()
             if fewest[name] - row[name] >= NOTHING]  # fmt: skip
    return (
        "Words cost nothing to see; relations must be observed. Asked about the novel entity with "
        f"{fewest['told']} and with {most['told']} of its insert triples told: {told} (joint model "
        f"{most[label(JOINT)]:.1f})."
    ) + f" A little can be worse than nothing: {joined(worse)}." * bool(worse)


def drawn(frame: pd.DataFrame, models: list[str]) -> Canvas:
    """A line for each model."""
    canvas, (axes,) = panels(1, columns=1)
    lines(axes, frame, models, frame["told"].tolist())
    axes.set_xlabel("insert triples told of each novel entity, at most")
    legend(canvas, [axes])
    return canvas


SECTION = Section("told", "How much must be seen", contents)
