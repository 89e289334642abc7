"""Processes of ``isi live``, and clients of their sockets."""

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from tests.environment import PATIENCE, wait_for

COMMAND = [sys.executable, "-m", "isi", "live"]


def lines(*requests: Any) -> bytes:
    return b"".join(json.dumps(request).encode() + b"\n" for request in requests)


class Client:
    """A process that is asked by its pipes, or a connection to a socket."""

    def __init__(self, reader: IO[bytes], writer: IO[bytes]) -> None:
        self.reader, self.writer = reader, writer

    def __call__(self, request: Any) -> dict[str, Any]:
        self.writer.write(lines(request))
        self.writer.flush()
        result: dict[str, Any] = json.loads(self.reader.readline())
        return result


@contextmanager
def piped(folder: Path) -> Iterator[tuple[subprocess.Popen[bytes], Client]]:
    """A process that answers its standard input."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([*COMMAND, str(folder)], **pipes) as process:  # type: ignore[call-overload]
        try:
            yield process, Client(process.stdout, process.stdin)
        finally:
            process.kill()


@contextmanager
def socket_of(folder: Path, path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process that serves a socket."""
    with subprocess.Popen(
        [*COMMAND, str(folder), "--socket", str(path)], stderr=subprocess.PIPE
    ) as process:
        try:
            assert wait_for(lambda: path.is_socket() or process.poll() is not None)
            yield process
        finally:
            process.kill()


def connect(path: Path) -> Client:
    connection = socket.socket(socket.AF_UNIX)
    connection.settimeout(PATIENCE)
    assert wait_for(lambda: not connection.connect_ex(str(path)))  # it may not listen yet
    both = connection.makefile("rwb")
    return Client(both, both)  # type: ignore[arg-type]
