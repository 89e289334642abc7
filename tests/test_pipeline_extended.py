"""A pipeline with a model, source, initializer, report section and stage that a user adds."""

from pathlib import Path
from typing import Any

import pandas as pd
from safetensors.torch import load_file

from tests import documented
from tests.small_pipeline import SMALL, Dvc, dvc, set_param, stages_run
from tools import workspace

__all__ = ["dvc"]
#: Household words, so that each has a word vector: head, relation, tail and count.
NOTEBOOK = [
    f"{head},{relation},{tail},{1 + number % 3}"
    for relation, heads, tails in (
        (
            "on",
            ("apple", "bowl", "bread", "cup", "egg", "fork", "knife", "pan", "plate"),
            ("shelf", "sink", "sofa"),
        ),
        (
            "beside",
            ("lamp", "laptop", "mirror", "pillow", "safe", "spoon"),
            ("apple", "bowl", "bread", "toaster"),
        ),
    )
    for number, (head, tail) in enumerate((head, tail) for head in heads for tail in tails)
]
#: Lists of experiments, each of a study that the pipeline leaves out here.
STUDIES = [
    f"{name}.experiments"
    for name in (
        "sweep",
        "cross_validation",
        "trajectory",
        "affordances",
        "explorer",
        "finetune_only",
        "measure_changes",
    )
]
LEFT_OUT = (
    "experiments.ai2thor",
    "experiments.transfer",
    "experiments.paper",
    "experiments.paper_transfer",
    "sources.ai2thor",
    "sources.mp3d",
    "initializers.iu",
    "initializers.rs",
    "initializers.ers",
)
MODULES = {
    "initializer": "isi/initializers/nearest.py",
    "model": "isi/models/transh.py",
    "source": "isi/sources/notebook.py",
    "table": "stages/report/tables/query_counts.py",
    "stage": "stages/count_triples.py",
}


def replace_once(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")


def test_what_a_user_adds_goes_from_its_files_to_the_report(tmp_path: Path, dvc: Dvc) -> None:
    """The steps of docs/extending.md, with its code and params."""
    changes: dict[str, Any] = {
        key: value for key, value in SMALL.items() if not key.startswith("experiments.")
    }
    changes |= {"training.batch_size": 64, "finetuning.batch_size": 64}
    changes |= dict.fromkeys(LEFT_OUT, workspace.DROP) | {key: [] for key in STUDIES}
    for addition in ("initializer", "model", "source", "experiment"):
        changes |= documented.params(f"own {addition} params")
    workspace.make(tmp_path, changes)
    for addition, name in MODULES.items():
        (tmp_path / name).write_text(documented.code(f"own {addition}"), encoding="utf-8")
    entry, before = documented.block("own table entry", "yaml"), "    - name: measure_decides\n"
    replace_once(tmp_path / "stages/report/items.yaml", before, f"{entry}{before}")
    stage = documented.block("own stage dvc", "yaml").removeprefix("stages:\n")
    replace_once(tmp_path / "dvc.yaml", "\nplots:\n", f"\n{stage}\nplots:\n")
    table = "\n".join(["head,relation,tail,count", *NOTEBOOK])
    (tmp_path / "data/raw/notebook.csv").write_text(table, encoding="utf-8")
    set_param(tmp_path, "experiments.notebook.initializers", ["xavier", "nearest"])
    stages = stages_run(dvc(tmp_path, "repro"))
    assert {
        "mine@notebook",
        "train_theta0@notebook",
        "insert@notebook-nearest",
        "count_triples@notebook",
    } <= stages
    runs = pd.read_parquet(tmp_path / "data/runs/notebook/nearest.parquet")
    assert set(runs["size"]) == {1, 3}
    joint = load_file(tmp_path / "data/embeddings/notebook/joint.safetensors")
    assert joint["relation"].shape[1:] == (2, 16)  # TransH's rows are twice as long
    assert "Nearest" in (tmp_path / "reports/tables/immediate.md").read_text(encoding="utf-8")
    assert (tmp_path / "reports/tables/query_counts.csv").stat().st_size
    assert "Number of queries" in (tmp_path / "reports/index.html").read_text(encoding="utf-8")
    counts = pd.read_parquet(tmp_path / "data/analyses/triple_counts/notebook.parquet").set_index(
        "entity"
    )["triples"]
    assert counts["apple"] == 3 + 6
