"""The paper's numbers beside those of every graph of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pandas as pd

from isi.report import selection, statistics
from isi.report.models import BASELINE, label
from isi.report.prose import joined, mean
from isi.report.results import Experiment, Results, Study
from isi.report.section import Content, Section, Table
from isi.report.sections import affordances, cross_validation, sensitivity, transfer
from isi.report.sections.graph import graph_statistics

_KEY = ["where", "what"]
T = TypeVar("T")


class Row(NamedTuple):
    """A number of the paper, and ours."""

    where: str
    what: str
    paper: float
    #: null where there is none
    ours: float
    #: what there is to say of ours
    note: str = ""


def contents(results: Results) -> Iterator[Content]:
    """One table, where there is a graph of its own to set beside the paper's."""
    if results.own:
        yield against(results)


def against(results: Results) -> Table:
    """The paper against this run: the first graph, and a column for each other."""
    columns = {"this run" if one is results.own[0] else one.name: rows(results, one) for one in results.own}
    stated = next(iter(columns.values()))
    frame = pd.DataFrame([row[:3] for row in stated], columns=[*_KEY, "paper"])
    for name, ours in columns.items():
        values = {row[:2]: row.ours for row in ours}
        frame[name] = [values.get(row[:2], np.nan) for row in stated]
    frame["note"] = [row.note for row in stated]
    others = "".join(f" Column {one.name}: {one.title}." for one in results.own[1:])
    return Table(
        "paper_against_this_run",
        "The paper against this run",
        "Numbers in the paper's abstract, tables and running text of its settings and results; its figures print "
        "none. MRR* in points. The graphs are not the same (AI2-THOR has grown), nor are the joint models, so "
        f"closeness is no goal; order and size are. Notes are on this run.{others}",
        frame,
        dict.fromkeys(("paper", *columns), shown),
        of_any_size=("paper", *columns),
    )


def shown(value: float) -> str:
    """A number of any size, as people read it."""
    value = round(value, 6)  # a mean that is whole but for its last bits
    return f"{value:,.0f}" if float(value).is_integer() else f"{value:.1f}" if abs(value) >= 1 else f"{value:.2g}"


@dataclass(frozen=True)
class _Column:
    """What stands in one column: an experiment with a graph of its own, and what was done with that graph."""

    results: Results
    experiment: Experiment

    @property
    def paper(self) -> Mapping[str, Any]:
        return self.results.paper

    @cached_property
    def gain(self) -> dict[str, float]:
        return statistics.improvement(self.experiment.at_once, "all")

    @cached_property
    def fewer(self) -> dict[str, float]:
        return statistics.fewer_epochs(self.experiment.convergence)

    @property
    def moved(self) -> Experiment | None:
        """The first experiment that inserts entities of another source into this graph."""
        source = self.experiment.how.graph.source
        return next((one for one in self.results.extended if one.how.graph.source == source), None)

    def own(self, study: Study[T] | None) -> Study[T] | None:
        """A study of this graph, or of what was inserted into it; None for others."""
        return study if study and study.experiment in (self.experiment, self.moved) else None


def rows(results: Results, experiment: Experiment) -> list[Row]:
    """All that the paper states, beside one experiment: the same rows whatever was run."""
    column = _Column(results, experiment)
    parts: tuple[Callable[[_Column], Iterator[Row]], ...] = (
        _abstract, _graph, _table1, _settings, _transfer_settings, _studies, _immediate, _convergence, _transfer,
        _affordances,
    )  # fmt: skip
    return [row for part in parts for row in part(column)]


def _abstract(column: _Column) -> Iterator[Row]:
    stated, epochs = column.paper["immediate"], column.paper["convergence"]["fewer_epochs_than_xavier"]
    methods = list(column.paper["indicators"])
    names = joined(label(name) for name in methods)
    what = "gain over Xavier at once, all queries, %"
    theirs = stated["improvement_over_xavier"]
    yield Row(
        "abstract", f"{what}: the figure is ES's", stated["improvement_in_the_abstract"], column.gain.get("es", np.nan)
    )  # fmt: skip
    yield Row("section 6.1", f"{what}: mean of {names}", mean(theirs, methods), mean(column.gain, methods))
    yield Row("abstract", f"fewer epochs than Xavier, %: mean of {names}", epochs.get("mean", np.nan),
              mean(column.fewer, methods))  # fmt: skip


def _graph(column: _Column) -> Iterator[Row]:
    stated, words = column.paper["graph"], column.results.vocabulary
    entities, triples = column.experiment.entities, column.experiment.triples
    kinds = entities["kind"].value_counts()
    bowls, ends = triples, words["bowls_in_cabinets"]
    for end, names in ends.items():
        bowls = bowls[bowls[end].isin(names)]
    ours = {
        "relations": triples["relation"].nunique(),
        "entities": len(entities),
        "concepts": sum(int(kinds.get(kind, 0)) for kind in words["concepts"]),
        **{kind: kinds.get(kind, 0) for kind in stated if kind in words["kinds"]},
        "observations": triples["count"].sum(),
        "unique_triples": len(triples),
        "bowls_in_cabinets": bowls["count"].sum(),
    }
    said = {
        "concepts": "household concepts: objects and rooms", **{kind: f"{kind}s" for kind in words["kinds"]},
        "observations": "observations (paper: over 15,000)", "unique_triples": "unique triples",
        "bowls_in_cabinets": f"observations of ({', '.join(names[0] for names in ends.values())})",
    }  # fmt: skip
    for name, value in ours.items():
        yield Row("section 5.1", said.get(name, name), stated[name], float(value))


def _table1(column: _Column) -> Iterator[Row]:
    stated, words = column.paper["graph"]["median_per_environment"], column.results.vocabulary["relations"]
    observations = column.results.seen[column.experiment.how.graph.source].observations
    counts = pd.DataFrame()
    if observations["scene"].notna().any():
        counts = graph_statistics(observations, stated, words).frame.set_index("room")
    counted = {**{word: f"{word} triples" for word in words.values()}, "entities": "entities", "rooms": "rooms"}
    for room, numbers in stated.items():
        for name, what in counted.items():
            median = "" if name == "rooms" else ", median per environment"
            own = "object types" if name == "entities" else name
            there = room in counts.index and own in counts.columns
            yield Row(
                "Table 1",
                f"{room}: {what}{median}",
                numbers.get(name, np.nan),
                float(counts[own][room]) if there else np.nan,
            )


def _settings(column: _Column) -> Iterator[Row]:
    stated, params, how = column.paper["settings"], column.results.params, column.experiment.how
    most, size = max(how.sessions.sizes), column.experiment.curve_size
    share, shares = 100 / len(column.experiment.entities), stated["shares"]
    candidates = params.initializers.get("ers", {}).get("candidates", np.nan)
    yield Row("section 5.3", "repeats of each set size", stated["repeats"], how.sessions.seeds)
    yield Row("section 6.1", "novel entities inserted at once, at most", stated["largest_size"], most)
    for which, number in (("smallest", min(how.sessions.sizes)), ("largest", most)):
        yield Row("section 6.1", f"the {which} set, % of all entities", shares[which], share * number)
    yield Row("section 6.2", "novel entities in the learning curves", stated["curve_size"], size or np.nan)
    yield Row("section 5.3", "margin of convergence, points of MRR*", stated["margin"], 100 * params.convergence.margin)
    yield Row("section 5.3", "epochs of fine-tuning, at most", stated["max_epochs"], params.finetuning.max_epochs)
    yield Row("section 5.3", "fine-tuning rate", stated["finetuning_rate"], params.finetuning.learning_rate)
    yield Row("section 5.3", "ERS: candidates", stated["candidates"], candidates)


def _transfer_settings(column: _Column) -> Iterator[Row]:
    stated, moved = column.paper["settings"]["transfer"], column.moved
    extend = moved.how.graph.extend if moved else None
    sessions = moved.how.sessions if moved else None
    ours = {
        "candidates": ("candidates", extend.candidates if extend else np.nan),
        "size": ("entities inserted at once", max(sessions.sizes) if sessions else np.nan),
        "min_observations": ("observations, at least", extend.min_observations if extend else np.nan),
        "repeats": ("repeats", sessions.seeds if sessions else np.nan),
    }
    for name, (what, value) in ours.items():
        yield Row("section 6.3", f"transfer: {what}", stated[name], value)


def _studies(column: _Column) -> Iterator[Row]:
    """Cross-validation and the size of the indicator set."""
    results = column.results
    words = {"dimension": "dimension", "ratio": "negatives per positive", "learning_rate": "learning rate of Θ⁰",
             "weight_decay": "weight decay of Θ⁰"}  # fmt: skip
    folds = column.own(results.cross_validation)
    choice = cross_validation.settings_of(results)[0]
    for name, what in words.items():
        best = cross_validation.best(folds.found, choice, name) if folds else np.nan
        note = cross_validation.note(folds.found, choice, name) if folds else ""
        yield Row("section 5.3", f"{what}: best in cross-validation", column.paper["training"][name], best, note)
    rule = {"neighbours": ("neighbouring sizes averaged", selection.NEIGHBOURS),
            "epochs": ("grow while so many epochs are gained", selection.EPOCHS),
            "points": ("stop where MRR* is so many points below the best", 100 * selection.LOSS)}  # fmt: skip
    for name, (what, ours) in rule.items():
        yield Row("section 5.3", f"rule: {what}", column.paper["indicators_rule"][name], ours)
    picked: dict[str, int] = {}
    tops: dict[str, int] = {}
    if sweep := column.own(results.sweep):
        found = sensitivity.means(*sensitivity.measured(sweep), list(results.params.sweep.initializers))
        picked, tops = sensitivity.picked_sizes(found), sensitivity.best_sizes(found)
    for name, stated in column.paper["indicators"].items():
        what = f"{label(name)}: indicator set size that the rule picks"
        yield Row("section 5.3", what, stated, picked.get(name, np.nan))
    for name in column.paper["indicators"]:
        what = f"{label(name)}: indicator set size of the best immediate MRR*, scope all (paper: falls beyond)"
        yield Row("section 5.3", what, column.paper["indicators_degrade_after"], tops.get(name, np.nan))


def _immediate(column: _Column) -> Iterator[Row]:
    for name, stated in column.paper["immediate"]["improvement_over_xavier"].items():
        what = f"{label(name)}: gain over Xavier at once, all queries, %"
        yield Row("section 6.1", what, stated, column.gain.get(name, np.nan))


def _convergence(column: _Column) -> Iterator[Row]:
    stated, cells = column.paper["convergence"], column.experiment.convergence
    scopes = {"all": "", "novel_heldout": ", asked about held-out triples of the novel entities instead"}
    for scope, asked in scopes.items():
        epochs = cells[cells["scope"] == scope].groupby("model")["epochs"]
        means, deviation = epochs.mean(), epochs.std(ddof=1)
        for name, numbers in stated["epochs"].items():
            what = f"{label(name)}: epochs to convergence, mean{asked}"
            yield Row("Table 2", what, numbers["mean"], means.get(name, np.nan))
            what = f"{label(name)}: epochs to convergence, standard deviation{asked}"
            yield Row("Table 2", what, numbers["deviation"], deviation.get(name, np.nan))
    for name in column.paper["indicators"]:
        what = f"{label(name)}: fewer epochs than Xavier, %"
        theirs = stated["fewer_epochs_than_xavier"].get(name, np.nan)
        yield Row("section 6.2", what, theirs, column.fewer.get(name, np.nan))


def _transfer(column: _Column) -> Iterator[Row]:
    stated, moved = column.paper["transfer"], column.moved
    models = moved.initializers if moved else []
    means = statistics.mrr_star(moved.at_once, models) if moved else {}
    epochs = statistics.epochs(moved.convergence, models) if moved else {}
    dropped = transfer.drop(moved.at_once) if moved else {}
    base = column.results.own[0].title
    parts = (
        ("all_queries", "MRR* at once, all queries", means.get("all", {})),
        ("novel_queries", "MRR* at once, new entities' queries", means.get("novel", {})),
        ("epochs", "epochs to convergence after the transfer", epochs.get("all", {})),
        ("drop", f"drop of MRR* over {base}'s entities at once, %", dropped),
    )
    for key, what, ours in parts:
        for name, number in stated[key].items():
            yield Row("section 6.3", f"{label(name)}: {what}", number, ours.get(name, np.nan))


def _affordances(column: _Column) -> Iterator[Row]:
    stated, how = column.paper["affordances"], column.results.params.affordances
    study, judged = column.own(column.results.affordances), column.results.vocabulary["afforded"]
    found = affordances.answers(study, how.relation) if study else None
    for name in (*column.paper["indicators"], BASELINE):
        who = "xavier" if name == BASELINE else "isi"
        ran = found is not None and name in set(found.ranks["model"])
        counts = found.judged(name, how.entities, judged) if found and ran else {}
        shown = f"{label(name)}: of {affordances.TOP * len(how.entities)} answers shown, how many are"
        for how_so, number in {"affordances": stated[who], **stated["judged"][who]}.items():
            yield Row("Table 3", f"{shown} {how_so}", number, counts.get(how_so, np.nan))


SECTION = Section("paper", "The paper's numbers beside ours", contents)
