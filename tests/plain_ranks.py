"""The rule of ranks a second time: one comparison after another."""

from collections.abc import Callable, Collection, Iterable, Sequence


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


def filtered_rank(
    score: Callable[..., float],
    triple: Sequence[int],
    slot: int,
    candidates: Iterable[int],
    true: Collection[tuple[int, ...]],
    tie: float = 0.0,
) -> float:
    """The rank of an answer among candidates that do not give another true triple;
    each is scored alone.
    """
    others = {(*triple[:slot], each, *triple[slot + 1 :]) for each in candidates} - {tuple(triple)}
    scores = [score(*other) for other in sorted(others) if other not in true]
    return plain_rank(scores, score(*triple), tie)
