"""The script of the page's explorer."""

from pathlib import Path

from markupsafe import Markup

TEMPLATES = Path(__file__).parent / "templates"

#: The modules of the page in the order of their imports.
MODULES = ("linear_algebra", "model", "data", "random", "similarity", "initializers",
           "ranking", "state", "insertion", "elements", "map_view", "answers_view", "controls",
           "main")  # fmt: skip


def script() -> Markup:
    """The modules of the page in one script, without their imports and exports."""
    sources = ((TEMPLATES / "explorer" / f"{name}.js").read_text("utf-8") for name in MODULES)
    lines = [line for source in sources for line in source.splitlines(keepends=True)]
    shown = [line.removeprefix("export ") for line in lines if not line.startswith("import ")]
    return Markup("".join(shown))  # noqa: S704
