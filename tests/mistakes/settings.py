"""Mistakes in recordings that the recorder is to continue."""

import gzip
import json
from pathlib import Path

from isi.sources.recordings import FORMAT

#: Of a recording by the player that ``player`` writes.
HEADER = {**FORMAT, "simulator": "ai2thor", "build": "player a8076d3d28d21e02", "package": "5.0.0"}


def player() -> None:
    """Write a player that is never started, whose SHA-256 is known."""
    Path("player").write_bytes(b"#!/bin/sh\n")
    Path("player").chmod(0o755)


def recording(*lines: object) -> bytes:
    """The file of a recording."""
    return b"".join(gzip.compress(f"{json.dumps(line)}\n".encode()) for line in lines)


def of_another_build() -> None:
    player()
    Path("r").write_bytes(recording(HEADER | {"build": "thor-1"}))


def without_a_scene() -> None:
    player()
    Path("r").write_bytes(recording(HEADER, 3))
