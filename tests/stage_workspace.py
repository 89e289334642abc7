"""A folder in which a test runs stages in its own process, with the outputs of earlier stages."""

import sys
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path

import pandas as pd
import pytest
import yaml

from isi.tables import paths
from isi.tables.table import Table
from stages.files import ENTITIES, OBSERVATIONS, TRIPLES
from stages.files import KINDS as KIND_TABLE
from stages.pipeline import PIPELINE
from tests.stage_run import main_of
from tools.workspace import change

ROOT = Path(__file__).parent.parent
OBSERVED = pd.DataFrame(
    {
        "scene": ["FloorPlan1"],
        "room": ["kitchen"],
        "instance": ["Mug|1"],
        "head": ["mug"],
        "relation": ["atLocation"],
        "tail": ["kitchen"],
        "count": [1],
    }
)
KINDS = pd.DataFrame(
    {"entity": ["kitchen", "mug"], "kind": ["room", "object"], "phrase": ["kitchen", "mug"]}
)
#: Runs a stage (its name and arguments), and returns the one line with which it refuses its input.
Says = Callable[[str], str]


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """A folder with the code, the sources, the params and the pipeline."""
    for name in ("isi", "stages", "data/raw", "beyond"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).symlink_to(ROOT / name)
    for path in (paths.PARAMS, PIPELINE):
        (tmp_path / path).write_bytes((ROOT / path).read_bytes())
    return tmp_path


def set_params(workspace: Path, changes: dict[str, object]) -> None:
    params = yaml.safe_load((workspace / "params.yaml").read_text(encoding="utf-8"))
    for key, value in changes.items():
        change(params, key, value)
    (workspace / "params.yaml").write_text(yaml.safe_dump(params), encoding="utf-8")


def outputs(workspace: Path) -> dict[str, bytes]:
    """Bytes of every file under ``data`` outside ``raw``, by path."""
    files = [
        path
        for path in (workspace / "data").rglob("*")
        if path.is_file() and "raw" not in path.parts
    ]
    return {str(path.relative_to(workspace)): path.read_bytes() for path in files}


def leave(workspace: Path, *earlier: Path) -> None:
    """Write outputs of an earlier run, which a failed run must not change."""
    for path in earlier:
        (workspace / path).parent.mkdir(parents=True, exist_ok=True)
        (workspace / path).write_bytes(b"the last good one")


def write(workspace: Path, path: Path, frame: pd.DataFrame, table: Table) -> None:
    """Write a table as an earlier stage does."""
    with chdir(workspace):
        table.write_file(path, frame, "an_earlier_stage")


def observed(workspace: Path, source: str, observations: pd.DataFrame, kinds: pd.DataFrame) -> None:
    """Write the tables that mining a source gives."""
    write(workspace, OBSERVATIONS.path(source=source), observations, OBSERVATIONS)
    write(workspace, KIND_TABLE.path(source=source), kinds, KIND_TABLE)


def graph(workspace: Path, experiment: str) -> None:
    """Write the tables of a graph with a mug in a kitchen."""
    triples = OBSERVED[["head", "relation", "tail", "count"]].assign(source="ai2thor")
    write(workspace, TRIPLES.path(experiment=experiment), triples, TRIPLES)
    write(workspace, ENTITIES.path(experiment=experiment), KINDS.assign(source="ai2thor"), ENTITIES)


@pytest.fixture
def says(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Says:
    """A function that runs a stage, and returns its one line of refusal;
    it checks that no output changes.
    """

    def say(command: str) -> str:
        monkeypatch.chdir(workspace)
        monkeypatch.setattr(sys, "argv", [f"stages.{command.split()[0]}", *command.split()[1:]])
        before = outputs(workspace)
        with pytest.raises(SystemExit) as ended:
            main_of(command.split()[0])()
        line = ended.value.code
        assert outputs(workspace) == before
        assert capsys.readouterr() == ("", "")
        assert isinstance(line, str)
        assert "\n" not in line
        assert len(line) < 300
        return line.removeprefix(f"{command.split()[0]}: ")

    return say
