"""Every number that the paper states, beside this run's."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from isi.report import cross_validation, sensitivity, transfer
from isi.report.results import ISI, Results
from isi.report.tables import ROOMS, Table, graph_statistics, improvement_over_xavier, label
from isi.tables import AT_LOCATION

#: Where the paper states it, what, its number and this run's.
Row = tuple[str, str, float, float]


def against(results: Results) -> Table:
    """The paper against this run."""
    rows = [
        *_abstract(results), *_graph(results), *_settings(results), *_immediate(results), *_convergence(results),
        *_transfer(results), *_affordances(results),
    ]  # fmt: skip
    return Table(
        "paper_against_this_run",
        "The paper against this run",
        "Every number in the paper's abstract, tables and running text of its results. MRR* in points. The graphs are "
        "not the same (AI2-THOR has grown), nor are the joint models, so closeness is no goal; order and size are.",
        pd.DataFrame(rows, columns=["where", "what", "paper", "this run"]),
        dict.fromkeys(("paper", "this run"), _shown),
    )


def _shown(value: float) -> str:
    return f"{value:,.0f}" if float(value).is_integer() else f"{value:.1f}" if abs(value) >= 1 else f"{value:.2g}"


def fewer_epochs(results: Results, scope: str = "all") -> dict[str, float]:
    """By how much each initializer's mean number of epochs is below Xavier's, in per cent (section 6.2)."""
    cells = results.convergence
    epochs = cells[cells["scope"] == scope].groupby("model")["epochs"].mean()
    if "xavier" not in epochs or not epochs["xavier"]:
        return {}
    return {str(model): float(value) for model, value in (100 * (1 - epochs / epochs["xavier"])).items()}


def _abstract(results: Results) -> Iterator[Row]:
    gain, fewer = improvement_over_xavier(results, "all"), fewer_epochs(results)
    stated, epochs = results.paper["immediate"], results.paper["convergence"]["fewer_epochs_than_xavier"]
    what = "gain over Xavier at once, all queries, %"
    yield "abstract", f"{what}: the figure is ES's", stated["improvement_in_the_abstract"], gain.get("es", np.nan)
    mean = float(np.mean([stated["improvement_over_xavier"][name] for name in ISI]))
    yield "section 6.1", f"{what}: mean of ES, RS and ERS", mean, _mean_of_isi(gain)
    yield "abstract", "fewer epochs than Xavier, %: mean of ES, RS and ERS", epochs["mean"], _mean_of_isi(fewer)


def _graph(results: Results) -> Iterator[Row]:
    stated, kinds = results.paper["graph"], results.entities["kind"].value_counts()
    bowls = results.triples[
        (results.triples["head"] == "bowl") & (results.triples["relation"] == AT_LOCATION)
        & (results.triples["tail"] == "cabinet")
    ]  # fmt: skip
    ours = {
        "relations": results.triples["relation"].nunique(),
        "entities": len(results.entities),
        "concepts": kinds.get("object", 0) + kinds.get("room", 0),
        "affordance": kinds.get("affordance", 0),
        "material": kinds.get("material", 0),
        "observations": results.triples["count"].sum(),
        "unique_triples": len(results.triples),
        "bowls_in_cabinets": bowls["count"].sum(),
    }
    words = {
        "concepts": "household concepts: objects and rooms", "affordance": "affordances", "material": "materials",
        "observations": "observations (paper: over 15,000)", "unique_triples": "unique triples",
        "bowls_in_cabinets": "observations of (bowl, atLocation, cabinet)",
    }  # fmt: skip
    for name, value in ours.items():
        yield "section 5.1", words.get(name, name), stated[name], float(value)
    table = graph_statistics(results).frame.set_index("room").astype(float)
    columns = {"location": "location triples", "material": "material triples", "affordance": "affordance triples",
               "object types": "entities", "rooms": "rooms"}  # fmt: skip
    for room in (*ROOMS, "all"):
        for column, name in columns.items():
            median = "" if column == "rooms" else ", median per environment"
            paper = stated["median_per_environment"][room]["entities" if column == "object types" else column]
            yield "Table 1", f"{room}: {name}{median}", paper, float(table[column][room])


def _settings(results: Results) -> Iterator[Row]:
    stated, params = results.paper["settings"], results.params
    yield "section 5.3", "repeats of each set size", stated["repeats"], params.sessions.seeds
    yield "section 6.1", "novel entities inserted at once, at most", stated["largest_size"], max(params.sessions.sizes)
    yield "section 6.2", "novel entities in the learning curves", stated["curve_size"], results.curve_size or np.nan
    yield "section 5.3", "margin of convergence, points of MRR*", stated["margin"], 100 * params.convergence.margin
    yield "section 5.3", "epochs of fine-tuning, at most", stated["max_epochs"], params.finetuning.max_epochs
    yield "section 5.3", "fine-tuning rate", stated["finetuning_rate"], params.finetuning.learning_rate
    yield "section 5.3", "ERS: candidates", stated["candidates"], params.initializers.ers.candidates
    moved = stated["transfer"]
    yield "section 6.3", "transfer: candidates", moved["candidates"], params.transfer.candidates
    yield "section 6.3", "transfer: entities inserted at once", moved["size"], params.transfer.size
    yield "section 6.3", "transfer: observations, at least", moved["min_observations"], params.mp3d.min_observations
    yield "section 6.3", "transfer: repeats", moved["repeats"], params.transfer.seeds
    words = {"dimension": "dimension", "ratio": "negatives per positive", "learning_rate": "learning rate of Θ⁰",
             "weight_decay": "weight decay of Θ⁰"}  # fmt: skip
    for name, what in words.items():
        best = cross_validation.best(results, name)
        yield "section 5.3", f"{what}: best in cross-validation", results.paper["training"][name], best
    for name, picked in sensitivity.picked_sizes(results).items():
        what = f"{label(name)}: indicator set size that the rule picks"
        yield "section 5.3", what, results.paper["indicators"][name], picked
    for name, best in sensitivity.best_sizes(results).items():
        what = f"{label(name)}: indicator set size of the best immediate MRR*, scope all (paper: falls beyond)"
        yield "section 5.3", what, results.paper["indicators_degrade_after"], best


def _immediate(results: Results) -> Iterator[Row]:
    gain = improvement_over_xavier(results, "all")
    for name, stated in results.paper["immediate"]["improvement_over_xavier"].items():
        what = f"{label(name)}: gain over Xavier at once, all queries, %"
        yield "section 6.1", what, stated, gain.get(name, np.nan)


def _convergence(results: Results) -> Iterator[Row]:
    stated, fewer = results.paper["convergence"], fewer_epochs(results)
    cells = results.convergence[results.convergence["scope"] == "all"].groupby("model")["epochs"]
    mean, deviation = cells.mean(), cells.std(ddof=1)
    for name, numbers in stated["epochs"].items():
        yield "Table 2", f"{label(name)}: epochs to convergence, mean", numbers["mean"], mean.get(name, np.nan)
        what = f"{label(name)}: epochs to convergence, standard deviation"
        yield "Table 2", what, numbers["deviation"], deviation.get(name, np.nan)
    for name in ISI:
        what = f"{label(name)}: fewer epochs than Xavier, %"
        yield "section 6.2", what, stated["fewer_epochs_than_xavier"][name], fewer.get(name, np.nan)


def _transfer(results: Results) -> Iterator[Row]:
    stated, found = results.paper["transfer"], results.transfer
    means = 100 * found.at_once.groupby(["scope", "model"])["mrr_star"].mean()
    for scope, key, what in (
        ("all", "all_queries", "all queries"),
        ("novel", "novel_queries", "new entities' queries"),
    ):
        for name, number in stated[key].items():
            yield "section 6.3", f"{label(name)}: MRR* at once, {what}", number, means.get((scope, name), np.nan)
    cells = found.convergence
    epochs = cells[cells["scope"] == "all"].groupby("model")["epochs"].mean()
    for name, number in stated["epochs"].items():
        what = f"{label(name)}: epochs to convergence after the transfer"
        yield "section 6.3", what, number, epochs.get(name, np.nan)
    dropped = transfer.drop(results)
    for name, number in stated["drop"].items():
        what = f"{label(name)}: drop of MRR* over AI2-THOR's entities at once, %"
        yield "section 6.3", what, number, dropped.get(name, np.nan)


def _affordances(results: Results) -> Iterator[Row]:
    stated = results.paper["affordances"]
    for name in (*ISI, "xavier"):
        if name in results.initializers:
            answers = [answer for entity in results.params.affordances.entities
                       for answer in transfer.top_answers(results, name, entity)]  # fmt: skip
            hits = sum(kind == "affordance" for _, kind in answers)
            what = f"{label(name)}: of {len(answers)} answers shown, how many are affordances"
            yield "Table 3", what, stated["xavier" if name == "xavier" else "isi"], hits


def _mean_of_isi(values: dict[str, Any]) -> float:
    own = [values[name] for name in ISI if name in values]
    return float(np.mean(own)) if own else np.nan


TABLES = (against,)
