"""Training a stack of embeddings: the loss and its gradient, Adagrad, the loop over epochs,
and when it stops.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import pandas as pd
import torch
from torch import Tensor

from isi.config import Count, NotNegative, Positive, Section
from isi.evaluation.query_sets import validation
from isi.evaluation.ranking import MEASURES, Queries, Result, evaluate, measure_rows
from isi.graph.graph import Graph
from isi.models.bilinear import BlockModel
from isi.models.model import Model
from isi.models.scoring import DenseTriples, padded, spaced
from isi.models.stack import Embedding, NotFinite, check_finite, mapped, select
from isi.training.batches import DenseBatch, ListBatch, Negatives, TrainingData, batches, is_sampled

#: Initial value of Adagrad's accumulators.
ACCUMULATOR = 1e-6
TABLES = ("entity", "relation")


class Optimizer(Section):
    """``finetuning`` in params: batches, learning rate, weight decay and epochs of Adagrad.

    The weight decay γ acts on all rows. With one update for each observation, γ / d acts on the
    rows that the observation touches (``is_single``).
    """

    batch_size: Count
    learning_rate: Positive
    weight_decay: NotNegative
    max_epochs: Count


class Training(Optimizer):
    """``training`` in params: the settings of both Θ⁰ and the joint model, with early stopping."""

    evaluate_every: Count
    patience: Count


@dataclass(frozen=True)
class State:
    """A stack in training: its embedding and Adagrad's sums of squared gradients."""

    embedding: Embedding
    squares: Embedding


#: Called before the first epoch (as epoch 0) and after each epoch, with the A embeddings still in
#: training and their places in the stack, (A,); returns a mask of the embeddings that continue,
#: (A,), bool.
Watch = Callable[[int, Embedding, Tensor], Tensor]


def never_stop(epoch: int, embedding: Embedding, models: Tensor) -> Tensor:  # noqa: ARG001
    """Train every embedding to the last epoch."""
    return torch.ones(len(models), dtype=torch.bool)


def train(
    embedding: Embedding,
    data: TrainingData,
    negatives: Negatives,
    settings: Optimizer,
    root: int,
    watch: Watch = never_stop,
) -> Embedding:
    """Train each embedding of a stack for ``max_epochs``, or until the watch stops it.

    An embedding that stops leaves the stack, without effect on the others. ``NotFinite`` if an
    embedding diverges: it has NaN, a coordinate above ``LARGEST``, or infinity in Adagrad's sums.
    """
    state, result = start(embedding), start(embedding).embedding
    models = torch.arange(len(embedding.entity))
    for epoch in range(settings.max_epochs + 1):
        if epoch:
            run_epoch(state, data, negatives, settings, root, epoch)
        _check_state(state, models, epoch, settings.learning_rate)
        going_on = watch(epoch, state.embedding, models) & (epoch < settings.max_epochs)
        if not going_on.all():
            _copy_rows(state.embedding, ~going_on, result, models)
            if not going_on.any():
                break
            state, data, models = (
                mapped(select(state, going_on), spaced),
                select(data, going_on),
                models[going_on],
            )
    return result


def start(embedding: Embedding) -> State:
    """A copy of an embedding with fresh accumulators."""
    return mapped(
        State(embedding, mapped(embedding, lambda table: torch.full_like(table, ACCUMULATOR))),
        spaced,
    )


def _copy_rows(source: Embedding, chosen: Tensor, target: Embedding, models: Tensor) -> None:
    """Copy the chosen embeddings of a stack, (A,) bool, to their places in another one."""
    for name in TABLES:
        getattr(target, name)[models[chosen]] = getattr(source, name)[chosen]


def _check_state(state: State, models: Tensor, epoch: int, rate: float) -> None:
    try:
        check_finite((state.embedding.entity, state.embedding.relation), "vectors or scores")
        check_finite(
            (state.squares.entity, state.squares.relation),
            "Adagrad's sums",
            torch.finfo(torch.float32).max,
        )
    except NotFinite as error:
        advice = f"turn down the learning rate ({rate:g})" if epoch else "check the initial vectors"
        problem = f"diverged in epoch {epoch} ({error.message}): {advice}"
        raise NotFinite(models[error.models].tolist(), problem) from error


def run_epoch(
    state: State,
    data: TrainingData,
    negatives: Negatives,
    settings: Optimizer,
    root: int,
    epoch: int,
    compiled: bool = True,
) -> None:
    """One pass over all observations of each embedding, in place; if ``compiled``, by compiled code
    where that fits.
    """
    single = is_single(negatives, data.session.graph, settings)
    if single:
        decay = settings.weight_decay / state.embedding.entity.shape[-1]
        settings = settings.model_copy(update={"weight_decay": decay})
    fits = is_compiled(state.embedding.model, settings.batch_size) and state.embedding.entity.is_cpu
    if compiled and single and fits:
        from isi.training.compiled import run_compiled_epoch

        rates = settings.learning_rate, settings.weight_decay
        tables = state.embedding, state.squares
        run_compiled_epoch(*tables, data, negatives.ratio, *rates, root, epoch)
        return
    for batch, positives in batches(data, negatives, settings.batch_size, root, epoch):
        trained_rows = batch.touched() if single else None
        gradient = loss_gradient(state.embedding, batch)
        adagrad(state, gradient, positives, ~data.session.entities, settings, trained_rows)


def is_single(negatives: Negatives, graph: Graph, settings: Optimizer) -> bool:
    """Whether each observation, with sampled negatives, is an update of its own, of the rows that
    it touches alone.
    """
    return settings.batch_size == 1 and is_sampled(negatives, graph)


def is_compiled(model: Model, batch_size: int) -> bool:
    """Whether updates are compiled: batches of one observation, for a plain block model without
    constraint.
    """
    is_plain = isinstance(model, BlockModel) and model.is_plain()
    return batch_size == 1 and is_plain and model.is_free


def compile_ahead(model: Model, batch_size: int) -> None:
    """Compile ``isi.training.compiled``, or load its cache, before workers are forked,
    which then share the code.
    """
    if is_compiled(model, batch_size):
        import isi.training.compiled  # noqa: F401


def loss_gradient(embedding: Embedding, batch: DenseBatch | ListBatch) -> Embedding:
    """Gradient of the loss Σ -log σ(y · f) over a batch, y = 1 for positives,
    -1 for negatives (section 3).
    """
    entity, relation = embedding.entity, embedding.relation
    if isinstance(batch, DenseBatch):
        scores, backward = embedding.model.scores(
            entity, relation, DenseTriples.of(entity, relation)
        )
        slope = torch.sigmoid_(scores).mul_(batch.positives + batch.negatives).sub_(batch.positives)
    else:
        scores, backward = embedding.model.scores(entity, relation, batch.triples)
        slope = padded(torch.sigmoid, scores) - batch.positive
    by_entity, by_relation = backward(slope)
    return replace(embedding, entity=by_entity, relation=by_relation)


def adagrad(
    state: State,
    gradient: Embedding,
    positives: Tensor,
    frozen: Tensor,
    settings: Optimizer,
    trained_rows: tuple[Tensor, Tensor] | None = None,
) -> None:
    """Update a stack in place from a batch's gradient:
    Θ ← Θ - rate · g / √Σg², g = gradient / positives + decay · Θ. Then entities are constrained.

    ``gradient`` is summed over the batch, ``positives``, (M,), is its number of positives; an
    embedding with 0 stays as it is. ``frozen`` entities, (M, E), get no gradient. ``trained_rows``:
    only these entities, (M, E), and relations, (M, R), change; None: all.
    """
    scale = (positives > 0) / positives.clamp(min=1)
    decay = (settings.weight_decay * (positives > 0))[:, None, None]
    gradient.entity.masked_fill_(frozen[..., None], 0.0)
    for place, name in enumerate(TABLES):
        table, squares = getattr(state.embedding, name), getattr(state.squares, name)
        step = getattr(gradient, name).mul_(scale[:, None, None]).addcmul_(table, decay)
        if trained_rows is not None:
            step.masked_fill_(~trained_rows[place][..., None], 0.0)
        squares.addcmul_(step, step)
        table.addcdiv_(step, squares.sqrt(), value=-settings.learning_rate)
    model, entity = state.embedding.model, state.embedding.entity
    if not model.is_free:
        changed = ~frozen if trained_rows is None else trained_rows[0]
        entity.copy_(torch.where(changed[..., None], model.constrain(entity), entity))


class EarlyStopping:
    """Stores each model's best embedding by validation MRR*;
    stops after ``patience`` evaluations without gain.

    ``looks`` has, for each evaluation, measures (``measure_rows``) and ``kept``: whether MRR* is
    the best so far.
    """

    def __init__(self, embedding: Embedding, queries: Queries, settings: Training) -> None:
        self.best, self.looks = start(embedding).embedding, list[pd.DataFrame]()
        self.queries, self.settings = queries, settings
        self.highest = torch.full((len(embedding.entity),), -1.0, dtype=torch.float64)
        self.since_best = torch.zeros(len(embedding.entity), dtype=torch.int64)

    def __call__(self, epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        if not epoch or (epoch % self.settings.evaluate_every and epoch < self.settings.max_epochs):
            return never_stop(epoch, embedding, models)
        results = evaluate(embedding, {"valid": self.queries})
        mrr_star = results["valid"].measures[:, 0]
        is_best = mrr_star > self.highest[models]
        self.looks.append(measure_rows(results, epoch, models).assign(kept=is_best.cpu().numpy()))
        self.highest[models[is_best]] = mrr_star[is_best]
        self.since_best[models] = torch.where(is_best, 0, self.since_best[models] + 1)
        _copy_rows(embedding, is_best, self.best, models)
        going_on = self.since_best[models] < self.settings.patience
        if not going_on.all():
            self.queries = select(self.queries, going_on)
        return going_on


def train_until_best(
    embedding: Embedding, data: TrainingData, negatives: Negatives, settings: Training, root: int
) -> tuple[Embedding, list[pd.DataFrame]]:
    """Train each embedding until validation MRR* stops improving;
    returns the best embeddings and all measures.
    """
    watch = EarlyStopping(embedding, validation(data.session)["valid"], settings)
    train(embedding, data, negatives, settings, root, watch)
    return watch.best, watch.looks


@dataclass(frozen=True)
class Target:
    """A value of one measure of a query set at which an embedding is as good as the joint model."""

    query_set: str
    measure: str
    value: Tensor  #: NaN: none; shape: (M,)


class ConvergenceWatch:
    """Measures each embedding at every epoch; stops it once it has converged, by the rule of
    ``isi.evaluation.query_sets.epochs_to_convergence``.

    Args:
        query_sets: what is measured, in mappings whose query sets share their triples.
        targets: by name. An embedding has converged once it has reached, for each name, all of
            its targets at one epoch.
        trained: embeddings that are trained at all, (M,), bool; the others end at epoch 0. None:
            all.
        full_curves: train to the last epoch, converged or not.
    """

    def __init__(
        self,
        query_sets: list[dict[str, Queries]],
        targets: dict[str, list[Target]],
        trained: Tensor | None = None,
        full_curves: bool = False,
    ) -> None:
        self.looks = list[pd.DataFrame]()
        self.query_sets, self.targets, self.full_curves = query_sets, targets, full_curves
        self.trained = trained
        self.reached = dict[str, Tensor]()

    def __call__(self, epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        results = dict[str, Result]()
        for sharing in self.query_sets:
            results |= evaluate(embedding, sharing)
        self.looks.append(measure_rows(results, epoch, models))
        for name, targets in self.targets.items():
            now = torch.stack([_is_reached(results, target) for target in targets]).all(0)
            self.reached[name] = self.reached[name] | now if epoch else now
        going_on = never_stop(epoch, embedding, models)
        if self.trained is not None and not epoch:
            going_on = self.trained
        if not self.full_curves:
            going_on = going_on & ~torch.stack(list(self.reached.values())).all(0)
        if not going_on.all():
            self.query_sets = select(self.query_sets, going_on)
            self.targets = select(self.targets, going_on)
            self.reached = select(self.reached, going_on)
        return going_on


def _is_reached(results: Mapping[str, Result], target: Target) -> Tensor:
    """Where a target is reached, or there is none; shape (M,), bool."""
    values = results[target.query_set].measures[:, MEASURES.index(target.measure)]
    return (values >= target.value) | target.value.isnan()
