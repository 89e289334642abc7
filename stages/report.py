"""Render the report: tables, figures, metrics and the page."""

from __future__ import annotations

import hashlib
import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

from isi import paths
from isi.params import Params
from isi.report import contents, figures, page, results
from isi.stage import Provenance, stage
from isi.tables import keep_only

_PACKAGES = ("dvc", "gensim", "matplotlib", "numpy", "pandas", "procthor", "pyarrow", "scipy", "torch")
_SOURCES = ("isi", "stages", "data/raw")  # dependencies of the stage, whole


@stage(
    "seed", "ai2thor", "materials", "graph", "words", "sessions", "embedding", "negatives", "training", "finetuning",
    "convergence", "insert", "initializers", "curves", "sweep", "cross_validation", "rates", "approach", "mp3d",
    "transfer", "affordances",
)  # fmt: skip
def report(params: Params, _provenance: Provenance) -> None:
    """Render the report: tables, figures, metrics and the page."""
    listed = (*params.insert.initializers, "joint")
    for runs in (paths.runs(experiment, "joint").parent for experiment in ("ai2thor", "transfer")):
        # the folder is a dependency
        keep_only(runs, [path for path in runs.iterdir() if path.name.split(".")[0] in listed])
    found = results.read(params)
    made = [table(found) for table in contents.TABLES]
    page.write(paths.REPORTS, found, made, figures.draw(found, contents.FIGURES), what_was_run(params, found))
    print(f"report: {paths.REPORTS / 'index.html'}")


def what_was_run(params: Params, found: results.Results) -> dict[str, dict[str, Any]]:
    """Params, versions and hashes: the same for equal runs, whenever and wherever they ran."""
    values = params.model_dump(exclude={"compute"})
    files = sorted(path for source in _SOURCES for path in Path(source).rglob("*") if _is_source(path))
    code = hashlib.sha256(b"".join(str(path).encode() + path.read_bytes() for path in files)).hexdigest()
    return {
        "Hashes (SHA-256)": {
            "code and shipped inputs": code,
            "params": hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest(),
            "recording of AI2-THOR": params.ai2thor.sha256,
        },
        "Params": dict(_flat(values)),
        "Versions": {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES},
        "Entities without a word vector": dict.fromkeys(
            found.transfer.coverage.loc[found.transfer.coverage["served_by"].isna(), "entity"], ""
        ),
    }


def _is_source(path: Path) -> bool:
    return path.is_file() and "__pycache__" not in path.parts and not path.name.startswith(".")


def _flat(values: dict[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    pairs: list[tuple[str, Any]] = []
    for key, value in values.items():
        pairs += _flat(value, f"{prefix}{key}.") if isinstance(value, dict) and value else [(prefix + key, value)]
    return pairs


if __name__ == "__main__":
    report()
