"""What a command does not import: each of these modules would make it slower by up to a second."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.small_bundle import home_of

SLOW = {"torch", "safetensors.torch", "pandas", "scipy", "networkx", "numba", "pyarrow", "jinja2"}


def loaded(code: str) -> set[str]:
    """The modules that Python has loaded when it has run ``code``; what the code prints is none."""
    shown = "; import sys; print(); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code + shown], capture_output=True, text=True, check=True
    )
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("isi.cli", {*SLOW, "numpy"}),
        ("isi.home.database", SLOW),
        ("isi.home.home", SLOW),
        ("isi.cli.train", SLOW),
        ("isi.home.groups", SLOW - {"torch"}),
        ("isi.home.explain", SLOW - {"torch"}),
        (
            "isi.home.phrases as phrases; phrases.shipped().vector('mug')",
            {"gensim", "sentence_transformers", "transformers"},
        ),
    ],
)
def test_a_module_imports_nothing_slow_that_it_does_not_need(module: str, absent: set[str]) -> None:
    assert absent.isdisjoint(loaded(f"import {module}"))


@pytest.fixture(scope="module")
def small_home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The home of the small bundle, with an inserted entity."""
    home = home_of(tmp_path_factory.mktemp("small") / "home")
    command("tell", "stove", "atLocation", "kitchen", "--initializer", "mean", home=home)
    return home


def command(*line: str, home: Path) -> set[str]:
    """The modules that a command about a home loads."""
    tokens = [*line, "--home", str(home)]
    return loaded(f"from isi.cli import main; main({tokens!r})")


@pytest.mark.parametrize(
    "line",
    [
        ("ask", "kettle", "atLocation"),
        ("ask", "stove", "hasAffordance"),
        ("ask", "kettle", "--tail", "kitchen", "--new", "--json"),
        ("history",),
        ("stale", "30d"),
        ("facts",),
        ("nearest", "kettle"),
        ("tell", "kettle", "atLocation", "bedroom", "--dry-run"),
        ("undo", "--dry-run"),
    ],
)
def test_what_computes_no_vector_needs_numpy_and_sqlite_alone(
    line: tuple[str, ...], small_home: Path
) -> None:
    assert SLOW.isdisjoint(command(*line, home=small_home))


def test_a_new_entity_needs_pytorch(small_home: Path) -> None:
    new = ("tell", "oven", "atLocation", "kitchen", "--dry-run", "--initializer", "mean")
    assert "torch" in command(*new, home=small_home)


def test_a_description_of_files_needs_no_pytorch(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("mug,at,kitchen\n", encoding="utf-8")
    line = ["train", "--describe", str(tmp_path / "log.csv")]
    assert "torch" not in loaded(f"from isi.cli import main; main({line!r})")
