"""The triples that determine a novel vector:
insert triples, their negatives, known triples with the novel entity.

Training uses a row in three ways, and so does the objective of MAP (docs/method.md): as an end of
its own triples; in corrupted copies of them; and as the wrong end of everybody else's triples. Each
is a list of weighted triples of the novel and a known entity. Of more than ``SAMPLE`` triples a
systematic sample is taken (its error: docs/checks.md).
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from isi.graph.graph import HEAD, RELATION, TAIL
from isi.initializers.context import InitContext

#: Maximum number of corrupted ends, of corrupted relations and of known triples of a novel entity.
SAMPLE = 1536
#: Maximum number of known triples, evenly spaced by row, from which the last are drawn.
KNOWN_SAMPLE = 2**16


@dataclass(frozen=True)
class Evidence:
    """C weighted triples of each novel entity with a known one; a weight of 0 marks padding."""

    is_tail: Tensor  #: whether the novel entity is the tail; shape: (M, n, C), bool
    relation: Tensor  #: ids; shape: (M, n, C)
    other: Tensor  #: ids of the known ends; shape: (M, n, C)
    positive: Tensor  #: number of true triples; shape: (M, n, C), float64
    negative: Tensor  #: expected number of corrupted triples; shape: (M, n, C), float64


def evidence_of(context: InitContext, ratio: int, known_negatives: float) -> Evidence:
    """The evidence of the insert triples, of ``ratio`` corrupted ends and relations for each,
    and of known triples.

    ``known_negatives``: β, weight of the known triples that are corrupted by a novel entity.
    """
    ids = context.novel_is_tail, context.relation, context.other
    parts = [Evidence(*ids, context.weight, torch.zeros_like(context.weight))]
    parts += [corrupted_ends(context, ratio), corrupted_relations(context, ratio)]
    if known_negatives:
        parts.append(corrupted_known(context, known_negatives * ratio))
    names = ("is_tail", "relation", "other", "positive", "negative")
    columns = {name: [getattr(part, name) for part in parts] for name in names}
    return Evidence(**{name: torch.cat(column, -1) for name, column in columns.items()})


def corrupted_ends(context: InitContext, ratio: int) -> Evidence:
    """Insert triples whose known end is replaced by a uniformly random known entity,
    perhaps by the true one.
    """
    relations, models = context.theta0.relation.shape[1], context.novel.shape
    number, slot = slots_of(context)
    most = min(context.observed.shape[-1], 2 * relations)  # slots of an entity with triples
    number, slot = number[..., :most], slot[..., :most]
    ends, share = spread(context.known.double(), max(1, SAMPLE // most))
    share = share / share.sum(-1, keepdim=True)
    shape = (*models, most, ends.shape[-1])
    weight = ratio * number[..., None] * share[:, None, None]
    other = ends[:, None, None].expand(shape)
    slot = slot[..., None].expand(shape).flatten(2)
    return _negative(slot >= relations, slot % relations, other.flatten(2), weight.flatten(2))


def slots_of(context: InitContext) -> tuple[Tensor, Tensor]:
    """Number of insert triples in each slot of a novel entity, and the slot, those with most first;
    shape (M, n, 2R) each.

    Slot r: the novel entity is the head of relation r; slot R + r: its tail.
    """
    relations = context.theta0.relation.shape[1]
    number = torch.zeros(*context.novel.shape, 2 * relations, dtype=torch.float64)
    number.scatter_add_(-1, context.novel_is_tail * relations + context.relation, context.weight)
    number, slot = number.sort(dim=-1, descending=True, stable=True)
    return number, slot


def corrupted_relations(context: InitContext, ratio: int) -> Evidence:
    """Insert triples whose relation is replaced by another one, uniformly at random."""
    relations = context.theta0.relation.shape[1]
    number = min(relations - 1, max(1, SAMPLE // context.observed.shape[-1]))
    steps = (
        1 + (torch.arange(number) + 0.5).mul((relations - 1) / max(1, number)).long()
    )  # evenly spaced, all different
    relation = (context.relation[..., None] + steps) % relations
    weight = ratio / max(1, number) * context.weight[..., None].expand_as(relation)
    is_tail, other = (
        ids[..., None].expand_as(relation) for ids in (context.novel_is_tail, context.other)
    )
    return _negative(*(values.flatten(2) for values in (is_tail, relation, other, weight)))


def corrupted_known(context: InitContext, weight: float) -> Evidence:
    """Training triples of D⁰ whose head or tail is replaced by a uniformly random
    entity that is the novel one.

    Each has the probability 1 / known entities. The expected numbers are multiplied by ``weight``
    and by s (``complete``): a triple that was not given is not false.
    """
    relations, entities = context.theta0.relation.shape[1], context.theta0.entity.shape[1]
    known, trained = context.known.sum(-1).double(), context.trained.sum(-1).double()
    step = -(-len(context.triples) // KNOWN_SAMPLE) or 1
    triples, in_sample = context.triples[::step], context.trained[:, ::step].double()
    head, relation, tail = triples[:, HEAD], triples[:, RELATION], triples[:, TAIL]
    keys = torch.cat([relation * entities + tail, (relations + relation) * entities + head])
    key, place = torch.unique(keys, return_inverse=True)
    number = torch.zeros(len(known), len(key), dtype=torch.float64).index_add_(
        1, place, in_sample.repeat(1, 2)
    )
    number *= (trained / in_sample.sum(-1).clamp(min=1))[:, None]
    item, number = spread(number, SAMPLE)
    by_entity = complete(context) * weight / known[:, None]
    shape = (*context.novel.shape, item.shape[-1])
    slot = (key[item] // entities)[:, None].expand(shape)
    other = (key[item] % entities)[:, None].expand(shape)
    return _negative(
        slot >= relations, slot % relations, other, by_entity[..., None] * number[:, None]
    )


def complete(context: InitContext) -> Tensor:
    """s of the novel entities of a context (``share_known``); shape (M, n)."""
    numbers = context.trained.sum(-1), context.known.sum(-1)
    return share_known(context.observed.sum(-1), *numbers)


def share_known(insert_triples: Tensor, trained: Tensor, known: Tensor) -> Tensor:
    """s = min(1, insert triples / mean training triples of an entity): how much of a novel entity
    is known, by numbers of insert triples, (M, n), training triples, (M,), and known entities,
    (M,); shape (M, n), float64.
    """
    mean = 2 * trained.double() / known.double()
    return (insert_triples / mean[:, None]).nan_to_num(0).clamp(max=1)


def spread(weight: Tensor, most: int) -> tuple[Tensor, Tensor]:
    """Ids of at most ``most`` of N items for each model, and their weights;
    shapes: (M, N), results (M, ≤ ``most``).

    All items if they are that few; else a systematic sample with probability proportional to
    weight, whose items have equal weights and the same total.
    """
    if weight.shape[1] <= most:
        return torch.arange(weight.shape[1]).expand(weight.shape), weight
    total = weight.cumsum(-1)
    at = (torch.arange(most) + 0.5) / most * total[:, -1:]
    place = torch.searchsorted(total, at.contiguous(), right=True).clamp(max=weight.shape[1] - 1)
    return place, (total[:, -1:] / most).expand(-1, most)


def _negative(is_tail: Tensor, relation: Tensor, other: Tensor, weight: Tensor) -> Evidence:
    return Evidence(is_tail, relation, other, torch.zeros_like(weight), weight)
