"""The recorder drives a controller of the simulator, for which a small one stands here."""

import gzip
import hashlib
import json
import random
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from isi import config
from isi.errors import InputError
from isi.sources import Source
from isi.sources.recordings import FORMAT, ITHOR, Layout, Recorder, locate, read_recording
from isi.tables import paths
from stages.files import OBSERVATIONS
from stages.record import Recording, header, main, record
from tests.observing import observations_of

ROOT = Path(__file__).parent.parent
RAW: dict[str, Any] = yaml.safe_load((ROOT / paths.PARAMS).read_text(encoding="utf-8"))
KITCHEN: list[dict[str, Any]] = [
    {"objectId": f"Mug|{number}", "objectType": "Mug", "pickupable": True, "position": number}
    for number in range(5)
] + [{"objectId": f"Shelf|{number}", "objectType": "Shelf"} for number in range(5)]
SCENES = {f"FloorPlan{number}": KITCHEN[number - 1 :] for number in (1, 2, 3)}
PLAIN = [{key: value for key, value in thing.items() if key != "position"} for thing in KITCHEN]


class Simulator:
    """The controllers that were started; each has the same scenes, and fails where it is told."""

    def __init__(self, scenes: Mapping[str, Any]) -> None:
        self.scenes, self.started = scenes, list[Mapping[str, Any]]()
        self.running = 0
        self.fails: dict[str, Exception] = {}  #: by floor plan; "" for the start

    def __call__(self, **settings: Any) -> "Simulator":
        self.started.append(settings)
        if error := self.fails.get(""):
            raise error
        self.running += 1
        return self

    def stop(self) -> None:
        self.running -= 1

    def reset(self, scene: str) -> Any:
        if error := self.fails.get(scene):
            raise error
        self.scene = scene
        return self.event(self.scenes[scene])

    def step(self, action: str, *, randomSeed: int, raise_for_failure: bool) -> Any:
        assert (action, raise_for_failure) == ("InitialRandomSpawn", True)
        return self.event(shuffled(self.scenes[self.scene], randomSeed))

    def event(self, objects: Any) -> Any:
        scene = self.scene + "_physics" * (not self.scene.startswith("FloorPlan_"))
        return SimpleNamespace(metadata={"sceneName": scene, "objects": objects})


def shuffled(objects: Sequence[Any], seed: int) -> list[Any]:
    return random.Random(seed).sample(objects, len(objects))


@pytest.fixture
def simulator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Simulator:
    """In a folder with the file of a build."""
    monkeypatch.chdir(tmp_path)
    Path("thor").write_bytes(b"build")
    made = Simulator(SCENES)
    monkeypatch.setattr("stages.record.Controller", made)
    return made


def settings(**changes: object) -> Recorder:
    ours = {"platform": "thor", "output": "r", "scenes": ["FloorPlan1-3"]}
    return config.check({**RAW["recorder"], **ours, **changes}, Recorder, "recorder")


def lines(path: str = "r") -> list[dict[str, Any]]:
    return [json.loads(line) for line in gzip.decompress(Path(path).read_bytes()).splitlines()]


def names(path: str = "r") -> list[str]:
    """Names of the scenes in a recording, in order."""
    return [Layout(**scene).name for scene in lines(path)[1:]]


def test_scenes_are_recorded_as_the_simulator_gives_them_less_what_is_not_mined(
    simulator: Simulator,
) -> None:
    record(settings(output="out/r.jsonl.gz"))
    first, *scenes = lines("out/r.jsonl.gz")
    digits = hashlib.sha256(b"build").hexdigest()[:16]
    assert first == FORMAT | {"build": f"thor {digits}", "package": "5.0.0"}
    assert scenes == [
        {"scene": name, "spawn": None, "objects": PLAIN[place:]}
        for place, name in enumerate(SCENES)
    ]
    assert [path.name for path in Path("out").iterdir()] == ["r.jsonl.gz"]
    assert [scene.name for scene in read_recording(Path("out/r.jsonl.gz"), None)] == list(SCENES)
    (started,) = simulator.started
    assert started["local_executable_path"] == str(Path("thor").absolute())
    assert not simulator.running


def test_a_build_that_is_downloaded_is_named_to_the_controller(simulator: Simulator) -> None:
    record(settings(platform="Linux64", build="a" * 40, width=20))
    (started,) = simulator.started
    assert started["platform"].name() == "Linux64"
    assert (started["commit_id"], started["width"], started["height"]) == ("a" * 40, 20, 20)


def test_seeds_give_several_layouts_of_a_floor_plan(simulator: Simulator) -> None:
    record(settings(scenes=["FloorPlan1"], spawns=[None, 0, 1]))
    assert names() == ["FloorPlan1", "FloorPlan1#0", "FloorPlan1#1"]
    assert [scene["objects"] for scene in lines()[2:]] == [shuffled(PLAIN, 0), shuffled(PLAIN, 1)]
    assert len(simulator.started) == 1


def test_a_run_records_only_what_is_not_there(simulator: Simulator) -> None:
    record(settings(scenes=["FloorPlan2"]))
    record(settings())
    assert names() == ["FloorPlan2", "FloorPlan1", "FloorPlan3"]
    before = Path("r").read_bytes()
    record(settings())
    assert Path("r").read_bytes() == before
    assert len(simulator.started) == 2  # no player where nothing is missing


def test_a_scene_that_fails_is_given_up_with_one_line(
    simulator: Simulator, capsys: pytest.CaptureFixture[str]
) -> None:
    simulator.fails["FloorPlan2"] = RuntimeError("Agent cannot\nbe placed. " + "x" * 1000)
    recording, missing = record(settings())
    assert names() == ["FloorPlan1", "FloorPlan3"]
    assert recording.names == {*names()}
    assert len(missing) == 3
    (line,) = (line for line in capsys.readouterr().err.splitlines() if "given up" in line)
    assert "FloorPlan2 is given up: Agent cannot be placed. x" in line
    assert len(line) < 400
    assert (len(simulator.started), simulator.running) == (2, 0)


def test_another_scene_than_the_one_asked_for_is_no_scene(
    simulator: Simulator, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = simulator.reset("FloorPlan1")
    monkeypatch.setattr(simulator, "reset", {f"FloorPlan{n}": answer for n in (1, 2, 3)}.get)
    record(settings())
    assert names() == ["FloorPlan1"]
    assert "FloorPlan2 is given up: it loaded the scene FloorPlan1" in capsys.readouterr().err


def test_a_player_that_does_not_start_ends_the_run_with_a_hint(simulator: Simulator) -> None:
    simulator.fails[""] = TimeoutError()
    with pytest.raises(InputError, match=r"^thor: cannot be started: TimeoutError: .* a display"):
        record(settings())
    assert not Path("r").exists()


def test_another_build_does_not_go_on_with_a_recording(simulator: Simulator) -> None:
    record(settings(scenes=["FloorPlan1"]))
    Path("thor").write_bytes(b"another")
    with pytest.raises(InputError, match=r"r: line 1: expected 'thor .* as build of the recording"):
        record(settings())
    Path("thor").unlink()
    with pytest.raises(InputError, match="thor: cannot be read"):
        header(settings())
    assert names() == ["FloorPlan1"]
    assert len(simulator.started) == 1


@pytest.mark.parametrize("content", [b"", b"a photograph", gzip.compress(b'{"format": "other"}\n')])
def test_what_is_no_recording_is_refused_and_left_as_it_is(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "r"
    path.write_bytes(content)
    with pytest.raises(InputError, match="/r: "):
        Recording(path, {})
    assert path.read_bytes() == content


def test_what_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="file/r: cannot be written"):
        Recording(tmp_path / "file" / "r", {}).append(Layout(scene="FloorPlan1", spawn=None), [])


def test_groups_and_ranges_list_floor_plans_in_order() -> None:
    plans = [layout.scene for layout in settings(scenes=["FloorPlan_Val1_2-3", "ithor"]).layouts]
    assert plans[:3] == ["FloorPlan_Val1_2", "FloorPlan_Val1_3", "FloorPlan1"]
    assert len(plans) == 122
    apartments = settings(scenes=["robothor"]).layouts
    assert len(apartments) == 75
    assert (apartments[59].name, apartments[74].name) == ("FloorPlan_Train12_5", "FloorPlan_Val3_5")


def test_the_command_takes_its_settings_from_params_and_from_its_arguments_before_them(
    simulator: Simulator, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = yaml.safe_dump({"recorder": {**RAW["recorder"], "platform": "nowhere"}})
    paths.PARAMS.write_text(text, encoding="utf-8")
    arguments = ["--scenes", "FloorPlan2", "FloorPlan1", "--platform", "thor", "--output", "here/r"]
    monkeypatch.setattr(sys, "argv", ["record", *arguments])
    main()
    assert capsys.readouterr().out == "2 scenes in here/r, 2 of them new\n"
    assert names("here/r") == ["FloorPlan2", "FloorPlan1"]
    assert len(simulator.started) == 1


# As sources read it

DESK = {"objectId": "Desk|1", "objectType": "Desk", "salientMaterials": ["Wood"]}
CUP = {
    "objectId": "Cup|1",
    "objectType": "Cup",
    "parentReceptacles": ["Desk|1"],
    "pickupable": True,
}
ROBOTHOR = {"reader": "robothor", "sha256": None, "materials": "simulator", "broken": "error"}


def test_apartments_of_the_simulator_are_read_from_the_output_of_the_recorder(
    simulator: Simulator,
) -> None:
    simulator.scenes = {"FloorPlan_Val2_1": [DESK, CUP]}
    record(settings(output="data/recordings/robothor.jsonl.gz", scenes=["FloorPlan_Val2_1"]))
    observed = observations_of({**ROBOTHOR, "from": "simulator"})
    assert observed.rows("scene", "instance", "head", "relation", "tail") == [
        ("FloorPlan_Val2_1", "Desk|1", "desk", "atLocation", "apartment"),
        ("FloorPlan_Val2_1", "Desk|1", "desk", "hasMaterial", "wood"),
        ("FloorPlan_Val2_1", "Cup|1", "cup", "atLocation", "apartment"),
        ("FloorPlan_Val2_1", "Cup|1", "cup", "atLocation", "desk"),
        ("FloorPlan_Val2_1", "Cup|1", "cup", "hasAffordance", "pick up"),
        ("FloorPlan_Val2_1", "Cup|1", "cup", "hasAffordance", "put"),
    ]


def test_mining_recorded_scenes_gives_the_bytes_of_the_shipped_recording(
    simulator: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped = json.loads(locate("recording").read_bytes())
    simulator.scenes = {
        name: objects
        for plans in ITHOR
        for name, objects in zip(plans.names, shipped[plans.key], strict=True)
    }
    record(settings(scenes=["ithor"]))
    assert names() == list(simulator.scenes)
    output = Path("r").absolute()
    monkeypatch.chdir(ROOT)
    shipped_table, table = (mine(output, form) for form in ("recording", str(output)))
    assert shipped_table == table


def mine(path: Path, source: str) -> bytes:
    """Mine a recording with AI2-THOR's settings in params; returns the bytes of the table."""
    given = {**RAW["sources"]["ai2thor"], "sha256": None, "from": source}
    path = path.with_suffix(".parquet")  # beside the recording
    OBSERVATIONS.write_parts(path, Source(given, "sources.ai2thor", 0).frames(), "mine")
    return path.read_bytes()
