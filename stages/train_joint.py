"""Train the joint model of every seed on all that has a split, and measure it in the scopes of every size."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from isi.base import paths, tables
from isi.base.stage import Given, stage
from isi.experiments.cells import JOINT, Vectors
from isi.experiments.executor import compute_of, run, stack_height
from isi.experiments.judging import JudgingTask, judge
from isi.experiments.learning import LearningTask, as_tensors, learn_joint, learning
from isi.experiments.store import Store


@stage
def train_joint(given: Given, experiment: str) -> None:
    """Train the joint model of every seed on all that has a split, and measure it in the scopes of every size."""
    store, how, compute = Store(experiment, given.provenance), learning(given), compute_of(given)
    cells, insert_triples = store.cells(stack_height(compute)), store.insert_triples()
    tasks = [
        LearningTask(replace(cell, size=JOINT, novel=cell.novel[:, :0]), how)
        for cell in cells
        if cell.size == cells[0].size  # once for each seed
    ]
    learned = run(learn_joint, tasks, compute, f"{experiment}, joint")
    tensors = as_tensors(tasks, learned)
    row = {seed: number for number, seed in enumerate(tensors["seed"].tolist())}
    judged = []
    for cell in cells:
        rows = [row[seed] for seed in cell.seeds]
        theta = Vectors(how.family, tensors["entity"][rows].numpy(), tensors["relation"][rows].numpy())
        judged.append(JudgingTask(cell, theta, store.insert_triples_of(cell, insert_triples)))
    runs = pd.concat(run(judge, judged, compute, f"{experiment}, joint, measured"))
    tables.write_tensors(paths.joint(experiment), tensors, given.provenance)
    store.write_log("joint", pd.concat(result.log for result in learned))
    store.write_runs("joint", runs)


if __name__ == "__main__":
    train_joint()
