"""How the joint model does as another family of embeddings, each trained as validation triples alone advise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pandas as pd

from isi.models.model import MODELS
from isi.report.prose import joined
from isi.report.results import Results
from isi.report.section import Content, Section, Table
from isi.report.statistics import HALVES, over_seeds

#: By family, names to values: how it is trained, and its own options.
Chosen = Mapping[str, Mapping[str, Any]]


def contents(results: Results) -> Iterator[Content]:
    """Who is ahead in words, and a row for each."""
    if results.families is None:
        return
    rows, how = results.families.found, results.params.compare_models
    if rows.empty:
        return
    chosen = {name: trained.model_dump() | results.params.models[name] for name, trained in how.models.items()}
    yield (
        f"The joint model, trained on everything, of every family on the graph of {results.families.experiment.title}, "
        f"over test triples. Everything else here is with {called(results.params.embedding.model)}. {sentence(rows)}"
    )
    yield families(rows, chosen, how.seeds)


def called(family: str) -> str:
    """What people call a family: the name of its class."""
    return MODELS.get(family, f"models.{family}").__name__


def sentence(rows: pd.DataFrame) -> str:
    """The families in order of MRR*."""
    means = 100 * rows.groupby("family")["mrr_star"].mean().sort_values(ascending=False, kind="stable")
    return f"MRR*, best first: {joined(f'{called(str(name))} {value:.1f}' for name, value in means.items())}."


def families(rows: pd.DataFrame, chosen: Chosen, seeds: int) -> Table:
    """Measures of each family over seeds, with what was chosen for it.

    Args:
        rows: ``tables.FAMILIES``, with a column ``family``.
    """
    found = over_seeds(rows, ["family"], {**HALVES, "mrr": "MRR", "valid_mrr_star": "validation MRR*"})
    lines = [
        {"family": called(name), **found.loc[name], "epochs": rows.loc[rows["family"] == name, "epochs"].mean()}
        | {what.replace("_", " "): _shown(value) for what, value in values.items()}
        for name, values in chosen.items()
        if name in found.index
    ]
    return Table(
        "families",
        "Families of embeddings",
        f"MRR* (points) of the joint model over test triples, mean and interval over {seeds} seeds, with its "
        "entity and its relation half; MRR: of heads and tails alone, as others state it; MRR* on validation triples; "
        "how long training took; rate, weight decay and the options of a family, chosen on validation triples.",
        pd.DataFrame(lines),
    )


def _shown(value: object) -> str:
    return (
        ("yes" if value else "no")
        if isinstance(value, bool)
        else f"{value:g}"
        if isinstance(value, float)
        else str(value)
    )


SECTION = Section("families", "Families of embeddings", contents)
