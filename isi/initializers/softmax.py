"""The evidence of MAP for an embedding that was trained with cross-entropy over entities.

The loss of a novel vector v is that of training (docs/initializers.md). As the answer to the query
of an insert triple, softplus(log Z - f). As a wrong answer to a known query, softplus(f - log Z)
for each known answer. As the given end of a query (v, r, ?), log Σ exp(f) over candidates, less
f of the known end. Here log Z is that of the known entities.
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from isi.initializers.api import InitContext
from isi.initializers.evidence import SAMPLE, Evidence, complete, joined, slots_of, spread
from isi.initializers.newton import Crowd, QueryLoss
from isi.initializers.scale import KnownQueries, log_partition, parts_of_sides
from isi.initializers.scores import anchors
from isi.models.model import RelationMapModel
from isi.models.stack import rows

CANDIDATES = 64  #: Maximum number of candidates of a query about a novel entity: the most likely.


def facts(context: InitContext, queries: KnownQueries) -> Evidence:
    """The insert triples, as answers to queries about their known ends."""
    shape, per_model = context.other.shape, (len(context.novel), -1)
    log_z = log_partition(
        context.theta0,
        context.known,
        context.novel_is_tail.reshape(per_model),
        context.relation.reshape(per_model),
        context.other.reshape(per_model),
    )
    weight = context.weight
    if queries.tails_only:
        weight = weight * context.novel_is_tail
    return Evidence(
        context.novel_is_tail,
        context.relation,
        context.other,
        weight,
        torch.zeros_like(weight),
        -log_z.view(shape),
    )


def crowd(context: InitContext, queries: KnownQueries, model: int, weight: float) -> Crowd | None:
    """The known queries of a model, to which its n novel entities are wrong answers; None if they
    are among the evidence.

    A query counts as often as it has known answers, times ``weight``, β, and s (``complete``).
    """
    theta = context.theta0
    if not weight or not isinstance(theta.model, RelationMapModel):
        return None
    unique = queries.unique
    given, relation = theta.entity[model, unique.given], theta.relation[model, unique.relation]
    return Crowd(
        theta.model.interaction,
        anchors(theta.model, unique.novel_is_tail[:, None], relation, given),
        -unique.log_z[model].float(),
        unique.answers[model].float(),
        (weight * complete(context)[model, :, None]).float(),
    )


def sampled_crowd(context: InitContext, queries: KnownQueries, weight: float) -> Evidence:
    """At most ``SAMPLE`` of the queries of ``crowd``, for a model without a map of relations."""
    unique = queries.unique
    item, number = spread(unique.answers, SAMPLE)
    shape = (*context.novel.shape, item.shape[-1])
    times = weight * complete(context)[..., None] * number[:, None]
    offset = -unique.log_z.gather(1, item)
    return Evidence(
        unique.novel_is_tail[item][:, None].expand(shape),
        unique.relation[item][:, None].expand(shape),
        unique.given[item][:, None].expand(shape),
        torch.zeros_like(times),
        times,
        offset[:, None].expand(shape),
    )


@dataclass(frozen=True, kw_only=True)
class ByQuery(Evidence):
    """Weighted triples, of which each has a log Z, and queries about the novel entities, whose
    likely answers are the last triples (see ``QueryLoss``).
    """

    number: Tensor  #: of facts of each query; shape: (M, n, G), float64
    rest: Tensor  #: log Σ exp(score) of unlikely answers; shape: (M, n, G), float64
    right: Tensor  #: facts of these queries; shape: (M, n, C), float64
    likely: int  #: number of likely answers to each query

    def about(self, model: int, novel: Tensor) -> QueryLoss:
        """The queries about some novel entities, (B,), of a model."""
        of = model, novel
        return QueryLoss(self.number[of], self.rest[of], self.right[of], self.likely)


def evidence_by_query(
    context: InitContext, queries: KnownQueries, at: Tensor, weight: float
) -> ByQuery:
    """The evidence of novel entities near vectors ``at``, (M, n, d), which say what is likely;
    ``weight``: see ``crowd``.
    """
    parts = [facts(context, queries)]
    if weight and not isinstance(context.theta0.model, RelationMapModel):
        parts.append(sampled_crowd(context, queries, weight))
    number, likely, rest = queries_about(context, queries, at)
    every = joined([*parts, likely])
    offsets = [torch.as_tensor(part.offset) for part in (*parts, likely)]
    right = torch.zeros_like(every.positive)
    right[..., : context.observed.shape[-1]] = _number_of_queries(context, queries)
    each = likely.other.shape[-1] // number.shape[-1]
    listed = vars(replace(every, offset=torch.cat(offsets, -1)))
    return ByQuery(**listed, number=number, rest=rest, right=right, likely=each)


def queries_about(
    context: InitContext, queries: KnownQueries, at: Tensor
) -> tuple[Tensor, Evidence, Tensor]:
    """The queries (v, r, ?) and (?, r, v) of the insert triples: their numbers of facts, (M, n, G);
    the likely candidates of all, one query after the other; log Σ exp(score) of the others,
    (M, n, G).
    """
    relations = context.theta0.relation.shape[1]
    number, slot = slots_of(context, _number_of_queries(context, queries))
    most = max(1, int((number > 0).sum(-1).max()))
    number, slot = number[..., :most], slot[..., :most]
    place, rest = _likely_candidates(context, slot, at)
    slot = slot[..., None].expand(place.shape).flatten(2)
    none = torch.zeros(slot.shape, dtype=torch.float64)
    likely = Evidence(slot >= relations, slot % relations, place.flatten(2), none, none, none)
    return number, likely, rest


def _likely_candidates(context: InitContext, slot: Tensor, at: Tensor) -> tuple[Tensor, Tensor]:
    """Ids of the known entities of highest score in queries about vectors ``at``, (M, n, d), by
    ``slot``, (M, n, G): (M, n, G, S); and log Σ exp(score) of the others, (M, n, G).
    """
    theta, (models, new, most) = context.theta0, slot.shape
    relations = theta.relation.shape[1]
    given = at[:, :, None].expand(-1, -1, most, -1).flatten(1, 2).to(theta.entity.dtype)
    novel_is_tail, relation = slot.flatten(1) >= relations, slot.flatten(1) % relations
    number = min(CANDIDATES, int(context.known.sum(1).min()))
    place = torch.zeros(models, new * most, number, dtype=torch.int64)
    rest = torch.zeros(models, new * most, dtype=torch.float64)
    for part, is_tail in parts_of_sides(novel_is_tail, context.known.numel()):
        vectors, row = rows(given, part), rows(theta.relation, relation.gather(1, part))
        score = theta.model.score_heads if is_tail else theta.model.score_tails
        scores = score(vectors, row, theta.entity).masked_fill(~context.known[:, None], -torch.inf)
        best = scores.topk(number, sorted=False).indices
        others = scores.scatter(2, best, -torch.inf).double().logsumexp(-1)
        of_side = novel_is_tail.gather(1, part) == is_tail
        index = part[..., None].expand(best.shape)
        place.scatter_(1, index, torch.where(of_side[..., None], best, place.gather(1, index)))
        rest.scatter_(1, part, torch.where(of_side, others, rest.gather(1, part)))
    size = models, new, most
    return place.view(*size, number), rest.view(size)


def _number_of_queries(context: InitContext, queries: KnownQueries) -> Tensor:
    """Number of queries about the novel entity with each insert triple as right answer."""
    weight = context.weight
    return weight * ~context.novel_is_tail if queries.tails_only else weight
