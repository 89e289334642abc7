"""``isi.insert`` on one thread: a thousand entities within a second, one within 10 ms, a million known within 4 GiB."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest

GIB = 1024


def place(**settings: Any) -> dict[str, Any]:
    """Insert in a process of its own, so that the memory is that of insertion alone."""
    command = [sys.executable, "-m", "tests.placed", json.dumps(settings)]
    reported: dict[str, Any] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return reported


@pytest.mark.parametrize(
    ("entities", "new", "rounds", "most_seconds", "most_mib"),
    [(14_541, 1, 50, 0.01, GIB), (14_541, 1000, 5, 1.0, 2 * GIB), (1_000_000, 1, 1, 10.0, 4 * GIB),
     (1_000_000, 100, 1, 60.0, 4 * GIB)],
)  # fmt: skip
def test_insert(benchmark: Any, entities: int, new: int, rounds: int, most_seconds: float, most_mib: float) -> None:
    settings = {"entities": entities, "dimension": 200, "new": new, "rounds": rounds}
    benchmark.group = "insert"
    reported = benchmark.pedantic(place, kwargs=settings, rounds=1)
    benchmark.extra_info.update(entities=entities, new=new, dimension=200, **reported)
    assert reported["seconds"] <= most_seconds
    assert reported["peak_mib"] <= most_mib
