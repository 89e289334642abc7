"""A random graph of any size: an epoch on it and a ranking, by a process that reports what they took.

python -m tests.growing_graph 10000 100000 --form lists
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from timeit import Timer

import numpy as np
import torch

from isi import config
from isi.evaluation.ranking import evaluate, make_queries, padded_ids
from isi.graph.graph import Graph
from isi.graph.sessions import TEST, TRAIN, VALID, Shares, session_of, split
from isi.models.model import EmbeddingParams, make_model
from isi.models.stack import uniform
from isi.tables import paths
from isi.training import batches, trainer
from tests.houses import peak_mib

RELATIONS = 3
#: The share of an entity among heads (or tails) falls with this power of its place.
POWER = 0.75
TEST_TRIPLES = 200
#: ``batches.DENSE_LIMIT`` that makes every graph take a form.
LIMITS = {"tables": 2**62, "lists": 0}


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
    kinds = torch.zeros(len(names), dtype=torch.int64)
    return Graph(names, relations, torch.from_numpy(ids), torch.ones(triples, dtype=torch.int64), kinds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("entities", type=int)
    parser.add_argument("triples", type=int)
    parser.add_argument("--form", choices=LIMITS, required=True)
    given = parser.parse_args()
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    batches.DENSE_LIMIT = LIMITS[given.form]
    graph, keys, root = power_law_graph(given.entities, given.triples), torch.zeros(1, 2, dtype=torch.int64), 0
    raw = config.read(paths.PARAMS)  # by section, since the whole of it loads sources, too
    how = config.check(raw["embedding"], EmbeddingParams, "embedding")
    negatives = config.check(raw["negatives"], batches.Negatives, "negatives")
    settings = config.check(raw["training"], trainer.Training, "training")
    shares = config.check(raw["sessions"], Shares, "sessions")
    model = make_model(how.model, raw["models"][how.model], f"models.{how.model}")
    session = session_of(graph, torch.from_numpy(split(graph, root, 0, shares.valid, shares.test))[None])
    data = batches.training_data(session, "training", keys, negatives.head_pool)
    state = trainer.start(uniform(session.entities, RELATIONS, model, how.dimension, how.init_range, root, keys))
    asked = session.members(TEST)
    asked &= asked.cumsum(1) <= TEST_TRIPLES

    def epoch() -> None:
        trainer.run_epoch(state, data, negatives, settings, root, 1)

    def rank() -> None:
        learned = session.members(TRAIN, VALID)
        queries = make_queries(session, padded_ids(asked), asked, learned, session.entities)
        evaluate(state.embedding, {"test": queries})

    before = peak_mib()
    epoch_seconds, training_mib = seconds(epoch), peak_mib()
    print(json.dumps({
        "entities": given.entities, "triples": given.triples, "form": given.form, "relations": RELATIONS,
        "observations": int(data.counts.sum()), "epoch_seconds": epoch_seconds, "ranked": int(asked.sum()),
        "ranking_seconds": seconds(rank), "before_mib": before, "training_mib": training_mib,
        "peak_mib": peak_mib(),
    }))  # fmt: skip


def seconds(work: Callable[[], None]) -> float:
    """Of one call: the mean of as many as take a fifth of a second."""
    calls, total = Timer(work).autorange()
    return total / calls


if __name__ == "__main__":
    main()
