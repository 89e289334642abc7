"""Files of a small experiment, some of whose names need escaping in other formats,
for tests of commands.
"""

import pandas as pd
import torch
import yaml

from isi.experiment.store import JOINT
from isi.graph import graph as tables
from isi.tables import paths
from tests.observing import TRIPLE

MADE = "a_test"
ENTITIES = pd.DataFrame(
    [
        ("fill", "affordance"),
        ("kitchen", "room"),
        ("mug", "object"),
        ("tea/pot", "object"),
        ('Öfen 5"', "object"),
    ],
    columns=["entity", "kind"],
)
TRIPLES = pd.DataFrame(
    [
        ("mug", "atLocation", "kitchen", 3),
        ("mug", "hasAffordance", "fill", 1),
        ("tea/pot", "atLocation", "kitchen", 2),
        ('Öfen 5"', "atLocation", "tea/pot", 1),
    ],
    columns=[*TRIPLE, "count"],
)
#: Vectors of the entities, and of atLocation and hasAffordance, for DistMult: f(h, r, t) = Σ h·r·t.
VECTORS = [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [2.0, 1.0], [0.0, 3.0]]
RELATIONS = [[0.0, 1.0], [1.0, 0.0]]


def write_experiment() -> None:
    """Write the files of an experiment: params, graph, and the joint models of seeds 4 and 7."""
    params = {
        "embedding": {"model": "distmult", "dimension": 2, "init_range": 0.1},
        "models": {"distmult": {}},
    }
    paths.PARAMS.write_text(yaml.safe_dump(params), encoding="utf-8")
    write_graph(ENTITIES, TRIPLES)
    other = torch.flip(torch.tensor(VECTORS), [-1])
    tensors = {
        "entity": torch.stack([torch.tensor(VECTORS), other]),
        "relation": torch.tensor([RELATIONS, RELATIONS]),
        "known": torch.tensor([[True] * 5, [True] * 4 + [False]]),
        "seed": torch.tensor([4, 7]),
    }
    JOINT.write(tensors, MADE, experiment="home")


def write_graph(entities: pd.DataFrame, triples: pd.DataFrame) -> None:
    """Write the tables of a graph for the experiment ``home``."""
    named = entities.assign(source="home", phrase=entities["entity"].str.lower())
    tables.ENTITIES.write(named, MADE, experiment="home")
    tables.TRIPLES.write(triples.assign(source="home"), MADE, experiment="home")
