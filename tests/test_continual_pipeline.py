"""The third pipeline on a tiny timeline: the same bytes whatever the workers, resumption after a
kill, DVC, and the page.
"""

import os
import shutil
import signal
from contextlib import chdir
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from isi.continual import run
from isi.continual.along import Step
from isi.continual.experiment import COSTS, FAULTS, MATRIX, Chain
from isi.params import load_continual
from isi.tables import paths
from tests import small_continual, stage_run
from tests.small_continual import NAME
from tests.small_pipeline import Dvc, dvc, stages_run
from tools import workspace

__all__ = ["dvc"]
WHOLE = run.step_of
LOG = Path("steps")  #: Of a worker, which has another memory, in the folder of the project.
PARTS = MATRIX.path(experiment=NAME).with_name("parts")


def logged(chain: Chain, *arguments: Any) -> Step:
    """A step that notes its chain and its snapshot."""
    with LOG.open("a", encoding="utf-8") as file:
        print(chain, arguments[-2], file=file)
    return WHOLE(chain, *arguments)


def killed_at_snapshot_2(chain: Chain, *arguments: Any) -> Step:
    if arguments[-2] == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return logged(chain, *arguments)


def project(folder: Path, workers: int, **changes: Any) -> Path:
    stage_run.lay_out(folder, {"compute.workers": workers})
    small_continual.lay_out(folder, **changes)
    return folder


def grown(folder: Path) -> dict[str, bytes]:
    """Bytes of the tables that do not differ from run to run."""
    with chdir(folder):
        stage_run.run(f"grow {NAME}")
        return {
            table.template: table.path(experiment=NAME).read_bytes() for table in (MATRIX, FAULTS)
        }


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, bytes]]:
    """A project after a run with one worker, and its tables."""
    folder = project(tmp_path_factory.mktemp("one"), 1)
    return folder, grown(folder)


def test_two_workers_write_the_same_bytes(
    tmp_path: Path, one: tuple[Path, dict[str, bytes]]
) -> None:
    assert grown(project(tmp_path, 2)) == one[1]


def test_tables_have_every_chain_phase_and_test_set(one: tuple[Path, dict[str, bytes]]) -> None:
    with chdir(one[0]):
        matrix, costs = (table.read_text(experiment=NAME) for table in (MATRIX, COSTS))
    chains = matrix[["initializer", "strategy", "seed"]].drop_duplicates()
    pairs = [("er_avg", "insert"), ("er_avg", "replay"), ("default", "insert")]
    first = [(seed,) for seed in range(2)]
    assert len(chains) == len(first) * (1 + len(pairs))
    of_chains = matrix.dropna(subset=["initializer"])
    assert set(of_chains.groupby(["phase", "i", "j"]).groups) == {
        (phase, i, j) for phase in ("inserted", "trained") for i in (1, 2) for j in range(i + 1)
    }
    assert len(costs) == 2 * (1 + len(pairs) * 2 * 2)
    assert (costs["seconds"] >= 0).all()
    assert costs["peak_mib"].isna().all() or (costs["peak_mib"] > 50).all()


def test_a_killed_run_goes_on_at_the_snapshot_where_it_ended(
    tmp_path: Path, one: tuple[Path, dict[str, bytes]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker is killed in the first step of snapshot 2; the steps before it are not repeated."""
    folder = project(tmp_path, 1)
    log = folder / LOG
    monkeypatch.setattr(run, "step_of", killed_at_snapshot_2)
    with pytest.raises(SystemExit, match="worker process was killed"):
        grown(folder)
    before = log.read_text(encoding="utf-8").splitlines()
    assert {step.rsplit(" ", 1)[1] for step in before} == {"0", "1"}
    assert not (folder / MATRIX.path(experiment=NAME)).exists()
    monkeypatch.setattr(run, "step_of", logged)
    assert grown(folder) == one[1]
    steps = log.read_text(encoding="utf-8").splitlines()
    assert len(steps) == len(set(steps)) == 2 + 2 * 3 * 2


def test_finished_steps_are_read_and_those_of_other_settings_are_not(
    tmp_path: Path, one: tuple[Path, dict[str, bytes]], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "again"
    shutil.copytree(one[0], folder, symlinks=True)
    steps = list[str]()

    def counted(_: object, tasks: list[Any], *_others: Any) -> None:
        steps.extend(str(chain) for chain, *_ in tasks)
        raise KeyboardInterrupt

    monkeypatch.setattr(run, "run_each", counted)
    assert grown(folder) == one[1]
    assert steps == []
    # the files of another strategy's option are missing; those of all other chains serve
    strategies = {"insert": {}, "replay": {"number": 6}}
    small_continual.write_params(folder, strategies=strategies)
    with pytest.raises(KeyboardInterrupt):
        grown(folder)
    assert steps == ["tiny, er_avg, replay, seed 0", "tiny, er_avg, replay, seed 1"]


def test_tables_are_made_of_what_was_grown(one: tuple[Path, dict[str, bytes]]) -> None:
    with chdir(one[0]):
        stage_run.run("tables_continual")
        folder = paths.REPORTS / "continual" / "tables"
        table = pd.read_csv(folder / f"grown_{NAME}.csv")
        made = {path.stem for path in folder.glob("*.csv")}
    # nobody publishes any of this timeline
    assert made == {"carried", "matrices", f"grown_{NAME}", "faults"}
    assert list(table["initializer"]) == ["ERAvg", "ERAvg", "default"]
    assert table.notna().all(axis=None)
    assert len(set(table["base test, before"])) == 1


def test_dvc_runs_the_pipeline_and_runs_nothing_again(tmp_path: Path, dvc: Dvc) -> None:
    workspace.make(tmp_path, {})
    for path in (paths.CONTINUAL_PIPELINE,):
        (tmp_path / path).parent.mkdir()
        shutil.copy2(stage_run.ROOT / path, tmp_path / path)
    folder = Path("data") / "raw" / NAME
    small_continual.write_timeline(tmp_path / folder)
    small_continual.write_params(tmp_path, timeline=str(folder), seeds=1)
    target = str(paths.CONTINUAL_PIPELINE)
    assert stages_run(dvc(tmp_path, "repro", target)) == {
        f"{target}:grow@{NAME}",
        f"{target}:tables_continual",
        f"{target}:report_continual",
    }
    assert (tmp_path / "reports/continual/index.html").exists()
    lock = yaml.safe_load((tmp_path / target).with_name("dvc.lock").read_text(encoding="utf-8"))
    (of_folder,) = (
        dep for dep in lock["stages"]["tables_continual"]["deps"] if dep["path"] == "data/continual"
    )
    assert of_folder["nfiles"] == 4  # without the parts of a killed run
    assert list((tmp_path / PARTS).glob("*.parquet"))
    assert stages_run(dvc(tmp_path, "repro", target)) == set()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"timeline": "ENTITTY"}, r"continual\.tiny\.timeline.*ENTITY"),
        ({"initializers": {"er_avgg": {}}}, r"tiny\.initializers\.er_avgg"),
        ({"initializers": {"default": {"k": 1}}}, "default: expected no options"),
        ({"strategies": {"replay": {"count": 5}}}, r"strategies\.replay\.count"),
        ({"pairs": {"er_avg": ["ewc"]}}, r"pairs\.er_avg.*'ewc'"),
        ({"training": small_continual.ENTRY["training"] | {"loss": "margin"}}, "negatives"),
    ],
)
def test_a_wrong_entry_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, Any], message: str
) -> None:
    small_continual.lay_out(tmp_path, **change)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(Exception, match=message):
        load_continual()
