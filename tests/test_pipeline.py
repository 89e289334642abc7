"""One run of the whole pipeline through DVC on a small grid,
and the stages that an edit re-runs.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import networkx as nx
import pandas as pd
import pytest
import torch
import yaml
from dvc.repo import Repo
from safetensors.torch import load_file, save_file

from isi.formats.plain import read
from stages.report.tables.estimates import combined
from tests.small_pipeline import EXPERIMENTS, INITIALIZERS, SMALL, Dvc, dvc, set_param, stages_run
from tools import workspace

__all__ = ["dvc"]
ISI = ("es", "rs", "ers")
SWEPT = ("es", "ers")
ANALYSES = (
    "sweep_indicators",
    "cross_validate",
    "trace_trajectory",
    "rank_affordances",
    "finetune_only",
    "train_final",
)
#: Of both experiments: source, graph, words, sessions, theta0, joint and insertion; then analyses,
#: sweeps, what the page demonstrates, the tables, the report.
STAGES = 2 * (6 + len(INITIALIZERS)) + 5 + len(SWEPT) + 3
SCOPES = {"known", "novel", "weighted", "held_out", "novel_held_out", "known_closed"}
HALVES = ("", "_entity", "_relation")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, dvc: Dvc) -> Path:
    """A workspace in which the pipeline has run."""
    pipeline = tmp_path_factory.mktemp("pipeline")
    workspace.make(pipeline, SMALL)
    assert len(stages_run(dvc(pipeline, "repro"))) == STAGES
    return pipeline


def test_runs_have_every_grid_point_epoch_and_scope(folder: Path) -> None:
    for name in INITIALIZERS:
        runs = pd.read_parquet(folder / f"data/runs/ai2thor/{name}.parquet")
        assert len(runs[["size", "seed"]].drop_duplicates()) == 6
        assert set(runs.loc[runs["epoch"] == 0, "scope"]) == SCOPES
        curves = runs[(runs["size"] == 2) & (runs["scope"] == "weighted")]
        epochs = curves.groupby("seed")["epoch"].apply(sorted).tolist()
        assert epochs == [[0, 1, 2, 3], [0, 1, 2, 3], [0]]  # two seeds are fine-tuned
        for measure in ("mrr_star", "mrr"):
            assert runs[measure].dropna().between(0, 1).all()
            halves = runs[[f"{measure}_entity", f"{measure}_relation"]].mean(axis=1)
            assert (halves - runs[measure]).abs().max() < 1e-12
            assert (runs[measure].isna() == (runs["queries"] == 0)).all()
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
        # A tie is as wide as the largest score of its row, which may be a novel entity's: hence the
        # tolerance.
        pd.testing.assert_frame_equal(
            closed(name), closed("xavier"), check_categorical=False, atol=1e-4
        )


def test_the_final_model_of_the_whole_graph_is_a_bundle(folder: Path) -> None:
    bundle = read(folder / "data/final_models/ai2thor")
    assert bundle.manifest.model_name == "analogy"
    assert bundle.entities.shape == (len(bundle.entity_names), 8)
    names = [bundle.entity_names, bundle.relation_names, bundle.entity_names]
    triples = {
        tuple(words[i] for words, i in zip(names, row, strict=True))
        for row in bundle.triples.tolist()
    }
    graph = pd.read_parquet(folder / "data/graph/ai2thor/triples.parquet")
    assert triples == set(
        graph[["head", "relation", "tail"]].astype(str).itertuples(index=False, name=None)
    )
    log = pd.read_parquet(folder / "data/embeddings/ai2thor/joint.log.parquet")
    last = log[log["kept"]].groupby("seed")["epoch"].last()
    assert bundle.manifest.made["epochs"] == last.sort_values().iloc[1]  # of 3
    assert bundle.words is not None
    vectors = load_file(folder / "data/words/ai2thor/vectors.safetensors")["vectors"]
    assert (bundle.words == vectors.numpy()).all()


def test_every_size_of_the_indicator_set_is_swept_with_the_first_seeds(folder: Path) -> None:
    for name in SWEPT:
        runs = pd.read_parquet(folder / f"data/analyses/indicator_sweep/ai2thor/{name}.parquet")
        assert runs[["k", "size", "seed"]].drop_duplicates().to_numpy().tolist() == [
            [k, 2, seed] for k in (1, 8) for seed in (0, 1)
        ]
        assert set(runs["scope"]) == SCOPES
        assert set(runs.loc[runs["epoch"] > 0, "seed"]) <= {0}  # one seed is fine-tuned
    swept = pd.read_parquet(folder / "data/analyses/indicator_sweep/ai2thor/es.parquet")
    # of 8 indicators
    main = pd.read_parquet(folder / "data/runs/ai2thor/es.parquet").query("size == 2")
    same = swept.merge(main, on=["seed", "epoch", "scope"], suffixes=("", " of main"))
    # the weight of a group is that of the seeds that are swept
    same = same[same["scope"] != "weighted"].dropna(subset=["mrr"])
    equal = (same["mrr"] == same["mrr of main"]).groupby(same["k"]).all()
    assert equal.to_dict() == {1: False, 8: True}


def test_every_setting_is_cross_validated_on_every_fold(folder: Path) -> None:
    table = pd.read_parquet(folder / "data/analyses/cross_validation/ai2thor.parquet")
    settings = (
        table[["dimension", "ratio", "learning_rate", "weight_decay", "fold"]].to_numpy().tolist()
    )
    expected = [(8, 9, 0.1, 0.001), (8, 9, 0.2, 0.001), (12, 9, 0.1, 0.001)]
    assert settings == [[*setting, fold] for setting in expected for fold in range(3)]
    assert table["mrr_star"].between(0, 1).all()
    assert set(table["epoch"]) <= {2, 4}


def test_the_entity_of_figure_1_starts_where_the_experiment_inserts_it(folder: Path) -> None:
    traced = load_file(folder / "data/analyses/trajectory/ai2thor.safetensors")
    novel = pd.read_parquet(folder / "data/sessions/ai2thor/novel.parquet").query(
        "size == 2 and seed == 0"
    )["entity"]
    place = novel.tolist().index(int(traced["entity"]))
    theta0 = load_file(folder / "data/embeddings/ai2thor/theta0/size=02.safetensors")
    assert traced["theta0"].equal(theta0["entity"][0])
    assert traced["known"].equal(theta0["known"][0])
    for name in ("xavier", "iu", *ISI):
        path, indicators = traced[f"{name}.path"], traced[f"{name}.indicators"]
        assert path[0].equal(
            load_file(folder / f"data/runs/ai2thor/{name}.safetensors")["size=02"][0, place]
        )
        assert path.shape == (3, 8)
        assert not path[1:].eq(path[0]).all(1).any()
        if name in ISI:
            centroid = theta0["entity"][0][indicators].mean(0)
            assert torch.allclose(path[0], centroid, atol=1e-6)
        else:
            assert not indicators.any()


def test_the_query_breakdown_sums_to_the_runs(folder: Path) -> None:
    files = sorted((folder / "data/analyses/query_breakdown/ai2thor").glob("*.parquet"))
    assert {file.stem for file in files} == {*INITIALIZERS, "joint"}
    parts = pd.concat(map(pd.read_parquet, files))
    sums = combined(parts, ["model", "size", "seed", "scope"])
    for name in (*INITIALIZERS, "joint"):
        runs = pd.read_parquet(folder / f"data/runs/ai2thor/{name}.parquet").query(
            "epoch == 0 and queries > 0"
        )
        both = runs.merge(
            sums[sums["model"] == name], on=["size", "seed", "scope"], suffixes=("", " of parts")
        )
        assert len(both) == runs["scope"].isin(["novel", "held_out"]).sum()
        for half in HALVES:
            assert (both[f"mrr{half}"] - both[f"mrr{half} of parts"]).abs().max() < 1e-6


def test_changes_of_the_measure_are_measured_with_it_where_params_say(folder: Path) -> None:
    for name in (*INITIALIZERS, "joint"):
        changes, moved = (
            pd.read_parquet(folder / f"data/analyses/measure/{experiment}/{name}.parquet")
            for experiment in EXPERIMENTS
        )
        assert moved.empty
        runs = pd.read_parquet(folder / f"data/runs/ai2thor/{name}.parquet")
        both = changes[changes["change"] == "none"].merge(
            runs, on=["size", "seed", "epoch", "scope"]
        )
        assert len(both) == runs["scope"].isin(["known", "novel", "weighted"]).sum()
        assert (both["value"] - both["mrr"]).abs().max() < 1e-12


def test_theta0_knows_all_but_the_novel_entities(folder: Path) -> None:
    novel = pd.read_parquet(folder / "data/sessions/ai2thor/novel.parquet")
    for size in (1, 2):
        theta0 = load_file(folder / f"data/embeddings/ai2thor/theta0/size={size:02d}.safetensors")
        for row, seed in enumerate(theta0["seed"].tolist()):
            entities = novel[(novel["size"] == size) & (novel["seed"] == seed)]["entity"].tolist()
            assert (~theta0["known"][row]).nonzero().flatten().tolist() == entities
            assert not theta0["entity"][row, entities].any()
            assert theta0["entity"][row][theta0["known"][row]].any(-1).all()


def test_the_report_is_whole_and_stands_alone(folder: Path) -> None:
    page = (folder / "reports/index.html").read_text(encoding="utf-8")
    drawn = re.findall(r'<figure id="figure-(\w+)"', page)
    assert {"answer", "1", "figure3a_immediate", "figure3b_curves"} <= {*drawn}
    assert len(drawn) == len({*drawn}) == 7
    assert 'id="picture"' in page
    assert not re.search("src=|<link", page)
    differences = pd.read_csv(folder / "reports/tables/differences.csv")
    assert len(differences) == 5 * len(INITIALIZERS) * (len(INITIALIZERS) - 1) / 2
    metrics = json.loads((folder / "reports/metrics.json").read_text(encoding="utf-8"))
    runs = pd.read_parquet(folder / "data/runs/ai2thor/rs.parquet")
    immediate = runs[(runs["epoch"] == 0) & (runs["scope"] == "novel")]["mrr"].mean()
    of_novel = metrics["ai2thor"]["immediate_mrr"]["novel"]
    assert of_novel["rs"] == pytest.approx(100 * immediate, abs=6e-3)


def verify(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run ``make verify`` for all grid points of a folder."""
    command = [sys.executable, "-m", "tools.verify", "--points", "99"]
    environment = os.environ | {"PYTHONPATH": str(workspace.ROOT)}
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, env=environment
    )


def test_other_code_computes_the_same_from_the_tables_alone(folder: Path) -> None:
    process = verify(folder)
    assert process.returncode == 0, process.stdout + process.stderr
    rows = {line[:18].strip(): line.split() for line in process.stdout.splitlines()}
    # scopes, seeds, grid points of a seed, models
    assert int(rows["the measure"][-4]) == 6 * 3 * 3 * 6
    assert int(rows["initial vectors"][-4]) > 100
    compared = ("initial vectors", "the measure", "epochs")
    assert all(int(rows[name][-1]) == 0 for name in compared)


def test_verify_finds_altered_numbers(folder: Path, tmp_path: Path) -> None:
    for name in (
        "data/graph",
        "data/words",
        "data/sessions",
        "data/embeddings",
        "data/runs",
        "reports/tables",
    ):
        shutil.copytree(folder / name, tmp_path / name)
    shutil.copy2(folder / "params.yaml", tmp_path)
    vectors = load_file(tmp_path / "data/runs/transfer/rs.safetensors")
    vectors["size=10"][1, 4, 2] += 1e-4
    save_file(vectors, tmp_path / "data/runs/transfer/rs.safetensors")
    runs = pd.read_parquet(tmp_path / "data/runs/ai2thor/es.parquet")
    chosen = runs.index[(runs["epoch"] == 0) & (runs["scope"] == "known") & (runs["seed"] == 2)][0]
    runs.loc[chosen, "mrr_star_entity"] += 1e-4
    runs.to_parquet(tmp_path / "data/runs/ai2thor/es.parquet")
    table = pd.read_csv(tmp_path / "reports/tables/table2_convergence.csv").astype({"mean": float})
    table.loc[1, "mean"] += 0.1
    table.to_csv(tmp_path / "reports/tables/table2_convergence.csv", index=False)
    process = verify(tmp_path)
    assert process.returncode == 1
    for expected in (
        "initial vectors, .* rs, transfer, size 10, seed 1: ",
        "the measure, known, mrr_star_entity, es, ai2thor, .* seed 2: ",
        "epochs, iu, mean, ai2thor: ",
    ):
        assert len(re.findall(f"^{expected}", process.stdout, re.MULTILINE)) == 1
    assert process.stdout.count(" here, ") == 3


def test_every_result_of_the_paper_has_a_row_beside_ours(folder: Path) -> None:
    def leaves(value: Any) -> list[float]:
        return (
            [leaf for part in value.values() for leaf in leaves(part)]
            if isinstance(value, dict)
            else [value]
        )

    paper = yaml.safe_load((folder / "data/raw/paper/values.yaml").read_text(encoding="utf-8"))
    rows = pd.read_csv(folder / "reports/tables/paper_results.csv")
    shown = rows["paper"].value_counts()
    printed = [
        paper["immediate"]["improvement_over_xavier"],
        paper["convergence"],
        paper["transfer"],
    ]
    # that the others need no epochs after the transfer is read out of a sentence about Xavier
    results = [leaf for part in printed for leaf in leaves(part) if leaf]
    for number, times in pd.Series(results).value_counts().items():
        assert shown.get(number, 0) >= times, number
    runs = pd.read_parquet(folder / "data/runs/transfer/es.parquet")
    immediate = runs[(runs["epoch"] == 0) & (runs["scope"] == "novel")]["mrr"].mean()
    row = rows[(rows["kind"] == "transfer: novel entities") & (rows["whose"] == "ES")].iloc[0]
    assert (row["paper"], row["today's graph"]) == (85.7, pytest.approx(100 * immediate, abs=0.01))


def test_each_repeat_of_the_transfer_has_ai2thors_entities_and_its_ten(folder: Path) -> None:
    def table(path: str) -> pd.DataFrame:
        return pd.read_parquet(folder / f"data/{path}.parquet")

    entities, triples = table("graph/transfer/entities"), table("graph/transfer/triples")
    old = table("graph/ai2thor/entities")
    assert entities["entity"][: len(old)].tolist() == old["entity"].tolist()
    novel, insert_triples = (
        table("sessions/transfer/novel"),
        table("sessions/transfer/insert_triples"),
    )
    ids = dict(zip(entities["entity"], entities.index, strict=True))
    answers = table("analyses/affordances/transfer").query("initializer == 'es'")
    for seed, split in table("sessions/transfer/splits").groupby("seed"):
        drawn = set(novel[novel["seed"] == seed]["entity"])
        assert len(drawn) == 10
        assert set(entities["source"].astype(str)[list(drawn)]) == {"mp3d"}
        seen = triples.loc[split["triple"]]
        ends = {ids[name] for name in [*seen["head"], *seen["tail"]]}
        assert ends == set(range(len(old))) | drawn
        assert (seen["source"] == "ai2thor").sum() == (triples["source"] == "ai2thor").sum()
        train = set(split.loc[split["split"] == "train", "triple"])
        assert set(insert_triples[insert_triples["seed"] == seed]["triple"]) <= train
        ranked = answers[answers["seed"] == seed]
        assert set(ranked["entity"]) == drawn
        assert set(ranked["answer"]) == ends
        assert (ranked.groupby("entity")["rank"].apply(sorted).map(len) == len(ends)).all()
    runs = table("runs/transfer/es")
    assert set(runs["epoch"]) == set(range(SMALL["finetuning.max_epochs"] + 1))


def test_params_and_code_are_dependencies_of_the_stages_that_read_them_alone(
    folder: Path, dvc: Dvc
) -> None:
    insertion = {f"insert@ai2thor-{name}" for name in INITIALIZERS}
    of_es = {
        "trace_trajectory@ai2thor",
        "rank_affordances@transfer",
        "demonstrate",
    }
    edits: dict[str, tuple[object, set[str]]] = {
        "initializers.es.k": (
            3,
            {
                *(f"insert@{name}-es" for name in EXPERIMENTS),
                *of_es,
            },
        ),
        "experiments.transfer.sessions.sizes": ([9], {"make_sessions@transfer"}),
        "experiments.transfer.graph.extend.min_observations": (7, {"build_graph@transfer"}),
        "sources.mp3d.rooms": ({"bedroom": "bedroom"}, {"mine@mp3d"}),
        "sweep.k": ([2], {f"sweep_indicators@ai2thor-{name}" for name in SWEPT}),
        "sweep.initializers.ers.candidates": (20, {"sweep_indicators@ai2thor-ers"}),
        "cross_validation.folds": (2, {"cross_validate@ai2thor"}),
        "trajectory.epochs": (3, {"trace_trajectory@ai2thor"}),
        "experiments.ai2thor.full_curves": ([1], {"finetune_only@ai2thor", *insertion}),
    }
    code: dict[str, set[str]] = {
        "isi/initializers/paper.py": {
            *(
                f"insert@{name}-{initializer}"
                for name in EXPERIMENTS
                for initializer in INITIALIZERS
            ),
            *(f"sweep_indicators@ai2thor-{name}" for name in SWEPT),
            *of_es,
        },
        "stages/trace_trajectory.py": {"trace_trajectory@ai2thor"},
        "stages/report/figures.py": set(),
        "isi/errors.py": set(),
        "isi/cli/__init__.py": set(),
    }
    before = {name: (folder / name).read_bytes() for name in ("params.yaml", *code)}
    for key, (value, _) in edits.items():
        set_param(folder, key, value)
    for name in code:
        (folder / name).write_bytes(before[name] + b"\n# edited\n")
    status = json.loads(dvc(folder, "status", "--json"))
    for name, content in before.items():
        (folder / name).write_bytes(content)
    stages: dict[str, set[str]] = defaultdict(set)
    for stage, changes in status.items():
        for change in changes:
            for name, params in change["changed deps"].items():
                for key in params if isinstance(params, dict) else [name]:
                    stages[key].add(stage)

    def dependents(changed: str) -> set[str]:
        """All stages, except those of the report, that depend on a changed param or path."""
        return {
            stage
            for key, names in stages.items()
            if re.match(rf"{re.escape(key)}([./]|$)", changed)
            for stage in names - {"tables", "report"}
        }

    assert {key: dependents(key) for key in edits} == {
        key: expected for key, (_, expected) in edits.items()
    }
    assert {name: dependents(name) for name in code} == code


def test_nothing_of_one_experiment_depends_on_another() -> None:
    graph = Repo(str(workspace.ROOT)).index.graph  # from a stage to those that it depends on
    # but for what lies beyond
    names = {stage: stage.addressing for stage in graph if ":" not in stage.addressing}
    for stage, name in names.items():
        after = {names[other] for other in nx.ancestors(graph, stage) if other in names} - {
            "demonstrate",
            "tables",
            "report",
        }
        experiment = name.partition("@")[2].split("-")[0]
        if experiment in EXPERIMENTS and not name.startswith("mine"):
            assert all(other.partition("@")[2].split("-")[0] == experiment for other in after), name
        if name.startswith(ANALYSES):
            assert not after


def test_the_number_of_workers_re_runs_nothing_and_changes_no_byte(folder: Path, dvc: Dvc) -> None:
    set_param(folder, "compute.workers", 1)
    set_param(folder, "compute.stack", 3)
    assert not stages_run(dvc(folder, "repro"))
    before = {path: path.read_bytes() for path in (folder / "data/runs").rglob("*.*")}
    dvc(folder, "repro", "--force", "--single-item", "insert@ai2thor-rs")
    assert {path: path.read_bytes() for path in before} == before
