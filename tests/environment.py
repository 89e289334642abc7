"""How tests start commands of their own, and wait."""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

#: With this interpreter's ``python`` first on the path.
ENVIRONMENT = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
Value = TypeVar("Value")


def wait_for(value: Callable[[], Value], seconds: float = 30) -> Value:
    """The value once it is true, or what it is when the time is over."""
    deadline = time.monotonic() + seconds
    while not (last := value()) and time.monotonic() < deadline:
        time.sleep(0.05)
    return last
