"""The paper beside this run: its numbers, and the causes of the gap."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import nan
from typing import Any

import numpy as np
import pandas as pd

from isi.report import stats
from isi.report.data import Analysis, Experiment, Results, VariantRuns
from isi.report.section import Content
from isi.report.sections import choices, queries, run, transfer
from isi.report.sections.convergence import learning_curves, table2
from isi.report.tables import Column, ReportTable
from isi.report.words import BASELINE, JOINT, SCOPES, isi, joined, label

#: Where the paper has a number, what it is, the number, ours (null where there is none), and a note on ours.
Row = tuple[str, str, float, float, str]


def paper(results: Results) -> Iterator[Content]:
    """The paper's numbers beside the first graph and each other, where there is a graph of its own."""
    if not results.standalone:
        return
    first, *others = results.standalone
    columns = [Column("this run", form=shown, any_size=True)]
    columns += [Column(one.name, title=one.title, form=shown, any_size=True) for one in others]
    ours = {column: {row[:2]: row[3] for row in rows_of(results, one)}
            for column, one in zip(columns, results.standalone, strict=True)}  # fmt: skip
    table = ReportTable.of("paper_against_this_run", [
        {"where": where, "what": title, Column("paper", form=shown, any_size=True): theirs,
         **{column: ours[column].get((where, title), nan) for column in columns}, "note": note}
        for where, title, theirs, _, note in rows_of(results, first)
    ])  # fmt: skip
    yield Content({"others": others}, [table])


def shown(value: float) -> str:
    """A number of any size, as people read it."""
    value = round(value, 6)  # a mean that is whole but for its last bits
    return f"{value:,.0f}" if float(value).is_integer() else f"{value:.1f}" if abs(value) >= 1 else f"{value:.2g}"


def rows_of(results: Results, experiment: Experiment) -> list[Row]:
    """All numbers of the paper, beside one experiment: the same rows whatever was run."""
    source = experiment.settings.graph.source
    moved = next((one for one in results.extended if one.settings.graph.source == source), None)
    gain = stats.values(stats.improvements(experiment.immediate, "all"))
    fewer = stats.fewer_epochs(experiment.convergence)
    theirs, methods, title = (
        results.paper["immediate"],
        list(results.paper["indicators"]),
        "immediate gain over Xavier, all queries, %",
    )
    names = joined(map(label, methods))
    rows = [
        ("abstract", f"{title}: the figure is ES's", theirs["improvement_in_the_abstract"], gain.get("es", nan)),
        ("section 6.1", f"{title}: mean of {names}", _mean_of(theirs["improvement_over_xavier"], methods),
         _mean_of(gain, methods)),
        ("abstract", f"fewer epochs than Xavier, %: mean of {names}",
         results.paper["convergence"]["fewer_epochs_than_xavier"].get("mean", nan), _mean_of(fewer, methods)),
        *_graph(results, experiment), *_settings(results, experiment, moved),
        *_choices(results, experiment, moved),
        *_by_model("section 6.1", title, theirs["improvement_over_xavier"], gain),
        *_convergence(results.paper, experiment.convergence, fewer), *_transfer(results, moved),
        *_table3(results, experiment, moved),
    ]  # fmt: skip
    return [(*row, "") if len(row) == 4 else row for row in rows]


def _by_model(where: str, title: str, theirs: Mapping[str, float], ours: Mapping[str, float]) -> Iterator[Any]:
    for model, number in theirs.items():
        yield where, f"{label(model)}: {title}", number, ours.get(model, nan)


def _mean_of(numbers: Mapping[str, float], models: list[str]) -> float:
    """The mean over those of the models that have a number; null without any."""
    present = [numbers[model] for model in models if model in numbers]
    return sum(present) / len(present) if present else nan


def _graph(results: Results, experiment: Experiment) -> Iterator[Any]:
    """The size of the graph, and Table 1."""
    paper, words = results.paper["graph"], results.vocabulary
    entities, triples, ends = experiment.entities, experiment.triples, words["bowls_in_cabinets"]
    kinds = entities["kind"].value_counts()
    bowls = triples[np.logical_and.reduce([np.ones(len(triples), dtype=bool),
                                           *(triples[end].isin(names) for end, names in ends.items())])]  # fmt: skip
    for name, title, ours in (
        ("relations", "relations", triples["relation"].nunique()),
        ("entities", "entities", len(entities)),
        ("concepts", "household concepts: objects and rooms", kinds.reindex(words["concepts"]).sum()),
        *((kind, f"{kind}s", kinds.get(kind, 0)) for kind in paper if kind in words["kinds"]),
        ("observations", "observations (paper: over 15,000)", triples["count"].sum()),
        ("unique_triples", "unique triples", len(triples)),
        ("bowls_in_cabinets", f"observations of ({', '.join(names[0] for names in ends.values())})",
         bowls["count"].sum()),
    ):  # fmt: skip
        yield "section 5.1", title, paper[name], float(ours)
    observations, counts = results.observed[experiment.settings.graph.source].observations, pd.DataFrame()
    if observations["scene"].notna().any():
        table = run.table1(observations, paper["median_per_environment"], words["relations"])
        counts = table.frame.set_index("room")
    titles = {word: f"{word} triples, median per environment" for word in words["relations"].values()}
    titles |= {"entities": "entities, median per environment", "rooms": "rooms"}
    for room, numbers in paper["median_per_environment"].items():
        for name, title in titles.items():
            column = "object types" if name == "entities" else name
            ours = float(counts[column][room]) if room in counts.index and column in counts else nan
            yield "Table 1", f"{room}: {title}", numbers.get(name, nan), ours


def _settings(results: Results, experiment: Experiment, moved: Experiment | None) -> Iterator[Any]:
    paper, params, sessions = results.paper["settings"], results.params, experiment.settings.sessions
    least, most, share = min(sessions.sizes), max(sessions.sizes), 100 / len(experiment.entities)
    extend = moved.settings.graph.extend if moved else None
    for where, title, theirs, ours in (
        ("5.3", "repeats of each set size", paper["repeats"], sessions.seeds),
        ("6.1", "novel entities inserted together, at most", paper["largest_size"], most),
        ("6.1", "the smallest set, % of all entities", paper["shares"]["smallest"], share * least),
        ("6.1", "the largest set, % of all entities", paper["shares"]["largest"], share * most),
        ("6.2", "novel entities in the learning curves", paper["curve_size"], experiment.curve_size or nan),
        ("5.3", "margin of convergence, points of MRR*", paper["margin"], 100 * params.convergence.margin),
        ("5.3", "epochs of fine-tuning, at most", paper["max_epochs"], params.finetuning.max_epochs),
        ("5.3", "fine-tuning rate", paper["finetuning_rate"], params.finetuning.learning_rate),
        ("5.3", "ERS: candidates", paper["candidates"], params.initializers.get("ers", {}).get("candidates", nan)),
        ("6.3", "transfer: candidates", paper["transfer"]["candidates"], extend.candidates if extend else nan),
        ("6.3", "transfer: entities inserted together", paper["transfer"]["size"],
         max(moved.settings.sessions.sizes) if moved else nan),
        ("6.3", "transfer: observations, at least", paper["transfer"]["min_observations"],
         extend.min_observations if extend else nan),
        ("6.3", "transfer: repeats", paper["transfer"]["repeats"], moved.settings.sessions.seeds if moved else nan),
    ):  # fmt: skip
        yield f"section {where}", title, theirs, ours


def _of_graph(analysis: Analysis[Any] | None, *experiments: Experiment | None) -> Analysis[Any] | None:
    """An analysis of one of the experiments; None for others."""
    return analysis if analysis and analysis.experiment in experiments else None


def _choices(results: Results, experiment: Experiment, moved: Experiment | None) -> Iterator[Any]:
    """Cross-validation, and the size of the indicator set."""
    paper, choice = results.paper, results.params.settings[0].model_dump()
    words = {"dimension": "dimension", "ratio": "negatives per positive", "learning_rate": "learning rate of Θ⁰",
             "weight_decay": "weight decay of Θ⁰"}  # fmt: skip
    folds, sweep = (_of_graph(one, experiment, moved) for one in (results.cross_validation, results.sweep))
    for name, title in words.items():
        best, note = choices.best(folds.result, choice, name) if folds else (nan, "")
        yield "section 5.3", f"{title}: best in cross-validation", paper["training"][name], best, note
    rule = paper["indicators_rule"]
    for title, theirs, ours in (
        ("neighbouring sizes averaged", rule["neighbours"], choices.NEIGHBOURS),
        ("grow while so many epochs are gained", rule["epochs"], choices.EPOCHS),
        ("stop where MRR* is so many points below the best", rule["points"], 100 * choices.LOSS),
    ):
        yield "section 5.3", f"rule: {title}", theirs, ours
    means = choices.sweep_means(sweep, list(results.params.sweep.initializers))[0] if sweep else None
    picked, tops = ({}, {}) if means is None else (choices.picked_sizes(means), choices.best_sizes(means))
    yield from _by_model("section 5.3", "indicator set size that the rule picks", paper["indicators"], picked)
    title = f"indicator set size of the best immediate MRR*, {SCOPES['all']} (paper: falls beyond)"
    beyond = dict.fromkeys(paper["indicators"], paper["indicators_degrade_after"])
    yield from _by_model("section 5.3", title, beyond, tops)


def _convergence(paper: Mapping[str, Any], convergence: pd.DataFrame, fewer: Mapping[str, float]) -> Iterator[Any]:
    theirs, title = paper["convergence"], "epochs to convergence"
    for scope, which in (("all", ""), ("novel_heldout", ", on held-out triples of the novel entities instead")):
        epochs = convergence[convergence["scope"] == scope].groupby("model")["epochs"]
        means, deviations = epochs.mean(), epochs.std(ddof=1)
        for name, numbers in theirs["epochs"].items():
            for part, ours, words in (("mean", means, "mean"), ("deviation", deviations, "standard deviation")):
                yield "Table 2", f"{label(name)}: {title}, {words}{which}", numbers[part], ours.get(name, nan)
    numbers = {name: theirs["fewer_epochs_than_xavier"].get(name, nan) for name in paper["indicators"]}
    yield from _by_model("section 6.2", "fewer epochs than Xavier, %", numbers, fewer)


def _transfer(results: Results, moved: Experiment | None) -> Iterator[Any]:
    models = moved.initializers if moved else []
    means = stats.mrr_star(moved.immediate, models) if moved else {}
    for key, title, ours in (
        ("all_queries", "immediate MRR*, all queries", means.get("all", {})),
        ("novel_queries", "immediate MRR*, new entities' queries", means.get("novel", {})),
        ("epochs", "epochs to convergence after the transfer",
         stats.epochs(moved.convergence, models).get("all", {}) if moved else {}),
        ("drop", f"immediate drop of MRR* over {results.standalone[0].title}'s entities, %",
         stats.values(transfer.drops(moved.immediate)) if moved else {}),
    ):  # fmt: skip
        yield from _by_model("section 6.3", title, results.paper["transfer"][key], ours)


def _table3(results: Results, experiment: Experiment, moved: Experiment | None) -> Iterator[Any]:
    paper, settings = results.paper["affordances"], results.params.affordances
    analysis = _of_graph(results.affordances, experiment, moved)
    answers = queries.answers_of(analysis, settings.relation) if analysis else None
    title = f"of {queries.TOP * len(settings.entities)} answers shown, how many are"
    for name in (*results.paper["indicators"], BASELINE):
        who, counts = "xavier" if name == BASELINE else "isi", {}
        if answers and name in set(answers.ranks["model"]):
            counts = answers.judged(name, settings.entities, results.vocabulary["afforded"])
        for verdict, number in {"affordances": paper[who], **paper["judged"][who]}.items():
            yield "Table 3", f"{label(name)}: {title} {verdict}", number, counts.get(verdict, nan)


#: The name of a row, MRR* over all queries right after insertion, and epochs to convergence, by model.
Line = tuple[str, Mapping[str, float], Mapping[str, float]]


def causes(results: Results) -> Iterator[Content]:
    """From this run to the paper: a row for each difference between them, and Figure 3b and Table 2 under some."""
    variants, first = results.variants_of("causes"), next(iter(results.standalone), None)
    methods = isi(first.finetuned) if first else []
    if not variants or not first or first.curve_size is None or BASELINE not in first.finetuned or not methods:
        return
    lines = [*_of_main(results, first), *of_variants(results, variants)]
    rows = [*(cause_row(*line, methods) for line in lines), paper_row(results.paper, methods)]
    ours, theirs, slow = rows[:-1], rows[-1], Column(label(BASELINE), "epochs")
    most_gain, slowest = (pd.DataFrame(ours)[name].fillna(-1).to_numpy().argmax() for name in ("gain %", slow))
    curves = [(name, runs, experiment) for name, runs in variants.items() if runs.variant.full_curves
              for experiment in runs.experiments]  # fmt: skip
    numbers = {
        "methods": methods, "margin": 100 * results.params.convergence.margin,
        "curves": [(f"{name}_{experiment}", f"{runs.title}, {results.titles[experiment]}", runs.variant.size,
                    runs.max_epochs(results.params)) for name, runs, experiment in curves],
        "gain": [row["gain %"] for row in (theirs, rows[0], ours[most_gain])], "of_gain": ours[most_gain]["row"],
        "epochs": [row[slow] for row in (theirs, rows[0], ours[slowest])], "of_epochs": ours[slowest]["row"],
    }  # fmt: skip
    drawn = [item for curve in curves for item in full_curves(results, *curve)]
    yield Content(numbers, [ReportTable.of("causes", rows), *drawn])


def full_curves(results: Results, name: str, runs: VariantRuns, experiment: str) -> list[Any]:
    """Figure 3b and Table 2 under the conditions of a variant with full learning curves."""
    rows, margin = runs.runs[runs.runs["experiment"] == experiment], results.params.convergence.margin
    epochs, paper = runs.convergence(experiment, results.params), results.paper["convergence"]["epochs"]
    return [learning_curves(f"curves_{name}_{experiment}", rows, runs.initializers, margin),
            table2(f"convergence_{name}_{experiment}", epochs, runs.initializers, paper)]  # fmt: skip


def _of_main(results: Results, first: Experiment) -> Iterator[Line]:
    """The main runs as they are, at their largest size, by their entity half, and with another filter."""
    size, largest = first.curve_size, max(first.settings.sessions.sizes)
    yield (f"this run, {size} novel entities", *_at_size(first, size))
    if largest != size:
        share = 100 * largest / len(first.entities)
        yield (f"{largest} novel entities, {share:.0f} % of all", *_at_size(first, largest))
    yield "entity prediction alone", _at_size(first, size, "mrr_star_entity")[0], {}
    breakdown = results.query_breakdown.get(first.name)
    if breakdown is not None:
        rows = breakdown.queries[(breakdown.queries["scope"] == "all") & (breakdown.queries["size"] == size)]
        true = stats.combined(rows[rows["filter"] == "true"], ["model", "size", "seed"])
        yield "all true triples left out of the candidates", stats.means(true, "mrr_star"), {}


def of_variants(results: Results, variants: Mapping[str, VariantRuns]) -> Iterator[Line]:
    """The variants that were run for this, then the other graphs."""
    for runs in variants.values():
        for experiment in runs.experiments:
            epochs = runs.convergence(experiment, results.params)
            later = stats.means(epochs[epochs["scope"] == "all"], "epochs", scale=1) if runs.variant.finetuned else {}
            title = f"{runs.title} ({results.titles[experiment]})"
            yield title, stats.means(runs.immediate(experiment, "all"), "mrr_star"), later
    for one in results.standalone[1:]:
        if size := one.curve_size:
            yield (f"{one.title}, {size} novel entities", *_at_size(one, size))


def _at_size(
    experiment: Experiment, size: int | None, column: str = "mrr_star"
) -> tuple[Mapping[str, float], Mapping[str, float]]:
    """Means over all queries of one size: right after insertion, and epochs to convergence."""
    now, later = (rows[(rows["size"] == size) & (rows["scope"] == "all")]
                  for rows in (experiment.immediate, experiment.convergence))  # fmt: skip
    return stats.means(now, column), stats.means(later, "epochs", scale=1)


def cause_row(name: str, now: Mapping[str, float], later: Mapping[str, float], methods: list[str]) -> dict[Any, Any]:
    """A line as a row of the table."""
    mean, base = float(np.mean([now.get(method, nan) for method in methods])), now.get(BASELINE, nan)
    return {
        "row": name, "joint": now.get(JOINT, nan), label(BASELINE): base, "ISI": mean,
        "gain %": 100 * (mean / base - 1),
        Column(label(BASELINE), "epochs"): later.get(BASELINE, nan),
        Column("ISI", "epochs"): float(np.mean([later.get(method, nan) for method in methods])),
    }  # fmt: skip


def paper_row(paper: Mapping[str, Any], methods: list[str]) -> dict[Any, Any]:
    """The paper's own numbers as a row."""
    later = {name: numbers["mean"] for name, numbers in paper["convergence"]["epochs"].items()}
    gain = _mean_of(paper["immediate"]["improvement_over_xavier"], methods)
    return {"row": "the paper", "gain %": gain, Column(label(BASELINE), "epochs"): later.get(BASELINE, nan),
            Column("ISI", "epochs"): _mean_of(later, methods)}  # fmt: skip
