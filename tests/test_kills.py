"""Two runs that are killed, and gone on with; and that the comparison sees what is lost."""

from __future__ import annotations

import random
import signal
import sys

import pytest

from tests.kills.__main__ import kills
from tests.kills.workspace import Lost, Workspace

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes as Linux has them")


@pytest.fixture(scope="module")
def where(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    """A pipeline up to one insertion, and what it makes."""
    made = Workspace(tmp_path_factory.mktemp("kills"), ["insert@published-ers"])
    made.finish()
    made.expected = made.digests()
    return made


def test_what_a_fault_has_changed_is_seen(where: Workspace) -> None:
    where.compare()
    left, changed = (where.folder / "data/runs/published" / name for name in (".ers.parquet.1.tmp", "ers.parquet"))
    left.write_bytes(b"left over")
    before = changed.read_bytes()
    changed.write_bytes(before[:-1])
    with pytest.raises(Lost, match=r"^2 files differ, lack or stay: data/runs/published/\.ers\.parquet\.1\.tmp, data"):
        where.compare()
    left.unlink()
    changed.write_bytes(before)


def test_two_runs_that_are_killed_lose_nothing(where: Workspace) -> None:
    assert "data/runs/published/ers.parquet" in where.expected
    assert [fault.lost for fault in kills(where, 2, 8.0, random.Random(2))] == ["", ""]


def test_what_is_struck_is_a_worker_of_the_stage_that_runs(where: Workspace) -> None:
    where.clear()
    fault = where.strike("a worker", signal.SIGKILL, 0, random.Random(0))
    assert fault
    assert fault.status != 0
    assert fault.stage.split() == ["train_theta0", "published"]
