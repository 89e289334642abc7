"""Beyond the paper: stronger initializers, fewer insert triples, other words,
embedding models and graphs.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import groupby
from math import nan
from typing import Any

import numpy as np
import pandas as pd

from isi.report.data import Experiment, ModelRuns, Results, VariantRuns
from isi.report.figures import by_row
from isi.report.section import Content, Contents, Tables
from isi.report.sections.answer import ZERO
from isi.report.stats import (
    Difference,
    Estimates,
    by_label,
    by_seed,
    difference,
    signed,
    values,
)
from isi.report.tables import Column, Rows
from isi.report.words import BASELINE, JOINT, isi, label, labelled

#: The initializer with which all others are compared, paired by seed.
REFERENCE = "ers"
#: Pairs of initializers that are compared on each graph, with the novel entity given.
_PAIRS = (
    ("ers", BASELINE),
    ("ers", "kind_mean"),
    ("es", "es_permuted_kinds"),
    ("soft_hybrid", "ers"),
    ("map", "soft_hybrid"),
)
#: A function from runs to estimates by model.
Means = Callable[[Any], Estimates]
#: Measures of the tables by graph, by the end of the table's name.
_MEASURES: dict[str, Means] = {
    "immediate": lambda runs: runs.immediate_means("novel"),
    "novel_given": lambda runs: runs.given_means,
    "epochs": ModelRuns.epochs_means,
}


def stronger(results: Results) -> Contents:
    """Initializers beyond the paper: a table for each graph,
    sorted by entity MRR* with the novel entity given.
    """
    for variant, group in groupby(results.variants_of("baselines"), key=lambda runs: runs.variant):
        listed, tables, above = list(group), Tables(), []
        for runs in listed:
            given, cells = runs.given_means, runs.by_grid_point("given")
            best = max(isi(runs.initializers), key=lambda method: given[method].mean, default=None)
            order = sorted(runs.models, key=lambda model: -given[model].mean)
            reference = cells[REFERENCE] if REFERENCE in cells else pd.Series(np.nan, cells.index)
            columns = {
                "all": runs.immediate_means("all"),
                "novel": runs.immediate_means("novel"),
                "novel entity given": given,
                f"novel entity given, minus {label(REFERENCE)}": {
                    model: difference(by_seed(cells[model], reference)) for model in order
                },
            }
            tables[f"strong_{runs.name}"] = by_label(order, columns)
            if best is not None:
                above.append((runs, given[best].mean, *_above(given, cells, best)))
            else:
                above.append((runs, nan, 0, 0))
        ran = dict.fromkeys(name for runs in listed for name in runs.initializers)
        added = [name for name in ran if name not in results.params.initializers]
        numbers = {"added": added, "size": variant.size, "above": above, "reference": REFERENCE}
        yield Content(numbers, tables)


def _above(given: Estimates, cells: pd.DataFrame, best: str) -> tuple[int, int]:
    """How many initializers have a higher mean than ``best``,
    and for how many of them the interval of the difference excludes zero.
    """
    higher = [name for name in given if name != JOINT and given[name].mean > given[best].mean]
    apart = [difference(by_seed(cells[name], cells[best])).low > 0 for name in higher]
    return len(higher), sum(apart)


def _by_graph(ran: Sequence[ModelRuns], means: Means, variant: str = "") -> Rows:
    """A row of estimates by model for each of ``ran``, sorted by graph;
    column ``variant``, if given, has the title of the variant.
    """
    names, rows = list(dict.fromkeys(runs.name for runs in ran)), Rows()
    for runs in sorted(ran, key=lambda runs: names.index(runs.name)):
        titles = {"graph": runs.title}
        if variant and isinstance(runs, VariantRuns):
            titles[variant] = runs.variant.title
        rows.append(titles | labelled(means(runs)))
    return rows


def n_insert_triples(results: Results) -> Contents:
    """Entity MRR* with the novel entity given by number of insert triples,
    on the first graph with such runs.
    """
    variants = results.variants_of("insert_triples")
    for first in variants[:1]:
        given, rows = dict[str, Estimates](), dict[str, Estimates]()
        for runs in (runs for runs in variants if runs.name == first.name):
            limit = runs.variant.max_insert_triples
            given["all" if limit is None else str(limit)] = runs.given_means
            rows["all" if limit is None else f"at most {limit}"] = runs.given_means
        means = pd.DataFrame({number: values(of_model) for number, of_model in given.items()}).T
        lowest = means.min(skipna=False)
        worse = [
            (name, lowest[name], means[name].idxmin())
            for name in first.initializers
            if means[name].iloc[0] - lowest[name] >= ZERO
        ]
        numbers = {
            "variant": first,
            "fewest": means.iloc[0],
            "most": means.iloc[-1],
            "numbers": list(given),
            "worse": worse,
        }
        table = [
            {"insert triples": number} | labelled(of_model) for number, of_model in given.items()
        ]
        figure = by_row({"": rows}, first.models)
        yield Content(numbers, {"n_insert_triples": table}, {"n_insert_triples": figure})


def other_words(results: Results) -> Contents:
    """A table with a row for each graph and kind of word vectors."""
    if variants := results.variants_of("words"):
        yield Content(
            tables={"other_words": _by_graph(variants, _MEASURES["novel_given"], "words")}
        )


def embeddings(results: Results) -> Contents:
    """Other embedding models: MRR* and epochs by graph, and how often ISI is above Xavier."""
    variants = results.variants_of("embeddings")
    if not variants:
        return
    names = list(dict.fromkeys(name for runs in variants for name in runs.initializers))
    rows: dict[str, dict[str, Estimates]] = {}
    for runs in variants:
        rows.setdefault(runs.title, {})[runs.variant.title] = runs.given_means
    numbers = {
        "methods": isi(names),
        "pairs": len(variants),
        "ahead": sum(
            _best_of(runs.given_means, [BASELINE, *isi(names)]) in isi(names) for runs in variants
        ),
        "best": Counter(_best_of(runs.given_means, names) for runs in variants).most_common(),
    }
    tables = {
        f"embeddings_{name}": _by_graph(variants, of, "embedding") for name, of in _MEASURES.items()
    }
    yield Content(numbers, tables, {"embeddings": by_row(rows, variants[0].models)})


def _best_of(means: Estimates, names: Iterable[str]) -> str | None:
    """The model with the highest mean, the first in a tie; None without any."""
    return max(
        (name for name in names if name in means), key=lambda name: means[name].mean, default=None
    )


def other_graphs(results: Results) -> Contents:
    """All graphs side by side: sizes, shared entities, and the same measures on each;
    nothing without other graphs.
    """
    if not results.other_graphs:
        return
    others, like, ran = results.other_graphs, results.other_graphs[0].variant, list[ModelRuns]()
    for graph in (graph for graph in results.standalone if graph.queries is not None):
        initializers = [name for name in like.initializers if name in graph.initializers]
        ran.append(replace(graph.of_size(like.size), initializers=initializers))
    ran = [runs for runs in (*ran, *others) if len(runs.runs)]
    gains, compared = Rows(), defaultdict[tuple[str, str], list[Difference]](list)
    for runs in ran:
        cells = runs.by_grid_point("given")
        row: dict[Any, Any] = {"graph": runs.title}
        for first, second in _PAIRS:
            if {first, second} <= set(runs.models):
                points = difference(by_seed(cells[first], cells[second]))
                row[Column(f"{label(first)} minus {label(second)}", form=signed)] = points
                compared[first, second].append(points)
        gains.append(row)
    pairs = [
        (
            pair,
            sum(points.low > 0 for points in of_graphs),
            sum(points.high < 0 for points in of_graphs),
            len(of_graphs),
        )
        for pair, of_graphs in sorted(compared.items(), key=lambda item: _PAIRS.index(item[0]))
    ]
    graphs: list[Experiment | VariantRuns] = [*results.standalone, *others]
    tables = {"graphs": sizes(graphs), "graphs_shared": shared(graphs), "graphs_gains": gains}
    tables |= {f"graphs_{name}": _by_graph(ran, means) for name, means in _MEASURES.items()}
    figure = by_row({"": {runs.title: runs.given_means for runs in ran}}, others[0].models)
    yield Content({"size": like.size, "pairs": pairs}, tables, {"graphs": figure})


def sizes(graphs: Iterable[Experiment | VariantRuns]) -> Rows:
    """A row for each graph: counts, and the per cent of triples whose relation
    the tail's kind predicts.
    """
    return [
        {
            "graph": graph.title,
            "observations": int(triples["count"].sum()),
            "unique triples": len(triples),
            "relations": triples["relation"].nunique(),
            "entities": len(entities),
            "kinds": ", ".join(
                f"{number} {kind}" for kind, number in entities["kind"].value_counts().items()
            ),
            "predicted by kind %": 100
            * (relations_by_kind(entities, triples).max(axis=1).sum() / len(triples)),
        }
        for graph in graphs
        for entities, triples in [(graph.entities, graph.triples)]
    ]


def relations_by_kind(entities: pd.DataFrame, triples: pd.DataFrame) -> pd.DataFrame:
    """Number of unique triples: a row for each kind of tail, a column for each relation."""
    kinds = triples["tail"].map(entities.set_index("entity")["kind"])
    return triples.groupby([kinds.rename("kind"), "relation"]).size().unstack(fill_value=0)


def shared(graphs: Iterable[Experiment | VariantRuns]) -> Rows:
    """A matrix of graphs: the number of entity phrases that two graphs share."""
    phrases = {graph.title: set(graph.entities["phrase"]) for graph in graphs}
    return [
        {"graph": title, **{other: len(here & there) for other, there in phrases.items()}}
        for title, here in phrases.items()
    ]
