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
def pipeline(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    """A pipeline up to Θ⁰, and the files that it makes."""
    workspace = Workspace(tmp_path_factory.mktemp("kills"), ["train_theta0@published"])
    workspace.finish()
    workspace.expected = workspace.digests()
    return workspace


def test_what_a_fault_has_changed_is_seen(pipeline: Workspace) -> None:
    pipeline.compare()
    folder = pipeline.folder / "data/embeddings/published"
    left, changed = folder / ".theta0.log.parquet.1.tmp", folder / "theta0.log.parquet"
    left.write_bytes(b"left over")
    before = changed.read_bytes()
    changed.write_bytes(before[:-1])
    with pytest.raises(Lost, match=r"^2 files differ, lack or stay: .*/\.theta0\.log\.parquet\.1\.tmp, "):
        pipeline.compare()
    left.unlink()
    changed.write_bytes(before)


def test_two_runs_that_are_killed_lose_nothing(pipeline: Workspace) -> None:
    assert "data/embeddings/published/theta0.log.parquet" in pipeline.expected
    assert [fault.lost for fault in kills(pipeline, 2, 6.0, random.Random(2))] == ["", ""]


def test_what_is_struck_is_a_worker_of_the_stage_that_runs(pipeline: Workspace) -> None:
    pipeline.clear()
    fault = pipeline.strike("a worker", signal.SIGKILL, 0, random.Random(0))
    assert fault
    assert fault.status != 0
    assert fault.stage.split() == ["train_theta0", "published"]
