"""Compare batch sizes, learning rates, weight decays, margins and norms of embedding models;
those in params.yaml were chosen so.

Each setting trains the joint model with two seeds; its score is the best validation MRR*,
averaged over seeds. No test triple is used. Writes the table of the documentation.
"""

import argparse
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from isi.training.fit import TrainConfig
from stages.grid import GridPoints
from stages.params import StageParams
from stages.runner import Compute, run
from stages.store import Store
from stages.train_theta0 import train_config, train_stack
from tools.docs import write_table

SEEDS = 2
OF_TRAINING = {"learning_rate": [0.05, 0.1, 0.2], "weight_decay": [0.0, 1e-4, 1e-3]}
#: Of the models that have them.
OF_MODEL = {"margin": [0.5, 1.0, 2.0, 4.0, 8.0], "squared": [False, True]}


def best_valid(points: GridPoints, config: TrainConfig) -> np.ndarray:
    """Best validation MRR* of each joint model; shape (M,)."""
    return train_stack(points, config).log.groupby("seed")["mrr_star"].max().to_numpy()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--models", nargs="+", help="default: all")
    parser.add_argument("--batches", type=int, nargs="+", help="batch sizes (that of params)")
    given = parser.parse_args()
    params = StageParams.load()
    models = params.read("models", dict[str, dict[str, Any]])
    experiment = next(iter(params.read("experiments", dict[str, Any])))
    joint = Store(experiment).grid(SEEDS, seeds=SEEDS)[0].all_known
    of_training = OF_TRAINING | ({"batch_size": given.batches} if given.batches else {})
    rows, tasks = [], []
    for name in given.models or models:
        options = models[name]
        of_model = {key: values for key, values in OF_MODEL.items() if key in options}
        for rates, chosen in product(combinations(of_training), combinations(of_model)):
            changes = {f"training.{key}": value for key, value in rates.items()}
            changes |= {f"models.{name}.{key}": value for key, value in chosen.items()}
            changed = params.changed({"embedding.model": name, **changes})
            rows.append({"model": name, **rates, **chosen})
            tasks.append((joint, train_config(changed)))
    measured = 100 * np.mean(
        run(best_valid, tasks, params.read("compute", Compute), "models"), axis=1
    )
    table = pd.DataFrame(rows).assign(**{"validation MRR*": measured.round(2)})
    ordered = table.sort_values(["model", "validation MRR*"], ascending=[True, False])
    write_table("models", ordered.astype(object).fillna("–"))


def combinations(grid: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    """All mappings of each key to one of its values."""
    return [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]


if __name__ == "__main__":
    main()
