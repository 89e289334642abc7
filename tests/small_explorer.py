"""What the picture and the explorer have of a small graph, a page of them alone,
and the scores of an entity by Python.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from jinja2 import Environment, PackageLoader

from isi.initializers.api import INITIALIZERS
from isi.models.stack import Embedding
from stages.demonstrate import COMPUTED, Explored, Options, payload, picture
from stages.report.explorer import script
from stages.train_theta0 import train_stack
from tests import small_grid
from tests.small_graphs import points_of

NAMES = ["bowl", "bottle", "<b>box</b>", "kitchen", "table top", "tap", "50% / half", "cup",
         "cup board", "mug", "pan", "pot", "sofa", "shelf"]  # fmt: skip
PAGE = """<!doctype html><html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark"><title>Demonstration</title>
<style>{% include "style.css" %}</style></head><body><main><h1>Page</h1>
{% include "picture.html" %}<h3>Try it</h3>{% include "explorer.html" %}</main></body></html>"""


@dataclass(frozen=True, eq=False)
class Shown:
    """What is shown, with what the demonstration is computed from."""

    explored: Explored
    kinds: pd.Series
    options: Options
    root: int
    fraction: float

    @property
    def data(self) -> dict[str, Any]:
        return payload(self.explored, self.kinds, self.options, self.root, self.fraction)

    def write(self, path: Path) -> Path:
        """Write a page with the picture and the explorer alone, and return its path."""
        environment = Environment(loader=PackageLoader("stages.report"), autoescape=True)
        text = environment.from_string(PAGE).render(
            picture=picture(self.explored, self.options),
            explorer=self.data,
            explorer_script=script(),
            question="{}?".format,
        )
        path.write_text(text, encoding="utf-8")
        return path


def small() -> Shown:
    """Three of 14 entities are new; one has no word vector; one new entity has no facts."""
    points = points_of(small_grid.GRAPH, 3, [5])
    points = replace(points, insert_triples=points.insert_triples[points.insert_triples[:, 1] < 2])
    result = train_stack(points, small_grid.LEARNING)
    joint = train_stack(points.all_known, small_grid.LEARNING).theta
    words = small_grid.WORDS.copy()
    words[[points.novel[0, 1], 4]] = 0
    listed = {name: INITIALIZERS.get(name, name).defaults for name in COMPUTED}
    changed = {"ers": {"k": 3, "candidates": 5}, "es": {"k": 3}, "rs": {"k": 4}}
    named = replace(points, graph=replace(points.graph, entities=NAMES))
    kinds = pd.Series([f"kind {kind}" for kind in points.graph.kinds.tolist()])
    return Shown(Explored(named, result.theta, joint, words), kinds, {**listed, **changed}, 0, 0.5)


def scores(embedding: Embedding, entity: int) -> np.ndarray:
    """Scores of all entities as tail and as head of each relation; shape (R, 2, E)."""
    relations = torch.arange(embedding.relation.shape[1])[None]
    given = torch.full_like(relations, entity)
    both = embedding.score_tails(given, relations)[0], embedding.score_heads(relations, given)[0]
    return torch.stack(both, 1).numpy()
