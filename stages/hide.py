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

from isi.analyses.hidden_entities import HIDDEN_ENTITIES, Hidden, mean_seconds, seconds_path
from isi.analyses.hidden_in_pykeen import HidingTask, hidden_in
from isi.experiment.grid import GridPoints
from isi.experiment.runner import compute_of, run
from isi.graph.graph import Graph, build_graph
from isi.graph.tables import GRAPH_ENTITIES, GRAPH_TRIPLES
from isi.graph.words import load_vectors, look_up
from isi.stage import StageContext, stage
from isi.tables import io


@stage
def hide(given: StageContext, graph: str) -> None:
    """Hide entities of a graph, let PyKEEN train on the others, insert the hidden, and ask about them."""
    key = f"hidden.{graph}"
    how = given.section(key, Hidden)
    found, phrases = of_package(graph) if how.source == "pykeen" else explored(graph)
    words = None if how.words is None else look_up(load_vectors(how.words), phrases).vectors
    none = np.zeros((1, 0, 0), dtype=np.int64)
    tasks = [
        HidingTask(GridPoints(graph, found, 0, [seed], none[0], none), words, how, key, given.seed)
        for seed in range(how.seeds)
    ]
    answers, seconds = zip(*run(hidden_in, tasks, compute_of(given), f"hide {graph}"), strict=True)
    HIDDEN_ENTITIES.write(pd.concat(answers, ignore_index=True), given.stage, graph=graph)
    listed = json.dumps(mean_seconds(pd.concat(seconds)), indent=1)
    io.atomically(seconds_path(graph), lambda path: path.write_text(f"{listed}\n", encoding="utf-8"))


def of_package(name: str) -> tuple[Graph, list[str]]:
    """A graph that lies in PyKEEN's package, of all its splits; and what its entities are called."""
    whole = get_dataset(dataset=name)
    splits = [factory.mapped_triples for factory in whole.factory_dict.values()]
    triples = torch.unique(torch.cat(splits), dim=0)
    names = [sorted(ids, key=ids.__getitem__) for ids in (whole.entity_to_id, whole.relation_to_id)]
    ones = torch.ones(len(triples), dtype=torch.int64)
    return Graph(*names, triples, ones, torch.zeros(len(names[0]), dtype=torch.int64)), names[0]


def explored(name: str) -> tuple[Graph, list[str]]:
    """A graph of the second pipeline, and the phrases of its entities."""
    entities = GRAPH_ENTITIES.read(graph=name)
    graph = build_graph(entities, GRAPH_TRIPLES.read(graph=name), GRAPH_TRIPLES.path(graph=name))
    return graph, list(entities["phrase"])


if __name__ == "__main__":
    hide()
