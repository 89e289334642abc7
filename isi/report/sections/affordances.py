"""Table 3: what can be done with entities right after insertion, as the embedding ranks it (section 6.3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from isi.report.models import BASELINE, contenders, controls, isi, label
from isi.report.prose import joined, listed
from isi.report.results import Results, Study
from isi.report.section import Content, Section, Table
from isi.report.statistics import over_seeds

#: Answers that are shown and counted.
TOP = 4


@dataclass(frozen=True)
class Answers:
    """The ranked answers to (entity, relation, ?) of one experiment."""

    #: ``tables.AFFORDANCES``, with a column ``model``
    ranks: pd.DataFrame
    #: by id
    entities: pd.DataFrame
    relation: str
    #: kinds of what the relation leads to: answers of these are such as were asked for
    kinds: Sequence[str]
    #: source of the entities that every repeat has: what is shown as an answer
    source: str

    @property
    def what(self) -> str:
        """What was asked for: affordances."""
        return joined(f"{kind}s" for kind in self.kinds)

    def repeats(self, entity: str) -> int:
        """How many repeats inserted an entity."""
        ids = self.entities.index[self.entities["entity"] == entity]
        return int(self.ranks.loc[self.ranks["entity"].isin(ids), "seed"].nunique())

    def top(self, model: str, entity: str) -> list[tuple[str, str]]:
        """The answers of lowest mean rank over the repeats that inserted an entity, each with its kind."""
        ids = self.entities.index[self.entities["entity"] == entity]
        own = self.ranks[(self.ranks["model"] == model) & self.ranks["entity"].isin(ids)]
        old = own[own["answer"].map(self.entities["source"]) == self.source]
        best = old.groupby("answer")["rank"].mean().sort_values(kind="stable").index[:TOP]
        return [(str(answer), str(kind)) for answer, kind in self.entities.loc[best, ["entity", "kind"]].to_numpy()]

    def judged(self, model: str, entities: Sequence[str], afforded: Mapping[str, Sequence[str]]) -> dict[str, int]:
        """How many of the answers about some entities are such as were asked for, and how many are wrong.

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
        """The highest-ranked answers of all inserted entities, and whether they are such as were asked for."""
        rows = self.ranks[self.ranks["rank"] <= TOP]
        return rows.assign(hit=rows["answer"].map(self.entities["kind"]).isin(self.kinds))

    @property
    def shares(self) -> dict[str, float]:
        """Of the highest-ranked answers of all inserted entities, how many are such, in per cent."""
        return {str(model): float(value) for model, value in (100 * self.hits.groupby("model")["hit"].mean()).items()}


def answers(study: Study[pd.DataFrame], relation: str) -> Answers:
    """Those of the study; ``relation``: by which they were asked for."""
    experiment = study.experiment
    tails = experiment.triples.loc[experiment.triples["relation"] == relation, "tail"]
    kind_of = experiment.entities.set_index("entity")["kind"]
    kinds = sorted(kind_of[tails.unique()].unique())
    return Answers(study.found, experiment.entities, relation, kinds, experiment.how.graph.source)


def contents(results: Results) -> Iterator[Content]:
    """Shares of answers in words, Table 3, and shares."""
    if results.affordances is None:
        return
    how, experiment = results.params.affordances, results.affordances.experiment
    found, initializers = answers(results.affordances, how.relation), experiment.initializers
    first = [*isi(initializers), *([BASELINE] if BASELINE in initializers else [])]
    yield in_words(found, initializers)
    source = results.source_title(found.source)
    yield ranked(
        found, how.entities, first, "table3_affordances", "Table 3. Answers right after insertion",
        f"The {TOP} highest-ranked answers to (entity, {found.relation}, ?), each with its kind, by mean rank over the "
        f"n repeats that inserted the entity. Answers are the entities of {source}, which every repeat has. Those that "
        "are of another kind than the relation leads to are marked ×.",
    )  # fmt: skip
    others = [name for name in initializers if name not in first]
    if others:
        title = "Table 3 with the other initializers"
        yield ranked(found, how.entities, others, "table3_others", title, "As Table 3.", folded=True)
    yield shares(found, initializers, int((experiment.novel["session"] == 1).sum()))


def in_words(found: Answers, initializers: Sequence[str]) -> str:
    """How many of the highest-ranked answers are such as were asked for."""
    percent, others = "{:.0f} %", controls(initializers)
    text = (
        f"How many of the {TOP} highest-ranked answers to (entity, {found.relation}, ?) right after insertion are "
        f"{found.what} at all: {listed(found.shares, contenders(initializers), percent)}"
    )
    if others:
        text += f"; with the controls, {listed(found.shares, others, percent)}"
    return (
        f"{text}. Such an answer need not be true. (Table 3 ranks earlier entities alone, by mean rank; these shares "
        "are of all entities of D¹, repeat by repeat.)"
    )


def ranked(
    found: Answers, entities: Sequence[str], models: Sequence[str], name: str, title: str, caption: str,
    folded: bool = False,
) -> Table:  # fmt: skip
    """The first answers about some entities, a column an initializer."""
    lines = []
    for entity in entities:
        tops = {model: found.top(model, entity) for model in models}
        for place in range(TOP):
            shown = {label(model): _marked(found, *answers[place]) if place < len(answers) else "–"
                     for model, answers in tops.items()}  # fmt: skip
            lines.append({"entity": f"{entity} (n = {found.repeats(entity)})", "": f"{place + 1}.", **shown})
    return Table(name, title, caption, pd.DataFrame(lines), folded=folded)


def _marked(found: Answers, answer: str, kind: str) -> str:
    return f"{'' if kind in found.kinds else '× '}{answer} ({kind})"


def shares(found: Answers, initializers: Sequence[str], inserted: int) -> Table:
    """How often the highest-ranked answers are such as were asked for, over everything that was inserted."""
    rows, one = found.hits, joined(found.kinds)
    first = rows[rows["rank"] == 1]
    parts = [over_seeds(own, ["model"], {"hit": name}).reindex(list(initializers))
             for own, name in ((rows, f"top {TOP}: {found.what} %"), (first, f"first: {one} %"))]  # fmt: skip
    frame = pd.concat(parts, axis=1).reset_index(drop=True)
    frame.insert(0, "initializer", [label(name) for name in initializers])
    number = int(found.entities["kind"].isin(found.kinds).sum())
    return Table(
        "affordance_shares",
        f"How often the highest-ranked answers are {found.what}",
        f"Of the {TOP} highest-ranked answers to (entity, {found.relation}, ?) among all entities of D¹, in each "
        f"repeat, over all {inserted} inserted entities: how many are {found.what}, whichever they are, of which there "
        f"are {number}. Intervals are over repeats.",
        frame,
    )


SECTION = Section("affordances", "What can be done with new entities", contents)
