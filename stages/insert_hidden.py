"""Hide entities of a graph, train a PyKEEN model on the others, insert the hidden entities, and rank answers."""

import sys
from importlib.util import find_spec

import numpy as np
import pandas as pd
import torch

if find_spec("pykeen") is None:
    sys.exit("insert_hidden: expected the package PyKEEN: pip install 'isi-kge[pykeen]'")

from pykeen.datasets import get_dataset

from isi.analyses.hidden_entities import HIDDEN_ENTITIES, seconds_path
from isi.analyses.hidden_in_pykeen import hidden_in
from isi.experiment.grid import GridPoints
from isi.experiment.runner import run
from isi.graph.graph import GRAPH_ENTITIES, GRAPH_TRIPLES, Graph, build_graph
from isi.graph.words import load_vectors, look_up
from isi.stage import StageContext, stage
from isi.tables import io


@stage
def insert_hidden(context: StageContext, graph: str) -> None:
    settings, params = context.beyond.hidden[graph], context.params
    triples, phrases = of_package(graph) if settings.source == "pykeen" else of_pipeline(graph)
    words = None if settings.words is None else look_up(load_vectors(settings.words), phrases).vectors
    splits = np.zeros((1, len(triples.triples)), dtype=np.int8)
    points = [GridPoints.without_insertion(graph, triples, [seed], splits) for seed in range(settings.seeds)]
    tasks = [(point, words, settings, f"hidden.{graph}", params.seed) for point in points]
    answers, seconds = zip(*run(hidden_in, tasks, params.compute, f"hidden, {graph}"), strict=True)
    HIDDEN_ENTITIES.write(pd.concat(answers, ignore_index=True), context.stage, graph=graph)
    by_method = pd.concat(seconds).astype({"told": "Int64"}).groupby(["method", "told"], dropna=False, sort=False)
    means = by_method["seconds"].mean().round(3).reset_index().to_json(orient="records", indent=1)
    io.atomically(seconds_path(graph), lambda path: path.write_text(f"{means}\n", encoding="utf-8"))


def of_package(name: str) -> tuple[Graph, list[str]]:
    """A dataset of PyKEEN (all its splits) as a graph, and the names of its entities."""
    dataset = get_dataset(dataset=name)
    splits = [factory.mapped_triples for factory in dataset.factory_dict.values()]
    triples = torch.unique(torch.cat(splits), dim=0)
    names = [sorted(ids, key=ids.__getitem__) for ids in (dataset.entity_to_id, dataset.relation_to_id)]
    ones = torch.ones(len(triples), dtype=torch.int64)
    return Graph(*names, triples, ones, torch.zeros(len(names[0]), dtype=torch.int64)), names[0]


def of_pipeline(name: str) -> tuple[Graph, list[str]]:
    """A graph of the second pipeline, and the phrases of its entities for word vectors."""
    entities = GRAPH_ENTITIES.read(graph=name)
    graph = build_graph(entities, GRAPH_TRIPLES.read(graph=name), GRAPH_TRIPLES.path(graph=name))
    return graph, list(entities["phrase"])


if __name__ == "__main__":
    insert_hidden()
