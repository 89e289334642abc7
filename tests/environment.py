"""Helpers that start commands from tests and wait for a condition."""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

#: The environment of commands: the folder of this interpreter is first on the path.
ENVIRONMENT = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
#: Seconds after which a test gives up waiting for a process: many, since other work may keep the machine busy.
PATIENCE = 120
Value = TypeVar("Value")


def wait_for(value: Callable[[], Value], seconds: float = PATIENCE) -> Value:
    """Call ``value`` until it is true or ``seconds`` have passed; returns the last value."""
    deadline = time.monotonic() + seconds
    while not (last := value()) and time.monotonic() < deadline:
        time.sleep(0.05)
    return last
