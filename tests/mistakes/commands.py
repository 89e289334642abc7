"""Mistakes in command lines about homes (``isi tell``, ``remove``, ``undo``, ``ask``, ...)."""

from pathlib import Path

import isi
from isi.home.bundle import Bundle
from stages.train_final import FINAL_MODEL
from tests.mistakes.calls import Typed
from tests.small_bundle import home_of, written

HOME = Path("home")
LARGEST = "x" * 300


def anew(bundle: Bundle) -> None:
    """Make a bundle the home."""
    for path in HOME.iterdir():
        path.unlink()
    home_of(HOME, bundle)


def changed() -> None:
    """Tell of a new entity."""
    with isi.open(HOME) as home:
        home.tell([("hob", "atLocation", "kitchen"), ("kettle", "atLocation", "bedroom")])


def of_pipeline() -> None:
    written(FINAL_MODEL.path(experiment="mine"))


def own_files() -> None:
    """Write triples, a home, plain files, and folders of a user."""
    if not HOME.exists():
        home_of(HOME)
    written(Path("files"))
    table = "head,relation,tail\nmug,at,kitchen\ncup,at,kitchen\n"
    Path("triples.csv").write_text(table, encoding="utf-8")
    for folder in ("plain", "soft"):
        Path(folder).mkdir()
    Path("plain/triples.tsv").write_text(table.replace(",", "\t"), encoding="utf-8")
    Path("soft/triples.csv").symlink_to("../triples.csv")


COMMAND_CASES = [
    Typed("a long name", f"tell {'x' * 1001} atLocation bed", "name"),
    Typed("a folder whose name is too long", f"undo --home {LARGEST}", "xxx...xxx"),
]
