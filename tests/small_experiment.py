"""Files of a small experiment, some of whose names need escaping in other formats,
for tests of commands.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from isi.graph import graph as tables
from tests.observing import TRIPLE
from tests.small_bundle import home_of, small

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
LABELS = ["atLocation", "hasAffordance"]


def write_experiment() -> None:
    """Write the graph of the experiment ``home``."""
    named = ENTITIES.assign(source="home", phrase=ENTITIES["entity"].str.lower())
    tables.ENTITIES.write(named, MADE, experiment="home")
    tables.TRIPLES.write(TRIPLES.assign(source="home"), MADE, experiment="home")


def write_model(folder: Path) -> None:
    """Write the home of a model of the same graph."""
    names = ENTITIES["entity"].tolist()
    triples = [
        (names.index(head), LABELS.index(relation), names.index(tail))
        for head, relation, tail in TRIPLES[TRIPLE].itertuples(index=False)
    ]
    bundle = small(
        entities=np.array(VECTORS, np.float32),
        relations=np.array(RELATIONS, np.float32),
        entity_names=names,
        kinds=ENTITIES["kind"].tolist(),
        phrases=[name.lower() for name in names],
        relation_names=LABELS,
        triples=np.array(triples),
        words=None,
    )
    manifest = bundle.manifest.model_copy(update={"words": None})
    home_of(folder, replace(bundle, manifest=manifest))
