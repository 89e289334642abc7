"""Observations of AI2-THOR's and RoboTHOR's scenes:
materials, and the real recordings (`read_files.yaml` has scenes written by hand).
"""

import json
from collections import Counter
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from isi.config import read as read_params
from isi.graph.graph import MinedSource, build_tables
from isi.sources import ai2thor, settings_of
from isi.sources.recordings import (
    ROBOTHOR,
    Scene,
    SceneObject,
    locate,
    read_recording,
    scene_objects,
)
from isi.tables import paths
from tests.observing import observations_of, observe, source_of, written


def thing(kind: str, number: int = 1) -> SceneObject:
    """An object in the simulator's format."""
    reported = {"objectType": kind, "objectId": f"{kind}|{number}"}
    return scene_objects(Path("recording.json"), "a scene", [reported])[0]


COLUMNS = ["scene", "room", "instance", "head", "relation", "tail", "count"]


def rows(observations: pd.DataFrame) -> list[tuple[str, ...]]:
    return sorted(observations.drop(columns="count").itertuples(index=False, name=None))


def mined(
    scenes: list[Scene],
    materials_of: ai2thor.MaterialsOf = ai2thor.reported_materials,
    **cleaning: Any,
) -> tuple[pd.DataFrame, Counter[str]]:
    """Observations of scenes, and the counts of dropped ones."""
    counts: Counter[str] = Counter()
    observations = ai2thor.mine(scenes, materials_of, Path("recording.json"), counts, **cleaning)
    return pd.DataFrame(observations, columns=COLUMNS), counts


# Materials


@pytest.fixture(scope="module")
def shares() -> pd.DataFrame:
    return ai2thor.read_shares(paths.MATERIAL_SHARES, paths.MATERIAL_CATEGORIES)


def test_suncg_materials_of_many_instances_meet_the_published_shares_independently(
    shares: pd.DataFrame,
) -> None:
    number = 20_000
    cabinets = ai2thor.suncg_materials(shares, 0)(
        1, [thing("Cabinet", place) for place in range(number)]
    )
    met = {name: sum(name in drawn for drawn in cabinets) / number for name in shares.columns}
    published = {
        "wood": 0.914,
        "stone": 0.454,
        "metal": 0.366,
        "tile": 0.103,
        "glass": 0.004,
        "leather": 0.003,
    }
    assert met == pytest.approx(published | {"fabric": 0.0}, abs=0.015)
    assert met["fabric"] == 0
    both = sum({"wood", "stone"} <= set(drawn) for drawn in cabinets) / number
    assert both == pytest.approx(0.914 * 0.454, abs=0.015)  # 0.454 if one number decided both


def test_objects_without_a_category_get_no_materials(shares: pd.DataFrame) -> None:
    drawn = ai2thor.suncg_materials(shares, 0)(
        1, [thing("AlarmClock", n) for n in range(200)] + [thing("Bed")]
    )
    assert not any(drawn[:-1])
    assert "fabric" in drawn[-1]  # share 1 of beds


def test_a_scene_draws_the_same_materials_whatever_else_is_mined(shares: pd.DataFrame) -> None:
    scenes = [
        Scene(f"FloorPlan{n}", n, "kitchen", [thing("Cabinet", i) for i in range(40)])
        for n in (1, 2, 3)
    ]

    def drawn(chosen: list[Scene], root: int = 0) -> list[list[tuple[str, ...]]]:
        observed, _ = mined(chosen, ai2thor.suncg_materials(shares, root))
        return [
            [row[2:] for row in rows(observed[observed["scene"] == scene.name])] for scene in chosen
        ]

    first, second, third = drawn(scenes)
    assert drawn([scenes[2], scenes[1]]) == [third, second]
    assert first != second
    assert drawn(scenes[:1], root=1) != [first]


def test_scenes_are_taken_only_as_they_are_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("isi.sources.CHUNK", 500)

    def scenes() -> Iterator[Scene]:
        for number in count(1):
            yield Scene(f"House{number}", number, "kitchen", [thing("Mug")])

    observations = ai2thor.mine(
        scenes(), ai2thor.reported_materials, Path("recording.json"), Counter()
    )
    assert len(next(source_of(observations).frames())) == 500


# The real recording


@pytest.fixture(scope="module")
def real() -> list[Scene]:
    _, settings = settings_of(read_params(paths.PARAMS)["sources"]["ai2thor"], "sources.ai2thor")
    return list(read_recording(locate("recording"), settings["sha256"]))


def test_the_real_recording_gives_the_known_figures(real: list[Scene]) -> None:
    source = source_of(ai2thor.mine(real, ai2thor.reported_materials, Path("recording"), Counter()))
    observations = pd.concat(source.frames())
    made = build_tables(MinedSource("ai2thor", observations, source.kinds))
    entities, triples = made.entities, made.triples
    assert (len(observations), len(triples), len(entities)) == (23_729, 1_036, 153)
    assert triples["count"].sum() == 23_729
    assert (entities["kind"] == "room").sum() == 4
    assert (entities["kind"] == "affordance").sum() == 17
    in_room = observations[observations["tail"] == observations["room"].astype(str)]
    objects = sum(len(scene.objects) for scene in real)
    assert objects == 5_670
    assert len(in_room) == objects - 120  # one floor a scene
    assert not in_room.duplicated(["scene", "instance"]).any()
    observations, counts = mined(real, broken="drop", circular="drop")
    assert (counts, len(observations)) == ({ai2thor.IN_CYCLE: 14}, 23_729 - 14)


def test_every_mapped_object_is_a_type_of_the_recording(
    real: list[Scene], shares: pd.DataFrame
) -> None:
    scenes = [*real, *read_recording(locate("recording"), None, ROBOTHOR)]
    assert set(shares.index) <= {thing.name for scene in scenes for thing in scene.objects}
    assert shares.index.is_unique


def test_the_recorded_apartments_of_robothor_give_the_known_figures() -> None:
    section = {
        "reader": "robothor",
        "from": "recording",
        "sha256": None,
        "materials": "simulator",
        "broken": "error",
    }
    observed = observations_of(section)
    made = build_tables(MinedSource("robothor", observed.table, observed.kinds))
    assert observed.table["scene"].nunique() == 75
    assert set(observed.table["room"]) == {"apartment"}
    assert (len(observed.table), len(made.triples), len(made.entities)) == (15_514, 522, 77)
    assert observed.counts == {}
    in_room = observed.table[observed.table["tail"] == "apartment"]
    assert len(in_room) == 3_045
    assert not in_room.duplicated(["scene", "instance"]).any()
    cleaned = observations_of({**section, "circular": "drop"})
    assert cleaned.counts == {ai2thor.IN_CYCLE: 4}
    assert len(cleaned.table) == 15_514 - 4


def test_a_recorded_scene_gives_what_the_whole_recording_gives_of_it(
    tmp_path: Path, real: list[Scene]
) -> None:
    recording = json.loads(locate("recording").read_bytes())
    content = {"scene": "FloorPlan407", "objects": recording["bathrooms"][6]}
    alone = observe("ai2thor_scene", written(tmp_path / "bath.json", json.dumps(content)))
    expected, _ = mined([scene for scene in real if scene.name == "FloorPlan407"])
    assert alone.rows(*COLUMNS) == list(expected.itertuples(index=False, name=None))
    assert len(alone.table) > 100
