"""The tables of the report: each a function of the results."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from isi.graph import KINDS
from isi.report.results import JOINT, Results
from isi.tables import AT_LOCATION, HAS_AFFORDANCE, HAS_MATERIAL

ROOMS = ("bathroom", "bedroom", "kitchen", "living room")
ISI = ("es", "rs", "ers")
LABELS = {"xavier": "Xavier", "iu": "IU", "es": "ES", "rs": "RS", "ers": "ERS", JOINT: "Joint"}
_HALVES = {"mrr_star": "MRR*", "mrr_star_entity": "entity half", "mrr_star_relation": "relation half"}
_SCOPES = ("all", "novel_heldout")


@dataclass(frozen=True)
class Table:
    """A table as shown: numbers are in the units that its caption names."""

    name: str
    title: str
    caption: str
    frame: pd.DataFrame


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
        "observations": len(results.observations),
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
    means = 100 * shown.groupby(["scope", "size", "model"])[list(_HALVES)].mean().rename(columns=_HALVES)
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
    return {str(k): float(v) for k, v in (100 * (means.div(means["xavier"], axis=0) - 1)).mean().items()}


def convergence(results: Results) -> Table:
    """Table 2: epochs to convergence over all sizes."""
    paper = results.paper["convergence"]["epochs"]
    frame = pd.DataFrame({"initializer": [label(name) for name in results.initializers]})
    for scope in _SCOPES:
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
    means = 100 * results.inserted.groupby(["kind", "model"])["mrr_star"].mean().unstack("model")
    number = results.inserted[results.inserted["model"] == results.initializers[0]].groupby("kind").size()
    kinds = [kind for kind in KINDS if kind in means.index]
    frame = means.loc[kinds, results.initializers].rename(columns=label).reset_index()
    frame.insert(1, "inserted", number.loc[kinds].to_numpy())
    return Table(
        "novel_by_kind",
        "Immediate MRR* by kind of the novel entity",
        "MRR* (points) in scope novel of the queries that touch an inserted entity, mean over the inserted entities "
        "of a kind.",
        frame.rename_axis(None, axis=1),
    )


def corruption(results: Results) -> Table:
    """Known against known_closed: crowding against damage."""
    lines = []
    for model in results.models:
        own = results.runs[results.runs["model"] == model]
        for size in results.params.curves.sizes:
            by_epoch = 100 * own[own["size"] == size].groupby(["scope", "epoch"])["mrr_star"].mean().unstack("scope")
            if len(by_epoch):
                known, closed = by_epoch["known"], by_epoch["known_closed"]
                lines.append([label(model), size, known.iloc[0], closed.iloc[0], closed.iloc[0] - known.iloc[0],
                              known.min(), closed.min(), known.iloc[-1], closed.iloc[-1]])  # fmt: skip
    columns = ["model", "size", "known at once", "known_closed at once", "crowding at once", "known, lowest",
               "known_closed, lowest", "known at the end", "known_closed at the end"]  # fmt: skip
    return Table(
        "corruption",
        "Earlier knowledge: crowding or damage",
        "MRR* (points) of queries about known entities, mean over seeds, with the novel entities among the candidates "
        "(known) and without (known_closed). What is lost only in the former is crowding: the novel entities rank "
        "above the answers. What is lost in the latter is damage. Lowest: over all epochs.",
        pd.DataFrame(lines, columns=columns),
    )


def known_by_scope(results: Results) -> Table:
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
    """Triples whose tail is named in the definition of their head: what definitions could leak."""
    definition = dict(zip(results.definitions["phrase"], results.definitions["definition"], strict=True))
    phrase = dict(zip(results.entities["entity"], results.entities["phrase"], strict=True))
    rows = [
        (head, relation, tail, count, definition[phrase[head]])
        for head, relation, tail, count in zip(
            *(results.triples[c] for c in ("head", "relation", "tail", "count")), strict=True
        )
        if phrase[head] in definition and names(definition[phrase[head]], tail)
    ]
    return Table(
        "definition_leaks",
        "What definitions could leak",
        f"{len(rows)} of {len(results.triples)} unique triples have a tail that is named, in any inflection, in the "
        "definition whose embedding is the word vector of their head.",
        pd.DataFrame(rows, columns=["head", "relation", "tail", "count", "definition of the head"]),
    )


def names(text: str, phrase: str) -> bool:
    """Whether a text names a phrase, in any regular inflection of its first word."""
    first, *rest = phrase.split()
    stem = re.escape(first.removesuffix("e"))
    pattern = rf"\b{stem}(?:e|s|es|d|ed|en|n|ing|{re.escape(first[-1])}(?:ed|ing))?\b" + "".join(
        rf"\s+{re.escape(w)}\b" for w in rest
    )
    return re.search(pattern, text) is not None or re.search(rf"\b{re.escape(phrase)}\b", text) is not None


def fallbacks(results: Results) -> Table:
    """How often each initializer lacked what it needs, and what it fell back to."""
    fell = results.inserted.assign(fallback=results.inserted["fallback"].replace({"None": None, "nan": None}))
    counts = fell.groupby(["model", "fallback"], dropna=True).size().rename("inserted entities").reset_index()
    counts["model"] = counts["model"].map(label)
    counts = counts.rename(columns={"model": "initializer", "fallback": "fell back to"})
    return Table("fallbacks", "Fallbacks", f"Of {_inserted_entities(results)} inserted entities.", counts)


def left_out(results: Results) -> Table:
    """What could not be asked, or took no part: counted."""
    sets = results.at_once[results.at_once["model"] == results.initializers[0]]
    empty = sets[sets["queries"] == 0].groupby("scope").size()
    lines = {
        f"sets without queries in scope {scope}": int(empty.get(scope, 0)) for scope in sorted(sets["scope"].unique())
    }
    lines["entities without a word vector"] = int(results.coverage["served_by"].isna().sum())
    lines["inserted entities without insert triples"] = _inserted_entities(results) - len(
        results.insert_triples[["size", "seed", "entity"]].drop_duplicates()
    )
    lines["known entities without training triples, over all sets"] = _orphans(results)
    ties = results.ties.groupby("model")["ties"].sum()
    lines |= {f"tied rivals at epoch 0, {label(model)}": int(ties.get(model, 0)) for model in results.models}
    frame = pd.DataFrame({"": list(lines), "count": list(lines.values())})
    number = len(sets[["size", "seed"]].drop_duplicates())
    return Table("left_out", "What was left out, and ties", f"Of {number} sets of novel entities.", frame)


def _inserted_entities(results: Results) -> int:
    return len(results.novel)


def _orphans(results: Results) -> int:
    """Known entities that lose all their training triples with the novel ones, over all cells."""
    ids = {name: number for number, name in enumerate(results.entities["entity"])}
    ends = results.triples[["head", "tail"]].replace(ids).to_numpy(np.int64)
    orphans = 0
    for (_, seed), cell in results.novel.groupby(["size", "seed"]):
        split = results.splits[results.splits["seed"] == seed].sort_values("triple")["split"].to_numpy()
        new = np.isin(ends, cell["entity"]).any(1)
        trained = np.unique(ends[(split == "train") & ~new])
        orphans += len(ids) - len(cell) - len(trained)
    return orphans


def training(results: Results) -> Table:
    """How long Θ⁰ and the joint model trained, and what validation MRR* they reached."""
    lines = []
    for name, log in (("theta0", results.theta0_log), ("joint", results.joint_log)):
        last = log.groupby(["size", "seed"])["epoch"].max()
        kept = log[log["kept"]].groupby(["size", "seed"]).last()
        lines.append(
            [
                name,
                len(last),
                last.mean(),
                kept["epoch"].mean(),
                100 * kept["mrr_star"].mean(),
                100 * kept["mrr_star"].std(ddof=1),
            ]
        )
    columns = ["model", "trained", "epochs", "best epoch", "validation MRR*", "std"]
    return Table(
        "training",
        "Training of the initial and the joint models",
        "Means over all models.",
        pd.DataFrame(lines, columns=columns),
    )


def _halves_by_model(runs: pd.DataFrame, models: list[str], scopes: tuple[str, ...]) -> pd.DataFrame:
    means = 100 * runs.groupby(["model", "scope"])[list(_HALVES)].mean()
    lines = [
        {"model": label(model)}
        | {
            f"{scope}: {name}": means[column].get((model, scope), np.nan)
            for scope in scopes
            for column, name in _HALVES.items()
        }
        for model in models
    ]
    return pd.DataFrame(lines)


def _in_order(values: pd.Series, order: list[str]) -> pd.Series:
    return values.astype(pd.CategoricalDtype(order, ordered=True))


#: In the order of the page.
TABLES: tuple[Callable[[Results], Table], ...] = (
    graph_statistics, graph_totals, training, immediate, improvement, immediate_by_size, convergence,
    convergence_by_size, novel_by_kind, corruption, known_by_scope, fallbacks, left_out, leaks,
)  # fmt: skip
