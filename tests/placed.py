"""Insert entities into an embedding of random numbers, in a process of its own; tells seconds and peak memory."""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import numpy as np
import torch

import isi
from tests.houses import peak_mib

RELATIONS, TOLD = 237, 3


def place(entities: int, dimension: int, new: int, rounds: int, **how: Any) -> dict[str, Any]:
    """Seconds of each round, and the peak of this process's memory, tables included."""
    torch.set_num_threads(1)
    rng = np.random.default_rng(0)
    table, relations = (rng.standard_normal((rows, dimension), np.float32) for rows in (entities, RELATIONS))
    numbers = entities + np.arange(new).repeat(TOLD)
    told = np.stack([numbers, rng.integers(RELATIONS, size=TOLD * new), rng.integers(entities, size=TOLD * new)], 1)
    seconds = []
    for _ in range(rounds):
        start = time.perf_counter()
        done = isi.insert(table, relations, told, new=new, model="complex", **how)
        seconds.append(time.perf_counter() - start)
        initializer = done.initializer
        del done
    return {"initializer": initializer, "seconds": float(np.median(seconds)), "peak_mib": peak_mib()}


if __name__ == "__main__":
    print(json.dumps(place(**json.loads(sys.argv[1]))))
