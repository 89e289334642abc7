"""Compare batch sizes and learning rates on validation MRR*, as params.yaml's were chosen.

Training is judged by the joint model's best validation MRR*; fine-tuning by validation MRR* on D¹
averaged over all initializers but the controls and over epochs, so that none is favoured. No test triple is looked at.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pandas as pd
import torch

from isi import lessons, params, paths, ranking, training
from isi.experiments import learning
from isi.experiments.cells import JOINT
from isi.experiments.executor import run
from isi.experiments.insertion import FineTuning, InsertTask, insertion_of, put
from isi.experiments.learning import Learning, LearningTask
from isi.experiments.store import Store, insert_triples_of
from isi.initializers import INITIALIZERS
from isi.report.tables import CONTROLS
from isi.tables import Provenance


@dataclass(frozen=True)
class TuningTask(InsertTask):
    """Fine-tune with given settings and look at validation MRR* every ``every`` epochs."""

    every: int


def fine_tune(task: TuningTask) -> float:
    """Mean validation MRR* of an initializer's Θ¹ over models and epochs."""
    session, how = task.joint, task.tuning
    insertion = insertion_of(task)
    initial = INITIALIZERS[task.initializer](insertion, **task.options)
    state = training.start(put(insertion.theta0, torch.from_numpy(task.novel), initial.vectors))
    lesson = lessons.lesson(session, "fine-tuning", task.keys, how.negatives.head_pool)
    valid, looks = ranking.validation(session), []
    for epoch in range(1, how.optimizer.max_epochs + 1):
        training.run_epoch(state, lesson, how.negatives, how.optimizer, how.root, epoch)
        if epoch % task.every == 0:
            looks.append(ranking.evaluate(state.embedding, valid)["valid"].measures[:, 0].numpy())
    return float(np.mean(looks))


def best_valid(task: LearningTask) -> np.ndarray:
    """Best validation MRR* of each joint model."""
    log = learning.learn_joint(task).log
    return log.groupby("seed")["mrr_star"].max().to_numpy()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--size", type=int, default=5)
    parser.add_argument("--batches", type=int, nargs="+", default=[2048])
    parser.add_argument("--training", type=float, nargs="+", default=[0.05, 0.1, 0.2, 0.4])
    parser.add_argument("--finetuning", type=float, nargs="+", default=[0.01, 0.02, 0.04, 0.08, 0.16])
    given = parser.parse_args()
    settings = params.load(paths.PARAMS)
    store = Store("ai2thor", Provenance("choose_rates", {}))
    cell = next(cell for cell in store.cells(given.seeds) if cell.size == given.size)
    single = [
        replace(cell, seeds=[s], splits=cell.splits[[i]], novel=cell.novel[[i]]) for i, s in enumerate(cell.seeds)
    ]

    def how(batch: int, rate: float) -> Learning:
        optimizer = settings.training.model_copy(update={"batch_size": batch, "learning_rate": rate})
        return Learning(settings.seed, settings.embedding, settings.negatives, optimizer)

    grid = list(product(given.batches, given.training))
    tasks = [LearningTask(**vars(replace(c, size=JOINT)), learning=how(*point)) for point in grid for c in single]
    looks = np.concatenate(run(best_valid, tasks, settings.compute, "training"))
    show("training", grid, looks.reshape(len(grid), -1).mean(1))

    chosen = how(settings.training.batch_size, settings.training.learning_rate)
    theta0 = run(
        learning.learn_initial,
        [LearningTask(**vars(c), learning=chosen) for c in single],
        settings.compute, "theta0",
    )  # fmt: skip
    table, (words,) = store.insert_triples(), store.tensors(paths.vectors("ai2thor"), "vectors")
    grid = list(product(given.batches, given.finetuning))
    tuned = [
        TuningTask(
            **vars(c), embedding=(learned.entity, learned.relation), insert_triples=insert_triples_of(c, table),
            initializer=name, options=settings.initializers.options(name), words=words, joint_mrr_star={}, every=10,
            tuning=FineTuning(
                settings.seed, settings.negatives,
                settings.finetuning.model_copy(update={"batch_size": batch, "learning_rate": rate}),
                settings.convergence.margin, [],
            ),
        )
        for batch, rate in grid
        for c, learned in zip(single, theta0, strict=True)
        for name in settings.insert.initializers
        if name not in CONTROLS
    ]  # fmt: skip
    show(
        "fine-tuning", grid, np.reshape(run(fine_tune, tuned, settings.compute, "fine-tuning"), (len(grid), -1)).mean(1)
    )


def show(name: str, grid: list[tuple[int, float]], mrr_star: np.ndarray) -> None:
    table = pd.DataFrame(grid, columns=["batch size", "learning rate"]).assign(value=100 * mrr_star)
    print(f"\n{name}: validation MRR*")
    print(table.pivot(index="batch size", columns="learning rate", values="value").round(2).to_string())


if __name__ == "__main__":
    main()
