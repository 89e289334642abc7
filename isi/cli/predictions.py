"""Link prediction for ``isi export``: the best tails that a graph lacks, for each head and relation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.bundle.query import OpenBundle
from isi.config import check, value_of
from isi.errors import InputError
from isi.experiment.store import JOINT, Store
from isi.graph.graph import HEAD, RELATION, TAIL, Graph
from isi.models.model import EmbeddingParams, make_model
from isi.models.stack import Embedding

COLUMNS = ["head", "relation", "tail", "score", "rank"]
NO_PREDICTIONS = pd.DataFrame(columns=COLUMNS)
#: Numbers in one score matrix, at most.
BUDGET = 2**24


def by_joint_model(store: Store, values: Mapping[str, Any], most: int, seed: int | None) -> pd.DataFrame:
    """Predictions of the joint model of a seed.

    Args:
        store: of an experiment whose joint model was trained.
        values: of ``params.yaml``: the embedding and its model.
        most: tails for each head and relation.
        seed: of the sessions; the first one where it is null.

    Returns:
        columns head, relation, tail (names), score, rank.

    Raises:
        InputError: where there is no model, none of that seed, or it is not of this graph or model.
    """
    graph, path = store.graph(), JOINT.path(experiment=store.experiment)
    tensors = JOINT.read(["entity", "relation", "known", "seed"], experiment=store.experiment)
    entity, relation, known, seeds = (tensor.numpy() for tensor in tensors.values())
    row = 0 if seed is None else next(iter(np.flatnonzero(seeds == seed).tolist()), None)
    if row is None or not len(seeds):
        raise InputError(path, f"seed {seed}", f"expected one of {', '.join(map(str, seeds.tolist()))}")
    params = check(values.get("embedding"), EmbeddingParams, "embedding")
    model = make_model(params.model, value_of(values, f"models.{params.model}"), f"models.{params.model}")
    expected = (len(graph.entities), len(graph.relations), model.width(entity.shape[-1]))
    shape = (entity.shape[1], relation.shape[1], relation.shape[2])
    if shape != expected:
        names = "entities, relations and numbers of a relation's row"
        raise InputError(path, "", f"expected {names} {expected} as in the graph, got {shape}")
    rows = slice(row, row + 1)
    embedding = Embedding(torch.from_numpy(entity[rows]), torch.from_numpy(relation[rows]), model)
    return best_tails(graph, embedding, torch.from_numpy(known[row]), most)


def by_bundle(opened: OpenBundle, kinds: pd.Series[str], most: int) -> pd.DataFrame:
    """Predictions of a bundle's model."""
    bundle = opened.bundle
    codes = torch.from_numpy(pd.factorize(kinds)[0].astype("int64"))
    ids, counts = torch.from_numpy(bundle.triples), torch.ones(len(bundle.triples), dtype=torch.int64)
    graph = Graph(bundle.entity_names, bundle.relation_names, ids, counts, codes)
    return best_tails(graph, opened.embedding, torch.ones(len(bundle.entities), dtype=torch.bool), most)


def best_tails(graph: Graph, embedding: Embedding, known: Tensor, most: int) -> pd.DataFrame:
    """The best tails for each head and relation that do not make a triple of the graph.

    Heads of a relation are the entities of every kind that heads one of its triples. Ranks start at 1; of equal scores,
    the entity of lower id goes first.

    Args:
        known: entities that the embedding knows; shape (E,), bool.
        most: tails for each head and relation.
    """
    rows = [row for relation in range(len(graph.relations)) for row in _tails(graph, embedding, known, relation, most)]
    table = pd.DataFrame(rows, columns=COLUMNS)
    names = {"head": graph.entities, "relation": graph.relations, "tail": graph.entities}
    return table.assign(**{column: [names[column][row] for row in table[column]] for column in names})


def _tails(
    graph: Graph, embedding: Embedding, known: Tensor, relation: int, most: int
) -> Iterator[tuple[int, int, int, float, int]]:
    """Ids of head, relation and tail, with score and rank."""
    triples = graph.triples[graph.triples[:, RELATION] == relation]
    heads = torch.nonzero(torch.isin(graph.kinds, graph.kinds[triples[:, HEAD]]) & known)[:, 0]
    for part in torch.split(heads, max(1, BUDGET // len(known))):
        scores = embedding.score_tails(part[None], torch.full_like(part, relation)[None])[0]
        row_of = torch.full_like(known, -1, dtype=torch.int64).index_copy(0, part, torch.arange(len(part)))
        present = triples[row_of[triples[:, HEAD]] >= 0]
        scores = scores.masked_fill(~known, -torch.inf)
        scores[row_of[present[:, HEAD]], present[:, TAIL]] = -torch.inf
        best = scores.sort(dim=-1, descending=True, stable=True)
        for head, values, tails in zip(part.tolist(), best.values[:, :most], best.indices[:, :most], strict=True):
            for rank, (score, tail) in enumerate(zip(values.tolist(), tails.tolist(), strict=True), 1):
                if score > -torch.inf:
                    yield head, relation, tail, score, rank
