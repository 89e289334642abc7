"""A pipeline with a model, source, initializer, section and stage of a user; and a pipeline that is killed."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pandas as pd
import psutil
from safetensors.torch import load_file

from tests import documented
from tests.environment import ENVIRONMENT
from tests.small_pipeline import EXPERIMENTS, SMALL, dvc, set_param, stages_run
from tools import workspace

#: Household words, so that each has a word vector: head, relation, tail and count.
NOTEBOOK = [
    f"{head},{relation},{tail},{1 + number % 3}"
    for relation, heads, tails in (
        ("on", ("apple", "bowl", "bread", "cup", "egg", "fork", "knife", "pan", "plate"), ("shelf", "sink", "sofa")),
        ("beside", ("lamp", "laptop", "mirror", "pillow", "safe", "spoon"), ("apple", "bowl", "bread", "toaster")),
    )
    for number, (head, tail) in enumerate((head, tail) for head in heads for tail in tails)
]  # fmt: skip
ANALYSES = (
    "sweep", "cross_validation", "rate_sweep", "trajectory", "compare_models", "affordances", "query_breakdown",
    "explorer",
)  # fmt: skip
MODULES = {
    "initializer": "isi/initializers/nearest.py", "model": "isi/models/transh.py", "source": "isi/sources/notebook.py",
    "section": "isi/report/sections/query_counts.py", "stage": "stages/count_triples.py",
}  # fmt: skip


def replace_once(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")


def test_what_a_user_adds_goes_from_its_files_to_the_report(tmp_path: Path) -> None:
    """Follows docs/extending.md, with its code and params."""
    changes: dict[str, Any] = {key: value for key, value in SMALL.items() if not key.startswith("experiments.")}
    changes |= {"training.batch_size": 64, "finetuning.batch_size": 64}
    changes |= {f"experiments.{name}": workspace.DROP for name in EXPERIMENTS}
    changes |= {f"sources.{name}": workspace.DROP for name in ("ai2thor", "mp3d", "published")}
    changes |= {f"{analysis}.experiments": [] for analysis in ANALYSES}
    for addition in ("initializer", "model", "source", "experiment"):
        changes |= documented.params(f"own {addition} params")
    workspace.make(tmp_path, changes)
    for addition, name in MODULES.items():
        (tmp_path / name).write_text(documented.code(f"own {addition}"), encoding="utf-8")
    replace_once(tmp_path / "isi/report/page.py", '"run.run")', '"query_counts.query_counts", "run.run")')
    stage = documented.block("own stage dvc", "yaml").removeprefix("stages:\n")
    replace_once(tmp_path / "dvc.yaml", "\nplots:\n", f"\n{stage}\nplots:\n")
    (tmp_path / "data/raw/notebook.csv").write_text(
        "\n".join(["head,relation,tail,count", *NOTEBOOK]), encoding="utf-8"
    )
    set_param(tmp_path, "experiments.notebook.initializers", ["xavier", "nearest"])
    stages = stages_run(dvc(tmp_path, "repro"))
    assert {"mine@notebook", "train_theta0@notebook", "insert@notebook-nearest", "count_triples@notebook"} <= stages
    runs = pd.read_parquet(tmp_path / "data/runs/notebook/nearest.parquet")
    assert set(runs["session"]) == {1, 2}
    joint = load_file(tmp_path / "data/embeddings/notebook/joint.safetensors")
    assert joint["relation"].shape[1:] == (2, 16)  # TransH's rows are twice as long
    assert "Nearest" in (tmp_path / "reports/tables/immediate.md").read_text(encoding="utf-8")
    assert (tmp_path / "reports/tables/queries.csv").stat().st_size
    assert "Number of queries" in (tmp_path / "reports/index.html").read_text(encoding="utf-8")
    counts = pd.read_parquet(tmp_path / "data/analyses/triple_counts/notebook.parquet").set_index("entity")["triples"]
    assert counts["apple"] == 3 + 6


def processes_in(folder: Path) -> list[psutil.Process]:
    """Processes whose working directory is a folder."""
    processes = []
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            if Path(process.cwd()) == folder and process.status() != psutil.STATUS_ZOMBIE:
                processes.append(process)
    return processes


def wait_until(condition: Callable[[], bool], seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.1)
    return condition()


def test_nothing_goes_on_after_dvc_is_killed_and_nothing_half_written_counts(tmp_path: Path) -> None:
    workspace.make(tmp_path, SMALL | {"training.max_epochs": 5000, "training.patience": 5000, "compute.workers": 2})
    dvc(tmp_path, "repro", "make_sessions@ai2thor")
    command = [sys.executable, "-m", "dvc", "repro", "train_theta0@ai2thor"]
    environment = ENVIRONMENT | {"SHELL": "/bin/sh"}  # which, unlike bash, may wait for its last command
    run = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    assert wait_until(lambda: len(processes_in(tmp_path)) >= 4, 60)  # dvc, the stage and two workers
    run.kill()
    run.wait()
    wait_until(lambda: not processes_in(tmp_path), 60)  # a worker that is still importing has to finish that first
    assert not [process.cmdline() for process in processes_in(tmp_path)]
    assert not (tmp_path / "data/embeddings").exists()
    set_param(tmp_path, "training.max_epochs", 2)
    assert "train_theta0@ai2thor" in stages_run(dvc(tmp_path, "repro", "train_theta0@ai2thor"))
