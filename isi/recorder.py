"""Record scenes of the live simulator (``make record``) for the readers of AI2-THOR and RoboTHOR.

Scenes are appended to a recording one by one. Each line is a separate gzip member: a killed run
loses one at most.
"""

import gzip
import hashlib
import json
import os
import platform
import shlex
import tempfile
import warnings
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from threading import Event
from typing import Any

from ai2thor.build import COMMIT_ID, build_name
from ai2thor.controller import Controller
from ai2thor.exceptions import RestartError, UnityCrashException
from ai2thor.platform import STR_PLATFORM_MAP, Request
from ai2thor.wsgi_server import WsgiServer

from isi.errors import InputError, at, unwritable
from isi.sources import recordings
from isi.sources.readers import parse_json, reading
from isi.sources.recordings import MOST_BYTES, Layout, Recorder
from isi.tables import io, paths

Reported = Mapping[str, Any]  #: An object as the simulator reports it.
_LONGEST = 300  #: Maximum number of characters of a simulator's message.
_CHUNK, _GZIP = 2**20, 16 + zlib.MAX_WBITS
#: Errors that are raised after the player has died.
_DIED = (UnityCrashException, RestartError, BrokenPipeError)
_NEEDS = "it needs a graphics device and, except with CloudRendering, a display"


class Recording:
    """A recording on disk: a header, then the scenes;
    the header is written with the first scene.
    """

    def __init__(self, path: Path, simulator: Mapping[str, Any]) -> None:
        """Read the recorded layouts' names, truncate an incomplete last line;
        InputError if the header differs.
        """
        self.path, self._header = path, recordings.FORMAT | dict(simulator)
        self.names: set[str] = set()  #: names of the recorded layouts
        if not path.exists():
            return
        whole = 0
        lines = ((end, line) for end, content in _members(path) for line in content.splitlines())
        for number, (whole, line) in enumerate(lines, 1):  # noqa: B007
            if number == 1:
                recordings.check_header(path, line, self._header)
            else:
                self.names.add(parse_json(Layout, line, path, f"line {number}").name)
        if not whole:
            raise InputError(path, "", "expected a recording to continue, or no file")
        if whole < path.stat().st_size:
            with _writing(path):
                os.truncate(path, whole)

    def append(self, layout: Layout, objects: Iterable[Reported]) -> None:
        """Append a scene, with ``recordings.FIELDS`` of each object;
        InputError if it cannot be written.
        """
        fields = [
            {key: thing[key] for key in recordings.FIELDS if key in thing} for thing in objects
        ]
        scene = _member(layout.model_dump() | {"objects": fields})
        if not self.path.exists():
            whole = _member(self._header) + scene
            io.atomically(self.path, lambda temporary: temporary.write_bytes(whole))
        else:
            with _writing(self.path), self.path.open("ab") as file:
                file.write(scene)
                file.flush()
                os.fsync(file.fileno())
        self.names.add(layout.name)


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise unwritable(path, error) from error


def _member(record: Mapping[str, Any]) -> bytes:
    return gzip.compress(json.dumps(record, separators=(",", ":")).encode() + b"\n", mtime=0)


def _members(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield (end in the file, content) of each complete gzip member, in bytes;
    InputError above ``MOST_BYTES``.
    """
    unpack, content, end, rest = zlib.decompressobj(_GZIP), b"", 0, b""
    with (
        reading(path, "a recording, compressed by gzip", lambda: f"byte {end:,}"),
        path.open("rb") as file,
    ):
        while chunk := rest or file.read(_CHUNK):
            content += unpack.decompress(chunk, MOST_BYTES + 1 - len(content))
            if len(content) > MOST_BYTES:
                raise InputError(
                    path, f"byte {end:,}", f"expected lines of at most {MOST_BYTES:,} bytes"
                )
            rest = unpack.unused_data
            end += len(chunk) - len(rest)
            if unpack.eof:
                yield end, content
                unpack, content = zlib.decompressobj(_GZIP), b""


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


class Simulator:
    """The simulator: the first call of ``objects`` starts a player, ``close`` ends it."""

    def __init__(self, settings: Recorder) -> None:
        """Check that it can start; InputError if the build does not exist,
        or its display or driver is missing.
        """
        self._settings, self._started = settings, Event()
        self._player: Player | None = None
        program, chosen = settings.executable, STR_PLATFORM_MAP.get(settings.platform)
        request = Request(
            platform.system(),
            settings.width,
            settings.width,
            os.environ.get("DISPLAY"),
            headless=False,
        )
        problem = ""
        if program and (not os.access(program, os.X_OK) or program.is_dir()):
            problem = (
                f"expected one of {', '.join(recordings.PLATFORMS)}, or a program, "
                f"got {str(program)!r}"
            )
        elif not program and (missing := chosen.validate(request)):
            problem = (
                f"{settings.platform}: {' '.join(missing)} "
                f"{chosen.dependency_instructions(request) or ''}"
            )
        if problem:
            raise InputError(paths.PARAMS, "recorder.platform", problem)
        self._folder = tempfile.TemporaryDirectory()

    def close(self) -> None:
        """End the player, and delete the logs of a local build."""
        self._end()
        self._folder.cleanup()

    def objects(self, layout: Layout) -> list[Reported]:
        """Objects of a scene as the simulator reports them;
        InputError if it fails, or dies ``retries`` + 1 times.
        """
        settings = self._settings
        for _ in range(settings.retries + 1):
            try:
                return self._observed(layout)
            except Exception as error:
                self._end()
                causes = _chain(error)
                if not any(isinstance(cause, _DIED) for cause in causes):
                    raise InputError(
                        settings.platform, layout.name, self._problem(causes)
                    ) from error
        times = f"the player died {settings.retries + 1} times (recorder.retries)"
        raise InputError(
            settings.platform, layout.name, times + f": {_NEEDS}" * (not self._started.is_set())
        )

    def _observed(self, layout: Layout) -> list[Reported]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # ``objects`` reports errors in one line
            event = self._player.reset(layout.scene) if self._player else self._start(layout.scene)
            got = str(event.metadata["sceneName"]).removesuffix("_physics")
            if got != layout.scene:
                raise RuntimeError(f"it loaded the scene {got}")
            if layout.spawn is not None and self._player:
                event = self._player.step(
                    "InitialRandomSpawn", randomSeed=layout.spawn, raise_for_failure=True
                )
        objects: list[Reported] = event.metadata["objects"]
        if not isinstance(objects, list) or not all(isinstance(thing, dict) for thing in objects):
            raise RuntimeError("it has no list of objects")
        return objects

    def _start(self, plan: str) -> Any:
        """Start the player in a floor plan, and return the first event."""
        settings, program = self._settings, self._settings.executable
        if program:  # a local build may ignore the display
            command = shlex.quote(str(program.absolute()))
            build = {"local_executable_path": command, "x_display": os.environ.get("DISPLAY", ":0")}
        else:
            build = {"platform": STR_PLATFORM_MAP[settings.platform]}
            build |= {"commit_id": settings.build} if settings.build else {}
        self._player = Player(
            Path(self._folder.name) if program else None,
            self._started,
            scene=plan,
            width=settings.width,
            height=settings.width,
            server_class=WsgiServer,
            server_timeout=settings.seconds,
            server_start_timeout=settings.start_seconds,
            **build,
        )
        return self._player.last_event

    def _end(self) -> None:
        if self._player:
            self._player.end()
        self._player = None

    def _problem(self, causes: Sequence[BaseException]) -> str:
        settings = self._settings
        if any(isinstance(cause, TimeoutError) for cause in causes):
            limit = f"{settings.seconds:g} s (recorder.seconds)"
            return (
                f"no answer within {limit}, or {settings.start_seconds:g} s at the "
                "start (recorder.start_seconds)"
            )
        lines = filter(None, map(str.strip, str(causes[-1]).splitlines()))
        message = next(lines, "an error without a message")[:_LONGEST]
        return (
            f"the simulator answers: {message}"
            if self._started.is_set()
            else f"cannot be started: {message}: {_NEEDS}"
        )


def _chain(error: BaseException) -> list[BaseException]:
    """An error, its cause, the cause of that, and so on."""
    before = error.__cause__ or error.__context__
    return [error] if before is None else [error, *_chain(before)]


class Player(Controller):  # type: ignore[misc]
    """A running player (simulator process). If its start fails, it is killed;
    the controller cannot restart it.
    """

    def __init__(self, local: Path | None, started: Event, **settings: Any) -> None:
        """Start the player; its first message sets ``started``;
        ``local`` is the folder of a local build's logs.
        """
        self._local, self._started = local, started
        self._served: Any = None
        try:
            super().__init__(**settings)
        except BaseException:
            self.end()
            raise

    @property
    def base_dir(self) -> str:
        return str(self._local or super().base_dir)

    def unity_command(self, *settings: Any, **keywords: Any) -> list[str]:
        if self._local:
            self.gpu_device = None
        return list(super().unity_command(*settings, **keywords))

    def start(self, *settings: Any, **keywords: Any) -> Any:
        first = super().start(*settings, **keywords)
        self._started.set()
        return first

    def _build_server(self, host: str, port: int, width: int, height: int) -> None:
        if self._served:  # the controller would restart and stay in the previous scene
            self.server = self._served
            raise UnityCrashException("the player has died")
        super()._build_server(host, port, width, height)
        self._served = self.server

    def end(self) -> None:
        """Kill the player's process and stop its server."""
        process = getattr(self.server, "unity_proc", None)
        if process is not None:
            process.kill()
            process.wait()
        with suppress(Exception):
            self.stop()
