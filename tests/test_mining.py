"""Observations of AI2-THOR scenes, mined by hand and from the real recording."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any, get_args

import networkx as nx
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isi.config import read as read_params
from isi.errors import InputError
from isi.graph.graph import MinedSource, build_tables
from isi.sources import CHUNK, settings_of
from isi.sources.ai2thor import ELSEWHERE, IN_CYCLE, ITSELF, MISSING, NOT_THERE, Circular, CleaningRules, mine
from isi.sources.materials import MaterialsOf, read_shares, reported_materials, suncg_materials
from isi.sources.names import entity_name
from isi.sources.recordings import Scene, SceneObject, locate, read_recording
from isi.sources.tables import OBSERVATIONS
from isi.tables import paths
from tests.houses import houses
from tests.observing import Observations, observations_of, source_of

KEYS = ("kitchens", "living_rooms", "bedrooms", "bathrooms")
PROPERTIES = (
    "openable", "pickupable", "toggleable", "canFillWithLiquid", "sliceable", "breakable", "dirtyable", "cookable",
    "moveable", "isHeatSource", "isColdSource", "receptacle", "canBeUsedUp",
)  # fmt: skip


def thing(
    kind: str, number: int = 1, parents: list[str] | None = None, made_of: list[str] | None = None, *properties: str
) -> SceneObject:
    """An object as the simulator reports it."""
    return {
        "objectType": kind,
        "objectId": f"{kind}|{number}",
        "name": f"{kind}_{number}",
        "parentReceptacles": parents,
        "receptacleObjectIds": None,
        "salientMaterials": made_of,
        **{name: name in properties for name in PROPERTIES},
    }


COLUMNS = ["scene", "room", "instance", "head", "relation", "tail", "count"]
#: FloorPlan1: a mug stands on a counter and in a sink at once; the counter stands on the floor.
KITCHEN = [
    thing("Floor", 1, None, ["Wood"], "receptacle", "dirtyable"),
    thing("CounterTop", 1, ["Floor|1"], ["Stone", "Wood"], "receptacle"),
    thing("Sink", 1, None, None, "receptacle"),
    thing("Mug", 1, ["CounterTop|1", "Sink|1"], ["Ceramic"], "pickupable", "canFillWithLiquid", "breakable"),
    thing("Mug", 2, [], [], "pickupable"),
]
#: FloorPlan302.
BEDROOM = [
    thing("Floor", 1),
    thing("TVStand", 1, ["Floor|1"], ["Wood"], "receptacle", "openable"),
    thing("AlarmClock", 1, ["TVStand|1"], ["Metal", "Glass"], "toggleable"),
]
#: (scene, room, instance, head, relation, tail), written out by hand.
EXPECTED = [
    ("FloorPlan1", "kitchen", "CounterTop|1", "counter top", "atLocation", "kitchen"),
    ("FloorPlan1", "kitchen", "CounterTop|1", "counter top", "hasMaterial", "stone"),
    ("FloorPlan1", "kitchen", "CounterTop|1", "counter top", "hasMaterial", "wood"),
    ("FloorPlan1", "kitchen", "Sink|1", "sink", "atLocation", "kitchen"),
    ("FloorPlan1", "kitchen", "Mug|1", "mug", "atLocation", "kitchen"),
    ("FloorPlan1", "kitchen", "Mug|1", "mug", "atLocation", "counter top"),
    ("FloorPlan1", "kitchen", "Mug|1", "mug", "atLocation", "sink"),
    ("FloorPlan1", "kitchen", "Mug|1", "mug", "hasMaterial", "ceramic"),
    ("FloorPlan1", "kitchen", "Mug|1", "mug", "hasAffordance", "pick up"),
    ("FloorPlan1", "kitchen", "Mug|1", "mug", "hasAffordance", "put"),
    ("FloorPlan1", "kitchen", "Mug|1", "mug", "hasAffordance", "fill"),
    ("FloorPlan1", "kitchen", "Mug|1", "mug", "hasAffordance", "empty"),
    ("FloorPlan1", "kitchen", "Mug|1", "mug", "hasAffordance", "break"),
    ("FloorPlan1", "kitchen", "Mug|2", "mug", "atLocation", "kitchen"),
    ("FloorPlan1", "kitchen", "Mug|2", "mug", "hasAffordance", "pick up"),
    ("FloorPlan1", "kitchen", "Mug|2", "mug", "hasAffordance", "put"),
    ("FloorPlan302", "bedroom", "TVStand|1", "tv stand", "atLocation", "bedroom"),
    ("FloorPlan302", "bedroom", "TVStand|1", "tv stand", "hasMaterial", "wood"),
    ("FloorPlan302", "bedroom", "TVStand|1", "tv stand", "hasAffordance", "open"),
    ("FloorPlan302", "bedroom", "TVStand|1", "tv stand", "hasAffordance", "close"),
    ("FloorPlan302", "bedroom", "AlarmClock|1", "alarm clock", "atLocation", "bedroom"),
    ("FloorPlan302", "bedroom", "AlarmClock|1", "alarm clock", "atLocation", "tv stand"),
    ("FloorPlan302", "bedroom", "AlarmClock|1", "alarm clock", "hasMaterial", "metal"),
    ("FloorPlan302", "bedroom", "AlarmClock|1", "alarm clock", "hasMaterial", "glass"),
    ("FloorPlan302", "bedroom", "AlarmClock|1", "alarm clock", "hasAffordance", "turn on"),
    ("FloorPlan302", "bedroom", "AlarmClock|1", "alarm clock", "hasAffordance", "turn off"),
]


def recording() -> dict[str, Any]:
    """Thirty scenes a room, empty but for two, and RoboTHOR's, which are not of the 120."""
    scenes: dict[str, Any] = {key: [[] for _ in range(30)] for key in KEYS}
    scenes["kitchens"][0] = json.loads(json.dumps(KITCHEN))
    scenes["bedrooms"][1] = json.loads(json.dumps(BEDROOM))
    return scenes | {"robothor": [[thing("Dumbbell")]] * 75}


def read(path: Path, content: object) -> list[Scene]:
    """Write a recording and read it."""
    path.write_text(json.dumps(content), encoding="utf-8")
    return list(read_recording(path, None))


def rows(observations: pd.DataFrame) -> list[tuple[str, ...]]:
    return sorted(observations.drop(columns="count").itertuples(index=False, name=None))


def mined(
    scenes: list[Scene], materials_of: MaterialsOf, source: Path, rules: CleaningRules | None = None
) -> pd.DataFrame:
    return pd.DataFrame(mine(scenes, materials_of, source, rules), columns=COLUMNS)


def mine_one(*objects: SceneObject, rules: CleaningRules | None = None) -> pd.DataFrame:
    scene = Scene("FloorPlan1", 1, "kitchen", list(objects))
    return mined([scene], reported_materials, Path("recording.json"), rules)


def tails(observations: pd.DataFrame, relation: str) -> list[str]:
    return sorted(observations.loc[observations["relation"] == relation, "tail"])


def test_two_rooms_give_the_observations_written_out_by_hand(tmp_path: Path) -> None:
    scenes = read(tmp_path / "recording.json", recording())
    observations = mined(scenes, reported_materials, tmp_path)
    assert rows(observations) == sorted(EXPECTED)
    assert (observations["count"] == 1).all()
    OBSERVATIONS.write_file(tmp_path / "table.parquet", observations, "mine")
    assert rows(OBSERVATIONS.read_file(tmp_path / "table.parquet")) == sorted(EXPECTED)


def test_each_property_gives_its_affordances() -> None:
    given = {has: tails(mine_one(thing("Gadget", 1, None, None, has)), "hasAffordance") for has in PROPERTIES}
    assert given == {
        "openable": ["close", "open"], "pickupable": ["pick up", "put"], "toggleable": ["turn off", "turn on"],
        "canFillWithLiquid": ["empty", "fill"], "sliceable": ["slice"], "breakable": ["break"],
        "dirtyable": ["clean", "dirty"], "moveable": ["pull", "push"], "cookable": ["cook"], "isHeatSource": ["heat"],
        "isColdSource": ["cool"], "receptacle": [], "canBeUsedUp": [],
    }  # fmt: skip
    together = tails(mine_one(thing("Gadget", 1, None, None, *PROPERTIES)), "hasAffordance")
    assert len(together) == len(set(together)) == 17


@pytest.mark.parametrize(
    ("kind", "name"),
    [("AlarmClock", "alarm clock"), ("TVStand", "tv stand"), ("CD", "cd"), ("HousePlant", "house plant"),
     ("Mug", "mug"), ("ToiletPaperHanger", "toilet paper hanger")],
)  # fmt: skip
def test_types_become_lower_case_words(kind: str, name: str) -> None:
    assert entity_name(kind) == name


def test_the_floor_is_neither_object_nor_receptacle_while_other_receptacles_of_the_object_stay() -> None:
    rug_on_both = thing("Cloth", 1, ["Floor|1", "Shelf|1"])
    observations = mine_one(thing("Floor", 1, None, ["Wood"], "dirtyable"), thing("Shelf"), rug_on_both)
    assert "floor" not in set(observations["head"]) | set(observations["tail"])
    assert tails(observations[observations["head"] == "cloth"], "atLocation") == ["kitchen", "shelf"]


def test_two_receptacles_of_one_type_are_two_observations() -> None:
    observations = mine_one(thing("Shelf", 1), thing("Shelf", 2), thing("Book", 1, ["Shelf|1", "Shelf|2"]))
    assert tails(observations[observations["head"] == "book"], "atLocation") == ["kitchen", "shelf", "shelf"]


@pytest.mark.parametrize("missing", ["Desk|7", "CounterTop|1"], ids=["nowhere", "in another scene"])
def test_a_parent_that_its_scene_lacks_is_named_or_dropped_and_counted(tmp_path: Path, missing: str) -> None:
    broken, path = recording(), tmp_path / "recording.json"
    broken["bedrooms"][1][2]["parentReceptacles"] = ["TVStand|1", missing, "Desk|8"]
    scenes, rules = read(path, broken), CleaningRules("drop")
    with pytest.raises(InputError, match=rf"recording\.json.*FloorPlan302.*AlarmClock\|1.*{re.escape(missing)}"):
        mined(scenes, reported_materials, path)
    found = mined(scenes, reported_materials, path, rules)
    assert rules.counts == {MISSING: 2}
    assert tails(found[found["head"] == "alarm clock"], "atLocation") == ["bedroom", "tv stand"]


# What a simulator says that cannot be

#: A bowl in the cabinet that it holds, and a crate two further receptacles away from itself.
CIRCLES = [
    thing("Bowl", 1, ["Cabinet|1"]), thing("Cabinet", 1, ["Bowl|1", "Shelf|1"]),
    thing("Crate", 1, ["Shelf|2"]), thing("Shelf", 2, ["Desk|1"]), thing("Desk", 1, ["Crate|1", "Shelf|1"]),
    thing("Shelf", 1), thing("Mug", 1, ["Bowl|1"]),
]  # fmt: skip


def locations(observations: pd.DataFrame) -> list[tuple[str, str]]:
    """What lies in what, rooms left out."""
    inside = observations[(observations["relation"] == "atLocation") & (observations["tail"] != "kitchen")]
    return sorted(inside[["head", "tail"]].itertuples(index=False, name=None))


def test_receptacles_that_lie_in_what_they_hold_stay_unless_they_are_to_be_dropped_and_are_counted() -> None:
    outside = [("cabinet", "shelf"), ("desk", "shelf"), ("mug", "bowl")]
    circle = [("bowl", "cabinet"), ("cabinet", "bowl"), ("crate", "shelf"), ("desk", "crate"),
              ("shelf", "desk")]  # fmt: skip
    assert locations(mine_one(*CIRCLES)) == sorted(circle + outside)
    rules = CleaningRules("error", "drop")
    assert locations(mine_one(*CIRCLES, rules=rules)) == outside
    assert rules.counts == {IN_CYCLE: 5}
    backwards = CleaningRules("error", "drop")
    assert locations(mine_one(*reversed(CIRCLES), rules=backwards)) == outside
    assert backwards.counts == rules.counts


@given(st.lists(st.sets(st.integers(0, 6)), min_size=1, max_size=7))
def test_what_is_dropped_is_what_lies_in_a_circle_of_receptacles(inside: list[set[int]]) -> None:
    edges = [
        (child, parent)
        for child, parents in enumerate(inside)
        for parent in sorted(parents)
        if parent < len(inside) and parent != child
    ]
    part_of = {node: part for part in nx.strongly_connected_components(nx.DiGraph(edges)) for node in part}
    objects = [thing(f"Box{'abcdefg'[child]}", 1) for child in range(len(inside))]
    for child, parent in edges:
        objects[child]["parentReceptacles"] = [
            *(objects[child]["parentReceptacles"] or ()),
            objects[parent]["objectId"],
        ]
    rules = CleaningRules("error", "drop")
    kept = locations(mine_one(*objects, rules=rules))
    outside = [(child, parent) for child, parent in edges if parent not in part_of[child]]
    name = [entity_name(box["objectType"]) for box in objects]
    assert kept == sorted((name[child], name[parent]) for child, parent in outside)
    assert rules.counts[IN_CYCLE] == len(edges) - len(outside)


def test_a_receptacle_that_lies_in_what_it_holds_can_be_refused() -> None:
    with pytest.raises(InputError, match=r"FloorPlan1, object Bowl\|1: its parent receptacle 'Cabinet\|1' lies in it"):
        mine_one(*CIRCLES, rules=CleaningRules("error", "error"))


def test_what_is_its_own_receptacle_is_refused_or_dropped_and_counted() -> None:
    box = thing("Box", 1, ["Box|1", "Shelf|1"])
    for circular in get_args(Circular):
        with pytest.raises(InputError, match=r"FloorPlan1, object Box\|1: it is its own parent receptacle"):
            mine_one(box, thing("Shelf", 1), rules=CleaningRules("error", circular))
        rules = CleaningRules("drop", circular)
        assert locations(mine_one(box, thing("Shelf", 1), rules=rules)) == [("box", "shelf")]
        assert rules.counts == {ITSELF: 1}


def test_contents_that_are_not_there_or_elsewhere_are_refused_or_dropped_and_counted() -> None:
    shelf = {**thing("Shelf"), "receptacleObjectIds": ["Mug|1", "Mug|2", "Mug|3", "Mug|4"]}
    objects = [shelf, thing("Mug", 1, ["Shelf|1"]), thing("Mug", 2, ["Sink|1"]), thing("Mug", 3), thing("Sink")]
    rules = CleaningRules("drop")
    assert locations(mine_one(*objects, rules=rules)) == [("mug", "shelf"), ("mug", "sink")]
    assert rules.counts == {ELSEWHERE: 2, NOT_THERE: 1}
    with pytest.raises(InputError, match=r"FloorPlan1, object Shelf\|1: it holds 'Mug\|2', which lies elsewhere"):
        mine_one(*objects)
    with pytest.raises(InputError, match=r"Shelf\|1: it holds 'Mug\|1', which is not in the scene"):
        mine_one(shelf)


# Materials


@pytest.fixture(scope="module")
def shares() -> pd.DataFrame:
    return read_shares(paths.MATERIAL_SHARES, paths.MATERIAL_CATEGORIES)


def test_simulator_materials_are_the_salient_ones_in_lower_case() -> None:
    objects = [thing("Pot", 1, None, ["Metal", "Glass"]), thing("Pot", 2, None, None), thing("Pot", 3, None, [])]
    assert reported_materials(1, objects) == [["metal", "glass"], [], []]


def test_suncg_materials_of_many_instances_meet_the_published_shares_independently(shares: pd.DataFrame) -> None:
    number = 20_000
    cabinets = suncg_materials(shares, 0)(1, [thing("Cabinet", place) for place in range(number)])
    met = {name: sum(name in drawn for drawn in cabinets) / number for name in shares.columns}
    published = {"wood": 0.914, "stone": 0.454, "metal": 0.366, "tile": 0.103, "glass": 0.004, "leather": 0.003}
    assert met == pytest.approx(published | {"fabric": 0.0}, abs=0.015)
    assert met["fabric"] == 0
    both = sum({"wood", "stone"} <= set(drawn) for drawn in cabinets) / number
    assert both == pytest.approx(0.914 * 0.454, abs=0.015)  # 0.454 if one number decided both


def test_types_that_share_a_category_draw_with_its_shares(shares: pd.DataFrame) -> None:
    drawn = suncg_materials(shares, 0)(1, [thing(kind, place) for place in range(5000) for kind in ("Drawer", "Sofa")])
    for kind, wood, leather in (("Drawer", 0.914, 0.003), ("Sofa", 0.557, 0.268)):
        own = drawn[0 if kind == "Drawer" else 1 :: 2]
        assert sum("wood" in names for names in own) / 5000 == pytest.approx(wood, abs=0.03)
        assert sum("leather" in names for names in own) / 5000 == pytest.approx(leather, abs=0.03)


def test_suncg_materials_are_the_seven_of_the_paper(shares: pd.DataFrame) -> None:
    assert set(shares.columns) == {"wood", "metal", "fabric", "glass", "leather", "stone", "tile"}


def test_objects_without_a_category_get_no_materials(shares: pd.DataFrame) -> None:
    drawn = suncg_materials(shares, 0)(1, [thing("AlarmClock", n) for n in range(200)] + [thing("Bed")])
    assert not any(drawn[:-1])
    assert "fabric" in drawn[-1]  # share 1 of beds


def test_a_scene_draws_the_same_materials_whatever_else_is_mined(shares: pd.DataFrame) -> None:
    scenes = [Scene(f"FloorPlan{n}", n, "kitchen", [thing("Cabinet", i) for i in range(40)]) for n in (1, 2, 3)]

    def drawn(chosen: list[Scene], root: int = 0) -> list[list[tuple[str, ...]]]:
        observed = mined(chosen, suncg_materials(shares, root), Path("recording"))
        return [[row[2:] for row in rows(observed[observed["scene"] == scene.name])] for scene in chosen]

    one, two, three = drawn(scenes)
    assert drawn([scenes[2], scenes[1]]) == [three, two]
    assert one != two
    assert drawn(scenes[:1], root=1) != [one]


def test_a_mapping_to_a_category_without_shares_is_refused_with_its_line(tmp_path: Path) -> None:
    categories = tmp_path / "categories.csv"
    categories.write_text("object,category\nbed,bed\nspaceship,vehicle\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"categories\.csv.*line 3.*'vehicle'"):
        read_shares(paths.MATERIAL_SHARES, categories)


@pytest.mark.parametrize(
    ("text", "place"),
    [("concept,material\nbed,wood\n", "concept, material, share"), ("concept,material,share\nbed,wood,1.5\n", "share"),
     ("concept,material,share\nbed,wood,0.5\nbed,wood,0.7\n", "line 3: 'bed wood' is there twice"),
     ("concept,material,share\nbed,wood,nan\n", "line 2: .*share, got 'nan'"),
     ("concept,material,share\n ,wood,1\n", "line 2: concept: expected a name")],
)  # fmt: skip
def test_a_broken_table_of_shares_is_named(tmp_path: Path, text: str, place: str) -> None:
    path = tmp_path / "shares.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=rf"shares\.csv.*{place}"):
        read_shares(path, paths.MATERIAL_CATEGORIES)


# Many scenes

#: Kitchens, then bedrooms, whose names kitchens lack.
MANY = list(houses([Scene("FloorPlan1", 1, "kitchen", KITCHEN)], 50))
MANY += list(houses([Scene("FloorPlan302", 302, "bedroom", BEDROOM)], 50))
#: The last scene holds an object whose receptacle is missing.
BROKEN = [*MANY, Scene("House7777", 7777, "kitchen", [thing("Mug", 9, ["Shelf|3"])])]


def mine_to(path: Path, scenes: list[Scene], materials_of: MaterialsOf) -> bytes:
    """The bytes of the table of some scenes."""
    source = source_of(mine(scenes, materials_of, Path("recording.json")))
    OBSERVATIONS.write_stream_file(path, source.tables(), "mine")
    return path.read_bytes()


def test_many_scenes_give_the_same_bytes_again(tmp_path: Path, shares: pd.DataFrame) -> None:
    drawn = suncg_materials(shares, 0)
    assert mine_to(tmp_path / "1", MANY, drawn) == mine_to(tmp_path / "2", MANY, drawn)


def test_each_chunk_is_a_row_group_and_together_they_are_what_each_scene_gives_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("isi.sources.CHUNK", 500)
    mine_to(tmp_path / "table.parquet", MANY, reported_materials)
    file = pq.ParquetFile(tmp_path / "table.parquet")
    alone = pd.concat([mined([scene], reported_materials, tmp_path) for scene in MANY], ignore_index=True)
    rows = [file.metadata.row_group(group).num_rows for group in range(file.num_row_groups)]
    assert rows == [500, 500, len(alone) - 1000]
    read = OBSERVATIONS.read_file(tmp_path / "table.parquet")
    assert read.astype(alone.dtypes).equals(alone)


def test_scenes_without_any_observation_are_refused(tmp_path: Path) -> None:
    empty = Scene("FloorPlan1", 1, "kitchen", [])
    with pytest.raises(InputError, match="expected observations, got none"):
        mine_to(tmp_path / "table.parquet", [empty], reported_materials)
    full = Scene("FloorPlan2", 2, "kitchen", KITCHEN)
    assert mine_to(tmp_path / "table.parquet", [empty, full, empty], reported_materials)


def test_a_mistake_in_a_late_scene_is_told_in_one_line_and_the_old_table_stays(
    tmp_path: Path,
) -> None:
    path = tmp_path / "table.parquet"
    path.write_bytes(b"the last good one")
    with pytest.raises(InputError) as refused:
        mine_to(path, BROKEN, reported_materials)
    missing = "its parent receptacle 'Shelf|3' is not in the scene"
    assert str(refused.value) == f"recording.json: House7777, object Mug|9: {missing}"
    assert path.read_bytes() == b"the last good one"
    assert list(tmp_path.iterdir()) == [path]


def test_scenes_are_taken_only_as_they_are_needed() -> None:
    def scenes() -> Iterator[Scene]:
        for number in count(1):
            yield Scene(f"House{number}", number, "kitchen", [thing("Mug")])

    table = next(source_of(mine(scenes(), reported_materials, Path("recording.json"))).tables())
    assert table.num_rows == CHUNK


# The real recording


@pytest.fixture(scope="module")
def real() -> list[Scene]:
    _, settings = settings_of(read_params(paths.PARAMS)["sources"]["ai2thor"], "sources.ai2thor")
    return list(read_recording(locate("recording"), settings["sha256"]))


def test_the_real_recording_gives_the_known_figures(real: list[Scene]) -> None:
    source = source_of(mine(real, reported_materials, Path("recording")))
    observations = pa.concat_tables(source.tables()).to_pandas()
    made = build_tables(MinedSource("ai2thor", observations, source.kinds))
    entities, triples = made.entities, made.triples
    assert (len(observations), len(triples), len(entities)) == (23_729, 1_036, 153)
    assert triples["count"].sum() == 23_729
    assert (entities["kind"] == "room").sum() == 4
    assert (entities["kind"] == "affordance").sum() == 17


def test_every_object_of_the_real_recording_but_the_floors_is_seen_once_in_its_room(real: list[Scene]) -> None:
    observations = mined(real, reported_materials, Path("recording"))
    in_room = observations[observations["tail"] == observations["room"]]
    objects = sum(len(scene.objects) for scene in real)
    assert objects == 5_670
    assert len(in_room) == objects - 120  # one floor a scene
    assert not in_room.duplicated(["scene", "instance"]).any()


def test_the_real_recording_has_receptacles_in_what_they_hold_and_is_tidy_but_for_them(real: list[Scene]) -> None:
    rules = CleaningRules("drop", "drop")
    kept = len(list(mine(real, reported_materials, Path("recording"), rules)))
    assert rules.counts == {IN_CYCLE: 14}
    assert kept == 23_729 - 14


def test_every_mapped_object_is_a_type_of_the_recording(real: list[Scene], shares: pd.DataFrame) -> None:
    robothor = json.loads(locate("recording").read_bytes())["robothor"]
    types = {thing["objectType"] for objects in [*(scene.objects for scene in real), *robothor] for thing in objects}
    assert set(shares.index) <= {entity_name(kind) for kind in types}
    assert shares.index.is_unique


# RoboTHOR

SETTINGS = {"reader": "robothor", "from": "recording", "sha256": None, "materials": "simulator", "broken": "error"}


def observed(**settings: object) -> Observations:
    return observations_of({**SETTINGS, **settings})


def test_the_recorded_apartments_give_the_known_figures() -> None:
    found = observed()
    observations = found.table
    made = build_tables(MinedSource("robothor", observations, found.kinds))
    assert observations["scene"].nunique() == 75
    assert set(observations["room"]) == {"apartment"}
    assert (len(observations), len(made.triples), len(made.entities)) == (15_514, 522, 77)
    assert (made.entities["kind"] == "room").sum() == 1
    assert found.counts == {}


def test_every_object_of_an_apartment_is_seen_in_it_once() -> None:
    observations = observed().table
    in_room = observations[observations["tail"] == "apartment"]
    assert len(in_room) == 3_045
    assert not in_room.duplicated(["scene", "instance"]).any()


def test_receptacles_in_what_they_hold_can_be_dropped() -> None:
    before, after = observed(), observed(broken="drop", circular="drop")
    assert after.counts == {"receptacles dropped that lie in what they hold": 4}
    assert len(after.table) == len(before.table) - 4


@pytest.mark.parametrize(
    ("changes", "place"),
    [
        ({"from": "simulator"}, "data/recordings/robothor.jsonl.gz: "),
        ({"from": "nowhere.json"}, "nowhere.json: "),
        ({"sha256": "0" * 64}, "ai2thor-object-metadata.json: .*sha256"),
        ({"circular": "always"}, r"sources\.mine\.circular"),
    ],
)
def test_settings_that_lead_nowhere_are_named(
    changes: dict[str, Any], place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=place):
        observed(**changes)
