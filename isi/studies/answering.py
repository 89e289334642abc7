"""The answers of a model to every query about some novel entities, in order, with what is true."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.base.schemas import TRUE_NAMES
from isi.embeddings.stack import Embedding
from isi.experiments.cells import Cells
from isi.graph import HEAD, RELATION, TAIL
from isi.sessions.session import OUT, TRAIN

#: Columns of triples with the end that a query hides, and with the one that it gives.
HIDDEN = {"tail": (TAIL, HEAD), "head": (HEAD, TAIL)}
#: What a true answer is to a session; none: not true.
TRUE = (None, *TRUE_NAMES)
TOLD, LEARNED, HELD_OUT = 1, 2, 3


@dataclass(frozen=True)
class Picked:
    """The novel entities of a stack that are shown: their model, place in ``novel``, and id; shapes (K,)."""

    model: Tensor
    place: Tensor
    entity: Tensor

    def of(self, values: Tensor) -> Tensor:
        """Values of novel entities, (M, n, ...), of those alone; shape (K, ...)."""
        return values[self.model, self.place]


@dataclass(frozen=True)
class Asked:
    """Queries about the entities that are shown: (entity, relation, ?) and (?, relation, entity)."""

    picked: Picked
    #: who may answer; shape: (K, E), bool
    candidates: Tensor
    #: which are asked, by relation and by what is hidden, in the order of ``HIDDEN``; shape: (K, R, 2), bool
    asked: Tensor
    #: what each answer is, an index into ``TRUE``; shape: (K, R, 2, E), int8
    truth: Tensor


def pick(cells: Cells, seeds: Mapping[int, int]) -> Picked:
    """The novel entities of a stack that are shown in its seeds; ``seeds``: of entities."""
    novel = cells.novel_in(1)
    wanted = torch.tensor([[seeds[entity] == seed for entity in own]
                           for own, seed in zip(novel.tolist(), cells.seeds, strict=True)])  # fmt: skip
    model, place = wanted.nonzero(as_tuple=True)
    return Picked(model, place, novel[model, place])


def asked_of(cells: Cells, picked: Picked, told: Tensor) -> Asked:
    """The queries of entities that are shown: for the ends that entities of their kind are of triples.

    Args:
        told: the insert triples; shape (M, T), bool.
    """
    graph, session = cells.graph, cells.session(1)
    code = torch.where(session.splits == TRAIN, torch.where(told, TOLD, LEARNED), HELD_OUT)
    code = code.masked_fill(session.splits == OUT, 0).to(torch.int8)
    shape = len(graph.relations), len(HIDDEN)
    takes = torch.zeros(int(graph.kinds.max()) + 1, *shape, dtype=torch.bool)
    truth = torch.zeros(len(picked.entity), *shape, len(graph.entities), dtype=torch.int8)
    relation = graph.triples[:, RELATION]
    for side, (hidden, given) in enumerate(HIDDEN.values()):
        takes[graph.kinds[graph.triples[:, given]], relation, side] = True
        k, triple = (graph.triples[:, given] == picked.entity[:, None]).nonzero(as_tuple=True)
        truth[k, relation[triple], side, graph.triples[triple, hidden]] = code[picked.model[k], triple]
    return Asked(picked, session.entities[picked.model], takes[graph.kinds[picked.entity]], truth)


def answers_of(embedding: Embedding, cells: Cells, queries: Asked, first: int) -> pd.DataFrame:
    """The first answers to each query and the true ones, in order (``tables.SINGLE_ANSWERS``); equal scores by id."""
    novel, picked = cells.novel_in(1), queries.picked
    scores = torch.stack([
        torch.stack([picked.of(embedding.score_tails(novel, relation)),
                     picked.of(embedding.score_heads(relation, novel))], 1)
        for relation in (torch.full_like(novel, number) for number in range(len(cells.graph.relations)))
    ], 1)  # fmt: skip
    barred = ~queries.candidates[:, None, None]
    order = scores.masked_fill(barred, -torch.inf).sort(dim=-1, descending=True, stable=True).indices
    rank = order.argsort(-1) + 1
    shown = queries.asked[..., None] & ~barred & ((rank <= first) | (queries.truth > 0))
    k, relation, side, place = shown.gather(-1, order).nonzero(as_tuple=True)
    answer = order[k, relation, side, place]
    return pd.DataFrame({
        "entity": picked.entity[k].cpu().numpy(), "relation": np.array(cells.graph.relations)[relation.cpu().numpy()],
        "hidden": np.array(list(HIDDEN))[side.cpu().numpy()], "answer": answer.cpu().numpy(),
        "rank": place.cpu().numpy() + 1,
        "true": np.array(TRUE, dtype=object)[queries.truth[k, relation, side, answer].cpu().numpy()],
    })  # fmt: skip
