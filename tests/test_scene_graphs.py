"""Scene graphs of Spark-DSG as its own package reads them, and scenes with rooms of their own
(`read_files.yaml` has the others).
"""

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isi.graph.files import read_graph
from isi.sources.ai2thor import ROOMLESS
from tests.observing import TRIPLE, observe, written

#: Written by spark-dsg 1.1.3: two rooms, kitchen and one of unknown class; labels of objects 5
#: (arm_chair) and 6 (Mug).
GRAPH = Path(__file__).parent / "scene_graph.json"
MUG = {"objectId": "Mug|1", "objectType": "Mug", "sliceable": True, "salientMaterials": ["Ceramic"]}


def triples(reader: str, path: Path, **settings: object) -> Counter[tuple[object, ...]]:
    """The number of observations of each triple."""
    return Counter(observe(reader, path, **settings).rows(*TRIPLE))


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


def test_each_file_may_have_a_room_of_its_own(tmp_path: Path) -> None:
    mug, bed = (
        written(tmp_path / f"{thing['objectType']}.json", json.dumps([thing]))
        for thing in (MUG, {"objectId": "Bed|1", "objectType": "Bed"})
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
