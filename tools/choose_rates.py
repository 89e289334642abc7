"""Compare batch sizes and learning rates on validation MRR*; those in params.yaml were chosen so.

The score of training is the joint model's best validation MRR*. The score of fine-tuning is
validation MRR* on D¹, averaged over every tenth epoch and the paper's initializers. Test triples
enter only the counts for true ranks.
"""

import argparse
from itertools import product

import numpy as np
import pandas as pd
from torch import Tensor

from isi.evaluation.query_sets import validation
from isi.evaluation.ranking import evaluate
from isi.experiment.grid import GridPoints
from isi.experiment.insert import InsertConfig, finetune, initialize, with_vectors
from isi.experiment.runner import run
from isi.experiment.store import Store
from isi.experiment.train import TrainConfig, train_stack
from isi.initializers.api import INITIALIZERS
from isi.models.stack import Embedding
from isi.params import load
from isi.training.trainer import never_stop

#: Epochs between two measurements of validation MRR*.
EVERY = 10


def fine_tune(
    points: GridPoints, theta0: Embedding, words: np.ndarray, config: InsertConfig
) -> float:
    """Mean validation MRR* of one initializer during fine-tuning,
    over models and every ``EVERY``-th epoch.
    """
    valid, measured = validation(points.session(1)), []

    def watch(epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        if epoch and epoch % EVERY == 0:
            measured.append(evaluate(embedding, valid)["valid"].measures[:, 0].numpy())
        return never_stop(epoch, embedding, models)

    initial = initialize(points, theta0, words, config)
    finetune(points, with_vectors(theta0, points.novel_in(1), initial.vectors), config, watch)
    return float(np.mean(measured))


def best_valid(points: GridPoints, config: TrainConfig) -> np.ndarray:
    """Best validation MRR* of each joint model; shape (M,)."""
    return train_stack(points, config).log.groupby("seed")["mrr_star"].max().to_numpy()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--experiment", help="default: the first one in params")
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--size", type=int, default=5)
    parser.add_argument("--batches", type=int, nargs="+", default=[2048])
    parser.add_argument("--training", type=float, nargs="+", default=[0.05, 0.1, 0.2, 0.4])
    parser.add_argument(
        "--finetuning", type=float, nargs="+", default=[0.01, 0.02, 0.04, 0.08, 0.16]
    )
    given = parser.parse_args()
    params = load()
    store = Store(given.experiment or next(iter(params.experiments)))
    single = store.grid(1, given.size, given.seeds)
    grid = list(product(given.batches, given.training))
    joint = [points.all_known for points in single]
    settings = [
        params.training.model_copy(update={"batch_size": b, "learning_rate": rate})
        for b, rate in grid
    ]
    tasks = [
        (points, params.train_config(training=training))
        for training in settings
        for points in joint
    ]
    measured = np.concatenate(run(best_valid, tasks, params.compute, "training"))
    show("training", grid, measured.reshape(len(grid), -1).mean(1))
    chosen = params.train_config()
    theta0 = run(train_stack, [(points, chosen) for points in single], params.compute, "theta0")
    words, grid = store.words(), list(product(given.batches, given.finetuning))
    names = [
        name
        for name in params.initializers
        if INITIALIZERS.get(name, name).role in ("paper", "isi")
    ]
    tuned = [
        (
            points,
            trained.theta,
            words,
            params.insert_config(name).training(batch_size=batch, learning_rate=rate),
        )
        for (batch, rate), (points, trained), name in product(
            grid, zip(single, theta0, strict=True), names
        )
    ]
    means = np.reshape(run(fine_tune, tuned, params.compute, "fine-tuning"), (len(grid), -1)).mean(
        1
    )
    show("fine-tuning", grid, means)


def show(name: str, grid: list[tuple[int, float]], mrr_star: np.ndarray) -> None:
    table = pd.DataFrame(grid, columns=["batch size", "learning rate"]).assign(value=100 * mrr_star)
    print(f"\n{name}: validation MRR* (points)")
    print(
        table.pivot(index="batch size", columns="learning rate", values="value")
        .round(2)
        .to_string()
    )


if __name__ == "__main__":
    main()
