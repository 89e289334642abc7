"""Training of the rows of new entities, while all other rows are frozen, with the model's loss."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import softplus

from isi.evaluation.filtered import end_ranks
from isi.graph.graph import HEAD, TAIL, Graph
from isi.initializers.evidence import share_known
from isi.initializers.scale import KnownQueries, Scale, parts_of_sides
from isi.insertion.engine import trained_session
from isi.insertion.inverses import InverseRelations, both_ways, unpack
from isi.models.model import Model
from isi.models.scoring import Backward, Triples
from isi.models.stack import Embedding, check_finite
from isi.random import stream
from isi.training.batches import Negatives, training_data
from isi.training.trainer import ACCUMULATOR, Optimizer, Watch, never_stop, train

BUDGET = 2**24  #: Maximum number of scores in one table.
FEWEST = 3  #: Number of facts from which one is held out.
LOOKS = 20  #: Number of times that held-out facts are ranked, at even distances.
PATIENCE = 4  #: Number of looks without gain after which training stops.


@dataclass(frozen=True, eq=False)
class LogOdds(Model):
    """A model ``base`` whose scores are log odds: slope · score + offset."""

    base: Model
    slope: float
    offset: float

    @property
    def is_free(self) -> bool:
        return self.base.is_free

    def constrain(self, vectors: Tensor) -> Tensor:
        return self.base.constrain(vectors)

    def width(self, dimension: int) -> int:
        return self.base.width(dimension)

    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        return self.slope * self.base.score(head, relation, tail) + self.offset

    def scores(self, entity: Tensor, relation: Tensor, triples: Triples) -> tuple[Tensor, Backward]:
        scores, by_score = self.base.scores(entity, relation, triples)

        def backward(slope: Tensor) -> tuple[Tensor, Tensor]:
            return by_score(self.slope * slope)

        return self.slope * scores + self.offset, backward

    def transform(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return self.base.transform(vectors, relation)

    def inverse(self, vectors: Tensor, relation: Tensor) -> Tensor:
        return self.base.inverse(vectors, relation)


@dataclass(frozen=True, eq=False)
class NewRows:
    """The rows of new entities, the last ones of an embedding, and all that trains them."""

    theta: Embedding  #: a stack of one
    known: int  #: number of known entities
    known_triples: np.ndarray  #: ids, (K, 3)
    scale: Scale
    optimizer: Optimizer
    negatives: Negatives
    seed: int
    queries: KnownQueries | None  #: of the known triples, with a scale ``by_query``

    def fit(self, triples: np.ndarray, epochs: int, watch: Watch = never_stop) -> Embedding:
        """The embedding after so many epochs of ``triples``, (T, 3), each with a new entity."""
        if self.queries is None:
            return self.fit_all(triples, epochs, 0, watch)
        loss = CrossEntropy.of(self, self._unpacked(triples), self.queries)
        fitted = self._by_gradients(loss, epochs, watch)
        return replace(self.theta, entity=fitted.entity)

    def fit_all(
        self, triples: np.ndarray, epochs: int, all_epochs: int, watch: Watch = never_stop
    ) -> Embedding:
        """As ``fit``, by logistic loss of log odds and corrupted triples; then all rows are trained
        for ``all_epochs``.
        """
        theta, scale = unpack(self.theta), self.scale
        if (scale.slope, scale.offset) != (1.0, 0.0):
            theta = replace(theta, model=LogOdds(theta.model, scale.slope, scale.offset))
        every = self._unpacked(np.concatenate([triples, self.known_triples]))
        session, entities = trained_session(every, theta), theta.entity.shape[1]
        novel = torch.arange(self.known, entities)[None]
        keys = torch.tensor([[entities, entities - self.known]])
        data = training_data(session, "fine-tuning", keys, self.negatives.head_pool, novel)
        numbers = {"new_rows_first": epochs, "max_epochs": epochs + all_epochs}
        optimizer = self.optimizer.model_copy(update=numbers)
        trained = train(theta, data, self.negatives, optimizer, self.seed, watch)
        relation = trained.relation.reshape(self.theta.relation.shape)
        return Embedding(trained.entity, relation, self.theta.model)

    def _by_gradients(self, loss: CrossEntropy, epochs: int, watch: Watch) -> Embedding:
        """The unpacked embedding after so many epochs of Adagrad."""
        theta = unpack(replace(self.theta, entity=self.theta.entity.clone()))
        new, settings = theta.entity[:, self.known :], self.optimizer
        squares = torch.full_like(new, ACCUMULATOR)
        for epoch in range(epochs + 1):
            order = stream(self.seed, "fine-tuning by query", epoch).permutation(len(loss.triples))
            batches = np.array_split(order, -(-len(order) // settings.batch_size))
            for part in batches if epoch else ():
                step = loss.gradient(theta, part) / len(part) + settings.weight_decay * new
                squares.addcmul_(step, step)
                new.addcdiv_(step, squares.sqrt(), value=-settings.learning_rate)
                new.copy_(theta.model.constrain(new))
            check_finite((new,), f"vectors after epoch {epoch}")
            if not watch(epoch, theta, torch.zeros(1, dtype=torch.int64)).all():
                break
        return theta

    def _unpacked(self, triples: np.ndarray) -> np.ndarray:
        """Triples in the form of the unpacked embedding."""
        packed = isinstance(self.theta.model, InverseRelations)
        return both_ways(torch.from_numpy(triples)).numpy() if packed else triples


@dataclass(frozen=True, eq=False)
class CrossEntropy:
    """The part of new rows in cross-entropy over all entities (``isi.initializers.softmax``).

    A fact of a new entity is the answer to two queries, (h, r, ?) and (?, r, t), or to the first
    alone. To each known query, a new entity is a wrong answer.
    """

    known: int  #: number of known entities
    triples: Tensor  #: facts, (T, 3)
    queries: KnownQueries
    share: Tensor  #: how much of each new entity is known, s; shape: (n,), float32

    @classmethod
    def of(cls, new: NewRows, triples: np.ndarray, queries: KnownQueries) -> CrossEntropy:
        """The loss of facts, (T, 3)."""
        entities = new.theta.entity.shape[1]
        facts, trained = torch.from_numpy(triples), queries.trained.sum(-1)
        ends = facts[:, [HEAD, TAIL]]
        joining = ends[(ends < new.known).any(1)].amax(1)
        number = torch.bincount(joining, minlength=entities)[None, new.known :]
        share = share_known(number, trained, torch.tensor([new.known]))
        return cls(new.known, facts, queries, share[0].float())

    def gradient(self, theta: Embedding, part: np.ndarray) -> Tensor:
        """Of the loss of some facts, and of as large a part of the known queries; (1, n, d)."""
        known, new = theta.entity[:, : self.known], theta.entity[:, self.known :]
        new = new.detach().requires_grad_()
        gradient = torch.zeros_like(new)
        for facts in torch.split(self.triples[part], max(1, BUDGET // theta.entity.shape[1])):
            with torch.enable_grad():
                loss = self._of_facts(replace(theta, entity=torch.cat([known, new], 1)), facts)
            gradient += torch.autograd.grad(loss, new)[0]
        share = len(part) / len(self.triples)
        for places, is_tail in parts_of_sides(self.queries.unique.novel_is_tail[None], len(new[0])):
            with torch.enable_grad():
                loss = share * self._of_known(theta, new, places[0], is_tail)
            gradient += torch.autograd.grad(loss, new)[0]
        return gradient

    def _of_facts(self, theta: Embedding, facts: Tensor) -> Tensor:
        """Σ log Z - f over the queries of facts, (Q, 3)."""
        head, relation, tail = facts.T[:, None]
        loss = _cross_entropy(theta.score_tails(head, relation), tail)
        if not self.queries.tails_only:
            loss = loss + _cross_entropy(theta.score_heads(relation, tail), head)
        return loss

    def _of_known(self, theta: Embedding, new: Tensor, part: Tensor, is_tail: bool) -> Tensor:
        """Σ s · softplus(f - log Z) over the known answers of some queries, (P,), of one side, and
        new entities in their place.
        """
        unique, model = self.queries.unique, theta.model
        given, relation = (
            theta.entity[:, unique.given[part]],
            theta.relation[:, unique.relation[part]],
        )
        ends = given, relation, new
        scores = model.score_tails(*ends) if is_tail else model.score_heads(*ends)
        odds = scores[0] - unique.log_z[0, part, None].float()
        return unique.answers[0, part].float() @ softplus(odds) @ self.share


def _cross_entropy(scores: Tensor, answer: Tensor) -> Tensor:
    """Σ log Σ exp(f) - f of the answer; shapes (1, Q, E) and (1, Q)."""
    return (scores.logsumexp(-1) - scores.gather(-1, answer[..., None])[..., 0]).sum()


class HeldOut:
    """Ranks the ends of held-out facts now and then; ``best``: the epoch of highest MRR."""

    def __init__(self, theta: Embedding, graph: Graph, facts: Tensor, epochs: int) -> None:
        self.theta, self.graph, self.facts = theta, graph, facts
        self.every = max(1, epochs // LOOKS)
        self.best, self.highest, self.since_best = 0, -1.0, 0

    def __call__(self, epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        if epoch % self.every:
            return never_stop(epoch, embedding, models)
        theta = replace(self.theta, entity=embedding.entity)
        mrr = (1 / end_ranks(theta, self.graph, self.facts)).mean().item()
        self.since_best += 1
        if mrr > self.highest:
            self.best, self.highest, self.since_best = epoch, mrr, 0
        return torch.full((1,), self.since_best < PATIENCE)


def best_epochs(new: NewRows, triples: np.ndarray, epochs: int) -> int:
    """Number of epochs after which facts that are held out rank best; 0 if no new entity has
    ``FEWEST`` facts: training on one or two makes vectors worse (docs/insert_reference.md).
    """
    held_out = held_out_facts(triples, new.known, new.seed)
    if not held_out.any():
        return 0
    graph = trained_session(np.concatenate([triples, new.known_triples]), new.theta).graph
    watch = HeldOut(new.theta, graph, torch.from_numpy(np.flatnonzero(held_out)), epochs)
    new.fit(triples[~held_out], epochs, watch)
    return watch.best


def held_out_facts(triples: np.ndarray, known: int, seed: int) -> np.ndarray:
    """A mask, (T,), of one random triple with a known entity of each new entity (from the id
    ``known`` on) that has at least ``FEWEST``.
    """
    ends = triples[:, [HEAD, TAIL]]
    order = stream(seed, "held-out facts").permutation(len(triples))
    joining = order[(ends[order] < known).any(1)]
    _, first, number = np.unique(ends[joining].max(1), return_index=True, return_counts=True)
    held_out = np.zeros(len(triples), bool)
    held_out[joining[first[number >= FEWEST]]] = True
    return held_out
