"""From simulation to the real: entities of another source in an embedding that never saw them (section 6.3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from isi.graph.graph import MinedSource, new_entities
from isi.report import stats
from isi.report.data import Experiment, Results
from isi.report.figures import Figure
from isi.report.section import Content
from isi.report.sections import forgetting
from isi.report.significance import LEVEL, Pair, pairs_table
from isi.report.stats import epochs_summary, halves, values, wide
from isi.report.tables import Column, Estimate, ReportTable
from isi.report.words import BASELINE, JOINT, capitalized, contenders, label


def transfer(results: Results) -> Iterator[Content]:
    """Every experiment that inserts entities of another source."""
    return (_of_experiment(results, experiment) for experiment in results.extended)


def _of_experiment(results: Results, experiment: Experiment) -> Content:
    settings, name, runs = experiment.settings, experiment.name, experiment.immediate
    extend, (size, *_) = settings.graph.extend, settings.sessions.sizes
    assert extend is not None  # noqa: S101  # as of all that are extended
    paper, means = results.paper["transfer"], stats.mrr_star(runs, experiment.initializers)
    base, triples = results.source_title(settings.graph.source), experiment.triples
    heldout = runs[(runs["scope"] == "novel_heldout") & (runs["model"] == JOINT)]
    numbers: dict[str, Any] = {
        "title": capitalized(experiment.title), "name": name, "base": base, "size": size, "paper": paper,
        "repeats": settings.sessions.seeds,
        "relations": sorted(triples.loc[triples["source"] == extend.source, "relation"].unique()),
        "everything": means.get("all", {}), "novel": means.get("novel", {}), "baseline": BASELINE, "level": LEVEL,
        "epochs": stats.epochs(experiment.convergence, experiment.initializers).get("all", {}),
        "unconverged": stats.unconverged(experiment.convergence, experiment.initializers).get("all", {}),
        "drops": values(drops(runs)), "tested": contenders(experiment.initializers),
        "heldout": heldout["queries"].mean(), "none_heldout": int((heldout["queries"] == 0).sum()),
        "all_heldout": len(heldout), "curve_size": experiment.curve_size, "ended": [], "order": None,
    }  # fmt: skip
    steps = dict(results.mined[extend.source].itertuples(index=False, name=None))
    shown: list[ReportTable | Figure] = [
        mined(name, steps, experiment.entities, triples, results.observed[extend.source], base,
              extend.min_observations, settings.sessions.steps * size),
        _immediate(experiment, paper),
    ]  # fmt: skip
    if experiment.curve_size is not None:
        curves = forgetting.with_finetune_only(results, experiment)
        pairs = forgetting.at_the_end(curves)
        numbers |= {"ended": forgetting.ended(pairs), "order": _order(results, experiment, pairs)}
        every_pair = [pair for of_scope in pairs.values() for pair in of_scope]
        shown += [Figure(f"figure4_{name}", forgetting.drawn(curves, experiment.models)),
                  pairs_table(f"{name}_at_the_end", every_pair)]  # fmt: skip
    return Content(numbers, shown)


def _order(results: Results, experiment: Experiment, pairs: Mapping[str, Sequence[Pair]]) -> dict[str, Any] | None:
    """Whether ISI ends on the same side of Xavier as where this graph's own entities were inserted."""
    source = experiment.settings.graph.source
    graphs = [one for one in results.standalone if one.settings.graph.source == source and one.curve_size is not None]
    for base in graphs[:1]:
        here, there = (forgetting.against(of_scope["known_closed"], BASELINE)
                       for of_scope in (pairs, forgetting.at_the_end(base.curves)))  # fmt: skip
        both = [name for name in here if name in there]
        turned = [name for name in both if here[name].difference.mean * there[name].difference.mean < 0]
        significant = any(of_model[name].significant for of_model in (here, there) for name in both)
        if both:
            return {"title": base.title, "pairs": [there[name] for name in both], "reversed": turned,
                    "number": len(both), "significant": significant}  # fmt: skip
    return None


def mined(
    name: str, steps: Mapping[str, int], entities: pd.DataFrame, triples: pd.DataFrame, seen: MinedSource, base: str,
    minimum: int, inserted: int,
) -> ReportTable:  # fmt: skip
    """What another source adds to a graph.

    Args:
        steps: instances after each step of mining.
        entities: of the experiment, likewise ``triples``.
        seen: by the other source.
        base: the title of the graph.
    """
    unknown = new_entities(seen, entities[entities["source"] != seen.source])
    counts = dict(steps) | {
        f"{'of these, of' if steps else 'instances of'} objects that {base} has not": int(unknown.sum()),
        "kinds of such objects": len(unknown),
        f"of these, with at least {minimum} observations": int((unknown >= minimum).sum()),
        "drawn as candidates": int((entities["source"] == seen.source).sum()),
        "unique triples of the candidates": int((triples["source"] == seen.source).sum()),
        "inserted in a repeat": inserted,
    }
    return ReportTable.of(f"{name}_mined", [{"": step, "count": count} for step, count in counts.items()])


def _immediate(experiment: Experiment, paper: Mapping[str, Mapping[str, float]]) -> ReportTable:
    """MRR* right after insertion, epochs to convergence, and the drop on earlier knowledge, beside the paper's."""
    runs, models, dropped = experiment.immediate, experiment.models, drops(experiment.immediate)
    theirs = {key: [numbers.get(model) for model in models] for key, numbers in paper.items()}
    summary = epochs_summary(experiment.convergence, ["scope", "model"]).drop(columns="std")
    titles = {scope: f"epochs, {scope}" for scope in ("all", "novel_heldout")}
    columns: dict[Any, list[Any]] = {
        "model": list(map(label, models)),
        **halves(runs, models, "all"), Column("paper", "all"): theirs["all_queries"],
        **halves(runs, models, "novel"), Column("paper", "novel"): theirs["novel_queries"],
        "drop %": [dropped.get(model) for model in models], Column("paper", "drop %"): theirs["drop"],
        **wide(summary, [(model,) for model in models], titles), Column("paper", "epochs"): theirs["epochs"],
    }  # fmt: skip
    return ReportTable.of(f"{experiment.name}_immediate", columns)


def drops(runs: pd.DataFrame) -> dict[str, Estimate]:
    """By how much each initializer's MRR* in ``known`` is below that in ``known_closed`` immediately, in per cent.

    With known candidates only, nothing has changed for earlier knowledge, so this is what inserting costs.
    """

    def lost(means: np.ndarray) -> np.ndarray:
        share: np.ndarray = 100 * (1 - means[..., 0] / means[..., 1])
        return share

    shown, scopes = runs[(runs["model"] != JOINT)], list(forgetting.SCOPES)
    costs = {
        str(model): stats.of_means(lost, rows.pivot_table("mrr_star", "seed", "scope").reindex(columns=scopes))
        for model, rows in shown[shown["scope"].isin(scopes)].groupby("model")
    }
    return {model: drop for model, drop in costs.items() if not np.isnan(drop.mean)}
