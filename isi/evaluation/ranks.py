"""Ranks of answers among candidates, by scores alone.

A rank is 1 + the number of competitors whose scores are above the answer's; a tie counts ½.
Sums of halves are exact in floating point, so the order of counting changes no rank.
"""

from typing import Literal

import torch
from torch import Tensor

#: Scores closer to the answer's than this times the largest magnitude among them are tied.
TIE = 1e-5
#: Maximum number of scores in one table; more queries are ranked in parts.
BUDGET = 2**24

#: How a score is compared with the answer's. ``bounds``: with the answer's ± the tolerance of a
#: tie. ``gap``: their difference with ± the tolerance, as the experiments' numbers were computed.
#: Ranks differ only where rounding at the edge of a tie decides.
Ties = Literal["bounds", "gap"]


def parts(queries: Tensor, scores: int, dim: int = 0) -> tuple[Tensor, ...]:
    """Queries in parts along an axis, such that ``scores`` numbers for each fit into ``BUDGET``;
    at least one query each.
    """
    return torch.split(queries, max(1, BUDGET // scores), dim)


def scores_of(ids: Tensor, scores: Tensor) -> Tensor:
    """The scores of one candidate of each query; shapes (...), (..., C), result (...)."""
    return scores.gather(-1, ids[..., None])[..., 0]


def compare_with(scores: Tensor, answer: Tensor, ties: Ties = "bounds") -> tuple[Tensor, Tensor]:
    """Masks of the candidates that score above the answer, and of those that score above it or
    are tied; shapes (..., C).

    Args:
        scores: of the candidates, one or more; shape (..., C).
        answer: score of each answer, which may be a candidate or not; shape (...).
        ties: how they are compared. The tolerance is ``TIE`` times the largest magnitude among
            ``scores`` and ``answer``. NaN is tied with all: a diverged model is at chance.
    """
    tie = (TIE * torch.maximum(scores.abs().amax(-1), answer.abs()))[..., None]
    answer = answer[..., None]
    if ties == "gap":
        scores, answer = scores - answer, torch.zeros_like(answer)
    return scores > answer + tie, ~(scores < answer - tie)


def wins(scores: Tensor, answer: Tensor, ties: Ties = "bounds") -> Tensor:
    """What each candidate counts in a rank, in halves: 2 if it scores above the answer, 1 if tied,
    else 0; shape (..., C), uint8. The arguments are those of ``compare_with``.

    Example:
        >>> wins(torch.tensor([3.0, 1.0, 2.0, 1.0]), torch.tensor(1.0))
        tensor([2, 1, 2, 1], dtype=torch.uint8)
    """
    above, not_below = compare_with(scores, answer, ties)
    return above.byte() + not_below


def ahead(scores: Tensor, answer: Tensor, competes: Tensor) -> Tensor:
    """Number of competitors whose scores exceed the answer's, a tie counts ½: the rank less 1;
    shape (...).

    ``competes`` is a mask of the candidates, (..., C); further arguments are those of
    ``compare_with``. Scores of other candidates count for the tolerance of a tie alone.

    Example:
        >>> scores = torch.tensor([3.0, 1.0, 2.0, 1.0])
        >>> ahead(scores, scores[1], torch.tensor([True, False, False, True]))
        tensor(1.5000)
    """
    return (wins(scores, answer) * competes).sum(-1) / 2
