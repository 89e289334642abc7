"""Stages run as a user runs them, on a user's mistakes; and what is left of a stage that was killed."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest
import yaml

from isi import paths, tables
from isi.tables import Provenance
from tests import sleepers
from tools.workspace import change

ROOT = Path(__file__).parent.parent
OBSERVED = pd.DataFrame(
    {"scene": ["FloorPlan1"], "room": ["kitchen"], "instance": ["Mug|1"], "head": ["mug"], "relation": ["atLocation"],
     "tail": ["kitchen"], "count": [1]}
)  # fmt: skip
KNOWN = pd.DataFrame({"entity": ["mug"], "kind": ["object"], "source": ["ai2thor"], "phrase": ["mug"]})


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """A folder with the code, the sources and the params, whose outputs an earlier run left."""
    for name in ("isi", "stages", "data/raw"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "params.yaml").write_bytes((ROOT / "params.yaml").read_bytes())
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


@pytest.mark.parametrize(
    ("key", "misspelt", "named"),
    [("\nseed:", "\nsede:", "sede"), ("min_count: 1", "min_count: 0", "graph.min_count")],
)
def test_a_mistake_in_params_ends_a_stage_in_one_line_that_names_the_key(
    workspace: Path, key: str, misspelt: str, named: str
) -> None:
    leave(workspace, paths.observations("ai2thor"))
    text = (workspace / "params.yaml").read_text(encoding="utf-8")
    assert key in text
    (workspace / "params.yaml").write_text(text.replace(key, misspelt), encoding="utf-8")
    line = refusal(workspace, "stages.mine_ai2thor")
    assert "params.yaml" in line
    assert named in line


def a_recording() -> dict[str, list[list[object]]]:
    keys = ("kitchens", "living_rooms", "bedrooms", "bathrooms")
    scenes: dict[str, list[list[object]]] = {key: [[] for _ in range(30)] for key in keys}
    scenes["kitchens"][4] = [{"objectType": "Mug", "objectId": "Mug|1", "parentReceptacles": ["Shelf|1"]}]
    return scenes


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
    leave(workspace, paths.observations("ai2thor"))
    if content is not None:
        (workspace / "mine.json").write_text(content, encoding="utf-8")
    sha256 = hashlib.sha256((content or "").encode()).hexdigest()
    set_params(workspace, {"ai2thor.recording": "mine.json", "ai2thor.sha256": sha256})
    line = refusal(workspace, "stages.mine_ai2thor")
    assert "mine.json" in line
    assert all(place in line for place in places), line


def test_another_recording_than_the_params_vouch_for_is_refused_and_no_output_begun(workspace: Path) -> None:
    set_params(workspace, {"ai2thor.sha256": "0" * 64})
    line = refusal(workspace, "stages.mine_ai2thor")
    assert "ai2thor-object-metadata.json" in line
    assert "ai2thor.sha256" in line
    assert outputs(workspace) == {}


@pytest.mark.parametrize(
    ("content", "place"),
    [("2 3\nmug 1 2 3\nbowl 1 x 3\n", "line 3"), ("2 2\nmug 1 2 3\nbowl 1 2 3\n", "line")],
    ids=["broken line", "other dimension"],
)
def test_a_broken_file_of_word_vectors_is_named_and_the_earlier_vectors_stay(
    workspace: Path, content: str, place: str
) -> None:
    leave(workspace, paths.vectors("ai2thor"), paths.coverage("ai2thor"))
    tables.write(workspace / paths.entities("ai2thor"), KNOWN, tables.ENTITIES, Provenance("build_graph", {}))
    (workspace / "my.vec").write_text(content, encoding="utf-8")
    set_params(workspace, {"words.source": "my.vec"})
    line = refusal(workspace, "stages.embed_words", "ai2thor")
    assert "my.vec" in line
    assert place in line


def test_a_table_that_lacks_a_column_is_named_and_the_earlier_graph_stays(workspace: Path) -> None:
    leave(workspace, paths.entities("ai2thor"), paths.triples("ai2thor"))
    observed = workspace / paths.observations("ai2thor")
    tables.write(observed, OBSERVED, tables.OBSERVATIONS, Provenance("mine_ai2thor", {}))
    pq.write_table(pq.read_table(observed).drop_columns(["room"]), observed)
    line = refusal(workspace, "stages.build_graph")
    assert str(paths.observations("ai2thor")) in line
    assert "column 'room'" in line


@pytest.mark.parametrize(
    ("content", "places"),
    [
        (None, ["houses: ", "mp3d.houses"]),
        ("ASCII 1.1\nH x - 0 0 0 0 0 1 0 0 0 0\n", ["x.house", "line 2", "objects"]),
    ],
    ids=["no house", "truncated"],
)
def test_a_broken_house_is_named_and_the_earlier_observations_stay(
    workspace: Path, content: str | None, places: list[str]
) -> None:
    leave(workspace, paths.observations("mp3d"))
    (workspace / "houses").mkdir()
    if content is not None:
        (workspace / "houses/x.house").write_text(content, encoding="utf-8")
    set_params(workspace, {"mp3d.source": "house", "mp3d.houses": "houses"})
    line = refusal(workspace, "stages.mine_mp3d")
    assert all(place in line for place in places), line


@pytest.mark.parametrize(
    ("head", "count", "named"),
    [
        ("mug", 6, "params.yaml: affordances.entities: 'fan'"),
        ("fan", 5, "params.yaml: affordances.entities: 'fan'"),
        ("kitchen", 6, f"{paths.observations('mp3d')}: object 'kitchen'"),
    ],
    ids=["none of that name", "too few", "another kind"],
)
def test_entities_that_cannot_join_the_graph_are_named_and_the_earlier_graph_stays(
    workspace: Path, head: str, count: int, named: str
) -> None:
    leave(workspace, paths.entities("transfer"), paths.triples("transfer"))
    triples = OBSERVED[["head", "relation", "tail", "count"]].assign(source="ai2thor")
    tables.write(workspace / paths.triples("ai2thor"), triples, tables.TRIPLES, Provenance("build_graph", {}))
    both = pd.concat([KNOWN, KNOWN.assign(entity="kitchen", phrase="kitchen", kind="room")])
    tables.write(workspace / paths.entities("ai2thor"), both, tables.ENTITIES, Provenance("build_graph", {}))
    seen = OBSERVED.assign(scene=None, instance=None, head=head, count=count)
    tables.write(workspace / paths.observations("mp3d"), seen, tables.OBSERVATIONS, Provenance("mine_mp3d", {}))
    line = refusal(workspace, "stages.transfer_graph")
    assert named in line


def test_more_novel_entities_than_the_graph_has_are_refused_by_their_key(workspace: Path) -> None:
    triples = OBSERVED[["head", "relation", "tail", "count"]].assign(source="ai2thor")
    tables.write(workspace / paths.triples("ai2thor"), triples, tables.TRIPLES, Provenance("build_graph", {}))
    both = pd.concat([KNOWN, KNOWN.assign(entity="kitchen", phrase="kitchen", kind="room")])
    tables.write(workspace / paths.entities("ai2thor"), both, tables.ENTITIES, Provenance("build_graph", {}))
    line = refusal(workspace, "stages.make_sessions")
    assert "params.yaml: sessions.sizes" in line


def test_an_unknown_initializer_is_refused_with_the_names_of_those_there_are(workspace: Path) -> None:
    line = refusal(workspace, "stages.insert", "xaver")
    assert all(name in line for name in ("'xaver'", "xavier", "iu", "es", "rs", "ers"))


def test_a_good_input_after_a_bad_one_replaces_the_earlier_output(workspace: Path) -> None:
    leave(workspace, paths.entities("ai2thor"), paths.triples("ai2thor"))
    observed = workspace / paths.observations("ai2thor")
    tables.write(observed, OBSERVED, tables.OBSERVATIONS, Provenance("mine_ai2thor", {}))
    ended = run_stage(workspace, "stages.build_graph")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert tables.read(workspace / paths.entities("ai2thor"), tables.ENTITIES)["entity"].tolist() == ["kitchen", "mug"]
    expected = {str(path("ai2thor")) for path in (paths.observations, paths.entities, paths.triples)}
    assert set(outputs(workspace)) == expected  # and no temporary file


def test_a_stage_explains_itself_without_running(workspace: Path) -> None:
    (workspace / "params.yaml").unlink()  # not even read
    ended = run_stage(workspace, "stages.insert", "--help")
    assert ended.returncode == 0
    assert "python -m stages.insert" in ended.stdout
    assert "initializer" in ended.stdout


# Killed

STAGE = "import sys; from tests import sleepers; sleepers.main(sys.argv[1])"
#: Starts a stage, as DVC does, tells its process id, and waits for it.
PARENT = (
    "import subprocess, sys\n"
    "stage = subprocess.Popen([sys.executable, '-c', *sys.argv[1:]])\n"
    "print(stage.pid, flush=True)\n"
    "stage.wait()"
)

linux_only = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


def session(leader: int) -> dict[int, str]:
    """Living processes of the session that a process leads: id and command."""
    found = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state, _, _, of = (entry / "stat").read_text().rpartition(")")[2].split()[:4]
                command = (entry / "cmdline").read_text().replace("\0", " ")
            except OSError:  # it ended while we looked
                continue
            if int(of) == leader and state not in "ZX":
                found[int(entry.name)] = command
    return found


def wait_until(done: Callable[[], bool], seconds: float) -> bool:
    """Whether a condition comes true in time."""
    deadline = time.monotonic() + seconds
    while not done():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


@dataclass(frozen=True)
class Started:
    """A stage whose workers are all asleep at their tasks, in a session that its parent leads."""

    parent: int
    stage: int
    workers: set[int]


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Started]:
    command = [sys.executable, "-c", PARENT, STAGE, str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, start_new_session=True, stdout=subprocess.PIPE) as parent:
        assert parent.stdout
        try:
            stage = int(parent.stdout.readline())
            assert wait_until(lambda: len(list(tmp_path.iterdir())) == sleepers.WORKERS, 60)
            yield Started(parent.pid, stage, {int(path.name) for path in tmp_path.iterdir()})
        finally:
            for process in session(parent.pid):
                os.kill(process, signal.SIGKILL)


@linux_only
@pytest.mark.parametrize("killed", ["parent", "stage"])
def test_no_process_of_a_stage_outlives_it_or_its_parent(started: Started, killed: str) -> None:
    assert {started.parent, started.stage} | started.workers <= session(started.parent).keys()
    os.kill(getattr(started, killed), signal.SIGKILL)
    assert wait_until(lambda: not session(started.parent), 10), session(started.parent)
