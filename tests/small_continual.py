"""A tiny timeline in a folder, and an experiment of the third pipeline on it."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from isi.tables import paths

NAME = "tiny"
#: The timeline's folder. In a project, it is below data/raw; here data/raw may be a link.
FOLDER = Path("data") / "tiny"
ENTRY: dict[str, Any] = {
    "title": "Tiny",
    "timeline": str(FOLDER),
    "model": "complex",
    "dimension": 4,
    "training": {
        "loss": "softmax",
        "batch_size": 16,
        "learning_rate": 0.1,
        "n3": 0.005,
        "init_range": 0.1,
        "base_epochs": 2,
        "epochs": 2,
    },
    "seeds": 2,
    "most_tests": 4,
    "initializers": {"er_avg": {}, "default": {}},
    "strategies": {"insert": {}, "replay": {"number": 5}},
    "pairs": {"er_avg": "all", "default": ["insert"]},
}


def triples(seed: int, number: int, first: int, last: int) -> str:
    """Lines of random triples; the head is an entity from ``first`` on, the tail a lower one."""
    rng = np.random.default_rng(seed)
    heads = rng.integers(first, last, number)
    lines = [f"e{head}\tr{seed % 2}\te{rng.integers(head)}" for head in heads]
    return "\n".join(dict.fromkeys(lines)) + "\n"


def write_timeline(folder: Path) -> None:
    """Write three snapshots of 12, 15 and 17 entities."""
    borders = [(1, 12), (12, 15), (15, 17)]
    for snapshot, (first, last) in enumerate(borders):
        (folder / str(snapshot)).mkdir(parents=True)
        for place, (split, number) in enumerate((("train", 30), ("valid", 3), ("test", 6))):
            text = triples(3 * snapshot + place, number, first, last)
            (folder / str(snapshot) / f"{split}.txt").write_text(text, encoding="utf-8")


def write_params(folder: Path, **changes: Any) -> None:
    """Write the params of the third pipeline, with one experiment."""
    path = folder / paths.CONTINUAL_PARAMS
    path.parent.mkdir(exist_ok=True)
    entries = {"continual": {NAME: ENTRY | changes}}
    path.write_text(yaml.safe_dump(entries, sort_keys=False), encoding="utf-8")


def lay_out(folder: Path, **changes: Any) -> None:
    """Write timeline and params into a project."""
    write_timeline(folder / FOLDER)
    write_params(folder, **changes)
