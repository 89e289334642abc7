"""Training a stack of models: gradients, Adagrad, the epoch loop, early stopping, stopping at convergence."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import pad

from isi.embeddings import analogy
from isi.embeddings.stack import Embedding, select
from isi.lessons import Lesson, Lists, Tables, batches
from isi.params import Negatives, Optimizer, Training
from isi.ranking import Queries, Result, evaluate

#: What Adagrad's accumulators start at.
ACCUMULATOR = 1e-6
#: A multiple of the numbers that PyTorch takes at once, on any processor.
_REGISTER = 64


@dataclass(frozen=True)
class State:
    """An embedding in training: its vectors and Adagrad's sums of squared gradients."""

    embedding: Embedding
    squares: Embedding


def loss_gradient(embedding: Embedding, batch: Tables | Lists) -> Embedding:
    """Gradient of Σ -log σ(y · f) over a batch (section 3), in either form."""
    if isinstance(batch, Tables):
        scores, mapped = analogy.score_all(embedding)
        slope = torch.sigmoid_(scores).mul_(batch.positives + batch.negatives).sub_(batch.positives)
        return analogy.gradient(embedding, mapped, slope)
    ids = (batch.model, batch.head, batch.relation, batch.tail)
    scores, rows = analogy.score_listed(embedding, *ids)
    return analogy.gradient_listed(embedding, rows, *ids, _sigmoid(scores) - batch.positive)


def _sigmoid(scores: Tensor) -> Tensor:
    """σ of a list, to the same bits wherever a score stands in it; shape (N,).

    PyTorch rounds the last few numbers, which fill no register, otherwise than the rest.
    """
    return torch.sigmoid(pad(scores, (0, -len(scores) % _REGISTER)))[: len(scores)]


def adagrad(state: State, gradient: Embedding, positives: Tensor, frozen: Tensor, settings: Optimizer) -> None:
    """Update a stack in place from the gradient of a batch.

    Args:
        gradient: summed over the batch.
        positives: observations in the batch; where there are none, a model stays as it is; shape (M,).
        frozen: entities that take no part; shape (M, E), bool.
    """
    scale = (positives > 0) / positives.clamp(min=1)
    decay = (settings.weight_decay * (positives > 0))[:, None, None]
    gradient.entity.masked_fill_(frozen[..., None], 0.0)
    for name in ("entity", "relation"):
        table, squares = getattr(state.embedding, name), getattr(state.squares, name)
        step = getattr(gradient, name).mul_(scale[:, None, None]).addcmul_(table, decay)
        squares.addcmul_(step, step)
        table.addcdiv_(step, squares.sqrt(), value=-settings.learning_rate)


def run_epoch(state: State, lesson: Lesson, negatives: Negatives, settings: Optimizer, root: int, epoch: int) -> None:
    """One pass over all observations of each model, in place."""
    frozen = ~lesson.session.entities
    for batch, positives in batches(lesson, negatives, settings, root, epoch):
        adagrad(state, loss_gradient(state.embedding, batch), positives, frozen, settings)


def start(embedding: Embedding) -> State:
    """A copy of an embedding with fresh accumulators."""
    squares = [torch.full_like(table, ACCUMULATOR) for table in (embedding.entity, embedding.relation)]
    return State(_one_table(embedding), _one_table(Embedding(*squares)))


def leave(state: State, going: Tensor) -> State:
    """The state of the models that go on."""
    return State(_one_table(select(state.embedding, going)), _one_table(select(state.squares, going)))


def _one_table(embedding: Embedding) -> Embedding:
    """A copy whose parts are views of one table, so that updates run model by model (see ``score_all``)."""
    table = torch.cat([embedding.entity, embedding.relation], 1)
    entities = embedding.entity.shape[1]
    return Embedding(table[:, :entities], table[:, entities:])


@dataclass(frozen=True)
class Look:
    """One look at the validation MRR* of some models of a stack."""

    epoch: int
    #: places in the stack; shape: (A,)
    models: Tensor
    #: in the order of ``MEASURES``; shape: (A, 4), float64
    measures: Tensor
    #: whether this is each model's best so far, and was kept; shape: (A,), bool
    kept: Tensor


def fit(
    embedding: Embedding, lesson: Lesson, valid: Queries, negatives: Negatives, settings: Training, root: int
) -> tuple[Embedding, list[Look]]:
    """Train each model until validation MRR* stops improving; the best embedding of each is kept.

    A model that has stopped leaves the stack, which changes nothing for the others.
    """
    state, best = start(embedding), start(embedding).embedding
    models = torch.arange(len(embedding.entity))
    highest = torch.full((len(models),), -1.0, dtype=torch.float64)
    since = torch.zeros(len(models), dtype=torch.int64)
    looks = []
    for epoch in range(1, settings.max_epochs + 1):
        run_epoch(state, lesson, negatives, settings, root, epoch)
        if epoch % settings.evaluate_every and epoch < settings.max_epochs:
            continue
        measures = evaluate(state.embedding, {"valid": valid})["valid"].measures
        mrr_star = measures[:, 0]
        better = mrr_star > highest[models]
        looks.append(Look(epoch, models, measures, better))
        highest[models[better]], since[models] = mrr_star[better], torch.where(better, 0, since[models] + 1)
        for name in ("entity", "relation"):
            getattr(best, name)[models[better]] = getattr(state.embedding, name)[better]
        going = since[models] < settings.patience
        if not going.all():
            state, lesson, valid = leave(state, going), select(lesson, going), select(valid, going)
            models = models[going]
        if not len(models):
            break
    return best, looks


@dataclass(frozen=True)
class Followed:
    """Measures of some models of a stack after an epoch (0: before the first), by scope."""

    epoch: int
    #: places in the stack; shape: (A,)
    models: Tensor
    results: dict[str, Result]


def fine_tune(
    embedding: Embedding,
    lesson: Lesson,
    scopes: dict[str, Queries],
    targets: dict[str, Tensor],
    negatives: Negatives,
    settings: Optimizer,
    root: int,
    to_the_end: bool,
) -> list[Followed]:
    """Train Θ¹ on D¹, measured after every epoch, until it has converged in every scope of ``targets``.

    Args:
        embedding: Θ⁰ with the novel entities inserted.
        scopes: where to measure.
        targets: MRR* from which a model counts as converged, by scope; NaN where it is not asked; (M,).
        to_the_end: train all models for ``max_epochs``.
    """
    state, models = start(embedding), torch.arange(len(embedding.entity))
    reached = {scope: torch.isnan(target) for scope, target in targets.items()}
    followed = []
    for epoch in range(settings.max_epochs + 1):
        if epoch:
            run_epoch(state, lesson, negatives, settings, root, epoch)
        results = evaluate(state.embedding, scopes)
        followed.append(Followed(epoch, models, results))
        for scope, target in targets.items():
            reached[scope] |= results[scope].measures[:, 0] >= target
        going = ~torch.stack(list(reached.values())).all(0)
        if to_the_end or going.all():
            continue
        state, lesson, scopes = leave(state, going), select(lesson, going), select(scopes, going)
        targets, reached, models = select(targets, going), select(reached, going), models[going]
        if not len(models):
            break
    return followed
