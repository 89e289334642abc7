"""Tables and tensors that were altered by hand, or are of another run: the stage that reads them says what is wrong."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from safetensors.torch import load_file, save_file

from isi.tables import catalogue, io, paths
from isi.tables.catalogue import Schema
from tests import small
from tests.altered import (
    CASES,
    ENTITIES,
    JOINT_RUNS,
    NOVEL,
    OF_TENSORS,
    SPLITS,
    THETA0,
    TOLD,
    TRIPLES,
    WORDS,
    Tensors,
)
from tests.lawful import Alter, alter, alter_tensors
from tests.small import NAME
from tools.workspace import change


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder in which the pipeline has run; tests run in it."""
    made = tmp_path_factory.mktemp("altered")
    small.run_all(made)
    with chdir(made):
        yield made


def command(stage: str) -> str:
    return f"{stage} {NAME}" + " rs" * (stage == "insert")


@pytest.mark.parametrize(("path", "schema", "how", "stage"), [case[1:5] for case in CASES], ids=[c[0] for c in CASES])
def test_an_altered_table_is_refused(path: Path, schema: Schema, how: Alter, stage: str) -> None:
    with small.for_a_while(path, lambda file: alter(file, how, schema)):
        line = small.refusal(command(stage))
    assert line.startswith(f"{stage}: ")
    assert re.search(r"row \d|seed \d|was edited|expected", line), line


BREAKING = [case for case in CASES if case[5]]


@pytest.mark.parametrize(("path", "schema", "how", "stage", "says"), [case[1:] for case in BREAKING],
                         ids=[case[0] for case in BREAKING])  # fmt: skip
def test_where_its_digest_is_written_anew_the_rule_refuses_it(
    path: Path, schema: Schema, how: Alter, stage: str, says: str
) -> None:
    with small.for_a_while(path, lambda file: alter(file, how, schema, anew=True)):
        line = small.refusal(command(stage))
    assert re.search(says, line), line


# Tensors


@pytest.mark.parametrize("anew", [False, True], ids=["as it is", "digest anew"])
@pytest.mark.parametrize(("path", "how", "says"), [case[1:] for case in OF_TENSORS], ids=[c[0] for c in OF_TENSORS])
def test_altered_tensors_are_refused(path: Path, how: Callable[[Tensors], None], says: str | None, anew: bool) -> None:
    if anew and says is None:
        pytest.skip("lawful")
    with small.for_a_while(path, lambda file: alter_tensors(file, how, anew)):
        line = small.refusal(command("insert"))
    assert line.startswith(f"insert: {path}: ")
    assert re.search(says if anew and says else "was edited|expected", line), line


def test_tensors_of_a_type_that_numpy_lacks_are_refused() -> None:
    def halved(path: Path) -> None:
        tensors = load_file(path)
        save_file(tensors | {"entity": tensors["entity"].bfloat16()}, path)

    with small.for_a_while(THETA0, halved):
        assert small.refusal(command("insert")) == (
            f"insert: {THETA0}: tensor 'entity': expected a type that NumPy has, got torch.bfloat16"
        )


# Of another run


def changed(key: str, value: Any) -> Callable[[Path], None]:
    def alter_params(path: Path) -> None:
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
        change(values, key, value)
        path.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")

    return alter_params


@pytest.mark.parametrize(
    ("key", "value", "named", "by"),
    [
        (f"experiments.{NAME}.sessions.seeds", 3, NOVEL, "make_sessions"),
        ("training.learning_rate", 0.3, None, "train_joint"),
        (f"experiments.{NAME}.graph.min_count", 2, ENTITIES, "build_graph"),
        ("words.text", "phrase", WORDS, "embed_words"),
        ("seed", 1, None, "mine"),
    ],
)
def test_what_was_made_under_other_params_is_refused(key: str, value: Any, named: Path | None, by: str) -> None:
    with small.for_a_while(paths.PARAMS, changed(key, value)):
        line = small.refusal(command("insert"))
    assert f"was made under other params than there are now: run `dvc repro {by}@{NAME}`" in line
    assert named is None or str(named.parent) in line


def test_params_that_shape_nothing_that_is_read_refuse_nothing() -> None:
    with small.for_a_while(paths.PARAMS, changed("compute.stack", 1)):
        small.run(command("build_graph"))


def test_what_was_made_from_another_table_than_is_there_is_refused(tmp_path: Path) -> None:
    """Sessions of another run, whole and lawful in themselves, beside an embedding of this one."""
    small.lay_out(tmp_path, {**small.SMALL, "sessions.valid": 0.2})
    shutil.copytree(paths.DATA / "graph", tmp_path / paths.DATA / "graph")
    before = {path: path.read_bytes() for path in (SPLITS, NOVEL, TOLD)}
    with chdir(tmp_path):
        for path in (ENTITIES, TRIPLES):
            assert path.exists()
        small.run(command("make_sessions"))
    try:
        for path in before:
            alter(path, lambda _, path=path: pd.read_parquet(tmp_path / path), SCHEMA_OF[path], anew=True)  # type: ignore[misc]
        line = small.refusal(command("insert"))
    finally:
        for path, content in before.items():
            path.write_bytes(content)
    assert re.search(rf"was made from another {SPLITS.parent}\S+ than is there: run `dvc repro train_", line), line


SCHEMA_OF = {SPLITS: catalogue.SPLITS, NOVEL: catalogue.NOVEL, TOLD: catalogue.INSERT_TRIPLES}


def test_the_file_of_another_stage_is_refused() -> None:
    with small.for_a_while(NOVEL, lambda file: shutil.copy(TOLD, file)):
        assert f"{NOVEL}: " in small.refusal(command("train_theta0"))
    with small.for_a_while(JOINT_RUNS, lambda file: shutil.copy(paths.runs(NAME, "rs"), file)):
        expected = "expected what stage train_joint writes, got that of insert: run `dvc repro train_joint@"
        assert f"{JOINT_RUNS}: {expected}" in small.refusal(command("insert"))


def test_a_table_of_another_program_bears_no_digest() -> None:
    with small.for_a_while(NOVEL, lambda file: pd.read_parquet(file).to_parquet(file)):
        line = small.refusal(command("train_theta0"))
    assert f"{NOVEL}: bears no digest of a stage: `dvc checkout --force {NOVEL}`, or " in line


def test_as_it_was_everything_is_read_again() -> None:
    small.run(command("make_sessions"))
    assert np.isfinite(io.read(JOINT_RUNS, catalogue.RUNS)["queries"]).all()
