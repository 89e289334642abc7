"""Right after insertion: Figure 3a and gains over Xavier (section 6.1), and the ranked answers of Table 3 (6.3)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import nan
from typing import Any

import pandas as pd

from isi.report import stats
from isi.report.data import Analysis, Experiment, Results
from isi.report.figures import Figure, by_size
from isi.report.models import BASELINE, JOINT, contenders, controls, isi, label
from isi.report.section import Content, of_each
from isi.report.stats import HALVES, halves_by_model, in_order, over_seeds
from isi.report.tables import Column, Table
from isi.report.words import SCOPES, joined

SCOPE = Column("scope", words=SCOPES)
#: Answers that are shown and counted.
TOP = 4


def immediate(results: Results) -> Iterator[Content]:
    """MRR* right after insertion, of every graph."""
    return of_each(results.standalone, lambda experiment: of_experiment(results, experiment))


def of_experiment(results: Results, experiment: Experiment) -> Content:
    """Figure 3a, gains over Xavier, and MRR* by size, kind of entity, scope and session."""
    runs, models, initializers = experiment.immediate, experiment.models, experiment.initializers
    paper = results.paper["immediate"]["improvement_over_xavier"]
    novel = 100 * runs[runs["scope"] == "novel"].groupby("model")[list(HALVES)].mean()
    figure = by_size(runs, models, ("all", "novel"), ("mrr_star", "mrr_star_entity"), len(experiment.entities))
    kinds = in_order_of(experiment.entities["kind"].unique(), results.vocabulary["kinds"])
    shown: list[Table | Figure] = [
        Figure("figure3a_immediate", figure),
        Table.of("immediate", pd.DataFrame(
            dict[Any, Any](model=list(map(label, models))) | halves_by_model(runs, models, ("all", "novel")))),
        improvement(runs, initializers, paper),
        novel_by_kind(experiment.inserted, kinds, initializers),
        immediate_by_size(runs, models),
        Table.of("scopes", by_scope(runs, models)),
        Table.of("sessions", pd.concat(
            [by_scope(rows, models).assign(session=session) for session, rows in runs.groupby("session")],
            ignore_index=True).pipe(lambda frame: frame[["session", *frame.columns.drop("session")]])),
    ]  # fmt: skip
    queries = runs[runs["model"] == initializers[0]].groupby("scope")["queries"].sum()
    numbers = {
        "experiment": experiment, "tested": contenders(initializers), "methods": isi(initializers), "paper": paper,
        "collapsed": stats.collapsed(runs, experiment.ties, len(experiment.entities)),
        "everything": {JOINT: nan} | stats.mrr_star(runs, models).get("all", {}), "joint": JOINT,
        "gain": {name: estimate.mean for name, estimate in stats.improvements(runs, "all").items()},
        "known_percent": 100 * float(queries.get("known", 0) / max(queries.get("all", 0), 1)),
        "novel": {half: novel[column].dropna().to_dict() for column, half in HALVES.items()},
        "has_baseline": BASELINE in models, "has_sessions": experiment.settings.sessions.steps > 1,
    }  # fmt: skip
    return Content(numbers, shown)


def in_order_of(values: Iterable[str], first: Sequence[str]) -> list[str]:
    """Values in a given order, the others behind it as they come."""
    there = list(values)
    return [value for value in first if value in there] + [value for value in there if value not in first]


def immediate_by_size(runs: pd.DataFrame, models: Sequence[str]) -> Table:
    """The numbers behind Figure 3a, with their halves."""
    means = over_seeds(runs[runs["scope"].isin(["all", "novel"])], ["scope", "size", "model"], HALVES)
    frame = in_order(means.reset_index(), ["scope", "size", "model"], models)
    return Table.of("immediate_by_size", frame.rename(columns={"scope": SCOPE}))


def improvement(runs: pd.DataFrame, initializers: Sequence[str], paper: Mapping[str, float]) -> Table:
    """Improvement over Xavier, beside the paper's (see ``stats.improvements``)."""
    gains = {scope: stats.improvements(runs, scope) for scope in ("all", "novel")}
    return Table.of("improvement", [
        {"initializer": label(name)}
        | {Column(f"scope {scope}", title=SCOPES[scope]): gains[scope].get(name, nan) for scope in gains}
        | {"paper": paper.get(name)}
        for name in initializers if name != BASELINE
    ])  # fmt: skip


def novel_by_kind(inserted: pd.DataFrame, kinds: Sequence[str], initializers: Sequence[str]) -> Table:
    """Immediate MRR* of the queries about each inserted entity, by its kind."""
    queried = inserted[inserted["queries"] > 0]
    means = over_seeds(queried, ["kind", "model"], HALVES)
    means.insert(0, "inserted", queried.groupby(["kind", "model"]).size())
    order = [(kind, model) for kind in kinds for model in initializers if (kind, model) in means.index]
    frame = means.loc[order].reset_index()
    frame["model"] = frame["model"].map(label)
    return Table.of("novel_by_kind", frame.rename(columns={"model": "initializer"}))


def by_scope(runs: pd.DataFrame, models: Sequence[str]) -> pd.DataFrame:
    """A row for each scope and model: mean MRR* in points with its entity and its relation half."""
    means = over_seeds(runs[runs["scope"].isin(list(_ALL))], ["scope", "model"], HALVES).reset_index()
    means["scope"] = means["scope"].astype(pd.CategoricalDtype(list(_ALL), ordered=True))
    return in_order(means, ["scope", "model"], models).astype({"scope": str}).rename(columns={"scope": SCOPE})


_ALL = ("all", "known", "known_closed", "novel", "novel_heldout")


def affordances(results: Results) -> Iterator[Content]:
    """Table 3: what can be done with entities right after insertion, as the embedding ranks it."""
    if results.affordances is None:
        return
    settings, experiment = results.params.affordances, results.affordances.experiment
    answers, initializers = answers_of(results.affordances, settings.relation), experiment.initializers
    first = [*isi(initializers), *([BASELINE] if BASELINE in initializers else [])]
    others = [name for name in initializers if name not in first]
    yield Content(
        {
            "answers": answers, "top": TOP, "source": results.source_title(answers.source), "others": others,
            "tested": contenders(initializers), "controls": controls(initializers),
            "inserted": int((experiment.novel["session"] == 1).sum()),
            "number": int(answers.entities["kind"].isin(answers.kinds).sum()),
        },
        [
            Table.of("table3_affordances", ranked(answers, settings.entities, first)),
            Table.of("table3_others", ranked(answers, settings.entities, others)),
            affordance_shares(answers, initializers),
        ],
    )  # fmt: skip


@dataclass(frozen=True)
class Answers:
    """The ranked answers to (entity, relation, ?) of one experiment."""

    #: ``tables.AFFORDANCES``, with a column ``model``
    ranks: pd.DataFrame
    #: by id
    entities: pd.DataFrame
    relation: str
    #: kinds of the relation's tails: answers of other kinds are wrong
    kinds: Sequence[str]
    #: source of the entities that every repeat has: those that are shown as answers
    source: str

    @property
    def plural(self) -> str:
        """The kinds in words: affordances."""
        return joined(f"{kind}s" for kind in self.kinds)

    def repeats(self, entity: str) -> int:
        """How many repeats inserted an entity."""
        return int(self._of(entity)["seed"].nunique())

    def _of(self, entity: str) -> pd.DataFrame:
        return self.ranks[self.ranks["entity"].isin(self.entities.index[self.entities["entity"] == entity])]

    def top(self, model: str, entity: str) -> list[tuple[str, str]]:
        """The answers of lowest mean rank over the repeats that inserted an entity, each with its kind."""
        ranks = self._of(entity)
        known = ranks[(ranks["model"] == model) & (ranks["answer"].map(self.entities["source"]) == self.source)]
        best = known.groupby("answer")["rank"].mean().sort_values(kind="stable").index[:TOP]
        return [(str(answer), str(kind)) for answer, kind in self.entities.loc[best, ["entity", "kind"]].to_numpy()]

    def judged(self, model: str, entities: Sequence[str], afforded: Mapping[str, Sequence[str]]) -> dict[str, int]:
        """How many of the answers about some entities are of the relation's kinds, and how many are wrong.

        Args:
            afforded: what is plausible, by entity; where all are judged, also how many are that, and unlikely.
        """
        tops = [(entity, *answer) for entity in entities for answer in self.top(model, entity)]
        hits = [(entity, answer) for entity, answer, kind in tops if kind in self.kinds]
        counts = {"affordances": len(hits), "wrong": len(tops) - len(hits)}
        if all(entity in afforded for entity in entities):
            counts["plausible"] = sum(answer in afforded[entity] for entity, answer in hits)
            counts["unlikely"] = len(hits) - counts["plausible"]
        return counts

    @property
    def hits(self) -> pd.DataFrame:
        """The highest-ranked answers of all inserted entities, and whether they are of the relation's kinds."""
        rows = self.ranks[self.ranks["rank"] <= TOP]
        return rows.assign(hit=rows["answer"].map(self.entities["kind"]).isin(self.kinds))

    @property
    def shares(self) -> dict[str, float]:
        """Of the highest-ranked answers of all inserted entities, how many are of these kinds, in per cent."""
        return {str(model): float(value) for model, value in (100 * self.hits.groupby("model")["hit"].mean()).items()}


def answers_of(analysis: Analysis[pd.DataFrame], relation: str) -> Answers:
    """The answers of the analysis; ``relation``: of its queries."""
    experiment = analysis.experiment
    tails = experiment.triples.loc[experiment.triples["relation"] == relation, "tail"]
    kind_of = experiment.entities.set_index("entity")["kind"]
    kinds = sorted(kind_of[tails.unique()].unique())
    return Answers(analysis.result, experiment.entities, relation, kinds, experiment.settings.graph.source)


def ranked(answers: Answers, entities: Sequence[str], models: Sequence[str]) -> list[dict[str, Any]]:
    """The first answers about some entities, a column an initializer; those of another kind are marked."""
    rows = []
    for entity in entities:
        tops = {model: answers.top(model, entity) for model in models}
        for place in range(TOP):
            row = {"entity": f"{entity} (n = {answers.repeats(entity)})", "": f"{place + 1}."}
            for model, top in tops.items():
                marks = [f"{'' if kind in answers.kinds else '× '}{answer} ({kind})" for answer, kind in top]
                row[label(model)] = marks[place] if place < len(marks) else "–"
            rows.append(row)
    return rows


def affordance_shares(answers: Answers, initializers: Sequence[str]) -> Table:
    """How often the highest-ranked answers are of the relation's kinds, over everything that was inserted."""
    rows = answers.hits
    every, first = (over_seeds(hits, ["model"], {"hit": "hit"})["hit"] for hits in (rows, rows[rows["rank"] == 1]))
    return Table.of("affordance_shares", [
        {"initializer": label(name), f"top {TOP}: {answers.plural} %": every.get(name),
         f"first: {joined(answers.kinds)} %": first.get(name)}
        for name in initializers
    ])  # fmt: skip
