"""What initializers answer right after insertion, what fine-tuning costs, and what it takes from
earlier knowledge (sections 6.1 to 6.3).
"""

from collections.abc import Mapping
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from isi.evaluation.query_sets import CONVERGING
from isi.graph.graph import MinedSource, new_entities
from isi.report.tables.data import (
    BASELINE,
    DIRECTIONS,
    FINETUNE_ONLY,
    JOINT,
    Experiment,
    Results,
    Runs,
    read,
)
from isi.report.tables.estimates import (
    CELL,
    HALVES,
    Names,
    cells_of,
    combined,
    compare,
    difference,
    drops,
    epochs_summary,
    improvements,
    over_seeds,
    under,
    where,
)
from isi.report.tables.registry import Frames, of_each_graph, table

_SCOPES = ["all", "known", "known_closed", "novel", "novel_heldout"]
#: Scopes of earlier knowledge: with the novel entities among the candidates, and without.
EARLIER = ("known", "known_closed")
#: Points of MRR* by which equal rankings may differ: near ties of scores fall either way.
EQUAL = 0.01
#: The parts of the gain from Xavier on, each with the control that has it; an initializer of ISI
#: has the last, too.
STEPS = (("centre", "mean"), ("kind", "kind_mean"))
SEMANTICS = "words and facts"
WHOLE = "the whole gain"
#: A property, an initializer of ISI, and the control that differs from it in this property alone.
_TWINS = (("words", "es", "es_permuted"), ("words within a kind", "es", "es_permuted_kinds"))
#: Number of highest-ranked answers that are shown and counted (Table 3).
TOP = 4
#: Factor on the fine-tuning learning rate of params in the main runs.
_AS_CHOSEN = 1.0
_PLACES = {"given": "given", "answer": "answer", "both": "both", "any": "any or none"}


def in_rows(
    means: pd.DataFrame, runs: Runs, models: Names, header: str = "model", **orders: Names
) -> pd.DataFrame:
    """Means by group (index levels) as rows of a table, in the order of the models and of
    ``orders``, by level.
    """
    levels, frame = list(map(str, means.index.names)), means.reset_index()
    for name, order in {"model": models, **orders}.items():
        frame[name] = pd.Categorical(frame[name], list(order))
    frame = frame.dropna(subset=levels).sort_values(levels)
    named = runs.models.labelled(frame, "model")
    return named.rename(columns={"model": header}).reset_index(drop=True)


def by_label(
    runs: Runs, models: Names, columns: Mapping[str, Any], header: str = "model"
) -> pd.DataFrame:
    """A row for each model: its label, then columns of values by model; a frame gives all its
    columns, under its name if this is not empty.
    """
    models = list(models)
    labels = [runs.models.labels[name] for name in models]
    parts: list[Any] = [pd.Series(labels, models, name=header)]
    for name, values in columns.items():
        if isinstance(values, pd.DataFrame):
            parts.append(under(values.reindex(models), name))
        else:
            parts.append(pd.Series(values, dtype=float).reindex(models).rename(name))
    joined: pd.DataFrame = pd.concat(parts, axis=1).reset_index(drop=True)
    return joined


# Right after insertion


def halves(runs: Runs, scopes: Names) -> dict[str, pd.DataFrame]:
    """Means of MRR* and its halves by model, for each scope."""
    means = over_seeds(where(runs.immediate, scope=list(scopes)), ["scope", "model"], HALVES)
    return {scope: pd.DataFrame(means.loc[scope]) for scope in scopes if scope in means.index}


@table("report")
@of_each_graph
def immediate(_: Results, experiment: Experiment) -> pd.DataFrame:
    """MRR* right after insertion, with its halves."""
    return by_label(experiment, experiment.rows, halves(experiment, ("all", "novel")))


@table("report")
@of_each_graph
def improvement(results: Results, experiment: Experiment) -> pd.DataFrame:
    """Gain over Xavier in per cent, beside the paper's."""
    columns = dict[str, Any]()
    for scope in ("all", "novel"):
        gains = improvements(experiment.immediate, scope)
        for end in ("", " low", " high"):
            columns[f"scope {scope}{end}"] = gains[f"gain{end}"]
    columns["paper"] = results.paper["immediate"]["improvement_over_xavier"]
    others = [name for name in experiment.initializers if name != BASELINE]
    return by_label(experiment, others, columns, "initializer")


@table("report")
@of_each_graph
def novel_by_kind(results: Results, experiment: Experiment) -> pd.DataFrame:
    """MRR* about novel entities by their kind."""
    queried = experiment.inserted[experiment.inserted["queries"] > 0]
    means = over_seeds(queried, ["kind", "model"], HALVES)
    means.insert(0, "inserted", queried.groupby(["kind", "model"]).size())
    kinds = in_order(experiment.entities["kind"].unique(), results.vocabulary["kinds"])
    return in_rows(means, experiment, experiment.initializers, "initializer", kind=kinds)


def in_order(values: Any, first: Names) -> list[str]:
    """Values in the order of ``first``, then the others in their own order."""
    present = list(values)
    known = [value for value in first if value in present]
    return known + [value for value in present if value not in first]


@table("report")
@of_each_graph
def immediate_by_size(_: Results, experiment: Experiment) -> pd.DataFrame:
    """MRR* right after insertion by number of novel entities."""
    rows = where(experiment.immediate, scope=("all", "novel"))
    means = over_seeds(rows, ["scope", "size", "model"], HALVES)
    return in_rows(means, experiment, experiment.rows, scope=("all", "novel"))


@table("report")
@of_each_graph
def scopes(_: Results, experiment: Experiment) -> pd.DataFrame:
    """MRR* right after insertion by scope; with known candidates alone, a new vector changes
    nothing, so one row says it.
    """
    means = over_seeds(experiment.immediate, ["scope", "model"], HALVES)
    rows = in_rows(means, experiment, experiment.rows, scope=_SCOPES)
    joint = experiment.models.labels[JOINT]
    closed = (rows["scope"] == "known_closed") & (rows["model"] != joint)
    values = rows.loc[closed, list(HALVES.values())]
    if not len(values) or (values.max() - values.min() > EQUAL).any():
        return rows
    first = values.index[0]
    rows.loc[first, "model"] = "Any initializer"
    kept: pd.DataFrame = rows[~closed | (rows.index == first)]
    return kept


@table("report")
@of_each_graph
def gain_and_cost(_: Results, experiment: Experiment) -> pd.DataFrame:
    """What is answered about novel entities against what earlier knowledge loses, in points."""
    means = 100 * experiment.immediate.pivot_table("mrr_star", "model", "scope", observed=True)
    means = means.reindex(experiment.initializers)
    columns = {
        "earlier knowledge loses": means["known_closed"] - means["known"],
        "MRR* about novel entities": means["novel"],
    }
    return by_label(experiment, experiment.initializers, columns, "initializer")


@table("report")
@of_each_graph
def differences(_: Results, experiment: Experiment) -> pd.DataFrame | None:
    """All pairs of initializers in the headline measures, with tests."""
    if len(experiment.initializers) < 2:
        return None
    listed_measures = (
        ("immediate MRR*", 100, experiment.immediate, "all", "mrr_star"),
        ("immediate MRR*", 100, experiment.immediate, "novel", "mrr_star"),
        ("immediate entity prediction", 100, experiment.immediate, "novel", "mrr_star_entity"),
        ("epochs to convergence", 1, experiment.convergence, "all", "epochs"),
        ("epochs to convergence", 1, experiment.convergence, "novel_heldout", "epochs"),
    )
    measures = {
        f"{title}, {TITLES[scope]}": scale * cells_of(rows, experiment.initializers, scope, column)
        for title, scale, rows, scope, column in listed_measures
    }
    pairs = compare(measures, experiment.initializers, experiment.methods)
    return experiment.models.labelled(pairs, "first", "second")


#: Titles of scopes in the cells of tables.
TITLES = {
    "all": "all queries",
    "novel": "novel entities",
    "novel_heldout": "novel entities, held-out triples",
    "given": "novel entity given",
    "known": "earlier knowledge",
    "known_closed": "earlier knowledge, known candidates only",
}


# What the gain consists of


def about_new(runs: Runs) -> str:
    """The scope about novel entities: those that are given, where queries were broken down."""
    return "novel" if runs.queries is None else "given"


def steps(method: str, models: Names) -> list[tuple[str, str, str]]:
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
@of_each_graph
def parts_of_the_gain(_: Results, experiment: Experiment) -> pd.DataFrame | None:
    """Paired differences (points) of each step from Xavier to an initializer of ISI, of its steps
    together, and of the controls with other words.
    """
    models = experiment.initializers
    pairs = [step for method in experiment.methods for step in steps(method, models)]
    pairs += [(WHOLE, method, BASELINE) for method in experiment.methods]
    pairs = [pair for pair in dict.fromkeys([*pairs, *_TWINS]) if {*pair[1:]} <= set(models)]
    measures = [(scope, half) for scope in ("all", "novel") for half in HALVES]
    if experiment.queries is not None:
        measures.append(("given", "mrr_star_entity"))
    rows = dict[tuple[str, ...], dict[str, Any]]()
    for scope, half in measures:
        cells = experiment.by_run(scope, half)
        for part, first, second in pairs:
            points = difference(cells[first], cells[second])
            if points["seeds"]:
                names = (
                    scope,
                    part,
                    experiment.models.labels[first],
                    experiment.models.labels[second],
                )
                titles = ("scope", "part", "what has it", "minus")
                row: dict[str, Any] = dict(zip(titles, names, strict=True))
                for end in ("", " low", " high"):
                    row[f"{HALVES[half]}{end}"] = points[f"difference{end}"]
                rows[names] = rows.get(names, {}) | row
    ends = [f"{half}{end}" for half in HALVES.values() for end in ("", " low", " high")]
    frame = pd.DataFrame(rows.values())
    return frame.reindex(columns=["scope", "part", "what has it", "minus", *ends])


@table("report")
def answer_parts(results: Results) -> pd.DataFrame | None:
    """What the gain of the best of ISI consists of, over all queries and about novel entities: bars
    from ``start`` to ``end`` in points.
    """
    first = results.standalone[0]
    best = best_method(first)
    if best is None or BASELINE not in first.initializers:
        return None
    rows = list[dict[str, Any]]()
    for scope in ("all", about_new(first)):
        means = first.means(scope)["mean"]
        end = means.get(BASELINE, np.nan)
        row = {"scope": scope, "part": first.models.labels[BASELINE], "start": 0.0, "end": end}
        rows.append(row)
        for part, model, before in steps(best, first.initializers):
            points = first.minus(scope, model, before)["difference"]
            rows.append({"scope": scope, "part": part, "start": end, "end": end + points})
            end += points
        others = first.models.of_role(first.initializers, "baseline", "own")
        others = sorted(others, key=lambda name: -means.get(name, -np.inf))[:1]
        for name in (best, *others, JOINT):
            value = means.get(name, np.nan)
            label = first.models.labels[name]
            rows.append({"scope": scope, "part": label, "start": value, "end": value})
    return pd.DataFrame(rows)


def best_method(runs: Runs) -> str | None:
    """The initializer of ISI with the highest MRR* about novel entities."""
    means = runs.means(about_new(runs))["mean"]
    return max(
        (name for name in runs.methods if name in means.index),
        key=lambda name: means[name],
        default=None,
    )


@table("report")
def directions(results: Results) -> Frames:
    """Entity MRR* about novel entities: with the entity given, and with it as the answer."""
    frames = dict[str, pd.DataFrame]()
    for experiment in results.experiments:
        if len(experiment.directed):
            columns = dict[str, Any]()
            for name, title in DIRECTIONS.items():
                means = experiment.means(name)
                columns |= {
                    f"{title}{end}": means.get(f"mean{end}") for end in ("", " low", " high")
                }
            frames[f"directions{experiment.suffix}"] = by_label(
                experiment, experiment.rows, columns
            )
    return frames


@table("report")
def by_relation(results: Results) -> Frames:
    """Entity MRR* (points) by relation, hidden end and role of the novel entity."""
    frames = dict[str, pd.DataFrame]()
    pair = ["scope", "relation", "hidden", "novel"]
    cell = ["model", "size", "seed"]
    for experiment in results.experiments:
        if experiment.queries is None or experiment.queries.empty:
            continue
        rows = where(
            experiment.queries, filter="learned", scope=["all", "novel"], hidden=["head", "tail"]
        )
        rows = rows.assign(novel=rows["novel"].where(rows["scope"] == "novel", "any"))
        measured = combined(rows, [*pair, *cell])
        means = 100 * measured.groupby([*pair, "model"])["mrr_star_entity"].mean().unstack("model")
        queries = rows.groupby([*pair, "model"])["queries"].sum().groupby(pair).first()
        frame = means.assign(queries=queries).reset_index()
        for name, order in (("scope", ["novel", "all"]), ("novel", list(_PLACES))):
            frame[name] = pd.Categorical(frame[name], order)
        frame = frame.sort_values(pair)
        forms = {"head": "(?, {}, t)", "tail": "(h, {}, ?)"}
        frame["query"] = [
            forms[hidden].format(relation)
            for hidden, relation in zip(frame["hidden"], frame["relation"], strict=True)
        ]
        frame["novel entity"] = frame["novel"].map(_PLACES)
        models = [name for name in experiment.rows if name in frame]
        shown = frame[["scope", "query", "novel entity", "queries", *models]]
        labels = {name: experiment.models.labels[name] for name in models}
        frames[f"by_relation{experiment.suffix}"] = shown.rename(columns=labels)
    return frames


# Fine-tuning


@table("report")
@of_each_graph
def table2_convergence(results: Results, experiment: Experiment) -> pd.DataFrame:
    """Table 2: epochs to convergence over all sizes, beside the paper's."""
    return table2(experiment, results.paper["convergence"]["epochs"])


def table2(runs: Runs, paper: Mapping[str, Mapping[str, float]]) -> pd.DataFrame:
    """Epochs to convergence by initializer, for all queries and for held-out triples."""
    summary = epochs_summary(runs.convergence, ["scope", "model"])
    columns = dict[str, Any]()
    for scope in CONVERGING:
        of_scope = summary.loc[scope] if scope in summary.index else summary.droplevel(0).iloc[:0]
        for name in ("mean", "std", "median", "unconverged %"):
            for end in ("", " low", " high"):
                if f"{name}{end}" in of_scope:
                    columns[f"{scope}: {name}{end}"] = of_scope[f"{name}{end}"]
            theirs = {"mean": "mean", "std": "deviation"}.get(name)
            if scope == "all" and theirs:
                values = {model: numbers[theirs] for model, numbers in paper.items()}
                columns[f"paper: {name}"] = values
    return by_label(runs, runs.finetuned or runs.initializers, columns, "initializer")


@table("report")
@of_each_graph
def convergence_by_size(_: Results, experiment: Experiment) -> pd.DataFrame:
    """Epochs to convergence by number of novel entities."""
    epochs, by = experiment.convergence, ["scope", "size", "model"]
    summary = epochs_summary(epochs, by).drop(columns="std")
    groups = epochs.groupby(by)
    summary["triples queried"], summary["sets"] = groups["queries"].mean(), groups.size()
    return in_rows(summary, experiment, experiment.finetuned, "initializer")


@table("report")
def convergence_by_rate(results: Results) -> pd.DataFrame | None:
    """Epochs to convergence at one size, with other fine-tuning rates."""
    sweep, first = results.params.rate_sweep, results.standalone[0]
    names = [name for name in first.finetuned if name in sweep.initializers]
    swept = first.swept("rate_sweep", "rate_sweep", sweep.initializers)
    if swept is None or not names:
        return None
    main = where(first.runs, size=sweep.size).assign(factor=_AS_CHOSEN)
    runs = pd.concat([main, swept])
    of_size = first.of_size(sweep.size)
    epochs = of_size.converged(where(runs, model=names), ["model", "factor"])
    by = ["factor", "scope", "model"]
    summary = over_seeds(epochs, by, {"epochs": "mean"}, scale=1)
    groups = epochs.groupby(by)
    summary["median"] = groups["epochs"].median()
    summary["unconverged %"] = 100 * (1 - groups["converged"].mean())
    rows = [(scope, name) for scope in CONVERGING for name in names]
    frame = pd.DataFrame(rows, columns=["scope", "initializer"])
    for factor in sorted(set(epochs["factor"])):
        of_factor = summary.loc[factor].reindex(rows)
        frame = pd.concat([frame, under(of_factor, f"×{factor:g}").reset_index(drop=True)], axis=1)
    return first.models.labelled(frame, "initializer").dropna(how="all", subset=frame.columns[2:])


@table("report")
def curves(results: Results) -> Frames:
    """MRR* (points) by epoch of fine-tuning, with its interval: the first ten epochs, then every
    fifth; earlier knowledge also as a change since before the insertion.
    """
    frames = dict[str, pd.DataFrame]()
    for experiment in results.experiments:
        runs = experiment.curves
        if runs.empty:
            continue
        shown = runs[(runs["epoch"] <= 10) | (runs["epoch"] % 5 == 0)]
        means = over_seeds(shown, ["scope", "model", "epoch"], {"mrr_star": "MRR*"})
        change = over_seeds(
            since_before(shown), ["scope", "model", "epoch"], {"mrr_star": "change"}
        )
        means = means.join(change)
        frames[f"curves{experiment.suffix}"] = in_rows(
            means, experiment, [*experiment.rows, FINETUNE_ONLY], scope=_SCOPES
        ).assign(margin=100 * experiment.margin)
    return frames


def since_before(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs in ``EARLIER`` minus MRR* of Θ⁰, which equals any initializer's MRR* in known_closed at
    epoch 0.
    """
    shown = where(runs, scope=EARLIER)
    inserted = ~shown["model"].isin([JOINT, FINETUNE_ONLY])
    start = shown[(shown["scope"] == "known_closed") & (shown["epoch"] == 0) & inserted]
    before = start.drop_duplicates(CELL).set_index(CELL)["mrr_star"].rename("before")
    return shown.assign(mrr_star=shown["mrr_star"] - shown.join(before, on=CELL)["before"])


@table("report")
@of_each_graph
def forgetting(_: Results, experiment: Experiment) -> pd.DataFrame | None:
    """MRR* (points) about earlier knowledge: lowest, immediately, at the last epoch."""
    runs = experiment.curves
    if runs.empty:
        return None
    groups, rows = dict(list(runs.groupby(["model", "scope"]))), list[dict[str, Any]]()
    for model, scope in product([*experiment.rows, FINETUNE_ONLY], EARLIER):
        if (model, scope) not in groups:
            continue
        shown = groups[model, scope]
        by_epoch = over_seeds(shown, ["epoch"], HALVES)
        lowest = 100 * shown.groupby("epoch")["mrr_star"].mean().min()
        row: dict[str, Any] = {"model": experiment.models.labels[model], "scope": scope}
        row["lowest MRR*"] = lowest
        for when, place in (("immediately", 0), ("at the end", -1)):
            for name, value in by_epoch.iloc[place].items():
                row[f"{when}: {name}"] = value
        rows.append(row)
    return pd.DataFrame(rows)


def at_the_end(experiment: Experiment) -> pd.DataFrame:
    """Pairs of contenders (and fine-tuning without insertion) at the last epoch, in points."""
    runs = experiment.curves
    epoch = runs["epoch"].max()
    last, parts = where(runs, epoch=epoch), list[pd.DataFrame]()
    ran = list(dict.fromkeys(last["model"]))
    for scope in EARLIER:
        queried = set(last.loc[last["scope"] == scope, "model"])
        names = [*experiment.models.contenders(ran), FINETUNE_ONLY]
        names = [name for name in names if name in queried]
        cells = 100 * cells_of(last, names, scope, "mrr_star")
        measure = {f"{TITLES[scope]}, epoch {epoch}": cells}
        parts.append(compare(measure, names, experiment.methods))
    return experiment.models.labelled(pd.concat(parts), "first", "second")


@table("report")
@of_each_graph
def earlier_at_the_end(_: Results, experiment: Experiment) -> pd.DataFrame | None:
    """Differences in earlier knowledge at the last epoch."""
    return None if experiment.curves.empty else at_the_end(experiment)


# From simulation to real homes


@table("report")
def transfer(results: Results) -> Frames:
    """The transfer (section 6.3): what was mined, MRR* right after insertion beside the paper's,
    and differences at the last epoch.
    """
    frames, paper = dict[str, pd.DataFrame](), results.paper["transfer"]
    for experiment in results.extended:
        name = experiment.name
        frames[f"{name}_mined"] = _mined(results, experiment)
        frames[f"{name}_immediate"] = _beside(experiment, paper)
        if len(experiment.curves):
            frames[f"{name}_at_the_end"] = at_the_end(experiment)
    return frames


def _beside(experiment: Experiment, paper: Mapping[str, Any]) -> pd.DataFrame:
    """Measures right after insertion and epochs to convergence, with the paper's."""
    epochs = epochs_summary(experiment.convergence, ["scope", "model"])
    columns = dict[str, Any]()
    for scope in ("all", "novel"):
        means = experiment.means(scope)
        for end in ("", " low", " high"):
            columns[f"{scope}: MRR*{end}"] = means[f"mean{end}"]
        columns[f"{scope}: paper"] = paper[f"{scope}_queries"]
    dropped = drops(experiment.immediate)
    for end in ("", " low", " high"):
        columns[f"drop %{end}"] = dropped[f"drop{end}"]
    columns["drop %: paper"] = paper["drop"]
    for scope in CONVERGING:
        if scope not in epochs.index:
            continue
        of_scope = epochs.loc[scope]
        for name in ("mean", "mean low", "mean high"):
            columns[f"epochs, {scope}: {name}"] = of_scope[name]
        if scope == "all":
            columns["epochs, all: paper"] = paper["epochs"]
        for name in ("unconverged %", "unconverged % low", "unconverged % high"):
            columns[f"epochs, {scope}: {name}"] = of_scope[name]
    return by_label(experiment, experiment.rows, columns)


def _mined(results: Results, experiment: Experiment) -> pd.DataFrame:
    """Counts: the steps of mining the second source, its objects that the first lacks, candidates,
    inserted ones.
    """
    extend = experiment.settings.graph.extend
    assert extend is not None  # noqa: S101  # true of ``results.extended``
    source, minimum = extend.source, extend.min_observations
    base = next(
        (each.title for each in results.standalone if each.settings.graph.source
         == experiment.settings.graph.source),
        experiment.settings.graph.source,
    )  # fmt: skip
    place = f"data/observations/{source}"
    seen = MinedSource(source, read(f"{place}.parquet"), read(f"{place}.entities.parquet"))
    counts = dict(read(f"{place}.mined.parquet").itertuples(index=False, name=None))
    entities, triples = experiment.entities, experiment.triples
    unknown = new_entities(seen, entities[entities["source"] != source])
    of_these = "of these, of" if counts else "instances of"
    sessions = experiment.settings.sessions
    counts |= {
        f"{of_these} objects that {base} has not": int(unknown.sum()),
        "kinds of such objects": len(unknown),
        f"of these, with at least {minimum} observations": int((unknown >= minimum).sum()),
        "drawn as candidates": int((entities["source"] == source).sum()),
        "unique triples of the candidates": int((triples["source"] == source).sum()),
        "inserted in a repeat": sessions.steps * sessions.sizes[0],
    }
    return pd.DataFrame({"": list(counts), "count": list(counts.values())})


# Table 3


class AffordanceAnswers:
    """Ranked answers to (entity, relation, ?) in one experiment (Table 3)."""

    def __init__(self, results: Results) -> None:
        self.params = results.params.affordances
        self.experiment: Experiment | None = None
        for experiment in results.experiments:
            ranks = experiment.analysis("affordances")
            if ranks is not None and self.experiment is None:
                self.experiment, self.ranks = experiment, ranks
        if self.experiment is None:
            return
        entities, triples = self.experiment.entities, self.experiment.triples
        tails = triples.loc[triples["relation"] == self.params.relation, "tail"]
        kinds = entities.loc[entities["entity"].isin(tails), "kind"]
        self.entities = entities
        #: kinds of the relation's tails; answers of other kinds are wrong
        self.kinds = sorted(kinds.unique())
        self.ranks = self.ranks.rename(columns={"initializer": "model"})
        self.afforded: Mapping[str, Names] = results.vocabulary["afforded"]
        self._means = self._mean_ranks()

    def _mean_ranks(self) -> pd.DataFrame:
        """The mean rank of each answer that is in every repeat, over the repeats that inserted one
        of the entities shown: rows by model, entity and answer.
        """
        experiment = self.experiment
        assert experiment is not None  # noqa: S101
        ids = {name: place for place, name in enumerate(self.entities["entity"])}
        wanted = [ids[name] for name in self.params.entities if name in ids]
        rows = where(self.ranks, entity=wanted)
        known = self.entities["source"] == experiment.settings.graph.source
        rows = rows[rows["answer"].map(known)]
        means = rows.groupby(["model", "entity", "answer"])["rank"].mean()
        return means.reset_index()

    def top(self, model: str, entity: str) -> list[tuple[str, str]]:
        """The ``TOP`` answers of lowest mean rank, each with its kind."""
        ids = self.entities.index[self.entities["entity"] == entity]
        rows = where(self._means, model=model, entity=list(ids))
        best = rows.sort_values("rank", kind="stable")["answer"][:TOP]
        return list(self.entities.loc[best, ["entity", "kind"]].itertuples(index=False, name=None))

    def judged(self, model: str) -> dict[str, int]:
        """Number of ``top`` answers of a right kind (plausible, or unlikely) and of a wrong one."""
        entities = self.params.entities
        tops = [(entity, *answer) for entity in entities for answer in self.top(model, entity)]
        hits = [(entity, answer) for entity, answer, kind in tops if kind in self.kinds]
        counts = {"affordances": len(hits), "wrong": len(tops) - len(hits)}
        if all(entity in self.afforded for entity in entities):
            counts["plausible"] = sum(answer in self.afforded[entity] for entity, answer in hits)
            counts["unlikely"] = len(hits) - counts["plausible"]
        return counts

    def rows(self, models: Names, paper: Mapping[str, Mapping[str, Names]]) -> pd.DataFrame:
        """``top`` answers about the entities, a column for each initializer, then the paper's.

        × marks an answer of a wrong kind, ? an unlikely one: not in ``afforded``, if this has the
        entity. An entity that the paper lacks stands beside one of the paper's that is not shown.
        """
        experiment, rows = self.experiment, list[dict[str, str]]()
        assert experiment is not None  # noqa: S101
        named = list(dict.fromkeys(entity for words in paper.values() for entity in words))
        spare = iter([entity for entity in named if entity not in self.params.entities])
        for entity in self.params.entities:
            other = entity if entity in named else next(spare, entity)
            ids = self.entities.index[self.entities["entity"] == entity]
            number = where(self.ranks, entity=list(ids))["seed"].nunique()
            beside = f"; paper: {other}" if other != entity else ""
            answers: dict[str, Names] = {
                experiment.models.labels[model]: [
                    self._marked(entity, *answer) for answer in self.top(model, entity)
                ]
                for model in models
            }
            answers |= {f"paper: {name}": words.get(other, []) for name, words in paper.items()}
            for place in range(TOP):
                row = {"entity": f"{entity} (n = {number}{beside})", "": f"{place + 1}."}
                for name, words in answers.items():
                    row[name] = words[place] if place < len(words) else "–"
                rows.append(row)
        return pd.DataFrame(rows)

    def _marked(self, entity: str, answer: str, kind: str) -> str:
        return marked(answer, kind in self.kinds, self.afforded.get(entity))


def marked(answer: str, is_right: bool, likely: Names | None) -> str:
    """An answer, with × if it is of a wrong kind, and ? if it is not among the likely ones."""
    if not is_right:
        return f"× {answer}"
    return f"? {answer}" if likely is not None and answer not in likely else answer


@cache
def answers_of(results: Results) -> AffordanceAnswers:
    """The ranked answers, read once for all tables."""
    return AffordanceAnswers(results)


@table("report")
def affordances(results: Results) -> Frames:
    """Table 3: ranked affordances of inserted entities, and how often their kind is right."""
    answers = answers_of(results)
    experiment = answers.experiment
    if experiment is None:
        return {}
    first = [*experiment.methods, *({BASELINE} & set(experiment.initializers))]
    others = [name for name in experiment.initializers if name not in first]
    hits = answers.ranks[answers.ranks["rank"] <= TOP]
    kinds = answers.entities["kind"]
    hits = hits.assign(hit=hits["answer"].map(kinds).isin(answers.kinds))
    plural = " and ".join(f"{kind}s" for kind in answers.kinds)
    columns = dict[str, Any]()
    for title, rows in (
        (f"top {TOP}: {plural} %", hits),
        (f"first: {' and '.join(answers.kinds)} %", where(hits, rank=1)),
    ):
        means = over_seeds(rows, ["model"], {"hit": title})
        columns |= {str(name): means[name] for name in means}
    frames = {
        "table3_affordances": answers.rows(first, results.paper["affordances"]["answers"]),
        "affordance_shares": by_label(experiment, experiment.initializers, columns, "initializer"),
    }
    if others:
        frames["table3_others"] = answers.rows(others, {})
    return frames
