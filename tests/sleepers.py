"""A stage that never ends: workers that note their process ids and sleep, for tests that kill it."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import torch

from isi.experiments.cells import Cells
from isi.experiments.executor import run
from isi.graph import Graph
from isi.lifetime import tie_to_parent
from isi.params import Compute

WORKERS = 2


def sleep(task: Cells) -> None:
    """Note this process in the folder that the task's graph is named after, and sleep."""
    Path(task.graph.entities[0], str(os.getpid())).touch()
    time.sleep(300)


def main(folder: str) -> None:
    tie_to_parent()
    graph = Graph([folder], [], torch.zeros((0, 3), dtype=torch.int64), torch.zeros(0, dtype=torch.int64))
    nothing = np.zeros((1, 0), dtype=np.int8)
    tasks = [Cells(graph, 1, [seed], nothing, nothing) for seed in range(WORKERS)]
    run(sleep, tasks, Compute(workers=WORKERS, stack=1), "sleeping")
