"""Render the report: tables, figures, metrics and the page."""

import hashlib
import json
import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from isi.report import data, page
from isi.stage import StageContext, stage
from isi.tables import paths

_PACKAGES = ("dvc", "gensim", "matplotlib", "numpy", "pandas", "procthor", "pyarrow", "scipy", "torch")
#: Sections of params that change nothing in the report.
UNUSED = ("compute", "recorder", "plots", "finetune_only", "final_model")
_SOURCES = ("isi", "stages", "data/raw")  # dependencies of the stage, whole


@stage
def report(context: StageContext) -> None:
    values = context.params.model_dump(exclude=set(UNUSED), exclude_unset=True)
    page.write(paths.REPORTS, data.read(context.params, what_was_run(values)), page.SECTIONS)
    print(f"report: {paths.REPORTS / 'index.html'}")


def what_was_run(values: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Params, versions and hashes: the same for equal runs, whenever and wherever they ran."""
    files = sorted(path for source in _SOURCES for path in Path(source).rglob("*") if _is_source(path))
    code = hashlib.sha256(b"".join(str(path).encode() + path.read_bytes() for path in files)).hexdigest()
    hashes = {
        "code and shipped inputs": code,
        "params": hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest(),
    }
    for name, settings in (values.get("sources") or {}).items():
        if settings.get("sha256"):
            hashes[f"recording of {name}"] = settings["sha256"]
    versions = {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES}
    return {"Hashes (SHA-256)": hashes, "Params": dict(_flat(values)), "Versions": versions}


def _is_source(path: Path) -> bool:
    return path.is_file() and "__pycache__" not in path.parts and not path.name.startswith(".")


def _flat(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    pairs: list[tuple[str, Any]] = []
    for key, value in values.items():
        pairs += _flat(value, f"{prefix}{key}.") if isinstance(value, dict) and value else [(prefix + key, value)]
    return pairs


if __name__ == "__main__":
    report()
