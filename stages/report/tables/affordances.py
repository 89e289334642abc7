"""Ranked answers about inserted entities (Table 3)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import pandas as pd

from stages.report.tables.data import Experiment, Results
from stages.report.tables.estimates import BASELINE, where
from stages.report.tables.registry import of_each, table

#: Number of highest-ranked answers that are shown and counted.
TOP = 4


@dataclass(frozen=True, eq=False)
class AffordanceAnswers:
    """Ranked answers to (entity, relation, ?) in one experiment (Table 3)."""

    experiment: Experiment
    ranks: pd.DataFrame  #: rows by model, seed, entity and answer
    shown: Sequence[str]  #: the entities of the table
    kinds: Sequence[str]  #: of the relation's tails; answers of other kinds are wrong
    afforded: Mapping[str, Sequence[str]]

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

    def rows(
        self, models: Sequence[str], paper: Mapping[str, Mapping[str, Sequence[str]]]
    ) -> pd.DataFrame:
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
            answers = dict[str, Sequence[str]]()
            for model in models:
                answers[self.experiment.models.labels[model]] = [
                    marked(answer, kind in self.kinds, self.afforded.get(entity))
                    for answer, kind in self.top(model, entity)
                ]
            answers |= {f"paper: {name}": words.get(other, []) for name, words in paper.items()}
            parts.append(in_ranks(f"{entity} (n = {number}{beside})", answers))
        return pd.concat(parts)


def in_ranks(entity: str, answers: Mapping[str, Sequence[str]]) -> pd.DataFrame:
    """The first ``TOP`` answers about an entity: a row for each rank, a column for each name."""
    columns = {name: pd.Series(words[:TOP], dtype=object) for name, words in answers.items()}
    frame = pd.DataFrame(columns, index=range(TOP)).fillna("–")
    frame.insert(0, "entity", entity)
    frame.insert(1, "", [f"{rank}." for rank in range(1, 1 + TOP)])
    return frame


def marked(answer: str, is_right: bool, likely: Sequence[str] | None) -> str:
    """An answer, with × if it is of a wrong kind, and ? if it is not among the likely ones."""
    if not is_right:
        return f"× {answer}"
    return f"? {answer}" if likely is not None and answer not in likely else answer


@cache
def answers_of(results: Results, experiment: Experiment) -> AffordanceAnswers | None:
    """The ranked answers of an experiment, read once for all tables; None where it has none."""
    settings, ranks = results.params.affordances, experiment.affordances
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


@table("report")
def table3_by_entity(results: Results) -> pd.DataFrame | None:
    """Table 3 with a row for each entity: the answers of each initializer, best first."""
    ranked = table3_affordances(results)
    return None if ranked is None else by_entity(ranked)


def by_entity(ranked: pd.DataFrame) -> pd.DataFrame:
    """Ranked answers below each other as one text for each entity."""
    groups = ranked.drop(columns="").fillna("").groupby(["graph", "entity"], sort=False)
    joined: pd.DataFrame = groups.agg(", ".join)
    return joined.reset_index()
