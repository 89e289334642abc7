"""From simulation to the real: entities of another source in an embedding that never saw them (section 6.3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from isi.graph.graph import MinedSource, new_entities
from isi.report import stats
from isi.report.data import Experiment, Results
from isi.report.figures import Figure
from isi.report.models import BASELINE, JOINT, contenders, label
from isi.report.section import Content
from isi.report.sections import forgetting
from isi.report.significance import LEVEL, Pair, pairs_table
from isi.report.stats import epochs_summary, halves_by_model
from isi.report.tables import Column, Estimate, Table
from isi.report.words import capitalized


def transfer(results: Results) -> Iterator[Content]:
    """Every experiment that inserts entities of another source."""
    for experiment in results.extended:
        yield of_experiment(results, experiment)


def of_experiment(results: Results, experiment: Experiment) -> Content:
    """What was inserted, what is known of it immediately, and what that costs earlier knowledge."""
    settings, name, runs = experiment.settings, experiment.name, experiment.immediate
    extend, (size, *_) = settings.graph.extend, settings.sessions.sizes
    assert extend is not None  # noqa: S101  # as of all that are extended
    paper, means = results.paper["transfer"], stats.mrr_star(runs, experiment.initializers)
    steps = dict(results.mined[extend.source].itertuples(index=False, name=None))
    added = Added(experiment.entities, experiment.triples, results.observed[extend.source])
    base = results.source_title(settings.graph.source)
    heldout = runs[(runs["scope"] == "novel_heldout") & (runs["model"] == JOINT)]
    numbers: dict[str, Any] = {
        "title": capitalized(experiment.title), "name": name, "base": base, "size": size, "paper": paper,
        "repeats": settings.sessions.seeds, "relations": sorted(added.triples_added["relation"].unique()),
        "everything": means.get("all", {}), "novel": means.get("novel", {}), "baseline": BASELINE, "level": LEVEL,
        "epochs": stats.epochs(experiment.convergence, experiment.initializers).get("all", {}),
        "unconverged": stats.unconverged(experiment.convergence, experiment.initializers).get("all", {}),
        "drops": {model: drop.mean for model, drop in drops(runs).items()},
        "tested": contenders(experiment.initializers), "heldout": heldout["queries"].mean(),
        "none_heldout": int((heldout["queries"] == 0).sum()), "all_heldout": len(heldout),
        "curve_size": experiment.curve_size, "ended": [], "order": None,
    }  # fmt: skip
    shown: list[Table | Figure] = [
        mined(name, steps, added, base, extend.min_observations, settings.sessions.steps * size),
        immediate(name, runs, experiment.convergence, experiment.models, paper),
    ]
    if experiment.curve_size is not None:
        curves = forgetting.with_finetune_only(results, experiment)
        pairs = forgetting.at_the_end(curves)
        every = [pair for of_scope in pairs.values() for pair in of_scope]
        numbers |= {"ended": forgetting.ended(pairs), "order": order(results, experiment, pairs)}
        shown += [Figure(f"figure4_{name}", forgetting.drawn(curves, experiment.models)),
                  pairs_table(f"{name}_at_the_end", every)]  # fmt: skip
    return Content(numbers, shown)


def order(results: Results, experiment: Experiment, pairs: Mapping[str, Sequence[Pair]]) -> dict[str, Any] | None:
    """Whether ISI ends on the same side of Xavier as where this graph's own entities were inserted."""
    source = experiment.settings.graph.source
    own = next(
        (one for one in results.standalone if one.settings.graph.source == source and one.curve_size is not None), None
    )
    if own is None:
        return None
    here, there = (forgetting.against(found["known_closed"], BASELINE)
                   for found in (pairs, forgetting.at_the_end(own.curves)))  # fmt: skip
    both = [name for name in here if name in there]
    turned = [name for name in both if here[name].difference.mean * there[name].difference.mean < 0]
    significant = any(found[name].significant for found in (here, there) for name in both)
    if not both:
        return None
    return {"title": own.title, "pairs": [there[name] for name in both], "reversed": turned, "number": len(both),
            "significant": significant}  # fmt: skip


@dataclass(frozen=True)
class Added:
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
    def triples_added(self) -> pd.DataFrame:
        """The triples that came with the new entities."""
        return self.triples[self.triples["source"] == self.seen.source]


def mined(name: str, steps: Mapping[str, int], added: Added, base: str, minimum: int, inserted: int) -> Table:
    """What the other source adds to the graph; ``steps``: instances after each step of mining."""
    unknown = added.unknown
    counts = dict(steps) | {
        f"{'of these, of' if steps else 'instances of'} objects that {base} has not": int(unknown.sum()),
        "kinds of such objects": len(unknown),
        f"of these, with at least {minimum} observations": int((unknown >= minimum).sum()),
        "drawn as candidates": int((added.entities["source"] == added.seen.source).sum()),
        "unique triples of the candidates": len(added.triples_added),
        "inserted in a repeat": inserted,
    }
    return Table.of(f"{name}_mined", [{"": step, "count": count} for step, count in counts.items()])


def immediate(
    name: str, runs: pd.DataFrame, convergence: pd.DataFrame, models: Sequence[str],
    paper: Mapping[str, Mapping[str, float]],
) -> Table:  # fmt: skip
    """MRR* right after insertion, epochs to convergence, and the drop on earlier knowledge, beside the paper's."""
    columns: dict[Any, list[Any]] = {"model": list(map(label, models))}
    for scope, key in (("all", "all_queries"), ("novel", "novel_queries")):
        columns |= halves_by_model(runs, models, (scope,))
        columns[Column("paper", scope)] = [paper[key].get(model) for model in models]
    dropped = drops(runs)
    columns["drop %"] = [dropped.get(model) for model in models]
    columns[Column("paper", "drop %")] = [paper["drop"].get(model) for model in models]
    for scope in ("all", "novel_heldout"):
        epochs = epochs_summary(convergence[convergence["scope"] == scope], ["model"]).drop(columns="std")
        columns |= {Column(str(column), f"epochs, {scope}"): [epochs[column].get(model) for model in models]
                    for column in epochs}  # fmt: skip
    columns[Column("paper", "epochs")] = [paper["epochs"].get(model) for model in models]
    return Table.of(f"{name}_immediate", pd.DataFrame(columns))


def drops(runs: pd.DataFrame) -> dict[str, Estimate]:
    """By how much each initializer's MRR* in ``known`` is below that in ``known_closed`` immediately, in per cent.

    With known candidates only, nothing has changed for earlier knowledge, so this is what inserting costs.
    """

    def lost(means: np.ndarray) -> np.ndarray:
        share: np.ndarray = 100 * (1 - means[..., 0] / means[..., 1])
        return share

    found = {}
    for model, rows in runs[runs["scope"].isin(forgetting.SCOPES)].groupby("model"):
        cells = rows.pivot_table("mrr_star", "seed", "scope").reindex(columns=list(forgetting.SCOPES))
        found[str(model)] = stats.of_means(lost, cells)
    return {model: drop for model, drop in found.items() if model != JOINT and not np.isnan(drop.mean)}


def known_closed_at_the_end(runs: pd.DataFrame, last: int) -> dict[str, float]:
    """MRR* (points) of earlier knowledge with known candidates only after the last epoch."""
    ended = runs[(runs["scope"] == "known_closed") & (runs["epoch"] == last)]
    return {str(model): float(value) for model, value in (100 * ended.groupby("model")["mrr_star"].mean()).items()}
