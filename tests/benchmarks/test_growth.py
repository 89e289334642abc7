"""Time and memory as a graph grows, with batches as tables and as lists."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest

TRIPLES_PER_ENTITY = 10
SMALL = [100, 178, 316, 562, 1_000, 1_778, 3_162]
LARGE = [10_000, 100_000]


def grow(entities: int, form: str) -> dict[str, Any]:
    """Run in a process of its own, so that the memory is that of one graph alone."""
    numbers = str(entities), str(TRIPLES_PER_ENTITY * entities)
    command = [sys.executable, "-m", "tests.growing_graph", *numbers, "--form", form]
    reported: dict[str, Any] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return reported


@pytest.mark.parametrize(
    ("form", "entities"), [*(("tables", e) for e in SMALL), *(("lists", e) for e in SMALL + LARGE)]
)
def test_growth(benchmark: Any, entities: int, form: str) -> None:
    benchmark.group = "growth"
    benchmark.extra_info.update(benchmark.pedantic(grow, args=(entities, form), rounds=1))
