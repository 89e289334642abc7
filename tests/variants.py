"""Small variants and graphs of the second pipeline for tests of the report."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import pandas as pd

from isi.analyses.variants import Variant
from isi.report.data import Results, VariantRuns
from tests.reports import runs, small_params

#: By model: MRR* of queries that give the novel entity, for each seed.
Given = Mapping[str, Sequence[float]]

ENTITIES = pd.DataFrame(
    {
        "entity": ["mug", "cup board", "kitchen", "open"],
        "kind": ["object", "object", "room", "affordance"],
        "phrase": ["mug", "cupboard", "kitchen", "open"],
    }
)
TRIPLES = pd.DataFrame(
    [
        ("mug", "atLocation", "kitchen", 3),
        ("mug", "atLocation", "cup board", 2),
        ("mug", "nextTo", "cup board", 4),
        ("cup board", "hasAffordance", "open", 1),
    ],
    columns=["head", "relation", "tail", "count"],
)


def queries_of(experiment: str, given: Given) -> pd.DataFrame:
    """Rows of the query breakdown: ``given``, and rows of other queries with other values,
    which must be ignored.
    """
    rows = [
        (model, seed, hidden, novel, mrr_star)
        for model, values in given.items()
        for seed, value in enumerate(values)
        for hidden, novel, mrr_star in (
            ("tail", "given", value),
            ("head", "answer", 0.99),
            ("tail", "both", 0.98),
            ("relation", "given", 0.97),
        )
    ]
    frame = pd.DataFrame(rows, columns=["model", "seed", "hidden", "novel", "mrr_star"])
    frame = frame.assign(
        experiment=experiment,
        size=5,
        scope="novel",
        filter="learned",
        relation="on",
        queries=2,
        observations=1,
    )
    others = (frame.assign(scope="all", mrr_star=0.96), frame.assign(filter="true", mrr_star=0.95))
    return pd.concat([frame, *others], ignore_index=True)


def runs_of(
    experiment: str,
    immediate: Mapping[str, float],
    later: Mapping[tuple[str, int], Sequence[float]],
) -> pd.DataFrame:
    """Runs: ``immediate`` MRR* at epoch 0 (scopes all and novel, both seeds),
    and ``later`` MRR* (novel_heldout).
    """
    rows = [
        (model, scope, 5, seed, 0, value)
        for model, value in immediate.items()
        for scope in ("all", "novel")
        for seed in (0, 1)
    ]
    rows += [
        (model, "novel_heldout", 5, seed, epoch, value)
        for (model, seed), values in later.items()
        for epoch, value in enumerate(values)
    ]
    return runs(rows).assign(experiment=experiment)


def variant(
    group: str,
    given: Mapping[str, Given],
    immediate: Mapping[str, float] | None = None,
    **entry: Any,
) -> list[VariantRuns]:
    """A variant with ``given`` MRR* by experiment and model,
    and with the same immediate MRR* in each experiment.
    """
    models = list(
        dict.fromkeys(name for values in given.values() for name in values if name != "joint")
    )
    listed = {
        "title": group,
        "group": group,
        "experiments": list(given),
        "initializers": models,
        "size": 5,
        "seeds": 2,
    }
    later, key = entry.pop("later", {}), entry.pop("key", group)
    immediate = immediate or dict.fromkeys((*models, "joint"), 0.5)
    params = small_params(["home"])
    return [
        VariantRuns.of(
            key,
            Variant(**listed | entry),
            name,
            f"the {name} graph",
            params,
            runs_of(name, immediate, later),
            queries_of(name, values),
        )
        for name, values in given.items()
    ]


def beyond_of(results: Results) -> Results:
    """Results with a variant of each group, and another graph."""
    given = {
        "xavier": [0.1, 0.3],
        "es": [0.4, 0.5],
        "ers": [0.6, 0.7],
        "map": [0.8, 0.8],
        "joint": [0.9, 0.9],
    }
    groups = ("causes", "baselines", "insert_triples", "words", "embeddings")
    listed = [runs for group in groups for runs in variant(group, {"home": given})]
    (graph,) = variant("graphs", {"lab": given}, key="lab")
    return replace(
        results, variants=listed, other_graphs=[replace(graph, entities=ENTITIES, triples=TRIPLES)]
    )
