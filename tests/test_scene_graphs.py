"""Old files of Spark-DSG, and scenes with rooms of their own
(`read_files.yaml` has the others).
"""

import json
from collections import Counter
from pathlib import Path

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
