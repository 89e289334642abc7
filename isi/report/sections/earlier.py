"""Earlier knowledge during fine-tuning: crowding against damage."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pandas as pd

from isi.report.figures import by_epoch
from isi.report.models import BASELINE, JOINT, label
from isi.report.results import Experiment, Results
from isi.report.section import Content, Figure, Section, Table, by_experiment
from isi.report.statistics import HALVES, mrr_star

_SCOPES = ("known", "known_closed")


def contents(results: Results) -> Iterator[Content]:
    """The same of every graph."""
    yield from by_experiment(results, of_experiment)


def of_experiment(_results: Results, experiment: Experiment) -> Iterator[Content]:
    """What is lost at once, and by epoch at the size whose curves are drawn."""
    yield in_words(experiment.at_once, experiment.initializers)
    size = experiment.curve_size
    if size is None:
        yield f"No size in `experiments.{experiment.name}.followed` was inserted, so there is no curve to draw."
        return
    yield Figure(
        "corruption",
        "Earlier knowledge during fine-tuning",
        f"MRR* of queries about known entities at |ξ| = {size}, mean and (but for controls) 95 % interval over seeds: "
        "with the novel entities among the candidates (left) and without (right). A loss on the left alone is "
        "crowding, a loss on the right is damage. Scales differ.",
        by_epoch(experiment.curves, experiment.initializers, _SCOPES),
    )
    yield corruption(experiment.curves, experiment.models, size)


def in_words(at_once: pd.DataFrame, initializers: Sequence[str]) -> str:
    """What is asked, and Xavier's numbers."""
    now = mrr_star(at_once, [*initializers, JOINT])
    text = (
        "Queries about entities that were known before are asked twice: with the novel entities among the candidates "
        "(known) and without (known_closed)."
    )
    if all(BASELINE in now.get(scope, {}) for scope in _SCOPES):
        with_them, without = (now[scope][BASELINE] for scope in _SCOPES)
        text += (
            f" At once, over all sizes (figure and table are at one), Xavier has {with_them:.1f} with them and "
            f"{without:.1f} without; the difference is novel entities that rank above the answers, and no change to "
            "what was learned."
        )
    return text


def corruption(runs: pd.DataFrame, models: Sequence[str], size: int) -> Table:
    """Known against known_closed: crowding against damage, in runs of one size."""
    lines = []
    for model in models:
        for scope in _SCOPES:
            own = runs[(runs["model"] == model) & (runs["scope"] == scope)]
            if len(own):
                means = 100 * own.groupby("epoch")[list(HALVES)].mean().rename(columns=HALVES)
                line = {"model": label(model), "scope": scope, "lowest MRR*": means["MRR*"].min()}
                for when, row in (("at once", means.iloc[0]), ("at the end", means.iloc[-1])):
                    line |= {f"{name} {when}": row[name] for name in HALVES.values()}
                lines.append(line)
    return Table(
        "corruption",
        "Earlier knowledge: crowding or damage",
        f"MRR* (points) of queries about known entities at |ξ| = {size}, mean over seeds, with its "
        "entity and its relation half, with the novel entities among the candidates (known) and without "
        "(known_closed). What is lost only in the former is crowding: novel entities rank above the answers. What is "
        "lost in the latter is damage. Lowest: over all epochs.",
        pd.DataFrame(lines),
    )


SECTION = Section("earlier", "Earlier knowledge", contents)
