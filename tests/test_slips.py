"""Slips of a user: each is answered in one line that tells the way out.

Most stages run in this process, by their ``main``: it has its packages already.
"""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from isi.analyses.variants import VARIANT_RUNS
from isi.errors import LONGEST, InputError, cut, meant, short
from isi.experiment.store import INITIAL_VECTORS, INSERTED, THETA0
from isi.graph.graph import TRIPLES
from isi.stage import missing
from isi.tables import paths
from tests.test_bad_input import KINDS, OBSERVED, graph, observed, outputs, workspace

__all__ = ["workspace"]  # a fixture

ROOT = Path(__file__).parent.parent


Says = Callable[[str], str]


def main_of(command: str) -> Callable[[], None]:
    name = command.split()[0]
    main: Callable[[], None] = getattr(importlib.import_module(f"stages.{name}"), name)
    return main


@pytest.fixture
def says(workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Says:
    """The one line with which a stage refuses its input, having written nothing."""

    def say(command: str) -> str:
        monkeypatch.chdir(workspace)
        monkeypatch.setattr(sys, "argv", [f"stages.{command.split()[0]}", *command.split()[1:]])
        before = outputs(workspace)
        with pytest.raises(SystemExit) as ended:
            main_of(command)()
        line = ended.value.code
        assert outputs(workspace) == before
        assert capsys.readouterr() == ("", "")
        assert isinstance(line, str)
        assert "\n" not in line
        assert len(line) < 300
        return line.removeprefix(f"{command.split()[0]}: ")

    return say


def replaced(workspace: Path, old: str, new: str) -> None:
    text = (workspace / paths.PARAMS).read_text(encoding="utf-8")
    assert old in text
    (workspace / paths.PARAMS).write_text(text.replace(old, new, 1), encoding="utf-8")


# Names


@pytest.mark.parametrize(
    ("command", "place", "close"),
    [
        ("mine ai2tor", "sources.ai2tor", "ai2thor"),
        ("build_graph trasfer", "experiments.trasfer", "transfer"),
        ("insert ai2thor xaver", "initializers.xaver", "xavier"),
        ("vary glov", "beyond/params.yaml: variants.glov", "glove"),
        (f"build_graph {'x' * 5000}", "experiments.xxx", ""),
        ("build_graph ../../etc", "experiments.../../etc", ""),
    ],
)
def test_an_unknown_name_is_refused_with_what_was_probably_meant(
    workspace: Path, says: Says, command: str, place: str, close: str
) -> None:
    (workspace / "beyond").symlink_to(ROOT / "beyond")
    line = says(command)
    assert "params.yaml: " in line
    assert place in line
    assert not close or f"did you mean '{close}'?" in line


@pytest.mark.parametrize(
    ("old", "new", "command", "line"),
    [
        ("min_count: 1", "min_cuont: 1", "build_graph",
         "experiments.ai2thor.graph.min_cuont: unknown key; did you mean 'min_count'?"),
        ("\nseed:", "\nsede:", "build_graph", "sede: unknown key; did you mean 'seed'?"),
        ("\nexperiments:", "\nexperimets:", "build_graph", "experimets: unknown key; did you mean 'experiments'?"),
        ("\ncompute:", "\ncomptue:", "build_graph", "comptue: unknown key; did you mean 'compute'?"),
        ("novel: any ", "novel: object ", "make_sessions",
         "experiments.ai2thor.sessions.novel: expected a list, got the text 'object': write [object]"),
        ("sizes: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 14]", "sizes: 5", "make_sessions",
         "experiments.ai2thor.sessions.sizes: Input should be a valid list, got 5"),
        ("text: definition", "text: definitions", "embed_words",
         "words.text: Input should be 'definition', 'phrase', 'wordnet' or 'glove', got 'definitions'; did you mean "),
        ("source: shipped", f"source: {'ab' * 5000}", "embed_words", ""),  # a file of that name
        ("min_count: 1 ", f"min_count: 1{'0' * 30}", "build_graph",
         "experiments.ai2thor.graph.min_count: Input should be less than 2147483648, got 1000"),
    ],
    ids=["key", "key at the top", "section", "section of all", "text for a list", "number for a list", "choice", "long",
         "large"],
)  # fmt: skip
def test_a_slip_in_params_is_one_short_line_that_tells_the_way_out(
    workspace: Path, says: Says, old: str, new: str, command: str, line: str
) -> None:
    observed(workspace, "ai2thor", OBSERVED, KINDS)
    replaced(workspace, old, new)
    if command != "build_graph":
        graph(workspace, "ai2thor")
    assert says(f"{command} ai2thor").removeprefix("params.yaml: ").startswith(line)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: " + "[" * 200_000, "expected YAML that is nested less deeply"),
        ("- " * 200_000 + "a", "expected YAML that is nested less deeply"),
        ("a: " + "9" * 5000, "expected YAML: Exceeds the limit"),
        ("a: 2023-02-30", "expected YAML: day is out of range for month"),
        ("a: !!bool maybe", "expected YAML: 'maybe'"),
        ("a: !!python/object/apply:os.system [touch run]", "line 1: expected YAML: could not determine a constructor"),
        ("a: b: c", "line 1: expected YAML: mapping values are not allowed"),
        ("a: 1\na: 2", "line 2: expected YAML: found duplicate key"),
        ("seed: 1".encode("utf-16"), "expected UTF-8, got byte"),
        (b"seed: \x00", "expected YAML"),
        (b"", "expected a mapping of keys to values"),
    ],
    ids=["brackets", "dashes", "digits", "date", "tag", "object", "colons", "twice", "UTF-16", "NUL", "empty"],
)
def test_what_is_no_yaml_is_one_short_line(workspace: Path, says: Says, text: str | bytes, said: str) -> None:
    (workspace / paths.PARAMS).write_bytes(text.encode() if isinstance(text, str) else text)
    assert says("build_graph ai2thor").startswith(f"params.yaml: {said}")
    assert not (workspace / "run").exists()


def test_a_byte_order_mark_is_read_over(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    observed(workspace, "ai2thor", OBSERVED, KINDS)
    for path in (paths.PARAMS, paths.PIPELINE):
        (workspace / path).write_bytes(b"\xef\xbb\xbf" + (workspace / path).read_bytes())
    monkeypatch.chdir(workspace)
    monkeypatch.setattr(sys, "argv", ["stages.build_graph", "ai2thor"])
    main_of("build_graph")()
    assert (workspace / TRIPLES.path(experiment="ai2thor")).exists()


# Too early, elsewhere


@pytest.mark.parametrize(
    ("command", "line"),
    [
        (
            "build_graph ai2thor",
            "data/observations/ai2thor.parquet: missing: run `dvc repro mine@ai2thor`, which makes it",
        ),
        ("make_sessions ai2thor", "data/graph/ai2thor/entities.parquet: missing: run `dvc repro build_graph@ai2thor`"),
        ("insert ai2thor es", "missing: run `dvc repro "),
        ("report", "missing: run `dvc repro "),
    ],
)
def test_a_stage_before_its_inputs_says_which_stage_makes_them(
    workspace: Path, says: Says, command: str, line: str
) -> None:
    (workspace / "beyond").symlink_to(ROOT / "beyond")
    assert line in says(command)


def test_vectors_that_are_missing_name_the_stage_that_makes_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    for path, stage in (
        (THETA0.path(experiment="transfer", size=5), "train_theta0@transfer"),
        (INITIAL_VECTORS.path(experiment="transfer", initializer="es"), "insert@transfer-es"),
        (INSERTED.path(experiment="transfer", initializer="es_permuted"), "insert@transfer-es_permuted"),
        (VARIANT_RUNS.path(variant="insert_triples_0"), "beyond/dvc.yaml:vary@insert_triples_0"),
        (Path("reports/metrics.json"), "report"),
        (Path("reports/tables/differences.csv"), "report"),
        (Path("data/runs"), None),
        (Path("/data/runs"), None),
        (Path("gone"), None),
    ):
        expected = f"missing: run `dvc repro {stage}`, which makes it" if stage else "no such file"
        assert str(missing(path)) == f"{path}: {expected}"


def test_vectors_that_are_read_before_they_are_made_are_said_to_be_missing(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(workspace)
    (workspace / "beyond").symlink_to(ROOT / "beyond")
    with pytest.raises(InputError, match=r"run `dvc repro train_theta0@ai2thor`, which makes it$"):
        THETA0.read(["entity"], experiment="ai2thor", size=5)
    THETA0.write({"entity": torch.ones(1)}, "train_theta0", experiment="ai2thor", size=5)
    THETA0.read(["entity"], experiment="ai2thor", size=5)


def test_a_stage_outside_the_project_says_so(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "stages.build_graph", "ai2thor"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment)
    (line,) = ended.stderr.splitlines()
    assert line.startswith("build_graph: dvc.yaml: no such file: ")
    assert line.endswith("is not the folder of the project, go there first")
    (tmp_path / "params.yaml").write_text("a: 1\n")
    (tmp_path / "dvc.yaml").write_text("plots: []\n")
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment)
    assert ended.stderr.startswith("build_graph: dvc.yaml: stages: expected a mapping of stages")
    repro = [sys.executable, str(ROOT / "tools/repro.py")]
    ended = subprocess.run(repro, cwd=tmp_path / "..", capture_output=True, text=True, env=environment)
    assert (ended.returncode, len(ended.stderr.splitlines())) == (1, 1)
    assert "go to the folder of the project first" in ended.stderr


def test_tools_of_another_python_say_which_one_to_use() -> None:
    command = [sys.executable, "-S", str(ROOT / "tools/repro.py")]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert re.fullmatch(
        r"repro: \S+ lacks DVC or this project: use `make repro`, or activate \.venv first\n", ended.stderr
    )


# What is asked for, and help


@pytest.mark.parametrize("arguments", ["", " ai2thor es more", " --seed 3 ai2thor es"])
def test_wrong_arguments_are_one_line_and_status_2(
    arguments: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", f"insert{arguments}".split())
    with pytest.raises(SystemExit) as ended:
        main_of("insert")()
    assert ended.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"python -m stages\.insert: .+; see --help\n", err)


@pytest.mark.parametrize(
    ("stage", "told"),
    [
        ("insert", ["experiment: ai2thor, transfer, published\n", "initializer: xavier, iu, es, rs, ers, ",
                    "reads: data/graph/EXPERIMENT, data/sessions/EXPERIMENT, ",
                    "writes: data/runs/EXPERIMENT/INITIALIZER.parquet, "]),
        ("explore", ["graph: ", "writes: data/beyond/graphs/GRAPH/entities.parquet, "]),
        ("report", ["reads: data/raw, data/observations, ", "writes: reports/index.html, "]),
    ],
)  # fmt: skip
def test_help_lists_the_choices_of_arguments_and_what_is_read_and_written(
    stage: str, told: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "argv", [stage, "--help"])
    with pytest.raises(SystemExit) as ended:
        main_of(stage)()
    assert ended.value.code == 0
    out = capsys.readouterr().out
    assert all(part in out for part in told)


# How a message is kept short


def test_a_message_is_short_and_in_one_line_whatever_it_repeats() -> None:
    long = str(InputError("params.yaml", "x" * 5000, "expected " + "y" * 10**7))
    assert len(long) <= LONGEST
    assert long.startswith("params.yaml: xxx")
    assert str(InputError("f", "a\nb\x1b[31m\ud800", "c\tc")) == "f: a b\\x1b[31m\\ud800: c c"
    assert str(InputError("f" * 150, "place", "expected this")) == f"{'f' * 150}: place: expected this"
    assert cut("abcdefghij", 10) == "abcdefghij"
    assert cut("abcdefghijk", 10) == "abcde...jk"


def test_a_value_is_repeated_in_short() -> None:
    deep: list[object] = []
    for _ in range(2000):
        deep = [deep]
    for value in ("x" * 5000, deep, list(range(10**6)), {n: n for n in range(10**5)}, int("f" * 5000, 16)):
        assert len(short(value)) < 100
    assert short("es") == "'es'"


def test_what_was_meant_is_told_only_where_something_is_like_it() -> None:
    assert meant("xaver", ["es", "xavier"]) == "; did you mean 'xavier'?"
    assert meant("mug", ["es", "xavier"]) == ""
