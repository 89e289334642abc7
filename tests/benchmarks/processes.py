"""The work of benchmarks: each runs in its own process,
and reports seconds and peak memory as JSON.

python -m tests.benchmarks.processes grow_graph '{"entities": 10000, "triples": 100000, "form":
"lists"}'

Each function imports its own modules, so that its memory does not include modules of other
functions.
"""

import json
import re
import sys
import time
from collections import Counter
from collections.abc import Callable
from itertools import cycle
from pathlib import Path
from timeit import Timer
from typing import Any

RELATIONS = 3
FACTS = 10  #: Triples of a new entity that is inserted.
#: Entity number i is a head (or a tail) with a probability proportional to i to the power of minus
#: ``POWER``.
POWER = 0.75
TEST_TRIPLES = 200
#: Values of ``batches.DENSE_LIMIT`` with which batches of every graph take the form.
LIMITS = {"tables": 2**62, "lists": 0}


def peak_mib() -> int:
    """Peak resident memory of this process in MiB (Linux)."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(re.findall(r"VmHWM:\s+(\d+) kB", status)[0]) // 1024


def forget_peak() -> None:
    """Let the peak of memory start from what this process has now (Linux)."""
    Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")


def mine_houses(houses: int, table: str) -> dict[str, Any]:
    """Mine ``houses`` scenes: the recorded ones repeatedly,
    each time with new names of the scene and its objects.
    """
    from isi.config import read
    from isi.sources import settings_of
    from isi.sources.ai2thor import materials_of, mine
    from isi.sources.recordings import Scene, SceneObject, locate, read_recording
    from isi.tables import paths
    from stages.files import OBSERVATIONS
    from tests.observing import source_of

    def renamed(thing: SceneObject, house: int) -> SceneObject:
        receptacles, contents = (
            [f"{name}|{house}" for name in names] for names in (thing.receptacles, thing.contents)
        )
        return thing._replace(id=f"{thing.id}|{house}", receptacles=receptacles, contents=contents)

    start = time.perf_counter()
    _, settings = settings_of(read(paths.PARAMS)["sources"]["ai2thor"], "sources.ai2thor")
    recording = locate(settings["from_"])
    scenes = cycle(list(read_recording(recording, settings["sha256"])))
    made = (
        Scene(
            f"House{house}", house, scene.room, [renamed(thing, house) for thing in scene.objects]
        )
        for house, scene in zip(range(houses), scenes, strict=False)
    )
    source = source_of(mine(made, materials_of("suncg", 0), recording, Counter()))
    rows = OBSERVATIONS.write_parts(Path(table), source.frames(), "houses")
    return {
        "observations": rows,
        "seconds": round(time.perf_counter() - start, 1),
        "peak_mib": peak_mib(),
    }


def insert(
    entities: int,
    relations: int,
    triples: int,
    dimension: int,
    new: int,
    what: str,
    rounds: int,
) -> dict[str, Any]:
    """Insert ``new`` entities with ten insert triples each into a random ComplEx;
    median seconds of a core.

    ``triples``: number of known triples; ``what``: an initializer, ``fold_in`` after training with
    cross-entropy. Peak memory includes tables and triples.
    """
    import numpy as np
    import torch

    import isi

    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    rng, number = np.random.default_rng(0), FACTS * new
    tables = [
        np.float32(0.3) * rng.standard_normal((rows, dimension), np.float32)
        for rows in (entities, relations)
    ]
    known = np.stack(
        [rng.integers(0, most, triples) for most in (entities, relations, entities)], 1
    )
    ends = rng.integers(relations, size=number), rng.integers(entities, size=number)
    insert_triples = np.stack([entities + np.arange(new).repeat(FACTS), *ends], 1)
    forget_peak()
    seconds = []
    for _ in range(rounds + 1):  # the first one also imports modules
        start = time.process_time()
        given: dict[str, Any] = {"new": new, "model": "complex", "known_triples": known}
        if what == "fold_in":
            given["trained_with"] = "softmax"
        isi.insert(*tables, insert_triples, **given, initializer=what)
        seconds.append(time.process_time() - start)
    return {"seconds": float(np.median(seconds[1:])), "peak_mib": peak_mib()}


def grow_graph(entities: int, triples: int, form: str) -> dict[str, Any]:
    """Run an epoch and a ranking on a random graph with few entities of high degree (``POWER``)."""
    import numpy as np
    import torch

    from isi import config
    from isi.evaluation.ranking import evaluate, make_queries, padded_ids
    from isi.graph.graph import Graph
    from isi.graph.sessions import TEST, TRAIN, VALID, session_of, split
    from isi.models.model import EmbeddingParams, make_model
    from isi.models.stack import uniform
    from isi.tables import paths
    from isi.training import batches, trainer
    from stages.make_sessions import Shares

    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    batches.DENSE_LIMIT = LIMITS[form]
    rng = np.random.default_rng(0)
    share = np.arange(1, entities + 1) ** -POWER
    as_tail = rng.permutation(entities)
    code = np.empty(0, dtype=np.int64)
    while len(code) < triples:
        head, tail = rng.choice(entities, (2, triples), p=share / share.sum())
        drawn = (rng.integers(RELATIONS, size=triples) * entities + head) * entities + as_tail[tail]
        code = np.unique(np.append(code, drawn))
    code = rng.permutation(code)[:triples]
    ids = torch.from_numpy(
        np.stack([code // entities % entities, code // entities**2, code % entities], 1)
    )
    names = [[f"{number}" for number in range(count)] for count in (entities, RELATIONS)]
    graph = Graph(
        *names,
        ids,
        torch.ones(triples, dtype=torch.int64),
        torch.zeros(entities, dtype=torch.int64),
    )

    raw = config.read(paths.PARAMS)  # by section, since ``params.load`` also loads sources
    settings = config.check(raw["embedding"], EmbeddingParams, "embedding")
    negatives = config.check(raw["negatives"], batches.Negatives, "negatives")
    training = config.check(raw["training"], trainer.Training, "training")
    shares = config.check(raw["sessions"], Shares, "sessions")
    model = make_model(settings.model, raw["models"][settings.model], f"models.{settings.model}")
    keys, root = torch.zeros(1, 2, dtype=torch.int64), 0
    session = session_of(
        graph, torch.from_numpy(split(graph, root, 0, shares.valid, shares.test))[None]
    )
    data = batches.training_data(session, "training", keys)
    start = uniform(
        session.entities, RELATIONS, model, settings.dimension, settings.init_range, root, keys
    )
    state = trainer.start(start)
    queried = session.members(TEST)
    queried &= queried.cumsum(1) <= TEST_TRIPLES

    def rank() -> None:
        seen, triples = session.members(TRAIN, VALID), padded_ids(queried)
        queries = make_queries(session, triples, queried, seen, seen, session.entities)
        evaluate(state.embedding, {"test": queries})

    before = peak_mib()
    epoch_seconds = seconds_of(lambda: trainer.run_epoch(state, data, negatives, training, root, 1))
    training_mib = peak_mib()
    return {
        "entities": entities,
        "triples": triples,
        "form": form,
        "relations": RELATIONS,
        "observations": int(data.counts.sum()),
        "epoch_seconds": epoch_seconds,
        "ranked": int(queried.sum()),
        "ranking_seconds": seconds_of(rank),
        "before_mib": before,
        "training_mib": training_mib,
        "peak_mib": peak_mib(),
    }


def seconds_of(work: Callable[[], object]) -> float:
    """Mean seconds of a call, over a number of calls that take at least 0.2 seconds in total."""
    calls, total = Timer(work).autorange()
    return total / calls


if __name__ == "__main__":
    functions: list[Callable[..., dict[str, Any]]] = [
        mine_houses,
        insert,
        grow_graph,
    ]
    work = {function.__name__: function for function in functions}
    print(json.dumps(work[sys.argv[1]](**json.loads(sys.argv[2]))))
