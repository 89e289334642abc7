"""Compare rates, weight decays and margins of every embedding model on validation MRR*, as params.yaml's were chosen.

Each setting trains the joint model of a few seeds; the best validation MRR* of each is averaged. No test triple
is used. Writes the table that the documentation shows.
"""

from __future__ import annotations

import argparse
from itertools import product

import numpy as np
import pandas as pd

from isi.experiment.runner import run
from isi.experiment.store import Store
from isi.experiment.train import TrainConfig, train_config
from isi.models.model import make_model
from isi.params import Params, load
from tools.choose_rates import best_valid
from tools.docs import BENCHMARKS, write_table


def settings_of(params: Params, name: str, given: argparse.Namespace) -> list[dict[str, float | bool]]:
    """The grid of a model: rates, decays, and what its options may be."""
    grid: dict[str, list[float] | list[bool]] = {"learning_rate": given.rates, "weight_decay": given.decays}
    if "margin" in params.models[name]:
        grid["margin"] = given.margins
    if "squared" in params.models[name]:
        grid["squared"] = [False, True]
    return [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]


def learning_of(params: Params, name: str, setting: dict[str, float | bool]) -> TrainConfig:
    """How a model is trained with a setting."""
    options = params.models[name]
    model = make_model(name, options | {key: setting[key] for key in setting if key in options}, f"models.{name}")
    rates = {key: value for key, value in setting.items() if key not in options}
    return train_config(params, model, params.training.model_copy(update=rates))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", nargs="+", help="default: all")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--rates", type=float, nargs="+", default=[0.05, 0.1, 0.2])
    parser.add_argument("--decays", type=float, nargs="+", default=[0.0, 1e-4, 1e-3])
    parser.add_argument("--margins", type=float, nargs="+", default=[0.5, 1.0, 2.0, 4.0, 8.0])
    given = parser.parse_args()
    params = load()
    experiment = params.compare_models.experiment or next(iter(params.experiments))
    points = Store(experiment).grid(given.seeds, seeds=given.seeds)[0]
    joint = points.all_known
    rows, tasks = [], []
    for name in given.models or params.models:
        for setting in settings_of(params, name, given):
            rows.append({"model": name, **setting})
            tasks.append((joint, learning_of(params, name, setting)))
    measured = 100 * np.mean(run(best_valid, tasks, params.compute, "models"), axis=1)
    table = pd.DataFrame(rows).assign(**{"validation MRR*": measured.round(2)})
    shown = table.sort_values(["model", "validation MRR*"], ascending=[True, False]).astype(object).fillna("–")
    shown.to_csv(BENCHMARKS / "models.csv", index=False)
    write_table(BENCHMARKS / "models.md", shown.groupby("model", sort=False).head(3))


if __name__ == "__main__":
    main()
