"""Fold-in: the rows of new entities are trained together, while all other rows stay as they are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import torch
from torch import Tensor

from isi.config import Count, NotNegative, Positive
from isi.graph.graph import HEAD, TAIL
from isi.initializers.api import INITIALIZERS, InitResult, initializer, without_weights
from isi.initializers.context import InitContext
from isi.models.losses import Loss
from isi.random import stream
from isi.training.rows import Earlier, Facts, Penalty, Recipe, Tables, Task, fit

#: By the loss of training, how strongly a vector is held at its start: weight of the mean square of
#: its distance, in the unit of the known coordinates, by that of one fact. It counts where facts
#: are few.
HELD: dict[Loss, float] = {"logistic": 60, "softmax": 20, "self-adversarial": 6, "margin": 0.6}
BATCH = 1024  #: Number of facts in a step.
#: Number of drawn wrong answers: of each fact, and of each where all entities would be too many.
NEGATIVES, SAMPLED = 64, 512
#: Largest number of entities, and of facts times entities, for which cross-entropy is over all
#: entities.
FEW, EXACT = 2**12, 2**24

#: The initializer from whose vectors training starts.
Start = Literal["soft_rs", "er_avg", "soft_hybrid", "mean"]


@initializer(
    "fold_in",
    label="Fold-in",
    role="baseline",
    cost="trained",
    needs=("insert_triples",),
    defaults={"start": "soft_rs", "share": 0.35, "epochs": 10, "rate": 0.25, "pull": 1.0},
    calibration=[{"share": 0.7}, {"share": 1.0}, {"share": 0.1}, {"pull": 3.0}, {"share": 3.0}],
    starts_from="start",
)
def fold_in(
    context: InitContext,
    share: NotNegative,
    epochs: Count,
    rate: Positive,
    pull: NotNegative,
    start: Start = "soft_rs",
) -> InitResult:
    """Fold-in: the new rows, trained together on their facts by the embedding's own loss, with a
    share of their part in earlier facts.

    Args:
        share: β: weight of the part in earlier facts, to which new entities are wrong answers.
        epochs: of training; rate: step size of Adagrad, by the root mean square of the coordinates
            of known vectors.
        pull: how strongly vectors are held at their start, by ``HELD``; 0: not at all.
        start: the initializer from whose vectors training starts; without an inverse of relations,
            the mean.
    """
    first = start_of(context, start)
    trained = [
        _trained(context, model, vectors, share, epochs, rate, pull)
        for model, vectors in enumerate(first.vectors)
    ]
    vectors, relations = (torch.stack(parts) for parts in zip(*trained, strict=True))
    return replace(first, vectors=vectors, relations=relations, is_centroid=False)


def start_of(context: InitContext, start: str) -> InitResult:
    """The result from whose vectors training starts."""
    if context.training.start is not None:
        return without_weights(context.training.start)
    chosen = INITIALIZERS.get(start if context.theta0.model.invertible else "mean")
    return chosen.initialize(context, chosen.defaults)


@dataclass(frozen=True)
class _Rows:
    """The embedding of a context with the new rows last, and its triples."""

    fixed: Tensor  #: vectors of known entities, (E, d)
    facts: Facts
    has_facts: Tensor  #: whether each new entity has any; shape: (n,), bool
    earlier: Tensor  #: training triples of known entities, (K, 3)
    unit: float  #: root mean square of the coordinates of known vectors


def _trained(
    context: InitContext,
    model: int,
    start: Tensor,
    share: float,
    epochs: int,
    rate: float,
    pull: float,
) -> tuple[Tensor, Tensor]:
    """Vectors of the new entities of a model, (n, d), and the rows of new relations, (q, w)."""
    rows, relation = _rows(context, model, start), context.theta0.relation[model]
    known = len(relation) - context.training.relations
    tables = Tables(
        rows.fixed,
        start.clone().requires_grad_(),
        relation[:known],
        relation[known:].clone().requires_grad_(),
    )
    if len(rows.facts.triples):
        held = pull * HELD[context.scale.training.name] / rows.facts.weight.sum().item()
        penalty = _pull(start, held / rows.unit**2) if pull else None
        earlier = Earlier(rows.earlier, share) if share else None
        task = Task(rows.facts, earlier, penalty, context.training.tails_only)
        recipe = _recipe(context, len(rows.facts.triples), rate * rows.unit)
        rng = stream(context.root, "fold-in", *context.keys[model].tolist())
        fit(context.theta0.model, tables, task, recipe, epochs, rng)
    vectors = torch.where(rows.has_facts[:, None], tables.entity, start)
    return vectors.detach(), tables.relation.detach()


def _recipe(context: InitContext, facts: int, rate: float) -> Recipe:
    loss = context.scale.training
    negatives: int | None = NEGATIVES
    if loss.name == "softmax":
        entities = context.known.shape[1]
        is_exact = entities <= FEW and facts * entities <= EXACT
        negatives = None if is_exact else SAMPLED
    return Recipe(
        loss=loss.name,
        margin=loss.margin,
        temperature=loss.temperature,
        batch_size=BATCH,
        learning_rate=rate,
        negatives=negatives,
    )


def _pull(start: Tensor, weight: float) -> Penalty:
    """weight · Σ mean square of the distance from the start, over new entities."""

    def penalty(tables: Tables) -> Tensor:
        return weight * (tables.entity - start).square().mean(1).sum()

    return penalty


def _rows(context: InitContext, model: int, start: Tensor) -> _Rows:
    """What training sees of a model of the stack: known rows first, then the new ones."""
    theta0, known = context.theta0, context.known[model].nonzero()[:, 0]
    number, new = len(known), torch.arange(len(start))
    is_prefix = number == 0 or int(known[-1]) == number - 1
    entity = theta0.entity[model]
    fixed = entity[:number] if is_prefix else entity[known]
    place = torch.zeros(max(len(entity), context.known.shape[1]), dtype=torch.int64)
    place[context.novel[model]] = number + new
    place[known] = torch.arange(number)
    is_tail, observed = context.novel_is_tail[model], context.observed[model]
    other = place[context.other[model]]
    # a triple of two new entities is listed with both
    counts = observed & ~((other >= number) & is_tail)
    novel = (number + new)[:, None].expand(other.shape)
    ends = torch.where(is_tail, other, novel), torch.where(is_tail, novel, other)
    triples = torch.stack([ends[0], context.relation[model], ends[1]], -1)[counts]
    weight = context.weight[model][counts].float()
    of_new_relations = context.training.triples
    if of_new_relations is not None:
        triples = torch.cat([triples, of_new_relations])
        weight = torch.cat([weight, torch.ones(len(of_new_relations))])
    has_facts = torch.zeros(number + len(start), dtype=torch.bool)
    has_facts[triples[:, [HEAD, TAIL]].flatten()] = True
    earlier = context.triples[context.trained[model]]
    if not is_prefix:
        earlier[:, [HEAD, TAIL]] = place[earlier[:, [HEAD, TAIL]]]
    unit = fixed[:: max(1, number // 1024)].square().mean().sqrt().item()
    return _Rows(fixed, Facts(triples, weight), has_facts[number:], earlier, unit)
