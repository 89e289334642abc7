"""The last commit's report and locks: a run since then may have changed those of this
folder in their last digits.
"""

import io
import subprocess
import tarfile
from pathlib import Path

import pytest

from tools import committed

ROOT = committed.ROOT


def text_of(path: Path) -> str:
    """The text of a file in the last commit; without git, of this folder."""
    text = committed.text_of(str(path))
    if text is None:
        _skip_after_a_run()
        return (ROOT / path).read_text(encoding="utf-8")
    return text


def with_report(folder: Path) -> Path:
    """Fill an empty folder with what pages show:
    the report of the last commit, and the rest of this folder.

    Returns the folder; without git, the root.
    """
    archive = ["git", "archive", "--format=tar", "HEAD", "reports"]
    try:
        done = subprocess.run(archive, cwd=ROOT, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        _skip_after_a_run()
        return ROOT
    with tarfile.open(fileobj=io.BytesIO(done.stdout)) as tar:
        tar.extractall(folder, filter="data")
    for name in ("docs", "params.yaml"):
        (folder / name).symlink_to(ROOT / name)
    return folder


def _skip_after_a_run() -> None:
    if (ROOT / "data" / "observations").exists():
        pytest.skip("without git, nothing tells what was here before the last run")
