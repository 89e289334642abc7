"""The recorder drives the simulator's own controller,
which starts our player and exchanges messages with it.
"""

import gzip
import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from isi import config
from isi.errors import InputError
from isi.sources import OBSERVATIONS, Source
from isi.sources.recordings import ITHOR, Layout, Recorder, locate
from isi.tables import paths
from stages.record import record
from tests import player
from tests.environment import PATIENCE
from tests.observing import observations_of

ROOT = Path(__file__).parent.parent
RAW: dict[str, Any] = yaml.safe_load((ROOT / paths.PARAMS).read_text(encoding="utf-8"))
KITCHEN: list[dict[str, Any]] = [
    {
        "objectId": f"Mug|{number}",
        "objectType": "Mug",
        "pickupable": True,
        "parentReceptacles": [f"Shelf|{number}"],
    }
    for number in range(5)
] + [{"objectId": f"Shelf|{number}", "objectType": "Shelf"} for number in range(5)]
SCENES = {f"FloorPlan{number}": KITCHEN[number - 1 :] for number in (1, 2, 3)}

#: Seconds that the recorder waits for the player, unless a test names fewer.
LONG = 600.0


def settings(program: object, output: Path, **changes: object) -> dict[str, object]:
    """The recorder's settings in params, with our player."""
    ours = {
        "platform": str(program),
        "output": str(output),
        "scenes": ["FloorPlan1-3"],
        "retries": 1,
    }
    return {**RAW["recorder"], **ours, "seconds": LONG, "start_seconds": LONG, **changes}


def recorded(program: object, output: Path, **changes: object) -> list[str]:
    """Run the recorder; returns the names of the scenes in the recording."""
    record(config.check(settings(program, output, **changes), Recorder, "recorder"))
    return names(output)


def names(output: Path) -> list[str]:
    """Names of the scenes in a recording, in order."""
    _, *scenes = (json.loads(line) for line in gzip.decompress(output.read_bytes()).splitlines())
    return [Layout(scene=scene["scene"], spawn=scene["spawn"]).name for scene in scenes]


def refusal(program: object, output: Path, **changes: object) -> str:
    """The line with which a run of the recorder fails."""
    with pytest.raises(InputError) as refused:
        recorded(program, output, **changes)
    line = str(refused.value)
    assert line.isprintable()
    assert len(line) < 600
    return line


@pytest.fixture(autouse=True)
def _at_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine with a graphics card that is not set up, and without a display."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "0")
    monkeypatch.delenv("DISPLAY", raising=False)


def test_scenes_are_recorded_as_the_simulator_gives_them(tmp_path: Path) -> None:
    program, output = (
        player.install(tmp_path / "a player's", SCENES),
        tmp_path / "out" / "r.jsonl.gz",
    )
    assert recorded(program, output) == list(SCENES)
    header, *scenes = (
        json.loads(line) for line in gzip.decompress(output.read_bytes()).splitlines()
    )
    digits = hashlib.sha256(program.read_bytes()).hexdigest()[:16]
    assert header == {
        "format": "isi recording",
        "version": 1,
        "simulator": "ai2thor",
        "build": f"player {digits}",
        "package": "5.0.0",
    }
    assert scenes == [
        {"scene": name, "spawn": None, "objects": objects} for name, objects in SCENES.items()
    ]
    assert not (tmp_path / "home").exists()
    assert list(output.parent.iterdir()) == [output]


def test_seeds_give_several_layouts_of_a_floor_plan(tmp_path: Path) -> None:
    program, output = player.install(tmp_path / "player", SCENES), tmp_path / "r"
    recorded_names = recorded(program, output, scenes=["FloorPlan1"], spawns=[None, 0, 1])
    assert recorded_names == ["FloorPlan1", "FloorPlan1#0", "FloorPlan1#1"]
    scenes = [
        json.loads(line)["objects"]
        for line in gzip.decompress(output.read_bytes()).splitlines()[2:]
    ]
    for seed, objects in enumerate(scenes):
        parents = [thing["parentReceptacles"] for thing in player.spawned(KITCHEN, seed)]
        assert [thing["parentReceptacles"] for thing in objects] == parents
    assert scenes[0] != scenes[1]


def test_a_run_records_only_what_is_not_there(tmp_path: Path) -> None:
    program, output = player.install(tmp_path / "player", SCENES), tmp_path / "r"
    recorded(program, output, scenes=["FloorPlan2"])
    output.write_bytes(output.read_bytes() + gzip.compress(b"killed while it was written")[:-9])
    assert recorded(program, output) == ["FloorPlan2", "FloorPlan1", "FloorPlan3"]
    (tmp_path / "player" / "actions").unlink()
    assert recorded(program, output) == ["FloorPlan2", "FloorPlan1", "FloorPlan3"]
    assert not (tmp_path / "player" / "actions").exists()  # no player was started


@pytest.mark.parametrize("at", ["Reset", "Initialize"])
def test_a_scene_is_tried_again_by_another_player_when_the_first_has_died(
    tmp_path: Path, at: str
) -> None:
    dies = {"at": at, "scene": "FloorPlan2", "does": "die", "times": 1}
    program = player.install(tmp_path / "player", SCENES, dies)
    assert recorded(program, tmp_path / "r") == list(SCENES)
    processes = [line.split()[-1] for line in player.actions(tmp_path / "player")]
    assert len(set(processes)) == 2


def test_a_player_that_dies_too_often_ends_the_run_in_one_line_and_what_was_recorded_stays(
    tmp_path: Path,
) -> None:
    program = player.install(
        tmp_path / "player", SCENES, {"at": "Initialize", "scene": "FloorPlan2", "does": "die"}
    )
    line = refusal(program, tmp_path / "r")
    assert line == f"{program}: FloorPlan2: the player died 2 times (recorder.retries)"
    assert names(tmp_path / "r") == ["FloorPlan1"]


def test_a_player_that_dies_at_its_start_ends_the_run_with_a_hint(tmp_path: Path) -> None:
    program = player.install(tmp_path / "player", SCENES, {"at": "Start", "does": "die"})
    assert "device and, except with CloudRendering, a display" in refusal(program, tmp_path / "r")
    assert not (tmp_path / "r").exists()


@pytest.mark.parametrize(
    ("at", "limits"),
    [
        ("Start", {"start_seconds": 1.0}),
        ("Reset", {"seconds": 1.0}),
        ("Initialize", {"seconds": 1.0}),
    ],
)
def test_a_player_that_does_not_answer_is_waited_for_no_longer_than_params_say_and_is_ended(
    tmp_path: Path, at: str, limits: Mapping[str, float]
) -> None:
    scene = {} if at == "Start" else {"scene": "FloorPlan2"}
    program = player.install(tmp_path / "player", SCENES, {"at": at, **scene, "does": "hang"})
    began = time.monotonic()
    line = refusal(program, tmp_path / "r", **limits)
    # the other limit, which the line tells as well
    assert time.monotonic() - began < PATIENCE < LONG
    allowed = {"seconds": LONG, "start_seconds": LONG, **limits}
    start = f"{allowed['start_seconds']:g} s at the start (recorder.start_seconds)"
    assert line.endswith(
        f"no answer within {allowed['seconds']:g} s (recorder.seconds), or {start}"
    )
    players = subprocess.run(
        ["pgrep", "-f", str(tmp_path / "player")],  # noqa: S607
        capture_output=True,
        check=False,
    )
    assert players.stdout == b""


@pytest.mark.parametrize(
    ("scenes", "misbehaviours", "changes", "message"),
    [
        (
            SCENES,
            [{"at": "InitialRandomSpawn", "does": "fail", "message": ""}],
            {"spawns": [4]},
            "FloorPlan1#4: the simulator answers: an error without a message",
        ),
        (
            SCENES,
            [],
            {"scenes": ["FloorPlan30"]},
            (
                "FloorPlan30: the simulator answers: Scene "
                "'FloorPlan30_physics' not contained in build"
            ),
        ),
        (
            SCENES,
            [],
            {"scenes": ["FloorPlan3", "FloorPlan30"]},
            (
                "FloorPlan30: the simulator answers: Scene "
                "'FloorPlan30_physics' not contained in build"
            ),
        ),
        (
            {"FloorPlan1": ["Mug"]},
            [],
            {},
            "FloorPlan1: the simulator answers: it has no list of objects",
        ),
        (
            SCENES,
            [
                {
                    "at": "Initialize",
                    "scene": "FloorPlan2",
                    "does": "fail",
                    "code": "",
                    "message": "Agent could not be placed.\nat Unity.Frame\n" + "x" * 10_000,
                }
            ],
            {},
            "FloorPlan2: the simulator answers: Agent could not be placed.",
        ),
    ],
)
def test_an_answer_without_the_scene_ends_the_run_in_the_simulators_words(
    tmp_path: Path,
    scenes: Mapping[str, object],
    misbehaviours: list[dict[str, object]],
    changes: Any,
    message: str,
) -> None:
    program = player.install(tmp_path / "player", scenes, *misbehaviours)
    assert refusal(program, tmp_path / "r", **changes).startswith(f"{program}: {message}")
    if message.startswith("FloorPlan2"):
        assert names(tmp_path / "r") == ["FloorPlan1"]


def test_groups_and_ranges_list_floor_plans_in_order() -> None:
    recorder = config.check(
        {**RAW["recorder"], "scenes": ["FloorPlan_Val1_2-3", "ithor"]}, Recorder, "recorder"
    )
    plans = [layout.scene for layout in recorder.layouts]
    assert plans[:3] == ["FloorPlan_Val1_2", "FloorPlan_Val1_3", "FloorPlan1"]
    assert len(plans) == 122
    apartments = config.check(
        {**RAW["recorder"], "scenes": ["robothor"]}, Recorder, "recorder"
    ).layouts
    assert len(apartments) == 75
    assert (apartments[59].name, apartments[74].name) == ("FloorPlan_Train12_5", "FloorPlan_Val3_5")


# As sources read it

DESK = {
    "objectId": "Desk|1",
    "objectType": "Desk",
    "salientMaterials": ["Wood"],
    "pickupable": False,
}
CUP = {
    "objectId": "Cup|1",
    "objectType": "Cup",
    "parentReceptacles": ["Desk|1"],
    "pickupable": True,
}
ROBOTHOR = {"reader": "robothor", "sha256": None, "materials": "simulator", "broken": "error"}


def test_apartments_of_the_simulator_are_read_from_the_output_of_the_recorder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    program = player.install(tmp_path / "player", {"FloorPlan_Val2_1": [DESK, CUP]})
    recorded(program, Path("data/recordings/robothor.jsonl.gz"), scenes=["FloorPlan_Val2_1"])
    observed = observations_of({**ROBOTHOR, "from": "simulator"})
    assert observed.rows("scene", "instance", "head", "relation", "tail") == [
        ("FloorPlan_Val2_1", "Desk|1", "desk", "atLocation", "apartment"),
        ("FloorPlan_Val2_1", "Desk|1", "desk", "hasMaterial", "wood"),
        ("FloorPlan_Val2_1", "Cup|1", "cup", "atLocation", "apartment"),
        ("FloorPlan_Val2_1", "Cup|1", "cup", "atLocation", "desk"),
        ("FloorPlan_Val2_1", "Cup|1", "cup", "hasAffordance", "pick up"),
        ("FloorPlan_Val2_1", "Cup|1", "cup", "hasAffordance", "put"),
    ]


# As a user runs it


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "stages.record", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )


def test_the_command_takes_its_settings_from_params_and_from_its_arguments_before_them(
    tmp_path: Path,
) -> None:
    program = player.install(tmp_path / "player", SCENES)
    text = yaml.safe_dump({"recorder": settings("nowhere", tmp_path / "nowhere")})
    (tmp_path / paths.PARAMS).write_text(text, encoding="utf-8")
    ended = run(
        tmp_path,
        "--scenes",
        "FloorPlan2",
        "FloorPlan1",
        "--platform",
        str(program),
        "--output",
        "here/r",
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout == "2 scenes in here/r, 2 of them new\n"
    assert names(tmp_path / "here" / "r") == ["FloorPlan2", "FloorPlan1"]
    refused = run(tmp_path)
    assert (refused.returncode, refused.stdout) == (1, "")
    assert refused.stderr.splitlines() == [refused.stderr.strip()]
    assert refused.stderr.startswith("record: params.yaml: recorder.platform: expected one of ")


# All of it


def test_mining_scenes_recorded_over_the_wire_gives_the_bytes_of_the_shipped_recording(
    tmp_path: Path,
) -> None:
    shipped = json.loads(locate("recording").read_bytes())
    scenes = {
        name: objects
        for plans in ITHOR
        for name, objects in zip(plans.names, shipped[plans.key], strict=True)
    }
    program, output = player.install(tmp_path / "player", scenes), tmp_path / "r"
    assert recorded(program, output, scenes=["ithor"]) == list(scenes)
    assert len(scenes) == 120
    mined = [
        mine(tmp_path / form, source)
        for form, source in (("shipped", "recording"), ("recorded", str(output)))
    ]
    assert mined[0] == mined[1]


def mine(path: Path, source: str) -> bytes:
    """Mine a recording with AI2-THOR's settings in params; returns the bytes of the table."""
    given = {**RAW["sources"]["ai2thor"], "sha256": None, "from": source}
    OBSERVATIONS.write_parts(path, Source(given, "sources.ai2thor", 0).frames(), "mine")
    return path.read_bytes()
