"""Entries of the second pipeline's params, and a folder with both pipelines, for several tests."""

import shutil
from pathlib import Path
from typing import Any

import yaml

from isi.tables import paths
from stages.pipeline import BEYOND_PARAMS, BEYOND_PIPELINE, PIPELINE

ROOT = Path(__file__).parent.parent
SESSIONS = {"novel": "any", "sizes": [3], "seeds": 2}
WORDS = {"source": "shipped", "text": "phrase", "sha256": None}
GRAPH: dict[str, Any] = {
    "title": "again",
    "source": {"reader": "published"},
    "words": WORDS,
    "sessions": SESSIONS,
    "initializers": ["xavier", "es"],
    "changes": {"embedding.dimension": 8, "training.max_epochs": 2, "finetuning.max_epochs": 2},
}
VARIANT: dict[str, Any] = {
    "title": "own",
    "group": "baselines",
    "experiments": ["ai2thor"],
    "initializers": ["xavier", "es"],
    "size": 5,
    "seeds": 2,
}


def copy_pipelines(folder: Path) -> None:
    """Copy both dvc.yaml files, and params.yaml of the first pipeline, into a folder."""
    for path in (paths.PARAMS, PIPELINE, BEYOND_PIPELINE):
        (folder / path).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / path, folder / path)


def list_entries(**sections: Any) -> None:
    """Write params of the second pipeline with these sections, in the current folder."""
    BEYOND_PARAMS.write_text(yaml.safe_dump({"variants": {}, **sections}), encoding="utf-8")
