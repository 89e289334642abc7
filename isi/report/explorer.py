"""The data of the page's explorer: Θ⁰ of one seed and its graph,
from which the page computes insertions itself.
"""

import base64
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import torch
from markupsafe import Markup

from isi.experiment.grid import GridPoints
from isi.experiment.store import Store
from isi.graph.sessions import sample_insert_triples
from isi.initializers.similarity import cosines
from isi.models.bilinear import BlockModel
from isi.models.stack import Embedding
from isi.params import Params
from isi.report.words import TEMPLATES, label

#: The initializers that the page computes: the functions in its table of them.
COMPUTED = re.findall(
    r"^  (\w+): \(world, subject,",
    (TEMPLATES / "explorer/initializers.js").read_text(encoding="utf-8"),
    re.MULTILINE,
)
#: The modules of the page in the order of their imports.
MODULES = ("linear_algebra", "model", "data", "random", "similarity", "newton", "initializers",
           "ranking", "state", "insertion", "elements", "map_view", "answers_view", "controls",
           "main")  # fmt: skip
#: Coordinates of the joint model are rounded to this many steps from zero to the largest.
STEPS = 2**15 - 1


@dataclass(frozen=True, eq=False)
class Explored:
    """Θ⁰ and the joint model of one seed, with the word vectors of the graph's entities."""

    points: GridPoints  #: of one seed
    theta0: Embedding
    joint: Embedding
    words: np.ndarray  #: shape: (E, w)


def read(params: Params, experiment: str) -> Explored | None:
    """Read what the explorer of an experiment shows;
    None if its model is none that the page computes.
    """
    store, model, chosen = Store(experiment), params.model_of(), params.explorer
    if not (isinstance(model, BlockModel) and model.linear):
        return None
    points = store.grid(1, chosen.size, chosen.seed + 1)[-1]
    return Explored(points, store.theta0(points, model), store.joint(points, model), store.words())


def payload(explored: Explored, kinds: pd.Series, params: Params) -> dict[str, Any]:
    """The explorer's data as JSON values; arrays are base64 of little-endian numbers
    (see ``explorer/data.js``).
    """
    points, theta0, model = explored.points, explored.theta0, explored.theta0.model
    assert isinstance(model, BlockModel)  # noqa: S101  # no other is read
    graph, known = points.graph, points.session(0).entities[0].numpy()
    vectors, joint = (of.entity[0].double().numpy() for of in (explored.theta0, explored.joint))
    of_kinds, names = pd.factorize(kinds.astype(str), sort=True)
    centre, axes, shown = plane(vectors[known])
    turned, fitted = procrustes(joint, vectors, known)
    scale = max(float(np.abs(joint).max()), 1e-9) / STEPS
    upper = cosines(torch.as_tensor(explored.words))[np.triu_indices(len(known))]
    novel = sorted(set(map(int, points.novel[0, 0])))
    return {
        "seed": points.seeds[0],
        "model": type(model).__name__,
        "scalars": vectors.shape[1] * model.scalars // 100,
        "dimension": vectors.shape[1],
        "names": graph.entities,
        "kinds": list(names),
        "kind": of_kinds.tolist(),
        "relations": graph.relations,
        "known": np.flatnonzero(known).tolist(),
        "novel": novel,
        "start": starts_at(points),
        "theta0": packed(vectors[known]),
        "map": packed(model.maps(theta0.relation[0])),
        "cosines": packed(upper),
        "worded": np.flatnonzero((explored.words != 0).any(1)).tolist(),
        "triples": np.c_[graph.triples, graph.counts, points.splits[0]].tolist(),
        "given": insert_triples(points, params.seed, params.sessions.insert_fraction),
        "joint": packed(np.round(joint / scale), "<i2"),
        "jointScale": scale,
        "jointMap": packed(model.maps(explored.joint.relation[0])),
        "jointPlaces": ((turned - centre) @ axes.T).round(3).tolist(),
        "fitted": round(100 * fitted),
        "plane": packed(np.vstack([centre, axes])),
        "shown": round(100 * shown),
        "initializers": [
            {"name": name, "label": label(name), "options": params.initializers[name]}
            for name in COMPUTED
            if name in params.initializers
        ],
    }


def starts_at(points: GridPoints) -> int:
    """The novel entity that is shown first: the bottle, else the first."""
    novel = sorted(set(map(int, points.novel[0, 0])))
    names = points.graph.entities
    return next((entity for entity in novel if names[entity] == "bottle"), novel[0])


def packed(values: Any, kind: str = "<f4") -> str:
    """Numbers as base64, in single precision or another kind."""
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()


def insert_triples(points: GridPoints, root: int, fraction: float) -> dict[str, list[int]]:
    """Insert triples by entity: of novel ones those of the run,
    of known ones drawn by the same rule.
    """
    session, rows = points.session(0), points.insert_triples_in(1)
    splits, seed = session.splits[0].numpy(), points.seeds[0]
    triples = {
        int(entity): rows[rows[:, 1] == place, 2].tolist()
        for place, entity in enumerate(points.novel[0, 0])
    }
    for entity in np.flatnonzero(session.entities[0]):
        alone = np.array([[entity]])
        drawn = sample_insert_triples(points.graph, splits, alone, 1, root, seed, fraction)
        triples[int(entity)] = [triple for _, triple in drawn]
    return {str(entity): listed for entity, listed in sorted(triples.items())}


def plane(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """The mean (d) of vectors (N, d), two principal axes (2, d) with fixed signs,
    and their share of the variance.
    """
    centre = vectors.mean(0, dtype=np.float64)
    _, strength, axes = np.linalg.svd(vectors - centre, full_matrices=False)
    largest = np.abs(axes[:2]).argmax(1)
    turned = axes[:2] * np.sign(axes[[0, 1], largest])[:, None]
    return centre, turned, float((strength[:2] ** 2).sum() / (strength**2).sum())


def procrustes(
    vectors: np.ndarray, onto: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, float]:
    """Rotate, scale and shift ``vectors`` (E, d) to fit ``onto`` at known rows;
    explained share of its variance.
    """
    centre, target = vectors[known].mean(0), onto[known].mean(0)
    offsets, target_offsets = vectors[known] - centre, onto[known] - target
    left, lengths, right = np.linalg.svd(offsets.T @ target_offsets)
    scale = lengths.sum() / (offsets**2).sum()
    return (vectors - centre) @ left @ right * scale + target, float(
        lengths.sum() * scale / (target_offsets**2).sum()
    )


def script() -> Markup:
    """The modules of the page in one script, without their imports and exports."""
    sources = ((TEMPLATES / "explorer" / f"{name}.js").read_text("utf-8") for name in MODULES)
    lines = [line for source in sources for line in source.splitlines(keepends=True)]
    shown = [line.removeprefix("export ") for line in lines if not line.startswith("import ")]
    return Markup("".join(shown))  # noqa: S704
