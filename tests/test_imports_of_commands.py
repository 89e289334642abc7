"""What a command does not import: each of these modules would make it slower by up to a second."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("isi.cli", {"torch", "pandas", "numpy"}),
        ("isi.home.database", {"torch", "pandas"}),
        ("isi.cli.train", {"torch", "pandas"}),
        ("isi.home.explain", {"pandas", "networkx", "jinja2"}),
        (
            "isi.home.phrases as phrases; phrases.shipped().vector('mug')",
            {"gensim", "sentence_transformers", "transformers"},
        ),
    ],
)
def test_a_command_imports_nothing_slow_that_it_does_not_need(
    module: str, absent: set[str]
) -> None:
    """``isi.home.explain`` has all that tell, ask, remove and undo need."""
    code = f"import sys, {module}; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert absent.isdisjoint(loaded)
