"""The script of the page's explorer."""

import re
from pathlib import Path

from markupsafe import Markup

TEMPLATES = Path(__file__).parent / "templates"

#: The modules of the page in the order of their imports.
MODULES = ("linear_algebra", "model", "data", "random", "similarity", "initializers",
           "ranking", "state", "insertion", "elements", "map_view", "answers_view", "controls",
           "main")  # fmt: skip


def script() -> Markup:
    """The modules of the page in one script, without their imports, exports, comments and
    indents.
    """
    sources = ((TEMPLATES / "explorer" / f"{name}.js").read_text("utf-8") for name in MODULES)
    text = re.sub(r"/\*.*?\*/", "", "".join(sources), flags=re.DOTALL)
    lines = [line.strip().removeprefix("export ") for line in text.splitlines()]
    shown = [line for line in lines if line and not line.startswith("import ")]
    return Markup("\n".join(shown))  # noqa: S704
