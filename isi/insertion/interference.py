"""Interference: how far new entities push the answers to earlier queries down."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from isi.evaluation.filtered import end_queries
from isi.evaluation.ranks import parts, scores_of, wins
from isi.graph.graph import HEAD, TAIL
from isi.initializers.context import trained_session
from isi.models.stack import Embedding
from isi.random import stream
from isi.vocabulary import Vocabulary


@dataclass(frozen=True)
class RankChange:
    """A query whose known answer now ranks below a new entity.
    Ranks are filtered, as in ``Interference``.
    """

    query: tuple[str | int, ...]  #: head, relation and tail, with ``?`` in place of the answer
    answer: str | int
    rank_old: float  #: among old candidates
    rank_cur: float  #: among all candidates
    new: str | int  #: the new entity with the highest score among those above the answer


@dataclass(frozen=True)
class Interference:
    """Effect of new entities on the ranks of known answers.
    Each queried triple gives a head and a tail query.

    Old candidates are the entities before the insertion; all candidates include the new ones.
    Candidates that make another true triple are left out (filtered ranks), and a tie counts ½.
    ``h_old`` and ``h_cur`` are H_old and H_cur of MEOR (Ren, Gao and Jiang 2026), which calls their
    difference D.
    """

    queries: int
    #: for each new entity, the share of queries in which it scores above the known answer; queries
    #: that it answers itself by a true triple count 0
    above: list[float]
    h_old: float  #: mean reciprocal rank of known answers among old candidates
    h_cur: float  #: among all candidates
    rank_old: float  #: mean rank of known answers among old candidates
    rank_cur: float  #: among all candidates: ``rank_old`` + the sum of ``above``
    changes: list[RankChange]  #: queries whose reciprocal rank falls most, the largest fall first


def interference_of(
    embedding: Embedding,
    names: Vocabulary,
    labels: Vocabulary,
    queried: np.ndarray,
    true: Sequence[np.ndarray],
    old: int,
    most: int,
    seed: int,
    show: int,
) -> Interference:
    """The interference of all entities from the id ``old`` on with triples of earlier ones.

    Args:
        queried: triples of earlier entities, ids, (Q, 3); above ``most``, a random sample of this
            size (``seed``).
        true: further true triples for the filter, (T, 3) each.
        show: maximum number of ``changes``.
    """
    if len(queried) > most:
        queried = queried[np.sort(stream(seed, "interference").permutation(len(queried))[:most])]
    before, after, highest, above = ranks_of(
        embedding, np.concatenate([queried, *true]), len(queried), old
    )
    falls, changes = 1 / before - 1 / after, list[RankChange]()
    for place in torch.argsort(falls, descending=True, stable=True)[
        : min(show, int((falls > 0).sum()))
    ].tolist():
        slot, (head, relation, tail) = (
            (HEAD, TAIL)[place // len(queried)],
            queried[place % len(queried)].tolist(),
        )
        query = [names.of(head), labels.of(relation), names.of(tail)]
        answer, query[slot] = query[slot], "?"
        ranks = before[place].item(), after[place].item()
        changes.append(RankChange(tuple(query), answer, *ranks, names.of(int(highest[place]))))
    return Interference(
        len(before),
        (above / len(before)).tolist(),
        (1 / before).mean().item(),
        (1 / after).mean().item(),
        before.mean().item(),
        after.mean().item(),
        changes,
    )


def ranks_of(
    embedding: Embedding, true: np.ndarray, queried: int, old: int
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Filtered ranks of the answers to the head queries, then the tail queries,
    of the first triples of ``true``.

    Args:
        true: triples of the filter, (T, 3), of which the first ``queried`` are queried.
        old: number of old entities, the first rows.

    Returns:
        ranks among old and among all entities, and the id of the new entity with the highest score
        above the answer, (2 · queried,) each; for each new entity, the number of answers that it is
        above, (E - old,).
    """
    graph, ranks = trained_session(true, embedding).graph, list[tuple[Tensor, ...]]()
    above = torch.zeros(len(graph.entities) - old, dtype=torch.float64)
    for part in parts(torch.arange(queried), 2 * len(graph.entities)):
        queries = end_queries(graph, part[None])
        scores = queries.scores(embedding, embedding.entity)
        answer = scores_of(queries.answers, scores)
        # apart, so that the tolerance of a tie among old candidates does not depend on the new ones
        before = queries.ranks(scores[..., :old]).double()
        # the answer comes first and does not compete: a candidate, even if no entity is new
        new = torch.cat([answer[..., None], scores[..., old:]], -1)
        competes = pad(~queries.right[..., old:], (1, 0))
        added = wins(new, answer) * competes / 2
        highest = new.masked_fill(added == 0, -torch.inf).argmax(-1) - 1 + old
        ranks.append((before, before + added.sum(-1), highest))
        above += added[..., 1:].sum((0, 1, 2))
    before, after, highest = (torch.cat(each, -1).flatten() for each in zip(*ranks, strict=True))
    return before, after, highest, above
