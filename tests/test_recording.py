"""Recordings of both formats are read; those of the recorder are written,
cut short and continued.
"""

import errno
import gzip
import hashlib
import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from isi.config import check
from isi.config import read as read_params
from isi.errors import InputError
from isi.recorder import Recording, header
from isi.sources.recordings import (
    FORMAT,
    ITHOR,
    ROBOTHOR,
    FloorPlans,
    Layout,
    Recorder,
    Scene,
    SceneObject,
    read_recording,
)
from isi.tables import paths

ROOT = Path(__file__).parent.parent
KEYS = ("kitchens", "living_rooms", "bedrooms", "bathrooms")
MUG = {
    "objectId": "Mug|1",
    "objectType": "Mug",
    "parentReceptacles": ["Shelf|1"],
    "receptacleObjectIds": None,
    "salientMaterials": ["Ceramic"],
    "pickupable": True,
    "openable": False,
    "position": {"x": 1.0},
}
#: What mining reads of it.
READ = SceneObject("Mug|1", "mug", ["Shelf|1"], [], ["ceramic"], ["pick up", "put"])
SIMULATOR = {"build": "thor-1", "package": "5.0.0"}
HEADER = FORMAT | SIMULATOR


def package() -> dict[str, Any]:
    """A recording in the package's format: thirty scenes per room and RoboTHOR's 75,
    empty except one.
    """
    scenes: dict[str, Any] = {key: [[] for _ in range(30)] for key in KEYS}
    scenes["kitchens"][4] = [dict(MUG)]
    return scenes | {"robothor": [[] for _ in range(74)] + [[dict(MUG)]]}


def read(path: Path, content: object, plans: tuple[FloorPlans, ...] = ITHOR) -> list[Scene]:
    """Write a recording of the package (JSON, or text unchanged), and read it with its SHA-256."""
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return list(read_recording(path, hashlib.sha256(path.read_bytes()).hexdigest(), plans))


def read_lines(path: Path, *lines: object, plans: tuple[FloorPlans, ...] = ITHOR) -> list[Scene]:
    """Write a recording of the recorder (JSON, or bytes unchanged), and read it."""
    encoded = [line if isinstance(line, bytes) else json.dumps(line).encode() for line in lines]
    path.write_bytes(gzip.compress(b"\n".join(encoded)))
    return list(read_recording(path, None, plans))


def scene(
    name: str = "FloorPlan5", spawn: object = None, objects: object = ()
) -> dict[str, object]:
    return {
        "scene": name,
        "spawn": spawn,
        "objects": list(objects) if isinstance(objects, tuple) else objects,
    }


# As the package has it


def test_scenes_of_the_package_bear_the_numbers_of_their_floor_plans_and_only_what_mining_reads(
    tmp_path: Path,
) -> None:
    scenes = read(tmp_path / "recording.json", package())
    assert len(scenes) == 120
    ends = [(scenes[place].name, scenes[place].room) for place in (0, 29, 30, 59, 60, 89, 90, 119)]
    assert ends == [
        ("FloorPlan1", "kitchen"),
        ("FloorPlan30", "kitchen"),
        ("FloorPlan201", "living room"),
        ("FloorPlan230", "living room"),
        ("FloorPlan301", "bedroom"),
        ("FloorPlan330", "bedroom"),
        ("FloorPlan401", "bathroom"),
        ("FloorPlan430", "bathroom"),
    ]
    assert all(scene.name == f"FloorPlan{scene.number}" for scene in scenes)
    assert scenes[4] == Scene("FloorPlan5", 5, "kitchen", [READ])


# As the recorder writes it


def test_scenes_of_the_recorder_come_in_its_order_with_their_layouts(tmp_path: Path) -> None:
    lines = [scene("FloorPlan201", objects=(MUG,)), scene("FloorPlan1", 7), scene("FloorPlan1")]
    assert read_lines(tmp_path / "r", HEADER, *lines) == [
        Scene("FloorPlan201", 201, "living room", [READ]),
        Scene("FloorPlan1#7", 1, "kitchen", []),
        Scene("FloorPlan1", 1, "kitchen", []),
    ]


def test_apartments_have_their_names_or_in_the_package_their_places(tmp_path: Path) -> None:
    recorded = read_lines(
        tmp_path / "r",
        HEADER,
        scene("FloorPlan_Train2_1"),
        scene("FloorPlan_Val3_5"),
        plans=ROBOTHOR,
    )
    assert [(scene.name, scene.number, scene.room) for scene in recorded] == [
        ("FloorPlan_Train2_1", 506, "apartment"),
        ("FloorPlan_Val3_5", 575, "apartment"),
    ]
    packaged = read(tmp_path / "r.json", package(), ROBOTHOR)
    assert len(packaged) == 75
    assert packaged[-1] == Scene("RoboTHOR75", 575, "apartment", [READ])


def test_scenes_of_the_recorder_are_read_one_by_one(tmp_path: Path) -> None:
    path = tmp_path / "r"
    path.write_bytes(
        b"".join(gzip.compress(json.dumps(line).encode() + b"\n") for line in (HEADER, scene()))
        + b"junk"
    )
    scenes = read_recording(path, None)
    assert next(scenes).name == "FloorPlan5"
    with pytest.raises(InputError, match="gzip"):
        next(scenes)


# As it grows


def write(path: Path, *layouts: Layout) -> None:
    recording = Recording(path, SIMULATOR)
    for layout in layouts:
        recording.append(layout, [MUG])


def test_what_is_written_is_what_the_simulator_gave_less_what_is_not_mined_and_is_read_again(
    tmp_path: Path,
) -> None:
    path = tmp_path / "folder" / "r.jsonl.gz"
    write(path, Layout(scene="FloorPlan5", spawn=None), Layout(scene="FloorPlan5", spawn=3))
    header, *scenes = (json.loads(line) for line in gzip.decompress(path.read_bytes()).splitlines())
    assert header == HEADER
    assert scenes[1] == scene(
        spawn=3, objects=[{key: value for key, value in MUG.items() if key != "position"}]
    )
    assert [scene.name for scene in read_recording(path, None)] == ["FloorPlan5", "FloorPlan5#3"]
    assert Recording(path, SIMULATOR).names == {"FloorPlan5", "FloorPlan5#3"}


def test_a_recording_that_is_killed_anywhere_in_a_scene_goes_on_behind_the_last_whole_one(
    tmp_path: Path,
) -> None:
    path, first, second = (
        tmp_path / "r",
        Layout(scene="FloorPlan1", spawn=None),
        Layout(scene="FloorPlan2", spawn=None),
    )
    write(path, first)
    first_line = path.read_bytes()
    write(path, second)
    both = path.read_bytes()
    for length in range(len(first_line), len(both)):
        path.write_bytes(both[:length])
        if length > len(first_line):
            with pytest.raises(InputError, match=r"cut short|gzip"):
                list(read_recording(path, None))
        recording = Recording(path, SIMULATOR)
        assert recording.names == {"FloorPlan1"}
        assert path.read_bytes() == first_line
    recording.append(second, [MUG])
    assert path.read_bytes() == both


@pytest.mark.parametrize(
    ("damage", "place"),
    [
        (lambda _whole: b"", "expected a recording to continue, or no file"),
        (lambda whole: whole[:20], "expected a recording to continue, or no file"),
        (lambda _whole: b"a photograph, and nothing else", "byte 0: .*gzip"),
        (lambda whole: whole[:150] + b"????" + whole[154:], "byte .*gzip"),
        (lambda whole: whole + b"\0" * 40, "byte .*gzip"),
        (
            lambda _whole: gzip.compress(b'{"format": "other"}\n'),
            "line 1: expected 'isi recording' as format",
        ),
        (lambda whole: whole + gzip.compress(b"3\n"), "line 3: "),
    ],
)
def test_what_is_no_recording_is_refused_and_left_as_it_is(
    tmp_path: Path, damage: Callable[[bytes], bytes], place: str
) -> None:
    path = tmp_path / "r"
    write(path, Layout(scene="FloorPlan1", spawn=None))
    broken = damage(path.read_bytes())
    path.write_bytes(broken)
    with pytest.raises(InputError, match=rf"/r: {place}"):
        Recording(path, SIMULATOR)
    assert path.read_bytes() == broken


def test_another_local_build_of_the_same_name_does_not_go_on_with_a_recording(
    tmp_path: Path,
) -> None:
    section = read_params(ROOT / paths.PARAMS)["recorder"]
    headers = []
    for folder in ("one", "other"):
        program = tmp_path / folder / "thor-Linux64"
        program.parent.mkdir()
        program.write_text(folder, encoding="utf-8")
        headers.append(header(check({**section, "platform": str(program)}, Recorder, "recorder")))
    digits = [hashlib.sha256(content).hexdigest()[:16] for content in (b"one", b"other")]
    assert [made["build"] for made in headers] == [f"thor-Linux64 {first}" for first in digits]
    Recording(tmp_path / "r", headers[0]).append(Layout(scene="FloorPlan1", spawn=None), [MUG])
    expected = (
        f"line 1: expected 'thor-Linux64 {digits[1]}' as build of the recording, got .*{digits[0]}"
    )
    with pytest.raises(InputError, match=expected):
        Recording(tmp_path / "r", headers[1])
    program.unlink()
    with pytest.raises(InputError, match="other/thor-Linux64: cannot be read"):
        header(check({**section, "platform": str(program)}, Recorder, "recorder"))


def test_what_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="file/r: cannot be written"):
        write(tmp_path / "file" / "r", Layout(scene="FloorPlan1", spawn=None))


def test_a_line_that_cannot_be_cut_off_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_path: Path, _length: int) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    write(tmp_path / "r", Layout(scene="FloorPlan1", spawn=None))
    cut = (tmp_path / "r").read_bytes() + gzip.compress(b"killed")[:-9]
    (tmp_path / "r").write_bytes(cut)
    monkeypatch.setattr("os.truncate", refuse)
    with pytest.raises(InputError, match=r"/r: cannot be written \(Permission denied\)"):
        Recording(tmp_path / "r", SIMULATOR)
    assert (tmp_path / "r").read_bytes() == cut


@pytest.mark.parametrize("whole", [True, False])
def test_a_line_is_unpacked_up_to_the_longest_that_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole: bool
) -> None:
    path = tmp_path / "r"
    write(path, Layout(scene="FloorPlan1", spawn=None))
    monkeypatch.setattr("isi.recorder.MOST_BYTES", 400)
    assert Recording(path, SIMULATOR).names == {"FloorPlan1"}
    bomb = gzip.compress(b" " * 50_000_000)
    path.write_bytes(path.read_bytes() + (bomb if whole else bomb[:-9]))
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=r"byte .*: expected lines of at most 400 bytes"):
            Recording(path, SIMULATOR)
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()
