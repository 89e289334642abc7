"""The order of insertion of new entities that have triples with each other."""

from collections.abc import Iterator

import numpy as np

from isi.graph.graph import HEAD, TAIL

ROUNDS = 3  #: Number of times that such entities are inserted.


def layers(triples: np.ndarray, known: int, number: int) -> np.ndarray:
    """Fewest triples between each of ``number`` new entities and a known one, minus 1;
    0 if there is no path; (n,).

    ``triples``: ids, (T, 3); new entities have the ids from ``known`` on.
    """
    ends = triples[:, [HEAD, TAIL]] - known
    layer = np.full(number, number)
    layer[ends[(ends >= 0).sum(1) == 1].max(1)] = 0
    between = ends[(ends >= 0).all(1)]
    for _ in range(number):
        nearer = layer.copy()
        np.minimum.at(nearer, between, layer[between[:, ::-1]] + 1)
        if (nearer == layer).all():
            break
        layer = nearer
    return np.where(layer < number, layer, 0)


def schedule(
    triples: np.ndarray, known: int, number: int, repeat: bool
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Ids of new entities, (m,), and a mask of their triples, (T,), step by step.
    The last step has all new entities.

    The first round inserts layer by layer, from triples with known entities and with earlier
    layers. In later rounds (``repeat``, or if two new entities have a triple) all are inserted
    together from all triples, each with the vectors that the others had before.
    """
    everyone, ends = np.arange(known, known + number), triples[:, [HEAD, TAIL]]
    proper = ends[:, 0] != ends[:, 1]
    if repeat or ((ends >= known).all(1) & proper).any():
        layer = np.concatenate([np.full(known, -1), layers(triples[proper], known, number)])
        of_ends = layer[ends]
        for step in range(int(layer.max()) + 1):
            yield (
                everyone[layer[known:] == step],
                (of_ends.max(1) == step) & (of_ends.min(1) < step),
            )
        for _ in range(ROUNDS - 2):
            yield everyone, proper
    yield everyone, proper
