"""The recipe by which an embedding of a user's graph is trained (Lacroix et al. 2018): ComplEx,
cross-entropy over all entities for both ends of each triple, N3, Adagrad.

Of two learning rates, the one with the better MRR of validation triples is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from isi.errors import InputError, at
from isi.evaluation.filtered import end_ranks
from isi.graph.graph import Graph
from isi.graph.sessions import TEST, TRAIN, VALID
from isi.models.bilinear import ComplEx
from isi.models.stack import Embedding, NotFinite, uniform
from isi.random import stream
from isi.training.held_out import groups_of, held_out, held_out_measures, repeated_relations
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


@dataclass(frozen=True)
class TrainingSummary:
    """How an embedding was trained, and filtered MRRs of test triples, which another one of the
    same recipe was not trained on.

    The embedding itself is trained on all triples. MRRs are None if no triple can leave training.
    """

    entities: int
    relations: int
    triples: int
    observations: int
    dimension: int
    learning_rate: float
    epochs: int
    batch_size: int
    repeated: list[list[str]]  #: relations that repeat each other; one alone is symmetric
    test_triples: int  #: head and tail of each are queried
    mrr: float | None
    #: of candidates ranked by their number of training triples in the slot of the relation
    frequency: float | None
    chance: float | None  #: expectation of random ranks
    warning: str | None  #: a sentence

    def __str__(self) -> str:
        text = (
            f"{self.triples:,} triples ({self.observations:,} observations) of {self.entities:,}"
            f" entities and {self.relations:,} relations; learning rate {self.learning_rate:g},"
            f" {self.epochs} epochs in batches of {self.batch_size:,}."
        )
        if self.repeated:
            named = ", ".join(" and ".join(map(repr, names)) for names in self.repeated)
            text += (
                f"\nTriples of symmetric, inverse or equal relations ({named}) are "
                "split together with those that they repeat."
            )
        if self.mrr is not None:
            text += (
                f"\nMRR of {self.test_triples:,} test triples: {self.mrr:.3f}; of answers by "
                f"frequency {self.frequency:.3f}, at random {self.chance:.3f}. In the end, all "
                "triples were trained on."
            )
        return text + f"\nWarning: {self.warning}." * bool(self.warning)


@dataclass(frozen=True, eq=False)
class Trained:
    """An embedding of a graph, and one that has not seen the test triples."""

    graph: Graph
    theta: Embedding
    tested: Embedding
    splits: np.ndarray  #: of triples; shape: (T,), int8
    groups: np.ndarray  #: of triples that repeat each other (``groups_of``); shape: (T,)
    seed: int
    summary: TrainingSummary

    def on(self, triples: np.ndarray) -> Embedding:
        """An embedding that is trained as this one, on the triples in a mask, (T,)."""
        rate, dimension = self.summary.learning_rate, self.summary.dimension
        return train_on(self.graph, torch.from_numpy(triples), rate, dimension, self.seed)


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


def train_graph(graph: Graph, rate: float | None, dimension: int, seed: int) -> Trained:
    """Train an embedding of a graph, and measure it; ``rate`` None: the better one of ``RATES``.
    ``InputError`` for an impossible dimension, or if training diverges.
    """
    with at("argument 'dimension'"):
        MODEL.width(dimension)
    repeated = repeated_relations(graph)
    groups = groups_of(graph, repeated)
    splits = held_out(graph, groups, seed)
    rate = rate or better_rate(graph, splits, dimension, seed)
    masks = torch.from_numpy(np.stack([splits != TEST, splits >= TRAIN]))
    try:
        tested, theta = (train_on(graph, mask, rate, dimension, seed) for mask in masks)
    except NotFinite as error:
        lower = f"{error.message}: lower the learning rate"
        raise InputError("argument 'learning_rate'", "", lower) from error
    summary = TrainingSummary(
        entities=len(graph.entities),
        relations=len(graph.relations),
        triples=len(graph.triples),
        observations=int(graph.counts.sum()),
        dimension=dimension,
        learning_rate=rate,
        epochs=epochs_for(graph),
        batch_size=recipe_for(graph, rate).batch_size,
        repeated=[[graph.relations[relation] for relation in together] for together in repeated],
        **held_out_measures(graph, groups, splits, tested),
    )
    return Trained(graph, theta, tested, splits, groups, seed, summary)
