"""A random graph of any size: an epoch on it and a ranking, by a process that reports what they took.

python -m tests.growth 10000 100000 --form lists
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable
from timeit import Timer

import numpy as np
import torch

from isi import lessons, paths, ranking, training
from isi.embeddings.stack import uniform
from isi.graph import Graph
from isi.params import load
from isi.sessions import TEST, TRAIN, VALID, joint_session, split
from tests.houses import peak_mib

RELATIONS = 3
#: The share of an entity among heads (or tails) falls with this power of its place.
POWER = 0.75
TEST_TRIPLES = 200
#: ``lessons.TABLE_CELLS`` that makes every graph take a form.
CELLS = {"tables": 2**62, "lists": 0}


def power_law_graph(entities: int, triples: int, seed: int = 0) -> Graph:
    """Unique triples, each observed once, in which few entities have most of the edges."""
    rng = np.random.default_rng(seed)
    share = np.arange(1, entities + 1) ** -POWER
    as_tail = rng.permutation(entities)
    code = np.empty(0, dtype=np.int64)
    while len(code) < triples:
        head, tail = rng.choice(entities, (2, triples), p=share / share.sum())
        code = np.unique(
            np.append(code, (rng.integers(RELATIONS, size=triples) * entities + head) * entities + as_tail[tail])
        )
    code = rng.permutation(code)[:triples]
    ids = np.stack([code // entities % entities, code // entities**2, code % entities], 1)
    names = [f"entity {number}" for number in range(entities)]
    relations = [f"relation {number}" for number in range(RELATIONS)]
    return Graph(names, relations, torch.from_numpy(ids), torch.ones(triples, dtype=torch.int64))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("entities", type=int)
    parser.add_argument("triples", type=int)
    parser.add_argument("--form", choices=CELLS, required=True)
    given = parser.parse_args()
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    lessons.TABLE_CELLS = CELLS[given.form]
    params, keys = load(paths.PARAMS), torch.zeros(1, 2, dtype=torch.int64)
    graph = power_law_graph(given.entities, given.triples)
    shares = params.sessions.valid, params.sessions.test
    session = joint_session(graph, torch.from_numpy(split(graph, params.seed, 0, *shares))[None])
    lesson = lessons.lesson(session, "training", keys, params.negatives.head_pool)
    size, half_range = params.embedding.dimension, params.embedding.init_range
    state = training.start(uniform(session.entities, RELATIONS, size, half_range, params.seed, keys))
    asked = session.members(TEST)
    asked &= asked.cumsum(1) <= TEST_TRIPLES

    def epoch() -> None:
        training.run_epoch(state, lesson, params.negatives, params.training, params.seed, 1)

    def rank() -> None:
        learned = session.members(TRAIN, VALID)
        queries = ranking.prepare(session, ranking.query_slots(asked), asked, learned, session.entities)
        ranking.evaluate(state.embedding, {"test": queries})

    before = peak_mib(os.getpid())
    epoch_seconds, training_mib = seconds(epoch), peak_mib(os.getpid())
    print(json.dumps({
        "entities": given.entities, "triples": given.triples, "form": given.form,
        "observations": int(lesson.counts.sum()), "epoch_seconds": epoch_seconds, "ranked": int(asked.sum()),
        "ranking_seconds": seconds(rank), "before_mib": before, "training_mib": training_mib,
        "peak_mib": peak_mib(os.getpid()),
    }))  # fmt: skip


def seconds(work: Callable[[], None]) -> float:
    """Of one call: the mean of as many as take a fifth of a second."""
    calls, total = Timer(work).autorange()
    return total / calls


if __name__ == "__main__":
    main()
