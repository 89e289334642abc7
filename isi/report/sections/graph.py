"""The graphs: Table 1, their sizes, and how well they were learned."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from isi.report.prose import joined
from isi.report.results import Experiment, Results
from isi.report.section import Content, Heading, Section, Table, by_experiment
from isi.report.statistics import HALVES


def contents(results: Results) -> Iterator[Content]:
    """Each graph of its own, then the training on all."""
    yield from by_experiment(results, of_graph)
    if len(results.own) > 1:
        yield Heading("All experiments")
    yield training({name: (one.theta0_log, one.joint_log) for name, one in results.experiments.items()},
                   {name: asked.used for name, asked in results.asking.items()})  # fmt: skip


def of_graph(results: Results, experiment: Experiment) -> Iterator[Content]:
    """Table 1, where the source tells scenes apart, and the size of the graph."""
    stated = results.paper["graph"]
    yield (
        f"{experiment.triples['count'].sum():,} observations make {len(experiment.triples):,} unique triples over "
        f"{len(experiment.entities):,} entities; the paper, with the AI2-THOR of its time, had over "
        f"{stated['observations']:,}, {stated['unique_triples']} and {stated['entities']}."
    )
    observations = results.seen[experiment.how.graph.source].observations
    if observations["scene"].notna().any():
        yield graph_statistics(observations, stated["median_per_environment"], results.vocabulary["relations"])
    kinds = in_order_of(experiment.entities["kind"].unique(), results.vocabulary["kinds"])
    yield graph_totals(experiment.entities, experiment.triples, kinds, stated)
    yield relation_half(experiment.entities, experiment.triples)


def relation_half(entities: pd.DataFrame, triples: pd.DataFrame) -> str:
    """What the queries for relations ask for: how far the kind of a tail tells the relation."""
    pairs = relations_by_kind(entities, triples)
    told, every = int(pairs.max(axis=1).sum()), len(triples)
    number = f"in all {every:,} triples" if told == every else f"in {told:,} of {every:,} triples"
    leads = joined(f"{kind} to {relation}" for kind, relation in pairs.idxmax(axis=1).items())
    return (
        f"The kind of the tail tells the relation {number} ({leads}), so the half of MRR* that asks for relations is a "
        f"choice of kind, one of {triples['relation'].nunique()}. What is known beyond kinds shows in the half that "
        "asks for entities; the paper does not say what either half weighs."
    )


def relations_by_kind(entities: pd.DataFrame, triples: pd.DataFrame) -> pd.DataFrame:
    """How many unique triples have a tail of each kind (a row) and each relation (a column)."""
    kinds = triples["tail"].map(entities.set_index("entity")["kind"])
    return triples.groupby([kinds.rename("kind"), "relation"]).size().unstack(fill_value=0)


def in_order_of(values: Iterable[str], first: Sequence[str]) -> list[str]:
    """Values in a given order, the others behind it as they come."""
    own = list(values)
    return [value for value in first if value in own] + [value for value in own if value not in first]


def graph_statistics(
    observations: pd.DataFrame, stated: Mapping[str, Mapping[str, float]], words: Mapping[str, str]
) -> Table:
    """Table 1: what one environment holds, by room type, beside the paper's.

    Args:
        observations: ``tables.OBSERVATIONS``, of scenes.
        stated: the paper's numbers, by room.
        words: what the paper calls relations.
    """
    rows = observations[observations["scene"].notna()]
    relations = in_order_of(sorted(rows["relation"].unique()), list(words))
    counts = pd.DataFrame(
        {words.get(name, name): rows[rows["relation"] == name].groupby("scene").size() for name in relations}
    ).fillna(0)
    counts["entities"] = rows.groupby("scene")["head"].nunique()
    counts["room"] = rows.groupby("scene")["room"].first()
    lines = {}
    for room in [*in_order_of(sorted(counts["room"].dropna().unique()), list(stated)), "all"]:
        own = counts if room == "all" else counts[counts["room"] == room]
        ours = own.drop(columns="room").median().to_dict() | {"rooms": len(own)}
        theirs = {f"{name} (paper)": stated.get(room, {}).get(str(name), np.nan) for name in ours}
        lines[room] = {
            column: value for pair in zip(ours.items(), theirs.items(), strict=True) for column, value in pair
        }
    frame = pd.DataFrame(lines).T.rename_axis("room").rename(columns={"entities": "object types"}).reset_index()
    return Table(
        "table1_graph_statistics",
        "Table 1. Graph statistics",
        "Median count per environment of triples by relation and of distinct object types, and the number of rooms, "
        "beside the paper's (AI2-THOR of 2019).",
        frame.dropna(axis=1, how="all"),
    )


def graph_totals(
    entities: pd.DataFrame, triples: pd.DataFrame, kinds: Sequence[str], stated: Mapping[str, Any]
) -> Table:
    """The size of the whole graph, beside the paper's."""
    ours = {
        "observations": int(triples["count"].sum()),
        "unique_triples": len(triples),
        "entities": len(entities),
        **{f"{kind} entities": int((entities["kind"] == kind).sum()) for kind in kinds},
    }
    frame = pd.DataFrame({"": list(ours), "this run": list(ours.values())})
    frame["paper"] = [stated.get(name) for name in ours]
    frame[""] = frame[""].str.replace("_", " ")
    return Table("graph_totals", "Size of the graph", "The paper states over 15,000 observations.", frame)


def training(logs: Mapping[str, tuple[pd.DataFrame, pd.DataFrame]], used: Mapping[str, pd.DataFrame]) -> Table:
    """How long Θ⁰ and the joint model trained, what validation MRR* they reached, and the coordinates in use.

    Args:
        logs: ``tables.TRAINING_LOG`` of both, by experiment.
        used: ``tables.USED`` of the joint model, by experiment.
    """
    lines = []
    for experiment, both in logs.items():
        for name, log in zip(("theta0", "joint"), both, strict=True):
            epochs = log.groupby(["size", "seed"])["epoch"].max()
            kept = log[log["kept"]].groupby(["size", "seed"]).last()
            lines.append(
                {"experiment": experiment, "model": name, "trained": len(epochs), "epochs": epochs.mean()}
                | {"best epoch": kept["epoch"].mean()}
                | {f"validation {shown}": 100 * kept[column].mean() for column, shown in HALVES.items()}
                | {"std": 100 * kept["mrr_star"].std(ddof=1)}
                | (in_use(used[experiment]) if name == "joint" and experiment in used else {})
            )
    caption = (
        "Means over all models; MRR* in points, its standard deviation over models. In use: share of the scalars and "
        "of the blocks that are not zero (above 0.001) in any relation of the joint model."
    )
    return Table("training", "Training of the initial and the joint models", caption, pd.DataFrame(lines))


def in_use(used: pd.DataFrame) -> dict[str, float]:
    """Scalars and blocks that any relation uses, in per cent; ``tables.USED``."""
    sums = used[used["relation"].isna()].groupby("part")[["used", "of"]].sum()
    return {f"{part} in use %": 100 * float(row["used"] / row["of"]) for part, row in sums.iterrows()}


SECTION = Section("graph", "The graphs, and how well they are learned", contents)
