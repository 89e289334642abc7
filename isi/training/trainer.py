"""Training a stack of models: Adagrad, the one loop over epochs, and who watches it.

The gradient of the loss of a batch, in either form, for whatever family.

A model that diverges or collapses is stopped before anything is measured of it, and said to be one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal, Protocol

import torch
from pydantic import Field
from torch import Tensor

from isi.config import Count, NotNegative, Positive, Section
from isi.evaluation.query_sets import validation
from isi.evaluation.ranking import Queries, Result, evaluate
from isi.models import bits
from isi.models.bits import apart
from isi.models.finite import NotFinite, check_finite
from isi.models.stack import Embedding, select
from isi.models.triples import DenseTriples
from isi.training import single_updates
from isi.training.batches import DenseBatch, ListBatch, Negatives, TrainingData, batches

#: What Adagrad's accumulators start at.
ACCUMULATOR = 1e-6


class Optimizer(Section):
    """How an embedding is trained."""

    batch_size: Count
    learning_rate: Positive
    weight_decay: NotNegative
    max_epochs: Count
    #: epochs in which the rows of novel entities alone move, before all do (the order of IncDE)
    new_rows_first: Annotated[int, Field(ge=0)] = 0


class Training(Optimizer):
    """How Θ⁰ and the joint model are trained, and when they stop."""

    new_rows_first: Literal[0] = 0  # all rows are new
    evaluate_every: Count
    patience: Count


@dataclass(frozen=True)
class State:
    """An embedding in training: its vectors and Adagrad's sums of squared gradients."""

    embedding: Embedding
    squares: Embedding


class Watch(Protocol):
    """Looks at a stack in training before the first epoch (0) and after each."""

    def __call__(self, epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        """Which of the models go on; shape (A,), bool.

        Args:
            embedding: of the models that are still in training.
            models: their places in the stack; shape (A,).
        """


def train(
    embedding: Embedding, data: TrainingData, negatives: Negatives, settings: Optimizer, root: int, watch: Watch
) -> Embedding:
    """Train each model for ``max_epochs``, or until the watch lets it go.

    A model that goes leaves the stack, which changes nothing for the others.

    Returns:
        each model as it was when it left.

    Raises:
        NotFinite: where a model diverges: NaN or infinity in its vectors, in Adagrad's sums, or in what it would score.
    """
    state, left = start(embedding), start(embedding).embedding
    models = torch.arange(len(embedding.entity))
    for epoch in range(settings.max_epochs + 1):
        if epoch:
            run_epoch(state, data, negatives, settings, root, epoch)
        try:
            _check(state)
        except NotFinite as error:
            slower = f"turn down the learning rate ({settings.learning_rate:g})"
            advice = slower if epoch else "look at what training starts from"
            found = f"diverged in epoch {epoch} ({error.problem}): {advice}"
            raise NotFinite(models[error.models].tolist(), found) from error
        going = watch(epoch, state.embedding, models)
        if going.all() and epoch < settings.max_epochs:
            continue
        leaving = ~going if epoch < settings.max_epochs else torch.ones_like(going)
        for name in ("entity", "relation"):
            getattr(left, name)[models[leaving]] = getattr(state.embedding, name)[leaving]
        if leaving.all():
            break
        state, data, models = keep_models(state, going), select(data, going), models[going]
    return left


def _check(state: State) -> None:
    check_finite((state.embedding.entity, state.embedding.relation), "vectors or scores")
    check_finite((state.squares.entity, state.squares.relation), "Adagrad's sums", torch.finfo(torch.float32).max)


def run_epoch(
    state: State, data: TrainingData, negatives: Negatives, settings: Optimizer, root: int, epoch: int
) -> None:
    """One pass over all observations of each model, in place: by batches, or one by one."""
    alone = data.new if epoch <= settings.new_rows_first else None
    if alone is None and single_updates.can_compile(state.embedding, data, negatives, settings.batch_size):
        rates = settings.learning_rate, settings.weight_decay
        single_updates.run_compiled(state.embedding, state.squares, data, negatives.ratio, *rates, root, epoch)
        return
    frozen = ~data.session.entities
    for batch, positives in batches(data, negatives, settings.batch_size, root, epoch):
        adagrad(state, loss_gradient(state.embedding, batch), positives, frozen, settings, alone)


def adagrad(
    state: State, gradient: Embedding, positives: Tensor, frozen: Tensor, settings: Optimizer,
    alone: Tensor | None = None,
) -> None:  # fmt: skip
    """Update a stack in place from the gradient of a batch.

    Args:
        gradient: summed over the batch.
        positives: observations in the batch; where there are none, a model stays as it is; shape (M,).
        frozen: entities that take no part; shape (M, E), bool.
        alone: entities whose rows alone move, (M, E), bool; all rows of both tables where it is null.
    """
    scale = (positives > 0) / positives.clamp(min=1)
    decay = (settings.weight_decay * (positives > 0))[:, None, None]
    gradient.entity.masked_fill_(frozen[..., None], 0.0)
    for name in ("entity", "relation") if alone is None else ("entity",):
        table, squares = getattr(state.embedding, name), getattr(state.squares, name)
        step = getattr(gradient, name).mul_(scale[:, None, None]).addcmul_(table, decay)
        if alone is not None:
            step.masked_fill_(~alone[..., None], 0.0)
        squares.addcmul_(step, step)
        table.addcdiv_(step, squares.sqrt(), value=-settings.learning_rate)


def start(embedding: Embedding) -> State:
    """A copy of an embedding with fresh accumulators."""
    entity, relation = (torch.full_like(table, ACCUMULATOR) for table in (embedding.entity, embedding.relation))
    return State(_apart(embedding), _apart(Embedding(entity, relation, embedding.model)))


def keep_models(state: State, staying: Tensor) -> State:
    """The state of the models that stay."""
    return State(_apart(select(state.embedding, staying)), _apart(select(state.squares, staying)))


def _apart(embedding: Embedding) -> Embedding:
    return Embedding(apart(embedding.entity), apart(embedding.relation), embedding.model)


@dataclass(frozen=True)
class ValidationResult:
    """One look at the validation MRR* of some models of a stack."""

    epoch: int
    #: places in the stack; shape: (A,)
    models: Tensor
    #: in the order of ``MEASURES``; shape: (A, 4), float64
    measures: Tensor
    #: whether this is each model's best so far, and was kept; shape: (A,), bool
    is_best: Tensor


class EarlyStopping:
    """Keeps the best embedding of each model by validation MRR*, and lets it go when none better comes."""

    def __init__(self, embedding: Embedding, valid: Queries, settings: Training) -> None:
        self.best, self.validations = start(embedding).embedding, list[ValidationResult]()
        self.valid, self.settings = valid, settings
        self.highest = torch.full((len(embedding.entity),), -1.0, dtype=torch.float64)
        self.since = torch.zeros(len(embedding.entity), dtype=torch.int64)

    def __call__(self, epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        if not epoch or (epoch % self.settings.evaluate_every and epoch < self.settings.max_epochs):
            return torch.ones(len(models), dtype=torch.bool)
        measures = evaluate(embedding, {"valid": self.valid})["valid"].measures
        mrr_star = measures[:, 0]
        better = mrr_star > self.highest[models]
        self.validations.append(ValidationResult(epoch, models, measures, better))
        self.highest[models[better]] = mrr_star[better]
        self.since[models] = torch.where(better, 0, self.since[models] + 1)
        for name in ("entity", "relation"):
            getattr(self.best, name)[models[better]] = getattr(embedding, name)[better]
        going = self.since[models] < self.settings.patience
        if not going.all():
            self.valid = select(self.valid, going)
        return going


def train_until_best(
    embedding: Embedding, data: TrainingData, negatives: Negatives, settings: Training, root: int
) -> tuple[Embedding, list[ValidationResult]]:
    """Train each model until validation MRR* stops improving; the best embedding of each is kept."""
    watch = EarlyStopping(embedding, validation(data.session)["valid"], settings)
    train(embedding, data, negatives, settings, root, watch)
    return watch.best, watch.validations


@dataclass(frozen=True)
class EpochMeasures:
    """Measures of some models of a stack after an epoch (0: before the first), by scope."""

    epoch: int
    #: places in the stack; shape: (A,)
    models: Tensor
    results: dict[str, Result]


class ConvergenceWatch:
    """Measures every model after every epoch, and lets it go when it has converged in every scope of the targets.

    Args:
        scopes: where to measure.
        targets: MRR* from which a model counts as converged, by scope; NaN where it is not asked; (M,).
        full_curves: let no model go.
    """

    def __init__(self, scopes: dict[str, Queries], targets: dict[str, Tensor], full_curves: bool) -> None:
        self.epochs = list[EpochMeasures]()
        self.scopes, self.targets, self.full_curves = scopes, targets, full_curves
        self.reached = {scope: torch.isnan(target) for scope, target in targets.items()}

    def __call__(self, epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        results = evaluate(embedding, self.scopes)
        self.epochs.append(EpochMeasures(epoch, models, results))
        for scope, target in self.targets.items():
            self.reached[scope] |= results[scope].measures[:, 0] >= target
        if self.full_curves:
            return torch.ones(len(models), dtype=torch.bool)
        going = ~torch.stack(list(self.reached.values())).all(0)
        if not going.all():
            self.scopes, self.targets = select(self.scopes, going), select(self.targets, going)
            self.reached = select(self.reached, going)
        return going


def loss_gradient(embedding: Embedding, batch: DenseBatch | ListBatch) -> Embedding:
    """Gradient of Σ -log σ(y · f) over a batch (section 3)."""
    entity, relation, family = embedding.entity, embedding.relation, embedding.model
    if isinstance(batch, DenseBatch):
        scores, pull = family.scores(entity, relation, DenseTriples.of(entity, relation))
        slope = torch.sigmoid_(scores).mul_(batch.positives + batch.negatives).sub_(batch.positives)
    else:
        scores, pull = family.scores(entity, relation, batch.triples)
        slope = bits.padded(torch.sigmoid, scores) - batch.positive
    by_entity, by_relation = pull(slope)
    return replace(embedding, entity=by_entity, relation=by_relation)
