"""Fine-tuning: epochs to convergence and forgetting (section 6.2),
and the transfer (section 6.3).
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, product
from math import nan
from typing import Any

import pandas as pd

from isi.evaluation.query_sets import CONVERGING
from isi.graph.graph import MinedSource, new_entities
from isi.report import stats
from isi.report.data import Experiment, Results
from isi.report.figures import by_epoch
from isi.report.section import Content, of_each_graph
from isi.report.stats import CELL, Pair, compare, difference, epochs_summary, pairs_table
from isi.report.tables import Column, Estimate
from isi.report.words import (
    BASELINE,
    FINETUNE_ONLY,
    HALVES,
    JOINT,
    SCOPE,
    SCOPES,
    contenders,
    isi,
    label,
    of_role,
)

#: Factor on the fine-tuning learning rate of params in the main runs.
AS_CHOSEN = 1.0
#: Scopes of Figure 3b.
CURVES = ("all", "novel_heldout")
#: Scopes of earlier knowledge: with the novel entities among the candidates, and without.
EARLIER = ("known", "known_closed")
_CHANGE = "change in MRR* (points)"


@of_each_graph
def convergence(results: Results, experiment: Experiment) -> Content:
    """Epochs to convergence: Figure 3b, Table 2 over all sizes, by size,
    and at other fine-tuning rates.
    """
    params, initializers, epochs, curves = (
        results.params,
        experiment.finetuned,
        experiment.convergence,
        {},
    )
    sweep, by = params.rate_sweep, ["scope", "size", "model"]
    groups, of_sizes = epochs.groupby(by), epochs_summary(epochs, by).drop(columns="std")
    of_sizes = of_sizes.assign(
        **{"triples queried": groups["queries"].mean(), "sets": groups.size()}
    )
    heldout = experiment.epochs().get("novel_heldout", {})
    best = min(
        (name for name in isi(initializers) if name in heldout),
        key=lambda name: heldout[name],
        default=None,
    )
    numbers: dict[str, Any] = {
        "best": [],
        "rates": None,
        "curves_drawn": len(experiment.curves) > 0,
        "saved": best and BASELINE in heldout and (heldout[BASELINE], heldout[best], best),
    }
    tables: dict[str, Any] = {
        "table2_convergence": table2(epochs, initializers, results.paper["convergence"]["epochs"]),
        "convergence_by_size": stats.ordered_rows(of_sizes, initializers, "initializer"),
    }
    if len(experiment.curves):
        numbers["best"] = [
            line for line in best_epochs(experiment.curves, initializers) if line[2] < line[4]
        ]
        margin = params.convergence.margin
        curves["figure3b_curves"] = by_epoch(
            experiment.curves, lines_of(experiment)[:-1], CURVES, margin=margin
        )
    swept = [name for name in initializers if name in sweep.initializers]
    if "rate_sweep" in experiment.analyses and swept:
        main = experiment.of_size(sweep.size).runs.assign(factor=AS_CHOSEN)
        runs = pd.concat([main, experiment.analyses["rate_sweep"]])
        by_factor = experiment.converged(runs[runs["model"].isin(swept)], ["model", "factor"])
        numbers["rates"] = {scope: orders(by_factor, swept, scope) for scope in CONVERGING}
        tables["convergence_by_rate"] = by_rate(by_factor, swept)
    return Content(numbers, tables, curves)


def best_epochs(runs: pd.DataFrame, initializers: Sequence[str]) -> list[tuple[Any, ...]]:
    """Held-out MRR* (points): model, best mean, its epoch, last mean, its epoch,
    difference last minus best.
    """
    heldout, lines = runs[runs["scope"] == "novel_heldout"], []
    for model in of_role(initializers, "isi", "baseline"):
        by_epoch = 100 * heldout[heldout["model"] == model].pivot_table("mrr_star", "epoch", "seed")
        if len(by_epoch):
            means = by_epoch.mean(axis=1)
            best, last = (
                int(by_epoch.index.to_numpy()[means.to_numpy().argmax()]),
                int(by_epoch.index.max()),
            )
            change = difference((by_epoch.loc[last] - by_epoch.loc[best]).dropna().to_numpy())
            lines.append((model, means[best], best, means[last], last, change))
    return lines


def table2(
    epochs: pd.DataFrame, initializers: Sequence[str], paper: Mapping[str, Any]
) -> dict[Any, list[Any]]:
    """Table 2: epochs to convergence over all sizes, beside the paper's."""
    summary = epochs_summary(epochs, ["scope", "model"])[["mean", "std", "median", "unconverged %"]]
    columns = dict[Any, Any]()
    for column, cells in stats.by_group(summary, CONVERGING).items():
        columns[column] = cells
        part = (
            {"mean": "mean", "std": "deviation"}.get(column.name) if column.group == "all" else None
        )
        if part:
            theirs = {model: numbers[part] for model, numbers in paper.items()}
            columns[Column(column.name, "paper", below=True)] = theirs
    return stats.by_label(initializers, columns, "initializer")


def by_rate(epochs: pd.DataFrame, initializers: Sequence[str]) -> dict[Any, list[Any]]:
    """A table of epochs to convergence at one size,
    with columns for each factor on the fine-tuning rate.
    """
    by = ["factor", "scope", "model"]
    groups, summary = epochs.groupby(by), stats.over_seeds(epochs, by, {"epochs": "mean"}, scale=1)
    summary["median"] = groups["epochs"].median()
    summary["unconverged %"] = 100 * (1 - groups["converged"].mean())
    rows = [
        (scope, model)
        for scope in CONVERGING
        if scope in set(epochs["scope"])
        for model in initializers
    ]
    columns = stats.by_group(summary, sorted(epochs["factor"].unique()), "×{:g}")
    keys: dict[Any, list[Any]] = {
        SCOPE: [scope for scope, _ in rows],
        "initializer": [label(row[1]) for row in rows],
    }
    return keys | {
        column: [of_rows.get(row) for row in rows] for column, of_rows in columns.items()
    }


def orders(epochs: pd.DataFrame, initializers: Sequence[str], scope: str) -> dict[float, str]:
    """Labels in order of mean epochs, as text, for each factor on the fine-tuning rate;
    "=" joins equal means.
    """
    means = epochs[epochs["scope"] == scope].groupby(["factor", "model"])["epochs"].mean()
    lines = {}
    for factor in means.index.unique("factor"):
        listed = pd.Series(
            {label(model): means[factor][model] for model in initializers if model in means[factor]}
        )
        lines[float(factor)] = ", ".join(
            " = ".join(listed.index[listed == mean]) for mean in sorted(set(listed))
        )
    return lines


@of_each_graph
def forgetting(_: Results, experiment: Experiment) -> Content:
    """Interference and forgetting by epoch at ``curve_size``;
    without curves only the template's text.
    """
    means, before = (experiment.mrr_star.get(scope, {}) for scope in EARLIER)
    ranked = sorted(((name, means[name]) for name in contenders(means)), key=lambda pair: pair[1])
    about = {
        "worst": next(iter(ranked), None),
        "least": next(reversed(ranked), None),
        "start": next((before[name] for name in experiment.initializers if name in before), nan),
        "curves_drawn": len(experiment.curves) > 0,
    }
    if not len(experiment.curves):
        return Content(about)
    runs = with_finetune_only(experiment)
    pairs = at_the_end(runs)
    tables = {
        "forgetting": interference(runs, [*experiment.models, FINETUNE_ONLY]),
        "earlier_at_the_end": pairs_table(chain(*pairs.values())),
    }
    figure = by_epoch(since_before(runs), lines_of(experiment), EARLIER, ylabels=[_CHANGE])
    return Content(about | {"ended": end_comparisons(pairs)}, tables, {"forgetting": figure})


def with_finetune_only(experiment: Experiment) -> pd.DataFrame:
    """The runs with full curves and, if it was run,
    fine-tuning without insertion (``known_closed`` alone).
    """
    if "finetune_only" not in experiment.analyses:
        return experiment.curves
    runs: pd.DataFrame = experiment.analyses["finetune_only"]
    shown = runs[(runs["size"] == experiment.curve_size) & (runs["scope"] == "known_closed")]
    return pd.concat([experiment.curves, shown.assign(model=FINETUNE_ONLY)], ignore_index=True)


def since_before(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs in ``EARLIER`` minus MRR* of Θ⁰, which equals any initializer's MRR*
    in known_closed at epoch 0.
    """
    shown = runs[runs["scope"].isin(EARLIER)]
    inserted = ~shown["model"].isin([JOINT, FINETUNE_ONLY])
    start = shown[(shown["scope"] == "known_closed") & (shown["epoch"] == 0) & inserted]
    before = shown[CELL].join(start.drop_duplicates(CELL).set_index(CELL)["mrr_star"], on=CELL)[
        "mrr_star"
    ]
    return shown.assign(mrr_star=shown["mrr_star"] - before)


def lines_of(experiment: Experiment) -> list[str]:
    """The models of figures by epoch but the joint one:
    those with full curves, and fine-tuning without insertion.
    """
    return [
        *(model for model in experiment.initializers if model in set(experiment.curves["model"])),
        FINETUNE_ONLY,
    ]


def at_the_end(runs: pd.DataFrame) -> dict[str, list[Pair]]:
    """Pairs of contenders (and fine-tuning without insertion) at the last epoch,
    in points, by scope.
    """
    epoch, pairs = runs["epoch"].max(), {}
    last = runs[runs["epoch"] == epoch]
    ran = list(dict.fromkeys(last["model"]))
    for scope in EARLIER:
        queried = set(last.loc[last["scope"] == scope, "model"])
        compared = [model for model in (*contenders(ran), FINETUNE_ONLY) if model in queried]
        measure = {
            f"{SCOPES[scope]}, epoch {epoch}": 100
            * stats.cells_of(last, compared, scope, "mrr_star")
        }
        pairs[scope] = compare(measure, compared)
    return pairs


def pairs_with(pairs: Sequence[Pair], model: str) -> dict[str, Pair]:
    """The pairs of an initializer of ISI and ``model``, by initializer."""
    return {pair.first: pair for pair in pairs if pair.second == model and isi([pair.first])}


def end_comparisons(pairs: Mapping[str, Sequence[Pair]]) -> list[tuple[str, str, list[Pair]]]:
    """ISI against Xavier and against no insertion at the last epoch:
    (scope, model, pairs), if there are pairs.
    """
    shown = (("known_closed", BASELINE), ("known", BASELINE), ("known_closed", FINETUNE_ONLY))
    lines = [
        (scope, model, list(pairs_with(pairs[scope], model).values())) for scope, model in shown
    ]
    return [line for line in lines if line[2]]


def interference(runs: pd.DataFrame, models: Sequence[str]) -> list[dict[Any, Any]]:
    """Rows by model and scope of MRR* (points) about earlier knowledge:
    lowest, immediately, at the last epoch.
    """
    groups, rows = dict(list(runs.groupby(["model", "scope"]))), []
    for model, scope in (key for key in product(models, EARLIER) if key in groups):
        shown = groups[model, scope]
        lowest = 100 * shown.groupby("epoch")["mrr_star"].mean().min()
        row: dict[Any, Any] = {"model": label(model), SCOPE: scope, "lowest MRR*": lowest}
        for when, epoch in (
            ("immediately", shown["epoch"].min()),
            ("at the end", shown["epoch"].max()),
        ):
            means = stats.over_seeds(shown[shown["epoch"] == epoch], ["epoch"], HALVES).iloc[0]
            row |= {Column(half, when): means[half] for half in HALVES.values()}
        rows.append(row)
    return rows


def transfer(results: Results) -> Iterator[Content]:
    """Transfer: entities of a second source are inserted into an embedding of the
    first source (section 6.3).
    """
    for experiment in results.extended:
        settings, name, runs, figures = (
            experiment.settings,
            experiment.name,
            experiment.immediate,
            {},
        )
        extend, (size, *_), triples = (
            settings.graph.extend,
            settings.sessions.sizes,
            experiment.triples,
        )
        assert extend is not None  # noqa: S101  # true of ``results.extended``
        base, paper = results.source_title(settings.graph.source), results.paper["transfer"]
        dropped, means = interference_percent(runs), experiment.mrr_star.get("all", {})
        higher = {
            method: means[method] for method in isi(means) if means[method] < means.get("mean", nan)
        }
        numbers: dict[str, Any] = {
            "experiment": experiment,
            "base": base,
            "size": size,
            "ended": [],
            "heldout": runs[(runs["scope"] == "novel_heldout") & (runs["model"] == JOINT)][
                "queries"
            ],
            "relations": sorted(
                triples.loc[triples["source"] == extend.source, "relation"].unique()
            ),
            "drops": stats.values(dropped),
            "curves_drawn": len(experiment.curves) > 0,
            "higher": higher,
            "isi_drop": max((dropped[method].mean for method in isi(dropped)), default=nan),
        }
        epochs = epochs_summary(experiment.convergence, ["scope", "model"])
        totals = {scope: experiment.immediate_means(scope) for scope in ("all", "novel")}

        def of_scopes(scope: str, column: str, epochs: pd.DataFrame = epochs) -> Any:
            return epochs[column].get(scope, {})

        steps = dict(results.mined[extend.source].itertuples(index=False, name=None))
        tables: dict[str, Any] = {
            f"{name}_mined": mining_steps(
                steps,
                experiment.entities,
                triples,
                results.observed[extend.source],
                base,
                extend.min_observations,
                settings.sessions.steps * size,
            ),
            f"{name}_immediate": stats.by_label(
                experiment.models,
                {
                    Column("MRR*", "all"): totals["all"],
                    Column("paper", "all", below=True): paper["all_queries"],
                    Column("MRR*", "novel"): totals["novel"],
                    Column("paper", "novel", below=True): paper["novel_queries"],
                    "drop %": dropped,
                    Column("paper", "drop %", below=True): paper["drop"],
                    Column("mean", "epochs, all"): of_scopes("all", "mean"),
                    Column("paper", "epochs, all", below=True): paper["epochs"],
                    Column("unconverged %", "epochs, all"): of_scopes("all", "unconverged %"),
                    Column("mean", "epochs, novel_heldout"): of_scopes("novel_heldout", "mean"),
                    Column("unconverged %", "epochs, novel_heldout"): of_scopes(
                        "novel_heldout", "unconverged %"
                    ),
                },
            ),
        }
        if len(experiment.curves):
            curves = with_finetune_only(experiment)
            pairs = at_the_end(curves)
            numbers["ended"] = end_comparisons(pairs)
            tables[f"{name}_at_the_end"] = pairs_table(chain(*pairs.values()))
            rows = pd.concat(
                [
                    curves[curves["scope"] == "known"],
                    since_before(curves[curves["scope"] != "known"]),
                ]
            )
            ylabels = ["MRR* (points)", _CHANGE]
            figures[f"figure4_{name}"] = by_epoch(
                rows, lines_of(experiment), EARLIER, ylabels=ylabels
            )
        yield Content(numbers, tables, figures)


def mining_steps(
    steps: Mapping[str, int],
    entities: pd.DataFrame,
    triples: pd.DataFrame,
    seen: MinedSource,
    base: str,
    minimum: int,
    inserted: int,
) -> list[dict[str, Any]]:
    """Rows of counts: the ``steps`` of mining the source ``seen``, its objects that ``base`` lacks,
    candidates, |ξ|.
    """
    unknown = new_entities(seen, entities[entities["source"] != seen.source])
    counts = dict(steps) | {
        f"{'of these, of' if steps else 'instances of'} objects that {base} has not": int(
            unknown.sum()
        ),
        "kinds of such objects": len(unknown),
        f"of these, with at least {minimum} observations": int((unknown >= minimum).sum()),
        "drawn as candidates": int((entities["source"] == seen.source).sum()),
        "unique triples of the candidates": int((triples["source"] == seen.source).sum()),
        "inserted in a repeat": inserted,
    }
    return [{"": step, "count": count} for step, count in counts.items()]


def interference_percent(runs: pd.DataFrame) -> dict[str, Estimate]:
    """Interference by initializer: per cent by which MRR* in ``known`` is below
    MRR* in ``known_closed``.
    """
    earlier = runs[runs["scope"].isin(EARLIER) & (runs["model"] != JOINT)]
    pairs = {}
    for model, rows in earlier.groupby("model"):
        cells = rows.pivot_table("mrr_star", "seed", "scope").reindex(columns=list(EARLIER))
        known, closed = (cells[[scope]].set_axis(["mrr_star"], axis=1) for scope in EARLIER)
        pairs[str(model)] = (known, closed)
    return stats.relative(pairs, sign=-1)
