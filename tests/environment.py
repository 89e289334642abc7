"""How tests start commands of their own."""

from __future__ import annotations

import os
import sys
from pathlib import Path

#: With this interpreter's ``python`` first on the path.
ENVIRONMENT = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
