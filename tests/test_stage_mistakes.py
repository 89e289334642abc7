"""A user's mistake ends a stage in one line that names the file and the place;
earlier outputs stay.
"""

import os
import re
import subprocess
import sys
from contextlib import chdir
from pathlib import Path

import pandas as pd
import pytest
import torch

from isi.errors import LONGEST, InputError, short, suggestion
from isi.tables import io, paths
from isi.tables.table import concat
from stages.breakdown import QUERY_BREAKDOWN
from stages.files import (
    ENTITIES,
    INSERT_TRIPLES,
    NOVEL,
    OBSERVATIONS,
    SPLITS,
    TRIPLES,
    WORD_VECTORS,
)
from stages.files import KINDS as KIND_TABLE
from stages.pipeline import PIPELINE, missing
from stages.store import INITIAL_VECTORS, MEASURE_CHANGES, RUNS, THETA0
from stages.vary import VARIANT_RUNS
from tests import stage_run
from tests.stage_run import main_of
from tests.stage_workspace import (
    KINDS,
    OBSERVED,
    ROOT,
    Says,
    graph,
    leave,
    observed,
    outputs,
    says,
    set_params,
    workspace,
    write,
)

__all__ = ["says", "workspace"]  # fixtures


# Params


@pytest.mark.parametrize(
    ("old", "new", "command", "names"),
    [
        ("\nseed:", "\nsede:", "mine ai2thor", "seed: "),
        ("reader: ai2thor", "reader: ai2tor", "mine ai2thor", "sources.ai2thor.reader"),
        # a file of that name
        ("source: shipped", f"source: {'ab' * 5000}", "embed_words ai2thor", ""),
        ("\n    k: 8", "\n    kk: 8", "insert ai2thor es", "initializers.es.kk"),
    ],
)
def test_a_mistake_in_params_is_named_by_its_key(
    workspace: Path, says: Says, old: str, new: str, command: str, names: str
) -> None:
    observed(workspace, "ai2thor", OBSERVED, KINDS)
    if not command.startswith(("mine", "build_graph")):
        graph(workspace, "ai2thor")
    text = (workspace / paths.PARAMS).read_text(encoding="utf-8")
    assert old in text
    (workspace / paths.PARAMS).write_text(text.replace(old, new, 1), encoding="utf-8")
    assert names in says(command)


@pytest.mark.parametrize(
    ("command", "names", "close"),
    [
        ("mine ai2tor", "sources.ai2tor", "ai2thor"),
        ("build_graph trasfer", "experiments.trasfer", "transfer"),
        ("insert ai2thor xaver", "initializers.xaver", "xavier"),
        ("vary glov", "beyond/params.yaml: variants.glov", "glove"),
        ("sweep_indicators ai2thor mean", "sweep.initializers.mean", ""),
        (f"build_graph {'x' * 5000}", "experiments.xxx", ""),
        ("build_graph ../../etc", "experiments.../../etc", ""),
    ],
)
def test_an_unknown_name_is_refused_with_a_similar_one(
    workspace: Path, says: Says, command: str, names: str, close: str
) -> None:
    graph(workspace, "ai2thor")
    line = says(command)
    assert "params.yaml: " in line
    assert names in line
    assert not close or f"did you mean '{close}'?" in line


@pytest.mark.parametrize(
    "text",
    [
        "a: " + "[" * 20_000,
        "- " * 20_000 + "a",
        "a: " + "9" * 5000,
        "a: 2023-02-30",
        "a: !!bool maybe",
        "a: !!python/object/apply:os.system [touch run]",
        "a: b: c",
        "a: 1\na: 2",
        "seed: 1".encode("utf-16"),
        b"seed: \x00",
        b"",
    ],
    ids=[
        "brackets",
        "dashes",
        "digits",
        "date",
        "tag",
        "object",
        "colons",
        "twice",
        "UTF-16",
        "NUL",
        "empty",
    ],
)
def test_broken_yaml_is_one_short_line_and_runs_nothing(
    workspace: Path, says: Says, text: str | bytes
) -> None:
    (workspace / paths.PARAMS).write_bytes(text.encode() if isinstance(text, str) else text)
    assert re.match(r"params\.yaml: .*expected (YAML|UTF-8|a mapping)", says("build_graph ai2thor"))
    assert not (workspace / "run").exists()


# What is sound


def test_a_sound_file_after_a_broken_one_replaces_the_earlier_output(
    workspace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    leave(workspace, ENTITIES.path(experiment="ai2thor"), TRIPLES.path(experiment="ai2thor"))
    observed(workspace, "ai2thor", OBSERVED, KINDS)
    for path in (paths.PARAMS, PIPELINE):  # a byte order mark is read over
        (workspace / path).write_bytes(b"\xef\xbb\xbf" + (workspace / path).read_bytes())
    with chdir(workspace):
        stage_run.run("build_graph ai2thor")
    assert capsys.readouterr().err == ""
    assert ENTITIES.read_file(workspace / ENTITIES.path(experiment="ai2thor"))[
        "entity"
    ].tolist() == ["kitchen", "mug"]
    tables = (OBSERVATIONS, KIND_TABLE, ENTITIES, TRIPLES)
    files = [table.path(source="ai2thor", experiment="ai2thor") for table in tables]
    assert set(outputs(workspace)) == set(map(str, files))  # and no temporary file


def test_an_initializer_that_the_experiment_does_not_list_leaves_tables_without_rows(
    workspace: Path,
) -> None:
    set_params(workspace, {"experiments.ai2thor.initializers": ["rs", "xavier"]})
    graph(workspace, "ai2thor")
    row = pd.DataFrame({"size": [1], "seed": [0], "entity": [1], "triple": [0], "split": ["train"]})
    for table in (SPLITS, NOVEL, INSERT_TRIPLES):
        write(workspace, table.path(experiment="ai2thor"), row, table)
    write(workspace, RUNS.path(experiment="ai2thor", model="joint"), concat([], RUNS), RUNS)
    with chdir(workspace):
        WORD_VECTORS.write({"vectors": torch.ones(2, 3)}, "embed_words", experiment="ai2thor")
        stage_run.run("insert ai2thor es")
    for table in (RUNS, MEASURE_CHANGES, QUERY_BREAKDOWN):
        path = table.path(experiment="ai2thor", model="es")
        assert table.read_file(workspace / path).empty
    assert (
        io.read_tensors(
            workspace / INITIAL_VECTORS.path(experiment="ai2thor", initializer="es"), []
        )
        == {}
    )


# Too early, or outside the project


@pytest.mark.parametrize(
    ("command", "names"),
    [
        (
            "build_graph ai2thor",
            "data/observations/ai2thor.parquet: missing: run `dvc repro mine@ai2thor`",
        ),
        (
            "make_sessions ai2thor",
            "data/graph/ai2thor/entities.parquet: missing: run `dvc repro build_graph@ai2thor`",
        ),
        ("insert ai2thor es", "missing: run `dvc repro "),
        ("tables", "missing: run `dvc repro "),
        ("report", "reports/tables: missing: run `dvc repro tables`"),
    ],
)
def test_a_stage_before_its_inputs_names_the_stage_that_makes_them(
    says: Says, command: str, names: str
) -> None:
    assert names in says(command)


def test_the_stage_that_makes_a_missing_file_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    for path, stage in (
        (THETA0.path(experiment="transfer", size=5), "train_theta0@transfer"),
        (INITIAL_VECTORS.path(experiment="transfer", initializer="es"), "insert@transfer-es"),
        (
            QUERY_BREAKDOWN.path(experiment="transfer", model="es_permuted"),
            "insert@transfer-es_permuted",
        ),
        (VARIANT_RUNS.path(variant="insert_triples_0"), "beyond/dvc.yaml:vary@insert_triples_0"),
        (Path("reports/metrics.json"), "tables"),
        (Path("reports/tables/differences.csv"), "tables"),
        (Path("data/runs"), None),
        (Path("/data/runs"), None),
        (Path("gone"), None),
    ):
        expected = f"missing: run `dvc repro {stage}`, which makes it" if stage else "no such file"
        assert str(missing(path)) == f"{path}: {expected}"


def test_a_stage_outside_the_project_says_so(tmp_path: Path) -> None:
    environment, repro = os.environ | {"PYTHONPATH": str(ROOT)}, str(ROOT / "tools/repro.py")
    for arguments, expected in (
        (["-m", "stages.build_graph", "ai2thor"], r"dvc\.yaml: no such file"),
        ([repro], "go to the folder of the project"),
        (["-S", repro], "lacks DVC or this project"),  # as where DVC is another installation's
        (
            ["-S", "-m", "stages.insert", "ai2thor", "es"],
            "^stages: .* cannot run this project: .*make repro",
        ),
    ):
        command = [sys.executable, *arguments]
        ended = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, env=environment
        )
        (line,) = ended.stderr.splitlines()
        assert (ended.returncode, ended.stdout) == (1, "")
        assert re.search(expected, line)


@pytest.mark.parametrize("arguments", ["", " ai2thor es more", " --seed 3 ai2thor es"])
def test_wrong_arguments_are_one_line_and_status_2(
    arguments: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", f"insert{arguments}".split())
    with pytest.raises(SystemExit) as ended:
        main_of("insert")()
    out, err = capsys.readouterr()
    assert (ended.value.code, out) == (2, "")
    assert re.fullmatch(r"python -m stages\.insert: .+; see --help\n", err)


# How a message is kept short


def test_a_message_is_short_and_in_one_line_whatever_it_repeats() -> None:
    long = str(InputError("params.yaml", "x" * 5000, "expected " + "y" * 10**7))
    assert len(long) <= LONGEST
    assert long.startswith("params.yaml: xxx")
    assert str(InputError("f", "a\nb\x1b[31m\ud800", "c\tc")) == "f: a b\\x1b[31m\\ud800: c c"
    deep: list[object] = []
    for _ in range(2000):
        deep = [deep]
    for value in (
        "x" * 5000,
        deep,
        list(range(10**6)),
        {n: n for n in range(10**5)},
        int("f" * 5000, 16),
    ):
        assert len(short(value)) < 100
    assert suggestion("xaver", ["es", "xavier"]) == "; did you mean 'xavier'?"
    assert suggestion("mug", ["es", "xavier"]) == ""
