"""Scenes of the live simulator, whose player may die on the way."""

from __future__ import annotations

import hashlib
import os
import platform
import shlex
import tempfile
import warnings
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from ai2thor.build import COMMIT_ID, build_name
from ai2thor.exceptions import RestartError, UnityCrashException
from ai2thor.fifo_server import FifoServer
from ai2thor.platform import STR_PLATFORM_MAP, Request
from ai2thor.wsgi_server import WsgiServer

from isi.errors import InputError
from isi.recording.player import Player
from isi.recording.settings import PLATFORMS, Layout, Recorder
from isi.sources._materials import Object
from isi.tables import paths

_SERVERS = {"wsgi": WsgiServer, "fifo": FifoServer}
#: What is raised where the player has died, by whichever way that was noticed.
_DIED = (UnityCrashException, RestartError, BrokenPipeError)
#: The longest message of the simulator's that is passed on.
_LONGEST = 300
_NEEDS = "it needs a graphics device and, but for CloudRendering, a display"


class Simulator:
    """The simulator, started when it is first asked for a scene; a context that ends it."""

    def __init__(self, how: Recorder) -> None:
        """Check that it can be started.

        Raises:
            InputError: where there is no such build here, or it lacks a display or a graphics driver.
        """
        self._how = how
        self._player: Player | None = None
        self._has_started = False
        _check_platform(how)
        self._folder = tempfile.TemporaryDirectory()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._end()
        self._folder.cleanup()

    def objects(self, what: Layout) -> list[Object]:
        """The objects of a scene, as the simulator reports them; tried again when the player dies.

        Raises:
            InputError: where it cannot be started, dies too often, does not answer in time, or answers an error.
        """
        for _ in range(self._how.retries + 1):
            try:
                return self._observed(what)
            except Exception as error:
                self._end()
                if not _came_of(error, _DIED):
                    raise InputError(self._how.platform, what.name, self._problem(error)) from error
        times = f"the player died {self._how.retries + 1} times (recorder.retries)"
        raise InputError(self._how.platform, what.name, times if self._has_started else f"{times}: {_NEEDS}")

    def _observed(self, what: Layout) -> list[Object]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what the controller warns of is said here in one line
            event = self._in(what.plan)
            got = str(event.metadata["sceneName"]).removesuffix("_physics")
            if got != what.plan:
                raise RuntimeError(f"this is {got}")
            if what.spawn is not None and self._player:
                event = self._player.step("InitialRandomSpawn", randomSeed=what.spawn, raise_for_failure=True)
        objects: list[Object] = event.metadata["objects"]
        if not isinstance(objects, list) or not all(isinstance(thing, dict) for thing in objects):
            raise RuntimeError("it has no list of objects")
        return objects

    def _in(self, plan: str) -> Any:
        """What is seen in a floor plan as it is built."""
        if self._player:
            return self._player.reset(plan)
        how, local = self._how, self._how.executable
        self._player = Player(
            local=Path(self._folder.name) if local else None,
            answered=self._note_start,
            scene=plan,
            width=how.width,
            height=how.width,
            server_class=_SERVERS[how.server],
            server_timeout=how.seconds,
            server_start_timeout=how.start_seconds,
            **_which(how),
        )
        return self._player.last_event

    def _note_start(self) -> None:
        self._has_started = True

    def _end(self) -> None:
        if self._player:
            self._player.end()
        self._player = None

    def _problem(self, error: Exception) -> str:
        if _came_of(error, (TimeoutError,)):
            limit = f"{self._how.seconds:g} s (recorder.seconds)"
            return f"no answer within {limit}, or {self._how.start_seconds:g} s at the start (recorder.start_seconds)"
        first = _chain(error)[-1]
        lines = [line.strip() for line in str(first).splitlines() if line.strip()]
        said = (lines or ["an error without a message"])[0][:_LONGEST]
        return f"the simulator answers: {said}" if self._has_started else f"cannot be started: {said}: {_NEEDS}"


def header(how: Recorder) -> dict[str, Any]:
    """Which simulator a recording is of: a local build by its name and what it hashes to, since names repeat.

    Raises:
        InputError: where a local build cannot be read.
    """
    local = how.executable
    build = f"{local.name} {_digits(local)}" if local else build_name(how.platform, how.build or COMMIT_ID)
    return {"build": build, "package": version("ai2thor")}


def _digits(program: Path) -> str:
    """The first of its sha256."""
    try:
        with program.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()[:16]
    except OSError as error:
        raise InputError(program, "", f"cannot be read ({error.strerror})") from error


def _which(how: Recorder) -> dict[str, Any]:
    """The build, as the controller takes it; a local one may do without the display that it is told of."""
    if how.executable:
        command = shlex.quote(str(how.executable.absolute()))
        return {"local_executable_path": command, "x_display": os.environ.get("DISPLAY", ":0")}
    return {"platform": STR_PLATFORM_MAP[how.platform]} | ({"commit_id": how.build} if how.build else {})


def _check_platform(how: Recorder) -> None:
    key = "recorder.platform"
    if how.executable:
        if not os.access(how.executable, os.X_OK) or how.executable.is_dir():
            known = ", ".join(PLATFORMS)
            raise InputError(paths.PARAMS, key, f"expected one of {known}, or a program, got {how.platform!r}")
        return
    chosen = STR_PLATFORM_MAP[how.platform]
    request = Request(platform.system(), how.width, how.width, os.environ.get("DISPLAY"), headless=False)
    if missing := chosen.validate(request):
        hint = chosen.dependency_instructions(request) or ""
        raise InputError(paths.PARAMS, key, f"{how.platform}: {' '.join(missing)} {hint}")


def _chain(error: BaseException) -> list[BaseException]:
    """An error, and those that it was raised from or in the handling of."""
    found = [error]
    while (before := found[-1].__cause__ or found[-1].__context__) is not None:
        found.append(before)
    return found


def _came_of(error: BaseException, kinds: tuple[type[BaseException], ...]) -> bool:
    return any(isinstance(one, kinds) for one in _chain(error))
