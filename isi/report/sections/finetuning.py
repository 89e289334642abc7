"""Fine-tuning: epochs to convergence and forgetting (section 6.2), and the transfer (section 6.3)."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, product
from typing import Any

import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi.evaluation.query_sets import CONVERGING
from isi.graph.graph import MinedSource, new_entities
from isi.report import stats
from isi.report.data import Experiment, Results
from isi.report.figures import by_epoch
from isi.report.section import Content, of_each_graph
from isi.report.stats import CELL, Pair, compare, difference, epochs_summary, pairs_table
from isi.report.tables import Column, Estimate
from isi.report.words import BASELINE, FINETUNE_ONLY, HALVES, JOINT, SCOPE, SCOPES, contenders, isi, label

#: Factor on the fine-tuning learning rate of params in the main runs.
AS_CHOSEN = 1.0
#: Scopes of Figure 3b.
CURVES = ("all", "novel_heldout")
#: Scopes of earlier knowledge: with the novel entities among the candidates, and without.
EARLIER = ("known", "known_closed")


@of_each_graph
def convergence(results: Results, experiment: Experiment) -> Content:
    """Epochs to convergence: Figure 3b, Table 2 over all sizes, by size, and at other fine-tuning rates."""
    params, initializers, epochs, curves = results.params, experiment.finetuned, experiment.convergence, {}
    sweep, by = params.rate_sweep, ["scope", "size", "model"]
    groups, of_sizes = epochs.groupby(by), epochs_summary(epochs, by).drop(columns="std")
    of_sizes = of_sizes.assign(**{"triples queried": groups["queries"].mean(), "sets": groups.size()})
    numbers: dict[str, Any] = {"best": [], "rates": None}
    tables: dict[str, Any] = {
        "table2_convergence": table2(epochs, initializers, results.paper["convergence"]["epochs"]),
        "convergence_by_size": stats.ordered_rows(of_sizes, initializers, "initializer"),
    }
    if experiment.curve_size is not None:
        numbers["best"] = best_epochs(experiment.curves, initializers)
        margin = params.convergence.margin
        curves["figure3b_curves"] = by_epoch(experiment.curves, initializers, CURVES, margin=margin)
    swept = [name for name in initializers if name in sweep.initializers]
    if "rate_sweep" in experiment.analyses and swept:
        main = experiment.of_size(sweep.size).runs.assign(factor=AS_CHOSEN)
        runs = pd.concat([main, experiment.analyses["rate_sweep"]])
        by_factor = experiment.converged(runs[runs["model"].isin(swept)], ["model", "factor"])
        numbers["rates"] = {scope: orders(by_factor, swept, scope) for scope in CONVERGING}
        tables["convergence_by_rate"] = by_rate(by_factor, swept)
    return Content(numbers, tables, curves)


def best_epochs(runs: pd.DataFrame, initializers: Sequence[str]) -> list[tuple[Any, ...]]:
    """ISI's held-out MRR* (points): model, best mean, its epoch, last mean, its epoch, difference last minus best."""
    heldout, lines = runs[runs["scope"] == "novel_heldout"], []
    for model in isi(initializers):
        by_epoch = 100 * heldout[heldout["model"] == model].pivot_table("mrr_star", "epoch", "seed")
        if len(by_epoch):
            means = by_epoch.mean(axis=1)
            best, last = int(by_epoch.index.to_numpy()[means.to_numpy().argmax()]), int(by_epoch.index.max())
            change = difference((by_epoch.loc[last] - by_epoch.loc[best]).dropna().to_numpy())
            lines.append((model, means[best], best, means[last], last, change))
    return lines


def table2(epochs: pd.DataFrame, initializers: Sequence[str], paper: Mapping[str, Any]) -> dict[Any, list[Any]]:
    """Table 2: epochs to convergence over all sizes, beside the paper's."""
    summary = epochs_summary(epochs, ["scope", "model"])[["mean", "std", "median", "unconverged %"]]
    theirs = {Column(title, "paper"): {model: numbers[part] for model, numbers in paper.items()}
              for part, title in (("mean", "mean"), ("deviation", "std"))}  # fmt: skip
    return stats.by_label(initializers, stats.by_group(summary, CONVERGING) | theirs, "initializer")


def by_rate(epochs: pd.DataFrame, initializers: Sequence[str]) -> dict[Any, list[Any]]:
    """A table of epochs to convergence at one size, with columns for each factor on the fine-tuning rate."""
    by = ["factor", "scope", "model"]
    groups, summary = epochs.groupby(by), stats.over_seeds(epochs, by, {"epochs": "mean"}, scale=1)
    summary["median"] = groups["epochs"].median()
    summary["unconverged %"] = 100 * (1 - groups["converged"].mean())
    rows = [(scope, model) for scope in CONVERGING if scope in set(epochs["scope"]) for model in initializers]
    columns = stats.by_group(summary, sorted(epochs["factor"].unique()), "×{:g}")
    keys: dict[Any, list[Any]] = {SCOPE: [scope for scope, _ in rows], "initializer": [label(row[1]) for row in rows]}
    return keys | {column: [of_rows.get(row) for row in rows] for column, of_rows in columns.items()}


def orders(epochs: pd.DataFrame, initializers: Sequence[str], scope: str) -> dict[float, str]:
    """Labels in order of mean epochs, as text, for each factor on the fine-tuning rate; "=" joins equal means."""
    means = epochs[epochs["scope"] == scope].groupby(["factor", "model"])["epochs"].mean()
    lines = {}
    for factor in means.index.unique("factor"):
        listed = pd.Series({label(model): means[factor][model] for model in initializers if model in means[factor]})
        lines[float(factor)] = ", ".join(" = ".join(listed.index[listed == mean]) for mean in sorted(set(listed)))
    return lines


@of_each_graph
def forgetting(_: Results, experiment: Experiment) -> Content:
    """Interference and forgetting by epoch at ``curve_size``; without curves only the template's text."""
    if experiment.curve_size is None:
        return Content()
    runs = with_finetune_only(experiment)
    pairs = at_the_end(runs)
    tables = {"forgetting": interference(runs, [*experiment.models, FINETUNE_ONLY]),
              "earlier_at_the_end": pairs_table(chain(*pairs.values()))}  # fmt: skip
    return Content({"ended": end_comparisons(pairs)}, tables, {"forgetting": curves_figure(runs, experiment.models)})


def with_finetune_only(experiment: Experiment) -> pd.DataFrame:
    """The runs with full curves and, if it was run, fine-tuning without insertion (``known_closed`` alone)."""
    if "finetune_only" not in experiment.analyses:
        return experiment.curves
    runs: pd.DataFrame = experiment.analyses["finetune_only"]
    shown = runs[(runs["size"] == experiment.curve_size) & (runs["scope"] == "known_closed")]
    return pd.concat([experiment.curves, shown.assign(model=FINETUNE_ONLY)], ignore_index=True)


def since_before(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs in ``EARLIER`` minus MRR* of Θ⁰, which equals any initializer's MRR* in known_closed at epoch 0."""
    shown = runs[runs["scope"].isin(EARLIER)]
    inserted = ~shown["model"].isin([JOINT, FINETUNE_ONLY])
    start = shown[(shown["scope"] == "known_closed") & (shown["epoch"] == 0) & inserted]
    before = shown[CELL].join(start.drop_duplicates(CELL).set_index(CELL)["mrr_star"], on=CELL)["mrr_star"]
    return shown.assign(mrr_star=shown["mrr_star"] - before)


def curves_figure(runs: pd.DataFrame, models: Sequence[str]) -> Canvas:
    """MRR* minus MRR* before insertion, by epoch; a panel for each scope of earlier knowledge."""
    lines = [*(model for model in models if model != JOINT), FINETUNE_ONLY]
    return by_epoch(since_before(runs), lines, EARLIER, ylabel="MRR* minus before (points)")


def at_the_end(runs: pd.DataFrame) -> dict[str, list[Pair]]:
    """Pairs of contenders (and fine-tuning without insertion) at the last epoch, in points, by scope."""
    epoch, pairs = runs["epoch"].max(), {}
    last = runs[runs["epoch"] == epoch]
    ran = list(dict.fromkeys(last["model"]))
    for scope in EARLIER:
        queried = set(last.loc[last["scope"] == scope, "model"])
        compared = [model for model in (*contenders(ran), FINETUNE_ONLY) if model in queried]
        measure = {f"{SCOPES[scope]}, epoch {epoch}": 100 * stats.cells_of(last, compared, scope, "mrr_star")}
        pairs[scope] = compare(measure, compared)
    return pairs


def pairs_with(pairs: Sequence[Pair], model: str) -> dict[str, Pair]:
    """The pairs of an initializer of ISI and ``model``, by initializer."""
    return {pair.first: pair for pair in pairs if pair.second == model and isi([pair.first])}


def end_comparisons(pairs: Mapping[str, Sequence[Pair]]) -> list[tuple[str, str, list[Pair]]]:
    """ISI against Xavier and against no insertion at the last epoch: (scope, model, pairs), if there are pairs."""
    shown = (("known_closed", BASELINE), ("known", BASELINE), ("known_closed", FINETUNE_ONLY))
    lines = [(scope, model, list(pairs_with(pairs[scope], model).values())) for scope, model in shown]
    return [line for line in lines if line[2]]


def interference(runs: pd.DataFrame, models: Sequence[str]) -> list[dict[Any, Any]]:
    """Rows by model and scope of MRR* (points) about earlier knowledge: lowest, immediately, at the last epoch."""
    groups, rows = dict(list(runs.groupby(["model", "scope"]))), []
    for model, scope in (key for key in product(models, EARLIER) if key in groups):
        shown = groups[model, scope]
        lowest = 100 * shown.groupby("epoch")["mrr_star"].mean().min()
        row: dict[Any, Any] = {"model": label(model), SCOPE: scope, "lowest MRR*": lowest}
        for when, epoch in (("immediately", shown["epoch"].min()), ("at the end", shown["epoch"].max())):
            means = stats.over_seeds(shown[shown["epoch"] == epoch], ["epoch"], HALVES).iloc[0]
            row |= {Column(half, when): means[half] for half in HALVES.values()}
        rows.append(row)
    return rows


def transfer(results: Results) -> Iterator[Content]:
    """Transfer: entities of a second source are inserted into an embedding of the first source (section 6.3)."""
    for experiment in results.extended:
        settings, name, runs, figures = experiment.settings, experiment.name, experiment.immediate, {}
        extend, (size, *_), triples = settings.graph.extend, settings.sessions.sizes, experiment.triples
        assert extend is not None  # noqa: S101  # true of ``results.extended``
        base, paper = results.source_title(settings.graph.source), results.paper["transfer"]
        dropped = interference_percent(runs)
        numbers: dict[str, Any] = {
            "experiment": experiment, "base": base, "size": size, "ended": [], "order": None,
            "heldout": runs[(runs["scope"] == "novel_heldout") & (runs["model"] == JOINT)]["queries"],
            "relations": sorted(triples.loc[triples["source"] == extend.source, "relation"].unique()),
            "drops": stats.values(dropped),
        }  # fmt: skip
        epochs = epochs_summary(experiment.convergence, ["scope", "model"]).drop(columns="std")
        steps = dict(results.mined[extend.source].itertuples(index=False, name=None))
        tables: dict[str, Any] = {
            f"{name}_mined": mining_steps(steps, experiment.entities, triples, results.observed[extend.source], base,
                                   extend.min_observations, settings.sessions.steps * size),
            f"{name}_immediate": stats.by_label(experiment.models, {
                **stats.halves(runs, "all"), Column("paper", "all"): paper["all_queries"],
                **stats.halves(runs, "novel"), Column("paper", "novel"): paper["novel_queries"],
                "drop %": dropped, Column("paper", "drop %"): paper["drop"],
                **stats.by_group(epochs, CONVERGING, "epochs, {}"),
                Column("paper", "epochs"): paper["epochs"],
            }),
        }  # fmt: skip
        if experiment.curve_size is not None:
            curves = with_finetune_only(experiment)
            pairs = at_the_end(curves)
            bases = (other for other in results.standalone if other.settings.graph.source == settings.graph.source)
            first = next((other for other in bases if other.curve_size is not None), None)
            numbers |= {"ended": end_comparisons(pairs), "order": first and _order(pairs, first)}
            tables[f"{name}_at_the_end"] = pairs_table(chain(*pairs.values()))
            figures[f"figure4_{name}"] = curves_figure(curves, experiment.models)
        yield Content(numbers, tables, figures)


def _order(pairs: Mapping[str, Sequence[Pair]], base: Experiment) -> dict[str, Any] | None:
    """Whether ISI minus Xavier ends with the same sign in ``base``, which inserts entities of its own graph."""
    here, there = (pairs_with(of_scope["known_closed"], BASELINE) for of_scope in (pairs, at_the_end(base.curves)))
    both = [(here[name], there[name]) for name in here if name in there]
    turned = [new.first for new, old in both if new.difference.mean * old.difference.mean < 0]
    significant = any(new.significant or old.significant for new, old in both)
    order = {"title": base.title, "pairs": [old for _, old in both], "reversed": turned, "significant": significant}
    return order if both else None


def mining_steps(
    steps: Mapping[str, int], entities: pd.DataFrame, triples: pd.DataFrame, seen: MinedSource, base: str,
    minimum: int, inserted: int,
) -> list[dict[str, Any]]:  # fmt: skip
    """Rows of counts: the ``steps`` of mining the source ``seen``, its objects that ``base`` lacks, candidates, |ξ|."""
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


def interference_percent(runs: pd.DataFrame) -> dict[str, Estimate]:
    """Interference by initializer: per cent by which MRR* in ``known`` is below MRR* in ``known_closed``."""
    earlier = runs[runs["scope"].isin(EARLIER) & (runs["model"] != JOINT)]
    pairs = {}
    for model, rows in earlier.groupby("model"):
        cells = rows.pivot_table("mrr_star", "seed", "scope").reindex(columns=list(EARLIER))
        known, closed = (cells[[scope]].set_axis(["mrr_star"], axis=1) for scope in EARLIER)
        pairs[str(model)] = (known, closed)
    return stats.relative(pairs, sign=-1)
