"""Earlier knowledge during fine-tuning: interference of novel entities, and forgetting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain, product
from typing import Any

import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi.report.data import Experiment, Results
from isi.report.figures import by_epoch
from isi.report.section import Content, of_each_graph
from isi.report.significance import Pair, compare, pairs_table
from isi.report.stats import CELL, cells_of, over_seeds
from isi.report.tables import Column
from isi.report.words import BASELINE, FINETUNE_ONLY, HALVES, JOINT, SCOPE, contenders, isi, label
from isi.report.words import SCOPES as TITLES

SCOPES = ("known", "known_closed")


@of_each_graph
def forgetting(_: Results, experiment: Experiment) -> Content:
    """What is lost right after insertion, and by epoch at the size whose curves are drawn."""
    if experiment.curve_size is None:
        return Content()
    runs = with_finetune_only(experiment)
    pairs = at_the_end(runs)
    tables = {
        "forgetting": by_scope(runs, [*experiment.models, FINETUNE_ONLY]),
        "earlier_at_the_end": pairs_table(chain(*pairs.values())),
    }
    return Content({"ended": ended(pairs)}, tables, {"forgetting": drawn(runs, experiment.models)})


def with_finetune_only(experiment: Experiment) -> pd.DataFrame:
    """The runs whose curves are drawn, those with nothing inserted among them where there are any."""
    if "finetune_only" not in experiment.analyses:
        return experiment.curves
    runs: pd.DataFrame = experiment.analyses["finetune_only"]
    shown = runs[(runs["size"] == experiment.curve_size) & (runs["scope"] == "known_closed")]
    return pd.concat([experiment.curves, shown.assign(model=FINETUNE_ONLY)], ignore_index=True)


def since_before(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs about known entities, minus what Θ⁰ had in the same session before anything was inserted.

    That is MRR* in known_closed right after insertion, the same for all but the joint model.
    """
    shown = runs[runs["scope"].isin(SCOPES)]
    inserted = ~shown["model"].isin([JOINT, FINETUNE_ONLY])
    start = shown[(shown["scope"] == "known_closed") & (shown["epoch"] == 0) & inserted]
    before = start.drop_duplicates(CELL).set_index(CELL)["mrr_star"].rename("before")
    both = shown.join(before, on=CELL)
    return both.assign(mrr_star=both["mrr_star"] - both["before"])


def drawn(runs: pd.DataFrame, models: Sequence[str]) -> Canvas:
    """By epoch, a panel for each scope: how far from before anything was inserted."""
    lines = [*(model for model in models if model != JOINT), FINETUNE_ONLY]
    return by_epoch(since_before(runs), lines, SCOPES, ylabel="MRR* minus before (points)")


def at_the_end(runs: pd.DataFrame) -> dict[str, list[Pair]]:
    """Contenders, and nothing inserted, in pairs after the last epoch, in points; by scope."""
    epoch = runs["epoch"].max()
    last = runs[runs["epoch"] == epoch]
    ran = list(dict.fromkeys(last["model"]))
    models = [*contenders(ran), *({FINETUNE_ONLY} & set(ran))]
    pairs = {}
    for scope in SCOPES:
        queried = set(last.loc[last["scope"] == scope, "model"])
        compared = [model for model in models if model in queried]
        measure = {f"{TITLES[scope]}, epoch {epoch}": 100 * cells_of(last, compared, scope, "mrr_star")}
        pairs[scope] = compare(measure, compared)
    return pairs


def against(pairs: Sequence[Pair], model: str) -> dict[str, Pair]:
    """ISI against one model, by initializer."""
    return {pair.first: pair for pair in pairs if pair.second == model and isi([pair.first])}


def ended(pairs: Mapping[str, Sequence[Pair]]) -> list[tuple[str, str, list[Pair]]]:
    """Interference and forgetting at the end, ISI against Xavier and against nothing inserted: scope, model, pairs."""
    shown = (("known_closed", BASELINE), ("known", BASELINE), ("known_closed", FINETUNE_ONLY))
    lines = [(scope, model, list(against(pairs[scope], model).values())) for scope, model in shown]
    return [line for line in lines if line[2]]


def by_scope(runs: pd.DataFrame, models: Sequence[str]) -> list[dict[Any, Any]]:
    """Known against known_closed: interference against forgetting, in runs of one size."""
    groups, rows = dict(list(runs.groupby(["model", "scope"]))), []
    for model, scope in product(models, SCOPES):
        if (model, scope) in groups:
            shown = groups[model, scope]
            lowest = 100 * shown.groupby("epoch")["mrr_star"].mean().min()
            row: dict[Any, Any] = {"model": label(model), SCOPE: scope, "lowest MRR*": lowest}
            for when, epoch in (("immediately", shown["epoch"].min()), ("at the end", shown["epoch"].max())):
                means = over_seeds(shown[shown["epoch"] == epoch], ["epoch"], HALVES).iloc[0]
                row |= {Column(half, when): means[half] for half in HALVES.values()}
            rows.append(row)
    return rows
