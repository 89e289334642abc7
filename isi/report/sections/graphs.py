"""Insertion into other embeddings and on other graphs: what ISI gains on each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import pandas as pd

from isi.report.data import Experiment, Results
from isi.report.figures import Figure, by_row, legend, panels
from isi.report.models import BASELINE, isi, label
from isi.report.section import Content
from isi.report.significance import Difference, by_seed, difference, signed
from isi.report.tables import Column, Estimate, Table
from isi.report.variants import VariantRuns, of_group

#: The comparisons between initializers, with the novel entity given.
_PAIRS = (("ers", BASELINE), ("ers", "kind_mean"), ("es", "es_permuted_kinds"), ("soft_hybrid", "ers"),
          ("map_soft_hybrid", "soft_hybrid"))  # fmt: skip
#: The estimates by model that a row of a table has for a variant and an experiment.
Means = Callable[[VariantRuns, str], Mapping[str, Estimate]]


def of_models(means: Mapping[str, Estimate]) -> dict[Any, Estimate]:
    """Columns of models."""
    return {label(model): estimate for model, estimate in means.items()}


def rows_of(
    results: Results, variants: Mapping[str, VariantRuns], means: Means, variant_column: str
) -> list[dict[Any, Any]]:
    """A row for each experiment and variant that ran on it."""
    return [
        {"graph": results.titles[experiment], variant_column: runs.title, **of_models(means(runs, experiment))}
        for experiment in dict.fromkeys(name for runs in variants.values() for name in runs.experiments)
        for runs in variants.values() if experiment in runs.experiments
    ]  # fmt: skip


def embeddings(results: Results) -> Iterator[Content]:
    """Other embedding models on the graphs of the paper and of today: who is ahead, and how soon they converge."""
    found = of_group(results.variants, "embeddings")
    if not found:
        return
    pairs = [
        (runs, experiment, runs.given_means(experiment)) for runs in found.values() for experiment in runs.experiments
    ]
    names = list(dict.fromkeys(name for runs in found.values() for name in runs.initializers))
    experiments = list(dict.fromkeys(experiment for _, experiment, _ in pairs))
    canvas, axes = panels(len(experiments))
    models = next(iter(found.values())).models
    for panel, experiment in zip(axes, experiments, strict=True):
        of_panel = [(runs.title, means) for runs, name, means in pairs if name == experiment]
        by_row(panel, pd.DataFrame([means for _, means in of_panel]), models, [title for title, _ in of_panel])
        panel.set_title(results.titles[experiment])
    legend(canvas, axes)
    numbers = {
        "methods": isi(names), "baseline": BASELINE, "pairs": len(pairs),
        "ahead": sum(best_of(means, [BASELINE, *isi(names)]) in isi(names) for *_, means in pairs),
        "best": Counter(best_of(means, names) for *_, means in pairs).most_common(),
    }  # fmt: skip
    means: dict[str, Means] = {
        "immediate": lambda runs, experiment: runs.immediate_means(experiment, "novel"),
        "novel_given": VariantRuns.given_means,
        "epochs": lambda runs, experiment: runs.epochs_means(experiment, results.params),
    }
    tables = [Table.of(f"embeddings_{name}", rows_of(results, found, of, "embedding")) for name, of in means.items()]
    yield Content(numbers, [Figure("embeddings", canvas), *tables])


def best_of(means: Mapping[str, Estimate], names: Iterable[str]) -> str | None:
    """The model with most; the first of several."""
    return max((name for name in names if name in means), key=lambda name: means[name].mean, default=None)


def other_graphs(results: Results) -> Iterator[Content]:
    """All graphs side by side, what they share, and the same runs on each."""
    if not results.other_graphs:
        return
    graphs = {one.title: (one.entities, one.triples) for one in results.standalone}
    graphs |= {one.runs.title: (one.entities, one.triples) for one in results.other_graphs.values()}
    others = {one.runs.title: one.runs for one in results.other_graphs.values()}
    first = next(iter(others.values()))
    main = {
        one.title: as_variant(one, results, first) for one in results.standalone if one.name in results.query_breakdown
    }
    runs_of = {title: runs for title, runs in (main | others).items() if runs.experiments}
    given = {title: runs.given_means(runs.experiments[0]) for title, runs in runs_of.items()}
    differences = {title: differences_of(runs) for title, runs in runs_of.items()}
    canvas, (axes,) = panels(1, columns=1)
    by_row(axes, pd.DataFrame(list(given.values())), first.models, list(given))
    legend(canvas, [axes])
    rows: dict[str, dict[str, dict[Any, Any]]] = {
        "immediate": {title: of_models(runs.immediate_means(runs.experiments[0], "novel"))
                      for title, runs in runs_of.items()},
        "novel_given": {title: of_models(means) for title, means in given.items()},
        "gains": {title: {Column(f"{label(first)} minus {label(second)}", form=signed): points
                          for (first, second), points in pairs.items()} for title, pairs in differences.items()},
        "epochs": {title: of_models(finetuned(runs, results).epochs_means(runs.experiments[0], results.params))
                   for title, runs in runs_of.items()},
    }  # fmt: skip
    compared = [(pair, [pairs[pair] for pairs in differences.values() if pair in pairs]) for pair in _PAIRS]
    numbers = {
        "size": first.variant.size,
        "pairs": [
            (pair, sum(points.low > 0 for points in found), sum(points.high < 0 for points in found), len(found))
            for pair, found in compared if found
        ],
    }  # fmt: skip
    tables = [Table.of(f"graphs_{name}", [{"graph": title, **row} for title, row in lines.items()])
              for name, lines in rows.items()]  # fmt: skip
    yield Content(numbers, [Table.of("graphs", sizes(graphs)), Table.of("graphs_shared", shared(graphs)),
                            Figure("graphs", canvas), *tables])  # fmt: skip


def sizes(graphs: Mapping[str, tuple[pd.DataFrame, pd.DataFrame]]) -> list[dict[str, Any]]:
    """A row for each graph; of each its entities and triples (``tables.ENTITIES`` and ``tables.TRIPLES``)."""
    rows = []
    for title, (entities, triples) in graphs.items():
        predicted = relations_by_kind(entities, triples).max(axis=1).sum() / len(triples)
        kinds = entities["kind"].value_counts()
        rows.append({
            "graph": title, "observations": int(triples["count"].sum()), "unique triples": len(triples),
            "relations": triples["relation"].nunique(), "entities": len(entities),
            "kinds": ", ".join(f"{number} {kind}" for kind, number in kinds.items()),
            "predicted by kind %": 100 * predicted,
        })  # fmt: skip
    return rows


def relations_by_kind(entities: pd.DataFrame, triples: pd.DataFrame) -> pd.DataFrame:
    """How many unique triples have a tail of each kind (a row) and each relation (a column)."""
    kinds = triples["tail"].map(entities.set_index("entity")["kind"])
    return triples.groupby([kinds.rename("kind"), "relation"]).size().unstack(fill_value=0)


def shared(graphs: Mapping[str, tuple[pd.DataFrame, pd.DataFrame]]) -> list[dict[str, Any]]:
    """How many entities each two graphs share, by phrase."""
    phrases = {title: set(entities["phrase"]) for title, (entities, _) in graphs.items()}
    return [{"graph": title, **{other: len(here & there) for other, there in phrases.items()}}
            for title, here in phrases.items()]  # fmt: skip


def as_variant(experiment: Experiment, results: Results, like: VariantRuns) -> VariantRuns:
    """A main experiment as if it were a variant, at another's size."""
    queries, name = results.query_breakdown[experiment.name].queries, experiment.name
    runs, queries = (frame[frame["size"] == like.variant.size] for frame in (experiment.runs, queries))
    entry = like.variant.model_copy(update={"title": experiment.title, "experiments": [name], "changes": {}})
    return VariantRuns(entry, runs.assign(experiment=name), queries.assign(experiment=name))


def finetuned(runs: VariantRuns, results: Results) -> VariantRuns:
    """The runs without those of a main experiment that were not fine-tuned."""
    main = results.experiments.get(runs.experiments[0])
    left_out = set(main.initializers) - set(main.finetuned) if main else set()
    return replace(runs, runs=runs.runs[~runs.runs["model"].isin(left_out)])


def differences_of(runs: VariantRuns) -> dict[tuple[str, str], Difference]:
    """Paired differences of the first minus the second of each pair that was run, with the novel entity given."""
    cells = 100 * runs.given_in(runs.experiments[0]).pivot_table("mrr_star_entity", ["seed", "size"], "model")
    return {
        (first, second): difference(by_seed(cells[first], cells[second]))
        for first, second in _PAIRS if first in cells and second in cells
    }  # fmt: skip
