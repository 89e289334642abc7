"""What initializers answer right after insertion, what fine-tuning costs, and what it takes from
earlier knowledge (sections 6.1 to 6.3).
"""

from collections.abc import Sequence
from typing import Any

import pandas as pd

from stages.build_graph import mined, new_entities
from stages.grid import JOINT_MODEL
from stages.mine import MINED
from stages.report.scopes import DIRECTIONS, EARLIER, GROUPED, TITLES
from stages.report.tables.data import NOT_INSERTED, Experiment, Results, Runs
from stages.report.tables.estimates import (
    BASELINE,
    CELL,
    MEASURES,
    TableRow,
    bounded,
    compare,
    epochs_summary,
    named,
    over_seeds,
    where,
)
from stages.report.tables.registry import of_each, table

#: Points of MRR by which equal rankings may differ: near ties of scores fall either way.
EQUAL = 0.01
#: The parts of the gain from Xavier on, each with the control that has it; an initializer of ISI
#: has the last, too.
STEPS = (("centre", "mean"), ("kind", "kind_mean"))
SEMANTICS = "words and facts"


# Right after insertion


@table("report")
@of_each("standalone")
def immediate(_: Results, experiment: Experiment) -> pd.DataFrame:
    """The measure right after insertion by group, in both forms: without and with counts."""
    forms = {name: MEASURES[name] for name in ("mrr", "mrr_star")}
    rows = where(experiment.immediate, scope=GROUPED)
    means = over_seeds(rows, ["scope", "model"], forms)
    scopes = [scope for scope in GROUPED if scope in means.index]
    columns = {scope: pd.DataFrame(means.loc[scope]) for scope in scopes}
    return experiment.models.by_label(experiment.rows, columns)


@table("report")
@of_each("standalone")
def immediate_by_size(_: Results, experiment: Experiment) -> pd.DataFrame:
    """The measure right after insertion by number of novel entities."""
    rows = where(experiment.immediate, scope=GROUPED)
    means = over_seeds(rows, ["scope", "size", "model"], MEASURES)
    return experiment.models.in_rows(means, experiment.rows, scope=GROUPED)


@table("report")
@of_each("standalone")
def scopes(_: Results, experiment: Experiment) -> pd.DataFrame:
    """MRR right after insertion by scope; with known candidates alone, a new vector changes
    nothing, so one row says it.
    """
    means = over_seeds(experiment.immediate, ["scope", "model"], MEASURES)
    rows = experiment.models.in_rows(means, experiment.rows, scope=list(TITLES))
    joint = experiment.models.labels[JOINT_MODEL]
    closed = (rows["scope"] == "known_closed") & (rows["model"] != joint)
    values = rows.loc[closed, list(MEASURES.values())]
    if not len(values) or (values.max() - values.min() > EQUAL).any():
        return rows
    rows.loc[values.index[0], "model"] = "Any initializer"
    return rows.drop(values.index[1:])


@table("report")
@of_each("standalone")
def gains(results: Results, experiment: Experiment) -> pd.DataFrame | None:
    """Gain over Xavier, as a ratio of the means over sizes and as a mean of the sizes' ratios, in
    both forms of the measure.
    """
    if BASELINE not in experiment.initializers:
        return None
    forms = {"mrr": "", "mrr_star": f"{MEASURES['mrr_star']}: "}
    of_forms = {form: experiment.statistics(form) for form in forms}
    rows = list[TableRow]()
    for model in experiment.initializers:
        if model == BASELINE:
            continue
        row: TableRow = {"initializer": experiment.models.labels[model]}
        for form, title in forms.items():
            of_form = of_forms[form]
            row |= bounded(f"{title}gain, %", of_form.gain(model))
            row |= bounded(f"{title}mean of the sizes' gains, %", of_form.gain_by_size(model))
        if experiment is results.on(papers=True):
            paper = results.paper["immediate"]["improvement_over_xavier"]
            row["paper"] = paper.get(model)
        rows.append(row)
    return pd.DataFrame(rows)


@table("report")
@of_each("standalone")
def differences(_: Results, experiment: Experiment) -> pd.DataFrame | None:
    """All pairs of initializers in the headline measures, with tests."""
    if len(experiment.initializers) < 2:
        return None
    measures = {f"MRR, {TITLES[scope]}": experiment.by_run(scope) for scope in GROUPED}
    measures["entity prediction, novel entities"] = experiment.by_run("novel", "mrr_entity")
    pairs = compare(measures, experiment.initializers, experiment.methods)
    if len(experiment.finetuned) > 1:
        cells = experiment.convergence.pivot(index=CELL, columns="model", values="epochs")
        methods = experiment.models.of_role(experiment.finetuned, "isi")
        of_epochs = compare({"epochs to convergence": cells}, experiment.finetuned, methods)
        pairs = pd.concat([pairs, of_epochs], ignore_index=True)
    return experiment.models.labelled(pairs, "first", "second")


# What the gain consists of


def steps(method: str, models: Sequence[str]) -> list[tuple[str, str, str]]:
    """Steps from Xavier over the controls that were run to ``method``: part, model with it, model
    without it.
    """
    path, names, before = list[tuple[str, str, str]](), list[str](), BASELINE
    for name, model in (*STEPS, (SEMANTICS, method)):
        names.append(name)
        if model in models:
            path.append((" and ".join(names), model, before))
            names, before = [], model
    return path


@table("report")
@of_each("standalone")
def answer_parts(_: Results, experiment: Experiment) -> pd.DataFrame | None:
    """What the gain of the best of ISI consists of, in both groups together and about novel
    entities: bars from ``start`` to ``end`` in points, and what each part adds.
    """
    best = best_method(experiment)
    if best is None or BASELINE not in experiment.initializers:
        return None
    labels, initializers = experiment.models.labels, experiment.initializers
    rows = list[tuple[str, str, float, float]]()
    for scope in ("weighted", "novel"):
        means = experiment.means(scope)["mean"].reindex(experiment.rows)
        rows.append((scope, labels[BASELINE], 0.0, means[BASELINE]))
        for part, model, before in steps(best, initializers):
            rows.append((scope, part, means[before], means[model]))
        others = means[experiment.models.of_role(initializers, "baseline", "own")]
        for name in (best, *others.nlargest(1).index, JOINT_MODEL):
            rows.append((scope, labels[name], means[name], means[name]))
    frame = pd.DataFrame(rows, columns=["scope", "part", "start", "end"])
    adds = (frame["end"] - frame["start"]).where(frame["end"] != frame["start"])
    return frame.assign(adds=adds)


def best_method(runs: Runs) -> str | None:
    """The initializer of ISI with the highest MRR about novel entities."""
    means = runs.means("novel")["mean"].reindex(runs.methods).dropna()
    return str(means.idxmax()) if len(means) else None


@table("report")
@of_each("standalone")
def directions(_: Results, experiment: Experiment) -> pd.DataFrame | None:
    """Entity MRR about novel entities: with the entity given, and with it as the answer."""
    if experiment.directed.empty:
        return None
    columns = dict[str, Any]()
    for name, title in DIRECTIONS.items():
        columns |= named(experiment.means(name), "mean", title)
    return experiment.models.by_label(experiment.rows, columns)


# Fine-tuning


@table("report")
@of_each("standalone")
def table2_convergence(results: Results, experiment: Experiment) -> pd.DataFrame | None:
    """Table 2: epochs to convergence over all sizes, beside the paper's."""
    if not experiment.finetuned:
        return None
    summary = epochs_summary(experiment.convergence, ["model"])
    frame = experiment.models.by_label(experiment.finetuned, {"": summary}, "initializer")
    if experiment is results.on(papers=True):
        theirs = pd.DataFrame(results.paper["convergence"]["epochs"]).T
        theirs = theirs.reindex(experiment.finetuned)
        frame.insert(5, "paper: mean", theirs["mean"].to_numpy())
        frame.insert(6, "paper: deviation", theirs["deviation"].to_numpy())
    return frame


@table("report")
@of_each("standalone")
def curves(_: Results, experiment: Experiment) -> pd.DataFrame | None:
    """Learning curves at one size (Figure 3b)."""
    return by_epoch(experiment)


@table("report")
@of_each("extended")
def curves_transfer(_: Results, experiment: Experiment) -> pd.DataFrame | None:
    """Learning curves of the transfer (Figure 4)."""
    return by_epoch(experiment)


def by_epoch(experiment: Experiment) -> pd.DataFrame | None:
    """MRR (points) by epoch of fine-tuning, with its interval: the first ten epochs, then every
    fifth; earlier knowledge also as a change since before the insertion.
    """
    runs, by = experiment.curves, ["scope", "model", "epoch"]
    if runs.empty:
        return None
    shown = runs[(runs["epoch"] <= 10) | (runs["epoch"] % 5 == 0)]
    means = over_seeds(shown, by, {"mrr": "MRR"})
    means = means.join(over_seeds(since_before(shown), by, {"mrr": "change"}))
    models = [*experiment.rows, NOT_INSERTED]
    return experiment.models.in_rows(means, models, scope=list(TITLES))


def since_before(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs in ``EARLIER`` minus MRR of Θ⁰, which equals any initializer's MRR in known_closed at
    epoch 0.
    """
    shown = where(runs, scope=EARLIER)
    inserted = ~shown["model"].isin([JOINT_MODEL, NOT_INSERTED])
    start = shown[(shown["scope"] == "known_closed") & (shown["epoch"] == 0) & inserted]
    before = start.drop_duplicates(CELL).set_index(CELL)["mrr"].rename("before")
    return shown.assign(mrr=shown["mrr"] - shown.join(before, on=CELL)["before"])


# From simulation to real homes


@table("report")
@of_each("extended")
def transfer_immediate(results: Results, experiment: Experiment) -> pd.DataFrame:
    """MRR right after the transfer and epochs to convergence (section 6.3), with the paper's."""
    of_paper = experiment is results.on(papers=True, extended=True)
    theirs = results.paper["transfer"] if of_paper else {}
    statistics, rows = experiment.statistics(), list[TableRow]()
    epochs = epochs_summary(experiment.convergence, ["model"]) if experiment.finetuned else None
    for model in experiment.rows:
        row: TableRow = {"model": experiment.models.labels[model]}
        row |= bounded("weighted: MRR", statistics.weighted(model))
        row |= bounded("weighted: by the paper's weights", statistics.by_papers_share(model))
        row["weighted: paper"] = theirs.get("all_queries", {}).get(model)
        row |= bounded("novel: MRR", statistics.novel(model))
        row["novel: paper"] = theirs.get("novel_queries", {}).get(model)
        row |= bounded("known: MRR", statistics.known(model))
        row |= bounded("known: drop, %", statistics.drop(model))
        row["known: drop, paper, %"] = theirs.get("drop", {}).get(model)
        if epochs is not None and model in experiment.finetuned:
            of_model = epochs.loc[model]
            row |= named(of_model, "mean", "epochs: mean")
            row["epochs: do not end"] = of_model["do not end"]
            # it prints those of Xavier alone; none of the others is our reading of its words
            printed = theirs.get("epochs", {}) if model == BASELINE else {}
            row["epochs: paper"] = printed.get(model)
        rows.append(row)
    return pd.DataFrame(rows)


@table("report", "{}_mined")
def transfer_mined(results: Results) -> dict[str, pd.DataFrame]:
    """What was mined for the transfer (section 6.3), by experiment."""
    return {experiment.name: _mined(results, experiment) for experiment in results.extended}


def _mined(results: Results, experiment: Experiment) -> pd.DataFrame:
    """Counts: the steps of mining the second source, its objects that the first lacks, candidates,
    inserted ones.
    """
    extend = experiment.settings.graph.extend
    assert extend is not None  # noqa: S101  # true of ``results.extended``
    source, minimum = extend.source, extend.min_observations
    titles = {each.settings.graph.source: each.title for each in reversed(results.standalone)}
    base = titles.get(experiment.settings.graph.source, experiment.settings.graph.source)
    counts = dict(MINED.read_text(source=source).itertuples(index=False, name=None))
    entities, triples = experiment.entities, experiment.triples
    unknown = new_entities(mined(source), entities[entities["source"] != source])
    of_these = "of these, of" if counts else "instances of"
    sessions = experiment.settings.sessions
    counts |= {
        f"{of_these} objects that {base} has not": int(unknown.sum()),
        "kinds of such objects": len(unknown),
        f"of these, with at least {minimum} observations": int((unknown >= minimum).sum()),
        "drawn as candidates": int((entities["source"] == source).sum()),
        "unique triples of the candidates": int((triples["source"] == source).sum()),
        "inserted in a repeat": sessions.sizes[0],
    }
    return pd.DataFrame({"": list(counts), "count": list(counts.values())})
