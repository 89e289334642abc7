"""A stage that never ends: its workers write their process ids and sleep,
for tests that kill it.
"""

import os
import time
from pathlib import Path

import numpy as np
import torch

from isi.graph.graph import Graph
from isi.process import errors_in_one_line, tie_to_parent
from stages.grid import GridPoints
from stages.runner import Compute, run

WORKERS = 2


def sleep(points: GridPoints) -> None:
    """Write this process id into the folder ``points.experiment``, and sleep."""
    Path(points.experiment, str(os.getpid())).touch()
    time.sleep(300)


def main(folder: str) -> None:
    tie_to_parent()
    with errors_in_one_line("endless"):
        _sleep(folder)


def _sleep(folder: str) -> None:
    nothing = torch.zeros(0, dtype=torch.int64)
    graph = Graph([], [], torch.zeros((0, 3), dtype=torch.int64), nothing, nothing)
    splits = np.zeros((1, 0), dtype=np.int8)
    tasks = [
        (GridPoints.without_insertion(folder, graph, [seed], splits),) for seed in range(WORKERS)
    ]
    run(sleep, tasks, Compute(workers=WORKERS, stack=1), "sleeping")
