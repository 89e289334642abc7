"""Time and memory of mining, of training on larger and larger graphs and of ``isi.insert``, each in
its own process on one thread.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

HOUSES, GIB = 10_000, 1024
TRIPLES_PER_ENTITY = 10
SMALL = [100, 178, 316, 562, 1_000, 1_778, 3_162]
LARGE = [10_000, 100_000]


def report(work: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Run a function of ``processes`` in a new process, and return its report."""
    command = [sys.executable, "-m", "tests.benchmarks.processes", work, json.dumps(settings)]
    reported: dict[str, Any] = json.loads(
        subprocess.run(command, check=True, capture_output=True, text=True).stdout
    )
    return reported


def measured(
    benchmark: Any, group: str, most_mib: float, work: str, **settings: Any
) -> dict[str, Any]:
    """Run a function of ``processes`` once, and check its limit of memory."""
    benchmark.group = group
    reported: dict[str, Any] = benchmark.pedantic(report, args=(work, settings), rounds=1)
    assert reported["peak_mib"] <= most_mib
    return reported


def test_ten_thousand_houses_of_tables(benchmark: Any, tmp_path: Path) -> None:
    """With about 470,000 objects: memory must not grow with their number."""
    table = str(tmp_path / "houses.parquet")
    reported = measured(benchmark, "mining", GIB, "mine_houses", houses=HOUSES, table=table)
    benchmark.extra_info.update(reported, houses=HOUSES)


@pytest.mark.parametrize(
    ("form", "entities"), [*(("tables", e) for e in SMALL), *(("lists", e) for e in SMALL + LARGE)]
)
def test_growth(benchmark: Any, entities: int, form: str) -> None:
    """An epoch with batches as tables or as lists."""
    settings = {"entities": entities, "triples": TRIPLES_PER_ENTITY * entities, "form": form}
    benchmark.group = "growth"
    benchmark.extra_info.update(benchmark.pedantic(report, args=("grow_graph", settings), rounds=1))


FB15K_237 = {"entities": 14_541, "relations": 237, "triples": 272_115, "dimension": 200}
MILLION = {
    "entities": 1_000_000,
    "relations": 1_000,
    "triples": 10_000_000,
    "dimension": 200,
}


@pytest.mark.parametrize(
    ("graph", "what", "new", "rounds", "most_mib"),
    [
        (FB15K_237, "map", 1, 15, 1.5 * GIB),
        (FB15K_237, "map", 1000, 1, 1.5 * GIB),
        (FB15K_237, "soft_rs", 1, 15, 1.5 * GIB),
        (FB15K_237, "fold_in", 1, 15, 1.5 * GIB),
        (FB15K_237, "fold_in", 1000, 1, 1.5 * GIB),
        (MILLION, "map", 1, 2, 5 * GIB),
        (MILLION | {"triples": 0}, "map", 1, 2, 4 * GIB),
    ],
)
def test_insert(
    benchmark: Any,
    graph: dict[str, int],
    what: str,
    new: int,
    rounds: int,
    most_mib: float,
) -> None:
    settings = {**graph, "what": what, "new": new, "rounds": rounds}
    reported = measured(benchmark, "insert", most_mib, "insert", **settings)
    benchmark.extra_info.update(settings, **reported)
