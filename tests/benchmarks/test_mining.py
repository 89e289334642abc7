"""Mining 10,000 houses (some 470,000 objects): time, and memory that does not grow with their number."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

HOUSES = 10_000
MOST_SECONDS, MOST_MIB = 60, 1024


def mine(table: Path) -> dict[str, Any]:
    """Mine in a process of its own, so that the memory is that of mining alone."""
    command = [sys.executable, "-m", "tests.houses", str(HOUSES), str(table)]
    reported: dict[str, Any] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return reported


def test_ten_thousand_houses(benchmark: Any, tmp_path: Path) -> None:
    benchmark.group = "mining"
    reported = benchmark.pedantic(mine, args=(tmp_path / "houses.parquet",), rounds=1)
    benchmark.extra_info.update(reported, houses=HOUSES)
    assert reported["seconds"] <= MOST_SECONDS
    assert reported["peak_mib"] <= MOST_MIB
