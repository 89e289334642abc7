"""ProcTHOR's houses: objects in the room whose floor they stand on, and what was recorded of their types."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pytest

from isi.sources import Mining, settings_of
from isi.sources import procthor_houses as procthor
from isi.sources._houses import House, Placed, asset_types
from isi.sources._materials import Object
from isi.sources._recording import Scene
from isi.sources.procthor_houses import CHUNK, ELSEWHERE, INSTANCES, OUTSIDE, TAKEN, UNNAMED, UNRECORDED, numbered
from isi.sources.tables import OBSERVATIONS
from tests.procthor import house, thing
from tests.test_bad_input import leave, mined, refusal, set_params, workspace
from tools import make_houses

__all__ = ["workspace"]

AFFORDANCES = {"mug": ["pick up", "put"], "counter top": [], "pen": ["pick up"], "sofa": ["push"], "painting": []}
ROWS = ["scene", "room", "instance", "head", "relation", "tail", "count"]


def no_materials(_house: int, things: list[Object]) -> list[list[str]]:
    return [[] for _ in things]


def observed(path: Path, *lines: dict[str, Any]) -> tuple[list[tuple[object, ...]], Counter[str]]:
    """Rows of the houses of a file, and what mining counted."""
    path.write_text("\n".join(map(json.dumps, lines)), encoding="utf-8")
    left: Counter[str] = Counter()
    table = pa.concat_tables(procthor.mine(numbered(path, None), AFFORDANCES, no_materials, left))
    assert table.schema.equals(OBSERVATIONS.schema)
    return list(pd.DataFrame(table.to_pydict())[ROWS].itertuples(index=False, name=None)), +left


def test_objects_are_in_the_room_whose_floor_holds_them_and_children_in_their_parents(tmp_path: Path) -> None:
    counter = thing("CounterTop|2|0", 1, 1, thing("Mug|surface|2|0", 1.2, 1, thing("Pen|surface|2|1", 1.2, 1)))
    rows, left = observed(tmp_path / "x.jsonl", house(counter, thing("Sofa|3|0", 5, 3)))
    assert rows == [
        ("House1", "kitchen", "CounterTop|2|0", "counter top", "atLocation", "kitchen", 1),
        ("House1", "kitchen", "Mug|surface|2|0", "mug", "atLocation", "kitchen", 1),
        ("House1", "kitchen", "Mug|surface|2|0", "mug", "atLocation", "counter top", 1),
        ("House1", "kitchen", "Mug|surface|2|0", "mug", "hasAffordance", "pick up", 1),
        ("House1", "kitchen", "Mug|surface|2|0", "mug", "hasAffordance", "put", 1),
        ("House1", "kitchen", "Pen|surface|2|1", "pen", "atLocation", "kitchen", 1),
        ("House1", "kitchen", "Pen|surface|2|1", "pen", "atLocation", "mug", 1),
        ("House1", "kitchen", "Pen|surface|2|1", "pen", "hasAffordance", "pick up", 1),
        ("House1", "living room", "Sofa|3|0", "sofa", "atLocation", "living room", 1),
        ("House1", "living room", "Sofa|3|0", "sofa", "hasAffordance", "push", 1),
    ]
    assert left == {INSTANCES: 4}


@pytest.mark.parametrize(
    ("identifier", "x", "z", "room", "counted"),
    [
        ("Sofa|2|0", 5, 1, "kitchen", None),  # in the corner
        ("Sofa|3|0", 5, 3, "living room", None),  # beside it
        ("Sofa|2|0", 5, 3, "living room", ELSEWHERE),
        ("Sofa|7|0", 5, 3, "living room", UNNAMED),
        ("Sofa", 5, 3, "living room", UNNAMED),
        ("Sofa|3|0", 9.0005, 3, "living room", None),  # corners are rounded to a millimetre
        ("Sofa|3|0", 9.0, 4.0, "living room", None),
        ("Sofa|3|0", 9.0015, 3, None, OUTSIDE),
        ("Sofa|3|0", -20, 3, None, OUTSIDE),
        ("WashingMachine|3|0", 5, 3, "living room", f"{UNRECORDED}washing machine"),
    ],
)
def test_what_is_odd_is_counted_and_what_stands_in_no_room_is_dropped(
    tmp_path: Path, identifier: str, x: float, z: float, room: str | None, counted: str | None
) -> None:
    rows, left = observed(tmp_path / "x.jsonl", house(thing(identifier, x, z)))
    assert [row[5] for row in rows if row[4] == "atLocation"] == [room] * bool(room)
    assert left == {INSTANCES: 1, **({counted: 1} if counted else {})}


def test_of_two_objects_of_the_same_id_the_first_counts_but_other_houses_may_have_it_too(tmp_path: Path) -> None:
    twice = [thing("Painting|2|0", 1, 1), thing("Painting|2|0", 8, 1)]
    rows, left = observed(tmp_path / "x.jsonl", house(*twice), house(*twice[:1]))
    assert [(row[0], row[1]) for row in rows] == [("House1", "kitchen"), ("House2", "kitchen")]
    assert left == {INSTANCES: 3, TAKEN: 1}


def test_an_object_whose_id_names_no_type_is_of_the_type_of_its_asset(tmp_path: Path) -> None:
    assert asset_types()["Mug_1"] == "Mug"
    objects = [thing("2|0", 1, 1, thing("small|2|0", 1, 1, asset="Pen_2"), asset="Mug_1")]
    rows, _ = observed(tmp_path / "x.jsonl", house(*objects, metadata={"schema": "0.0.1"}))
    assert [row[3:6] for row in rows if row[4] == "atLocation"] == [
        ("mug", "atLocation", "kitchen"), ("pen", "atLocation", "kitchen"), ("pen", "atLocation", "mug"),
    ]  # fmt: skip


def test_objects_of_made_houses_are_where_their_ids_say(tmp_path: Path) -> None:
    make_houses.write(tmp_path / "x.jsonl", 20)
    left: Counter[str] = Counter()
    placed = [
        (thing.room, room)
        for _, read, things in numbered(tmp_path / "x.jsonl", None)
        for thing, room in procthor.in_rooms(read, things, left)
    ]
    assert len(placed) == left[INSTANCES] > 500
    assert +left == {INSTANCES: len(placed)}


# What was recorded


def recording() -> procthor.Recorded:
    mugs = [
        {"objectType": "Mug", "pickupable": True, "openable": True, "salientMaterials": ["Ceramic", "Metal"]},
        {"objectType": "Mug", "pickupable": True, "openable": True, "breakable": True, "salientMaterials": ["Glass"]},
        {"objectType": "Mug", "pickupable": True, "breakable": True, "openable": True},
        {"objectType": "Mug", "pickupable": True, "salientMaterials": ["Glass"]},
    ]
    return procthor.recorded([Scene("FloorPlan1", 1, "kitchen", mugs[:2]), Scene("FloorPlan2", 2, "kitchen", mugs[2:])])


def test_a_type_affords_what_more_than_half_of_its_recorded_objects_do() -> None:
    assert recording().affordances == {"mug": ["open", "close", "pick up", "put"]}


def test_materials_are_those_of_a_recorded_object_of_the_type_as_often_as_there_are_such() -> None:
    drawn = procthor.by_recorded(recording().materials, 0)
    things = [{"objectType": "Mug"}] * 4_000
    counts = Counter(map(tuple, drawn(7, [*things, {"objectType": "Cart"}])[:-1]))
    assert set(counts) == {("ceramic", "metal"), ("glass",), ()}
    assert counts["glass",] == pytest.approx(2_000, abs=130)  # four standard deviations
    assert counts[()] == pytest.approx(1_000, abs=110)
    assert drawn(7, things) == drawn(7, things) != drawn(8, things)
    assert drawn(7, [{"objectType": "Cart"}]) == [[]]


@pytest.mark.parametrize("materials", ["suncg", "simulator"])
def test_the_source_mines_a_file_with_what_the_real_recording_says(tmp_path: Path, materials: str) -> None:
    make_houses.write(tmp_path / "x.jsonl.gz", 3)
    given = {"reader": "procthor_houses", "path": str(tmp_path / "x.jsonl.gz"), "sha256": None, "materials": materials}
    found, settings = settings_of(given, "sources.x")
    mining = Mining(0)
    frame = pa.concat_tables(found.observe(mining, **settings)).to_pandas().astype(str)
    assert {"atLocation", "hasMaterial", "hasAffordance"} == set(frame["relation"])
    assert mining.left[INSTANCES] == len(frame[["scene", "instance"]].drop_duplicates())
    assert {INSTANCES, OUTSIDE, TAKEN, UNNAMED, ELSEWHERE} <= set(mining.left)  # told, though there are none
    switches = frame[(frame["head"] == "light switch") & (frame["relation"] == "hasAffordance")]
    assert set(switches["tail"]) == {"turn on", "turn off"}


def test_houses_are_read_only_as_they_are_needed() -> None:
    taken: list[int] = []

    def endless() -> Iterator[tuple[int, House, list[Placed]]]:
        while True:
            taken.append(len(taken))
            yield len(taken), House.model_validate_json(json.dumps(house())), []

    parts = procthor.mine(endless(), {}, no_materials, Counter())
    for part in range(1, 4):
        next(parts)
        assert len(taken) == part * CHUNK


def test_a_late_mistake_is_one_line_of_the_stage_which_writes_nothing(workspace: Path) -> None:
    leave(workspace, *mined("home"))
    line = json.dumps(house()).encode() + b"\n"
    (workspace / "mine.jsonl").write_bytes(line * (CHUNK + 1) + line[:-9])
    set_params(workspace, {"sources": {"home": {
        "reader": "procthor_houses", "path": "mine.jsonl", "sha256": None, "materials": "suncg",
    }}})  # fmt: skip
    told = refusal(workspace, "stages.mine", "home")
    assert f"sources.home: mine.jsonl: line {CHUNK + 2}: expected a house" in told
    assert OBSERVATIONS.path(source="home").name in {path.name for path in (workspace / "data/observations").iterdir()}
