"""The project in any folder: spaces and other letters in its path, no git,
and the report of another processor.
"""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.environment import ENVIRONMENT
from tools import committed

ROOT = Path(__file__).parent.parent
ODD = "a b'c é $HOME"
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
PROGRAMS = ("python", "python3", "pip", "ruff", "mypy", "pytest", "mkdocs", "twine", "mutmut", "uv")
RULES = sorted(set(re.findall(r"^([a-z-]+):", MAKEFILE, re.MULTILINE)) - {"clean"})
MAKE, GIT = (shutil.which(name) or "" for name in ("make", "git"))
needs_git = pytest.mark.skipif(not GIT, reason="no git")


@pytest.fixture
def odd(tmp_path: Path) -> Path:
    folder = tmp_path / ODD
    folder.mkdir()
    return folder


# The Makefile


@pytest.fixture
def with_programs(odd: Path) -> Path:
    """A folder with the Makefile and an environment whose programs only
    note that they were called.
    """
    (odd / ".venv" / "bin").mkdir(parents=True)
    for name in PROGRAMS:
        program = odd / ".venv" / "bin" / name
        program.write_text(f'#!/bin/sh\necho {name} >> "$CALLED"\n', encoding="utf-8")
        program.chmod(0o755)
    for name in ("docs", "beyond", "quick"):
        (odd / name).mkdir()
    for name in (
        "Makefile",
        "params.yaml",
        "beyond/params.yaml",
        "requirements.lock",
        "pyproject.toml",
    ):
        shutil.copyfile(ROOT / name, odd / name)
    return odd


@pytest.mark.skipif(not MAKE, reason="no make")
@pytest.mark.parametrize("rule", RULES)
def test_a_rule_calls_the_programs_of_its_own_environment(with_programs: Path, rule: str) -> None:
    called = with_programs / "called"
    environment = ENVIRONMENT | {"CALLED": str(called)}
    made = subprocess.run(
        [MAKE, rule], cwd=with_programs, env=environment, capture_output=True, text=True
    )
    assert made.returncode == 0, made.stderr
    assert called.exists() or rule == "help"


# DVC


def pipeline(folder: Path) -> None:
    """A pipeline of one stage, and the configuration of this project."""
    stages = {
        "echo": {"cmd": "echo done > out", "outs": [{"out": {"cache": False, "persist": True}}]}
    }
    (folder / "dvc.yaml").write_text(yaml.safe_dump({"stages": stages}), encoding="utf-8")
    (folder / ".dvc").mkdir()
    shutil.copyfile(ROOT / ".dvc" / "config", folder / ".dvc" / "config")


def repro(folder: Path) -> str:
    """The output of ``tools/repro.py``, which must end well."""
    command = [sys.executable, str(ROOT / "tools" / "repro.py")]
    ran = subprocess.run(command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def test_the_pipeline_runs_without_git_and_says_once_what_cannot(odd: Path) -> None:
    pipeline(odd)
    first = repro(odd)
    assert (odd / "out").exists()
    assert "no git repository" in first
    assert "no git repository" not in repro(odd)


@needs_git
def test_in_a_git_repository_dvc_uses_git(odd: Path) -> None:
    subprocess.run([GIT, "init", "--quiet"], cwd=odd, check=True)
    pipeline(odd)
    assert "no git repository" not in repro(odd)
    assert not (odd / ".dvc" / "config.local").exists()


# The report of another processor


METRICS = {"graph": {"entities": 145}, "mrr": {"es": 72.05, "ers": 72.24, "never": None}}


@pytest.mark.parametrize(
    ("metrics", "said"),
    [
        (METRICS, ["3 of 3 numbers are equal"]),
        (
            METRICS | {"mrr": {"es": 72.06, "ers": 72.24, "never": 1.0}},
            [
                "2 of 3 numbers are equal",
                "1 differ as they may on another processor",
                "1 are in one report only",
            ],
        ),
        (
            {"graph": {"entities": 146}, "mrr": {"es": 74.06, "ers": 72.2}},
            [
                "0 of 3 numbers are equal",
                "1 differ as they may",
                "2 differ more",
                ": mrr.es is 74.06, not 72.05, graph.entities is 146, not 145",
            ],
        ),
        ({"mrr": {}}, ["0 of 0 numbers are equal", "3 are in one report only"]),
    ],
    ids=["equal", "another processor", "another graph", "other params"],
)
def test_a_line_says_how_a_report_differs_from_the_committed_one(
    metrics: dict[str, object], said: list[str]
) -> None:
    line = committed.compared(metrics, METRICS)
    assert "\n" not in line
    assert not [part for part in said if part not in line], line
    assert ("differ more" in line) == any(" is " in part for part in said)


@needs_git
def test_the_committed_text_is_that_before_a_run(odd: Path) -> None:
    (odd / "metrics.json").write_text('{"mrr": 72.0}', encoding="utf-8")
    assert committed.text_of("metrics.json", odd) is None
    assert "no git" in committed.against_commit("metrics.json", odd)
    identity = ["-c", "user.name=ISI", "-c", "user.email=isi@localhost"]
    for arguments in (
        ["init", "-q"],
        ["add", "metrics.json"],
        [*identity, "commit", "-q", "-m", "Baseline"],
    ):
        subprocess.run([GIT, *arguments], cwd=odd, check=True)
    (odd / "metrics.json").write_text('{"mrr": 73.0}', encoding="utf-8")
    assert committed.text_of("metrics.json", odd) == '{"mrr": 72.0}'
    assert "mrr is 73, not 72" in committed.against_commit("metrics.json", odd)
