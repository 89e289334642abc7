"""RoboTHOR's apartments: those that the package recorded, and those that a recorder gets from a player."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pytest

from isi.errors import InputError
from isi.graph.graph import MinedSource, build_tables
from isi.sources import Observed, observing
from tests import player
from tests.test_recorder import recorded

SETTINGS = {"reader": "robothor", "from": "recording", "sha256": None, "materials": "simulator", "broken": "error"}
DESK = {"objectId": "Desk|1", "objectType": "Desk", "salientMaterials": ["Wood"], "pickupable": False}
CUP = {"objectId": "Cup|1", "objectType": "Cup", "parentReceptacles": ["Desk|1"], "pickupable": True}


def observed(**settings: object) -> tuple[pd.DataFrame, Observed, Counter[str]]:
    """Observations of the source, its entities, and what it dropped."""
    found, parts = observing({**SETTINGS, **settings}, "sources.robothor", 0)
    return pa.concat_tables(parts).to_pandas(), found, found.mining.left


def test_the_recorded_apartments_give_the_known_figures() -> None:
    observations, found, left = observed()
    made = build_tables(MinedSource("robothor", observations, found.kinds))
    assert observations["scene"].nunique() == 75
    assert set(observations["room"]) == {"apartment"}
    assert (len(observations), len(made.triples), len(made.entities)) == (15_514, 522, 77)
    assert (made.entities["kind"] == "room").sum() == 1
    assert left == {}


def test_every_object_of_an_apartment_is_seen_in_it_once() -> None:
    observations, _, _ = observed()
    in_room = observations[observations["tail"] == "apartment"]
    assert len(in_room) == 3_045
    assert not in_room.duplicated(["scene", "instance"]).any()


def test_receptacles_in_what_they_hold_can_be_dropped() -> None:
    before, *_ = observed()
    after, _, left = observed(broken="drop", circular="drop")
    assert left == {"receptacles dropped that lie in what they hold": 4}
    assert len(after) == len(before) - 4


def test_apartments_of_the_simulator_are_found_where_the_recorder_was_told_to_put_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    program = player.install(tmp_path / "player", {"FloorPlan_Val2_1": [DESK, CUP]})
    recorded(program, Path("data/recordings/robothor.jsonl.gz"), scenes=["FloorPlan_Val2_1"])
    rows, _, _ = observed(**{"from": "simulator"})
    assert list(rows[["scene", "instance", "head", "relation", "tail"]].itertuples(index=False, name=None)) == [
        ("FloorPlan_Val2_1", "Desk|1", "desk", "atLocation", "apartment"),
        ("FloorPlan_Val2_1", "Desk|1", "desk", "hasMaterial", "wood"),
        ("FloorPlan_Val2_1", "Cup|1", "cup", "atLocation", "apartment"),
        ("FloorPlan_Val2_1", "Cup|1", "cup", "atLocation", "desk"),
        ("FloorPlan_Val2_1", "Cup|1", "cup", "hasAffordance", "pick up"),
        ("FloorPlan_Val2_1", "Cup|1", "cup", "hasAffordance", "put"),
    ]


def test_floor_plans_of_ithor_are_refused(tmp_path: Path) -> None:
    program = player.install(tmp_path / "player", {"FloorPlan1": [DESK]})
    recorded(program, tmp_path / "r", scenes=["FloorPlan1"])
    with pytest.raises(InputError, match=r"line 2: expected one of .*FloorPlan_Train1_1, got 'FloorPlan1'"):
        observed(**{"from": str(tmp_path / "r")})


@pytest.mark.parametrize(
    ("changes", "place"),
    [
        ({"from": "simulator"}, "data/recordings/robothor.jsonl.gz: "),
        ({"from": "nowhere.json"}, "nowhere.json: "),
        ({"sha256": "0" * 64}, "ai2thor-object-metadata.json: .*sha256"),
        ({"circular": "always"}, r"sources\.robothor\.circular"),
    ],
)
def test_settings_that_lead_nowhere_are_named(
    changes: dict[str, Any], place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=place):
        observed(**changes)
