"""Recordings of the recorder written, cut short and gone on with."""

from __future__ import annotations

import errno
import gzip
import hashlib
import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from isi.config import check
from isi.config import read as read_params
from isi.errors import InputError
from isi.recording.file import Recording
from isi.recording.settings import Layout, Recorder
from isi.recording.simulator import header
from isi.sources._recording import read_recording
from isi.tables import paths
from tests.test_recording import HEADER, MUG, SIMULATOR, scene

ROOT = Path(__file__).parent.parent


def write(path: Path, *layouts: Layout) -> None:
    recording = Recording(path, SIMULATOR)
    for layout in layouts:
        recording.append(layout, [MUG])


def test_what_is_written_is_what_the_simulator_gave_less_what_no_one_reads_and_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "r.jsonl.gz"
    write(path, Layout("FloorPlan5", None), Layout("FloorPlan5", 3))
    header, *scenes = (json.loads(line) for line in gzip.decompress(path.read_bytes()).splitlines())
    assert header == HEADER
    assert scenes[1] == scene(spawn=3, objects=[{key: value for key, value in MUG.items() if key != "position"}])
    assert [scene.name for scene in read_recording(path, None)] == ["FloorPlan5", "FloorPlan5#3"]
    assert Recording(path, SIMULATOR).names == {"FloorPlan5", "FloorPlan5#3"}


def test_a_recording_that_is_killed_anywhere_in_a_scene_goes_on_behind_the_last_whole_one(tmp_path: Path) -> None:
    path, first, second = tmp_path / "r", Layout("FloorPlan1", None), Layout("FloorPlan2", None)
    write(path, first)
    one = path.read_bytes()
    write(path, second)
    both = path.read_bytes()
    for length in range(len(one), len(both)):
        path.write_bytes(both[:length])
        if length > len(one):
            with pytest.raises(InputError, match=r"cut short|gzip"):
                list(read_recording(path, None))
        recording = Recording(path, SIMULATOR)
        assert recording.names == {"FloorPlan1"}
        assert path.read_bytes() == one
    recording.append(second, [MUG])
    assert path.read_bytes() == both


@pytest.mark.parametrize(
    ("damage", "place"),
    [
        (lambda _whole: b"", "expected a recording, or no file"),
        (lambda whole: whole[:20], "expected a recording, or no file"),
        (lambda _whole: b"a photograph, and nothing else", "byte 0: .*gzip"),
        (lambda whole: whole[:150] + b"????" + whole[154:], "byte .*gzip"),
        (lambda whole: whole + b"\0" * 40, "byte .*gzip"),
        (lambda _whole: gzip.compress(b'{"format": "other"}\n'), "line 1: expected a header"),
        (lambda whole: whole + gzip.compress(b"3\n"), "line 3: expected a scene"),
    ],
)  # fmt: skip
def test_what_is_no_recording_is_refused_and_left_as_it_is(
    tmp_path: Path, damage: Callable[[bytes], bytes], place: str
) -> None:
    path = tmp_path / "r"
    write(path, Layout("FloorPlan1", None))
    broken = damage(path.read_bytes())
    path.write_bytes(broken)
    with pytest.raises(InputError, match=rf"/r: {place}"):
        Recording(path, SIMULATOR)
    assert path.read_bytes() == broken


def test_a_recording_of_another_build_is_not_gone_on_with(tmp_path: Path) -> None:
    write(tmp_path / "r", Layout("FloorPlan1", None))
    with pytest.raises(InputError, match="line 1: was recorded with build 'thor-1', not 'thor-2': choose another"):
        Recording(tmp_path / "r", SIMULATOR | {"build": "thor-2"})


def test_another_local_build_of_the_same_name_does_not_go_on_with_a_recording(tmp_path: Path) -> None:
    section = read_params(ROOT / paths.PARAMS)["recorder"]
    headers = []
    for folder in ("one", "other"):
        program = tmp_path / folder / "thor-Linux64"
        program.parent.mkdir()
        program.write_text(folder, encoding="utf-8")
        headers.append(header(check({**section, "platform": str(program)}, Recorder, "recorder")))
    digits = [hashlib.sha256(content).hexdigest()[:16] for content in (b"one", b"other")]
    assert [found["build"] for found in headers] == [f"thor-Linux64 {some}" for some in digits]
    Recording(tmp_path / "r", headers[0]).append(Layout("FloorPlan1", None), [MUG])
    with pytest.raises(
        InputError, match=f"line 1: was recorded with build 'thor-Linux64 {digits[0]}', not .*{digits[1]}"
    ):
        Recording(tmp_path / "r", headers[1])
    program.unlink()
    with pytest.raises(InputError, match="other/thor-Linux64: cannot be read"):
        header(check({**section, "platform": str(program)}, Recorder, "recorder"))


def test_what_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="file/r: cannot be written"):
        write(tmp_path / "file" / "r", Layout("FloorPlan1", None))


def test_a_line_that_cannot_be_cut_off_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_path: Path, _length: int) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    write(tmp_path / "r", Layout("FloorPlan1", None))
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
    write(path, Layout("FloorPlan1", None))
    monkeypatch.setattr("isi.recording.file.MOST_BYTES", 400)
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
