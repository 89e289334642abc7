"""The whole pipeline on a small grid in a folder, and DVC commands in it."""

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
import yaml

from tests.warm_python import warm_python
from tools import workspace

EXPERIMENTS = ("ai2thor", "transfer")
INITIALIZERS = ("xavier", "iu", "es", "rs", "ers")
#: Params of a small grid on which every stage runs, with two items per sweep and one experiment per
#: analysis.
SMALL: dict[str, Any] = {
    "experiments.ai2thor.sessions.seeds": 3,
    "experiments.ai2thor.sessions.sizes": [1, 2],
    "experiments.ai2thor.full_curves": [2],
    "experiments.ai2thor.finetuned.seeds": 2,
    "experiments.transfer.sessions.seeds": 3,
    "embedding.dimension": 8,
    "training.max_epochs": 4,
    "training.evaluate_every": 2,
    "finetuning.max_epochs": 3,
    "compute.stack": 2,
    "finetune_only.experiments": ["ai2thor"],
    "sweep.initializers": {"es": {}, "ers": {"candidates": 30}},
    "sweep.k": [1, 8],
    "sweep.size": 2,
    "sweep.experiments": ["ai2thor"],
    "sweep.seeds": 2,
    "sweep.finetuned_seeds": 1,
    "measure_changes.experiments": ["ai2thor"],
    "trajectory.size": 2,
    "trajectory.epochs": 2,
    "cross_validation.folds": 3,
    "cross_validation.dimension": [12],
    "cross_validation.ratio": [],
    "cross_validation.learning_rate": [0.2],
    "cross_validation.weight_decay": [],
    "explorer.size": 2,
    "explorer.seed": 0,
    # The paper's graph goes through DVC in tests of killed runs.
    "experiments.paper": workspace.DROP,
    "experiments.paper_transfer": workspace.DROP,
    "sources.published": workspace.DROP,
    **{
        f"initializers.{name}": workspace.DROP
        for name in (
            "mean",
            "kind_mean",
            "gaussian",
            "es_permuted",
            "soft_hybrid",
            "map",
            "map_own_facts",
        )
    },
}


#: Runs DVC in a folder with the arguments, and returns its output.
Dvc = Callable[..., str]


@pytest.fixture(scope="module")
def dvc() -> Iterator[Dvc]:
    """A function that runs DVC, whose stages start at once."""
    with TemporaryDirectory() as script, warm_python(Path(script)) as environment:

        def run(folder: Path, *arguments: str) -> str:
            command = ["python", "-m", "dvc", *arguments]
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, env=environment
            )
            assert done.returncode == 0, done.stdout + done.stderr
            return done.stdout

        yield run


def stages_run(output: str) -> set[str]:
    """The stages that ran, from the output of ``dvc repro``."""
    return {line.split("'")[1] for line in output.splitlines() if line.startswith("Running stage")}


def set_param(folder: Path, key: str, value: object) -> None:
    path = folder / "params.yaml"
    params = yaml.safe_load(path.read_text(encoding="utf-8"))
    workspace.change(params, key, value)
    path.write_text(yaml.safe_dump(params, sort_keys=False, allow_unicode=True), encoding="utf-8")
