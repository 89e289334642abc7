"""Hide entities of a graph, train a PyKEEN model on the others, insert the hidden entities,
and rank answers.
"""

import sys
from importlib.util import find_spec

import numpy as np
import pandas as pd

if find_spec("pykeen") is None:
    sys.exit("insert_hidden: expected the package PyKEEN: pip install 'isi-kge[pykeen]'")

from isi.benchmark.graphs import of_package, shipped
from isi.benchmark.in_pykeen import hidden_in
from isi.benchmark.study import HIDDEN_ENTITIES, seconds_path, study_of
from isi.errors import at
from isi.experiment.grid import GridPoints
from isi.experiment.runner import run
from isi.graph.graph import GRAPH_ENTITIES, GRAPH_TRIPLES, Graph, build_graph
from isi.graph.words import load_vectors, look_up
from isi.stage import StageContext, stage
from isi.tables import io, paths


@stage
def insert_hidden(context: StageContext, study: str) -> None:
    settings, params = study_of(context.beyond.hidden, study), context.params
    with at(paths.BEYOND_PARAMS, f"hidden.{study}.graph"):
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


def of_pipeline(name: str) -> tuple[Graph, list[str]]:
    """A graph of the second pipeline, and the phrases of its entities for word vectors."""
    entities = GRAPH_ENTITIES.read(graph=name)
    graph = build_graph(entities, GRAPH_TRIPLES.read(graph=name), GRAPH_TRIPLES.path(graph=name))
    return graph, list(entities["phrase"])


SOURCES = {"pykeen": of_package, "graphs": of_pipeline, "table": shipped}

if __name__ == "__main__":
    insert_hidden()
