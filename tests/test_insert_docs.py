"""docs/insert.md and docs/insert_reference.md do what they say, as they are written."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.documented import blocks, commands


def ran(code: list[str], names: dict[str, Any] | None = None) -> dict[str, Any]:
    """The names that blocks of code leave, one after the other."""
    names = {} if names is None else names
    for place, block in enumerate(code):
        exec(compile(block, f"block {place}", "exec"), names)  # noqa: S102
    return names


def split(page: str) -> tuple[list[str], list[str]]:
    """Blocks that need PyKEEN, and those that do not."""
    of_pykeen = [block for block in blocks(page, "python") if "pykeen" in block]
    return of_pykeen, [block for block in blocks(page, "python") if block not in of_pykeen]


@pytest.mark.parametrize("page", ["insert.md", "insert_reference.md"])
def test_arrays(page: str, capsys: pytest.CaptureFixture[str]) -> None:
    _, plain = split(page)
    left = ran(plain)
    done = left["done"]
    assert done.entities[:5].tobytes() == left["entities"].tobytes()
    assert capsys.readouterr().out
    if page == "insert_reference.md":
        assert done.report()[0].indicators == ["kettle"]
        assert left["vectors"].shape == (6, 8)
        assert left["joined"]
    else:
        assert done.initializer == "map_mean"


@pytest.mark.parametrize("page", ["insert.md", "insert_reference.md"])
def test_pykeen(page: str) -> None:
    pytest.importorskip("pykeen")
    of_pykeen, _ = split(page)
    left = ran(of_pykeen)
    if page == "insert.md":
        assert left["factory"].num_entities == 132
        assert left["larger"].num_entities == left["more"].num_entities == 135
        before, after = (
            model.entity_representations[0]().detach().numpy() for model in (left["model"], left["larger"])
        )
        np.testing.assert_array_equal(after[:132], before)
    else:
        assert left["factory"].num_entities == left["model"].num_entities == 136


def test_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    kept = pytest.importorskip("tests.small_bundle")
    from isi.__main__ import main

    kept.written(tmp_path / "data" / "final_models" / "ai2thor")
    monkeypatch.chdir(tmp_path)
    shown = [line for line in commands("insert.md") if line.startswith("isi ")]
    assert len(shown) == 5
    for line in shown:
        main(shlex.split(line)[1:])
        assert capsys.readouterr().out
