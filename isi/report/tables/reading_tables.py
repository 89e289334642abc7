"""Tables of the paper's results under the readings of its metric."""

from itertools import compress, product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from isi import config
from isi.report.tables.data import BASELINE, read
from isi.report.tables.estimates import ENDS, Line, named, over_seeds, where, wide
from isi.report.tables.forms import CSV_ALONE
from isi.report.tables.readings import (
    ABOUT,
    ALLOWED,
    IN_WORDS,
    MAIN,
    OURS,
    READINGS,
    TITLES,
    CaseRuns,
    PaperResult,
    Readings,
    changed,
    means_of,
)
from isi.report.tables.registry import Frames, table
from isi.report.tables.results import TOP, by_label, in_ranks, in_rows, marked
from isi.tables import paths
from isi.tables.io import read_tensors

BEST = 10  #: Readings in the table of the nearest.
#: By case of a result: the cases of this project's graph and of the paper's, each under this
#: project's conditions and under the paper's.
CORNERS = {
    "published": (("ai2thor_batches", "ai2thor"), ("published_batches", "published")),
    "extended": (("transfer_batches", "transfer"), ("extended_batches", "extended")),
}
#: What differs between this run and the paper's, in the order of the axes of ``_corners``.
STEPS = ("the reading", "the conditions", "the graph")
GRAPHS = ("published", "extended", "ai2thor")


@table("readings")
def paper_results(results: Readings) -> pd.DataFrame:
    """Every result beside its value under the chosen reading, the one with the other filter, and
    this project's.
    """
    frame = pd.DataFrame(results.results)
    for title, reading in results.pairs.items():
        place = READINGS.index(reading)
        frame[[f"{title}{end}" for end in ENDS]] = results.values[:, :, place]
        frame[f"{title}: the paper is"] = _agreement(results, frame, title, reading)
    frame["whose"] = frame["model"].map(results.models.labels)
    frame = frame.rename(columns={"place": "where", "title": "what"})
    shown = [name for name in frame if any(str(name).startswith(title) for title in results.pairs)]
    return frame[["where", "kind", "whose", "what", "paper", *shown]]


def _agreement(results: Readings, frame: pd.DataFrame, title: str, reading: str) -> np.ndarray:
    """Whether the paper's number is within the interval, or else the initializers have the paper's
    order.
    """
    ranks = frame[["paper", title]].groupby(frame["kind"]).rank(method="first")
    is_equal = ranks["paper"] == ranks[title]
    same_order = is_equal.groupby(frame["kind"]).transform("all") & frame["ordered"]
    words = ["within the interval", "same order"]
    return np.select([results.within[reading], same_order], words, "not explained")


@table("readings")
def results_by_kind(results: Readings) -> pd.DataFrame:
    """How many results of each kind lie within their intervals: under the chosen reading and its
    neighbours, under the nearest of all readings, whether allowed or not, under one that was chosen
    by the other kinds, and in the median of all that are allowed.
    """
    chosen, kinds = results.chosen, list(map(str, results.by_kind))
    readings = {
        "this reading": chosen,
        "other filter": results.neighbour,
        "without the program's rule of convergence": changed(chosen, about="any"),
        "by the paper's words alone": results.nearest(among=IN_WORDS),
        "this project's reading": OURS,
        "nearest of all readings": results.nearest(among=READINGS),
    }
    left_out = {
        kind: results.nearest([other for other in kinds if other != kind]) for kind in kinds
    }
    counts = results.by_kind.assign(all=results.by_kind.sum(axis=1))
    frame = pd.DataFrame({"number": results.kinds.value_counts()}, [*kinds, "all"])
    frame.loc["all", "number"] = len(results.kinds)
    for title, reading in readings.items():
        frame[title] = counts.loc[reading]
    by_others = pd.Series({kind: counts[kind][reading] for kind, reading in left_out.items()})
    by_others["all"] = by_others.sum()
    frame["chosen by the other kinds"] = by_others
    frame["median of the allowed"] = counts.loc[ALLOWED].median()
    frame["most of the allowed"] = counts.loc[ALLOWED].max()
    best = {kind: results.nearest([kind]) for kind in kinds}
    frame["best reading of the kind"] = pd.Series(best | {"all": chosen})
    frame["reading of the other kinds"] = pd.Series(left_out | {"all": ""})
    frame.loc["all", "nearest reading"] = readings["nearest of all readings"]
    frame.loc["all", "most by the paper's words alone"] = counts.loc[IN_WORDS, "all"].max()
    frame.loc["all", "most of all readings"] = counts["all"].max()
    choices = zip(TITLES.values(), chosen.split(), strict=True)
    in_words = "; ".join(titles[choice] for titles, choice in choices)
    frame.loc["all", "the chosen reading in words"] = in_words
    return frame.rename_axis("results").reset_index()


@table("readings")
def all_readings(results: Readings) -> pd.DataFrame:
    """Every result under every reading: value, bounds, and whether the paper's is within."""
    ordered = results.ordered()
    columns: dict[str, Any] = {"reading": ordered.index, "rank": ordered["rank"].to_numpy()}
    columns["allowed"] = np.where(ordered.index.isin(ALLOWED), "yes", "no")
    places = [READINGS.index(str(reading)) for reading in ordered.index]
    for number, result in enumerate(results.results):
        for end, values in zip(ENDS, results.values[number], strict=True):
            columns[f"{result.title}{end}"] = values[places].round(1)
        within = results.within.iloc[number, places]
        columns[f"{result.title}: within"] = within.to_numpy(int)
    made = pd.DataFrame(columns)
    made.attrs[CSV_ALONE] = True
    return made


@table("readings")
def nearest(results: Readings) -> Frames:
    """The nearest readings, the chosen one and this project's; and the neighbours of the chosen
    one, which differ from it in a single aspect.
    """
    ranked, chosen = results.ordered(), results.chosen
    frame = pd.DataFrame([name.split() for name in ranked.index], ranked.index, list(TITLES))
    differing = (frame != chosen.split()).sum(axis=1)
    frame.insert(0, "rank", ranked["rank"].astype(str))
    frame["allowed"] = np.where(ranked.index.isin(ALLOWED), "yes", "no")
    frame["share within, %"], frame["distance"] = ranked["share"], ranked["distance"]
    frame["within"] = results.by_kind.sum(axis=1)
    shown = frame.index.isin([chosen, OURS]) | (ranked["rank"] <= BEST)
    return {"nearest_readings": frame[shown], "neighbours_of_the_reading": frame[differing == 1]}


@table("readings")
def unexplained(results: Readings) -> pd.DataFrame:
    """The results that are within under neither the chosen reading nor its other filter: their
    distances, and the nearest value of any reading.
    """
    rows = list[Line]()
    for number, result in enumerate(results.results):
        apart = results.distance.loc[number]
        if (apart[[results.chosen, results.neighbour]] <= 1).any():
            continue
        values = pd.Series(results.values[number, 0], READINGS)
        reading = str((values - result.paper).abs().idxmin())
        row: Line = {"what": result.title, "paper": result.paper}
        row |= {"this reading": values[results.chosen], "half-widths away": apart[results.chosen]}
        row |= {"nearest of all readings": values[reading], "its half-widths away": apart[reading]}
        row["its reading"] = result.read(reading)
        rows.append(row)
    return pd.DataFrame(rows)


def _corners(results: Readings, result: PaperResult) -> np.ndarray | None:
    """A result with each of ``STEPS`` taken (1) or not (0); shape (2, 2, 2); None: not run."""
    cases = CORNERS.get(result.case, ())
    names = [name for of_graph in cases for name in of_graph]
    if not names or not set(names) <= set(results.cases):
        return None
    runs = [results.cases[name] for name in names]
    values = np.empty((2, 2, 2))
    for (graph, conditions), of_case in zip(product((0, 1), repeat=2), runs, strict=True):
        measured = results.value(result, of_case.at(runs), [OURS, results.chosen])
        values[:, conditions, graph] = measured[0]
    return values


@table("readings")
def steps_to_the_paper(results: Readings) -> Frames:
    """By how much the reading, the conditions and the graph change each result: their steps, as
    means over the six orders with the least and the largest one; and every corner.
    """
    steps, corners = list[Line](), list[Line]()
    for result in results.results:
        values = _corners(results, result)
        if values is None:
            continue
        row: Line = {"what": result.title, "this run": values[0, 0, 0]}
        for axis, name in enumerate(STEPS):
            row |= dict(zip((f"{name}{end}" for end in ENDS), step(values, axis), strict=True))
        steps.append(row | {"all three": values[1, 1, 1], "paper": result.paper})
        corner: Line = {"what": result.title}
        for place in product((0, 1), repeat=3):
            changes = ", ".join(compress(STEPS, place))
            corner[changes or "this run"] = values[place]
        corners.append(corner | {"paper": result.paper})
    frames = {"steps_to_the_paper": steps, "corners_of_the_steps": corners}
    return {name: pd.DataFrame(rows) for name, rows in frames.items()}


def step(corners: np.ndarray, axis: int) -> tuple[float, float, float]:
    """By how much a step changes the value: the mean over the six orders of three steps, the least
    and the largest change.
    """
    changes = np.diff(corners, axis=axis).squeeze(axis)  # by whether each other one is taken
    orders = [[2, 1], [1, 2]]  # in which it comes first or last, or between the others
    return float(np.average(changes, weights=orders)), changes.min(), changes.max()


@table("readings")
def on_each_graph(results: Readings) -> Frames:
    """MRR* right after insertion of every model under named readings, on each graph."""
    readings = {"the chosen reading": results.chosen, **ABOUT["shown"]}
    frames = dict[str, pd.DataFrame]()
    for case in GRAPHS:
        if case not in results.cases:
            continue
        runs, rows = results.cases[case], list[Line]()
        for title, reading in readings.items():
            means = means_of(runs.mrr_star, reading).reindex(runs.models)
            rows.append({"reading": title} | wide(means, "mean", results.models.labels))
        frames[f"readings_{case}"] = pd.DataFrame(rows)
    return frames


def _table2(results: Readings, part: str) -> dict[str, float]:
    """The paper's Table 2: mean or deviation of the epochs by model."""
    return {name: of[part] for name, of in results.paper["convergence"]["epochs"].items()}


@table("readings")
def table2_readings(results: Readings) -> pd.DataFrame:
    """Table 2: epochs to convergence under the readings that are compared, beside the paper's."""
    runs, columns = results.cases[MAIN], dict[str, Any]()
    for title, reading in results.pairs.items():
        columns |= named(means_of(runs.epochs, reading), "mean", f"{title}: mean")
        columns[f"{title}: deviation"] = runs.epochs[reading].groupby("model").std()
        if reading == results.chosen:
            for part in ("mean", "deviation"):
                columns[f"paper: {part}"] = _table2(results, part)
    return by_label(results.models, runs.case.initializers, columns)


@table("readings")
def transfer_readings(results: Readings) -> pd.DataFrame | None:
    """The transfer's MRR* right after insertion, over all queries and about the new entities,
    beside the paper's.
    """
    if "extended" not in results.cases:
        return None
    runs, columns, paper = results.cases["extended"], dict[str, Any](), results.paper["transfer"]
    for title, whom, theirs in (
        ("all queries", "", paper["all_queries"]),
        ("new entities", "novel", paper["novel_queries"]),
    ):
        for name, reading in results.pairs.items():
            shown = changed(reading, about=whom) if whom else reading
            columns |= named(means_of(runs.mrr_star, shown), "mean", f"{title}: {name}")
        columns[f"{title}: paper"] = theirs
    return by_label(results.models, runs.models, columns)


@table("readings")
def decay_readings(results: Readings) -> pd.DataFrame | None:
    """Epochs to convergence at the sizes and seeds of both cases, with each weight decay of
    fine-tuning.
    """
    if "decay" not in results.cases:
        return None
    compared, columns = [results.cases[MAIN], results.cases["decay"]], dict[str, Any]()
    shared = compared[0].epochs.index.intersection(compared[1].epochs.index)
    for runs in compared:
        decay = runs.case.changes.get("finetuning.weight_decay", results.weight_decay)
        means = means_of(runs.epochs.loc[shared], results.chosen)
        columns |= named(means, "mean", f"weight decay of {decay:g}")
    columns["paper"] = _table2(results, "mean")
    return by_label(results.models, compared[1].case.initializers, columns)


# The paper's figures under the chosen reading


@table("readings")
def figure2_readings(results: Readings) -> pd.DataFrame | None:
    """Figure 2: MRR* right after insertion and epochs to convergence by number of indicators."""
    if "sweep" not in results.cases:
        return None
    runs, by = results.cases["sweep"], ["model", "k"]
    parts = list[pd.DataFrame]()
    for title, measured in (("MRR*", runs.mrr_star), ("epochs", runs.epochs)):
        rows = measured[results.chosen].rename(title).reset_index()
        parts.append(over_seeds(rows, by, {title: title}, scale=1))
    frame = in_rows(pd.concat(parts, axis=1), results.models, list(runs.case.indicators))
    return frame.rename(columns={"k": "indicators"})


@table("readings")
def figure3a_readings(results: Readings) -> pd.DataFrame:
    """Figure 3a: MRR* right after insertion by number of novel entities."""
    runs = results.cases[MAIN]
    rows = where(runs.mrr_star[results.chosen].rename("MRR*").reset_index(), k=0)
    means = over_seeds(rows, ["model", "size"], {"MRR*": "MRR*"}, scale=1)
    return in_rows(means, results.models, runs.models)


@table("readings")
def curves_readings(results: Readings) -> Frames:
    """Figures 3b and 4: MRR* by epoch, of all queries at one size, and of queries about the known
    entities in the transfer.
    """
    figures = {
        "figure3b_readings": (MAIN, results.chosen),
        "figure4_readings": ("extended", changed(results.chosen, about="known")),
    }
    frames = dict[str, pd.DataFrame]()
    for name, (case, reading) in figures.items():
        path = Path(f"data/beyond/readings/{case}.curves.safetensors")
        if case in results.cases and path.exists():
            frame = _curves(results.cases[case], path, reading)
            frames[name] = results.models.labelled(frame, "model")
    return frames


def _curves(runs: CaseRuns, path: Path, reading: str) -> pd.DataFrame:
    """MRR* (points) by model and epoch under a reading, with its interval over seeds: each of the
    first epochs, then every tenth.
    """
    (size,) = runs.case.curves
    seeds, place = runs.case.finetuned_seeds, READINGS.index(reading)
    joint = runs.mrr_star[reading].xs(("joint", 0, size), level=("model", "k", "size"))
    quantile, frames = stdtrit(seeds - 1, 0.975) / np.sqrt(seeds), list[pd.DataFrame]()
    for model in runs.case.initializers:
        name = f"{model}.size={size:02d}"
        tensor = read_tensors(path, [name])[name]
        mean, deviation = 100 * tensor[..., place].double().numpy()
        frame = pd.DataFrame({"model": model, "epoch": np.arange(len(mean)), "MRR*": mean})
        frame["MRR* low"] = mean - quantile * deviation
        frame["MRR* high"] = mean + quantile * deviation
        frames.append(frame[(frame["epoch"] <= 10) | (frame["epoch"] % 10 == 0)])
    rows = pd.concat(frames, ignore_index=True)
    return rows.assign(joint=joint[joint.index < seeds].mean())


@table("readings")
def table3_readings(results: Readings) -> pd.DataFrame | None:
    """Table 3 on the paper's graph and Matterport3D: the answers of lowest mean rank over the
    repeats that inserted the entity, beside the paper's.
    """
    path = Path("data/beyond/readings/extended.answers.parquet")
    if "extended" not in results.cases or not path.exists():
        return None
    answers = read(path)
    vocabulary = config.read(paths.RAW / "paper" / "vocabulary.yaml")
    afforded, theirs = vocabulary["afforded"], results.paper["affordances"]["answers"]
    parts = list[pd.DataFrame]()
    for entity, of_entity in answers.groupby("entity", sort=False):
        columns = dict[str, list[str]]()
        for model in ("es", "rs", "ers", BASELINE):
            ranks = where(of_entity, model=model).groupby(["answer", "kind"])["rank"].mean()
            top = ranks.sort_values(kind="stable").index[:TOP]
            columns[results.models.labels[model]] = [
                marked(answer, kind == "affordance", afforded.get(entity)) for answer, kind in top
            ]
        columns |= {f"paper: {name}": words.get(entity, []) for name, words in theirs.items()}
        parts.append(in_ranks(f"{entity} (n = {of_entity['seed'].nunique()})", columns))
    return pd.concat(parts)
