"""The recipe by which an embedding of a user's graph is trained (Lacroix et al. 2018): ComplEx,
cross-entropy over all entities for both ends of each triple, N3, Adagrad.

Of two learning rates, the one with the better MRR of validation triples is taken.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from isi.evaluation.filtered import end_ranks
from isi.graph.graph import Graph
from isi.graph.sessions import TRAIN, VALID
from isi.models.bilinear import ComplEx
from isi.models.stack import Embedding, NotFinite, uniform
from isi.random import stream
from isi.training.rows import Facts, Recipe, Tables, Task, fit

MODEL, MODEL_NAME = ComplEx(), "complex"
RATES = (0.1, 0.3)  #: Learning rates that are compared.
N3, INIT_RANGE = 0.05, 0.1
#: Steps of an epoch, unless a batch would have more triples than this.
STEPS, LARGEST_BATCH = 5, 1024
#: Epochs; of a graph with many triples fewer, so that no training sees more than ``MOST_SEEN``.
EPOCHS, FEWEST_EPOCHS, MOST_SEEN = 50, 10, 2**22
#: Largest number of entities for which cross-entropy is over all of them; of more, so many wrong
#: answers are drawn for each step.
MOST_ENTITIES, SAMPLED = 2**12, 512


def recipe_for(graph: Graph, rate: float) -> Recipe:
    """Loss, batches and regularization for a graph of some size."""
    return Recipe(
        loss="softmax",
        batch_size=min(LARGEST_BATCH, max(1, len(graph.triples) // STEPS)),
        learning_rate=rate,
        negatives=None if len(graph.entities) <= MOST_ENTITIES else SAMPLED,
        n3=N3,
    )


def epochs_for(graph: Graph) -> int:
    """The number of epochs for a graph of some size."""
    return max(FEWEST_EPOCHS, min(EPOCHS, MOST_SEEN // len(graph.triples)))


def train_on(graph: Graph, triples: Tensor, rate: float, dimension: int, seed: int) -> Embedding:
    """An embedding of a graph that is trained on the triples in a mask, (T,); ``NotFinite`` if that
    diverges.
    """
    known, key = torch.ones(1, len(graph.entities), dtype=torch.bool), torch.zeros(1, 1).long()
    start = uniform(known, len(graph.relations), MODEL, dimension, INIT_RANGE, seed, key)
    entity, relation = start.entity[0].requires_grad_(), start.relation[0].requires_grad_()
    tables = Tables(entity.detach()[:0], entity, relation.detach()[:0], relation)
    chosen = graph.triples[triples]
    task = Task(Facts(chosen, torch.ones(len(chosen))), tails_only=False)
    fit(MODEL, tables, task, recipe_for(graph, rate), epochs_for(graph), stream(seed, "training"))
    return Embedding(entity.detach()[None], relation.detach()[None], MODEL)


def better_rate(graph: Graph, splits: np.ndarray, dimension: int, seed: int) -> float:
    """The learning rate of ``RATES`` with the better MRR of validation triples of splits, (T,); the
    first without such triples.
    """
    valid, of_rate = torch.from_numpy(np.flatnonzero(splits == VALID)), dict[float, float]()
    if not len(valid):
        return RATES[0]
    for rate in RATES:
        try:
            theta = train_on(graph, torch.from_numpy(splits == TRAIN), rate, dimension, seed)
        except NotFinite:
            continue
        of_rate[rate] = (1 / end_ranks(theta, graph, valid)).mean().item()
    return max(of_rate, key=of_rate.__getitem__, default=RATES[0])
