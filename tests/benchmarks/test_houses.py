"""Mining 10,000 houses of ProcTHOR's form: within a minute and a gibibyte, and nearly all objects in a room."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from isi.sources.procthor_houses import INSTANCES, OUTSIDE
from tools import make_houses

HOUSES = 10_000
MOST_SECONDS, MOST_MIB, LEAST_SHARE = 60, 1024, 0.99


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("houses") / "houses.jsonl.gz"
    make_houses.write(path, HOUSES)
    return path


def mine(settings: dict[str, Any], table: Path) -> dict[str, Any]:
    """Mine in a process of its own, so that the memory is that of mining alone."""
    command = [sys.executable, "-m", "tests.mined", json.dumps(settings), str(table)]
    reported: dict[str, Any] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return reported


@pytest.mark.parametrize("materials", ["suncg", "simulator"])
def test_ten_thousand_houses(benchmark: Any, file: Path, tmp_path: Path, materials: str) -> None:
    settings = {"reader": "procthor_houses", "path": str(file), "sha256": None, "materials": materials}
    benchmark.group = "houses"
    reported = benchmark.pedantic(mine, args=(settings, tmp_path / "houses.parquet"), rounds=1)
    counts = reported.pop("counts")
    benchmark.extra_info.update(materials=materials, houses=HOUSES, objects=counts[INSTANCES], **reported)
    assert reported["seconds"] <= MOST_SECONDS
    assert reported["peak_mib"] <= MOST_MIB
    assert counts[OUTSIDE] <= (1 - LEAST_SHARE) * counts[INSTANCES]
