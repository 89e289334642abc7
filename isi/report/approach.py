"""Figure 1: where initializers put a novel entity among those that are known, and where training takes it."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from isi.experiments.tracing import TRACED
from isi.report.figures import Figure, colour_of, legend, panels
from isi.report.results import ISI, Results
from isi.report.tables import Table, label

#: Those without indicators.
_RANDOM = tuple(model for model in TRACED if model not in ISI)


def approach(results: Results) -> Figure:
    """Figure 1: Θ⁰ in the plane, one novel entity, its indicators, its starts and its ends."""
    vectors = results.approach["theta0"][results.approach["known"]]
    centre, axes, share = plane(vectors)
    canvas, drawn = panels(4, columns=2, height=6.6)
    for panel, model in zip(drawn, ISI, strict=False):
        _known(panel, (vectors - centre) @ axes.T)
        _path(panel, results, model, centre, axes)
        _indicators(panel, results, model, centre, axes)
        panel.set_title(label(model))
    _known(drawn[-1], (vectors - centre) @ axes.T)
    for model in _RANDOM:
        _path(drawn[-1], results, model, centre, axes)
    drawn[-1].set_title(" and ".join(label(model) for model in _RANDOM))
    for panel in drawn:
        panel.set(xticks=[], yticks=[])
    _key(drawn[0])
    legend(canvas, drawn[0])
    how = results.params.approach
    return Figure(
        "figure1_approach",
        "Figure 1. The approach",
        f"The entities of one Θ⁰ (|ξ| = {how.size}, seed {how.seed}) in the plane of their two principal components, "
        f"which hold {100 * share:.0f} % of their variance, and the novel entity “{_name(results)}”: where each "
        f"initializer puts it, the indicators whose centroid that is (triangles), and its way through {how.epochs} "
        "epochs of fine-tuning. Known entities are drawn where Θ⁰ has them; training moves them, too. "
        "What looks central in the plane need not be so in all dimensions (see the table).",
        canvas,
    )


def approach_distances(results: Results) -> Table:
    """The same in all dimensions: how far each start is from the known entities' centre and from its end."""
    vectors = results.approach["theta0"][results.approach["known"]]
    lines = []
    for model in TRACED:
        path = results.approach[f"{model}.path"].astype(np.float64)
        lines.append(
            {
                "initializer": label(model),
                "from the centre": np.linalg.norm(path[0] - vectors.mean(0, dtype=np.float64)),
                "from where training takes it": np.linalg.norm(path[-1] - path[0]),
                "indicators": ", ".join(_indicator_names(results, model)),
            }
        )
    away = np.linalg.norm(vectors - vectors.mean(0), axis=1).mean()
    return Table(
        "approach",
        "Figure 1 in numbers",
        f"Where each initializer puts “{_name(results)}”: distance, in all {vectors.shape[1]} dimensions, from the "
        f"centre of the known entities (which are {away:.1f} away from it on average) and from where "
        f"{results.params.approach.epochs} epochs of fine-tuning take it; and its indicators.",
        pd.DataFrame(lines),
    )


def plane(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """The plane of the two principal components of vectors, (N, d).

    Returns:
        their centre (d), two orthonormal axes (2, d), each with its largest part positive, and the share of
        the variance that lies in the plane.
    """
    centre = vectors.mean(0, dtype=np.float64)
    _, strength, axes = np.linalg.svd(vectors - centre, full_matrices=False)
    largest = np.abs(axes[:2]).argmax(1)
    turned = axes[:2] * np.sign(axes[[0, 1], largest])[:, None]
    return centre, turned, float((strength[:2] ** 2).sum() / (strength**2).sum())


def _known(axes: Axes, points: np.ndarray) -> None:
    axes.plot(*points.T, ls="", marker="o", ms=2.5, color="#b5bac2", mew=0, zorder=1)


def _indicators(axes: Axes, results: Results, model: str, centre: np.ndarray, plane_axes: np.ndarray) -> None:
    """Triangles, each with its name in the margin at the right: last, since it asks for the panel's limits."""
    chosen = np.flatnonzero(results.approach[f"{model}.indicators"])
    points = (results.approach["theta0"][chosen] - centre) @ plane_axes.T
    axes.plot(*points.T, ls="", marker="^", ms=5, color=colour_of(results, model), mec="white", mew=0.4, zorder=3)
    order = points[:, 1].argsort(kind="stable")
    low, high = axes.get_ylim()
    for height, number in zip(spread((points[order, 1] - low) / (high - low), 0.055), order, strict=True):
        axes.annotate(
            results.entities["entity"][chosen[number]], tuple(points[number]), (1.03, height), fontsize=6.5,
            textcoords="axes fraction", va="center", annotation_clip=False,
            arrowprops={
                "arrowstyle": "-", "lw": 0.4, "color": "#8a919c", "shrinkA": 1, "shrinkB": 2, "relpos": (0, 0.5)
            },
        )  # fmt: skip


def spread(heights: np.ndarray, gap: float) -> np.ndarray:
    """Ascending heights in [0, 1], pushed up to lie a gap apart and down to stay below 1; a smaller gap for many."""
    gap = min(gap, 1 / max(len(heights), 1))
    steps = gap * np.arange(len(heights))
    apart = np.maximum.accumulate(heights - steps)
    spread_out: np.ndarray = np.minimum(apart, 1 - steps[-1:].sum()) + steps
    return spread_out


def _path(axes: Axes, results: Results, model: str, centre: np.ndarray, plane_axes: np.ndarray) -> None:
    """A star where the entity is put, and an arrow along its way to where training takes it."""
    points = (results.approach[f"{model}.path"] - centre) @ plane_axes.T
    colour = colour_of(results, model)
    axes.plot(*points.T, color=colour, lw=0.8, alpha=0.7, zorder=4)
    axes.annotate(label(model), tuple(points[0]), (7, -9), fontsize=7, textcoords="offset points", color=colour)
    axes.plot(*points[0], ls="", marker="*", ms=11, color=colour, mec="black", mew=0.5, zorder=5)
    axes.annotate(
        "", tuple(points[-1]), tuple(points[0]), zorder=4,
        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.4, "shrinkA": 4, "shrinkB": 0},
    )  # fmt: skip


def _key(axes: Axes) -> None:
    for marker, size, colour, name in (("o", 2.5, "#b5bac2", "known entity"), ("^", 5, "#555555", "indicator"),
                                       ("*", 11, "#555555", "novel entity as inserted")):  # fmt: skip
        axes.plot([], [], ls="", marker=marker, ms=size, color=colour, label=name)
    axes.plot([], [], color="#555555", lw=1.4, label="to where training takes it")


def _name(results: Results) -> str:
    return str(results.entities["entity"][int(results.approach["entity"][0])])


def _indicator_names(results: Results, model: str) -> list[str]:
    return results.entities["entity"][results.approach[f"{model}.indicators"]].tolist()


TABLES = (approach_distances,)
FIGURES = (approach,)
