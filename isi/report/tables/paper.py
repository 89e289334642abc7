"""The paper's numbers beside this run's, and how far its results are repeated."""

from collections.abc import Mapping
from functools import cache
from itertools import product
from math import isnan, nan
from pathlib import Path
from typing import Any

import pandas as pd

from isi import config
from isi.config import value_of
from isi.report.tables.data import BASELINE, JOINT, Experiment, Results, read
from isi.report.tables.estimates import (
    ENDS,
    Line,
    drops,
    epochs_summary,
    improvements,
    named,
    where,
)
from isi.report.tables.forms import ANY_SIZE
from isi.report.tables.method import best_setting, indicator_means, picked_sizes, table1
from isi.report.tables.registry import table
from isi.report.tables.results import TOP, about_new, answers_of, by_label
from isi.tables.io import opening

#: The rows of the tables of all numbers; the file says how they are written.
_ROWS = Path(__file__).with_name("paper_rows.yaml")
#: A number of this run agrees with the paper's if it differs by at most this share.
AGREES = 0.1


@table("report")
def answer(results: Results) -> pd.DataFrame | None:
    """The answer of the report: measures of a few initializers, with the paper's below."""
    first, paper = results.standalone[0], results.paper
    models = [BASELINE, "mean", *first.methods, "map", JOINT]
    models = [name for name in models if name in first.rows]
    scope = about_new(first)
    cost = 100 * first.immediate.pivot_table("mrr_star", "model", "scope", observed=True)
    titles = {
        "given": "entity MRR* with the novel entity given",
        "novel": "MRR* about novel entities",
    }
    rows: Line = {
        "MRR* over all queries, right after insertion": first.means("all")["mean"],
        "gain over Xavier, %": improvements(first.immediate, "all")["gain"].drop(
            [BASELINE, JOINT], errors="ignore"
        ),
        "gain over Xavier in the paper, %": paper["immediate"]["improvement_over_xavier"],
        f"{titles[scope]}, right after insertion": first.means(scope)["mean"],
        "epochs of fine-tuning, over all queries": first.epochs("all")["mean"],
        "epochs of fine-tuning in the paper, over all queries": {
            name: of["mean"] for name, of in paper["convergence"]["epochs"].items()
        },
        "epochs of fine-tuning, about the novel entity": first.epochs("novel_heldout")["mean"],
        "earlier knowledge loses, points of MRR*": (cost["known_closed"] - cost["known"]).drop(
            JOINT, errors="ignore"
        ),
    }
    frame = pd.DataFrame({name: pd.Series(values, dtype=float) for name, values in rows.items()}).T
    shown = frame.reindex(columns=models).rename(columns=first.models.labels)
    return shown.dropna(how="all").rename_axis("measure").reset_index()


#: Kinds of the printed results, as ``readings.yaml`` names them, with the titles of their rows.
_KINDS = {
    "gains over Xavier (%)": "immediate gain over Xavier, all queries, %",
    "epochs to convergence, means": "epochs to convergence, mean",
    "epochs to convergence, deviations": "epochs to convergence, standard deviation",
    "transfer: MRR*, all queries": "immediate MRR*, all queries",
    "transfer: MRR*, new entities": "immediate MRR*, new entities' queries",
    "best number of indicators": (
        "indicator set size of the best immediate MRR*, all queries (paper: falls beyond)"
    ),
    "transfer: epochs": "epochs to convergence after the transfer",
    "transfer: drop (%)": "immediate drop of MRR* over {first}'s entities, %",
}


@table("report")
def paper_dots(results: Results) -> pd.DataFrame:
    """The printed results by kind: the paper's number, this run's, and that of one reading of the
    metric on the paper's own graph, with its interval.
    """
    titles = {
        title.format(first=results.standalone[0].title): kind for kind, title in _KINDS.items()
    }
    rows = rows_of(results, results.standalone[0], "printed")
    rows[["whose", "title"]] = rows["what"].str.split(": ", n=1, expand=True)
    rows["kind"] = pd.Categorical(rows["title"].map(titles), list(_KINDS))
    rows["this run is"] = list(map(comparison, rows["paper"], rows["this run"]))
    rows = rows.dropna(subset="kind").sort_values("kind", kind="stable")
    columns = {f"this reading{end}": f"one reading{end}" for end in ENDS}
    columns["this reading: the paper is"] = "the paper is"
    readings = _readings("paper_results").rename(columns=columns)
    shown = [name for name in ("kind", "whose", *columns.values()) if name in readings]
    rows = rows[["kind", "whose", "paper", "this run", "this run is"]]
    return rows.merge(readings[shown], "left", ["kind", "whose"])


@table("report")
def repeated(results: Results) -> pd.DataFrame:
    """How far the paper is repeated, by kind of result: results of this run within 10 % of the
    paper's, and those where the paper's is within the interval on its own graph, of one reading and
    of the best reading of the kind.
    """
    rows, kinds = paper_dots(results), _readings("results_by_kind").set_index("results")
    lines = list[Line]()
    for kind, of_kind in [*rows.groupby("kind", sort=False), ("all", rows)]:
        line: Line = {"results": kind, "number": len(of_kind)}
        line["this run: within 10 %"] = int((of_kind["this run is"] == "agrees").sum())
        if len(kinds):
            for column, title in (
                ("this reading", "the paper's graph, one reading: within the interval"),
                ("most of the allowed", "the best reading of the kind: within"),
            ):
                line[title] = int(kinds[column][str(kind)])
        lines.append(line)
    return pd.DataFrame(lines)


def _readings(name: str) -> pd.DataFrame:
    """A table about readings of the paper's metric, as the second pipeline left it; else empty.

    They are no dependency of the stage: it would run that pipeline for an hour. ``make beyond``
    makes these tables again.
    """
    path = Path(f"reports/readings/tables/{name}.csv")
    if not path.exists():
        return pd.DataFrame(columns=["kind", "whose", "results"])
    with opening(path, "a table of the report", ValueError):
        return pd.read_csv(path)


@table("report")
def paper_against_this_run(results: Results) -> pd.DataFrame:
    """The results that the paper prints, beside ours."""
    return _beside(results, "printed")


@table("report")
def papers_other_numbers(results: Results) -> pd.DataFrame:
    """All other numbers of the paper, beside ours."""
    return _beside(results, "others")


def _beside(results: Results, kind: str) -> pd.DataFrame:
    first, *others = results.standalone
    frame = rows_of(results, first, kind)
    notes = frame.pop("note")
    for other in others:
        frame[other.name] = rows_of(results, other, kind)["this run"]
    if kind == "printed":
        frame["this run is"] = list(map(comparison, frame["paper"], frame["this run"]))
    else:
        frame["note"] = notes
    frame.attrs[ANY_SIZE] = ["paper", "this run", *(other.name for other in others)]
    return frame


def comparison(paper: float, ours: float) -> str:
    """Whether a number agrees with the paper's within ``AGREES`` of it, is larger or smaller;
    empty without both.
    """
    if isnan(paper) or isnan(ours):
        return ""
    if abs(ours - paper) <= AGREES * abs(paper):
        return "agrees"
    return "larger" if ours > paper else "smaller"


@table("report")
def standalone_graphs(results: Results) -> pd.DataFrame | None:
    """The graphs with one source side by side."""
    graphs = [each for each in results.standalone if each.queries is not None]
    if len(graphs) < 2:
        return None
    columns = dict[str, Any]()
    for graph in graphs:
        columns |= named(graph.means("all"), "mean", f"{graph.title}: all")
        given = graph.means("given")
        columns |= named(given, "mean", f"{graph.title}: novel entity given")
        columns |= named(graph.epochs("novel_heldout"), "mean", f"{graph.title}: mean")
    models = list(dict.fromkeys(name for graph in graphs for name in graph.rows))
    return by_label(results.models, models, columns)


def rows_of(results: Results, experiment: Experiment, kind: str) -> pd.DataFrame:
    """Numbers of the paper (``printed`` or ``others`` of the file of rows) beside those of one
    experiment; the rows do not depend on what was run.
    """
    theirs, ours = _papers(results.paper), _ours(results, experiment)
    labels = results.models.labels
    filled = {
        "answers": TOP * len(results.params.affordances.entities),
        "first": results.standalone[0].title,
    }
    rows = list[tuple[str, str, float, float, str]]()
    for section, titles, key, *ours_key in config.read(_ROWS)[kind]:
        named = value_of(theirs, key)
        names = list(named) if isinstance(named, dict) else [""]
        parts = titles if isinstance(titles, dict) else {"": titles}
        for name, (part, title) in product(names, parts.items()):
            place = "".join(f".{step}" for step in (name, part) if step)
            number = value_of(theirs, key + place)
            value, note = value_of(ours, (*ours_key, key)[0] + place), ""
            if isinstance(value, tuple):
                value, note = value
            text = (f"{labels.get(name, name)}: {title}" if name else title).format(**filled)
            of_paper, of_run = (nan if each is None else float(each) for each in (number, value))
            rows.append((section, text, of_paper, of_run, note))
    return pd.DataFrame(rows, columns=["where", "what", "paper", "this run", "note"])


def _mean_of(numbers: Mapping[Any, float], models: list[str]) -> float:
    """The mean over the models that have a number; NaN if none has one."""
    return float(pd.Series(numbers, dtype=float).reindex(models).mean())


def _papers(paper: Mapping[str, Any]) -> dict[str, Any]:
    """The paper's numbers, and what follows from them."""
    methods, saved = list(paper["indicators"]), paper["convergence"]["fewer_epochs_than_xavier"]
    gained, answers = paper["immediate"]["improvement_over_xavier"], paper["affordances"]
    moved_epochs = paper["transfer"]["epochs"]
    whose = dict.fromkeys(methods, "isi") | {BASELINE: "xavier"}
    return {
        **paper,
        "means": {"gain": _mean_of(gained, methods), "fewer": saved.get("mean")},
        "fewer_epochs": {name: saved.get(name) for name in methods},
        "best_indicators": dict.fromkeys(methods, paper["indicators_degrade_after"]),
        "inferred_epochs": {
            name: epochs for name, epochs in moved_epochs.items() if name != BASELINE
        },
        "judged": {
            name: answers["judged"][who] | {"affordances": answers[who]}
            for name, who in whose.items()
        },
    }


@cache
def _ours(results: Results, experiment: Experiment) -> dict[str, Any]:
    """This run's numbers under the keys of the paper's."""
    methods, source = list(results.paper["indicators"]), experiment.settings.graph.source
    of_source = (other for other in results.extended if other.settings.graph.source == source)
    moved = next(of_source, None)
    gain = improvements(experiment.immediate, "all")["gain"].to_dict()
    epochs = experiment.epochs("all")["mean"]  # per cent below Xavier's: section 6.2
    fewer = (100 * (1 - epochs / (epochs.get(BASELINE) or nan))).to_dict()
    transfer = dict[str, Any]()
    if moved:
        transfer = {
            "all_queries": moved.means("all")["mean"].to_dict(),
            "novel_queries": moved.means("novel")["mean"].to_dict(),
            "drop": drops(moved.immediate)["drop"].to_dict(),
            "epochs": moved.epochs("all")["mean"].to_dict(),
        }
    return {
        "means": {"gain": _mean_of(gain, methods), "fewer": _mean_of(fewer, methods)},
        "fewer_epochs": fewer,
        "immediate": {"improvement_over_xavier": gain},
        "graph": _graph(results, experiment),
        "settings": {"finetuning_rate": results.params.finetuning.learning_rate},
        **_choices(results, experiment),
        "convergence": {
            "epochs": _epochs(experiment, "all"),
            "heldout": _epochs(experiment, "novel_heldout"),
        },
        "transfer": transfer,
        "judged": _judged(results, experiment, moved, [*methods, BASELINE]),
    }


def _graph(results: Results, experiment: Experiment) -> dict[str, Any]:
    """The size of the graph, and Table 1."""
    words, entities, triples = results.vocabulary, experiment.entities, experiment.triples
    kinds, bowls = entities["kind"].value_counts(), triples
    for end, names in words["bowls_in_cabinets"].items():
        bowls = bowls[bowls[end].isin(names)]
    observations = read(f"data/observations/{experiment.settings.graph.source}.parquet")
    counts = pd.DataFrame()
    if observations["scene"].notna().any():
        counts = table1(observations, results.paper["graph"]["median_per_environment"], words)
        counts = counts.set_index("room").rename(columns={"object types": "entities"})
    return {
        "relations": triples["relation"].nunique(),
        "entities": len(entities),
        "unique_triples": len(triples),
        "concepts": kinds.reindex(words["concepts"]).sum(),
        **{kind: kinds.get(kind, 0) for kind in words["kinds"]},
        "observations": triples["count"].sum(),
        "bowls_in_cabinets": bowls["count"].sum(),
        "median_per_environment": counts.to_dict("index"),
    }


def _choices(results: Results, experiment: Experiment) -> dict[str, Any]:
    """Best settings in cross-validation, each with a note, and the sizes that the rule picks."""
    picked = dict[str, dict[str, Any]](training={}, indicators={}, best_indicators={})
    if experiment is not results.standalone[0]:
        return picked
    folds = experiment.analysis("cross_validation")
    choice = results.params.settings[0].model_dump()
    if folds is not None:
        picked["training"] = {name: best_setting(folds, choice, name) for name in choice}
    means = indicator_means(results)
    if means is not None:
        picked["indicators"] = picked_sizes(means)
        best = means["all: MRR*"].unstack("model").dropna(axis=1, how="all").idxmax()
        picked["best_indicators"] = {str(name): int(k) for name, k in best.items()}
    return picked


def _epochs(experiment: Experiment, scope: str) -> dict[Any, Any]:
    """Table 2 in one scope, by model: mean and standard deviation of the epochs to convergence."""
    summary = epochs_summary(where(experiment.convergence, scope=scope), ["model"])
    return dict(summary.rename(columns={"std": "deviation"}).to_dict("index"))


def _judged(
    results: Results, experiment: Experiment, moved: Experiment | None, models: list[str]
) -> dict[str, Any]:
    """Table 3 by model: how many of the answers shown are affordances, and how many are plausible,
    unlikely, wrong.
    """
    answers = answers_of(results)
    if answers is None or answers.experiment not in (experiment, moved):
        return {}
    ran = set(answers.ranks["model"])
    return {name: answers.judged(name) for name in models if name in ran}
