"""What was run: what could not be asked, ties, fallbacks, params, versions and hashes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from isi.report.models import label
from isi.report.prose import joined
from isi.report.results import Experiment, Results
from isi.report.section import Content, Listing, Section, Table


def contents(results: Results) -> Iterator[Content]:
    """Counts over all experiments, then what was run."""
    yield left_out(results.experiments)
    yield ties({name: one.ties for name, one in results.experiments.items()},
               {name: one.models for name, one in results.experiments.items()})  # fmt: skip
    yield fallbacks({name: one.inserted for name, one in results.experiments.items()})
    for number, (title, values) in enumerate(results.run.items()):
        yield Listing(title, values, folded=number > 0)
    coverage = pd.concat(one.coverage for one in results.experiments.values())
    missing = coverage.loc[coverage["served_by"].isna(), "entity"]
    yield Listing("Entities without a word vector", dict.fromkeys(missing, ""))


def left_out(experiments: Mapping[str, Experiment]) -> Table:
    """What could not be asked, or took no part: counted."""
    counts = pd.DataFrame({name: _left_out(experiment) for name, experiment in experiments.items()})
    sets = joined(
        f"{len(one.novel[['size', 'seed']].drop_duplicates())} in {name}" for name, one in experiments.items()
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
        "known entities without training triples, over all sets": orphans(
            experiment.entities, experiment.triples, experiment.splits, experiment.novel
        ),
    }


def orphans(entities: pd.DataFrame, triples: pd.DataFrame, splits: pd.DataFrame, novel: pd.DataFrame) -> int:
    """Known entities that lose all their training triples with the novel ones, over all cells."""
    ids = {name: number for number, name in enumerate(entities["entity"])}
    ends = np.stack([triples[end].map(ids) for end in ("head", "tail")], axis=1)
    own_splits: dict[Any, pd.DataFrame] = dict(list(splits.groupby("seed")))
    lost = 0
    for (_, seed), cell in novel.groupby(["size", "seed"]):
        own = own_splits[seed]
        old = ~np.isin(ends[own["triple"]], cell["entity"]).any(1)
        known = np.setdiff1d(ends[own["triple"]], cell["entity"])
        lost += len(np.setdiff1d(known, ends[own["triple"]][old & (own["split"] == "train").to_numpy()]))
    return lost


def ties(counted: Mapping[str, pd.DataFrame], models: Mapping[str, list[str]]) -> Table:
    """Rivals whose score is tied with the answer's, at once: they count half in a rank.

    Args:
        counted: ``tables.TIES`` with a column ``model``, by experiment.
        models: of each experiment, in their order.
    """
    lines = []
    for name, frame in counted.items():
        counts = frame.groupby(["model", "scope"])["ties"].sum()
        lines += [
            {"experiment": name, "model": label(model)}
            | {scope: int(counts.get((model, scope), 0)) for scope in ("all", "novel")}
            for model in models[name]
        ]
    caption = "Rivals tied with the answer right after insertion, over all queries of all sets, by what is asked."
    return Table("ties", "Ties", caption, pd.DataFrame(lines))


def fallbacks(inserted: Mapping[str, pd.DataFrame]) -> Table:
    """How often each initializer lacked what it needs, and what it fell back to; ``tables.INSERTED``, by experiment."""
    parts = []
    for name, frame in inserted.items():
        fell = frame.groupby(["model", "fallback"], dropna=True).size().rename("inserted entities")
        parts.append(fell.reset_index().assign(experiment=name))
    counts = pd.concat(parts, ignore_index=True)
    counts["model"] = counts["model"].map(label)
    counts = counts.rename(columns={"model": "initializer", "fallback": "fell back to"})
    each = joined(f"{len(frame) // max(frame['model'].nunique(), 1):,} in {name}" for name, frame in inserted.items())
    caption = f"Of the entities that each initializer inserted, {each}."
    return Table("fallbacks", "Fallbacks", caption, counts[["experiment", *counts.columns.drop("experiment")]])


SECTION = Section("run", "What was run", contents)
