"""What initializers answer right after insertion, what fine-tuning costs, and what it takes from
earlier knowledge (sections 6.1 to 6.3).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import pandas as pd

from isi.evaluation.scopes import SCOPES
from isi.graph.graph import MinedSource
from stages.build_graph import new_entities
from stages.report.tables.data import (
    DIRECTIONS,
    FINETUNE_ONLY,
    JOINT,
    TITLES,
    Experiment,
    Models,
    Results,
    Runs,
    read,
)
from stages.report.tables.estimates import (
    BASELINE,
    CELL,
    MEASURES,
    Line,
    Names,
    bounded,
    compare,
    epochs_summary,
    named,
    over_seeds,
    under,
    where,
)
from stages.report.tables.registry import Frames, of_each, table

#: Scopes of the paper's measure, in the order of tables.
GROUPED = ("weighted", "known", "novel")
#: Scopes of earlier knowledge: with the novel entities among the candidates, and without.
EARLIER = ("known", "known_closed")
#: Points of MRR by which equal rankings may differ: near ties of scores fall either way.
EQUAL = 0.01
#: The parts of the gain from Xavier on, each with the control that has it; an initializer of ISI
#: has the last, too.
STEPS = (("centre", "mean"), ("kind", "kind_mean"))
SEMANTICS = "words and facts"
#: Number of highest-ranked answers that are shown and counted (Table 3).
TOP = 4


def in_rows(
    means: pd.DataFrame, labels: Models, models: Names, header: str = "model", **orders: Names
) -> pd.DataFrame:
    """Means by group (index levels) as rows of a table, in the order of the models and of
    ``orders``, by level.
    """
    orders = {"model": models, **orders}
    frame = where(means.reset_index(), **{name: list(order) for name, order in orders.items()})
    for name, order in orders.items():
        frame[name] = pd.Categorical(frame[name], list(order))
    frame = frame.sort_values(list(map(str, means.index.names)))
    frame = labels.labelled(frame, "model")
    return frame.rename(columns={"model": header}).reset_index(drop=True)


def by_label(
    labels: Models, models: Names, columns: Mapping[str, Any], header: str = "model"
) -> pd.DataFrame:
    """A row for each model: its label, then columns of values by model; a frame gives all its
    columns, under its name if this is not empty.
    """
    models = list(models)
    parts: list[Any] = [pd.Series(labels.labels, name=header).reindex(models)]
    for name, values in columns.items():
        if isinstance(values, pd.DataFrame):
            parts.append(under(values.reindex(models), name))
        else:
            parts.append(pd.Series(values, dtype=float).reindex(models).rename(name))
    joined: pd.DataFrame = pd.concat(parts, axis=1).reset_index(drop=True)
    return joined


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
    return by_label(experiment.models, experiment.rows, columns)


def in_order(values: Any, first: Names) -> list[str]:
    """Values in the order of ``first``, then the others in their own order."""
    present = list(values)
    known = [value for value in first if value in present]
    return known + [value for value in present if value not in first]


@table("report")
@of_each("standalone")
def immediate_by_size(_: Results, experiment: Experiment) -> pd.DataFrame:
    """The measure right after insertion by number of novel entities."""
    rows = where(experiment.immediate, scope=GROUPED)
    means = over_seeds(rows, ["scope", "size", "model"], MEASURES)
    return in_rows(means, experiment.models, experiment.rows, scope=GROUPED)


@table("report")
@of_each("standalone")
def scopes(_: Results, experiment: Experiment) -> pd.DataFrame:
    """MRR right after insertion by scope; with known candidates alone, a new vector changes
    nothing, so one row says it.
    """
    means = over_seeds(experiment.immediate, ["scope", "model"], MEASURES)
    rows = in_rows(means, experiment.models, experiment.rows, scope=list(SCOPES))
    joint = experiment.models.labels[JOINT]
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
    rows = list[Line]()
    for model in experiment.initializers:
        if model == BASELINE:
            continue
        row: Line = {"initializer": experiment.models.labels[model]}
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
@of_each("standalone")
def answer_parts(_: Results, experiment: Experiment) -> pd.DataFrame | None:
    """What the gain of the best of ISI consists of, in both groups together and about novel
    entities: bars from ``start`` to ``end`` in points.
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
        for name in (best, *others.nlargest(1).index, JOINT):
            rows.append((scope, labels[name], means[name], means[name]))
    return pd.DataFrame(rows, columns=["scope", "part", "start", "end"])


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
    return by_label(experiment.models, experiment.rows, columns)


# Fine-tuning


@table("report")
@of_each("standalone")
def table2_convergence(results: Results, experiment: Experiment) -> pd.DataFrame | None:
    """Table 2: epochs to convergence over all sizes, beside the paper's."""
    if not experiment.finetuned:
        return None
    summary = epochs_summary(experiment.convergence, ["model"])
    frame = by_label(experiment.models, experiment.finetuned, {"": summary}, "initializer")
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
    models = [*experiment.rows, FINETUNE_ONLY]
    return in_rows(means, experiment.models, models, scope=list(SCOPES))


def since_before(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs in ``EARLIER`` minus MRR of Θ⁰, which equals any initializer's MRR in known_closed at
    epoch 0.
    """
    shown = where(runs, scope=EARLIER)
    inserted = ~shown["model"].isin([JOINT, FINETUNE_ONLY])
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
    statistics, rows = experiment.statistics(), list[Line]()
    epochs = epochs_summary(experiment.convergence, ["model"]) if experiment.finetuned else None
    for model in experiment.rows:
        row: Line = {"model": experiment.models.labels[model]}
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
            row["epochs: paper"] = theirs.get("epochs", {}).get(model)
        rows.append(row)
    return pd.DataFrame(rows)


@table("report")
def transfer_mined(results: Results) -> Frames:
    """What was mined for the transfer (section 6.3), by experiment."""
    return {f"{each.name}_mined": _mined(results, each) for each in results.extended}


def _mined(results: Results, experiment: Experiment) -> pd.DataFrame:
    """Counts: the steps of mining the second source, its objects that the first lacks, candidates,
    inserted ones.
    """
    extend = experiment.settings.graph.extend
    assert extend is not None  # noqa: S101  # true of ``results.extended``
    source, minimum = extend.source, extend.min_observations
    titles = {each.settings.graph.source: each.title for each in reversed(results.standalone)}
    base = titles.get(experiment.settings.graph.source, experiment.settings.graph.source)
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
        "inserted in a repeat": sessions.sizes[0],
    }
    return pd.DataFrame({"": list(counts), "count": list(counts.values())})


# Table 3


@dataclass(frozen=True, eq=False)
class AffordanceAnswers:
    """Ranked answers to (entity, relation, ?) in one experiment (Table 3)."""

    experiment: Experiment
    ranks: pd.DataFrame  #: rows by model, seed, entity and answer
    shown: Names  #: the entities of the table
    kinds: Names  #: of the relation's tails; answers of other kinds are wrong
    afforded: Mapping[str, Names]

    @cached_property
    def _top(self) -> pd.DataFrame:
        """The ``TOP`` answers of lowest mean rank of each model about each entity, among those
        that are in every repeat; rows by model, entity and answer, with the answer's kind.
        """
        entities = self.experiment.entities
        answers = entities[entities["source"] == self.experiment.settings.graph.source]
        ranks = where(self.ranks, answer=list(answers.index))
        means = ranks.groupby(["model", "entity", "answer"])["rank"].mean().reset_index()
        best = means.sort_values("rank", kind="stable").groupby(["model", "entity"]).head(TOP)
        return best.assign(
            entity=best["entity"].map(entities["entity"]),
            kind=best["answer"].map(entities["kind"]),
            answer=best["answer"].map(entities["entity"]),
        )

    def top(self, model: str, entity: str) -> list[tuple[str, str]]:
        """The ``TOP`` answers of lowest mean rank, each with its kind."""
        rows = where(self._top, model=model, entity=entity)
        return list(rows[["answer", "kind"]].itertuples(index=False, name=None))

    def hits(self) -> pd.DataFrame:
        """The first ``TOP`` ranks of every repeat, with whether the answer's kind is right."""
        ranks = self.ranks[self.ranks["rank"] <= TOP]
        kinds = ranks["answer"].map(self.experiment.entities["kind"])
        return ranks.assign(hit=kinds.isin(self.kinds))

    def rows(self, models: Names, paper: Mapping[str, Mapping[str, Names]]) -> pd.DataFrame:
        """``top`` answers about the entities, a column for each initializer, then the paper's.

        × marks an answer of a wrong kind, ? an unlikely one: not in ``afforded``, if this has the
        entity. An entity that the paper lacks stands beside one of the paper's that is not shown.
        """
        theirs = list(dict.fromkeys(entity for words in paper.values() for entity in words))
        spare, parts = iter([name for name in theirs if name not in self.shown]), []
        for entity in self.shown:
            other = entity if entity in theirs else next(spare, entity)
            ids = self.experiment.entities.index[self.experiment.entities["entity"] == entity]
            number = where(self.ranks, entity=list(ids))["seed"].nunique()
            beside = f"; paper: {other}" if other != entity else ""
            answers = dict[str, Names]()
            for model in models:
                answers[self.experiment.models.labels[model]] = [
                    marked(answer, kind in self.kinds, self.afforded.get(entity))
                    for answer, kind in self.top(model, entity)
                ]
            answers |= {f"paper: {name}": words.get(other, []) for name, words in paper.items()}
            parts.append(in_ranks(f"{entity} (n = {number}{beside})", answers))
        return pd.concat(parts)


def in_ranks(entity: str, answers: Mapping[str, Names]) -> pd.DataFrame:
    """The first ``TOP`` answers about an entity: a row for each rank, a column for each name."""
    columns = {name: pd.Series(words[:TOP], dtype=object) for name, words in answers.items()}
    frame = pd.DataFrame(columns, index=range(TOP)).fillna("–")
    frame.insert(0, "entity", entity)
    frame.insert(1, "", [f"{rank}." for rank in range(1, 1 + TOP)])
    return frame


def marked(answer: str, is_right: bool, likely: Names | None) -> str:
    """An answer, with × if it is of a wrong kind, and ? if it is not among the likely ones."""
    if not is_right:
        return f"× {answer}"
    return f"? {answer}" if likely is not None and answer not in likely else answer


@cache
def answers_of(results: Results, experiment: Experiment) -> AffordanceAnswers | None:
    """The ranked answers of an experiment, read once for all tables; None where it has none."""
    settings, ranks = results.params.affordances, experiment.analysis("affordances")
    if ranks is None:
        return None
    entities, triples = experiment.entities, experiment.triples
    tails = triples.loc[triples["relation"] == settings.relation, "tail"]
    kinds = sorted(entities.loc[entities["entity"].isin(tails), "kind"].unique())
    ranks = ranks.rename(columns={"initializer": "model"})
    shown, afforded = settings.entities[experiment.name], results.vocabulary["afforded"]
    return AffordanceAnswers(experiment, ranks, shown, kinds, afforded)


@table("report")
@of_each("experiments")
def table3_affordances(results: Results, experiment: Experiment) -> pd.DataFrame | None:
    """Table 3: ranked affordances of inserted entities, of ISI and Xavier, beside the paper's."""
    answers = answers_of(results, experiment)
    if answers is None:
        return None
    shown = [*experiment.methods, *({BASELINE} & set(experiment.initializers))]
    return answers.rows(shown, results.paper["affordances"]["answers"])
