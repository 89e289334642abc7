"""From simulation to the real: entities of another source in an embedding that never saw them (section 6.3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

import pandas as pd

from isi.graph.graph import MinedSource, new_entities
from isi.report import stats
from isi.report.data import Experiment, Results
from isi.report.section import Content
from isi.report.sections import finetuning
from isi.report.significance import Pair, pairs_table
from isi.report.stats import epochs_summary, halves, values, wide
from isi.report.tables import Column, Estimate
from isi.report.words import BASELINE, JOINT, label


def transfer(results: Results) -> Iterator[Content]:
    """Every experiment that inserts entities of another source."""
    return (_of_experiment(results, experiment) for experiment in results.extended)


def _of_experiment(results: Results, experiment: Experiment) -> Content:
    settings, name, runs = experiment.settings, experiment.name, experiment.immediate
    extend, (size, *_) = settings.graph.extend, settings.sessions.sizes
    assert extend is not None  # noqa: S101  # as of all that are extended
    base, triples = results.source_title(settings.graph.source), experiment.triples
    heldout = runs[(runs["scope"] == "novel_heldout") & (runs["model"] == JOINT)]
    numbers: dict[str, Any] = {
        "experiment": experiment, "base": base, "size": size, "heldout": heldout["queries"],
        "relations": sorted(triples.loc[triples["source"] == extend.source, "relation"].unique()),
        "drops": values(drops(runs)), "ended": [], "order": None,
    }  # fmt: skip
    steps = dict(results.mined[extend.source].itertuples(index=False, name=None))
    tables: dict[str, Any] = {
        f"{name}_mined": mined(steps, experiment.entities, triples, results.observed[extend.source], base,
                               extend.min_observations, settings.sessions.steps * size),
        f"{name}_immediate": _immediate(experiment, results.paper["transfer"]),
    }  # fmt: skip
    figures = {}
    if experiment.curve_size is not None:
        curves = finetuning.with_finetune_only(experiment)
        pairs = finetuning.at_the_end(curves)
        numbers |= {"ended": finetuning.ended(pairs), "order": _order(results, experiment, pairs)}
        tables[f"{name}_at_the_end"] = pairs_table(chain(*pairs.values()))
        figures[f"figure4_{name}"] = finetuning.drawn(curves, experiment.models)
    return Content(numbers, tables, figures)


def _order(results: Results, experiment: Experiment, pairs: Mapping[str, Sequence[Pair]]) -> dict[str, Any] | None:
    """Whether ISI ends on the same side of Xavier as where this graph's own entities were inserted."""
    source = experiment.settings.graph.source
    graphs = [one for one in results.standalone if one.settings.graph.source == source and one.curve_size is not None]
    for base in graphs[:1]:
        here, there = (finetuning.against(of_scope["known_closed"], BASELINE)
                       for of_scope in (pairs, finetuning.at_the_end(base.curves)))  # fmt: skip
        both = [name for name in here if name in there]
        turned = [name for name in both if here[name].difference.mean * there[name].difference.mean < 0]
        significant = any(here[name].significant or there[name].significant for name in both)
        order = {"title": base.title, "pairs": [there[name] for name in both], "reversed": turned}
        return {**order, "significant": significant} if both else None
    return None


def mined(
    steps: Mapping[str, int], entities: pd.DataFrame, triples: pd.DataFrame, seen: MinedSource, base: str,
    minimum: int, inserted: int,
) -> list[dict[str, Any]]:  # fmt: skip
    """What a source (``seen``) adds to the graph titled ``base``: instances after each step of mining, then counts."""
    unknown = new_entities(seen, entities[entities["source"] != seen.source])
    counts = dict(steps) | {
        f"{'of these, of' if steps else 'instances of'} objects that {base} has not": int(unknown.sum()),
        "kinds of such objects": len(unknown),
        f"of these, with at least {minimum} observations": int((unknown >= minimum).sum()),
        "drawn as candidates": int((entities["source"] == seen.source).sum()),
        "unique triples of the candidates": int((triples["source"] == seen.source).sum()),
        "inserted in a repeat": inserted,
    }
    return [{"": step, "count": count} for step, count in counts.items()]


def _immediate(experiment: Experiment, paper: Mapping[str, Mapping[str, float]]) -> dict[Any, list[Any]]:
    """MRR* right after insertion, epochs to convergence, and the drop on earlier knowledge, beside the paper's."""
    runs, models, dropped = experiment.immediate, experiment.models, drops(experiment.immediate)
    theirs = {key: [numbers.get(model) for model in models] for key, numbers in paper.items()}
    summary = epochs_summary(experiment.convergence, ["scope", "model"]).drop(columns="std")
    titles = {scope: f"epochs, {scope}" for scope in ("all", "novel_heldout")}
    return {
        "model": list(map(label, models)),
        **halves(runs, models, "all"), Column("paper", "all"): theirs["all_queries"],
        **halves(runs, models, "novel"), Column("paper", "novel"): theirs["novel_queries"],
        "drop %": [dropped.get(model) for model in models], Column("paper", "drop %"): theirs["drop"],
        **wide(summary, [(model,) for model in models], titles), Column("paper", "epochs"): theirs["epochs"],
    }  # fmt: skip


def drops(runs: pd.DataFrame) -> dict[str, Estimate]:
    """By how much inserting puts each initializer's MRR* in ``known`` below that in ``known_closed``, in per cent."""
    scopes, pairs = list(finetuning.EARLIER), {}
    for model, rows in runs[runs["scope"].isin(scopes) & (runs["model"] != JOINT)].groupby("model"):
        cells = rows.pivot_table("mrr_star", "seed", "scope").reindex(columns=scopes)
        known, closed = (cells[[scope]].set_axis(["mrr_star"], axis=1) for scope in scopes)
        pairs[str(model)] = (known, closed)
    return stats.relative(pairs, sign=-1)
