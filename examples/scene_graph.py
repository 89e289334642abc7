"""From a scene graph to an embedding: read what a robot has mapped, train,
and tell what the next map has.

``python examples/scene_graph.py [MAP.json ...]``. A map is JSON of rooms with objects, as below, an
AI2-THOR event, or a file of Hydra's ``DynamicSceneGraph.save``; the reader follows from its
content.
"""

# %%
import json
import sys
from pathlib import Path

import isi
from isi.graph.files import read_graph

# %% Two maps of a home: the second one has a new object
ROOMS = {
    "kitchen": [
        "fridge",
        "kettle",
        "toaster",
        {"class": "mug", "receptacle": "shelf", "material": "ceramic"},
    ],
    "bedroom": [
        "bed",
        {"class": "lamp", "affordances": ["turn on"]},
        {"class": "desk", "material": "wood"},
    ],
    "bathroom": [
        "towel",
        {"class": "shelf", "material": "wood"},
        {"class": "sink", "material": "ceramic"},
    ],
}
maps = [Path(name) for name in sys.argv[1:]] or [Path("map.json"), Path("next_map.json")]
if len(sys.argv) == 1:
    later = ROOMS | {
        "kitchen": [*ROOMS["kitchen"], {"class": "espresso machine", "affordances": ["turn on"]}]
    }
    for path, rooms in zip(maps, (ROOMS, later), strict=True):
        listed = [{"name": room, "objects": objects} for room, objects in rooms.items()]
        path.write_text(json.dumps({"rooms": listed}), encoding="utf-8")

# %% Train on the first map. So small a home teaches a model little, and a warning says so
home = isi.train(maps[0])
print(home)

# %% Tell what the next map has: what is new is inserted, what is known is seen once more
# `isi tell --from next_map.json` does the same for a home in a folder
tables, _ = read_graph([maps[-1]])
facts = tables.triples[["head", "relation", "tail"]].to_numpy().tolist()
done = home.tell(facts)
print("inserted:", ", ".join(done.inserted), "seen again:", done.seen)

# %% Where is it, and what is it made of? A folder is the home for `isi ask` and `isi live`
for name in done.inserted:
    print(home.ask(name, "hasMaterial", top=2))
home.save("mapped_home")
