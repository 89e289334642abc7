"""Beyond the paper: stronger initializers, fewer insert triples, other words, other embeddings, and other graphs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
import pandas as pd

from isi.analyses.variants import Variant
from isi.report.data import Experiment, Results, VariantRuns
from isi.report.figures import Figure, by_row
from isi.report.section import Content
from isi.report.sections.gain import ZERO
from isi.report.significance import Difference, by_seed, difference, signed
from isi.report.stats import values
from isi.report.tables import Column, Estimate, ReportTable
from isi.report.words import BASELINE, JOINT, isi, label

#: The initializer with which stronger ones are compared, by seed.
REFERENCE = "ers"
#: The comparisons between initializers on each graph, with the novel entity given.
_PAIRS = (("ers", BASELINE), ("ers", "kind_mean"), ("es", "es_permuted_kinds"), ("soft_hybrid", "ers"),
          ("map_soft_hybrid", "soft_hybrid"))  # fmt: skip


def stronger(results: Results) -> Iterator[Content]:
    """Initializers that the paper does not have: a table for each graph, the best with the novel entity given first."""
    for runs in results.variants_of("baselines").values():
        given = {name: values(runs.given_means(name)) for name in runs.experiments}
        best = {name: max((means[method] for method in isi(runs.initializers)), default=inf)
                for name, means in given.items()}  # fmt: skip
        above = {name: {model: means[model] for model in sorted(runs.initializers, key=lambda model: -means[model])
                        if means[model] > best[name]} for name, means in given.items()}  # fmt: skip
        numbers = {
            "rivals": [name for name in runs.initializers if name not in results.params.initializers],
            "size": runs.variant.size, "titles": results.titles, "given": given, "best": best, "above": above,
            "reference": REFERENCE, "joint": JOINT,
        }  # fmt: skip
        tables = []
        for experiment, means in given.items():
            over_all, novel = (runs.immediate_means(experiment, scope) for scope in ("all", "novel"))
            cells, estimates = 100 * _given_by_seed(runs, experiment), runs.given_means(experiment)
            reference = cells[REFERENCE] if REFERENCE in cells else pd.Series(np.nan, cells.index)
            tables.append(ReportTable.of(f"strong_{experiment}", [
                {"model": label(model), "all": over_all.get(model), "novel": novel.get(model),
                 "novel entity given": estimates[model],
                 f"novel entity given, minus {label(REFERENCE)}": difference(by_seed(cells[model], reference))}
                for model in sorted(runs.models, key=lambda model: -means[model])
            ]))  # fmt: skip
        yield Content(numbers, tables)


def _given_by_seed(runs: VariantRuns, experiment: str) -> pd.DataFrame:
    """The entity half of the queries that give the novel entity: a row a seed and size, a column a model."""
    return runs.given_in(experiment).pivot_table("mrr_star_entity", ["seed", "size"], "model")


def _of_models(means: Mapping[str, Estimate]) -> dict[Any, Any]:
    return {label(model): estimate for model, estimate in means.items()}


def n_insert_triples(results: Results) -> Iterator[Content]:
    """By the number of insert triples: a figure, and its numbers."""
    for first in [*results.variants_of("insert_triples").values()][:1]:
        experiment, models = first.experiments[0], first.models
        listed = [runs for runs in results.variants_of("insert_triples").values() if experiment in runs.experiments]
        limits = [runs.variant.max_insert_triples for runs in listed]
        numbers = ["all" if limit is None else str(limit) for limit in limits]
        rows = [runs.given_means(experiment) for runs in listed]
        means = pd.DataFrame([values(row) for row in rows])
        lowest = {name: int(means[name].to_numpy().argmin()) for name in first.initializers}
        across = "insert triples of each novel entity, at most"
        figure = Figure("n_insert_triples", by_row({"": dict(zip(numbers, rows, strict=True))}, models, across))
        table = [{"insert triples": number, **_of_models(row)} for number, row in zip(numbers, rows, strict=True)]
        yield Content(
            {
                "size": first.variant.size, "initializers": first.initializers, "fewest": means.iloc[0].to_dict(),
                "most": means.iloc[-1].to_dict(), "numbers": numbers, "joint": JOINT,
                "worse": [(name, means[name].iloc[place], numbers[place]) for name, place in lowest.items()
                          if means[name].iloc[0] - means[name].iloc[place] >= ZERO],
            },
            [figure, ReportTable.of("n_insert_triples", table)],
        )  # fmt: skip


def _by_graph(
    results: Results, variants: Mapping[str, VariantRuns], column: str,
    means: Callable[[VariantRuns, str], Mapping[str, Estimate]],
) -> list[dict[Any, Any]]:  # fmt: skip
    """A row for each experiment and variant that ran on it: the estimates by model."""
    return [
        {"graph": results.titles[experiment], column: runs.title, **_of_models(means(runs, experiment))}
        for experiment in dict.fromkeys(name for runs in variants.values() for name in runs.experiments)
        for runs in variants.values() if experiment in runs.experiments
    ]  # fmt: skip


def other_words(results: Results) -> Iterator[Content]:
    """A row for each kind of word vectors and each graph."""
    if variants := results.variants_of("words"):
        rows = _by_graph(results, variants, "words", VariantRuns.given_means)
        yield Content(shown=[ReportTable.of("other_words", rows)])


def embeddings(results: Results) -> Iterator[Content]:
    """Other embedding models on the graphs of the paper and of today: who is ahead, and how soon they converge."""
    variants = results.variants_of("embeddings")
    if not variants:
        return
    pairs = [(runs.title, experiment, runs.given_means(experiment))
             for runs in variants.values() for experiment in runs.experiments]  # fmt: skip
    names = list(dict.fromkeys(name for runs in variants.values() for name in runs.initializers))
    rows: dict[str, dict[str, Mapping[str, Estimate]]] = {}
    for title, experiment, given in pairs:
        rows.setdefault(results.titles[experiment], {})[title] = given
    numbers = {
        "methods": isi(names), "baseline": BASELINE, "pairs": len(pairs),
        "ahead": sum(_best_of(given, [BASELINE, *isi(names)]) in isi(names) for *_, given in pairs),
        "best": Counter(_best_of(given, names) for *_, given in pairs).most_common(),
    }  # fmt: skip
    means: dict[str, Callable[[VariantRuns, str], Mapping[str, Estimate]]] = {
        "immediate": lambda runs, experiment: runs.immediate_means(experiment, "novel"),
        "novel_given": VariantRuns.given_means,
        "epochs": lambda runs, experiment: runs.epochs_means(experiment, results.params),
    }
    tables = [ReportTable.of(f"embeddings_{name}", _by_graph(results, variants, "embedding", of))
              for name, of in means.items()]  # fmt: skip
    yield Content(numbers, [Figure("embeddings", by_row(rows, next(iter(variants.values())).models)), *tables])


def _best_of(means: Mapping[str, Estimate], names: Iterable[str]) -> str | None:
    """The model with most; the first of several."""
    return max((name for name in names if name in means), key=lambda name: means[name].mean, default=None)


def other_graphs(results: Results) -> Iterator[Content]:
    """All graphs side by side, what they share, and the same runs on each."""
    if not results.other_graphs:
        return
    others = {one.runs.title: one.runs for one in results.other_graphs.values()}
    graphs = {one.title: (one.entities, one.triples) for one in results.standalone}
    graphs |= {one.runs.title: (one.entities, one.triples) for one in results.other_graphs.values()}
    first = next(iter(others.values()))
    main = {one.title: _as_variant(one, results, first.variant)
            for one in results.standalone if one.name in results.query_breakdown}  # fmt: skip
    runs_of = {title: runs for title, runs in (main | others).items() if runs.experiments}
    given = {title: runs.given_means(runs.experiments[0]) for title, runs in runs_of.items()}
    gains: dict[str, dict[tuple[str, str], Difference]] = {}
    for title, runs in runs_of.items():
        cells = 100 * _given_by_seed(runs, runs.experiments[0])
        gains[title] = {(first, second): difference(by_seed(cells[first], cells[second]))
                        for first, second in _PAIRS if first in cells and second in cells}  # fmt: skip
    rows: dict[str, dict[str, dict[Any, Any]]] = {
        "immediate": {title: _of_models(runs.immediate_means(runs.experiments[0], "novel"))
                      for title, runs in runs_of.items()},
        "novel_given": {title: _of_models(means) for title, means in given.items()},
        "gains": {title: {Column(f"{label(first)} minus {label(second)}", form=signed): points
                          for (first, second), points in pairs.items()} for title, pairs in gains.items()},
        "epochs": {title: _of_models(_finetuned(runs, results).epochs_means(runs.experiments[0], results.params))
                   for title, runs in runs_of.items()},
    }  # fmt: skip
    compared = {pair: [pairs[pair] for pairs in gains.values() if pair in pairs] for pair in _PAIRS}
    numbers = {"size": first.variant.size, "pairs": [
        (pair, sum(points.low > 0 for points in of_graphs), sum(points.high < 0 for points in of_graphs),
         len(of_graphs)) for pair, of_graphs in compared.items() if of_graphs
    ]}  # fmt: skip
    tables = [ReportTable.of(f"graphs_{name}", [{"graph": title, **row} for title, row in lines.items()])
              for name, lines in rows.items()]  # fmt: skip
    yield Content(numbers, [
        ReportTable.of("graphs", sizes(graphs)), ReportTable.of("graphs_shared", shared(graphs)),
        Figure("graphs", by_row({"": given}, first.models)), *tables,
    ])  # fmt: skip


def sizes(graphs: Mapping[str, tuple[pd.DataFrame, pd.DataFrame]]) -> list[dict[str, Any]]:
    """A row for each graph; of each its entities and triples (``ENTITIES`` and ``TRIPLES``)."""
    return [
        {
            "graph": title, "observations": int(triples["count"].sum()), "unique triples": len(triples),
            "relations": triples["relation"].nunique(), "entities": len(entities),
            "kinds": ", ".join(f"{number} {kind}" for kind, number in entities["kind"].value_counts().items()),
            "predicted by kind %": 100 * (relations_by_kind(entities, triples).max(axis=1).sum() / len(triples)),
        }
        for title, (entities, triples) in graphs.items()
    ]  # fmt: skip


def relations_by_kind(entities: pd.DataFrame, triples: pd.DataFrame) -> pd.DataFrame:
    """How many unique triples have a tail of each kind (a row) and each relation (a column)."""
    kinds = triples["tail"].map(entities.set_index("entity")["kind"])
    return triples.groupby([kinds.rename("kind"), "relation"]).size().unstack(fill_value=0)


def shared(graphs: Mapping[str, tuple[pd.DataFrame, pd.DataFrame]]) -> list[dict[str, Any]]:
    """How many entities each two graphs share, by phrase."""
    phrases = {title: set(entities["phrase"]) for title, (entities, _) in graphs.items()}
    return [{"graph": title, **{other: len(here & there) for other, there in phrases.items()}}
            for title, here in phrases.items()]  # fmt: skip


def _as_variant(experiment: Experiment, results: Results, like: Variant) -> VariantRuns:
    """A main experiment as if it were a variant, at another's size."""
    frames, name = (experiment.runs, results.query_breakdown[experiment.name].queries), experiment.name
    entry = like.model_copy(update={"title": experiment.title, "experiments": [name], "changes": {}})
    return VariantRuns(entry, *(rows[rows["size"] == like.size].assign(experiment=name) for rows in frames))


def _finetuned(runs: VariantRuns, results: Results) -> VariantRuns:
    """The runs without those of a main experiment that were not fine-tuned."""
    main = results.experiments.get(runs.experiments[0])
    left_out = set(main.initializers) - set(main.finetuned) if main else set()
    return replace(runs, runs=runs.runs[~runs.runs["model"].isin(left_out)])
