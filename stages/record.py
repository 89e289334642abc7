"""Record scenes of the live AI2-THOR simulator, for sources that are set to `from: simulator`.

Resumes where an earlier run stopped. The settings are those of the section `recorder` of
params.yaml, which no stage of a pipeline reads; arguments override them.
"""

import argparse
import gzip
import hashlib
import json
import os
import shlex
import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ai2thor.build import COMMIT_ID, build_name
from ai2thor.controller import Controller
from ai2thor.platform import STR_PLATFORM_MAP
from tqdm import tqdm

from isi import config
from isi.errors import InputError, at, cut
from isi.process import Parser, errors_in_one_line
from isi.sources import recordings
from isi.sources.readers import json_lines, parse_json
from isi.sources.recordings import MOST_BYTES, Layout, Recorder
from isi.tables import io, paths

Reported = Mapping[str, Any]  #: An object as the simulator reports it.
_LONGEST = 300  #: Maximum number of characters of a simulator's message.


class Recording:
    """A recording: a header, then the scenes, each line compressed by itself."""

    def __init__(self, path: Path, simulator: Mapping[str, Any]) -> None:
        """Read what is recorded; InputError if it is no recording of this simulator."""
        self.path, header = path, recordings.FORMAT | dict(simulator)
        self.names: set[str] = set()  #: names of the recorded layouts
        self._lines = [_compressed(json.dumps(header).encode())]
        if not path.exists():
            return
        lines = json_lines(path, MOST_BYTES, "a recording, compressed by gzip")
        recordings.check_header(path, next(lines, (1, b""))[1], header)
        for number, line in lines:
            self.names.add(parse_json(Layout, line, path, f"line {number}").name)
            self._lines.append(_compressed(line.strip()))

    def append(self, layout: Layout, objects: Iterable[Reported]) -> None:
        """Add a scene, with ``recordings.FIELDS`` of each object, and write the file as a whole or
        not at all.
        """
        fields = [
            {key: thing[key] for key in recordings.FIELDS if key in thing} for thing in objects
        ]
        scene = layout.model_dump() | {"objects": fields}
        self._lines.append(_compressed(json.dumps(scene, separators=(",", ":")).encode()))
        io.atomically(self.path, partial(Path.write_bytes, data=b"".join(self._lines)))
        self.names.add(layout.name)


def _compressed(line: bytes) -> bytes:
    return gzip.compress(line + b"\n", mtime=0)


def header(settings: Recorder) -> dict[str, Any]:
    """Build and package version of the simulator;
    a local build is named by its file and 16 digits of its SHA-256.
    """
    if program := settings.executable:
        with at(program):
            build = f"{program.name} {hashlib.sha256(program.read_bytes()).hexdigest()[:16]}"
    else:
        build = build_name(settings.platform, settings.build or COMMIT_ID)
    return {"build": build, "package": version("ai2thor")}


def record(settings: Recorder) -> tuple[Recording, list[Layout]]:
    """Record the layouts that a recording lacks, and return those that were missing before. A scene
    that fails is given up with one line; the next one gets a new player.
    """
    recording, controller = Recording(Path(settings.output), header(settings)), None
    missing = [layout for layout in settings.layouts if layout.name not in recording.names]
    try:
        for layout in tqdm(missing, unit="scene", disable=None):
            controller = controller or _started(settings)
            try:
                objects = _observed(controller, layout)
            except Exception as error:
                print(f"record: {layout.name} is given up: {_message(error)}", file=sys.stderr)
                _stopped(controller)
                controller = None
            else:
                recording.append(layout, objects)
    finally:
        _stopped(controller)
    return recording, missing


def _started(settings: Recorder) -> Controller:
    """A player of the build; InputError if it cannot be started."""
    build: dict[str, Any] = {"platform": STR_PLATFORM_MAP.get(settings.platform)}
    if program := settings.executable:  # which may ignore the display
        display = os.environ.get("DISPLAY", ":0")
        command = shlex.quote(str(program.absolute()))
        build = {"local_executable_path": command, "x_display": display}
    elif settings.build:
        build["commit_id"] = settings.build
    try:
        return Controller(width=settings.width, height=settings.width, **build)
    except Exception as error:
        needs = "it needs a graphics device and, except with CloudRendering, a display"
        problem = f"cannot be started: {_message(error)}: {needs}"
        raise InputError(settings.platform, "", problem) from error


def _stopped(controller: Controller | None) -> None:
    """End a player, if there is one."""
    if controller is not None:
        with suppress(Exception):
            controller.stop()


def _observed(controller: Controller, layout: Layout) -> list[Reported]:
    """The objects of a scene as the simulator reports them."""
    event = controller.reset(layout.scene)
    got = str(event.metadata["sceneName"]).removesuffix("_physics")
    if got != layout.scene:
        raise RuntimeError(f"it loaded the scene {got}")
    if layout.spawn is not None:
        event = controller.step(
            "InitialRandomSpawn", randomSeed=layout.spawn, raise_for_failure=True
        )
    objects: list[Reported] = event.metadata["objects"]
    return objects


def _message(error: Exception) -> str:
    """The message of an error in one line."""
    return cut(" ".join(str(error).split()) or type(error).__name__, _LONGEST)


def main() -> None:
    parser = Parser(
        prog="python -m stages.record",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    several = "ithor, robothor, floor plans by name, or ranges such as FloorPlan201-230"
    parser.add_argument("--scenes", nargs="+", metavar="SCENE", help=several)
    parser.add_argument(
        "--platform", help="a build to download, such as CloudRendering, or the path of one"
    )
    parser.add_argument("--output", help="the recording, such as data/recordings/robothor.jsonl.gz")
    arguments = vars(parser.parse_args())
    changed = {key: value for key, value in arguments.items() if value is not None}
    with errors_in_one_line("record", "the same command goes on from here"):
        section = config.read(paths.PARAMS).get("recorder")
        settings = {**section, **changed} if isinstance(section, dict) else section
        recorder = config.check(settings, Recorder, "recorder")
        recording, missing = record(recorder)
        new = sum(layout.name in recording.names for layout in missing)
        print(f"{len(recording.names):,} scenes in {recording.path}, {new:,} of them new")


if __name__ == "__main__":
    main()
