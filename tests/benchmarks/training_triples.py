"""Training triples as ours and as TorchKGE's, for benchmarks that compare them."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torchkge.data_structures import KnowledgeGraph

from isi.graph.graph import Graph
from isi.graph.sessions import split
from isi.params import Params


def splits(home: Graph, params: Params, models: int) -> Tensor:
    """What each model trains on; shape (M, T)."""
    drawn = (split(home, params.seed, seed, params.sessions.valid, params.sessions.test) for seed in range(models))
    return torch.from_numpy(np.stack(list(drawn)))


def as_torchkge(home: Graph, observations: Tensor) -> KnowledgeGraph:
    """Observations, of shape (N, 3), as TorchKGE takes them."""
    heads, relations, tails = observations.T
    names = {name: number for number, name in enumerate(home.entities)}
    kinds = {name: number for number, name in enumerate(home.relations)}
    return KnowledgeGraph(kg={"heads": heads, "tails": tails, "relations": relations}, ent2ix=names, rel2ix=kinds)
