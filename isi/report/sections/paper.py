"""The paper beside this run: its numbers, the causes of the gap, and where this run decides otherwise."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import nan
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pandas as pd

from isi.report import stats
from isi.report.data import Analysis, Experiment, Results
from isi.report.models import BASELINE, JOINT, isi, label
from isi.report.section import Content
from isi.report.sections import choices, immediate, run, transfer
from isi.report.sections.convergence import learning_curves, table2
from isi.report.tables import Column, Table
from isi.report.variants import VariantRuns, of_group
from isi.report.words import SCOPES, joined, mean_of

T = TypeVar("T")


class Row(NamedTuple):
    """A number of the paper, and ours."""

    where: str
    what: str
    paper: float
    #: null where there is none
    ours: float
    #: on ours
    note: str = ""


def paper(results: Results) -> Iterator[Content]:
    """The paper's numbers beside the first graph and each other, where there is a graph of its own."""
    if not results.standalone:
        return
    others = results.standalone[1:]
    columns = [Column("this run", form=shown, any_size=True)]
    columns += [Column(one.name, title=one.title, form=shown, any_size=True) for one in others]
    rows = {column: rows_of(results, one) for column, one in zip(columns, results.standalone, strict=True)}
    values = {column: {row[:2]: row.ours for row in of_graph} for column, of_graph in rows.items()}
    table = Table.of("paper_against_this_run", [
        {"where": row.where, "what": row.what, Column("paper", form=shown, any_size=True): row.paper,
         **{column: values[column].get(row[:2], nan) for column in columns}, "note": row.note}
        for row in rows[columns[0]]
    ])  # fmt: skip
    yield Content({"others": others}, [table])


def shown(value: float) -> str:
    """A number of any size, as people read it."""
    value = round(value, 6)  # a mean that is whole but for its last bits
    return f"{value:,.0f}" if float(value).is_integer() else f"{value:.1f}" if abs(value) >= 1 else f"{value:.2g}"


@dataclass(frozen=True)
class _Graph:
    """What stands in one column: an experiment with a graph of its own, and the analyses of that graph."""

    results: Results
    experiment: Experiment

    @property
    def paper(self) -> Mapping[str, Any]:
        return self.results.paper

    @cached_property
    def gain(self) -> dict[str, float]:
        gains = stats.improvements(self.experiment.immediate, "all")
        return {model: estimate.mean for model, estimate in gains.items()}

    @cached_property
    def fewer(self) -> dict[str, float]:
        return stats.fewer_epochs(self.experiment.convergence)

    @property
    def moved(self) -> Experiment | None:
        """The first experiment that inserts entities of another source into this graph."""
        source = self.experiment.settings.graph.source
        return next((one for one in self.results.extended if one.settings.graph.source == source), None)

    def analysis(self, analysis: Analysis[T] | None) -> Analysis[T] | None:
        """An analysis of this graph, or of what was inserted into it; None for others."""
        return analysis if analysis and analysis.experiment in (self.experiment, self.moved) else None


def rows_of(results: Results, experiment: Experiment) -> list[Row]:
    """All numbers of the paper, beside one experiment: the same rows whatever was run."""
    graph = _Graph(results, experiment)
    parts: tuple[Callable[[_Graph], Iterator[Row]], ...] = (
        _abstract, _size, _table1, _settings, _analyses, _convergence, _transfer, _table3
    )  # fmt: skip
    return [row for part in parts for row in part(graph)]


def _abstract(graph: _Graph) -> Iterator[Row]:
    paper, epochs = graph.paper["immediate"], graph.paper["convergence"]["fewer_epochs_than_xavier"]
    methods, gain = list(graph.paper["indicators"]), "immediate gain over Xavier, all queries, %"
    names = joined(map(label, methods))
    yield Row(
        "abstract", f"{gain}: the figure is ES's", paper["improvement_in_the_abstract"], graph.gain.get("es", nan)
    )
    yield Row("section 6.1", f"{gain}: mean of {names}", mean_of(paper["improvement_over_xavier"], methods),
              mean_of(graph.gain, methods))  # fmt: skip
    yield Row("abstract", f"fewer epochs than Xavier, %: mean of {names}", epochs.get("mean", nan),
              mean_of(graph.fewer, methods))  # fmt: skip


def _size(graph: _Graph) -> Iterator[Row]:
    paper, words = graph.paper["graph"], graph.results.vocabulary
    entities, triples = graph.experiment.entities, graph.experiment.triples
    kinds = entities["kind"].value_counts()
    bowls, ends = triples, words["bowls_in_cabinets"]
    for end, names in ends.items():
        bowls = bowls[bowls[end].isin(names)]
    ours = {
        "relations": ("relations", triples["relation"].nunique()),
        "entities": ("entities", len(entities)),
        "concepts": ("household concepts: objects and rooms",
                     sum(int(kinds.get(kind, 0)) for kind in words["concepts"])),
        **{kind: (f"{kind}s", kinds.get(kind, 0)) for kind in paper if kind in words["kinds"]},
        "observations": ("observations (paper: over 15,000)", triples["count"].sum()),
        "unique_triples": ("unique triples", len(triples)),
        "bowls_in_cabinets": (f"observations of ({', '.join(names[0] for names in ends.values())})",
                              bowls["count"].sum()),
    }  # fmt: skip
    for name, (what, value) in ours.items():
        yield Row("section 5.1", what, paper[name], float(value))


def _table1(graph: _Graph) -> Iterator[Row]:
    paper, words = graph.paper["graph"]["median_per_environment"], graph.results.vocabulary["relations"]
    observations = graph.results.observed[graph.experiment.settings.graph.source].observations
    counts = pd.DataFrame()
    if observations["scene"].notna().any():
        counts = run.table1(observations, paper, words).frame.set_index("room")
    counted = {**{word: f"{word} triples" for word in words.values()}, "entities": "entities", "rooms": "rooms"}
    for room, numbers in paper.items():
        for name, what in counted.items():
            median = "" if name == "rooms" else ", median per environment"
            column = "object types" if name == "entities" else name
            ours = float(counts[column][room]) if room in counts.index and column in counts else nan
            yield Row("Table 1", f"{room}: {what}{median}", numbers.get(name, nan), ours)


def _settings(graph: _Graph) -> Iterator[Row]:
    paper, params, sessions = graph.paper["settings"], graph.results.params, graph.experiment.settings.sessions
    least, most, share = min(sessions.sizes), max(sessions.sizes), 100 / len(graph.experiment.entities)
    candidates = params.initializers.get("ers", {}).get("candidates", nan)
    moved = graph.moved.settings if graph.moved else None
    extend = moved.graph.extend if moved else None
    size = max(moved.sessions.sizes) if moved else nan
    for where, what, theirs, ours in (
        ("5.3", "repeats of each set size", paper["repeats"], sessions.seeds),
        ("6.1", "novel entities inserted together, at most", paper["largest_size"], most),
        ("6.1", "the smallest set, % of all entities", paper["shares"]["smallest"], share * least),
        ("6.1", "the largest set, % of all entities", paper["shares"]["largest"], share * most),
        ("6.2", "novel entities in the learning curves", paper["curve_size"], graph.experiment.curve_size or nan),
        ("5.3", "margin of convergence, points of MRR*", paper["margin"], 100 * params.convergence.margin),
        ("5.3", "epochs of fine-tuning, at most", paper["max_epochs"], params.finetuning.max_epochs),
        ("5.3", "fine-tuning rate", paper["finetuning_rate"], params.finetuning.learning_rate),
        ("5.3", "ERS: candidates", paper["candidates"], candidates),
        ("6.3", "transfer: candidates", paper["transfer"]["candidates"], extend.candidates if extend else nan),
        ("6.3", "transfer: entities inserted together", paper["transfer"]["size"], size),
        ("6.3", "transfer: observations, at least", paper["transfer"]["min_observations"],
         extend.min_observations if extend else nan),
        ("6.3", "transfer: repeats", paper["transfer"]["repeats"], moved.sessions.seeds if moved else nan),
    ):  # fmt: skip
        yield Row(f"section {where}", what, theirs, ours)


def _analyses(graph: _Graph) -> Iterator[Row]:
    """Cross-validation, the size of the indicator set, and gains over Xavier."""
    results, paper = graph.results, graph.paper
    words = {"dimension": "dimension", "ratio": "negatives per positive", "learning_rate": "learning rate of Θ⁰",
             "weight_decay": "weight decay of Θ⁰"}  # fmt: skip
    folds, choice = graph.analysis(results.cross_validation), results.params.settings[0].model_dump()
    for name, what in words.items():
        best = choices.best(folds.result, choice, name) if folds else nan
        note = choices.note(folds.result, choice, name) if folds else ""
        yield Row("section 5.3", f"{what}: best in cross-validation", paper["training"][name], best, note)
    rule = paper["indicators_rule"]
    yield Row("section 5.3", "rule: neighbouring sizes averaged", rule["neighbours"], choices.NEIGHBOURS)
    yield Row("section 5.3", "rule: grow while so many epochs are gained", rule["epochs"], choices.EPOCHS)
    yield Row(
        "section 5.3", "rule: stop where MRR* is so many points below the best", rule["points"], 100 * choices.LOSS
    )
    sweep = graph.analysis(results.sweep)
    means = choices.sweep_means(sweep, list(results.params.sweep.initializers)) if sweep else None
    picked, tops = ({}, {}) if means is None else (choices.picked_sizes(means), choices.best_sizes(means))
    for name, theirs in paper["indicators"].items():
        yield Row(
            "section 5.3", f"{label(name)}: indicator set size that the rule picks", theirs, picked.get(name, nan)
        )
    for name in paper["indicators"]:
        what = f"{label(name)}: indicator set size of the best immediate MRR*, {SCOPES['all']} (paper: falls beyond)"
        yield Row("section 5.3", what, paper["indicators_degrade_after"], tops.get(name, nan))
    for name, theirs in paper["immediate"]["improvement_over_xavier"].items():
        what = f"{label(name)}: immediate gain over Xavier, all queries, %"
        yield Row("section 6.1", what, theirs, graph.gain.get(name, nan))


def _convergence(graph: _Graph) -> Iterator[Row]:
    paper, cells = graph.paper["convergence"], graph.experiment.convergence
    scopes = {"all": "", "novel_heldout": ", on held-out triples of the novel entities instead"}
    for scope, which in scopes.items():
        epochs = cells[cells["scope"] == scope].groupby("model")["epochs"]
        means, deviation = epochs.mean(), epochs.std(ddof=1)
        for name, numbers in paper["epochs"].items():
            what = f"{label(name)}: epochs to convergence"
            yield Row("Table 2", f"{what}, mean{which}", numbers["mean"], means.get(name, nan))
            yield Row("Table 2", f"{what}, standard deviation{which}", numbers["deviation"], deviation.get(name, nan))
    for name in graph.paper["indicators"]:
        theirs = paper["fewer_epochs_than_xavier"].get(name, nan)
        yield Row("section 6.2", f"{label(name)}: fewer epochs than Xavier, %", theirs, graph.fewer.get(name, nan))


def _transfer(graph: _Graph) -> Iterator[Row]:
    paper, moved = graph.paper["transfer"], graph.moved
    models = moved.initializers if moved else []
    means = stats.mrr_star(moved.immediate, models) if moved else {}
    epochs = stats.epochs(moved.convergence, models) if moved else {}
    drops = {name: drop.mean for name, drop in transfer.drops(moved.immediate).items()} if moved else {}
    parts = (
        ("all_queries", "immediate MRR*, all queries", means.get("all", {})),
        ("novel_queries", "immediate MRR*, new entities' queries", means.get("novel", {})),
        ("epochs", "epochs to convergence after the transfer", epochs.get("all", {})),
        ("drop", f"immediate drop of MRR* over {graph.results.standalone[0].title}'s entities, %", drops),
    )
    for key, what, ours in parts:
        for name, number in paper[key].items():
            yield Row("section 6.3", f"{label(name)}: {what}", number, ours.get(name, nan))


def _table3(graph: _Graph) -> Iterator[Row]:
    paper, settings = graph.paper["affordances"], graph.results.params.affordances
    analysis, judged = graph.analysis(graph.results.affordances), graph.results.vocabulary["afforded"]
    answers = immediate.answers_of(analysis, settings.relation) if analysis else None
    for name in (*graph.paper["indicators"], BASELINE):
        who = "xavier" if name == BASELINE else "isi"
        ran = answers is not None and name in set(answers.ranks["model"])
        counts = answers.judged(name, settings.entities, judged) if answers and ran else {}
        what = f"{label(name)}: of {immediate.TOP * len(settings.entities)} answers shown, how many are"
        for verdict, number in {"affordances": paper[who], **paper["judged"][who]}.items():
            yield Row("Table 3", f"{what} {verdict}", number, counts.get(verdict, nan))


def causes(results: Results) -> Iterator[Content]:
    """From this run to the paper: a row for each difference between them, and Figure 3b and Table 2 under some."""
    found, first = of_group(results.variants, "causes"), next(iter(results.standalone), None)
    if not found or first is None or first.curve_size is None or BASELINE not in first.finetuned:
        return
    methods = isi(first.finetuned)
    if not methods:
        return
    rows = [cause_row(*line, methods) for line in (*of_main(results, first), *of_variants(results, found))]
    rows.append(paper_row(results.paper, methods))
    ours, theirs, slow = rows[:-1], rows[-1], Column(label(BASELINE), "epochs")
    most_gain, slowest = (pd.DataFrame(ours)[name].fillna(-1).to_numpy().argmax() for name in ("gain %", slow))
    margin, shown, curves = results.params.convergence.margin, [Table.of("causes", rows)], []
    for name, runs in found.items():
        for experiment in runs.experiments if runs.variant.full_curves else ():
            titled = f"{runs.title}, {results.titles[experiment]}"
            curves.append((f"{name}_{experiment}", titled, runs.variant.size, runs.max_epochs(results.params)))
            shown += full_curves(results, name, runs, experiment)
    numbers = {
        "methods": methods, "curves": curves, "margin": 100 * margin,
        "gain": [row["gain %"] for row in (theirs, rows[0], ours[most_gain])], "of_gain": ours[most_gain]["row"],
        "epochs": [row[slow] for row in (theirs, rows[0], ours[slowest])], "of_epochs": ours[slowest]["row"],
    }  # fmt: skip
    yield Content(numbers, shown)


def full_curves(results: Results, name: str, runs: VariantRuns, experiment: str) -> list[Any]:
    """Figure 3b and Table 2 under the conditions of a variant with full learning curves."""
    rows, margin = runs.runs[runs.runs["experiment"] == experiment], results.params.convergence.margin
    cells, paper = runs.convergence(experiment, results.params), results.paper["convergence"]["epochs"]
    return [learning_curves(f"curves_{name}_{experiment}", rows, runs.initializers, margin),
            table2(f"convergence_{name}_{experiment}", cells, runs.initializers, paper)]  # fmt: skip


#: The name of a row, MRR* over all queries right after insertion, and epochs to convergence, by model.
Line = tuple[str, Mapping[str, float], Mapping[str, float]]


def of_main(results: Results, first: Experiment) -> Iterator[Line]:
    """The main runs as they are, at their largest size, by their entity half, and with another filter."""
    size, largest = first.curve_size, max(first.settings.sessions.sizes)
    yield f"this run, {size} novel entities", _immediate(first, size), _epochs(first, size)
    if largest != size:
        share = 100 * largest / len(first.entities)
        yield f"{largest} novel entities, {share:.0f} % of all", _immediate(first, largest), _epochs(first, largest)
    yield "entity prediction alone", _immediate(first, size, "mrr_star_entity"), {}
    breakdown = results.query_breakdown.get(first.name)
    if breakdown is not None:
        queries = breakdown.queries[(breakdown.queries["scope"] == "all") & (breakdown.queries["size"] == size)]
        cells = stats.combined(queries[queries["filter"] == "true"], ["model", "size", "seed"])
        yield "all true triples left out of the candidates", _means(cells, "mrr_star"), {}


def of_variants(results: Results, found: Mapping[str, VariantRuns]) -> Iterator[Line]:
    """The variants that were run for this, then the other graphs."""
    for runs in found.values():
        for experiment in runs.experiments:
            cells = runs.convergence(experiment, results.params)
            epochs = _means(cells[cells["scope"] == "all"], "epochs", scale=1) if runs.variant.finetuned else {}
            title = f"{runs.title} ({results.titles[experiment]})"
            yield title, _means(runs.immediate(experiment, "all"), "mrr_star"), epochs
    for one in results.standalone[1:]:
        if size := one.curve_size:
            yield f"{one.title}, {size} novel entities", _immediate(one, size), _epochs(one, size)


def _immediate(experiment: Experiment, size: int | None, column: str = "mrr_star") -> dict[str, float]:
    runs = experiment.immediate
    return _means(runs[(runs["size"] == size) & (runs["scope"] == "all")], column)


def _epochs(experiment: Experiment, size: int | None) -> dict[str, float]:
    cells = experiment.convergence
    return _means(cells[(cells["size"] == size) & (cells["scope"] == "all")], "epochs", scale=1)


def _means(cells: pd.DataFrame, column: str, scale: float = 100) -> dict[str, float]:
    return {str(model): scale * float(value) for model, value in cells.groupby("model")[column].mean().items()}


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
    gain = mean_of(paper["immediate"]["improvement_over_xavier"], methods)
    return {"row": "the paper", "gain %": gain, Column(label(BASELINE), "epochs"): later.get(BASELINE, nan),
            Column("ISI", "epochs"): mean_of(later, methods)}  # fmt: skip
