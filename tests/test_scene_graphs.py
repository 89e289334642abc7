"""Scene graphs of Spark-DSG, rooms that robots log, and events of AI2-THOR:
observations, and second readers.
"""

import gzip
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isi.errors import InputError
from isi.graph.files import guess, read_graph
from isi.sources.ai2thor import ABSENT, EMPTY, ROOMLESS
from isi.sources.recordings import AFFORDANCES
from isi.sources.spark_dsg import UNLABELLED
from tests.observing import TRIPLE, observe, refused, written
from tools.fuzz.formats import HOME

#: Written by spark-dsg 1.1.3: two rooms, kitchen and one of unknown class; labels of objects 5
#: (arm_chair) and 6 (Mug).
GRAPH = Path(__file__).parent / "scene_graph.json"
MUG = {"objectId": "Mug|1", "objectType": "Mug", "sliceable": True, "salientMaterials": ["Ceramic"]}
BED = {"objectId": "Bed|1", "objectType": "Bed"}
AT_HOME = Counter(
    {
        ("mug", "atLocation", "living room"): 1,
        ("wall shelf", "atLocation", "living room"): 1,
        ("mug", "atLocation", "bedroom"): 1,
        ("mug", "atLocation", "wall shelf"): 1,
        ("mug", "hasMaterial", "ceramic"): 1,
        ("mug", "hasAffordance", "fill"): 1,
        ("mug", "hasAffordance", "put"): 1,
    }
)


def triples(reader: str, path: Path, **settings: object) -> Counter[tuple[object, ...]]:
    """The number of observations of each triple."""
    return Counter(observe(reader, path, **settings).rows(*TRIPLE))


# Scene graphs of Spark-DSG


def test_an_object_is_in_the_labelled_room_and_places_above_it() -> None:
    assert guess(GRAPH) == "spark_dsg"
    assert triples("spark_dsg", GRAPH) == {
        ("arm chair", "atLocation", "kitchen"): 1,
        ("arm chair", "atLocation", "rug"): 1,
    }
    observed = observe("spark_dsg", GRAPH, rooms={"R(1)": "bedroom"}, labels={9: "lamp"})
    assert Counter(observed.rows("room", *TRIPLE)) == {
        ("kitchen", "arm chair", "atLocation", "kitchen"): 1,
        ("kitchen", "arm chair", "atLocation", "rug"): 1,
        ("bedroom", "arm chair", "atLocation", "bedroom"): 1,
        ("bedroom", "mug", "atLocation", "bedroom"): 1,
        ("bedroom", "lamp", "atLocation", "bedroom"): 1,
    }
    assert observed.kind_of()["rug"] == "object"
    assert observe("spark_dsg", GRAPH, room="hall").counts[UNLABELLED] == 1


def test_old_files_have_neither_names_of_layers_nor_labels(tmp_path: Path) -> None:
    graph = json.loads(GRAPH.read_text(encoding="utf-8"))
    old = {
        "directed": False,
        "layer_ids": [2, 3, 4, 5],
        "nodes": graph["nodes"],
        "edges": graph["edges"],
    }
    for node in old["nodes"]:
        node.pop("partition")
    path = written(tmp_path / "old.json", json.dumps(old))
    labels = {5: "arm chair", 6: "mug"}
    assert triples("spark_dsg", path, labels=labels, room="house") == {
        ("arm chair", "atLocation", "house"): 2,
        ("mug", "atLocation", "house"): 1,
    }


@pytest.mark.parametrize("seed", range(5))
def test_spark_dsg_finds_the_same_rooms(tmp_path: Path, seed: int) -> None:
    dsg = pytest.importorskip("spark_dsg")
    draw, graph = np.random.default_rng(seed), dsg.DynamicSceneGraph()
    rooms, things = (
        {1: "kitchen", 2: "bed_room", 3: "bath"},
        {4: "cup", 5: "night stand", 6: "TVSet"},
    )

    def add(
        layer: str,
        letter: str,
        number: int,
        kind: Any,
        label: int,
        parent: str = "",
        parents: int = 0,
    ) -> None:
        attributes = kind()
        attributes.name, attributes.semantic_label = f"{letter}({number})", label
        graph.add_node(layer, dsg.NodeSymbol(letter, number), attributes)
        if parent:
            graph.insert_edge(
                dsg.NodeSymbol(parent, int(draw.integers(parents))), dsg.NodeSymbol(letter, number)
            )

    for number in range(4):
        add(dsg.DsgLayers.ROOMS, "R", number, dsg.RoomNodeAttributes, int(draw.integers(1, 5)))
    for number in range(12):
        add(dsg.DsgLayers.PLACES, "p", number, dsg.PlaceNodeAttributes, 0, "R", 4)
    for number in range(40):
        add(
            dsg.DsgLayers.OBJECTS,
            "O",
            number,
            dsg.ObjectNodeAttributes,
            int(draw.integers(4, 8)),
            "p",
            12,
        )
    graph.set_labelspace(dsg.Labelspace(rooms), *((4, 0) if seed % 2 else ("ROOMS",)))
    graph.set_labelspace(dsg.Labelspace(things), *((2, 0) if seed % 2 else ("OBJECTS",)))
    graph.save(str(tmp_path / "made.json"), False)

    loaded, expected = (
        dsg.DynamicSceneGraph.load(str(tmp_path / "made.json")),
        Counter[tuple[object, ...]](),
    )
    words = {"bed_room": "bed room", "TVSet": "tv set"}
    for node in loaded.get_layer(dsg.DsgLayers.OBJECTS).nodes:
        room = loaded.get_node(loaded.get_node(node.get_parent()).get_parent())
        head, tail = (
            things.get(node.attributes.semantic_label),
            rooms.get(room.attributes.semantic_label),
        )
        if head and tail:
            expected[words.get(head, head), "atLocation", words.get(tail, tail)] += 1
    assert triples("spark_dsg", tmp_path / "made.json") == expected


# Rooms that robots log


def test_the_rooms_of_a_home_hold_names_or_mappings(tmp_path: Path) -> None:
    path = written(tmp_path / "home.json", json.dumps(HOME, indent=1))
    assert guess(path) == "rooms"
    assert triples("rooms", path) == AT_HOME
    kinds = {
        "mug": "object",
        "living room": "room",
        "wall shelf": "object",
        "ceramic": "material",
        "put": "affordance",
    }
    assert observe("rooms", path).kind_of().items() >= kinds.items()


def test_what_several_states_of_a_home_have_counts_once(tmp_path: Path) -> None:
    later = {"rooms": [{"name": "Living_Room", "objects": ["mug", "mug"]}]}
    path = written(tmp_path / "home.jsonl", "\n".join(map(json.dumps, [HOME, later, HOME])))
    assert guess(path) == "rooms"
    assert triples("rooms", path) == AT_HOME + Counter({("mug", "atLocation", "living room"): 1})


# Events of AI2-THOR


def test_events_are_read_from_lists_and_from_lines(tmp_path: Path) -> None:
    scenes = [
        ("FloorPlan1", [MUG]),
        ("FloorPlan301_physics", [MUG, BED]),
        ("FloorPlan1", [MUG, BED]),
    ]
    events = [
        {"metadata": {"sceneName": name, "objects": objects}, "agentId": 0}
        for name, objects in scenes
    ]
    text = "\n".join(map(json.dumps, events))
    files = [
        written(tmp_path / "list.json", json.dumps(events, indent=2)),
        written(tmp_path / "lines.jsonl", text),
        written(tmp_path / "lines.json", text + "\n\n"),
        written(tmp_path / "a.json.gz", gzip.compress(text.encode())),
        written(tmp_path / "metadata.json", json.dumps([event["metadata"] for event in events])),
    ]
    for path in files:
        assert guess(path) == "ai2thor_scene"
        assert triples("ai2thor_scene", path) == {
            ("mug", "atLocation", "kitchen"): 1,
            ("mug", "atLocation", "bedroom"): 1,
            ("bed", "atLocation", "kitchen"): 1,
            ("bed", "atLocation", "bedroom"): 1,
            ("mug", "hasMaterial", "ceramic"): 2,
            ("mug", "hasAffordance", "slice"): 2,
        }


def test_each_file_may_have_a_room_of_its_own(tmp_path: Path) -> None:
    mug, bed = (
        written(tmp_path / f"{thing['objectType']}.json", json.dumps([thing]))
        for thing in (MUG, BED)
    )
    graph, read = read_graph([f"kitchen={mug}", f"bedroom={bed}"])
    assert list(read) == [f"kitchen={mug}", f"bedroom={bed}"]
    assert {of_file["reader"] for of_file in read.values()} == {"ai2thor_scene"}
    located = graph.triples[graph.triples["relation"] == "atLocation"]
    assert list(zip(located["head"], located["tail"], strict=True)) == [
        ("bed", "bedroom"),
        ("mug", "kitchen"),
    ]
    assert read_graph([mug])[1][str(mug)][ROOMLESS] == 1
    equals = written(tmp_path / "a=b.json", json.dumps([MUG]))
    assert list(read_graph([equals])[1]) == [str(equals)]


# Keys of old versions, and scenes with gaps


def test_keys_of_old_versions_are_those_of_today(tmp_path: Path) -> None:
    egg = {"objectId": "Egg|1", "objectType": "Egg", "cookable": True}
    old = [
        egg | {"canChangeTempToHot": True},
        {"objectId": "Fridge|1", "objectType": "Fridge", "canChangeTempToCold": True},
    ]
    new = json.loads(
        json.dumps(old)
        .replace("canChangeTempToHot", "isHeatSource")
        .replace("canChangeTempToCold", "isColdSource")
    )
    given = [
        triples("ai2thor_scene", written(tmp_path / "a.json", json.dumps(scene)))
        for scene in (old, new)
    ]
    assert given[0] == given[1]
    assert given[0].keys() >= {
        ("egg", "hasAffordance", "heat"),
        ("fridge", "hasAffordance", "cool"),
    }


def test_properties_that_no_object_reports_are_named(tmp_path: Path) -> None:
    counts = observe("ai2thor_scene", written(tmp_path / "a.json", json.dumps([MUG]))).counts
    (what,) = (what for what in counts if what.startswith(ABSENT))
    assert counts[what] == len(AFFORDANCES) - 1
    assert "openable" in what
    assert "sliceable" not in what
    every = MUG | dict.fromkeys(AFFORDANCES, False)
    counts = observe("ai2thor_scene", written(tmp_path / "b.json", json.dumps([every]))).counts
    assert not any(what.startswith(ABSENT) for what in counts)


def test_events_without_objects_are_counted_unless_there_are_no_others(tmp_path: Path) -> None:
    lines = [
        {"metadata": {"objects": [MUG]}},
        {"metadata": {}},
        {"metadata": {"objects": []}},
        {"objects": None},
    ]
    path = written(tmp_path / "a.jsonl", "\n".join(map(json.dumps, lines)))
    observed = observe("ai2thor_scene", path, room="hall")
    assert observed.counts[EMPTY] == 3
    assert ("mug", "atLocation", "hall") in observed.rows(*TRIPLE)
    refused(
        "ai2thor_scene",
        written(tmp_path / "b.jsonl", "\n".join(map(json.dumps, lines[1:]))),
        ["b.jsonl"],
    )


@pytest.mark.parametrize(
    ("scene", "setting"),
    [
        (
            [{"objectId": "Table|1", "objectType": "Table", "receptacleObjectIds": ["Apple|1"]}],
            "broken",
        ),
        ([MUG | {"parentReceptacles": ["Bed|1"]}], "broken"),
        (
            [MUG | {"parentReceptacles": ["Bed|1"]}, BED | {"parentReceptacles": ["Mug|1"]}],
            "circular",
        ),
    ],
)
def test_impossible_containment_is_refused_with_the_setting_that_drops_it(
    tmp_path: Path, scene: list[object], setting: str
) -> None:
    path = written(tmp_path / "a.json", json.dumps(scene))
    settings = {"circular": "error"} if setting == "circular" else {}
    refused("ai2thor_scene", path, [f"--set {setting}=drop"], **settings)
    assert observe("ai2thor_scene", path, room="hall", **{setting: "drop"}).counts


# Labels that are given


def scene_graph(tmp_path: Path, label: str) -> Path:
    """The graph of the tests with this label for the class of room 0 in its labelspace."""
    text = GRAPH.read_text(encoding="utf-8")
    assert '"kitchen"' in text
    return written(
        tmp_path / "dsg.json",
        text.replace('"kitchen"', json.dumps(label)).replace('"arm_chair"', '"B2"'),
    )


@pytest.mark.parametrize("label", ["A101", "C7", "r(3)"])
def test_labels_of_a_labelspace_or_a_setting_may_look_like_names_of_nodes(
    tmp_path: Path, label: str
) -> None:
    assert (
        triples("spark_dsg", scene_graph(tmp_path, label))["b2", "atLocation", label.lower()] == 1
    )
    of_setting = triples("spark_dsg", GRAPH, rooms={"R(1)": label}, labels={6: "C3"})
    assert of_setting["c3", "atLocation", label.lower()] == 1


@pytest.mark.parametrize(
    ("settings", "named"),
    [({"rooms": {"R(9)": "office"}}, "R(9)"), ({"labels": {77: "chair", 78: "bed"}}, "77")],
)
def test_settings_that_name_what_the_file_lacks_are_refused(
    settings: dict[str, object], named: str
) -> None:
    refused("spark_dsg", GRAPH, [next(iter(settings)), named], room="hall", **settings)


def test_names_of_rooms_and_objects_stay_unless_words_are_joined(tmp_path: Path) -> None:
    names = ["NA", "True", "Mug", "CoffeeTable", "side_table", "TVStand", "iPhone"]
    home = {"rooms": [{"name": "Hall", "objects": names}]}
    observed = observe("rooms", written(tmp_path / "a.json", json.dumps(home)))
    expected = {"NA", "True", "Mug", "coffee table", "side table", "tv stand", "i phone", "Hall"}
    assert set(observed.kinds["entity"]) == expected
    assert observed.phrase_of()["Mug"] == "mug"


# Guesses


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ({"directed": True, "nodes": [{"id": "mug"}], "links": []}, ["--reader", "nodes"]),
        (
            {"nodes": [{"id": 1, "class_name": 3}], "edges": []},
            ["nodes.0.class_name", "virtualhome_graph", "--reader"],
        ),
        ([{"objectId": "a"}], ["ai2thor_scene", "--reader"]),
    ],
)
def test_a_guess_that_fails_names_the_reader_and_the_way_out(
    tmp_path: Path, content: object, named: list[str]
) -> None:
    path = written(tmp_path / "a.json", json.dumps(content))
    with pytest.raises(InputError) as error:
        read_graph([path])
    assert all(part in str(error.value) for part in [*named, "a.json"]), error.value
    assert "Field required" not in str(error.value) or "reader" in str(error.value)
