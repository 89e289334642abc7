"""Write docs/benchmarks/semi_inductive.csv: semi-inductive link prediction on two graphs that ship,
as Wikidata5M-SI asks it (arXiv 2310.11917).

Entities with eleven or more facts are hidden. An embedding of the others is trained. Then each
hidden entity is inserted from k of its facts, and the other ends of its remaining facts are ranked
among all entities. The queries are the same for each k. ``±`` follows the measure of which it is
the half width of the 95 % interval over the hidden entities of all seeds, each with all its
queries; the embedding of a seed counts as given. *Loss of trained MRR*: what a sample of the
triples that the embedding was trained on loses. On FB15k-237, entities have word vectors of
their labels, from the vocabulary that ships; CoDEx-S has no labels.
"""

from __future__ import annotations

import sys
import time
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import torch
from tqdm import tqdm

from isi.benchmark import HiddenSplit, hide
from isi.benchmark.graphs import shipped
from isi.insertion.api import insert_request
from isi.insertion.inverses import both_ways, pack
from isi.insertion.request import InsertRequest, KnownEmbedding
from isi.live import phrases
from isi.models.model import make_model
from isi.models.stack import Embedding, uniform
from isi.report.tables.estimates import over_seeds
from isi.training.rows import Facts, Recipe, Task, fit
from tools.docs import BENCHMARKS, write_table

NAME = "semi_inductive"
SHOTS = (0, 1, 3, 5, 10)  #: Numbers k of facts.
FEWEST = 11  #: Facts with a known entity that a hidden one has, so that one remains as a query.
QUERIES = 0.1  #: Share of these facts that are queries.
DIMENSION = 200  #: 100 complex numbers.
HALF_RANGE = 1e-3  #: Of the first vectors.
#: Initializers by whether they read facts, and whether they read words; None: the default.
METHODS: dict[str | None, tuple[bool, bool]] = {
    None: (False, False),
    "map": (True, False),
    "soft_hybrid": (True, True),
    "soft_rs": (True, False),
    "er_avg": (True, False),
    "soft_es": (False, True),
    "mean": (False, False),
    "xavier": (False, False),
}


#: What a row of the table is about.
CASE = ["graph", "facts", "initializer"]


@dataclass(frozen=True)
class Case:
    """A graph, which share of its entities is hidden, and how the rest is trained."""

    title: str
    graph: str
    has_labels: bool
    fraction: float
    seeds: int
    epochs: int
    recipe: Recipe


def recipe(negatives: int | None) -> Recipe:
    """Cross-entropy over all entities (None) or over a sample, with N3, by Adagrad."""
    return Recipe(loss="softmax", batch_size=1024, learning_rate=0.1, n3=5e-3, negatives=negatives)


CASES = (
    Case("CoDEx-S", "codex_s", False, 0.05, 3, 30, recipe(None)),
    Case("FB15k-237", "fb15k237", True, 0.0075, 1, 12, recipe(1000)),
)


def main(named: list[str]) -> None:
    torch.set_num_threads(1)
    warnings.simplefilter("ignore", UserWarning)
    cases = [case for case in CASES if not named or case.graph in named]
    each = [inserted(case, seed) for case in cases for seed in range(case.seeds)]
    rows, ranks = ([row for parts in both for row in parts] for both in zip(*each, strict=True))
    table = measured(pd.DataFrame(rows), pd.concat(ranks)).round(3)
    if named:
        table = with_others(table)
    write_table(NAME, table)


def measured(rows: pd.DataFrame, ranks: pd.DataFrame) -> pd.DataFrame:
    """Means over seeds by ``CASE``; of the ranks, means over queries, with intervals over hidden
    entities.

    Args:
        rows: ``hidden``, loss and seconds by ``CASE`` and seed.
        ranks: ``CASE``, ``entity`` (another one in each seed) and ``rank`` of each query.
    """
    means = rows.groupby(CASE, sort=False).mean().drop(columns="seed")
    rank = ranks["rank"]
    values = ranks.assign(mrr=1 / rank, hits=rank.le(10).astype(float), seed=ranks["entity"])
    names = {"mrr": "MRR of known ends", "hits": "hits@10"}
    estimates = over_seeds(values, CASE, names, scale=1)
    columns = {"hidden": means["hidden"].astype(int)}
    for name in names.values():
        columns[name] = estimates[name]
        columns[f"{name} ±"] = estimates[f"{name} high"] - estimates[name]
    table = pd.DataFrame(columns, means.index).join(means.drop(columns="hidden")).reset_index()
    return table[["graph", "hidden", *table.columns.drop(["graph", "hidden"])]]


def with_others(table: pd.DataFrame) -> pd.DataFrame:
    """The table with the rows of other graphs that the file has."""
    path = BENCHMARKS / f"{NAME}.csv"
    others = pd.read_csv(path) if path.exists() else table
    return pd.concat([others[~others["graph"].isin(table["graph"])], table])[table.columns]


def inserted(case: Case, seed: int) -> tuple[list[dict[str, Any]], list[pd.DataFrame]]:
    """``rows`` and ``ranks`` of ``measured``, for each number of facts and initializer."""
    graph, labels = shipped(case.graph)
    split = hide(graph, fraction=case.fraction, fewest=FEWEST, queries=QUERIES, seed=seed)
    theta = trained(case, split, seed)
    words = vectors_of([labels[row] for row in split.ids.order]) if case.has_labels else None
    before = split.evaluate(theta.model, entities=theta.entity[0], relations=theta.relation[0])
    rows, ranks = list[dict[str, Any]](), list[pd.DataFrame]()
    for shots in tqdm(SHOTS, f"{case.title}, seed {seed}", disable=None):
        for name, (needs_facts, needs_words) in METHODS.items():
            nothing_known = not shots and (needs_facts or (name is None and words is None))
            if nothing_known or (needs_words and words is None):
                continue
            request = InsertRequest(
                triples=split.ids.insert_triples(shots),
                new=len(split.hidden),
                words=words,
                initializer=name,
                trained_with="softmax",
                seed=seed,
                allow_without_facts=True,  # the label may have no known word
            )
            known = KnownEmbedding(
                theta.entity[0], theta.relation[0], theta.model, triples=split.ids.triples
            )
            begun = time.process_time()
            result = insert_request(known, request)
            seconds = time.process_time() - begun
            done = split.evaluate(
                theta.model, entities=result.entities, relations=theta.relation[0]
            )
            about = {"graph": case.title, "facts": shots, "initializer": name or "default"}
            rows.append(
                {
                    **about,
                    "hidden": len(split.hidden),
                    "seed": seed,
                    "loss of trained MRR": before.earlier - done.earlier,
                    "seconds": seconds,
                }
            )
            of_known = done.ranks[done.ranks["asked"] == "known"]
            entity = of_known["head"].where(of_known["slot"] == "tail", of_known["tail"])
            ranks.append(
                of_known[["rank"]].assign(**about, entity=[f"{seed} {label}" for label in entity])
            )
    return rows, ranks


def trained(case: Case, split: HiddenSplit, seed: int) -> Embedding:
    """An embedding of the known entities."""
    everyone = torch.ones(1, split.ids.known, dtype=torch.bool)
    relations, first = 2 * len(split.relations), torch.tensor([(0,)])
    model = make_model("complex", {}, "model")
    theta = uniform(everyone, relations, model, DIMENSION, HALF_RANGE, seed, first)
    triples = both_ways(torch.from_numpy(split.ids.triples))
    task = Task(Facts(triples, torch.ones(len(triples))))
    with tqdm(total=case.epochs, desc=f"{case.title}, seed {seed}", disable=None) as bar:

        def count(_: int) -> None:
            bar.update()

        return pack(fit(theta, task, case.recipe, case.epochs, seed, (0,), count))


def vectors_of(labels: list[str]) -> np.ndarray:
    """The vectors of labels, zero for one without a known word; (E, v)."""
    vocabulary = phrases.shipped()
    return np.stack([vocabulary.vector(label) for label in labels])


if __name__ == "__main__":
    main(sys.argv[1:])
