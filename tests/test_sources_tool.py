"""The tool that runs every source: what it counts, what it draws, and what it passes over."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.procthor import house, thing
from tools import sources

MADE = {"reader": "procthor_houses", "sha256": None, "materials": "suncg"}


@pytest.fixture(scope="module")
def homes(tmp_path_factory: pytest.TempPathFactory) -> sources.Measured:
    """Two houses: three mugs in kitchens, a mug and a sofa in a living room, and a mug in no room."""
    path = tmp_path_factory.mktemp("homes") / "homes.jsonl"
    mugs = [thing(f"Mug|2|{place}", 1, 1) for place in range(2)]
    first = house(*mugs, thing("Sofa|3|0", 8, 1, thing("Mug|surface|3|0", 8, 1)))
    second = house(mugs[0], thing("Mug|2|1", -9, 1))
    path.write_text(f"{json.dumps(first)}\n{json.dumps(second)}\n", encoding="utf-8")
    return sources.run("homes", {**MADE, "path": str(path)}, 0)


def test_a_row_counts_what_a_source_gave(homes: sources.Measured) -> None:
    row = sources.table([homes]).iloc[0]
    assert list(row[["source", "scenes", "rooms", "instances", "relations"]]) == ["homes", "2", "2", "5", "3"]
    assert "2 room" in row["of these"]
    assert row["counted by mining"] == "6 instances; 1 dropped, in no room of their house"
    at = homes.counts.xs("atLocation", level="relation")
    assert at.to_dict() == {
        ("mug", "kitchen"): 3, ("mug", "living room"): 1, ("mug", "sofa"): 1, ("sofa", "living room"): 1,
    }  # fmt: skip
    assert row["observations"] == str(homes.counts.sum())
    assert row["unique triples"] == str(len(homes.counts))


def test_a_picture_shows_how_often_each_object_was_seen_in_each_room(homes: sources.Measured) -> None:
    drawn = sources.picture(homes)
    assert drawn is not None
    axes = drawn.axes[0]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["living room (2)", "kitchen (1)"]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["sofa", "mug"]
    shown = axes.get_images()[0].get_array()
    assert shown is not None
    assert np.ma.filled(shown, 0).tolist() == [[1, 0], [1, 3]]


def test_the_command_writes_a_table_and_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def command(*arguments: str) -> None:
        monkeypatch.setattr(sys, "argv", ["sources", *arguments])
        sources.main()

    command("--houses", "2", "--docs", str(tmp_path), "published", sources.MADE)
    lines = (tmp_path / "benchmarks/sources.md").read_text(encoding="utf-8").splitlines()
    assert [line.split("|")[1].strip() for line in lines[2:]] == ["published", sources.MADE]
    pictures = {path.name: path.stat().st_size for path in (tmp_path / "sources").iterdir()}
    assert set(pictures) == {"published.png", f"{sources.MADE}.png"}
    assert all(1_000 < size < 150_000 for size in pictures.values())
