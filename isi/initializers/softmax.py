"""The evidence of MAP for an embedding that was trained with cross-entropy over entities.

The loss of a novel vector v is that of training (docs/method.md). As the answer to the query of an
insert triple, softplus(log Z - f). As a wrong answer to a known query, softplus(f - log Z) for each
of its known answers. As the given end of a query (v, r, ?), log Σ exp(f) over candidates, less f of
the known end. Here log Z is that of the known entities.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from isi.initializers.api import InitContext
from isi.initializers.evidence import Evidence, joined, spread
from isi.initializers.scale import KnownQueries, log_partition

#: Maximum number of known queries of a novel entity: those that it answers wrongly most.
RIVALS = 512
CANDIDATES = 128  #: Maximum number of candidates of a query with the novel entity as given end.


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
    observed = context.observed.double()
    if queries.tails_only:
        observed = observed * context.novel_is_tail
    return Evidence(
        context.novel_is_tail,
        context.relation,
        context.other,
        observed,
        torch.zeros_like(observed),
        -log_z.view(shape),
    )


def rivals(context: InitContext, queries: KnownQueries, at: Tensor, weight: float) -> Evidence:
    """The known queries to which vectors ``at``, (M, n, d), are the most likely wrong answers.

    ``weight``: β. A query counts as often as it has known answers, times β and s, which is as in
    ``corrupted_known``.
    """
    mean = 2 * context.trained.sum(-1).double() / context.known.sum(-1)
    complete = (context.observed.sum(-1) / mean[:, None]).nan_to_num(0).clamp(max=1)
    times = weight * complete[..., None] * queries.answers[:, None]
    odds = queries.scores(context.theta0, at).double() - queries.log_z[:, None]
    most = min(RIVALS, odds.shape[-1])
    place = (times * torch.sigmoid(odds)).topk(most, sorted=False).indices
    negative = times.gather(-1, place)
    log_z = queries.log_z[:, None].expand(odds.shape).gather(-1, place)
    return Evidence(
        queries.novel_is_tail[place],
        queries.relation[place],
        queries.other[place],
        torch.zeros_like(negative),
        negative,
        -log_z,
    )


@dataclass(frozen=True)
class ByQuery(Evidence):
    """Weighted triples, of which each has a log Z, and queries about the novel entities."""

    #: number of facts (v, r, ?) that a triple is; shape: (M, n, C), float64
    answers: Tensor | float = 0.0
    #: numbers of facts of G queries (v, r, ?), whose candidates are the last triples; shape: (M, n,
    #: G), float64
    asked: Tensor | None = None
    candidates: int = 0  #: of each of these queries


def evidence_by_query(
    context: InitContext, queries: KnownQueries, at: Tensor | None, weight: float
) -> ByQuery:
    """The evidence of novel entities; ``rivals`` of vectors ``at``, (M, n, d), if given."""
    parts = [facts(context, queries)]
    if at is not None and weight:
        parts.append(rivals(context, queries, at, weight))
    asked, candidates = asked_of(context, queries)
    every = joined([*parts, candidates])
    answers = torch.zeros_like(every.positive)
    answers[..., : context.observed.shape[-1]] = _asked_about(context, queries)
    size = candidates.other.shape[-1] // asked.shape[-1]
    return ByQuery(**vars(every), answers=answers, asked=asked, candidates=size)


def asked_of(context: InitContext, queries: KnownQueries) -> tuple[Tensor, Evidence]:
    """The queries (v, r, ?) and (?, r, v) of the insert triples: their numbers of facts, (M, n, G),
    and the candidates of all, one query after the other.

    The candidates are evenly spaced known entities, each for as many as it stands for.
    """
    relations, shape = context.theta0.relation.shape[1], context.novel.shape
    number = torch.zeros(*shape, 2 * relations, dtype=torch.float64)
    slots = context.novel_is_tail * relations + context.relation
    number.scatter_add_(-1, slots, _asked_about(context, queries))
    number, slot = number.sort(dim=-1, descending=True, stable=True)
    most = max(1, int((number > 0).sum(-1).max()))
    number, slot = number[..., :most], slot[..., :most]
    ends, weight = spread(context.known.double(), CANDIDATES)
    size = *shape, most, ends.shape[-1]
    slot = slot[..., None].expand(size).flatten(2)
    other = ends[:, None, None].expand(size).flatten(2)
    offset = weight.log()[:, None, None].expand(size).flatten(2)
    none = torch.zeros_like(offset)
    return number, Evidence(slot >= relations, slot % relations, other, none, none, offset)


def _asked_about(context: InitContext, queries: KnownQueries) -> Tensor:
    """Number of queries about the novel entity with each insert triple as right answer."""
    observed = context.observed.double()
    return observed * ~context.novel_is_tail if queries.tails_only else observed
