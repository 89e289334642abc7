"""Params of small experiments."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from isi.config import check
from stages.check_params import Params
from stages.params import CONDITIONS

ROOT = Path(__file__).parent.parent
EPOCHS = 3
#: Graphs of the small results: two of one source each, and one that is extended by a second source.
GRAPHS = {
    "home": {"source": "home"},
    "away": {"source": "away"},
    "moved": {
        "source": "home",
        "extend": {"source": "shop", "min_observations": 2, "candidates": 2, "always": ["fan"]},
    },
}
INITIALIZERS = ["xavier", "iu", "es", "rs", "ers", "mean", "es_permuted"]


def small_params(experiments: Sequence[str], **changes: Any) -> Params:
    """The params of this repository with small experiments; ``changes``: by dotted key."""
    values = yaml.safe_load((ROOT / "params.yaml").read_text(encoding="utf-8"))
    values["sources"] = {name: {"reader": "published"} for name in ("home", "away", "shop")}
    sessions = {"novel": "any", "sizes": [1, 2], "seeds": 2}
    values["experiments"] = {
        name: {
            "title": f"the {name} graph",
            "graph": GRAPHS[name],
            "initializers": "all",
            "finetuned": {"initializers": "all", "seeds": 2},
            "full_curves": [2],
            **dict.fromkeys(CONDITIONS),
            "sessions": sessions | ({"novel": "added", "sizes": [2]} if name == "moved" else {}),
        }
        for name in experiments
    }
    studies: dict[str, dict[str, Any]] = {
        "sweep": {"size": 2, "seeds": 2, "finetuned_seeds": 2, "k": [1, 2, 4]},
        "trajectory": {"size": 2},
        "cross_validation": {},
        "affordances": {"entities": {name: ["fan"] for name in experiments}},
        "measure_changes": {},
        "finetune_only": {},
        "final_model": {},
        "explorer": {"size": 2, "seed": 0},
    }
    for name, changed in studies.items():
        values[name] |= changed | {"experiments": []}
    values["finetuning"]["max_epochs"] = EPOCHS
    values["initializers"] = {name: values["initializers"][name] for name in INITIALIZERS}
    values["plots"] = {"initializers": ["es"]}
    for key, value in changes.items():
        place, _, last = key.rpartition(".")
        (values[place] if place else values)[last] = value
    return check(values, Params, "")
