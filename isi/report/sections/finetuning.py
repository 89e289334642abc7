"""Fine-tuning: epochs to convergence and forgetting (section 6.2),
and the transfer (section 6.3).
"""

from collections.abc import Mapping, Sequence
from itertools import chain, product
from math import nan
from typing import Any

import pandas as pd

from isi.evaluation.query_sets import CONVERGING
from isi.graph.graph import MinedSource, new_entities
from isi.report import stats
from isi.report.charts import by_epoch
from isi.report.data import Experiment, Results
from isi.report.section import Content, Contents, Figures, Numbers, Tables, of_each_graph
from isi.report.stats import (
    CELL,
    Estimates,
    Pair,
    compare,
    difference,
    epochs_summary,
    pairs_table,
    where,
)
from isi.report.tables import Cells, Column, Rows
from isi.report.words import (
    BASELINE,
    FINETUNE_ONLY,
    HALVES,
    JOINT,
    SCOPE,
    SCOPES,
    Names,
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
    initializers, epochs = experiment.finetuned, experiment.convergence
    by, paper = ["scope", "size", "model"], results.paper["convergence"]["epochs"]
    groups, of_sizes = epochs.groupby(by), epochs_summary(epochs, by).drop(columns="std")
    of_sizes["triples queried"], of_sizes["sets"] = groups["queries"].mean(), groups.size()
    numbers: Numbers = {
        "best": [],
        "rates": None,
        "curves_drawn": len(experiment.curves) > 0,
        "saved": saved(experiment, paper),
    }
    tables: Tables = {
        "table2_convergence": table2(epochs, initializers, paper),
        "convergence_by_size": stats.ordered_rows(of_sizes, initializers, "initializer"),
    }
    figures = Figures()
    if len(experiment.curves):
        lines = best_epochs(experiment.curves, initializers)
        numbers["best"] = [line for line in lines if line[2] < line[4]]
        shown, margin = lines_of(experiment)[:-1], results.params.convergence.margin
        figures["figure3b_curves"] = by_epoch(experiment.curves, shown, CURVES, margin)
    sweep = results.params.rate_sweep
    swept = [name for name in initializers if name in sweep.initializers]
    if "rate_sweep" in experiment.analyses and swept:
        main = experiment.of_size(sweep.size).runs.assign(factor=AS_CHOSEN)
        runs = pd.concat([main, experiment.analyses["rate_sweep"]])
        by_factor = experiment.converged(where(runs, model=swept), ["model", "factor"])
        numbers["rates"] = {scope: orders(by_factor, swept, scope) for scope in CONVERGING}
        tables["convergence_by_rate"] = by_rate(by_factor, swept)
    return Content(numbers, tables, figures)


def saved(experiment: Experiment, paper: Mapping[str, Any]) -> dict[str, Any] | None:
    """Epochs from Xavier and from the best of ISI on held-out triples, and over all queries beside
    the paper's; None if one of the two was not run.
    """
    epochs = experiment.epochs()
    heldout, of_all = (epochs.get(scope, {}) for scope in ("novel_heldout", "all"))
    best = min((name for name in isi(heldout)), key=lambda name: heldout[name], default=None)
    if best is None or BASELINE not in heldout:
        return None
    of_base = where(experiment.convergence, scope="novel_heldout", model=BASELINE)
    both = [name for name in (BASELINE, best) if name in of_all and name in paper]
    return {
        "base": heldout[BASELINE],
        "median": float(of_base["epochs"].median()),
        "best": best,
        "epochs": heldout[best],
        "kind": heldout.get("kind_mean"),
        "of_all": [of_all[name] for name in both],
        "paper": [paper[name]["mean"] for name in both] if len(both) == 2 else None,
    }


def best_epochs(runs: pd.DataFrame, initializers: Names) -> list[tuple[Any, ...]]:
    """Held-out MRR* (points): model, best mean, its epoch, last mean, its epoch,
    difference last minus best.
    """
    heldout, lines = where(runs, scope="novel_heldout"), []
    for model in of_role(initializers, "isi", "baseline"):
        by_epoch = 100 * where(heldout, model=model).pivot_table("mrr_star", "epoch", "seed")
        if len(by_epoch):
            means, last = by_epoch.mean(axis=1), int(by_epoch.index.max())
            best = int(by_epoch.index.to_numpy()[means.to_numpy().argmax()])
            change = difference((by_epoch.loc[last] - by_epoch.loc[best]).dropna().to_numpy())
            lines.append((model, means[best], best, means[last], last, change))
    return lines


def table2(epochs: pd.DataFrame, initializers: Names, paper: Mapping[str, Any]) -> Cells:
    """Table 2: epochs to convergence over all sizes, beside the paper's."""
    summary = epochs_summary(epochs, ["scope", "model"])[["mean", "std", "median", "unconverged %"]]
    beside = {"mean": "mean", "std": "deviation"}
    columns = dict[Any, Any]()
    for column, cells in stats.by_group(summary, CONVERGING).items():
        columns[column] = cells
        if column.group == "all" and column.name in beside:
            part = beside[column.name]
            theirs = {model: numbers[part] for model, numbers in paper.items()}
            columns[Column(column.name, "paper", below=True)] = theirs
    return stats.by_label(initializers, columns, "initializer")


def by_rate(epochs: pd.DataFrame, initializers: Names) -> Cells:
    """A table of epochs to convergence at one size,
    with columns for each factor on the fine-tuning rate.
    """
    by, ran = ["factor", "scope", "model"], set(epochs["scope"])
    groups, summary = epochs.groupby(by), stats.over_seeds(epochs, by, {"epochs": "mean"}, scale=1)
    summary["median"] = groups["epochs"].median()
    summary["unconverged %"] = 100 * (1 - groups["converged"].mean())
    rows = list(product((scope for scope in CONVERGING if scope in ran), initializers))
    table: Cells = {
        SCOPE: [scope for scope, _ in rows],
        "initializer": [label(model) for _, model in rows],
    }
    for column, cells in stats.by_group(summary, sorted(set(epochs["factor"])), "×{:g}").items():
        table[column] = [cells.get(row) for row in rows]
    return table


def orders(epochs: pd.DataFrame, initializers: Names, scope: str) -> dict[float, str]:
    """Labels in order of mean epochs, as text, for each factor on the fine-tuning rate;
    "=" joins equal means.
    """
    means = where(epochs, scope=scope).groupby(["factor", "model"])["epochs"].mean()
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
    numbers = {
        "worst": ranked and ranked[0],
        "least": ranked and ranked[-1],
        "start": next((before[name] for name in experiment.initializers if name in before), nan),
        "curves_drawn": len(experiment.curves) > 0,
    }
    if not len(experiment.curves):
        return Content(numbers)
    runs = with_finetune_only(experiment)
    pairs = at_the_end(runs)
    tables = {
        "forgetting": interference(runs, [*experiment.models, FINETUNE_ONLY]),
        "earlier_at_the_end": pairs_table(chain(*pairs.values())),
    }
    figure = by_epoch(since_before(runs), lines_of(experiment), EARLIER, ylabels=[_CHANGE])
    return Content(numbers | {"ended": end_comparisons(pairs)}, tables, {"forgetting": figure})


def with_finetune_only(experiment: Experiment) -> pd.DataFrame:
    """The runs with full curves and, if it was run,
    fine-tuning without insertion (``known_closed`` alone).
    """
    if "finetune_only" not in experiment.analyses:
        return experiment.curves
    runs: pd.DataFrame = experiment.analyses["finetune_only"]
    shown = where(runs, size=experiment.curve_size, scope="known_closed")
    return pd.concat([experiment.curves, shown.assign(model=FINETUNE_ONLY)], ignore_index=True)


def since_before(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs in ``EARLIER`` minus MRR* of Θ⁰, which equals any initializer's MRR*
    in known_closed at epoch 0.
    """
    shown = where(runs, scope=EARLIER)
    inserted = ~shown["model"].isin([JOINT, FINETUNE_ONLY])
    start = shown[(shown["scope"] == "known_closed") & (shown["epoch"] == 0) & inserted]
    before = start.drop_duplicates(CELL).set_index(CELL)["mrr_star"].rename("before")
    return shown.assign(mrr_star=shown["mrr_star"] - shown.join(before, on=CELL)["before"])


def lines_of(experiment: Experiment) -> list[str]:
    """The models of figures by epoch but the joint one:
    those with full curves, and fine-tuning without insertion.
    """
    ran = set(experiment.curves["model"])
    return [*(model for model in experiment.initializers if model in ran), FINETUNE_ONLY]


def at_the_end(runs: pd.DataFrame) -> dict[str, list[Pair]]:
    """Pairs of contenders (and fine-tuning without insertion) at the last epoch,
    in points, by scope.
    """
    epoch, pairs = runs["epoch"].max(), {}
    last = where(runs, epoch=epoch)
    ran = list(dict.fromkeys(last["model"]))
    for scope in EARLIER:
        queried = set(last.loc[last["scope"] == scope, "model"])
        compared = [model for model in (*contenders(ran), FINETUNE_ONLY) if model in queried]
        cells = 100 * stats.cells_of(last, compared, scope, "mrr_star")
        pairs[scope] = compare({f"{SCOPES[scope]}, epoch {epoch}": cells}, compared)
    return pairs


def end_comparisons(pairs: Mapping[str, Sequence[Pair]]) -> list[tuple[str, str, list[Pair]]]:
    """ISI against Xavier and against no insertion at the last epoch:
    (scope, model, pairs), if there are pairs.
    """
    lines = []
    for scope, model in (
        ("known_closed", BASELINE),
        ("known", BASELINE),
        ("known_closed", FINETUNE_ONLY),
    ):
        listed = [pair for pair in pairs[scope] if pair.second == model and isi([pair.first])]
        if listed:
            lines.append((scope, model, listed))
    return lines


def interference(runs: pd.DataFrame, models: Names) -> Rows:
    """Rows by model and scope of MRR* (points) about earlier knowledge:
    lowest, immediately, at the last epoch.
    """
    groups, rows = dict(list(runs.groupby(["model", "scope"]))), []
    for model, scope in (key for key in product(models, EARLIER) if key in groups):
        shown = groups[model, scope]
        lowest = 100 * shown.groupby("epoch")["mrr_star"].mean().min()
        row: dict[Any, Any] = {"model": label(model), SCOPE: scope, "lowest MRR*": lowest}
        by_epoch = stats.over_seeds(shown, ["epoch"], HALVES)
        for when, place in (("immediately", 0), ("at the end", -1)):
            row |= {Column(half, when): by_epoch[half].iloc[place] for half in HALVES.values()}
        rows.append(row)
    return rows


def transfer(results: Results) -> Contents:
    """Transfer: entities of a second source are inserted into an embedding of the
    first source (section 6.3).
    """
    for experiment in results.extended:
        settings, name, runs = experiment.settings, experiment.name, experiment.immediate
        extend, paper = settings.graph.extend, results.paper["transfer"]
        assert extend is not None  # noqa: S101  # true of ``results.extended``
        base, triples = results.source_title(settings.graph.source), experiment.triples
        size, *_ = settings.sessions.sizes
        means, drops = experiment.mrr_star.get("all", {}), stats.values(interference_percent(runs))
        of_joint = where(runs, scope="novel_heldout", model=JOINT)
        of_others = triples.loc[triples["source"] == extend.source, "relation"]
        of_mean = means.get("mean", nan)
        numbers: Numbers = {
            "experiment": experiment,
            "base": base,
            "size": size,
            "ended": [],
            "heldout": of_joint["queries"],
            "relations": sorted(of_others.unique()),
            "drops": drops,
            "curves_drawn": len(experiment.curves) > 0,
            "higher": {method: means[method] for method in isi(means) if means[method] < of_mean},
            "isi_drop": max((drops[method] for method in isi(drops)), default=nan),
        }
        mined = mining_steps(
            dict(results.mined[extend.source].itertuples(index=False, name=None)),
            experiment.entities,
            triples,
            results.observed[extend.source],
            base,
            extend.min_observations,
            settings.sessions.steps * size,
        )
        tables = {f"{name}_mined": mined, f"{name}_immediate": _beside(experiment, paper)}
        figures = Figures()
        if len(experiment.curves):
            curves = with_finetune_only(experiment)
            pairs = at_the_end(curves)
            numbers["ended"] = end_comparisons(pairs)
            tables[f"{name}_at_the_end"] = pairs_table(chain(*pairs.values()))
            known = where(curves, scope="known")
            rows = pd.concat([known, since_before(curves[curves["scope"] != "known"])])
            ylabels = ["MRR* (points)", _CHANGE]
            drawn = by_epoch(rows, lines_of(experiment), EARLIER, ylabels=ylabels)
            figures[f"figure4_{name}"] = drawn
        yield Content(numbers, tables, figures)


def _beside(experiment: Experiment, paper: Mapping[str, Any]) -> dict[Any, Any]:
    """A table of measures right after insertion and epochs to convergence, with the paper's."""
    epochs = epochs_summary(experiment.convergence, ["scope", "model"])
    columns = {
        Column("MRR*", "all"): experiment.immediate_means("all"),
        Column("paper", "all", below=True): paper["all_queries"],
        Column("MRR*", "novel"): experiment.immediate_means("novel"),
        Column("paper", "novel", below=True): paper["novel_queries"],
        "drop %": interference_percent(experiment.immediate),
        Column("paper", "drop %", below=True): paper["drop"],
    }
    for scope in CONVERGING:
        columns[Column("mean", f"epochs, {scope}")] = epochs["mean"].get(scope, {})
        if scope == "all":
            columns[Column("paper", "epochs, all", below=True)] = paper["epochs"]
        never = epochs["unconverged %"].get(scope, {})
        columns[Column("unconverged %", f"epochs, {scope}")] = never
    return stats.by_label(experiment.models, columns)


def mining_steps(
    steps: Mapping[str, int],
    entities: pd.DataFrame,
    triples: pd.DataFrame,
    seen: MinedSource,
    base: str,
    minimum: int,
    inserted: int,
) -> Rows:
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


def interference_percent(runs: pd.DataFrame) -> Estimates:
    """Interference by initializer: per cent by which MRR* in ``known`` is below
    MRR* in ``known_closed``.
    """
    pairs = {}
    for model, rows in runs[runs["model"] != JOINT].groupby("model"):
        cells = rows.pivot_table("mrr_star", "seed", "scope").reindex(columns=list(EARLIER))
        known, closed = (cells[[scope]].set_axis(["mrr_star"], axis=1) for scope in EARLIER)
        pairs[str(model)] = (known, closed)
    return stats.relative(pairs, sign=-1)
