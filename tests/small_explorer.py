"""What the explorer has of a small graph, and the scores of an entity by Python."""

from dataclasses import replace

import numpy as np
import pandas as pd
import torch

from isi.experiment.train import train_stack
from isi.initializers.api import INITIALIZERS
from isi.models.stack import Embedding
from isi.params import Params
from isi.report.explorer import COMPUTED, Explored
from tests import small_grid
from tests.reports import small_params
from tests.small_graphs import points_of

NAMES = ["bowl", "bottle", "<b>box</b>", "kitchen", "table top", "tap", "50% / half", "cup",
         "cup board", "mug", "pan", "pot", "sofa", "shelf"]  # fmt: skip


def small() -> tuple[Explored, pd.Series, Params]:
    """Three of 14 entities are new; one has no word vector; one new entity has no facts."""
    points = points_of(small_grid.GRAPH, 3, [5])
    points = replace(points, insert_triples=points.insert_triples[points.insert_triples[:, 2] < 2])
    result = train_stack(points, small_grid.LEARNING)
    joint = train_stack(points.all_known, small_grid.LEARNING).theta
    words = small_grid.WORDS.copy()
    words[[points.novel[0, 0, 1], 4]] = 0
    params = small_params(["home"])
    listed = {name: INITIALIZERS.get(name, name).defaults for name in COMPUTED}
    changed = {"ers": {"k": 3, "candidates": 5}, "es": {"k": 3}, "rs": {"k": 4}}
    params = params.model_copy(update={"initializers": {**listed, **changed}})
    named = replace(points, graph=replace(points.graph, entities=NAMES))
    kinds = pd.Series([f"kind {kind}" for kind in points.graph.kinds.tolist()])
    return Explored(named, result.theta, joint, words), kinds, params


def scores(embedding: Embedding, entity: int) -> np.ndarray:
    """Scores of all entities as tail and as head of each relation; shape (R, 2, E)."""
    relations = torch.arange(embedding.relation.shape[1])[None]
    given = torch.full_like(relations, entity)
    both = embedding.score_tails(given, relations)[0], embedding.score_heads(relations, given)[0]
    return torch.stack(both, 1).numpy()
