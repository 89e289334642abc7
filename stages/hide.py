"""Hide entities of a graph from PyKEEN's training, and insert them."""

from __future__ import annotations

import json
import sys
from importlib.util import find_spec

import numpy as np
import pandas as pd
import torch

if find_spec("pykeen") is None:
    sys.exit("hide: expected the package PyKEEN: pip install pykeen")

from pykeen.datasets import get_dataset

from isi.analyses.hidden_entities import Hidden, mean_seconds
from isi.analyses.hidden_in_pykeen import HidingTask, hidden_in
from isi.experiment.grid import GridPoints
from isi.experiment.runner import compute_of, run
from isi.graph.graph import Graph, build_graph
from isi.graph.words import load_vectors, look_up
from isi.stage import StageContext, stage
from isi.tables import catalogue, io, paths


@stage
def hide(given: StageContext, graph: str) -> None:
    """Hide entities of a graph, let PyKEEN train on the others, insert the hidden, and ask about them."""
    key = f"hidden.{graph}"
    how = given.section(key, Hidden)
    found, phrases = of_package(graph) if how.source == "pykeen" else explored(given, graph)
    words = None if how.words is None else look_up(load_vectors(how.words), phrases).vectors
    none = np.zeros((1, 0, 0), dtype=np.int64)
    tasks = [
        HidingTask(GridPoints(graph, found, 0, [seed], none[0], none), words, how, key, given.seed)
        for seed in range(how.seeds)
    ]
    answers, seconds = zip(*run(hidden_in, tasks, compute_of(given), f"hide {graph}"), strict=True)
    io.write(paths.hidden(graph), pd.concat(answers, ignore_index=True), catalogue.HIDDEN, given.provenance)
    listed = json.dumps(mean_seconds(pd.concat(seconds)), indent=1)
    io.atomically(paths.hidden_seconds(graph), lambda path: path.write_text(f"{listed}\n", encoding="utf-8"))


def of_package(name: str) -> tuple[Graph, list[str]]:
    """A graph that lies in PyKEEN's package, of all its splits; and what its entities are called."""
    whole = get_dataset(dataset=name)
    splits = [factory.mapped_triples for factory in whole.factory_dict.values()]
    triples = torch.unique(torch.cat(splits), dim=0)
    names = [sorted(ids, key=ids.__getitem__) for ids in (whole.entity_to_id, whole.relation_to_id)]
    ones = torch.ones(len(triples), dtype=torch.int64)
    return Graph(*names, triples, ones, torch.zeros(len(names[0]), dtype=torch.int64)), names[0]


def explored(given: StageContext, name: str) -> tuple[Graph, list[str]]:
    """A graph of the second pipeline, and the phrases of its entities."""
    entities = io.read(paths.explored(name, "entities"), catalogue.ENTITIES, given.provenance)
    path = paths.explored(name, "triples")
    return build_graph(entities, io.read(path, catalogue.TRIPLES, given.provenance), path), list(entities["phrase"])


if __name__ == "__main__":
    hide()
