"""What beats ISI: stronger initializers, right after insertion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from isi.report import varied
from isi.report.models import JOINT, described, isi, label
from isi.report.paired import by_seed, difference
from isi.report.prose import joined
from isi.report.results import Results
from isi.report.section import Bullets, Content, Section, Table
from isi.report.statistics import HIGH, LOW
from isi.report.varied import Varied

#: What others are compared with, by seed.
AGAINST = "ers"


def contents(results: Results) -> Iterator[Content]:
    """What each is, then a table for each graph."""
    for one in varied.group(results.beyond, "baselines").values():
        rivals = [name for name in one.initializers if name not in results.params.initializers]
        yield (
            "Initializers that the paper does not compare with, from the literature or nearest to hand, beside those "
            f"of the main runs, at |ξ| = {one.how.size}. What they must choose was chosen on known entities that were "
            "hidden, never on novel ones."
        )
        yield Bullets([described(name) for name in rivals])
        for experiment in one.experiments:
            title = results.experiments[experiment].title
            if isi(one.initializers):
                yield in_words(one, experiment, title)
            yield Table(
                f"strong_{experiment}",
                f"Stronger initializers ({title})",
                "MRR* (points) right after insertion, mean over seeds and its interval: over all queries, about "
                f"novel entities, and of the queries that ask about the novel entity; the last less "
                f"{label(AGAINST)}'s, by seed.",
                table(one, experiment),
            )


def in_words(one: Varied, experiment: str, title: str) -> str:
    """Who is above the best of ISI, and how far the joint model is."""
    values = varied.by_model(one.about_in(experiment), "mrr_star_entity", one.models)
    best = max(values[label(name)] for name in isi(one.initializers))
    above = {label(name): values[label(name)] for name in one.initializers if values[label(name)] > best}
    ranked = joined(f"{name} {value:.1f}" for name, value in sorted(above.items(), key=lambda item: -item[1]))
    return (
        f"On {title}, asked about the novel entity, the best of ISI here has {best:.1f}; above it: {ranked}. "
        f"The joint model, trained on everything, has {values[label(JOINT)]:.1f}."
    )


def table(one: Varied, experiment: str) -> pd.DataFrame:
    """A row for each model, those asked about best first."""
    columns = {
        "all": varied.by_model(one.at_once(experiment, "all"), "mrr_star", one.models),
        "novel": varied.by_model(one.at_once(experiment, "novel"), "mrr_star", one.models),
        "asked about": varied.by_model(one.about_in(experiment), "mrr_star_entity", one.models),
    }
    cells = one.about_in(experiment).pivot_table("mrr_star_entity", ["seed", "size"], "model")
    against = 100 * cells[AGAINST] if AGAINST in cells else pd.Series(np.nan, cells.index)
    lines = []
    for model in one.models:
        line: dict[str, object] = {"model": label(model)}
        for name, values in columns.items():
            line |= {f"{name}{end}": values.get(f"{label(model)}{end}") for end in ("", LOW, HIGH)}
        apart = difference(by_seed(100 * cells[model], against))
        told = {"": apart.mean, LOW: apart.low, HIGH: apart.high}
        lines.append(line | {f"asked about, less {label(AGAINST)}{end}": value for end, value in told.items()})
    frame = pd.DataFrame(lines)
    return frame.sort_values("asked about", ascending=False, kind="stable", ignore_index=True)


SECTION = Section("strong", "What beats ISI", contents)
