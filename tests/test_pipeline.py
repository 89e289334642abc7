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
from typing import Any

import networkx as nx
import pandas as pd
import psutil
import pyarrow.parquet as pq
import pytest
import torch
import yaml
from dvc.repo import Repo
from safetensors.torch import load_file

from tools import workspace

#: The paper's, and one control.
ISI = ("es", "rs", "ers")
INITIALIZERS = ("xavier", "iu", "es", "rs", "ers", "es_permuted")
SMALL: dict[str, Any] = {
    "sessions.seeds": 3, "sessions.sizes": [1, 2], "embedding.dimension": 8, "training.max_epochs": 4,
    "training.evaluate_every": 2, "finetuning.max_epochs": 3, "curves.sizes": [2], "compute.stack": 2,
    "sweep.k": [1, 8], "sweep.size": 2, "sweep.seeds": 2, "rates.size": 2, "approach.size": 2, "approach.epochs": 2,
    "cross_validation": {"folds": 3, "dimension": [12], "ratio": [], "learning_rate": [0.2], "weight_decay": []},
    "insert.initializers": list(INITIALIZERS), "transfer.seeds": 3,
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
    assert len(ran(dvc(made, "repro"))) == 16 + 2 * len(INITIALIZERS) + len(ISI)
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


def test_every_size_of_the_indicator_set_is_swept_with_the_first_seeds(folder: Path) -> None:
    for name in ISI:
        runs = pd.read_parquet(folder / f"data/sweeps/indicators/{name}.parquet")
        cells = runs[["k", "size", "seed"]].drop_duplicates()
        assert cells.to_numpy().tolist() == [[k, 2, seed] for k in (1, 8) for seed in (0, 1)]
        assert set(runs["scope"]) == SCOPES | {"novel"}
    swept = pd.read_parquet(folder / "data/sweeps/indicators/es.parquet")
    main = pd.read_parquet(folder / "data/runs/ai2thor/es.parquet").query("size == 2")  # of 8 indicators
    same = swept.merge(main, on=["seed", "epoch", "scope"], suffixes=("", " of main")).dropna(subset=["mrr_star"])
    equal = (same["mrr_star"] == same["mrr_star of main"]).groupby(same["k"]).all()
    assert equal.to_dict() == {1: False, 8: True}


def test_other_rates_start_from_the_same_vectors(folder: Path) -> None:
    rates = pd.read_parquet(folder / "data/sweeps/rates.parquet")
    assert set(rates["initializer"]) == set(INITIALIZERS)
    assert set(rates["factor"]) == {0.5, 2.0}
    for name in INITIALIZERS:
        main = pd.read_parquet(folder / f"data/runs/ai2thor/{name}.parquet").query("size == 2")
        for factor in (0.5, 2.0):
            own = rates[(rates["initializer"] == name) & (rates["factor"] == factor)]
            both = own.merge(main, on=["seed", "epoch", "scope"], suffixes=("", " of main"))
            same = (both["mrr_star"] == both["mrr_star of main"]) | both["mrr_star"].isna()
            assert same[both["epoch"] == 0].all()
            assert set(own["seed"]) == {0, 1, 2}


def test_every_setting_is_cross_validated_on_every_fold(folder: Path) -> None:
    table = pd.read_parquet(folder / "data/cross_validation/ai2thor.parquet")
    settings = table[["dimension", "ratio", "learning_rate", "weight_decay", "fold"]].to_numpy().tolist()
    expected = [(8, 9, 0.1, 0.001), (8, 9, 0.2, 0.001), (12, 9, 0.1, 0.001)]
    assert settings == [[*setting, fold] for setting in expected for fold in range(3)]
    assert table["mrr_star"].between(0, 1).all()
    assert set(table["epoch"]) <= {2, 4}


def test_the_entity_of_figure_1_starts_where_the_experiment_inserts_it(folder: Path) -> None:
    traced = load_file(folder / "data/approach/ai2thor.safetensors")
    novel = pd.read_parquet(folder / "data/sessions/ai2thor/novel.parquet").query("size == 2 and seed == 0")["entity"]
    place = novel.tolist().index(int(traced["entity"]))
    theta0 = load_file(folder / "data/embeddings/ai2thor/theta0/size=02.safetensors")
    assert traced["theta0"].equal(theta0["entity"][0])
    assert traced["known"].equal(theta0["known"][0])
    for name in ("xavier", "iu", *ISI):
        path, indicators = traced[f"{name}.path"], traced[f"{name}.indicators"]
        assert path[0].equal(load_file(folder / f"data/runs/ai2thor/{name}.safetensors")["size=02"][0, place])
        assert path.shape == (3, 8)
        assert not path[1:].eq(path[0]).all(1).any()
        if name in ISI:
            centroid = theta0["entity"][0][indicators].mean(0)
            assert torch.allclose(path[0], centroid, atol=1e-6)
        else:
            assert not indicators.any()


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
    assert page.count("<svg") == 7
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


def test_every_number_that_the_paper_states_has_a_row_beside_ours(folder: Path) -> None:
    def leaves(value: Any) -> list[float]:
        parts = list(value.values()) if isinstance(value, dict) else None
        return [value] if parts is None else [leaf for part in parts for leaf in leaves(part)]

    stated = yaml.safe_load((folder / "data/raw/paper/values.yaml").read_text(encoding="utf-8"))
    rows = pd.read_csv(folder / "reports/tables/paper_against_this_run.csv")
    given = rows["paper"].value_counts()
    for number, times in pd.Series(leaves(stated)).value_counts().items():
        assert given.get(number, 0) >= times or number in (41.4, 37.6, 42.1, 78.2), number
    assert given[41.4] == 2  # the abstract's, which is ES's
    assert rows["paper"].round(1).eq(40.4).sum() == 1
    runs = pd.read_parquet(folder / "data/runs/transfer/es.parquet")
    at_once = runs[(runs["epoch"] == 0) & (runs["scope"] == "novel")]["mrr_star"].mean()
    own = rows[rows["what"] == "ES: MRR* at once, new entities' queries"].iloc[0]
    assert (own["paper"], own["this run"]) == (85.7, pytest.approx(100 * at_once, rel=1e-5))


def test_each_repeat_of_the_transfer_has_ai2thors_entities_and_its_ten(folder: Path) -> None:
    def table(path: str) -> pd.DataFrame:
        return pd.read_parquet(folder / f"data/{path}.parquet")

    entities, triples = table("graph/transfer/entities"), table("graph/transfer/triples")
    old = table("graph/ai2thor/entities")
    assert entities["entity"][: len(old)].tolist() == old["entity"].tolist()
    novel, told = table("sessions/transfer/novel"), table("sessions/transfer/insert_triples")
    ids = dict(zip(entities["entity"], entities.index, strict=True))
    answers = table("runs/transfer/es.affordances")
    for seed, split in table("sessions/transfer/splits").groupby("seed"):
        drawn = set(novel[novel["seed"] == seed]["entity"])
        assert len(drawn) == 10
        assert set(entities["source"].astype(str)[list(drawn)]) == {"mp3d"}
        own = triples.loc[split["triple"]]
        ends = {ids[name] for name in [*own["head"], *own["tail"]]}
        assert ends == set(range(len(old))) | drawn
        assert (own["source"] == "ai2thor").sum() == (triples["source"] == "ai2thor").sum()
        train = set(split.loc[split["split"] == "train", "triple"])
        assert set(told[told["seed"] == seed]["triple"]) <= train
        ranked = answers[answers["seed"] == seed]
        assert set(ranked["entity"]) == drawn
        assert set(ranked["answer"]) == ends
        assert (ranked.groupby("entity")["rank"].apply(sorted).map(len) == len(ends)).all()
    runs = table("runs/transfer/es")
    assert set(runs["epoch"]) == set(range(SMALL["finetuning.max_epochs"] + 1))  # followed to the last


def test_editing_the_indicators_of_es_re_runs_es_and_the_report_alone(folder: Path) -> None:
    files = [*(folder / "data").rglob("*.parquet"), *(folder / "data").rglob("*.safetensors")]
    before = {
        path: path.read_bytes()
        for path in files
        if path.name.split(".")[0] not in ("es", "rates") and path.parent.name != "approach"
    }
    set_param(folder, "initializers.es.k", 3)
    again = {"insert@es", "transfer_insert@es", "vary_rate", "trace_approach", "report"}
    assert ran(dvc(folder, "repro")) == again
    assert {path: path.read_bytes() for path in before} == before


def test_editing_a_param_of_one_experiment_touches_that_experiment_and_the_report_alone(folder: Path) -> None:
    edits: dict[str, tuple[object, set[str]]] = {
        "transfer.size": (9, {"transfer_sessions"}),
        "mp3d.min_observations": (7, {"transfer_graph"}),
        "sweep.k": ([2], {f"sweep_indicators@{name}" for name in ISI}),
        "cross_validation.folds": (2, {"cross_validate"}),
        "rates.factors": ([3.0], {"vary_rate"}),
        "approach.epochs": (3, {"trace_approach"}),
        "curves.sizes": ([1], {f"insert@{name}" for name in INITIALIZERS}),
    }
    params = (folder / "params.yaml").read_text(encoding="utf-8")
    assert not json.loads(dvc(folder, "status", "--json"))
    for key, (value, own) in edits.items():
        set_param(folder, key, value)
        assert set(json.loads(dvc(folder, "status", "--json"))) == own | {"report"}, key
        (folder / "params.yaml").write_text(params, encoding="utf-8")


def test_nothing_of_one_experiment_depends_on_another() -> None:
    graph = Repo(str(workspace.ROOT)).index.graph  # from a stage to those that it depends on
    names = {stage: stage.addressing for stage in graph}
    leaves = ("sweep_indicators", "vary_rate", "cross_validate", "trace_approach", "insert@")
    for stage, name in names.items():
        after = {names[other] for other in nx.ancestors(graph, stage)} - {"report"}
        if "transfer" in name:
            assert all("transfer" in other for other in after)
        if name.startswith(leaves):
            assert not after


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
    inserted = {f"{stage}@{name}" for stage in ("insert", "transfer_insert") for name in (*INITIALIZERS, "nearest")}
    others = {f"sweep_indicators@{name}" for name in ISI} | {"vary_rate", "trace_approach", "report"}
    assert ran(dvc(folder, "repro")) == inserted | others
    assert "nearest" in (folder / "reports/tables/immediate.md").read_text(encoding="utf-8")
    vectors = load_file(folder / "data/runs/ai2thor/nearest.safetensors")
    assert vectors["size=02"].shape == (3, 2, 8)


def test_nothing_goes_on_after_dvc_is_killed_and_nothing_half_done_counts(tmp_path: Path) -> None:
    workspace.make(tmp_path, SMALL | {"training.max_epochs": 5000, "training.patience": 5000, "compute.workers": 2})
    dvc(tmp_path, "repro", "make_sessions")
    command = [sys.executable, "-m", "dvc", "repro", "train_theta0@ai2thor"]
    environment = ENVIRONMENT | {"SHELL": "/bin/sh"}  # which, unlike bash, may wait for its last command
    run = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    assert wait_until(lambda: len(working_in(tmp_path)) >= 5, 60)  # dvc, the stage, its server and two workers
    run.kill()
    run.wait()
    wait_until(lambda: not working_in(tmp_path), 60)  # a worker that is still importing has to finish that first
    assert not [process.cmdline() for process in working_in(tmp_path)]
    assert not (tmp_path / "data/embeddings").exists()
    set_param(tmp_path, "training.max_epochs", 2)
    assert "train_theta0@ai2thor" in ran(dvc(tmp_path, "repro", "train_theta0@ai2thor"))
