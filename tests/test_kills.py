"""Killed runs of the pipeline: the next run restores all outputs,
and the comparison detects missing ones.
"""

import random
import signal
import sys

import pytest

from tests.small_pipeline import Dvc, dvc
from tools.kills.__main__ import survived
from tools.kills.workspace import Fault, Lost, Workspace

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="looks for processes as Linux has them"
)


__all__ = ["dvc"]


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory: pytest.TempPathFactory, dvc: Dvc) -> Workspace:
    """A pipeline up to Θ⁰, whose last stage is killed, and the digests of its outputs."""
    inputs = ["observations", "graph", "sessions"]
    workspace = Workspace(tmp_path_factory.mktemp("kills"), ["train_theta0@paper"], inputs)
    dvc(workspace.folder, "repro", *workspace.targets)
    workspace.expected = workspace.digests()
    return workspace


def test_the_comparison_sees_changed_and_left_over_files(pipeline: Workspace) -> None:
    pipeline.compare()
    folder = pipeline.folder / "data/embeddings/paper"
    left, changed = folder / ".theta0.log.parquet.1.tmp", folder / "theta0.log.parquet"
    left.write_bytes(b"left over")
    before = changed.read_bytes()
    changed.write_bytes(before[:-1])
    with pytest.raises(
        Lost, match=r"^2 files differ, lack or stay: .*/\.theta0\.log\.parquet\.1\.tmp, "
    ):
        pipeline.compare()
    left.unlink()
    changed.write_bytes(before)


def test_a_killed_run_loses_nothing_and_leaves_no_process(pipeline: Workspace) -> None:
    """DVC is killed while workers train Θ⁰; the next run makes the same bytes."""
    assert "data/embeddings/paper/theta0.log.parquet" in pipeline.expected

    def strike() -> Fault | None:
        """A kill that ended the run; None if the worker's work was done before."""
        fault = pipeline.strike("DVC", signal.SIGKILL, 0, random.Random(0), running="a worker")
        return fault if fault and fault.status else None

    attempts = (survived(pipeline, strike) for _ in range(5))
    fault = next(filter(None, attempts), None)
    assert fault
    assert (fault.lost, fault.stage.split()) == ("", ["train_theta0", "paper"])
