"""Training a stack of models: negatives, Adagrad, the epoch loop, early stopping, convergence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from isi.embeddings import analogy
from isi.embeddings.stack import Embedding, select
from isi.params import Negatives, Optimizer, Training
from isi.ranking import Queries, Result, evaluate
from isi.sessions import TRAIN, Session
from isi.streams import stream

#: What Adagrad's accumulators start at.
ACCUMULATOR = 1e-6


@dataclass(frozen=True)
class Lesson:
    """What a stack of models learns from: the training observations and the pools of negatives."""

    session: Session
    #: of each training triple, 0 where it is none; shape: (M, T), int64
    counts: Tensor
    #: entities that may be corrupted tails; shape: (M, E), float32 of 0 and 1
    tails: Tensor
    #: entities that may be corrupted heads of a relation; shape: (M, R, E), float32
    heads: Tensor
    #: what each model's random streams depend on beside root, purpose and epoch; shape: (M, K)
    keys: Tensor


@dataclass(frozen=True)
class State:
    """An embedding in training: its vectors and Adagrad's sums of squared gradients."""

    embedding: Embedding
    squares: Embedding


def lesson(session: Session, keys: Tensor, head_pool: str) -> Lesson:
    """Collect what D (a stack of sessions) teaches; ``keys`` are (size, seed) of each model."""
    graph = session.graph
    train = session.members(TRAIN)
    heads = torch.zeros(len(keys), len(graph.relations), len(graph.entities))
    heads += session.entities[:, None]
    if head_pool == "unseen":
        seen = torch.zeros_like(heads, dtype=torch.bool)
        models, triples = train.nonzero(as_tuple=True)
        seen[models, graph.triples[triples, 1], graph.triples[triples, 0]] = True
        unseen = heads * ~seen
        heads = torch.where(unseen.sum(-1, keepdim=True) > 0, unseen, heads)
    return Lesson(session, train * graph.counts, session.entities.float(), heads, keys)


def batches(lesson: Lesson, root: int, epoch: int, size: int) -> Tensor:
    """Deal an epoch's observations into batches of even length, at most ``size``.

    Returns:
        How often each unique triple stands in each batch; shape (M, B, T), int64. Models with fewer
        batches than others have empty ones at the end.
    """
    triples = lesson.counts.shape[1]
    dealt = []
    for counts, key in zip(lesson.counts.numpy(), lesson.keys.tolist(), strict=True):
        observations = np.repeat(np.arange(triples, dtype=np.int32), counts)
        number = max(1, -(-len(observations) // size))
        stream(root, "batches", *key, epoch).shuffle(observations)
        batch = np.arange(len(observations)) * number // max(1, len(observations))
        table = np.bincount(batch * triples + observations, minlength=number * triples)
        dealt.append(torch.as_tensor(table.reshape(number, triples)))
    return torch.nn.utils.rnn.pad_sequence(dealt, batch_first=True)


def place(lesson: Lesson, batch: Tensor) -> Tensor:
    """Counts of unique triples, (M, T), as a table of positives; shape (M, R, E, E), float32."""
    graph = lesson.session.graph
    relations, entities = len(graph.relations), len(graph.entities)
    head, relation, tail = graph.triples.T
    table = torch.zeros(len(batch), relations * entities * entities)
    table[:, (relation * entities + head) * entities + tail] = batch.float()
    return table.view(-1, relations, entities, entities)


def expected_negatives(lesson: Lesson, positives: Tensor, ratio: int) -> Tensor:
    """How often each triple is expected among a batch's corrupted ones; shape (M, R, E, E).

    For each positive, ``ratio`` corrupted tails, heads and relations: tails from the session's
    entities, heads from the relation's pool, relations from all but the true one.
    """
    by_tail, by_head = positives.sum(-1), positives.sum(-2)  # of a head, of a tail: (M, R, E)
    relations = positives.shape[1]
    tails = lesson.tails / lesson.tails.sum(-1, keepdim=True)
    heads = lesson.heads / lesson.heads.sum(-1, keepdim=True)
    negatives = (by_tail * ratio)[..., None] * tails[:, None, None]
    negatives.addcmul_(heads[..., None], (by_head * ratio)[:, :, None])
    if relations > 1:
        share = ratio / (relations - 1)
        negatives.add_(positives.sum(1, keepdim=True), alpha=share).sub_(positives, alpha=share)
    return negatives


def sampled_negatives(lesson: Lesson, batches: Tensor, ratio: int, root: int, epoch: int) -> Tensor:
    """Draw the corrupted triples of an epoch's batches; counts of shape (M, B, R, E, E), int32.

    The draws are those of ``expected_negatives``. They are keyed by model and epoch alone.
    """
    graph = lesson.session.graph
    shape = (batches.shape[1], len(graph.relations), len(graph.entities), len(graph.entities))
    drawn = torch.empty(len(batches), *shape, dtype=torch.int32)
    for model, key in enumerate(lesson.keys.tolist()):
        rng = stream(root, "negatives", *key, epoch)
        batch, triple = (ids.numpy() for ids in batches[model].nonzero(as_tuple=True))
        repeats = ratio * batches[model].numpy()[batch, triple]
        cells = _corrupt(rng, lesson, model, np.repeat(batch, repeats), np.repeat(triple, repeats))
        counts = np.bincount(cells, minlength=int(np.prod(shape)))
        drawn[model] = torch.as_tensor(counts.astype(np.int32)).view(shape)
    return drawn


def _corrupt(rng: np.random.Generator, lesson: Lesson, model: int, batch: np.ndarray, triple: np.ndarray) -> np.ndarray:
    """Corrupt tail, head and relation of each (batch, triple); cells of the table (B, R, E, E)."""
    graph = lesson.session.graph
    relations, entities = len(graph.relations), len(graph.entities)
    head, relation, tail = graph.triples.numpy()[triple].T
    tails = np.flatnonzero(lesson.tails[model].numpy())
    pool = lesson.heads[model].numpy() > 0
    members = np.argsort(~pool, axis=1, kind="stable")  # the pool of each relation comes first
    new_tail = tails[rng.integers(len(tails), size=len(triple))]
    new_head = members[relation, (rng.random(len(triple)) * pool.sum(1)[relation]).astype(np.int64)]
    cells = [_cell(batch, relation, head, new_tail, relations, entities),
             _cell(batch, relation, new_head, tail, relations, entities)]  # fmt: skip
    if relations > 1:
        other = rng.integers(relations - 1, size=len(triple))
        cells.append(_cell(batch, other + (other >= relation), head, tail, relations, entities))
    return np.concatenate(cells)


def _cell(batch: np.ndarray, relation: np.ndarray, head: np.ndarray, tail: np.ndarray, relations: int, entities: int
          ) -> np.ndarray:  # fmt: skip
    cell: np.ndarray = ((batch * relations + relation) * entities + head) * entities + tail
    return cell


def loss_gradient(embedding: Embedding, positives: Tensor, negatives: Tensor) -> Embedding:
    """Gradient of Σ -log σ(y · f) over a batch (section 3); counts of shape (M, R, E, E)."""
    scores, mapped = analogy.score_all(embedding)
    slope = torch.sigmoid_(scores).mul_(positives + negatives).sub_(positives)
    return analogy.gradient(embedding, mapped, slope)


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
    dealt = batches(lesson, root, epoch, settings.batch_size)
    drawn = None
    if negatives.mode == "sampled":
        drawn = sampled_negatives(lesson, dealt, negatives.ratio, root, epoch)
    frozen = ~lesson.session.entities
    for number in range(dealt.shape[1]):
        positives = place(lesson, dealt[:, number])
        corrupted = expected_negatives(lesson, positives, negatives.ratio) if drawn is None else drawn[:, number]
        gradient = loss_gradient(state.embedding, positives, corrupted)
        adagrad(state, gradient, dealt[:, number].sum(1), frozen, settings)


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
    #: shape: (A,), float64
    mrr_star: Tensor
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
        mrr_star = evaluate(state.embedding, {"valid": valid})["valid"].measures[:, 0].nan_to_num(0.0)
        better = mrr_star > highest[models]
        looks.append(Look(epoch, models, mrr_star, better))
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


def epochs_to_convergence(mrr_star: np.ndarray, target: float) -> int | None:
    """The first epoch whose MRR* reaches the target (section 6.2); None where none does.

    Args:
        mrr_star: by epoch, from 0.
    """
    reached = np.flatnonzero(mrr_star >= target)
    return int(reached[0]) if len(reached) else None
