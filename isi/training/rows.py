"""Training of the new rows of one embedding, with gradients of autograd.

The facts of a task are the answers to queries, (h, r, ?) and (?, r, t), or to the first alone.
The objective is in docs/initializers.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import softplus

from isi.graph.graph import HEAD, RELATION, TAIL
from isi.models.losses import Loss, TrainingLoss
from isi.models.model import Model
from isi.models.stack import check_finite

#: Maximum number of earlier facts in a step, to which new entities are wrong answers; and of scores
#: of new entities as their answers.
EARLIER, EARLIER_SCORES = 2**10, 2**18
#: The earlier facts from which these are drawn are at even distances: so many for each new entity,
#: within these limits.
FOR_EACH, FEWEST_EARLIER, MOST_EARLIER = 2**8, 2**11, 2**13
TINY = 1e-10  #: What Adagrad adds to a divisor.
BUDGET = 2**24  #: Maximum number of scores in a table without gradient.
SMALL = 2**18  #: Maximum number of coordinates that stay in a processor's cache.

#: A term of the loss of a step, from the rows.
Penalty = Callable[["Tables"], Tensor]


@dataclass(frozen=True)
class Recipe:
    """How an embedding is trained: loss, batches, learning rate and regularization."""

    loss: Loss
    batch_size: int  #: facts
    learning_rate: float  #: of Adagrad
    #: of each fact; None, with ``softmax`` alone: all entities
    negatives: int | None = None
    #: ``TrainingLoss.margin`` and ``.temperature``
    margin: float = 0.0
    temperature: float = 1.0
    n3: float = 0.0  #: weight of the sum of the cubes of a fact's coordinates (``cubes``)

    @property
    def training_loss(self) -> TrainingLoss:
        return TrainingLoss(self.loss, self.margin, self.temperature)


@dataclass(frozen=True)
class Facts:
    """Triples to be trained on, each with a weight."""

    triples: Tensor  #: ids, (T, 3)
    weight: Tensor  #: shape: (T,)


@dataclass(frozen=True)
class Earlier:
    """The part of new entities in earlier facts: to each of them they are wrong answers."""

    triples: Tensor  #: ids, (K, 3)
    share: float = 1.0  #: β: weight of this part


@dataclass(frozen=True)
class Task:
    """One training: on which facts, with which other terms of the loss."""

    facts: Facts
    earlier: Earlier | None = None
    penalty: Penalty | None = None
    #: whether facts ask for tails alone, as with inverse relations
    tails_only: bool = True


def fit(
    model: Model,
    tables: Tables,
    task: Task,
    recipe: Recipe,
    epochs: int,
    rng: np.random.Generator,
) -> None:
    """Train the new rows of ``tables``, in place, for some epochs of a task, by Adagrad;
    ``NotFinite`` if that diverges.
    """
    # that of torch.optim takes two seconds to import
    squares = [torch.zeros_like(table) for table in tables.trained]
    loss = Objective(model, tables, task, recipe)
    for epoch in range(1, epochs + 1):
        for place in loss.batches(rng):
            slopes = torch.autograd.grad(loss.of(place, rng), tables.trained)
            with torch.no_grad():
                for table, slope, total in zip(tables.trained, slopes, squares, strict=True):
                    total.addcmul_(slope, slope)
                    table.addcdiv_(slope, total.sqrt() + TINY, value=-recipe.learning_rate)
            tables.constrain(model)
        check_finite(tuple(table[None] for table in tables.trained), f"vectors after epoch {epoch}")


@dataclass(frozen=True)
class Tables:
    """The rows of entities and relations: known ones, then those that are trained."""

    fixed_entity: Tensor
    entity: Tensor
    fixed_relation: Tensor
    relation: Tensor

    @property
    def trained(self) -> list[Tensor]:
        return [table for table in (self.entity, self.relation) if len(table)]

    @property
    def entities(self) -> int:
        """Number of entities, fixed or not."""
        return len(self.fixed_entity) + len(self.entity)

    def entity_rows(self, ids: Tensor) -> Tensor:
        """Vectors of entities, (..., d)."""
        return _rows(self.fixed_entity, self.entity, ids)

    def relation_rows(self, ids: Tensor) -> Tensor:
        """Rows of relations, (..., w)."""
        return _rows(self.fixed_relation, self.relation, ids)

    @torch.no_grad()
    def constrain(self, model: Model) -> None:
        """Put the trained entities under the constraint of the model."""
        if not model.is_free:
            self.entity.copy_(model.constrain(self.entity))


def cubes(model: Model, rows: Tensor) -> Tensor:
    """N3 (Lacroix et al. 2018): the sum of the cubes of the absolute coordinates of rows, (..., d),
    which may be complex numbers; shape (...).

    Example:
        >>> import torch
        >>> from isi.models.bilinear import ComplEx
        >>> cubes(ComplEx(), torch.tensor([3.0, 0.0, 4.0, 1.0]))  # of 3 + 4i and i
        tensor(126.)
    """
    squares = rows.square()
    if model.complex_vectors:
        real, imaginary = squares.chunk(2, -1)
        squares = real + imaginary
    return squares.pow(1.5).sum(-1)


def _rows(fixed: Tensor, moving: Tensor, ids: Tensor) -> Tensor:
    """Rows of two tables, one below the other."""
    if not len(moving):
        return fixed[ids]
    if not len(fixed):
        return moving[ids]
    moves = ids >= len(fixed)
    still = fixed[ids.masked_fill(moves, 0)]
    return torch.where(moves[..., None], moving[(ids - len(fixed)).clamp(min=0)], still)


class Objective:
    """The loss of a task, as a function of the rows of ``tables``."""

    def __init__(self, model: Model, tables: Tables, task: Task, recipe: Recipe) -> None:
        self.model, self.tables, self.task, self.recipe = model, tables, task, recipe
        self.loss = recipe.training_loss
        self.negatives = recipe.negatives or 0
        #: the slots of answers that facts ask for
        self.slots = (TAIL,) if task.tails_only else (TAIL, HEAD)
        #: by slot, log Σ exp(score) of the fixed answers to the query of each fact, (T,)
        self.fixed: dict[int, Tensor] = {}
        if self.is_exact and len(tables.fixed_entity):
            self.fixed = {slot: self._of_fixed(slot) for slot in self.slots}
        earlier = task.earlier or Earlier(task.facts.triples[:0])
        self.share = earlier.share / task.facts.weight.sum().item()
        self.known: dict[int, KnownQueries] = {}
        if earlier.share and len(earlier.triples) and len(tables.entity):
            for slot in self.slots:
                self.known[slot] = known_queries(model, tables, earlier.triples, slot, recipe)

    @property
    def is_exact(self) -> bool:
        """Whether all entities are candidates."""
        return self.recipe.loss == "softmax" and not self.negatives

    def batches(self, rng: np.random.Generator) -> Iterator[Tensor]:
        """Places of facts in batches, in random order."""
        order = torch.from_numpy(rng.permutation(len(self.task.facts.triples)))
        yield from torch.split(order, self.recipe.batch_size)

    def of(self, place: Tensor, rng: np.random.Generator) -> Tensor:
        """The mean loss of some facts, at places (B,), with all other terms."""
        task, tables = self.task, self.tables
        triples, weight = task.facts.triples[place], task.facts.weight[place]
        relation = tables.relation_rows(triples[:, RELATION])
        ends = {
            HEAD: tables.entity_rows(triples[:, HEAD]),
            TAIL: tables.entity_rows(triples[:, TAIL]),
        }
        right = self.model.score(ends[HEAD], relation, ends[TAIL])
        losses = torch.zeros_like(right)
        for slot in self.slots:
            if self.is_exact:
                losses = losses + self._log_z(slot, place, triples) - right
            else:
                end, answer = ends[HEAD + TAIL - slot], triples[:, slot]
                losses = losses + self._sampled(slot, end, relation, answer, right, rng)
        if self.recipe.n3:
            for rows in (ends[HEAD], relation, ends[TAIL]):
                losses = losses + self.recipe.n3 * cubes(self.model, rows)
        loss = (weight * losses).sum() / weight.sum()
        for slot, known in self.known.items():
            loss = loss + self.share * known.number * self._of_known(slot, known, rng)
        if task.penalty is not None:
            loss = loss + task.penalty(tables)
        return loss

    def _scores(self, slot: int, end: Tensor, relation: Tensor, entities: Tensor) -> Tensor:
        """Scores of entities, (C, d), as answers in a slot, by rows of the other ends, (B, d), and
        relations, (B, w); shape (B, C).
        """
        score = self.model.score_tails if slot == TAIL else self.model.score_heads
        return score(end[None], relation[None], entities[None])[0]

    def _queries(self, slot: int, triples: Tensor) -> Tensor:
        """A number for each query of some triples, (B,)."""
        return triples[:, RELATION] * self.tables.entities + triples[:, HEAD + TAIL - slot]

    @torch.no_grad()
    def _of_fixed(self, slot: int) -> Tensor:
        """For each fact whose query has no moving row, log Σ exp(score) over the fixed answers;
        NaN for others; shape (T,).
        """
        tables, triples = self.tables, self.task.facts.triples
        end, relation = triples[:, HEAD + TAIL - slot], triples[:, RELATION]
        is_fixed = (end < len(tables.fixed_entity)) & (relation < len(tables.fixed_relation))
        result = torch.full((len(triples),), torch.nan)
        chosen = triples[is_fixed]
        queries, inverse = torch.unique(self._queries(slot, chosen), return_inverse=True)
        end, relation = queries % tables.entities, queries // tables.entities
        log_z = [torch.zeros(0)]
        size = max(1, BUDGET // len(tables.fixed_entity))
        for part in torch.split(torch.arange(len(queries)), size) if len(queries) else ():
            rows = tables.entity_rows(end[part]), tables.relation_rows(relation[part])
            log_z.append(self._scores(slot, *rows, tables.fixed_entity).logsumexp(1))
        result[is_fixed] = torch.cat(log_z)[inverse]
        return result

    def _log_z(self, slot: int, place: Tensor, triples: Tensor) -> Tensor:
        """log Z of the queries of some facts, each query computed once; shape (B,)."""
        tables = self.tables
        queries, inverse = torch.unique(self._queries(slot, triples), return_inverse=True)
        end = tables.entity_rows(queries % tables.entities)
        relation = tables.relation_rows(queries // tables.entities)
        parts = []
        if len(tables.entity):
            parts.append(self._scores(slot, end, relation, tables.entity).logsumexp(1))
        if slot in self.fixed:
            of_query = torch.zeros(len(queries)).index_copy(0, inverse, self.fixed[slot][place])
            moves = of_query.isnan()
            again = self._scores(slot, end[moves], relation[moves], tables.fixed_entity)
            parts.append(of_query.masked_scatter(moves, again.logsumexp(1)))
        return torch.stack(parts).logsumexp(0)[inverse]

    def _sampled(
        self,
        slot: int,
        end: Tensor,
        relation: Tensor,
        answer: Tensor,
        right: Tensor,
        rng: np.random.Generator,
    ) -> Tensor:
        """Losses of queries, (B,), by drawn wrong answers, which stand for all entities."""
        tables = self.tables
        drawn = torch.from_numpy(rng.integers(tables.entities, size=self.negatives))
        wrong = tables.entity_rows(drawn)
        scores = self._scores(slot, end, relation, wrong)
        scores = scores.masked_fill(drawn == answer[:, None], -torch.inf)
        if self.recipe.loss == "softmax":
            each = scores + float(np.log(tables.entities / len(drawn)))
            return softplus(each.logsumexp(1) - right)
        return self.loss.of_right(right) + self.loss.of_wrong(right, scores).sum(1)

    def _of_known(self, slot: int, known: KnownQueries, rng: np.random.Generator) -> Tensor:
        """The mean loss of new entities as wrong answers to earlier facts, some of which are
        drawn.
        """
        tables = self.tables
        drawn = known.draw(rng, EARLIER_SCORES // len(tables.entity))
        end = tables.fixed_entity[known.end[drawn]]
        relation = tables.fixed_relation[known.relation[drawn]]
        new = self._scores(slot, end, relation, tables.entity)
        right = known.right[drawn]
        if self.recipe.loss == "softmax":
            return softplus(new.logsumexp(1) - right).mean()
        others = torch.from_numpy(rng.integers(tables.entities, size=self.negatives - 1))
        with torch.no_grad():
            rows = tables.entity_rows(others)
            beside = self._scores(slot, end, relation, rows)
        losses = self.loss.of_wrong(right, new, beside).sum(1)
        return losses.mean() * self.negatives / tables.entities


@dataclass(frozen=True)
class KnownQueries:
    """Queries of earlier facts, which new entities should not answer."""

    end: Tensor  #: ids of the ends that are no answers; shape: (K,)
    relation: Tensor  #: ids; shape: (K,)
    #: with cross-entropy, log Σ exp(score) over the known answers, which have nearly all of Z after
    #: training; else the score of the fact; shape: (K,)
    right: Tensor
    total: Tensor  #: sums of the numbers of facts, up to each query; shape: (K,), float64
    number: int  #: of earlier facts

    def draw(self, rng: np.random.Generator, most: int) -> Tensor:
        """Places of at most ``most`` or ``EARLIER`` random queries, in proportion to their numbers
        of facts.
        """
        size = max(1, min(EARLIER, most, len(self.end)))
        at = torch.from_numpy(rng.random(size)) * self.total[-1]
        return torch.searchsorted(self.total, at, right=True).clamp(max=len(self.end) - 1)


@torch.no_grad()
def known_queries(
    model: Model, tables: Tables, triples: Tensor, slot: int, recipe: Recipe
) -> KnownQueries:
    """The queries that hide a slot of triples, (K, 3), of fixed rows; of many, a sample."""
    most = min(max(FOR_EACH * len(tables.entity), FEWEST_EARLIER), MOST_EARLIER)
    step = -(-len(triples) // most)
    chosen, end_slot = triples[::step], HEAD + TAIL - slot
    if recipe.loss != "softmax":
        total = torch.arange(1, len(chosen) + 1, dtype=torch.float64)
        scores = _scores_of(model, tables, chosen)
        return KnownQueries(chosen[:, end_slot], chosen[:, RELATION], scores, total, len(triples))
    entities = tables.entities
    queries, count = torch.unique(
        chosen[:, RELATION] * entities + chosen[:, end_slot], return_counts=True
    )
    key = triples[:, RELATION] * entities + triples[:, end_slot]
    is_answer = torch.from_numpy(np.isin(key.numpy(), queries.numpy()))
    place = torch.searchsorted(queries, key[is_answer])
    scores = _scores_of(model, tables, triples[is_answer])
    highest = torch.full((len(queries),), -torch.inf).scatter_reduce(0, place, scores, "amax")
    rest = torch.zeros(len(queries)).index_add(0, place, (scores - highest[place]).exp())
    total, log_z = count.double().cumsum(0), highest + rest.log()
    return KnownQueries(queries % entities, queries // entities, log_z, total, len(triples))


def _scores_of(model: Model, tables: Tables, triples: Tensor) -> Tensor:
    """Scores of triples, (N, 3), of fixed rows; shape (N,)."""
    scores = [torch.zeros(0)]
    for part in torch.split(triples, max(1, SMALL // tables.entity.shape[1])):
        head, relation, tail = part.T
        entity, relations = tables.fixed_entity, tables.fixed_relation
        scores.append(model.score(entity[head], relations[relation], entity[tail]))
    return torch.cat(scores)
