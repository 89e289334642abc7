"""Train an embedding of all triples of an experiment, which `isi import` makes a home of.

It is trained like a joint model, for the median of the joint models' best epochs.
"""

from __future__ import annotations

from statistics import median_low
from typing import Any

import numpy as np
import pandas as pd

from isi.errors import InputError
from isi.formats.plain import write
from isi.graph.graph import Graph
from isi.graph.sessions import TRAIN
from isi.home.bundle import MODEL, Bundle, Manifest, WordSource
from isi.models.stack import Embedding
from isi.tables.table import DataFile, as_text
from isi.training.fit import TrainConfig, fit_for
from stages.embed_words import Words
from stages.grid import JOINT_MODEL, GridPoints
from stages.params import StageParams
from stages.runner import Compute, run
from stages.stage import StageContext, stage
from stages.store import TRAINING_LOG, Store
from stages.train_theta0 import train_config

#: The folder of an experiment's final model, a bundle.
FINAL_MODEL = DataFile("data/final_models/{experiment}")


@stage
def train_final(context: StageContext, experiment: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    entities, graph = as_text(store.entities()), store.graph()
    epochs = usual_epochs(TRAINING_LOG.read(experiment=experiment, model=JOINT_MODEL))
    tasks = [(whole_graph(experiment, graph), train_config(params), epochs)]
    compute: Compute = params.read("compute", Compute)
    (trained,) = run(train_stack_for, tasks, compute, f"{experiment}, final model")
    bundle = Bundle(
        manifest_of(params, experiment, epochs),
        trained.entity[0].numpy(),
        trained.relation[0].numpy(),
        graph.entities,
        list(entities["kind"]),
        list(entities["phrase"]),
        graph.relations,
        graph.triples.numpy(),
        store.words(),
    )
    write(FINAL_MODEL.path(experiment=experiment), bundle)


def manifest_of(params: StageParams, experiment: str, epochs: int) -> Manifest:
    """What the bundle says of its model, its word vectors and the params that it was trained by."""
    words: Words = params.read("words", Words)
    of_package = MODEL if words.shipped and words.text != "glove" else None
    name: str = params.read("embedding.model", str)
    options = params.read(f"models.{name}", dict[str, Any])
    sections = {
        section: params.read(section, dict[str, Any])
        for section in ("words", "embedding", "negatives", "training")
    }
    return Manifest(
        model_name=name,
        model_options=options,
        words=WordSource(source=words.source, text=words.text, model=of_package),
        made={
            "experiment": experiment,
            "epochs": epochs,
            "params": {"seed": params.seed, f"models.{name}": options, **sections},
        },
    )


def usual_epochs(log: pd.DataFrame) -> int:
    """Lower median over seeds of the best epoch in ``log`` (``TRAINING_LOG``);
    ``InputError`` if no epoch is best.
    """
    kept = log[log["kept"]].groupby("seed")["epoch"].max()
    if kept.empty:
        raise InputError(
            "joint.log.parquet", "column 'kept'", "expected true in at least one row, a best epoch"
        )
    return int(median_low(kept.tolist()))


def whole_graph(experiment: str, graph: Graph) -> GridPoints:
    """A grid point with all triples in train and the random streams of
    the joint model of seed 0.
    """
    splits = np.full((1, len(graph.triples)), TRAIN, dtype=np.int8)
    return GridPoints.without_insertion(experiment, graph, [0], splits)


def train_stack_for(points: GridPoints, config: TrainConfig, epochs: int) -> Embedding:
    """Train on all triples of ``points`` for a fixed number of epochs."""
    return fit_for(points.session(0), points.keys(), config, epochs)


if __name__ == "__main__":
    train_final()
