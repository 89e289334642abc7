"""Training by batches of triples with gradients of autograd: cross-entropy over all entities, or
a margin between triples and corrupted ones.

It is for graphs that ``isi.training`` is not made for: thousands of entities, one embedding at a
time. Embeddings are in the unpacked form, in which a query (h, r, ?) asks for tails alone
(``isi.insertion.inverses``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
import torch
from pydantic import Field
from torch import Tensor
from torch.nn.functional import cross_entropy, embedding, normalize, relu, softplus
from torch.optim import Adagrad

from isi.config import Count, NotNegative, Positive, Section
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.initializers.scale import QueryList
from isi.models.bilinear import BlockModel
from isi.models.model import Model
from isi.models.stack import Embedding, check_finite, usual_torch
from isi.random import stream

#: Number of known queries in a step, to which new entities are wrong answers.
KNOWN_QUERIES = 4096
TINY = 1e-12  #: Smallest modulus whose gradient is computed.

#: A term of the loss of a step, from the tables of entities and relations.
Penalty = Callable[[Tensor, Tensor], Tensor]


class Recipe(Section):
    """How an embedding is trained: loss, batches, learning rate and regularization."""

    rules = (
        (
            lambda recipe: recipe.loss == "softmax" or recipe.negatives is not None,
            "expected a number of negatives with the loss margin",
        ),
    )
    loss: Literal["softmax", "margin"]
    batch_size: Count  #: queries (h, r, ?) with their answers; each triple makes two
    learning_rate: Positive  #: of Adagrad
    #: weight of the sum of cubed moduli of the vectors of a query, per query (N3, Lacroix et al.
    #: 2018)
    n3: NotNegative = 0.0
    #: of each query; null: all entities, which ``margin`` does not allow
    negatives: Count | None = None
    margin: Annotated[float, Field(ge=0)] = 0.0  #: between the scores of right and wrong answers
    unit_length: bool = False  #: whether all vectors are divided by their length (LKGE's TransE)


@dataclass(frozen=True)
class Facts:
    """Triples to be trained on, in the unpacked form, each with a weight."""

    triples: Tensor  #: ids, (T, 3)
    weight: Tensor  #: shape: (T,)


@dataclass(frozen=True)
class Moving:
    """Which rows are trained: those from these ids on. By default all."""

    entity: int = 0
    relation: int = 0


@dataclass(frozen=True)
class Earlier:
    """The part of new entities in earlier facts: to each known query they are wrong answers.

    The loss of a query is softplus(log Σ exp(f) over new entities - log Z), with its log Z among
    the known ones, times the number of its answers.
    """

    queries: QueryList  #: all of them ask for tails
    number: float  #: of earlier facts


@dataclass(frozen=True)
class Task:
    """One training: on which facts, of which rows, with which other terms of the loss."""

    facts: Facts
    moving: Moving = field(default_factory=Moving)
    earlier: Earlier | None = None
    penalty: Penalty | None = None


#: Called after each epoch, with its number.
OnEpoch = Callable[[int], None]


def silent(epoch: int) -> None:
    """Report nothing."""


@usual_torch()
def fit(
    theta: Embedding,
    task: Task,
    recipe: Recipe,
    epochs: int,
    root: int,
    key: tuple[int, ...] = (),
    on_epoch: OnEpoch = silent,
) -> Embedding:
    """Train one embedding, (1, E, d), in the unpacked form, for some epochs of a task.

    Args:
        root, key: of the random streams of the order of facts and of negatives.

    Returns:
        the trained embedding; rows that do not move are the same numbers; without
        facts none moves.

    Raises:
        NotFinite: training diverged.
    """
    tables = Tables.of(theta, task.moving)
    if not tables.trained or not len(task.facts.triples):
        return theta
    optimizer = Adagrad(tables.trained, lr=recipe.learning_rate)
    rng = stream(root, "training by queries", *key)
    for epoch in range(1, epochs + 1):
        for place in _batches(len(task.facts.triples), recipe.batch_size, rng):
            optimizer.zero_grad()
            loss = loss_of(theta.model, tables, task, recipe, place, rng)
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
        check_finite(tuple(table[None] for table in tables.trained), f"vectors after epoch {epoch}")
        on_epoch(epoch)
    return tables.embedding(theta, recipe)


@dataclass(frozen=True)
class Tables:
    """The rows of entities and relations: fixed ones, then those that are trained."""

    fixed_entity: Tensor
    entity: Tensor
    fixed_relation: Tensor
    relation: Tensor

    @classmethod
    def of(cls, theta: Embedding, moving: Moving) -> Tables:
        entity, relation = theta.entity[0], theta.relation[0]
        return cls(
            entity[: moving.entity],
            entity[moving.entity :].clone().requires_grad_(),
            relation[: moving.relation],
            relation[moving.relation :].clone().requires_grad_(),
        )

    @property
    def trained(self) -> list[Tensor]:
        return [table for table in (self.entity, self.relation) if len(table)]

    def all_entities(self, recipe: Recipe) -> Tensor:
        """The vectors of all entities, (E, d)."""
        return _scaled(_joined(self.fixed_entity, self.entity), recipe)

    def all_relations(self, recipe: Recipe) -> Tensor:
        """The vectors of all relations, (R, w)."""
        return _scaled(_joined(self.fixed_relation, self.relation), recipe)

    def entities(self, ids: Tensor, recipe: Recipe) -> Tensor:
        """The vectors of entities, (..., d); where all rows are trained, the gradient has these
        rows alone.
        """
        if len(self.fixed_entity):
            return self.all_entities(recipe)[ids]
        return _scaled(embedding(ids, self.entity, sparse=True), recipe)

    def embedding(self, theta: Embedding, recipe: Recipe) -> Embedding:
        with torch.no_grad():
            # without fixed rows, they may be the trained tables themselves
            entity = self.all_entities(recipe).detach()
            relation = self.all_relations(recipe).detach()
        return replace(theta, entity=entity[None], relation=relation[None])


def loss_of(
    model: Model,
    tables: Tables,
    task: Task,
    recipe: Recipe,
    place: Tensor,
    rng: np.random.Generator,
) -> Tensor:
    """The mean loss of some facts, at places (B,), with all other terms."""
    triples, weight = task.facts.triples[place], task.facts.weight[place]
    relations = tables.all_relations(recipe)
    relation = relations[triples[:, RELATION]]
    if recipe.negatives is None:
        entities = tables.all_entities(recipe)
        head, tail = entities[triples[:, HEAD]], entities[triples[:, TAIL]]
        scores = model.score_tails(head[None], relation[None], entities[None])[0]
        losses = cross_entropy(scores, triples[:, TAIL], reduction="none")
    else:
        head, tail = (tables.entities(triples[:, slot], recipe) for slot in (HEAD, TAIL))
        number = len(tables.fixed_entity) + len(tables.entity)
        drawn = torch.from_numpy(rng.integers(number, size=recipe.negatives))
        wrong = tables.entities(drawn, recipe)
        right = model.score(head, relation, tail)
        scores = model.score_tails(head[None], relation[None], wrong[None])[0]
        scores = scores.masked_fill(drawn == triples[:, TAIL, None], -torch.inf)
        losses = _sampled(right, scores, number, recipe)
    loss = (weight * losses).sum() / weight.sum()
    if recipe.n3:
        cubes = sum(cubed(model, vectors) for vectors in (head, relation, tail))
        loss = loss + recipe.n3 * cubes / len(place)
    if task.earlier is not None:
        part = _of_earlier(model, tables, task.earlier, recipe, rng)
        loss = loss + part * (task.earlier.number / task.facts.weight.sum())
    if task.penalty is not None:
        loss = loss + task.penalty(tables.all_entities(recipe), relations)
    return loss


def cubed(model: Model, vectors: Tensor) -> Tensor:
    """Σ |x|³ over coordinates of vectors, (..., d), with the modulus of a complex coordinate."""
    if not isinstance(model, BlockModel):
        return vectors.abs().pow(3).sum()
    scalars, first, second = model.parts(vectors)
    square = (first.square() + second.square()).clamp(min=TINY)
    return scalars.abs().pow(3).sum() + square.pow(1.5).sum()


def _sampled(right: Tensor, wrong: Tensor, number: int, recipe: Recipe) -> Tensor:
    """Loss of queries, (B,), by scores of right, (B,), and of drawn wrong answers, (B, N), which
    stand for all ``number`` entities.
    """
    if recipe.loss == "margin":
        return relu(recipe.margin + wrong - right[:, None]).mean(1)
    each = wrong + float(np.log(number / wrong.shape[1]))
    return softplus(each.logsumexp(1) - right)


def _of_earlier(
    model: Model, tables: Tables, earlier: Earlier, recipe: Recipe, rng: np.random.Generator
) -> Tensor:
    """The mean loss of new entities as wrong answers to earlier facts, some of which are drawn."""
    queries = earlier.queries
    count = queries.answers[0]
    chance = (count / count.sum()).numpy()
    drawn = torch.from_numpy(rng.choice(len(chance), min(KNOWN_QUERIES, len(chance)), p=chance))
    head = tables.all_entities(recipe)[queries.given[drawn]]
    relation = tables.all_relations(recipe)[queries.relation[drawn]]
    new = tables.entity[None]
    scores = model.score_tails(head[None], relation[None], new)[0].logsumexp(1)
    return softplus(scores - queries.log_z[0, drawn].float()).mean()


def _batches(number: int, size: int, rng: np.random.Generator) -> Iterator[Tensor]:
    """Places of facts in batches, in random order."""
    order = torch.from_numpy(rng.permutation(number))
    yield from torch.split(order, size)


def _joined(fixed: Tensor, trained: Tensor) -> Tensor:
    return torch.cat([fixed, trained]) if len(fixed) else trained


def _scaled(vectors: Tensor, recipe: Recipe) -> Tensor:
    return normalize(vectors, dim=-1) if recipe.unit_length else vectors
