"""Helpers that start commands from tests and wait for a condition."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

#: The environment of commands: the folder of this interpreter is first on the path.
ENVIRONMENT = os.environ | {
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
}
#: Seconds after which a test gives up waiting for a process: many, since other work may keep the
#: machine busy.
PATIENCE = 120
Value = TypeVar("Value")
#: Runs a command that may mount file systems, which no other process sees.
OWN_MOUNTS = ["unshare", "--user", "--map-root-user", "--mount"]


def can_mount() -> bool:
    """Whether such a command works here."""
    command = [*OWN_MOUNTS, "mount", "-t", "tmpfs", "tmpfs", "/mnt"]
    try:
        return not subprocess.run(command, capture_output=True).returncode
    except OSError:
        return False


CAN_MOUNT = can_mount()


def wait_for(value: Callable[[], Value], seconds: float = PATIENCE) -> Value:
    """Call ``value`` until it is true or ``seconds`` have passed; returns the last value."""
    deadline = time.monotonic() + seconds
    while not (last := value()) and time.monotonic() < deadline:
        time.sleep(0.05)
    return last
