"""MRR* by kind of query (novel entity given or hidden, by relation, with two filters),
and Table 3 (section 6.3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd

from isi.report.charts import by_size
from isi.report.data import Experiment, Results
from isi.report.section import Content, Contents, Tables, of_each
from isi.report.stats import (
    DIRECTIONS,
    Estimates,
    Values,
    by_label,
    by_model,
    combined,
    means,
    values,
    where,
)
from isi.report.tables import Column, Rows
from isi.report.words import BASELINE, HALVES, JOINT, SCOPE, Names, contenders, isi, joined, label

#: Number of highest-ranked answers that are shown and counted.
TOP = 4
_PLACES = {"given": "given", "answer": "answer", "both": "both", "any": "any or none"}
_FILTERS = {"learned": "scope's filter", "true": "all true"}
_CELL = ("model", "size", "seed")
_PAIR = ["scope", "relation", "hidden", "novel"]


def query_breakdown(results: Results) -> Contents:
    """MRR* by direction, by relation, and with both filters,
    for each experiment with a query breakdown.
    """
    experiments = results.experiments.values()
    ran = [
        experiment
        for experiment in experiments
        if experiment.queries is not None and len(experiment.queries)
    ]
    return of_each(ran, _breakdown)


def _breakdown(experiment: Experiment) -> Content:
    models, given, rows = experiment.models, experiment.directions, pd.DataFrame(experiment.queries)
    pairs, by_filter = by_relation(rows), filters(rows)
    shown = {half: _filters_of(by_filter[half]) for half in HALVES}
    numbers = {
        "leaders": {direction: leader(estimates) for direction, estimates in given.items()},
        "joint": {
            direction: values(estimates).get(JOINT) for direction, estimates in given.items()
        },
    }
    drawn = by_size(
        experiment.directed,
        models,
        list(DIRECTIONS),
        ["mrr_star_entity"],
        list(DIRECTIONS.values()),
    )
    columns = {model: label(model) for model in models if model in pairs}
    pairs = pairs[["scope", "query", "novel entity", "queries", *columns]].rename(
        columns=columns | {"scope": SCOPE}
    )
    tables: Tables = {
        "directions": by_label(models, {title: given[name] for name, title in DIRECTIONS.items()}),
        "by_relation": pairs,
        "filters": [
            {SCOPE: scope, "model": label(model)}
            | {
                Column(title, half): by_filter[column].get((scope, model, name))
                for column, half in HALVES.items()
                for name, title in shown[column].items()
            }
            for scope in ("all", "novel")
            for model in models
        ],
    }
    return Content(numbers, tables, {"directions": drawn})


def leader(estimates: Estimates) -> tuple[str, float, Values] | None:
    """The initializer of the highest mean, this mean, and the means of all but controls;
    None if all are missing.
    """
    means = values({name: estimates[name] for name in estimates if name != JOINT})
    present = {name: mean for name, mean in means.items() if not pd.isna(mean)}
    if not present:
        return None
    best = max(present, key=lambda name: present[name])
    return best, present[best], {name: present[name] for name in contenders(present)}


def by_relation(rows: pd.DataFrame) -> pd.DataFrame:
    """Entity queries by scope, role of the novel entity, relation, hidden end:
    number, mean MRR* (points) by model.
    """
    rows = where(rows, filter="learned", scope=["all", "novel"], hidden=["head", "tail"])
    rows = rows.assign(novel=rows["novel"].where(rows["scope"] == "novel", "any"))
    means = (
        100 * combined(rows, [*_PAIR, *_CELL]).groupby([*_PAIR, "model"])["mrr_star_entity"].mean()
    )
    queries = rows.groupby([*_PAIR, "model"])["queries"].sum().groupby(_PAIR).first()
    orders = {"scope": ["novel", "all"], "novel": list(_PLACES)}
    frame = means.unstack("model").assign(queries=queries)
    frame = frame.sort_index(
        key=lambda level: level.map(orders[level.name].index) if level.name in orders else level
    )
    frame = frame.reset_index()
    query = [
        f"(?, {relation}, t)" if hidden == "head" else f"(h, {relation}, ?)"
        for relation, hidden in zip(frame["relation"], frame["hidden"], strict=True)
    ]
    return frame.assign(query=query, **{"novel entity": frame["novel"].map(_PLACES)})


def filters(rows: pd.DataFrame) -> pd.DataFrame:
    """MRR* with its halves under each filter: means over sizes and seeds in points, by scope,
    model and filter.
    """
    queries = combined(where(rows, scope=["all", "novel"]), ["scope", "filter", *_CELL])
    return 100 * queries.groupby(["scope", "model", "filter"])[list(HALVES)].mean()


def _filters_of(values: pd.Series) -> dict[str, str]:
    """The filters with their titles; one for both if they give equal values, as where no pair of
    entities has two relations.
    """
    of_filters = values.unstack("filter").dropna()
    if (of_filters["learned"] == of_filters["true"]).all():
        return {"learned": "either filter"}
    return _FILTERS


@dataclass(frozen=True)
class AffordanceAnswers:
    """Ranked answers to (entity, relation, ?) in one experiment:
    ``AFFORDANCES`` with ``initializer`` as ``model``.
    """

    ranks: pd.DataFrame
    entities: pd.DataFrame
    relation: str
    #: kinds of the relation's tails; answers of other kinds are wrong
    kinds: Names
    #: source of the entities that are in every repeat; only these are shown as answers
    source: str

    @classmethod
    def of(cls, experiment: Experiment) -> AffordanceAnswers:
        """The answers that were ranked in an experiment."""
        relation = experiment.params.affordances.relation
        tails = experiment.triples.loc[experiment.triples["relation"] == relation, "tail"]
        kinds = experiment.entities.loc[experiment.entities["entity"].isin(tails), "kind"]
        ranks, source = experiment.analyses["affordances"], experiment.settings.graph.source
        return cls(ranks, experiment.entities, relation, sorted(kinds.unique()), source)

    @property
    def plural(self) -> str:
        """The kinds in the plural, such as "affordances"."""
        return joined(f"{kind}s" for kind in self.kinds)

    def about(self, entity: str) -> pd.DataFrame:
        """The ranks in every repeat that inserted an entity."""
        ids = self.entities.index[self.entities["entity"] == entity]
        return where(self.ranks, entity=list(ids))

    def top(self, model: str, entity: str) -> list[tuple[str, str]]:
        """The ``TOP`` answers of lowest mean rank over the repeats that inserted the entity,
        each with its kind.
        """
        ranks = self.about(entity)
        known = ranks[
            (ranks["model"] == model)
            & (ranks["answer"].map(self.entities["source"]) == self.source)
        ]
        best = known.groupby("answer")["rank"].mean().sort_values(kind="stable").index[:TOP]
        return list(self.entities.loc[best, ["entity", "kind"]].itertuples(index=False, name=None))

    def judged(self, model: str, entities: Names, afforded: Mapping[str, Names]) -> dict[str, int]:
        """Number of ``top`` answers of a right kind
        (plausible: in ``afforded``, or unlikely) and of a wrong kind.
        """
        tops = [(entity, *answer) for entity in entities for answer in self.top(model, entity)]
        hits = [(entity, answer) for entity, answer, kind in tops if kind in self.kinds]
        counts = {"affordances": len(hits), "wrong": len(tops) - len(hits)}
        if all(entity in afforded for entity in entities):
            counts["plausible"] = sum(answer in afforded[entity] for entity, answer in hits)
            counts["unlikely"] = len(hits) - counts["plausible"]
        return counts

    def ranked(
        self,
        entities: Names,
        models: Names,
        afforded: Mapping[str, Names],
        paper: Mapping[str, Mapping[str, Names]],
    ) -> Rows:
        """Rows of ``top`` answers about entities, a column for each initializer, then the paper's.

        × marks an answer of a wrong kind, ? an unlikely one: not in ``afforded``, if this has the
        entity. An entity that the paper lacks stands beside one of the paper's that is not among
        ``entities``.
        """
        rows = []
        named = list(dict.fromkeys(entity for words in paper.values() for entity in words))
        replaced = iter([entity for entity in named if entity not in entities])
        for entity in entities:
            other = entity if entity in named else next(replaced, entity)
            number, likely = self.about(entity)["seed"].nunique(), afforded.get(entity)

            def marked(answer: str, kind: str, likely: Names | None = likely) -> str:
                wrong = kind not in self.kinds
                unlikely = likely is not None and answer not in likely
                return f"{'× ' if wrong else '? ' if unlikely else ''}{answer}"

            answers = {
                label(model): [marked(*answer) for answer in self.top(model, entity)]
                for model in models
            }
            theirs = {f"paper: {name}": words.get(other, []) for name, words in paper.items()}
            title = f"{entity} (n = {number}{f'; paper: {other}' if other != entity else ''})"
            rows += [
                {"entity": title, "": f"{place + 1}."}
                | {
                    name: [*words, *TOP * ["–"]][place]
                    for name, words in (answers | theirs).items()
                }
                for place in range(TOP)
            ]
        return rows

    @property
    def hits(self) -> pd.DataFrame:
        """Rows of ``ranks`` with rank ≤ ``TOP``; column ``hit``:
        whether the kind of the answer is in ``kinds``.
        """
        rows = self.ranks[self.ranks["rank"] <= TOP]
        return rows.assign(hit=rows["answer"].map(self.entities["kind"]).isin(self.kinds))

    @property
    def shares(self) -> Values:
        """Per cent of ``hits`` whose answer has a right kind, by model."""
        return means(self.hits, "hit")

    def shares_table(self, initializers: Names) -> dict[str, list[Any]]:
        """Per cent of answers of a right kind among the ``TOP`` and the first,
        over all inserted entities.
        """
        first = where(self.hits, rank=1)
        listed = {f"top {TOP}: {self.plural} %": self.hits, f"first: {joined(self.kinds)} %": first}
        shares = {title: by_model(rows, "hit", initializers) for title, rows in listed.items()}
        return by_label(initializers, shares, "initializer")


def affordances(results: Results) -> Contents:
    """Table 3: ranked affordances of inserted entities, right after insertion."""
    for experiment, _ in results.analysis("affordances"):
        answers, initializers = AffordanceAnswers.of(experiment), experiment.initializers
        entities = results.params.affordances.entities
        first = [*isi(initializers), *({BASELINE} & set(initializers))]
        others = [name for name in initializers if name not in first]
        afforded, paper = results.vocabulary["afforded"], results.paper["affordances"]["answers"]
        tables = {
            "table3_affordances": answers.ranked(entities, first, afforded, paper),
            "table3_others": answers.ranked(entities, others, afforded, {}),
            "affordance_shares": answers.shares_table(initializers),
        }
        yield Content(
            {"answers": answers, "experiment": experiment, "others": others, "top": TOP}, tables
        )
