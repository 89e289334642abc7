"""The paper against this run: the numbers of both, and the causes of the gap."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from math import nan
from typing import Any

import numpy as np
import pandas as pd

from isi.report import stats
from isi.report.data import Experiment, ModelRuns, Results, VariantRuns
from isi.report.figures import by_epoch
from isi.report.section import Content
from isi.report.sections import choices, queries, run
from isi.report.sections.finetuning import CURVES, interference_percent, table2
from isi.report.tables import Column
from isi.report.words import BASELINE, JOINT, SCOPES, isi, joined, label

#: Place of a number in the paper, its title, the paper's number, ours (NaN if there is none), and a note on ours.
Row = tuple[str, str, float, float, str]


def paper(results: Results) -> Iterator[Content]:
    """The paper's numbers beside those of each standalone experiment; nothing without one."""
    if not results.standalone:
        return
    first, *others = results.standalone
    columns = {"paper": "", "this run": ""} | {experiment.name: experiment.title for experiment in others}
    rows = rows_of(results, first)
    ours = [{row[:2]: row[3] for row in rows_of(results, experiment)} for experiment in others]
    yield Content({"others": others}, {"paper_against_this_run": [
        {"where": where, "what": title, **{
            Column(name, title=header, form=shown, any_size=True): number for (name, header), number in
            zip(columns.items(), [*numbers, *(values.get((where, title), nan) for values in ours)], strict=True)
        }, "note": note} for where, title, *numbers, note in rows
    ]})  # fmt: skip


def shown(value: float) -> str:
    """A number as text: whole, with one decimal from 1 up, else with two significant digits."""
    value = round(value, 6)  # a mean may miss a whole number by its last bits
    return f"{value:,.0f}" if float(value).is_integer() else f"{value:.1f}" if abs(value) >= 1 else f"{value:.2g}"


def rows_of(results: Results, experiment: Experiment) -> list[Row]:
    """All numbers of the paper beside those of one experiment; the rows do not depend on what was run."""
    source, paper, methods = experiment.settings.graph.source, results.paper, list(results.paper["indicators"])
    moved = next((other for other in results.extended if other.settings.graph.source == source), None)
    gain, fewer = stats.values(stats.improvements(experiment.immediate, "all")), fewer_epochs(experiment)
    theirs, saved = paper["immediate"]["improvement_over_xavier"], paper["convergence"]["fewer_epochs_than_xavier"]
    title, names = "immediate gain over Xavier, all queries, %", joined(map(label, methods))
    means, dropped = (moved.mrr_star, stats.values(interference_percent(moved.immediate))) if moved else ({}, {})
    gained = ("section 6.1", title, theirs, gain)
    later = (
        ("section 6.2", "fewer epochs than Xavier, %", {name: saved.get(name, nan) for name in methods}, fewer),
        *(("section 6.3", words, paper["transfer"][key], ours) for key, words, ours in (
            ("all_queries", "immediate MRR*, all queries", means.get("all", {})),
            ("novel_queries", "immediate MRR*, new entities' queries", means.get("novel", {})),
            ("epochs", "epochs to convergence after the transfer", moved.epochs().get("all", {}) if moved else {}),
            ("drop", f"immediate drop of MRR* over {results.standalone[0].title}'s entities, %", dropped))),
    )  # fmt: skip
    rows = [
        ("abstract", f"{title}: the figure is ES's", paper["immediate"]["improvement_in_the_abstract"],
         gain.get("es", nan)),
        ("section 6.1", f"{title}: mean of {names}", _mean_of(theirs, methods), _mean_of(gain, methods)),
        ("abstract", f"fewer epochs than Xavier, %: mean of {names}", saved.get("mean", nan), _mean_of(fewer, methods)),
        *_graph(results, experiment), *_settings(results, experiment, moved), *_choices(results, experiment, moved),
        *_by_model(gained), *_table2(paper["convergence"]["epochs"], experiment.convergence), *_by_model(*later),
        *_table3(results, experiment, moved),
    ]  # fmt: skip
    return [(*row, "") if len(row) == 4 else row for row in rows]


def fewer_epochs(experiment: Experiment) -> dict[str, float]:
    """Per cent by which each initializer's mean epochs to convergence are below Xavier's (section 6.2)."""
    epochs = experiment.epochs().get("all", {})
    base = epochs.get(BASELINE)
    return {model: 100 * (1 - mean / base) for model, mean in epochs.items()} if base else {}


def _by_model(*parts: tuple[str, str, Mapping[str, float], Mapping[str, float]]) -> Iterator[Any]:
    """A row for each model with a number in the paper; parts: place, title, the paper's numbers by model, ours."""
    for where, title, theirs, ours in parts:
        for model, number in theirs.items():
            yield where, f"{label(model)}: {title}", number, ours.get(model, nan)


def _mean_of(numbers: Mapping[str, float], models: Sequence[str]) -> float:
    """The mean over the models that have a number; NaN if none has one."""
    present = [numbers[model] for model in models if model in numbers]
    return sum(present) / len(present) if present else nan


def _graph(results: Results, experiment: Experiment) -> Iterator[Any]:
    """The size of the graph, and Table 1."""
    paper, words = results.paper["graph"], results.vocabulary
    entities, triples, ends = experiment.entities, experiment.triples, words["bowls_in_cabinets"]
    kinds, bowls = entities["kind"].value_counts(), triples
    for end, names in ends.items():
        bowls = bowls[bowls[end].isin(names)]
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
        counts = run.table1(observations, paper["median_per_environment"], words["relations"]).set_index("room")
    titles = {word: f"{word} triples, median per environment" for word in words["relations"].values()}
    titles |= {"entities": "entities, median per environment", "rooms": "rooms"}
    counts = counts.rename(columns={"object types": "entities"})
    for (room, numbers), (name, title) in product(paper["median_per_environment"].items(), titles.items()):
        ours = float(counts[name][room]) if room in counts.index and name in counts else nan
        yield "Table 1", f"{room}: {title}", numbers.get(name, nan), ours


def _settings(results: Results, experiment: Experiment, moved: Experiment | None) -> Iterator[Any]:
    paper, params, sessions = results.paper["settings"], results.params, experiment.settings.sessions
    least, most, share = min(sessions.sizes), max(sessions.sizes), 100 / len(experiment.entities)
    added: dict[str, Any] = {}
    if moved and moved.settings.graph.extend:
        inserted = moved.settings.sessions
        added = moved.settings.graph.extend.model_dump() | {"size": max(inserted.sizes), "repeats": inserted.seeds}
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
        *(("6.3", f"transfer: {title}", paper["transfer"][name], added.get(name, nan)) for name, title in (
            ("candidates", "candidates"), ("size", "entities inserted together"),
            ("min_observations", "observations, at least"), ("repeats", "repeats"))),
    ):  # fmt: skip
        yield f"section {where}", title, theirs, ours


def _analysis(name: str, *experiments: Experiment | None) -> tuple[Experiment, Any] | None:
    """The first of the experiments for which an analysis was run, and its result."""
    ran = (experiment for experiment in experiments if experiment and name in experiment.analyses)
    return next(((experiment, experiment.analyses[name]) for experiment in ran), None)


def _choices(results: Results, experiment: Experiment, moved: Experiment | None) -> Iterator[Any]:
    """Rows on cross-validation and the indicator set size: as ``Row``, but the note may be missing."""
    paper, choice = results.paper, results.params.settings[0].model_dump()
    words = {"dimension": "dimension", "ratio": "negatives per positive", "learning_rate": "learning rate of Θ⁰",
             "weight_decay": "weight decay of Θ⁰"}  # fmt: skip
    folds, sweep = (_analysis(name, experiment, moved) for name in ("cross_validation", "sweep"))
    for name, title in words.items():
        best, note = choices.best(folds[1], choice, name) if folds else (nan, "")
        yield "section 5.3", f"{title}: best in cross-validation", paper["training"][name], best, note
    rule = paper["indicators_rule"]
    for title, theirs, ours in (
        ("neighbouring sizes averaged", rule["neighbours"], choices.NEIGHBOURS),
        ("grow while so many epochs are gained", rule["epochs"], choices.EPOCHS),
        ("stop where MRR* is so many points below the best", rule["points"], 100 * choices.LOSS),
    ):
        yield "section 5.3", f"rule: {title}", theirs, ours
    picked, tops = dict[str, int](), dict[str, int]()
    if sweep:
        (swept, runs), models = sweep, list(results.params.sweep.initializers)
        means = choices.means_of(runs[runs["epoch"] == 0], swept.converged(runs, ["model", "k"]), models)
        picked, mrr_star = choices.picked_sizes(means), means[Column("MRR*", "all")].dropna()
        tops = {model: int(mrr_star[model].idxmax()) for model in mrr_star.index.unique("model")}
    title = f"indicator set size of the best immediate MRR*, {SCOPES['all']} (paper: falls beyond)"
    beyond = dict.fromkeys(paper["indicators"], paper["indicators_degrade_after"])
    yield from _by_model(
        ("section 5.3", "indicator set size that the rule picks", paper["indicators"], picked),
        ("section 5.3", title, beyond, tops),
    )


def _table2(paper: Mapping[str, Any], convergence: pd.DataFrame) -> Iterator[Any]:
    for scope, which in (("all", ""), ("novel_heldout", ", on held-out triples of the novel entities instead")):
        epochs = convergence[convergence["scope"] == scope].groupby("model")["epochs"]
        parts = (("mean", epochs.mean(), "mean"), ("deviation", epochs.std(ddof=1), "standard deviation"))
        for (name, numbers), (part, ours, words) in product(paper.items(), parts):
            yield "Table 2", f"{label(name)}: epochs to convergence, {words}{which}", numbers[part], ours.get(name, nan)


def _table3(results: Results, experiment: Experiment, moved: Experiment | None) -> Iterator[Any]:
    paper, entities = results.paper["affordances"], results.params.affordances.entities
    analysis = _analysis("affordances", experiment, moved)
    answers = queries.Answers.of(analysis[0]) if analysis else None
    title = f"of {queries.TOP * len(entities)} answers shown, how many are"
    for name in (*results.paper["indicators"], BASELINE):
        who, ran = "xavier" if name == BASELINE else "isi", answers and name in set(answers.ranks["model"])
        counts = answers.judged(name, entities, results.vocabulary["afforded"]) if answers and ran else {}
        for verdict, number in {"affordances": paper[who], **paper["judged"][who]}.items():
            yield "Table 3", f"{label(name)}: {title} {verdict}", number, counts.get(verdict, nan)


#: The name of a row, MRR* over all queries right after insertion, and epochs to convergence, by model.
Line = tuple[str, Mapping[str, float], Mapping[str, float]]


def causes(results: Results) -> Iterator[Content]:
    """Causes of the gap to the paper: a row for each changed setting; Figure 3b and Table 2 for full curves."""
    variants, first = results.variants_of("causes"), next(iter(results.standalone), None)
    methods = isi(first.finetuned) if first else []
    if not variants or not first or first.curve_size is None or BASELINE not in first.finetuned or not methods:
        return
    paper, margin = results.paper["convergence"]["epochs"], results.params.convergence.margin
    xavier, epochs = Column(label(BASELINE), "epochs"), {name: numbers["mean"] for name, numbers in paper.items()}
    rows = list[dict[Any, Any]]()
    for name, now, later in _lines(results, first, variants):
        mean, mean_epochs = (float(np.mean([values.get(method, nan) for method in methods])) for values in (now, later))
        base = now.get(BASELINE, nan)
        rows.append({"row": name, "joint": now.get(JOINT, nan), label(BASELINE): base, "ISI": mean,
                     "gain %": 100 * (mean / base - 1), xavier: later.get(BASELINE, nan),
                     Column("ISI", "epochs"): mean_epochs})  # fmt: skip
    gain = _mean_of(results.paper["immediate"]["improvement_over_xavier"], methods)
    theirs = {"row": "the paper", "gain %": gain, xavier: epochs.get(BASELINE, nan),
              Column("ISI", "epochs"): _mean_of(epochs, methods)}  # fmt: skip
    most_gain, slowest = (pd.DataFrame(rows)[name].fillna(-1).to_numpy().argmax() for name in ("gain %", xavier))
    curves = [runs for runs in variants if runs.variant.full_curves]
    numbers = {
        "methods": methods, "curves": curves,
        "gain": [row["gain %"] for row in (theirs, rows[0], rows[most_gain])], "of_gain": rows[most_gain]["row"],
        "epochs": [row[xavier] for row in (theirs, rows[0], rows[slowest])], "of_epochs": rows[slowest]["row"],
    }  # fmt: skip
    tables = {f"convergence_{runs.id}": table2(runs.convergence, runs.initializers, paper) for runs in curves}
    figures = {f"curves_{runs.id}": by_epoch(runs.runs, runs.initializers, CURVES, margin=margin) for runs in curves}
    yield Content(numbers, {"causes": [*rows, theirs], **tables}, figures)


def _lines(results: Results, first: Experiment, variants: Sequence[VariantRuns]) -> Iterator[Line]:
    """Lines of the first graph: two sizes, entity MRR*, filter ``true``; then of variants and of other graphs."""
    size, largest = first.curve_size, max(first.settings.sessions.sizes)
    main = first.of_size(size)
    yield _line(f"this run, {size} novel entities", main)
    if largest != size:
        share = 100 * largest / len(first.entities)
        yield _line(f"{largest} novel entities, {share:.0f} % of all", first.of_size(largest))
    yield "entity prediction alone", _line("", main, "mrr_star_entity")[1], {}
    if main.queries is not None:
        true = main.queries[(main.queries["scope"] == "all") & (main.queries["filter"] == "true")]
        means = stats.means(stats.combined(true, ["model", "size", "seed"]), "mrr_star")
        yield "all true triples left out of the candidates", means, {}
    for runs in variants:
        title, now, later = _line(f"{runs.variant.title} ({runs.title})", runs)
        yield title, now, later if runs.variant.finetuned else {}
    for experiment in results.standalone[1:]:
        if size := experiment.curve_size:
            yield _line(f"{experiment.title}, {size} novel entities", experiment.of_size(size))


def _line(title: str, runs: ModelRuns, column: str = "mrr_star") -> Line:
    now, later = (rows[rows["scope"] == "all"] for rows in (runs.immediate, runs.convergence))
    return title, stats.means(now, column), stats.means(later, "epochs", scale=1)
