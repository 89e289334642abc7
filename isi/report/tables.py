"""The tables of the report: each a function of the results."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from isi.convergence import SCOPES
from isi.graph import KINDS
from isi.report.results import JOINT, Experiment, Results
from isi.tables import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL

ROOMS = ("bathroom", "bedroom", "kitchen", "living room")
CONTROLS = ("mean", "gaussian", "gaussian_centred", "es_permuted")
LABELS = {
    "xavier": "Xavier", "iu": "IU", "es": "ES", "rs": "RS", "ers": "ERS", "mean": "Mean", "gaussian": "Gaussian",
    "gaussian_centred": "Centred Gaussian", "es_permuted": "Permuted ES", JOINT: "Joint",
}  # fmt: skip
HALVES = {"mrr_star": "MRR*", "mrr_star_entity": "entity half", "mrr_star_relation": "relation half"}


@dataclass(frozen=True)
class Table:
    """A table as shown: numbers are in the units that its caption names."""

    name: str
    title: str
    caption: str
    frame: pd.DataFrame
    #: of columns that are not shown as other numbers are, how
    formats: Mapping[str, Callable[[Any], str]] = field(default_factory=dict)


def label(model: str) -> str:
    """How a model is called where people read."""
    return LABELS.get(model, model)


def graph_statistics(results: Results) -> Table:
    """Table 1: what one environment holds, by room type, beside the paper's."""
    rows = results.observations
    columns = {"location": AT_LOCATION, "material": HAS_MATERIAL, "affordance": HAS_AFFORDANCE}
    counts = pd.DataFrame(
        {name: rows[rows["relation"] == relation].groupby("scene").size() for name, relation in columns.items()}
    ).fillna(0)
    counts["entities"] = rows.groupby("scene")["head"].nunique()
    counts["room"] = rows.groupby("scene")["room"].first()
    paper = results.paper["graph"]["median_per_environment"]
    lines = {}
    for room in (*ROOMS, "all"):
        own = counts if room == "all" else counts[counts["room"] == room]
        ours = own.drop(columns="room").median().to_dict() | {"rooms": len(own)}
        lines[room] = {f"{name}{suffix}": value for name in ours
                       for suffix, value in (("", ours[name]), (" (paper)", paper[room][name]))}  # fmt: skip
    frame = pd.DataFrame(lines).T.rename_axis("room").rename(columns={"entities": "object types"}).reset_index()
    return Table(
        "table1_graph_statistics",
        "Table 1. Graph statistics",
        "Median count per environment of location, material and affordance triples and of distinct object types, "
        "and the number of rooms, beside the paper's (AI2-THOR of 2019).",
        frame,
    )


def graph_totals(results: Results) -> Table:
    """The size of the whole graph, beside the paper's."""
    ours = {
        "observations": int(results.triples["count"].sum()),
        "unique_triples": len(results.triples),
        "entities": len(results.entities),
        **{f"{kind} entities": int((results.entities["kind"] == kind).sum()) for kind in KINDS},
    }
    frame = pd.DataFrame({"": list(ours), "this run": list(ours.values())})
    frame["paper"] = [results.paper["graph"].get(name) for name in ours]
    frame[""] = frame[""].str.replace("_", " ")
    return Table("graph_totals", "Size of the graph", "The paper states over 15,000 observations.", frame)


def immediate(results: Results) -> Table:
    """MRR* at once in scopes all and novel, with its entity and its relation half, over all sizes."""
    frame = _halves_by_model(results.at_once, results.models, ("all", "novel"))
    return Table(
        "immediate",
        "Immediate MRR*",
        "MRR* (points) right after insertion, mean over all sizes and seeds, with the half of it that asks for "
        "entities and the half that asks for relations, of which there are only three. The joint model has been "
        "trained on most of the queries of scope novel; it is no bound there.",
        frame,
    )


def immediate_by_size(results: Results) -> Table:
    """The numbers behind Figure 3a, with their halves."""
    shown = results.at_once[results.at_once["scope"].isin(["all", "novel"])]
    means = 100 * shown.groupby(["scope", "size", "model"])[list(HALVES)].mean().rename(columns=HALVES)
    frame = means.reset_index()
    frame["model"] = _in_order(frame["model"], results.models)
    frame = frame.sort_values(["scope", "size", "model"]).astype({"model": str}).replace({"model": LABELS})
    return Table(
        "immediate_by_size",
        "Immediate MRR* by size",
        "MRR* (points) right after insertion, mean over seeds.",
        frame.reset_index(drop=True),
    )


def improvement(results: Results) -> Table:
    """Improvement over Xavier in per cent: the ratio of means at each size, averaged over sizes (section 6.1)."""
    paper = results.paper["immediate"]["improvement_over_xavier"]
    others = [name for name in results.initializers if name != "xavier"]
    frame = pd.DataFrame({"initializer": [label(name) for name in others]})
    for scope in ("all", "novel"):
        ratios = improvement_over_xavier(results, scope)
        frame[f"scope {scope}"] = [ratios.get(name, np.nan) for name in others]
    frame["paper"] = [paper.get(name) for name in others]
    return Table(
        "improvement",
        "Improvement over Xavier",
        "Immediate MRR* against Xavier's, in per cent: the ratio of means at each size, averaged over sizes.",
        frame,
    )


def improvement_over_xavier(results: Results, scope: str) -> dict[str, float]:
    """Of each initializer, in per cent; empty where Xavier was not run."""
    shown = results.at_once[results.at_once["scope"] == scope]
    means = shown.groupby(["size", "model"])["mrr_star"].mean().unstack()
    if "xavier" not in means:
        return {}
    gain = (100 * (means.div(means["xavier"], axis=0) - 1)).mean().dropna()
    return {str(model): float(value) for model, value in gain.items()}


def convergence(results: Results) -> Table:
    """Table 2: epochs to convergence over all sizes."""
    paper = results.paper["convergence"]["epochs"]
    frame = pd.DataFrame({"initializer": [label(name) for name in results.initializers]})
    for scope in SCOPES:
        cells = results.convergence[results.convergence["scope"] == scope].groupby("model")
        for column, values in (("mean", cells["epochs"].mean()), ("std", cells["epochs"].std(ddof=1)),
                               ("unconverged %", 100 * (1 - cells["converged"].mean()))):  # fmt: skip
            frame[f"{scope}: {column}"] = values.reindex(results.initializers).to_numpy()
    for column in ("mean", "deviation"):
        frame[f"paper: {'std' if column == 'deviation' else column}"] = [
            paper.get(name, {}).get(column) for name in results.initializers
        ]
    return Table(
        "table2_convergence",
        "Table 2. Epochs to convergence",
        f"Epochs until MRR* is within {100 * results.params.convergence.margin:g} points of the joint model of the "
        "same seed, over all sizes and seeds; runs that never get there count as "
        f"{results.params.finetuning.max_epochs} and are the share given as unconverged.",
        frame,
    )


def convergence_by_size(results: Results) -> Table:
    """Table 2 for each size, with the number of queries that decide it."""
    cells = results.convergence.groupby(["scope", "size", "model"])
    frame = cells.agg(mean=("epochs", "mean"), std=("epochs", "std"), converged=("converged", "mean"),
                      queries=("queries", "mean"), sets=("seed", "size")).reset_index()  # fmt: skip
    frame["unconverged %"] = 100 * (1 - frame.pop("converged"))
    frame["model"] = _in_order(frame["model"], results.models)
    frame = frame.sort_values(["scope", "size", "model"]).astype({"model": str}).replace({"model": LABELS})
    frame = frame.rename(columns={"model": "initializer", "queries": "triples asked"})
    return Table(
        "convergence_by_size",
        "Epochs to convergence by size",
        "As Table 2, for each size; triples asked: mean number of triples whose head, tail and relation are asked "
        "for; sets: seeds that have any.",
        frame[["scope", "size", "initializer", "mean", "std", "unconverged %", "triples asked", "sets"]].reset_index(
            drop=True
        ),
    )


def novel_by_kind(results: Results) -> Table:
    """Immediate MRR* of the queries about each inserted entity, by its kind."""
    asked = results.inserted[results.inserted["queries"] > 0]
    groups = asked.groupby(["kind", "model"])
    means = 100 * groups[list(HALVES)].mean().rename(columns=HALVES)
    means["std"] = 100 * groups["mrr_star"].std(ddof=1)
    means.insert(0, "inserted", groups.size())
    order = [(kind, model) for kind in KINDS for model in results.initializers if (kind, model) in means.index]
    frame = means.loc[order].reset_index()
    frame["model"] = frame["model"].map(label)
    return Table(
        "novel_by_kind",
        "Immediate MRR* by kind of the novel entity",
        "MRR* (points) in scope novel of the queries that touch an inserted entity, mean and standard deviation over "
        "the inserted entities of a kind, with its entity and its relation half.",
        frame.rename(columns={"model": "initializer"}),
    )


def corruption(results: Results) -> Table:
    """Known against known_closed: crowding against damage, at the size whose curves are drawn."""
    size = results.curve_size
    runs = results.runs[results.runs["size"] == size]
    followed = "(no size in curves.sizes was inserted)" if size is None else f"at |ξ| = {size}"
    lines = []
    for model in results.models:
        for scope in ("known", "known_closed"):
            own = runs[(runs["model"] == model) & (runs["scope"] == scope)]
            if len(own):
                means = 100 * own.groupby("epoch")[list(HALVES)].mean().rename(columns=HALVES)
                line = {"model": label(model), "scope": scope, "lowest MRR*": means["MRR*"].min()}
                for when, row in (("at once", means.iloc[0]), ("at the end", means.iloc[-1])):
                    line |= {f"{name} {when}": row[name] for name in HALVES.values()}
                lines.append(line)
    return Table(
        "corruption",
        "Earlier knowledge: crowding or damage",
        f"MRR* (points) of queries about known entities {followed}, mean over seeds, with its "
        "entity and its relation half, with the novel entities among the candidates (known) and without "
        "(known_closed). What is lost only in the former is crowding: novel entities rank above the answers. What is "
        "lost in the latter is damage. Lowest: over all epochs.",
        pd.DataFrame(lines),
    )


def every_scope(results: Results) -> Table:
    """Every scope at once, over all sizes."""
    scopes = ("all", "known", "known_closed", "novel", "novel_heldout")
    frame = _halves_by_model(results.at_once, results.models, scopes)
    return Table(
        "scopes",
        "Immediate MRR* in every scope",
        "MRR* (points) right after insertion, mean over all sizes and seeds, with its entity and relation halves.",
        frame,
    )


def leaks(results: Results) -> Table:
    """Triples of both sources whose tail is named in the definition of their head: what definitions could leak."""
    entities, triples = results.transfer.entities, results.transfer.triples  # AI2-THOR's among them
    definition = dict(zip(results.definitions["phrase"], results.definitions["definition"], strict=True))
    phrase = dict(zip(entities["entity"], entities["phrase"], strict=True))
    columns = ["source", "head", "relation", "tail", "count"]
    rows = [
        (source, head, relation, tail, count, definition[phrase[head]])
        for source, head, relation, tail, count in triples[columns].itertuples(index=False)
        if phrase[head] in definition and names(definition[phrase[head]], tail)
    ]
    used = results.params.words.source == "shipped" and results.params.words.text == "definition"
    behind = "are" if used else "are not"
    return Table(
        "definition_leaks",
        "What definitions could leak",
        f"{len(rows)} of {len(triples)} unique triples of both sources have a tail that is named in the definition "
        "of their head, in the words themselves or with the first in a regular inflection. These definitions "
        f"{behind} behind the word vectors of this run. What a phrase itself says (a desk lamp is of a desk) is not "
        "counted.",
        pd.DataFrame(rows, columns=[*columns, "definition of the head"]),
    )


def names(text: str, phrase: str) -> bool:
    """Whether a text names a phrase, as it stands or with its first word in a regular inflection."""
    first, *rest = phrase.split()
    stem, double = re.escape(first.removesuffix("e")), re.escape(first[-1])
    inflected = rf"{stem}(?:e|s|es|d|ed|en|n|ing|{double}(?:ed|ing))?"
    pattern = r"\s+".join([rf"(?:{inflected}|{re.escape(first)})", *map(re.escape, rest)])
    return re.search(rf"\b{pattern}\b", text) is not None


def fallbacks(results: Results) -> Table:
    """How often each initializer lacked what it needs, and what it fell back to."""
    parts = []
    for name, experiment in results.experiments.items():
        fell = experiment.inserted.groupby(["model", "fallback"], dropna=True).size().rename("inserted entities")
        parts.append(fell.reset_index().assign(experiment=name))
    counts = pd.concat(parts, ignore_index=True)
    counts["model"] = counts["model"].map(label)
    counts = counts.rename(columns={"model": "initializer", "fallback": "fell back to"})
    inserted = " and ".join(f"{len(one.novel):,} in {name}" for name, one in results.experiments.items())
    caption = f"Of the inserted entities, {inserted}."
    return Table("fallbacks", "Fallbacks", caption, counts[["experiment", *counts.columns.drop("experiment")]])


def left_out(results: Results) -> Table:
    """What could not be asked, or took no part: counted."""
    counts = pd.DataFrame({name: _left_out(experiment) for name, experiment in results.experiments.items()})
    sets = " and ".join(
        f"{len(one.novel[['size', 'seed']].drop_duplicates())} in {name}" for name, one in results.experiments.items()
    )
    caption = f"Of the sets of novel entities, {sets}."
    return Table("left_out", "What was left out", caption, counts.rename_axis("").reset_index())


def _left_out(experiment: Experiment) -> dict[str, int]:
    sets = experiment.at_once[experiment.at_once["model"] == experiment.initializers[0]]
    empty = sets[sets["queries"] == 0].groupby("scope").size()
    told = experiment.insert_triples[["size", "seed", "entity"]].drop_duplicates()
    counts = {
        f"sets without queries in scope {scope}": int(empty.get(scope, 0)) for scope in sorted(sets["scope"].unique())
    }
    return counts | {
        "entities without a word vector": int(experiment.coverage["served_by"].isna().sum()),
        "inserted entities without insert triples": len(experiment.novel) - len(told),
        "known entities without training triples, over all sets": _orphans(experiment),
    }


def ties(results: Results) -> Table:
    """Rivals whose score is tied with the answer's, at once: they count half in a rank."""
    lines = []
    for name, experiment in results.experiments.items():
        counts = experiment.ties.groupby(["model", "scope"])["ties"].sum()
        lines += [
            {"experiment": name, "model": label(model)}
            | {scope: int(counts.get((model, scope), 0)) for scope in ("all", "novel")}
            for model in experiment.models
        ]
    caption = "Rivals tied with the answer right after insertion, over all queries of all sets, by scope."
    return Table("ties", "Ties", caption, pd.DataFrame(lines))


def _orphans(experiment: Experiment) -> int:
    """Known entities that lose all their training triples with the novel ones, over all cells."""
    ids = {name: number for number, name in enumerate(experiment.entities["entity"])}
    ends = experiment.triples[["head", "tail"]].replace(ids).to_numpy(np.int64)
    splits: dict[Any, pd.DataFrame] = dict(list(experiment.splits.groupby("seed")))
    orphans = 0
    for (_, seed), cell in experiment.novel.groupby(["size", "seed"]):
        own = splits[seed]
        old = ~np.isin(ends[own["triple"]], cell["entity"]).any(1)
        known = np.setdiff1d(ends[own["triple"]], cell["entity"])
        orphans += len(np.setdiff1d(known, ends[own["triple"]][old & (own["split"] == "train").to_numpy()]))
    return orphans


def training(results: Results) -> Table:
    """How long Θ⁰ and the joint model trained, and what validation MRR* they reached."""
    lines = []
    for experiment, found in results.experiments.items():
        for name, log in (("theta0", found.theta0_log), ("joint", found.joint_log)):
            epochs = log.groupby(["size", "seed"])["epoch"].max()
            kept = log[log["kept"]].groupby(["size", "seed"]).last()
            lines.append(
                {"experiment": experiment, "model": name, "trained": len(epochs), "epochs": epochs.mean()}
                | {"best epoch": kept["epoch"].mean()}
                | {f"validation {shown}": 100 * kept[column].mean() for column, shown in HALVES.items()}
                | {"std": 100 * kept["mrr_star"].std(ddof=1)}
            )
    caption = "Means over all models; MRR* in points, its standard deviation over models."
    return Table("training", "Training of the initial and the joint models", caption, pd.DataFrame(lines))


def _halves_by_model(runs: pd.DataFrame, models: list[str], scopes: tuple[str, ...]) -> pd.DataFrame:
    means = 100 * runs.groupby(["model", "scope"])[list(HALVES)].mean()
    lines = [
        {"model": label(model)}
        | {
            f"{scope}: {name}": means[column].get((model, scope), np.nan)
            for scope in scopes
            for column, name in HALVES.items()
        }
        for model in models
    ]
    return pd.DataFrame(lines)


def _in_order(values: pd.Series, order: list[str]) -> pd.Series:
    return values.astype(pd.CategoricalDtype(order, ordered=True))


#: In the order of the page.
TABLES: tuple[Callable[[Results], Table], ...] = (
    graph_statistics, graph_totals, training, immediate, improvement, immediate_by_size, convergence,
    convergence_by_size, novel_by_kind, corruption, every_scope, fallbacks, left_out, ties, leaks,
)  # fmt: skip
