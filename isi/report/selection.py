"""How large an indicator set should be (section 5.3)."""

from __future__ import annotations

from collections.abc import Sequence

#: Sizes whose epochs are averaged: each with the one before it and the one after.
NEIGHBOURS = 3
#: The set grows while this many epochs are gained, ...
EPOCHS = 1.0
#: ... and while MRR* is at most this far below the best.
LOSS = 0.01


def select_size(sizes: Sequence[int], mrr_star: Sequence[float], epochs: Sequence[float]) -> int:
    """The indicator set size that the paper's rule picks.

    The paper "increased the indicator set size while the average number of epochs for three neighboring
    sizes decreased by 1 epoch or the MRR* went 1% point below the best performance". Read here as: grow
    while the former holds, and stop before the latter. Where the wording is open, it is taken so:

    - Neighbours are those of the list, however far apart; the mean of a size is over it and its two
      neighbours. The first and the last size have no such mean, so growth is first asked for from the
      second size to the third, and the last size is never picked.
    - The best performance is that of the sizes up to this one: what a larger set would have does not
      count against a smaller one, and a rise at small sizes stops nothing.
    - The first size is picked where the second is too far below it, or where there are fewer than three.

    Args:
        sizes: ascending.
        mrr_star: immediate MRR* of each, in [0, 1].
        epochs: mean epochs to convergence of each.
    """
    means = [sum(epochs[place - 1 : place + 2]) / NEIGHBOURS for place in range(1, len(sizes) - 1)]
    picked = 0
    for place in range(1, len(sizes) - 1):
        too_low = mrr_star[place] < max(mrr_star[:place]) - LOSS
        no_gain = place > 1 and not means[place - 2] - means[place - 1] >= EPOCHS  # nor where there is no mean
        if too_low or no_gain:
            break
        picked = place
    return sizes[picked]
