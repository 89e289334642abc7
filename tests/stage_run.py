"""A run of the pipeline's main stages on a small grid, without DVC,
for tests that alter its files.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import yaml

from isi.tables import paths
from stages.pipeline import BEYOND_PARAMS, BEYOND_PIPELINE, PIPELINE
from tools.workspace import change

ROOT = Path(__file__).parent.parent
NAME, SOURCE = "paper", "published"
SMALL: dict[str, Any] = {
    f"experiments.{NAME}.sessions.seeds": 2,
    f"experiments.{NAME}.sessions.sizes": [1, 2],
    f"experiments.{NAME}.full_curves": [],
    f"experiments.{NAME}.negatives": None,
    f"experiments.{NAME}.training": {"batch_size": 2048},
    f"experiments.{NAME}.finetuning": {"max_epochs": 1},
    "embedding.dimension": 8,
    "training.max_epochs": 4,
    "training.evaluate_every": 2,
    "sweep.experiments": [],
    "final_model.experiments": [NAME],
    "explorer.experiments": [NAME],
    "explorer.size": 1,
    "explorer.seed": 0,
    "compute.stack": 2,
    "compute.workers": 1,
    "words.text": "glove",
}
STAGES = (
    f"mine {SOURCE}",
    f"build_graph {NAME}",
    f"embed_words {NAME}",
    f"make_sessions {NAME}",
    f"train_theta0 {NAME}",
    f"train_joint {NAME}",
    f"insert {NAME} rs",
)


def lay_out(folder: Path, changes: dict[str, Any]) -> None:
    """Write a project into a folder: params with changes by dotted key, pipelines, and sources."""
    values = yaml.safe_load((ROOT / paths.PARAMS).read_text(encoding="utf-8"))
    for key, value in changes.items():
        change(values, key, value)
    (folder / paths.PARAMS).write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    for path in (
        PIPELINE,
        BEYOND_PIPELINE,
        BEYOND_PARAMS,
    ):
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_bytes((ROOT / path).read_bytes())
    (folder / paths.DATA).mkdir()
    (folder / paths.RAW).symlink_to(ROOT / paths.RAW)


def main_of(name: str) -> Callable[[], None]:
    """What the command of a stage runs; the stage ``report`` is a package."""
    module = import_module(f"stages.{name}")
    if hasattr(module, "__path__"):
        module = import_module(f"stages.{name}.__main__")
    main: Callable[[], None] = getattr(module, name)
    return main


def run(command: str) -> None:
    """Run a stage in this process, in the current folder; ``command``: its name and arguments."""
    name, *arguments = command.split()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [name, *arguments])
        main_of(name)()


def run_all(folder: Path) -> None:
    """Run all ``STAGES`` on the small grid."""
    lay_out(folder, SMALL)
    with chdir(folder):
        for command in STAGES:
            run(command)


@contextmanager
def for_a_while(path: Path, alter: Callable[[Path], object]) -> Iterator[None]:
    """Alter a file, and restore its bytes in the end."""
    before = path.read_bytes()
    try:
        alter(path)
        yield
    finally:
        path.write_bytes(before)
