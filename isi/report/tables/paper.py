"""The paper's numbers beside this run's."""

from functools import cache
from itertools import product
from math import isnan, nan
from pathlib import Path
from typing import Any

import pandas as pd

from isi import config
from isi.config import value_of
from isi.report.tables.data import BASELINE, JOINT, Experiment, Results
from isi.report.tables.estimates import (
    Line,
    drops,
    epochs_summary,
    improvements,
    named,
    where,
)
from isi.report.tables.forms import ANY_SIZE
from isi.report.tables.method import indicator_means
from isi.report.tables.registry import table
from isi.report.tables.results import about_new, by_label

#: The rows of the table of all results; the file says how they are written.
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


#: Kinds of the printed results, with the titles of their rows.
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
    """The printed results by kind: the paper's number and this run's."""
    titles = {
        title.format(first=results.standalone[0].title): kind for kind, title in _KINDS.items()
    }
    rows = rows_of(results, results.standalone[0])
    rows[["whose", "title"]] = rows["what"].str.split(": ", n=1, expand=True)
    rows["kind"] = pd.Categorical(rows["title"].map(titles), list(_KINDS))
    rows["this run is"] = list(map(comparison, rows["paper"], rows["this run"]))
    rows = rows.dropna(subset="kind").sort_values("kind", kind="stable")
    shown: pd.DataFrame = rows[["kind", "whose", "paper", "this run", "this run is"]]
    return shown


@table("report")
def paper_against_this_run(results: Results) -> pd.DataFrame:
    """The results that the paper prints, beside ours."""
    first, *others = results.standalone
    frame = rows_of(results, first)
    for other in others:
        frame[other.name] = rows_of(results, other)["this run"]
    frame["this run is"] = list(map(comparison, frame["paper"], frame["this run"]))
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


def rows_of(results: Results, experiment: Experiment) -> pd.DataFrame:
    """Results that the paper prints beside those of one experiment; the rows do not depend on what
    was run.
    """
    paper, ours = results.paper, _ours(results, experiment)
    best = dict.fromkeys(paper["indicators"], paper["indicators_degrade_after"])
    theirs: dict[str, Any] = {**paper, "best_indicators": best}
    labels = results.models.labels
    first, rows = results.standalone[0].title, list[tuple[str, str, float, float]]()
    for section, titles, key in config.read(_ROWS)["rows"]:
        named = value_of(theirs, key)
        names = list(named) if isinstance(named, dict) else [""]
        parts = titles if isinstance(titles, dict) else {"": titles}
        for name, (part, title) in product(names, parts.items()):
            place = key + "".join(f".{step}" for step in (name, part) if step)
            text = (f"{labels.get(name, name)}: {title}" if name else title).format(first=first)
            number, value = value_of(theirs, place), value_of(ours, place)
            of_paper, of_run = (nan if each is None else float(each) for each in (number, value))
            rows.append((section, text, of_paper, of_run))
    return pd.DataFrame(rows, columns=["where", "what", "paper", "this run"])


@cache
def _ours(results: Results, experiment: Experiment) -> dict[str, Any]:
    """This run's numbers under the keys of the paper's."""
    source, transfer = experiment.settings.graph.source, dict[str, Any]()
    of_source = (other for other in results.extended if other.settings.graph.source == source)
    if moved := next(of_source, None):
        transfer = {
            "all_queries": moved.means("all")["mean"].to_dict(),
            "novel_queries": moved.means("novel")["mean"].to_dict(),
            "drop": drops(moved.immediate)["drop"].to_dict(),
            "epochs": moved.epochs("all")["mean"].to_dict(),
        }
    gain = improvements(experiment.immediate, "all")["gain"].to_dict()
    epochs = epochs_summary(where(experiment.convergence, scope="all"), ["model"])
    return {
        "immediate": {"improvement_over_xavier": gain},
        "best_indicators": _best_indicators(results, experiment),
        "convergence": {"epochs": epochs.rename(columns={"std": "deviation"}).to_dict("index")},
        "transfer": transfer,
    }


def _best_indicators(results: Results, experiment: Experiment) -> dict[str, int]:
    """The number of indicators with the highest MRR* over all queries, by initializer."""
    means = indicator_means(results)
    if means is None or experiment is not results.standalone[0]:
        return {}
    best = means["all: MRR*"].unstack("model").dropna(axis=1, how="all").idxmax()
    return {str(name): int(k) for name, k in best.items()}
