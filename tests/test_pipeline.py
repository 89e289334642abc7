"""One run of the whole pipeline through DVC on a small grid, then what an edit re-runs."""

from __future__ import annotations

import json
import os
import re
import shutil
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
from safetensors.torch import load_file, save_file

from isi.bundle.folder import read
from isi.report import stats
from tests import documented
from tests.environment import ENVIRONMENT
from tools import workspace

#: The paper's.
ISI = ("es", "rs", "ers")
EXPERIMENTS = ("ai2thor", "transfer", "published")
INITIALIZERS = ("xavier", "iu", "es", "rs", "ers")
FAMILIES = ("complex", "transe")
SMALL: dict[str, Any] = {
    "experiments.ai2thor.sessions.seeds": 3, "experiments.ai2thor.sessions.sizes": [1, 2],
    "experiments.ai2thor.full_curves.sizes": [2], "experiments.transfer.sessions.seeds": 3,
    "experiments.published.sessions.seeds": 2, "experiments.published.sessions.sizes": [2],
    "experiments.published.full_curves.sizes": [2], "experiments.published.initializers": ["xavier", "ers"],
    "embedding.dimension": 8, "training.max_epochs": 4, "training.evaluate_every": 2, "finetuning.max_epochs": 3,
    "compute.stack": 2, "sweep.k": [1, 8], "sweep.size": 2, "sweep.seeds": 2, "rate_sweep.size": 2,
    "trajectory.size": 2, "trajectory.epochs": 2, "cross_validation.folds": 3, "cross_validation.dimension": [12],
    "cross_validation.ratio": [], "cross_validation.learning_rate": [0.2], "cross_validation.weight_decay": [],
    "compare_models.seeds": 2, "explorer.size": 2, "explorer.epochs": 2, "explorer.best": "iu", "explorer.answers": 3,
}  # fmt: skip
LEFT_OUT = {
    "initializers": ("mean", "kind_mean", "gaussian", "gaussian_centred", "es_permuted", "es_permuted_kinds",
                     "soft_hybrid", "map_soft_hybrid"),
    "compare_models.models": ("analogy", "distmult", "rotate"),
}  # fmt: skip
SMALL |= {f"{key}.{name}": workspace.DROP for key, names in LEFT_OUT.items() for name in names}
#: Of its stages: 3 sources; graph, words, sessions, theta0, joint, nothing inserted and what is asked of 3
#: experiments; insertion; affordances, cross-validation, the approach, what is kept, single insertions and the report;
#: indicators; rates; families.
STAGES = 3 + 3 * 7 + 3 * len(INITIALIZERS) + 6 + len(ISI) + len(INITIALIZERS) + len(FAMILIES)
SCOPES = {"all", "known", "known_closed", "novel_heldout"}


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
    assert len(ran(dvc(made, "repro"))) == STAGES
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


def test_an_embedding_of_the_whole_graph_is_kept_for_commands(folder: Path) -> None:
    kept, triples = (
        read(folder / "data/final_models/ai2thor"),
        pd.read_parquet(folder / "data/graph/ai2thor/triples.parquet"),
    )
    assert kept.manifest.model_name == "analogy"
    assert kept.entities.shape == (len(kept.entity_names), 8)
    named = [kept.entity_names, kept.relation_names, kept.entity_names]
    found = {tuple(names[row] for names, row in zip(named, triple, strict=True)) for triple in kept.triples.tolist()}
    assert found == set(triples[["head", "relation", "tail"]].astype(str).itertuples(index=False, name=None))
    log = pd.read_parquet(folder / "data/embeddings/ai2thor/joint.log.parquet")
    last = log[log["kept"]].groupby("seed")["epoch"].last()
    assert kept.manifest.made["epochs"] == last.sort_values().iloc[1]  # of 3
    assert kept.words is not None
    vectors = load_file(folder / "data/words/ai2thor/vectors.safetensors")["vectors"]
    assert (kept.words == vectors.numpy()).all()


def test_every_size_of_the_indicator_set_is_swept_with_the_first_seeds(folder: Path) -> None:
    for name in ISI:
        runs = pd.read_parquet(folder / f"data/analyses/indicator_sweep/ai2thor/{name}.parquet")
        cells = runs[["k", "size", "seed"]].drop_duplicates()
        assert cells.to_numpy().tolist() == [[k, 2, seed] for k in (1, 8) for seed in (0, 1)]
        assert set(runs["scope"]) == SCOPES | {"novel"}
    swept = pd.read_parquet(folder / "data/analyses/indicator_sweep/ai2thor/es.parquet")
    main = pd.read_parquet(folder / "data/runs/ai2thor/es.parquet").query("size == 2")  # of 8 indicators
    same = swept.merge(main, on=["seed", "epoch", "scope"], suffixes=("", " of main")).dropna(subset=["mrr_star"])
    equal = (same["mrr_star"] == same["mrr_star of main"]).groupby(same["k"]).all()
    assert equal.to_dict() == {1: False, 8: True}


def test_other_rates_start_from_the_same_vectors(folder: Path) -> None:
    for name in INITIALIZERS:
        rates = pd.read_parquet(folder / f"data/analyses/rate_sweep/ai2thor/{name}.parquet")
        assert set(rates["factor"]) == {0.5, 2.0}
        main = pd.read_parquet(folder / f"data/runs/ai2thor/{name}.parquet").query("size == 2")
        for factor in (0.5, 2.0):
            own = rates[rates["factor"] == factor]
            both = own.merge(main, on=["seed", "epoch", "scope"], suffixes=("", " of main"))
            same = (both["mrr_star"] == both["mrr_star of main"]) | both["mrr_star"].isna()
            assert same[both["epoch"] == 0].all()
            assert set(own["seed"]) == {0, 1, 2}


def test_every_setting_is_cross_validated_on_every_fold(folder: Path) -> None:
    table = pd.read_parquet(folder / "data/analyses/cross_validation/ai2thor.parquet")
    settings = table[["dimension", "ratio", "learning_rate", "weight_decay", "fold"]].to_numpy().tolist()
    expected = [(8, 9, 0.1, 0.001), (8, 9, 0.2, 0.001), (12, 9, 0.1, 0.001)]
    assert settings == [[*setting, fold] for setting in expected for fold in range(3)]
    assert table["mrr_star"].between(0, 1).all()
    assert set(table["epoch"]) <= {2, 4}


def test_the_entity_of_figure_1_starts_where_the_experiment_inserts_it(folder: Path) -> None:
    traced = load_file(folder / "data/analyses/trajectory/ai2thor.safetensors")
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


def test_what_is_asked_is_the_same_as_in_the_runs(folder: Path) -> None:
    asked = pd.read_parquet(folder / "data/analyses/query_breakdown/ai2thor.parquet").query("filter == 'learned'")
    assert set(asked["model"]) == {*INITIALIZERS, "joint"}
    found = stats.combined(asked, ["model", "size", "seed", "scope"])
    for name in (*INITIALIZERS, "joint"):
        runs = pd.read_parquet(folder / f"data/runs/ai2thor/{name}.parquet").query("epoch == 0 and queries > 0")
        both = runs.merge(found[found["model"] == name], on=["size", "seed", "scope"], suffixes=("", " of parts"))
        assert len(both) == runs["scope"].isin(["all", "novel", "novel_heldout"]).sum()
        for half in ("mrr_star", "mrr_star_entity", "mrr_star_relation"):
            assert (both[half] - both[f"{half} of parts"]).abs().max() < 1e-6
    used = pd.read_parquet(folder / "data/analyses/query_breakdown/ai2thor.used.parquet")
    assert used.groupby("part")["of"].unique().str.get(0).to_dict() == {"blocks": 2, "scalars": 4}


def test_theta0_knows_all_but_the_novel_entities(folder: Path) -> None:
    novel = pd.read_parquet(folder / "data/sessions/ai2thor/novel.parquet")
    for size in (1, 2):
        theta0 = load_file(folder / f"data/embeddings/ai2thor/theta0/size={size:02d}.safetensors")
        for row, seed in enumerate(theta0["seed"].tolist()):
            own = novel[(novel["size"] == size) & (novel["seed"] == seed)]["entity"].tolist()
            assert (~theta0["known"][row]).nonzero().flatten().tolist() == own
            assert not theta0["entity"][row, own].any()
            assert theta0["entity"][row][theta0["known"][row]].any(-1).all()


def test_tables_name_their_stage(folder: Path) -> None:
    for name, stage in (("es", "insert"), ("joint", "train_joint")):
        metadata = pq.read_schema(folder / f"data/runs/ai2thor/{name}.parquet").metadata
        assert metadata[b"isi.stage"].decode() == stage


def test_the_report_is_whole_and_stands_alone(folder: Path) -> None:
    page = (folder / "reports/index.html").read_text(encoding="utf-8")
    assert page.count("<figure") == 1 + 8 + 4 + 1  # the verdict's; four more of the paper's graph, one of the transfer
    assert "src=" not in page
    assert re.findall("<script[^>]*>", page) == [
        '<script type="application/json" id="explorer-data">', "<script>", "<script>",
    ]  # fmt: skip
    assert "<link" not in page
    tables = {path.stem for path in (folder / "reports/tables").iterdir()}
    for name in tables:
        for form in ("csv", "md", "tex"):
            assert (folder / f"reports/tables/{name}.{form}").stat().st_size
    assert "\\toprule" in (folder / "reports/tables/table2_convergence.tex").read_text(encoding="utf-8")
    differences = pd.read_csv(folder / "reports/tables/differences.csv")
    assert len(differences) == 5 * len(INITIALIZERS) * (len(INITIALIZERS) - 1) / 2
    metrics = json.loads((folder / "reports/metrics.json").read_text(encoding="utf-8"))
    runs = pd.read_parquet(folder / "data/runs/ai2thor/rs.parquet")
    immediate = runs[(runs["epoch"] == 0) & (runs["scope"] == "novel")]["mrr_star"].mean()
    assert metrics["immediate_mrr_star"]["novel"]["rs"] == pytest.approx(100 * immediate, abs=6e-3)


def verified(folder: Path) -> subprocess.CompletedProcess[str]:
    """What `make verify` says of every cell of a folder."""
    command = [sys.executable, "-m", "tools.verify", "--cells", "99"]
    environment = os.environ | {"PYTHONPATH": str(workspace.ROOT)}
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=environment)


def test_other_code_computes_the_same_from_the_tables_alone(folder: Path) -> None:
    ended = verified(folder)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    rows = {line[:18].strip(): line.split() for line in ended.stdout.splitlines()}
    models = 2 * 3 * 6 + 3 * 6 + 2 * 3  # of both sizes of ai2thor, of transfer and of published
    assert int(rows["MRR* at once"][-4]) == 5 * models
    assert int(rows["initial vectors"][-4]) > 100
    assert all(int(rows[what][-1]) == 0 for what in ("initial vectors", "MRR* at once", "mean epochs", "unconverged %"))


def alter_vector(folder: Path) -> None:
    path = folder / "data/runs/transfer/rs.safetensors"
    vectors = load_file(path)
    vectors["size=10"][1, 4, 2] += 1e-4
    save_file(vectors, path)


def alter_measure(folder: Path) -> None:
    path = folder / "data/runs/ai2thor/es.parquet"
    runs = pd.read_parquet(path)
    place = runs.index[(runs["epoch"] == 0) & (runs["scope"] == "known") & (runs["seed"] == 2)][0]
    runs.loc[place, "mrr_star_entity"] += 1e-4
    runs.to_parquet(path)


def alter_table(folder: Path) -> None:
    path = folder / "reports/tables/table2_convergence_published.csv"
    table = pd.read_csv(path).astype({"all: mean": float})
    table.loc[1, "all: mean"] += 0.1
    table.to_csv(path, index=False)


@pytest.mark.parametrize(
    ("alter", "said"),
    [
        (alter_vector, "initial vectors, rs, transfer, size 10, seed 1"),
        (alter_measure, "MRR* at once, es, scope known, ai2thor"),
        (alter_table, "mean epochs, ers, scope all, published, size any"),
    ],
)
def test_a_number_that_was_altered_is_found(
    folder: Path, tmp_path: Path, alter: Callable[[Path], None], said: str
) -> None:
    for name in ("graph", "words", "sessions", "embeddings", "runs"):
        shutil.copytree(folder / "data" / name, tmp_path / "data" / name)
    shutil.copytree(folder / "reports/tables", tmp_path / "reports/tables")
    shutil.copy2(folder / "params.yaml", tmp_path)
    alter(tmp_path)
    ended = verified(tmp_path)
    assert ended.returncode == 1
    (line,) = [line for line in ended.stdout.splitlines() if " here, " in line]
    assert line.startswith(said)


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
    immediate = runs[(runs["epoch"] == 0) & (runs["scope"] == "novel")]["mrr_star"].mean()
    own = rows[rows["what"] == "ES: immediate MRR*, new entities' queries"].iloc[0]
    assert (own["paper"], own["this run"]) == (85.7, pytest.approx(100 * immediate, abs=0.01))


def test_each_repeat_of_the_transfer_has_ai2thors_entities_and_its_ten(folder: Path) -> None:
    def table(path: str) -> pd.DataFrame:
        return pd.read_parquet(folder / f"data/{path}.parquet")

    entities, triples = table("graph/transfer/entities"), table("graph/transfer/triples")
    old = table("graph/ai2thor/entities")
    assert entities["entity"][: len(old)].tolist() == old["entity"].tolist()
    novel, told = table("sessions/transfer/novel"), table("sessions/transfer/insert_triples")
    ids = dict(zip(entities["entity"], entities.index, strict=True))
    answers = table("analyses/affordances/transfer").query("initializer == 'es'")
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
        if path.name.split(".")[0] != "es"
        and path.parent.name not in ("trajectory", "affordances", "query_breakdown", "explorer")
    }
    set_param(folder, "initializers.es.k", 3)
    again = {*(f"insert@{name}-es" for name in EXPERIMENTS), *(f"break_down_queries@{name}" for name in EXPERIMENTS),
             "sweep_rates@ai2thor-es", "trace_trajectory@ai2thor", "single_insertions@ai2thor", "rank_affordances@transfer",  # noqa: E501
             "report"}  # fmt: skip
    assert ran(dvc(folder, "repro")) == again
    assert {path: path.read_bytes() for path in before} == before


def test_undoing_an_edit_runs_nothing_but_the_report(folder: Path) -> None:
    edited = (folder / "data/runs/ai2thor/es.parquet").read_bytes()
    set_param(folder, "initializers.es.k", 8)
    assert ran(dvc(folder, "repro")) <= {"report"}  # whose outputs git keeps; all others come back from the cache
    assert (folder / "data/runs/ai2thor/es.parquet").read_bytes() != edited
    assert not json.loads(dvc(folder, "status", "--json"))


def test_an_output_that_is_gone_comes_back_by_checkout(folder: Path) -> None:
    path = folder / "data/runs/ai2thor/es.parquet"
    before = path.read_bytes()
    path.unlink()
    dvc(folder, "checkout", "--force")
    assert path.read_bytes() == before


def test_editing_a_param_of_one_experiment_touches_that_experiment_and_the_report_alone(folder: Path) -> None:
    edits: dict[str, tuple[object, set[str]]] = {
        "experiments.transfer.sessions.sizes": ([9], {"make_sessions@transfer"}),
        "experiments.transfer.graph.extend.min_observations": (7, {"build_graph@transfer"}),
        "sources.mp3d.rooms": ({"bedroom": "bedroom"}, {"mine@mp3d"}),
        "sweep.k": ([2], {f"sweep_indicators@ai2thor-{name}" for name in ISI}),
        "sweep.initializers.ers.candidates": (20, {"sweep_indicators@ai2thor-ers"}),
        "cross_validation.folds": (2, {"cross_validate@ai2thor"}),
        "rate_sweep.factors": ([3.0], {f"sweep_rates@ai2thor-{name}" for name in INITIALIZERS}),
        "trajectory.epochs": (3, {"trace_trajectory@ai2thor"}),
        "explorer.answers": (4, {"single_insertions@ai2thor"}),
        "compare_models.models.transe.learning_rate": (0.3, {"compare_models@ai2thor-transe"}),
        "experiments.ai2thor.full_curves.sizes": (
            [1],
            {"finetune_only@ai2thor", *(f"insert@ai2thor-{name}" for name in INITIALIZERS)},
        ),
    }
    params = (folder / "params.yaml").read_text(encoding="utf-8")
    assert not json.loads(dvc(folder, "status", "--json"))
    for key, (value, own) in edits.items():
        set_param(folder, key, value)
        assert set(json.loads(dvc(folder, "status", "--json"))) == own | {"report"}, key
        (folder / "params.yaml").write_text(params, encoding="utf-8")


def test_an_edit_of_code_touches_what_imports_it_alone(folder: Path) -> None:
    inserting = {
        *(f"insert@{name}-{initializer}" for name in EXPERIMENTS for initializer in INITIALIZERS),
        *(f"break_down_queries@{name}" for name in EXPERIMENTS),
        *(f"sweep_indicators@ai2thor-{name}" for name in ISI),
        *(f"sweep_rates@ai2thor-{name}" for name in INITIALIZERS),
        "trace_trajectory@ai2thor", "single_insertions@ai2thor", "rank_affordances@transfer",
    }  # fmt: skip
    edits = {
        "isi/initializers/paper.py": inserting,
        "isi/analyses/single_insertions.py": {"trace_trajectory@ai2thor", "single_insertions@ai2thor"},
        "isi/report/sections/__init__.py": set(),
        "isi/errors.py": set(),
        "isi/cli/__init__.py": set(),
    }
    for name, expected in edits.items():
        path = folder / name
        text = path.read_text(encoding="utf-8")
        path.write_text(f"{text}\n# edited\n", encoding="utf-8")
        assert set(json.loads(dvc(folder, "status", "--json"))) == expected | {"report"}, name
        path.write_text(text, encoding="utf-8")


def test_nothing_of_one_experiment_depends_on_another() -> None:
    graph = Repo(str(workspace.ROOT)).index.graph  # from a stage to those that it depends on
    names = {stage: stage.addressing for stage in graph if ":" not in stage.addressing}  # but for what lies beyond
    leaves = (
        "sweep_indicators",
        "sweep_rates",
        "cross_validate",
        "trace_trajectory",
        "single_insertions",
        "rank_affordances",
        "break_down_queries",
        "finetune_only",
        "compare_models",
        "train_final",
    )
    for stage, name in names.items():
        after = {names[other] for other in nx.ancestors(graph, stage) if other in names} - {"report"}
        own = name.partition("@")[2].split("-")[0]
        if own in EXPERIMENTS and not name.startswith("mine"):
            assert all(other.partition("@")[2].split("-")[0] == own for other in after), name
        if name.startswith(leaves):
            assert not after


def test_the_number_of_workers_re_runs_nothing_and_changes_no_byte(folder: Path) -> None:
    set_param(folder, "compute.workers", 1)
    set_param(folder, "compute.stack", 3)
    assert not ran(dvc(folder, "repro"))
    before = {path: path.read_bytes() for path in (folder / "data/runs").rglob("*.*")}
    dvc(folder, "repro", "--force", "--single-item", "insert@ai2thor-rs")
    assert {path: path.read_bytes() for path in before} == before


#: Household words, so that each has a word vector: head, relation, tail and count.
NOTEBOOK = [
    f"{head},{relation},{tail},{1 + number % 3}"
    for relation, heads, tails in (
        ("on", ("apple", "bowl", "bread", "cup", "egg", "fork", "knife", "pan", "plate"), ("shelf", "sink", "sofa")),
        ("beside", ("lamp", "laptop", "mirror", "pillow", "safe", "spoon"), ("apple", "bowl", "bread", "toaster")),
    )
    for number, (head, tail) in enumerate((head, tail) for head in heads for tail in tails)
]  # fmt: skip


def test_things_of_ones_own_go_from_their_files_to_the_report(tmp_path: Path) -> None:
    """Follows docs/extending.md, with its code and params."""
    changes: dict[str, Any] = {key: value for key, value in SMALL.items() if not key.startswith("experiments.")}
    changes |= {"training.batch_size": 64, "finetuning.batch_size": 64}
    changes |= {f"experiments.{name}": workspace.DROP for name in EXPERIMENTS}
    changes |= {f"sources.{name}": workspace.DROP for name in ("ai2thor", "mp3d", "published")}
    studies = (
        "sweep", "cross_validation", "rate_sweep", "trajectory", "compare_models", "affordances", "query_breakdown",
        "explorer",
    )  # fmt: skip
    for study in studies:
        changes[f"{study}.experiments"] = []
    for own in ("initializer", "model", "source", "experiment"):
        changes |= documented.params(f"own {own} params")
    workspace.make(tmp_path, changes)
    for folder, name, own in (
        ("isi/initializers", "nearest", "initializer"), ("isi/models", "transh", "model"),
        ("isi/sources", "notebook", "source"), ("isi/report/sections", "query_counts", "section"),
        ("stages", "count_triples", "stage"),
    ):  # fmt: skip
        (tmp_path / folder / f"{name}.py").write_text(documented.code(f"own {own}"), encoding="utf-8")
    contents = tmp_path / "isi/report/page.py"
    listed = contents.read_text(encoding="utf-8")
    assert listed.count('"run.run")') == 1
    contents.write_text(listed.replace('"run.run")', '"query_counts.query_counts", "run.run")'), encoding="utf-8")
    pipeline = (tmp_path / "dvc.yaml").read_text(encoding="utf-8")
    own_stage = documented.block("own stage dvc", "yaml").removeprefix("stages:\n")
    (tmp_path / "dvc.yaml").write_text(pipeline.replace("\nplots:\n", f"\n{own_stage}\nplots:\n"), encoding="utf-8")
    (tmp_path / "data/raw/notebook.csv").write_text(
        "\n".join(["head,relation,tail,count", *NOTEBOOK]), encoding="utf-8"
    )
    set_param(tmp_path, "experiments.notebook.initializers", ["xavier", "nearest"])
    stages = ran(dvc(tmp_path, "repro"))
    assert {"mine@notebook", "train_theta0@notebook", "insert@notebook-nearest", "count_triples@notebook"} <= stages
    runs = pd.read_parquet(tmp_path / "data/runs/notebook/nearest.parquet")
    assert set(runs["session"]) == {1, 2}
    joint = load_file(tmp_path / "data/embeddings/notebook/joint.safetensors")
    assert joint["relation"].shape[1:] == (2, 16)  # TransH's rows are twice as long
    assert "Nearest" in (tmp_path / "reports/tables/immediate.md").read_text(encoding="utf-8")
    assert (tmp_path / "reports/tables/queries.csv").stat().st_size
    assert "How much is asked" in (tmp_path / "reports/index.html").read_text(encoding="utf-8")
    counted = pd.read_parquet(tmp_path / "data/analyses/triple_counts/notebook.parquet").set_index("entity")["triples"]
    assert counted["apple"] == 3 + 6


def test_nothing_goes_on_after_dvc_is_killed_and_nothing_half_done_counts(tmp_path: Path) -> None:
    workspace.make(tmp_path, SMALL | {"training.max_epochs": 5000, "training.patience": 5000, "compute.workers": 2})
    dvc(tmp_path, "repro", "make_sessions@ai2thor")
    command = [sys.executable, "-m", "dvc", "repro", "train_theta0@ai2thor"]
    environment = ENVIRONMENT | {"SHELL": "/bin/sh"}  # which, unlike bash, may wait for its last command
    run = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    assert wait_until(lambda: len(working_in(tmp_path)) >= 4, 60)  # dvc, the stage and two workers
    run.kill()
    run.wait()
    wait_until(lambda: not working_in(tmp_path), 60)  # a worker that is still importing has to finish that first
    assert not [process.cmdline() for process in working_in(tmp_path)]
    assert not (tmp_path / "data/embeddings").exists()
    set_param(tmp_path, "training.max_epochs", 2)
    assert "train_theta0@ai2thor" in ran(dvc(tmp_path, "repro", "train_theta0@ai2thor"))
