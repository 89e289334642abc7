"""``isi check``: what is wrong under data/, one line a finding; and a user's own edits, accepted."""

from __future__ import annotations

import datetime
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import chdir
from pathlib import Path

import pandas as pd
import pytest
import yaml

from isi import config
from isi.__main__ import main
from isi.cli._checking import TABLES, is_tensors, schema_of
from isi.process import only_one
from isi.tables import catalogue, io, paths
from isi.tables.catalogue import Schema
from isi.tables.origin import PipelineOrigins
from isi.tables.provenance import ACCEPTED, CONTENT, metadata_of
from tests import small
from tests.altered import NOVEL, SPLITS, THETA0, TOLD, a_little, another_novel, put
from tests.lawful import alter, alter_tensors
from tests.small import NAME
from tools.workspace import change

FILES = 3 + 2 + 2 + 3 + 2 + 1 + 4 + 4
#: Of the kept embedding and of single insertions.
FILES += 5 + 4


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("checked")
    small.run_all(folder)
    with chdir(folder):
        small.run(f"keep {NAME}")
        small.run(f"single_out {NAME}")
    return folder


@pytest.fixture
def _in_copy(made: Path, tmp_path: Path) -> Iterator[None]:
    shutil.copytree(made, tmp_path / "copy", symlinks=True)
    with chdir(tmp_path / "copy"):
        yield


def check(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[list[str], object]:
    """The lines that it prints, and how it ends."""
    ended: object = 0
    try:
        main(["check", *arguments])
    except SystemExit as error:
        ended = error.code
    return capsys.readouterr().out.splitlines(), ended


@pytest.mark.usefixtures("_in_copy")
def test_what_the_stages_wrote_holds_all_rules(capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert check(capsys) == ([f"{FILES} files under data, 0 findings"], 0)


def test_it_is_said_that_nothing_has_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    small.lay_out(tmp_path, {})
    assert check(capsys) == (["0 files under data, 0 findings: nothing has run (`dvc repro`)"], 0)


@pytest.mark.usefixtures("_in_copy")
def test_each_finding_is_one_line_and_the_status_is_1(capsys: pytest.CaptureFixture[str]) -> None:
    alter(SPLITS, put("triple", -1), catalogue.SPLITS)
    alter_tensors(THETA0, a_little)
    alter(paths.runs(NAME, "rs"), put("mrr_star", 2.0), catalogue.RUNS)
    lines, ended = check(capsys)
    assert ended == 1
    assert lines[-1] == f"{FILES} files under data, {len(lines) - 1} findings"
    for path, says in (
        (SPLITS, "row 0 (triple -1): expected 'triple' from 0 on"),
        (THETA0, f"was edited: `dvc checkout --force {THETA0}`"),
        (paths.runs(NAME, "rs"), "row 0 (mrr_star 2.0): expected 'mrr_star' from 0 to 1"),
    ):
        assert any(line.startswith(f"{path}: {says}") for line in lines), lines
    assert len(set(lines)) == len(lines)


@pytest.mark.usefixtures("_in_copy")
@pytest.mark.parametrize(
    ("path", "schema", "how"),
    [
        (SPLITS, catalogue.SPLITS, put("split", None)),
        (SPLITS, catalogue.SPLITS, put("split", "foo")),
        (TOLD, catalogue.INSERT_TRIPLES, put("triple", None)),
        (NOVEL, catalogue.NOVEL, put("entity", -1000)),
        (NOVEL, catalogue.NOVEL, put("entity", None)),
        (paths.triples(NAME), catalogue.TRIPLES, put("count", None)),
    ],
)
def test_a_file_that_is_refused_is_refused_whenever_it_is_read(
    capsys: pytest.CaptureFixture[str], path: Path, schema: Schema, how: Callable[[pd.DataFrame], pd.DataFrame]
) -> None:
    """By itself, and then beside the others."""
    alter(path, how, schema)
    lines, ended = check(capsys)
    assert ended == 1
    assert any(line.startswith(f"{path}: ") for line in lines)
    assert lines[-1].startswith(f"{FILES} files under data, ")


@pytest.mark.usefixtures("_in_copy")
def test_tensors_that_are_cut_short_are_one_finding_among_others(capsys: pytest.CaptureFixture[str]) -> None:
    vectors = paths.initial_vectors(NAME, "rs")
    for path in (THETA0, vectors):
        path.write_bytes(path.read_bytes()[:-100])
    alter(NOVEL, put("entity", -1), catalogue.NOVEL)
    lines, _ = check(capsys)
    for path in (THETA0, vectors, NOVEL):
        assert any(line.startswith(f"{path}: ") for line in lines), path


@pytest.mark.usefixtures("_in_copy")
def test_what_params_no_longer_list_is_not_looked_at(capsys: pytest.CaptureFixture[str]) -> None:
    """DVC leaves it lying."""
    shutil.copy(paths.initial_vectors(NAME, "rs"), paths.initial_vectors(NAME, "gone"))
    shutil.copy(paths.inserted(NAME, "rs"), paths.inserted(NAME, "gone"))
    shutil.copytree(paths.entities(NAME).parent, paths.entities("gone").parent)
    assert check(capsys) == ([f"{FILES} files under data, 0 findings"], 0)


@pytest.mark.usefixtures("_in_copy")
@pytest.mark.parametrize("value", [5, "published", datetime.date(2001, 1, 1)])
@pytest.mark.parametrize("key", ["experiments", "sweep.experiments", "training.batch_size"])
def test_params_of_another_type_end_it_in_findings_or_one_line(
    capsys: pytest.CaptureFixture[str], key: str, value: object
) -> None:
    values = yaml.safe_load(paths.PARAMS.read_text(encoding="utf-8"))
    change(values, key, value)
    paths.PARAMS.write_text(yaml.safe_dump(values), encoding="utf-8")
    lines, ended = check(capsys)
    assert "\n" not in str(ended)
    assert lines[-1].startswith(f"{FILES} files") or lines[-1].endswith(" findings")


@pytest.mark.usefixtures("_in_copy")
def test_an_edit_is_not_accepted_while_its_stage_runs(capsys: pytest.CaptureFixture[str]) -> None:
    alter(NOVEL, another_novel, catalogue.NOVEL)
    Path(".dvc").mkdir()
    with only_one(f"make_sessions@{NAME}"):
        lines, ended = check(capsys, "--accept", str(NOVEL))
    assert lines == []
    assert f"make_sessions@{NAME} runs already" in str(ended)


@pytest.mark.usefixtures("_in_copy")
def test_a_kept_embedding_is_checked_by_its_own_digests_and_by_what_it_was_made_from(
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = paths.kept(NAME)
    names = (folder / "entities.tsv").read_text(encoding="utf-8")
    (folder / "entities.tsv").write_text(f"{names[:-1]}x\n", encoding="utf-8")
    (line, _), ended = check(capsys)
    assert ended == 1
    assert line.startswith(f"{folder}/entities.tsv: expected the bytes whose SHA-256 is in embedding.json")
    PipelineOrigins(config.read(paths.PARAMS)).check_first()  # the report does not read it
    (folder / "entities.tsv").write_text(names, encoding="utf-8")
    alter_tensors(paths.vectors(NAME), a_little)
    assert check(capsys, "--accept", str(paths.vectors(NAME)))[1] == 0
    lines, _ = check(capsys)
    made = f"was made from another {paths.vectors(NAME)} than is there: run `dvc repro keep@{NAME}`"
    assert f"{folder}/embedding.json: {made}" in lines
    (folder / "embedding.json").unlink()
    assert any(line.startswith(f"{folder}/embedding.json: cannot be read") for line in check(capsys)[0])


@pytest.mark.usefixtures("_in_copy")
def test_what_does_not_agree_with_another_file_is_found(capsys: pytest.CaptureFixture[str]) -> None:
    last = len(pd.read_parquet(TOLD)) - 1
    alter(TOLD, put("triple", 10**6, last), catalogue.INSERT_TRIPLES, anew=True)
    coverage = paths.coverage(NAME)
    alter(coverage, lambda frame: frame[::-1], catalogue.COVERAGE, anew=True)
    lines, ended = check(capsys)
    assert ended == 1
    assert any(line.startswith(f"{TOLD}: row {last} (triple 1000000): expected ids below") for line in lines)
    assert any(re.match(rf"{coverage}: row 0 .*: expected the entities of the graph, in its order", x) for x in lines)
    assert any("was made from another" in line and str(TOLD) in line for line in lines)


@pytest.mark.usefixtures("_in_copy")
def test_an_edit_on_purpose_is_accepted_and_then_read(capsys: pytest.CaptureFixture[str]) -> None:
    """Also one that another program wrote, without a word of metadata."""
    written = metadata_of(SPLITS)
    splits = pd.read_parquet(SPLITS)
    row = int(splits.index[splits["split"] == "valid"][0])
    put("split", "test", row)(splits).to_parquet(SPLITS)
    assert "bears no digest" in small.refusal(f"train_theta0 {NAME}")
    by, (lines, ended) = f"make_sessions@{NAME}", check(capsys, "--accept", str(SPLITS.absolute()))
    assert ended == 0
    assert lines == [
        f"{SPLITS}: accepted. `dvc commit --force {by}` makes DVC keep it, until it runs that stage again",
        "`dvc repro` then runs what depends on it; without the commit, it would undo the edit first",
    ]
    accepted = metadata_of(SPLITS)
    assert accepted[ACCEPTED] == ""
    assert accepted[CONTENT] != written[CONTENT]
    assert {key: accepted[key] for key in ("isi.stage", "isi.own", "isi.params")} == {
        key: written[key] for key in ("isi.stage", "isi.own", "isi.params")
    }
    assert io.read_text(SPLITS, catalogue.SPLITS)["split"][row] == "test"
    small.run(f"train_theta0 {NAME}")
    lines, ended = check(capsys)
    assert all("was made from another" in line and str(SPLITS) in line for line in lines[:-1])
    assert any(str(paths.joint(NAME)) in line for line in lines)


@pytest.mark.usefixtures("_in_copy")
def test_an_accepted_edit_says_what_the_stage_had_written(capsys: pytest.CaptureFixture[str]) -> None:
    written = metadata_of(THETA0)[CONTENT]
    alter_tensors(THETA0, a_little)
    for _ in range(2):
        assert check(capsys, "--accept", str(THETA0))[1] == 0
        assert metadata_of(THETA0)[ACCEPTED] == written
    *lines, _ = check(capsys)[0]
    assert lines  # what was made from the earlier one
    assert all(f"was made from another {THETA0} than is there: run `dvc repro insert@" in line for line in lines)


@pytest.mark.usefixtures("_in_copy")
def test_an_edit_that_breaks_a_rule_is_not_accepted_and_nothing_changes(capsys: pytest.CaptureFixture[str]) -> None:
    def refused(*files: Path) -> str:
        before = [path.read_bytes() for path in (NOVEL, SPLITS)]
        lines, ended = check(capsys, "--accept", *map(str, files))
        assert lines == []
        assert [path.read_bytes() for path in (NOVEL, SPLITS)] == before
        return str(ended)

    alter(SPLITS, lambda splits: splits[100:], catalogue.SPLITS)
    assert "has no split" in refused(SPLITS)
    alter(NOVEL, put("entity", -1), catalogue.NOVEL)
    assert "entity -1" in refused(NOVEL)
    assert "entity -1" in refused(SPLITS)  # which cannot be seen beside it
    assert "entity -1" in refused(SPLITS, NOVEL)


@pytest.mark.usefixtures("_in_copy")
def test_files_that_change_together_are_accepted_together(capsys: pytest.CaptureFixture[str]) -> None:
    alter(NOVEL, another_novel, catalogue.NOVEL)
    lines, ended = check(capsys, "--accept", str(NOVEL))
    assert ended == 0
    lines, _ = check(capsys)
    assert any(line.startswith(f"{TOLD}: ") for line in lines)  # what was told is of another entity


def test_every_output_of_the_pipelines_has_rules() -> None:
    with chdir(small.ROOT):
        from tests.test_stages import BEYOND, FIRST, OPEN

        for entry in (FIRST | BEYOND).values():
            for out in entry["outs"]:
                if isinstance(out, str) and not re.search(r"^data/kept/|\.json$", out):
                    path = Path(OPEN.sub("x", out))
                    there = schema_of(path) or is_tensors(path) or is_tensors(path / "size=01.safetensors")
                    assert there, out
    assert len({id(schema) for _, schema in TABLES}) == 27


def test_it_runs_from_the_shell_and_says_where_it_is_not_at_home(tmp_path: Path) -> None:
    command, found = [sys.executable, "-m", "isi", "check"], os.environ | {"PYTHONPATH": str(small.ROOT)}
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, env=found)
    (line,) = ended.stderr.splitlines()
    assert "params.yaml: cannot be read" in line
    assert ended.returncode == 1
