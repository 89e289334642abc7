"""Compare rates, weight decays and margins of every embedding model on validation MRR*, as params.yaml's were chosen.

Each setting trains the joint model of a few seeds; the best validation MRR* of each is averaged. No test triple
is used. Writes the table that the documentation shows.
"""

from __future__ import annotations

import argparse
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from isi.experiment.grid import GridPoints
from isi.experiment.runner import run
from isi.experiment.store import Store
from isi.experiment.train import TrainConfig, train_config, train_stack
from isi.models.model import make_model
from isi.params import Params, load

FOLDER = Path(__file__).parent.parent / "docs" / "benchmarks"


def settings_of(params: Params, name: str, asked: argparse.Namespace) -> list[dict[str, float | bool]]:
    """The grid of a model: rates, decays, and what its options may be."""
    grid: dict[str, list[float] | list[bool]] = {"learning_rate": asked.rates, "weight_decay": asked.decays}
    if "margin" in params.models[name]:
        grid["margin"] = asked.margins
    if "squared" in params.models[name]:
        grid["squared"] = [False, True]
    return [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]


def learning_of(params: Params, name: str, setting: dict[str, float | bool]) -> TrainConfig:
    """How a model is trained with a setting."""
    options = params.models[name]
    model = make_model(name, options | {key: setting[key] for key in setting if key in options}, f"models.{name}")
    rates = {key: value for key, value in setting.items() if key not in options}
    return train_config(params, model, params.training.model_copy(update=rates))


def best_valid(points: GridPoints, config: TrainConfig) -> float:
    """Best validation MRR* of the joint models, averaged."""
    return float(train_stack(points, config).log.groupby("seed")["mrr_star"].max().mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", nargs="+", help="default: all")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--rates", type=float, nargs="+", default=[0.05, 0.1, 0.2])
    parser.add_argument("--decays", type=float, nargs="+", default=[0.0, 1e-4, 1e-3])
    parser.add_argument("--margins", type=float, nargs="+", default=[0.5, 1.0, 2.0, 4.0, 8.0])
    asked = parser.parse_args()
    params = load()
    experiment = params.compare_models.experiment or next(iter(params.experiments))
    points = Store(experiment).grid(asked.seeds, seeds=asked.seeds)[0]
    joint = points.all_known
    rows, tasks = [], []
    for name in asked.models or params.models:
        for setting in settings_of(params, name, asked):
            rows.append({"model": name, **setting})
            tasks.append((joint, learning_of(params, name, setting)))
    found = 100 * np.array(run(best_valid, tasks, params.compute, "models"))
    table = pd.DataFrame(rows).assign(**{"validation MRR*": found.round(2)})
    shown = table.sort_values(["model", "validation MRR*"], ascending=[True, False]).astype(object).fillna("–")
    FOLDER.mkdir(parents=True, exist_ok=True)
    shown.to_csv(FOLDER / "models.csv", index=False)
    best = shown.groupby("model", sort=False).head(3)
    text = best.astype(str).to_markdown(index=False, disable_numparse=True)
    (FOLDER / "models.md").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
