"""Hide entities of a graph, train a PyKEEN model on the others, insert the hidden entities,
and rank answers.
"""

import sys
from importlib.util import find_spec

import numpy as np
import pandas as pd
import torch

if find_spec("pykeen") is None:
    sys.exit("insert_hidden: expected the package PyKEEN: pip install 'isi-kge[pykeen]'")

from pykeen.datasets import dataset_resolver, get_dataset

from isi.errors import at
from isi.experiment.grid import GridPoints
from isi.experiment.runner import run
from isi.extras.hidden_entities import HIDDEN_ENTITIES, seconds_path, study_of
from isi.extras.hidden_in_pykeen import hidden_in
from isi.graph.graph import GRAPH_ENTITIES, GRAPH_TRIPLES, Graph, build_graph
from isi.graph.words import load_vectors, look_up
from isi.params import check_names
from isi.stage import StageContext, stage
from isi.tables import io, paths


@stage
def insert_hidden(context: StageContext, study: str) -> None:
    settings, params = study_of(context.beyond.hidden, study), context.params
    if settings.source == "pykeen":
        with at(paths.BEYOND_PARAMS):
            check_names([settings.graph], dataset_resolver.lookup_dict, f"hidden.{study}.graph")
    graph, phrases = SOURCES[settings.source](settings.graph)
    words = (
        None if settings.words is None else look_up(load_vectors(settings.words), phrases).vectors
    )
    splits = np.zeros((1, len(graph.triples)), dtype=np.int8)
    points = [
        GridPoints.without_insertion(study, graph, [seed], splits) for seed in range(settings.seeds)
    ]
    tasks = [(point, words, settings, f"hidden.{study}", params.seed) for point in points]
    answers, seconds = zip(*run(hidden_in, tasks, params.compute, f"hidden, {study}"), strict=True)
    HIDDEN_ENTITIES.write(pd.concat(answers, ignore_index=True), context.stage, study=study)
    by_method = (
        pd.concat(seconds)
        .astype({"told": "Int64"})
        .groupby(["method", "told"], dropna=False, sort=False)
    )
    means = by_method["seconds"].mean().round(3).reset_index().to_json(orient="records", indent=1)
    io.atomically(seconds_path(study), lambda path: path.write_text(f"{means}\n", encoding="utf-8"))


def of_package(name: str) -> tuple[Graph, list[str]]:
    """A dataset of PyKEEN (all its splits) as a graph, and the names of its entities."""
    dataset = get_dataset(dataset=name)
    splits = [factory.mapped_triples for factory in dataset.factory_dict.values()]
    triples = torch.unique(torch.cat(splits), dim=0)
    entities, relations = (
        sorted(ids, key=ids.__getitem__) for ids in (dataset.entity_to_id, dataset.relation_to_id)
    )
    return unweighted(entities, relations, triples), entities


def of_table(name: str) -> tuple[Graph, list[str]]:
    """A graph that ships as a table of triples, and the names of its entities."""
    listed = pd.read_csv(paths.RAW / name / "triples.csv", keep_default_na=False)
    entities, relations = (
        sorted({*listed["head"], *listed["tail"]}),
        sorted(set(listed["relation"])),
    )
    ids = [
        pd.Categorical(listed[slot], names).codes
        for slot, names in (("head", entities), ("relation", relations), ("tail", entities))
    ]
    return unweighted(
        entities, relations, torch.from_numpy(np.stack(ids, 1).astype(np.int64))
    ), entities


def unweighted(entities: list[str], relations: list[str], triples: torch.Tensor) -> Graph:
    """A graph without kinds, each of whose triples was observed once."""
    ones = torch.ones(len(triples), dtype=torch.int64)
    return Graph(entities, relations, triples, ones, torch.zeros(len(entities), dtype=torch.int64))


def of_pipeline(name: str) -> tuple[Graph, list[str]]:
    """A graph of the second pipeline, and the phrases of its entities for word vectors."""
    entities = GRAPH_ENTITIES.read(graph=name)
    graph = build_graph(entities, GRAPH_TRIPLES.read(graph=name), GRAPH_TRIPLES.path(graph=name))
    return graph, list(entities["phrase"])


SOURCES = {"pykeen": of_package, "graphs": of_pipeline, "table": of_table}

if __name__ == "__main__":
    insert_hidden()
