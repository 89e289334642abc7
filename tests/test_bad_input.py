"""Stages run as a user runs them, on a user's mistakes."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from contextlib import chdir
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest
import torch
import yaml

from isi.experiment.store import INITIAL_VECTORS, INSERTED, RUNS, TIES
from isi.graph.graph import ENTITIES, TRIPLES
from isi.graph.sessions import INSERT_TRIPLES, NOVEL, SPLITS
from isi.graph.words import COVERAGE, WORD_VECTORS
from isi.sources.tables import KINDS as KIND_TABLE
from isi.sources.tables import MINED, OBSERVATIONS
from isi.tables import io, paths
from isi.tables.table import Table, concat
from tools.workspace import change

ROOT = Path(__file__).parent.parent
OBSERVED = pd.DataFrame(
    {"scene": ["FloorPlan1"], "room": ["kitchen"], "instance": ["Mug|1"], "head": ["mug"], "relation": ["atLocation"],
     "tail": ["kitchen"], "count": [1]}
)  # fmt: skip
KINDS = pd.DataFrame({"entity": ["kitchen", "mug"], "kind": ["room", "object"], "phrase": ["kitchen", "mug"]})
HOUSES: dict[str, object] = {
    "reader": "mp3d_houses", "folder": "houses", "category": "mpcat40", "rooms": {"k": "kitchen"},
    "vocabulary": "data/raw/mp3d/vocabulary.yaml",
}  # fmt: skip
OWN_KINDS = {"atLocation": {"head": "object", "tail": "room"}}


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """A folder with the code, the sources and the params, whose outputs an earlier run left."""
    for name in ("isi", "stages", "data/raw"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).symlink_to(ROOT / name)
    for path in (paths.PARAMS, paths.PIPELINE):
        (tmp_path / path).write_bytes((ROOT / path).read_bytes())
    return tmp_path


def set_params(workspace: Path, changes: dict[str, object]) -> None:
    params = yaml.safe_load((workspace / "params.yaml").read_text(encoding="utf-8"))
    for key, value in changes.items():
        change(params, key, value)
    (workspace / "params.yaml").write_text(yaml.safe_dump(params), encoding="utf-8")


def run_stage(workspace: Path, *command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", *command], cwd=workspace, capture_output=True, text=True, check=False, timeout=60
    )


def outputs(workspace: Path) -> dict[str, bytes]:
    """Every file under ``data`` that did not ship with the product."""
    files = [path for path in (workspace / "data").rglob("*") if path.is_file() and "raw" not in path.parts]
    return {str(path.relative_to(workspace)): path.read_bytes() for path in files}


def refusal(workspace: Path, *command: str) -> str:
    """The one line with which a stage refuses its input, having written nothing."""
    before = outputs(workspace)
    ended = run_stage(workspace, *command)
    assert ended.returncode == 1, ended.stderr
    lines = ended.stderr.splitlines()
    assert len(lines) == 1, ended.stderr
    assert ended.stdout == ""
    assert outputs(workspace) == before
    return lines[0]


def leave(workspace: Path, *earlier: Path) -> None:
    """Outputs of an earlier run, which a failed one must not touch."""
    for path in earlier:
        (workspace / path).parent.mkdir(parents=True, exist_ok=True)
        (workspace / path).write_bytes(b"the last good one")


def write(workspace: Path, path: Path, frame: pd.DataFrame, table: Table) -> None:
    """A table as an earlier stage has left it."""
    with chdir(workspace):
        table.write_file(path, frame, "an_earlier_stage")


def observed(workspace: Path, source: str, observations: pd.DataFrame, kinds: pd.DataFrame) -> None:
    """What mining a source has given."""
    write(workspace, OBSERVATIONS.path(source=source), observations, OBSERVATIONS)
    write(workspace, KIND_TABLE.path(source=source), kinds, KIND_TABLE)


def graph(workspace: Path, experiment: str) -> None:
    """A graph of a mug in a kitchen."""
    triples = OBSERVED[["head", "relation", "tail", "count"]].assign(source="ai2thor")
    write(workspace, TRIPLES.path(experiment=experiment), triples, TRIPLES)
    write(workspace, ENTITIES.path(experiment=experiment), KINDS.assign(source="ai2thor"), ENTITIES)


@pytest.mark.parametrize(
    ("key", "misspelt", "command", "named"),
    [
        ("\nseed:", "\nsede:", "mine ai2thor", "sede"),
        ("reader: ai2thor", "reader: ai2tor", "mine ai2thor", "sources.ai2thor.reader"),
        ("min_count: 1", "min_count: 0", "build_graph ai2thor", "experiments.ai2thor.graph.min_count"),
        ("novel: any", "novel: nay", "make_sessions ai2thor", "experiments.ai2thor.sessions.novel"),
        ("\n  model: analogy", "\n  model: analog", "train_theta0 ai2thor", "embedding.model"),
        ("\n    k: 8", "\n    kk: 8", "insert ai2thor es", "initializers.es.kk"),
        ("\n    initializers: all", "\n    initializers: al", "insert ai2thor es", "experiments.ai2thor.initializers"),
    ],
)
def test_a_mistake_in_params_ends_a_stage_in_one_line_that_names_the_key(
    workspace: Path, key: str, misspelt: str, command: str, named: str
) -> None:
    graph(workspace, "ai2thor")
    text = (workspace / paths.PARAMS).read_text(encoding="utf-8")
    assert key in text
    (workspace / paths.PARAMS).write_text(text.replace(key, misspelt), encoding="utf-8")
    line = refusal(workspace, *f"stages.{command}".split())
    assert line.startswith(f"{command.split()[0]}: params.yaml: {named}")


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ("mine home", "sources.home"),
        ("insert home es", "experiments.home"),
        ("sweep_indicators ai2thor mean", "sweep.initializers.mean"),
    ],
)
def test_what_params_do_not_have_is_refused_by_its_key(workspace: Path, command: str, named: str) -> None:
    graph(workspace, "home")
    assert refusal(workspace, *f"stages.{command}".split()).startswith(f"{command.split()[0]}: params.yaml: {named}")


def a_recording() -> dict[str, list[list[object]]]:
    keys = ("kitchens", "living_rooms", "bedrooms", "bathrooms")
    scenes: dict[str, list[list[object]]] = {key: [[] for _ in range(30)] for key in keys}
    scenes["kitchens"][4] = [{"objectType": "Mug", "objectId": "Mug|1", "parentReceptacles": ["Shelf|1"]}]
    return scenes


def mined(source: str) -> list[Path]:
    return [table.path(source=source) for table in (OBSERVATIONS, KIND_TABLE, MINED)]


@pytest.mark.parametrize(
    ("content", "places"),
    [
        (json.dumps(a_recording())[:-3], ["JSON"]),
        (json.dumps(a_recording()), ["FloorPlan5", "Mug|1", "Shelf|1"]),
        (None, ["No such file"]),
    ],
    ids=["truncated", "missing parent", "no file"],
)
def test_a_broken_recording_is_named_and_the_earlier_observations_stay(
    workspace: Path, content: str | None, places: list[str]
) -> None:
    leave(workspace, *mined("ai2thor"))
    if content is not None:
        (workspace / "mine.json").write_text(content, encoding="utf-8")
    sha256 = hashlib.sha256((content or "").encode()).hexdigest()
    set_params(workspace, {"sources.ai2thor.from": "mine.json", "sources.ai2thor.sha256": sha256})
    line = refusal(workspace, "stages.mine", "ai2thor")
    assert "mine.json" in line
    assert all(place in line for place in places), line


def test_another_recording_than_the_params_vouch_for_is_refused_and_no_output_begun(workspace: Path) -> None:
    set_params(workspace, {"sources.ai2thor.sha256": "0" * 64})
    line = refusal(workspace, "stages.mine", "ai2thor")
    assert "ai2thor-object-metadata.json" in line
    assert "sources.ai2thor" in line
    assert "sha256" in line
    assert outputs(workspace) == {}


@pytest.mark.parametrize(
    ("content", "place"),
    [("2 3\nmug 1 2 3\nbowl 1 x 3\n", "line 3"), ("2 2\nmug 1 2 3\nbowl 1 2 3\n", "line")],
    ids=["broken line", "other dimension"],
)
def test_a_broken_file_of_word_vectors_is_named_and_the_earlier_vectors_stay(
    workspace: Path, content: str, place: str
) -> None:
    leave(workspace, WORD_VECTORS.path(experiment="ai2thor"), COVERAGE.path(experiment="ai2thor"))
    graph(workspace, "ai2thor")
    (workspace / "my.vec").write_text(content, encoding="utf-8")
    set_params(workspace, {"words.source": "my.vec"})
    line = refusal(workspace, "stages.embed_words", "ai2thor")
    assert "my.vec" in line
    assert place in line


def test_a_table_that_lacks_a_column_is_named_and_the_earlier_graph_stays(workspace: Path) -> None:
    leave(workspace, ENTITIES.path(experiment="ai2thor"), TRIPLES.path(experiment="ai2thor"))
    observed(workspace, "ai2thor", OBSERVED, KINDS)
    table = workspace / OBSERVATIONS.path(source="ai2thor")
    pq.write_table(pq.read_table(table).drop_columns(["room"]), table)
    line = refusal(workspace, "stages.build_graph", "ai2thor")
    assert str(OBSERVATIONS.path(source="ai2thor")) in line
    assert "column 'room'" in line


@pytest.mark.parametrize(
    ("content", "places"),
    [
        (None, ["sources.mp3d", "houses: "]),
        ("ASCII 1.1\nH x - 0 0 0 0 0 1 0 0 0 0\n", ["x.house", "line 2", "objects"]),
    ],
    ids=["no house", "truncated"],
)
def test_a_broken_house_is_named_and_the_earlier_observations_stay(
    workspace: Path, content: str | None, places: list[str]
) -> None:
    leave(workspace, *mined("mp3d"))
    (workspace / "houses").mkdir()
    if content is not None:
        (workspace / "houses/x.house").write_text(content, encoding="utf-8")
    set_params(workspace, {"sources.mp3d": HOUSES})
    line = refusal(workspace, "stages.mine", "mp3d")
    assert all(place in line for place in places), line


@pytest.mark.parametrize(
    ("reader", "name", "good", "bad"),
    [
        ("table", "log.csv", "head,relation,tail\nmug,atLocation,kitchen\n", "mug,atLocation\n"),
        ("rdf", "log.nt", "<urn:x:mug> <urn:x:atLocation> <urn:x:kitchen> .\n", "mug atLocation kitchen\n"),
    ],
)
def test_triples_of_ones_own_are_mined_and_broken_ones_are_named_and_the_earlier_observations_stay(
    workspace: Path, reader: str, name: str, good: str, bad: str
) -> None:
    lines = len(good.splitlines())
    (workspace / name).write_text(good, encoding="utf-8")
    set_params(workspace, {"sources.own": {"reader": reader, "path": name, "kinds": OWN_KINDS}})
    ended = run_stage(workspace, "stages.mine", "own")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout == "1 rows of observations of 2 entities\n"
    kinds = KIND_TABLE.read_file(workspace / KIND_TABLE.path(source="own"))
    assert kinds.to_numpy().tolist() == [["kitchen", "room", "kitchen"], ["mug", "object", "mug"]]
    (workspace / name).write_text(good + bad, encoding="utf-8")
    assert f"sources.own: {name}: line {lines + 1}: " in refusal(workspace, "stages.mine", "own")


@pytest.mark.parametrize("settings", [{}, HOUSES], ids=["tallies", "houses"])
@pytest.mark.parametrize(
    ("content", "place"),
    [
        (None, "cannot be read"),
        ("structure: [\n", "line 2: expected YAML"),
        ("structure: wall\nsame_as: {}\n", "structure: "),
        ("structure: [wall]\nsame_as: {wall: painting}\n", "same_as: 'wall' is in structure"),
    ],
    ids=["no file", "no YAML", "wrong type", "in both"],
)
def test_a_broken_vocabulary_is_named_and_the_earlier_observations_stay(
    workspace: Path, settings: dict[str, object], content: str | None, place: str
) -> None:
    leave(workspace, *mined("mp3d"))
    if content is not None:
        (workspace / "words.yaml").write_text(content, encoding="utf-8")
    changes: dict[str, object] = {"sources.mp3d": settings} if settings else {}
    set_params(workspace, {**changes, "sources.mp3d.vocabulary": "words.yaml"})
    assert f"sources.mp3d: words.yaml: {place}" in refusal(workspace, "stages.mine", "mp3d")


@pytest.mark.parametrize(
    ("head", "count", "named"),
    [
        ("mug", 6, "params.yaml: experiments.transfer.graph.extend.always: 'fan'"),
        ("fan", 5, "params.yaml: experiments.transfer.graph.extend.always: 'fan'"),
        ("oven", 6, f"{OBSERVATIONS.path(source='mp3d')}: object 'oven'"),
    ],
    ids=["none of that name", "too few", "another kind"],
)
def test_entities_that_cannot_join_the_graph_are_named_and_the_earlier_graph_stays(
    workspace: Path, head: str, count: int, named: str
) -> None:
    leave(workspace, ENTITIES.path(experiment="transfer"), TRIPLES.path(experiment="transfer"))
    made_of = OBSERVED.assign(relation="hasMaterial", tail="oven")
    kinds = pd.concat([KINDS, pd.DataFrame({"entity": ["oven"], "kind": ["material"], "phrase": ["oven"]})])
    observed(workspace, "ai2thor", pd.concat([OBSERVED, made_of]), kinds)
    seen = OBSERVED.assign(scene=None, instance=None, head=head, count=count)
    observed(workspace, "mp3d", seen, KINDS.replace("mug", head))
    line = refusal(workspace, "stages.build_graph", "transfer")
    assert named in line


def test_more_novel_entities_than_the_graph_has_are_refused_by_their_key(workspace: Path) -> None:
    graph(workspace, "ai2thor")
    line = refusal(workspace, "stages.make_sessions", "ai2thor")
    assert "params.yaml: experiments.ai2thor.sessions.sizes" in line


def test_a_graph_without_triples_has_no_sessions(workspace: Path) -> None:
    graph(workspace, "ai2thor")
    write(workspace, TRIPLES.path(experiment="ai2thor"), OBSERVED[:0].assign(source=""), TRIPLES)
    line = refusal(workspace, "stages.make_sessions", "ai2thor")
    assert "params.yaml: experiments.ai2thor.sessions: expected a graph with triples" in line


def test_an_unknown_initializer_is_refused_with_the_names_of_those_there_are(workspace: Path) -> None:
    line = refusal(workspace, "stages.insert", "ai2thor", "xaver")
    assert all(name in line for name in ("initializers.xaver", "xavier", "iu", "es", "rs", "ers"))


def test_a_good_input_after_a_bad_one_replaces_the_earlier_output(workspace: Path) -> None:
    leave(workspace, ENTITIES.path(experiment="ai2thor"), TRIPLES.path(experiment="ai2thor"))
    observed(workspace, "ai2thor", OBSERVED, KINDS)
    ended = run_stage(workspace, "stages.build_graph", "ai2thor")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ENTITIES.read_file(workspace / ENTITIES.path(experiment="ai2thor"))["entity"].tolist() == ["kitchen", "mug"]
    tables = (OBSERVATIONS, KIND_TABLE, ENTITIES, TRIPLES)
    files = [table.path(source="ai2thor", experiment="ai2thor") for table in tables]
    assert set(outputs(workspace)) == set(map(str, files))  # and no temporary file


def test_an_initializer_that_the_experiment_does_not_list_leaves_tables_without_rows(workspace: Path) -> None:
    set_params(workspace, {"experiments.ai2thor.initializers": ["rs", "xavier"]})
    graph(workspace, "ai2thor")
    row = pd.DataFrame({"size": [1], "seed": [0], "entity": [1], "triple": [0], "session": [1], "split": ["train"]})
    write(workspace, SPLITS.path(experiment="ai2thor"), row, SPLITS)
    write(workspace, NOVEL.path(experiment="ai2thor"), row, NOVEL)
    write(workspace, INSERT_TRIPLES.path(experiment="ai2thor"), row, INSERT_TRIPLES)
    write(workspace, RUNS.path(experiment="ai2thor", model="joint"), concat([], RUNS), RUNS)
    with chdir(workspace):
        WORD_VECTORS.write({"vectors": torch.ones(2, 3)}, "embed_words", experiment="ai2thor")
    ended = run_stage(workspace, "stages.insert", "ai2thor", "es")
    assert ended.returncode == 0, ended.stderr
    for path, schema in (
        (RUNS.path(experiment="ai2thor", model="es"), RUNS),
        (TIES.path(experiment="ai2thor", model="es"), TIES),
        (INSERTED.path(experiment="ai2thor", initializer="es"), INSERTED),
    ):
        assert schema.read_file(workspace / path).empty
    assert io.read_tensors(workspace / INITIAL_VECTORS.path(experiment="ai2thor", initializer="es"), []) == {}


def test_a_stage_explains_itself_without_running(workspace: Path) -> None:
    (workspace / paths.PARAMS).unlink()  # not even read
    ended = run_stage(workspace, "stages.insert", "--help")
    assert ended.returncode == 0
    assert "python -m stages.insert" in ended.stdout
    assert "experiment initializer" in ended.stdout
