"""The rule of ranks a second time: one comparison after another."""

from collections.abc import Iterable


def won(score: float, answer: float, tie: float = 0.0) -> float:
    """What a competitor counts: 1 above the answer, ½ if it is at most ``tie`` away from it."""
    if abs(score - answer) <= tie:
        return 0.5
    return float(score > answer)


def plain_rank(competitors: Iterable[float], answer: float, tie: float = 0.0) -> float:
    """The rank of an answer's score among the scores of its competitors."""
    rank = 1.0
    for score in competitors:
        rank += won(score, answer, tie)
    return rank
