"""One run of the whole pipeline through DVC on a small grid, then what an edit re-runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pandas as pd
import psutil
import pyarrow.parquet as pq
import pytest
import yaml
from safetensors.torch import load_file

from tools import workspace

#: The paper's, and one control.
INITIALIZERS = ("xavier", "iu", "es", "rs", "ers", "es_permuted")
SMALL = {
    "sessions.seeds": 3, "sessions.sizes": [1, 2], "embedding.dimension": 8, "training.max_epochs": 4,
    "training.evaluate_every": 2, "finetuning.max_epochs": 3, "curves.sizes": [2], "compute.stack": 2,
    "insert.initializers": list(INITIALIZERS),
}  # fmt: skip
SCOPES = {"all", "known", "known_closed", "novel_heldout"}


#: With this interpreter's ``python`` first on the path.
ENVIRONMENT = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}


def dvc(folder: Path, *arguments: str) -> str:
    """Run DVC in a folder; what it printed."""
    command = [sys.executable, "-m", "dvc", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=ENVIRONMENT)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def ran(output: str) -> set[str]:
    """The stages that ``dvc repro`` says it ran."""
    return {line.split("'")[1] for line in output.splitlines() if line.startswith("Running stage")}


def working_in(folder: Path) -> list[psutil.Process]:
    """Processes whose working directory is a folder."""
    found = []
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            if Path(process.cwd()) == folder and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
    return found


def wait_until(condition: Callable[[], bool], seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.1)
    return condition()


def set_param(folder: Path, key: str, value: object) -> None:
    path = folder / "params.yaml"
    params = yaml.safe_load(path.read_text(encoding="utf-8"))
    workspace.change(params, key, value)
    path.write_text(yaml.safe_dump(params, sort_keys=False, allow_unicode=True), encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace in which the pipeline has run."""
    made = tmp_path_factory.mktemp("pipeline")
    workspace.make(made, SMALL)
    assert len(ran(dvc(made, "repro"))) == 7 + len(INITIALIZERS)
    return made


def test_a_second_run_does_nothing(folder: Path) -> None:
    output = dvc(folder, "repro")
    assert not ran(output)
    assert "up to date" in output


def test_runs_have_every_cell_epoch_and_scope(folder: Path) -> None:
    for name in INITIALIZERS:
        runs = pd.read_parquet(folder / f"data/runs/ai2thor/{name}.parquet")
        cells = runs[["size", "seed"]].drop_duplicates()
        assert len(cells) == 6
        assert set(runs.loc[runs["epoch"] == 0, "scope"]) == SCOPES | {"novel"}
        assert set(runs.loc[runs["epoch"] > 0, "scope"]) <= SCOPES
        followed = runs[(runs["size"] == 2) & (runs["scope"] == "all")]
        assert (followed.groupby("seed")["epoch"].apply(sorted) == pd.Series([[0, 1, 2, 3]] * 3)).all()
        known = runs["mrr_star"].dropna()
        assert known.between(0, 1).all()
        halves = runs[["mrr_star_entity", "mrr_star_relation"]].mean(axis=1)
        assert (halves - runs["mrr_star"]).abs().max() < 1e-12
        assert (runs["mrr_star"].isna() == (runs["queries"] == 0)).all()
        vectors = load_file(folder / f"data/runs/ai2thor/{name}.safetensors")
        assert {key: tuple(value.shape) for key, value in vectors.items()} == {
            "size=01": (3, 1, 8),
            "size=02": (3, 2, 8),
        }


def test_all_initializers_start_from_the_same_earlier_knowledge(folder: Path) -> None:
    def closed(name: str) -> pd.DataFrame:
        runs = pd.read_parquet(folder / f"data/runs/ai2thor/{name}.parquet")
        return runs[(runs["epoch"] == 0) & (runs["scope"] == "known_closed")].reset_index(drop=True)

    for name in INITIALIZERS[1:]:
        # A tie is as wide as the largest score of its row, which may be a novel entity's: hence the tolerance.
        pd.testing.assert_frame_equal(closed(name), closed("xavier"), check_categorical=False, atol=1e-4)


def test_theta0_knows_all_but_the_novel_entities(folder: Path) -> None:
    novel = pd.read_parquet(folder / "data/sessions/ai2thor/novel.parquet")
    for size in (1, 2):
        theta0 = load_file(folder / f"data/embeddings/ai2thor/theta0/size={size:02d}.safetensors")
        for row, seed in enumerate(theta0["seed"].tolist()):
            own = novel[(novel["size"] == size) & (novel["seed"] == seed)]["entity"].tolist()
            assert (~theta0["known"][row]).nonzero().flatten().tolist() == own
            assert not theta0["entity"][row, own].any()
            assert theta0["entity"][row][theta0["known"][row]].any(-1).all()


def test_tables_name_their_stage_and_params(folder: Path) -> None:
    for name, stage in (("es", "insert"), ("joint", "train_joint")):
        metadata = pq.read_schema(folder / f"data/runs/ai2thor/{name}.parquet").metadata
        assert metadata[b"isi.stage"].decode() == stage
        assert len(metadata[b"isi.params"]) == 64


def test_the_report_is_whole_and_stands_alone(folder: Path) -> None:
    page = (folder / "reports/index.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 3
    assert "src=" not in page
    assert "<script" not in page
    assert "<link" not in page
    tables = {path.stem for path in (folder / "reports/tables").iterdir()}
    for name in tables:
        for form in ("csv", "md", "tex"):
            assert (folder / f"reports/tables/{name}.{form}").stat().st_size
    assert "\\toprule" in (folder / "reports/tables/table2_convergence.tex").read_text(encoding="utf-8")
    differences = pd.read_csv(folder / "reports/tables/differences.csv")
    assert len(differences) == 4 * len(INITIALIZERS) * (len(INITIALIZERS) - 1) / 2
    metrics = json.loads((folder / "reports/metrics.json").read_text(encoding="utf-8"))
    runs = pd.read_parquet(folder / "data/runs/ai2thor/rs.parquet")
    at_once = runs[(runs["epoch"] == 0) & (runs["scope"] == "novel")]["mrr_star"].mean()
    assert metrics["immediate_mrr_star"]["novel"]["rs"] == pytest.approx(100 * at_once, abs=1e-3)


def test_editing_the_indicators_of_es_re_runs_es_and_the_report_alone(folder: Path) -> None:
    files = [*(folder / "data").rglob("*.parquet"), *(folder / "data").rglob("*.safetensors")]
    before = {path: path.read_bytes() for path in files if path.name.split(".")[0] != "es"}
    set_param(folder, "initializers.es.k", 3)
    assert ran(dvc(folder, "repro")) == {"insert@es", "report"}
    assert {path: path.read_bytes() for path in before} == before


def test_the_number_of_workers_re_runs_nothing_and_changes_no_byte(folder: Path) -> None:
    set_param(folder, "compute.workers", 1)
    set_param(folder, "compute.stack", 3)
    assert not ran(dvc(folder, "repro"))
    before = {path: path.read_bytes() for path in (folder / "data/runs").rglob("*.*")}
    dvc(folder, "repro", "--force", "--single-item", "insert@rs")
    assert {path: path.read_bytes() for path in before} == before


def test_an_initializer_of_ones_own_goes_from_function_to_report(folder: Path) -> None:
    """Follows the README's section on it, with its code."""
    readme = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
    code = readme.partition("<!-- own initializer -->\n```python\n")[2].partition("```")[0]
    assert "@initializer" in code
    with (folder / "isi/initializers.py").open("a", encoding="utf-8") as file:
        file.write(f"\n\n{code}")
    set_param(folder, "insert.initializers", [*INITIALIZERS, "nearest"])
    set_param(folder, "initializers.nearest", {"scale": 0.5})
    assert ran(dvc(folder, "repro")) == {f"insert@{name}" for name in (*INITIALIZERS, "nearest")} | {"report"}
    assert "nearest" in (folder / "reports/tables/immediate.md").read_text(encoding="utf-8")
    vectors = load_file(folder / "data/runs/ai2thor/nearest.safetensors")
    assert vectors["size=02"].shape == (3, 2, 8)


def test_nothing_goes_on_after_dvc_is_killed_and_nothing_half_done_counts(tmp_path: Path) -> None:
    workspace.make(tmp_path, SMALL | {"training.max_epochs": 5000, "training.patience": 5000})
    dvc(tmp_path, "repro", "make_sessions")
    command = [sys.executable, "-m", "dvc", "repro", "train_theta0"]
    run = subprocess.Popen(command, cwd=tmp_path, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    assert wait_until(lambda: len(working_in(tmp_path)) >= 5, 60)  # dvc, the stage, its server and two workers
    run.kill()
    run.wait()
    assert wait_until(lambda: not working_in(tmp_path), 10)
    assert not (tmp_path / "data/embeddings").exists()
    set_param(tmp_path, "training.max_epochs", 2)
    assert "train_theta0" in ran(dvc(tmp_path, "repro", "train_theta0"))
