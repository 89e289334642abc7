"""What a trained model expects beyond the graph that it was trained on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.config import check, value_of
from isi.errors import InputError
from isi.experiment.store import Store
from isi.experiment.tables import JOINT
from isi.graph.graph import HEAD, RELATION, TAIL, Graph
from isi.models.model import EmbeddingParams, make_model
from isi.models.stack import Embedding

COLUMNS = ["head", "relation", "tail", "score", "rank"]
#: Numbers in one score matrix, at most.
BUDGET = 2**24


def predictions(store: Store, values: Mapping[str, Any], most: int, seed: int | None) -> pd.DataFrame:
    """The best tails that the graph lacks of each head and relation, by the joint model of a seed.

    A relation is asked of the entities of every kind that heads one of its triples. Ranks are among the tails that the
    graph lacks, from 1; of equal scores, the entity that stands first in the graph goes first.

    Args:
        store: of an experiment whose joint model was trained.
        values: of ``params.yaml``: the embedding and its family.
        most: tails of each head and relation.
        seed: of the sessions; the first one where it is null.

    Returns:
        columns head, relation, tail (names), score, rank.

    Raises:
        InputError: where there is no model, none of that seed, or it is not of this graph or family.
    """
    graph = store.graph()
    embedding, known = _model(store, graph, values, seed)
    return best(graph, embedding, known, most)


def best(graph: Graph, embedding: Embedding, known: Tensor, most: int) -> pd.DataFrame:
    """The same by any embedding of a graph, of which it knows some entities, (E,)."""
    rows = [row for relation in range(len(graph.relations)) for row in _best(graph, embedding, known, relation, most)]
    found = pd.DataFrame(rows, columns=COLUMNS)
    names = {"head": graph.entities, "relation": graph.relations, "tail": graph.entities}
    return found.assign(**{column: [listed[place] for place in found[column]] for column, listed in names.items()})


def _model(store: Store, graph: Graph, values: Mapping[str, Any], seed: int | None) -> tuple[Embedding, Tensor]:
    """The joint model of a seed, as a stack of one, and which entities it knows, (E,)."""
    path = JOINT.path(experiment=store.experiment)
    tensors = JOINT.read(["entity", "relation", "known", "seed"], experiment=store.experiment)
    entity, relation, known, seeds = (tensor.numpy() for tensor in tensors.values())
    row = 0 if seed is None else next(iter(np.flatnonzero(seeds == seed).tolist()), None)
    if row is None or not len(seeds):
        raise InputError(path, f"seed {seed}", f"expected one of {', '.join(map(str, seeds.tolist()))}")
    how = check(values.get("embedding"), EmbeddingParams, "embedding")
    family = make_model(how.model, value_of(values, f"models.{how.model}"), f"models.{how.model}")
    shapes = (len(graph.entities), len(graph.relations), family.width(entity.shape[-1]))
    got = (entity.shape[1], relation.shape[1], relation.shape[2])
    if got != shapes:
        expected = f"expected entities, relations and numbers of a relation's row {shapes} as in the graph, got {got}"
        raise InputError(path, "", expected)
    one = slice(row, row + 1)
    embedding = Embedding(torch.from_numpy(entity[one]), torch.from_numpy(relation[one]), family)
    return embedding, torch.from_numpy(known[row])


def _best(
    graph: Graph, embedding: Embedding, known: Tensor, relation: int, most: int
) -> Iterator[tuple[int, int, int, float, int]]:
    """Ids of head, relation and tail, with score and rank."""
    own = graph.triples[graph.triples[:, RELATION] == relation]
    heads = torch.nonzero(torch.isin(graph.kinds, graph.kinds[own[:, HEAD]]) & known)[:, 0]
    for piece in torch.split(heads, max(1, BUDGET // len(known))):
        scores = embedding.score_tails(piece[None], torch.full_like(piece, relation)[None])[0]
        place = torch.full_like(known, -1, dtype=torch.int64).index_copy(0, piece, torch.arange(len(piece)))
        there = own[place[own[:, HEAD]] >= 0]
        scores = scores.masked_fill(~known, -torch.inf)
        scores[place[there[:, HEAD]], there[:, TAIL]] = -torch.inf
        best = scores.sort(dim=-1, descending=True, stable=True)
        for head, values, tails in zip(piece.tolist(), best.values[:, :most], best.indices[:, :most], strict=True):
            for rank, (score, tail) in enumerate(zip(values.tolist(), tails.tolist(), strict=True), 1):
                if score > -torch.inf:
                    yield head, relation, tail, score, rank
