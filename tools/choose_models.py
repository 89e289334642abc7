"""Compare batch sizes, learning rates, weight decays, margins and norms of embedding models;
those in params.yaml were chosen so.

Each setting trains the joint model with a few seeds; its score is the best validation MRR*,
averaged over seeds. No test triple is used. Writes the table of the documentation.
"""

import argparse
from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
import pandas as pd

from isi.experiment.grid import GridPoints
from isi.experiment.runner import run
from isi.experiment.store import Store
from isi.experiment.train import TrainConfig, train_stack
from isi.models.model import make_model
from isi.params import load
from tools.docs import write_table


def best_valid(points: GridPoints, config: TrainConfig) -> np.ndarray:
    """Best validation MRR* of each joint model; shape (M,)."""
    return train_stack(points, config).log.groupby("seed")["mrr_star"].max().to_numpy()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--models", nargs="+", help="default: all")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--batches", type=int, nargs="+", help="batch sizes (that of params)")
    parser.add_argument("--rates", type=float, nargs="+", default=[0.05, 0.1, 0.2])
    parser.add_argument("--decays", type=float, nargs="+", default=[0.0, 1e-4, 1e-3])
    parser.add_argument("--margins", type=float, nargs="+", default=[0.5, 1.0, 2.0, 4.0, 8.0])
    given = parser.parse_args()
    params = load()
    experiment = params.compare_models.experiment or next(iter(params.experiments))
    joint = Store(experiment).grid(given.seeds, seeds=given.seeds)[0].all_known
    of_training = {"learning_rate": given.rates, "weight_decay": given.decays}
    of_training |= {"batch_size": given.batches} if given.batches else {}
    of_model = {"margin": given.margins, "squared": [False, True]}
    rows, tasks = [], []
    for name in given.models or params.models:
        options = params.models[name]
        choices = {key: values for key, values in of_model.items() if key in options}
        for rates, chosen in product(combinations(of_training), combinations(choices)):
            model = make_model(name, options | chosen, f"models.{name}")
            rows.append({"model": name, **rates, **chosen})
            tasks.append(
                (joint, params.train_config(model, params.training.model_copy(update=rates)))
            )
    measured = 100 * np.mean(run(best_valid, tasks, params.compute, "models"), axis=1)
    table = pd.DataFrame(rows).assign(**{"validation MRR*": measured.round(2)})
    shown = (
        table.sort_values(["model", "validation MRR*"], ascending=[True, False])
        .astype(object)
        .fillna("–")
    )
    write_table("models", shown)


def combinations(grid: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    """All mappings of each key to one of its values."""
    return [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]


if __name__ == "__main__":
    main()
