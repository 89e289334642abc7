"""The simulator's own controller, which says in time when its player has died or does not answer."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic
from types import FrameType
from typing import Any

from ai2thor.controller import Controller
from ai2thor.exceptions import UnityCrashException
from ai2thor.fifo_server import FifoServer

#: Seconds between looks at whether the player lives.
LOOK = 0.2


class Player(Controller):  # type: ignore[misc]
    """A started player. One that cannot be started is ended, and none is started again unasked."""

    def __init__(self, local: Path | None, answered: Callable[[], None], **settings: Any) -> None:
        """Start it.

        Args:
            local: folder for logs of a local build, which gets nothing into the home directory and no graphics device
                chosen for it; null for a downloaded build.
            answered: called when it has said its first.
            settings: of the controller.
        """
        self._local, self._answered = local, answered
        self._served: Any = None
        try:
            super().__init__(**settings)
        except BaseException:
            self.end()
            raise

    @property
    def base_dir(self) -> str:
        return str(self._local or super().base_dir)

    def unity_command(self, *settings: Any, **named: Any) -> list[str]:
        if self._local:
            self.gpu_device = None
        return list(super().unity_command(*settings, **named))

    def start(self, *settings: Any, **named: Any) -> Any:
        if self._served:  # the controller would go on in the scene that was before
            self.server = self._served
            raise UnityCrashException("the player has died")
        try:
            first = super().start(*settings, **named)
        finally:
            self._served = self.server
        self._answered()
        return first

    def _build_server(self, host: str, port: int, width: int, height: int) -> None:
        if self.server is None and self.server_class is FifoServer and "FIFO" in self._build.server_types:
            self.server = Fifo(width, height, self.server_timeout)
        super()._build_server(host, port, width, height)

    def end(self) -> None:
        """End its process and what serves it."""
        process = getattr(self.server, "unity_proc", None)
        if process is not None:
            process.kill()
            process.wait()
        with suppress(Exception):
            self.stop()


class Fifo(FifoServer):  # type: ignore[misc]
    """Named pipes, which by themselves wait for ever for a player that is gone before it has opened them.

    To be used in the main thread: signals look after it.
    """

    def receive(self, timeout: float | None = None) -> Any:
        with self._watched(timeout or self.timeout):
            return super().receive(timeout)

    def send(self, action: dict[str, Any]) -> None:
        with self._watched(self.timeout):
            super().send(action)

    @contextmanager
    def _watched(self, seconds: float) -> Iterator[None]:
        latest = monotonic() + seconds

        def look(_signal: int, _frame: FrameType | None) -> None:
            if self.unity_proc is not None and self.unity_proc.poll() is not None:
                raise UnityCrashException(f"the player has ended with status {self.unity_proc.returncode}")
            if monotonic() > latest:
                raise TimeoutError

        before = signal.signal(signal.SIGALRM, look)
        signal.setitimer(signal.ITIMER_REAL, LOOK, LOOK)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
