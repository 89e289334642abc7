"""Figure 1: where initializers put a novel entity among those that are known, and where training takes it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patheffects import withStroke

from isi.report.figures import legend, panels
from isi.report.models import colour, isi, label
from isi.report.results import Results
from isi.report.section import Content, Figure, Section, Table

#: What became of the entity (see ``tracing.Trace``), by name.
Traces = Mapping[str, np.ndarray]


def contents(results: Results) -> Iterator[Content]:
    """Figure 1 and its distances."""
    if results.approach is None:
        return
    how, traces = results.params.trajectory, results.approach.found
    names = results.approach.experiment.entities["entity"]
    yield (
        "An embedding Θ⁰ is learned of what the robot knows. A novel entity is given a vector, Θ¹ starts there, and "
        "fine-tuning on everything goes on from it. Xavier and informed uniform draw the vector; ISI takes the mean of "
        "k indicators."
    )
    share = plane(known_vectors(traces))[2]
    yield Figure(
        "figure1_approach",
        "Figure 1. The approach",
        f"The entities of one Θ⁰ (|ξ| = {how.size}, seed {how.seed}) in the plane of their two principal components, "
        f"which hold {100 * share:.0f} % of their variance, and the novel entity “{_name(traces, names)}”: where each "
        f"initializer puts it, the indicators whose centroid that is (triangles), and its way through {how.epochs} "
        "epochs of fine-tuning. Known entities are drawn where Θ⁰ has them; training moves them, too. "
        "What looks central in the plane need not be so: titles give distances in all dimensions.",
        drawn(traces, names),
    )
    yield distances(traces, names, how.epochs)


def known_vectors(traces: Traces) -> np.ndarray:
    """Θ⁰ of the known entities; shape: (N, d)."""
    return traces["theta0"][traces["known"]]


def traced(traces: Traces) -> list[str]:
    """The initializers whose entity was followed."""
    return [name.removesuffix(".path") for name in traces if name.endswith(".path")]


def drawn(traces: Traces, names: pd.Series) -> Canvas:
    """A panel for each initializer with indicators, and one for the others; ``names``: of entities, by id."""
    vectors, models = known_vectors(traces), traced(traces)
    centre, axes, _ = plane(vectors)
    groups = [[model] for model in isi(models)] + [[model for model in models if model not in isi(models)]]
    canvas, places = panels(len(groups), height=6.6)
    for panel, group in zip(places, groups, strict=True):
        panel.plot(*((vectors - centre) @ axes.T).T, ls="", marker="o", ms=2.5, color="#b5bac2", mew=0, zorder=1)
        for model in group:
            points = (traces[f"{model}.path"] - centre) @ axes.T
            _path(panel, points, colour(model, models), label(model) if len(group) > 1 else "")
        for model in isi(group):
            chosen = np.flatnonzero(traces[f"{model}.indicators"])
            points = (traces["theta0"][chosen] - centre) @ axes.T
            _indicators(panel, points, names[chosen].tolist(), colour(model, models))
        panel.set(xticks=[], yticks=[])
        panel.set_title("\n".join(_distances(traces, model) for model in group), fontsize=9)
    _key(places[0])
    legend(canvas, places)
    return canvas


def distances(traces: Traces, names: pd.Series, epochs: int) -> Table:
    """The same in all dimensions: how far each start is from the known entities' centre and from its end."""
    vectors = known_vectors(traces)
    lines = [
        {
            "initializer": label(model),
            "from the centre": from_centre(traces, model),
            "from where training takes it": moved(traces, model),
            "indicators": ", ".join(names[traces[f"{model}.indicators"]]),
        }
        for model in traced(traces)
    ]
    away = np.linalg.norm(vectors - vectors.mean(0), axis=1).mean()
    return Table(
        "approach",
        "Figure 1 in numbers",
        f"Where each initializer puts “{_name(traces, names)}”: distance, in all {vectors.shape[1]} dimensions, from "
        f"the centre of the known entities (which are {away:.1f} away from it on average) and from where {epochs} "
        "epochs of fine-tuning take it; and its indicators.",
        pd.DataFrame(lines),
        folded=True,
    )


def from_centre(traces: Traces, model: str) -> float:
    """How far an initializer puts the entity from the centre of those that are known, in all dimensions."""
    centre = known_vectors(traces).mean(0, dtype=np.float64)
    return float(np.linalg.norm(traces[f"{model}.path"][0].astype(np.float64) - centre))


def moved(traces: Traces, model: str) -> float:
    """How far training takes it from there."""
    path = traces[f"{model}.path"].astype(np.float64)
    return float(np.linalg.norm(path[-1] - path[0]))


def _distances(traces: Traces, model: str) -> str:
    return f"{label(model)}: {from_centre(traces, model):.1f} from the centre, {moved(traces, model):.1f} to its end"


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


def _indicators(axes: Axes, points: np.ndarray, names: Sequence[str], colour: str) -> None:
    """Triangles, each with its name in the margin at the right: last, since it asks for the panel's limits."""
    axes.plot(*points.T, ls="", marker="^", ms=5, color=colour, mec="white", mew=0.4, zorder=3)
    order = points[:, 1].argsort(kind="stable")
    low, high = axes.get_ylim()
    for height, number in zip(spread((points[order, 1] - low) / (high - low), 0.055), order, strict=True):
        axes.annotate(
            names[number], tuple(points[number]), (1.03, height), fontsize=6.5,
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


def _path(axes: Axes, points: np.ndarray, colour: str, name: str) -> None:
    """A star where the entity is put, its name where there are several, and an arrow to where training takes it."""
    axes.plot(*points.T, color=colour, lw=0.8, alpha=0.7, zorder=4)
    halo = [withStroke(linewidth=2.5, foreground="white")]
    axes.annotate(name, tuple(points[0]), (7, -10), fontsize=8, textcoords="offset points", color=colour, zorder=6,
                  path_effects=halo)  # fmt: skip
    axes.plot(*points[0], ls="", marker="*", ms=11, color=colour, mec="black", mew=0.5, zorder=5)
    axes.annotate(
        "", tuple(points[-1]), tuple(points[0]), zorder=4,
        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.4, "shrinkA": 4, "shrinkB": 0},
    )  # fmt: skip


def _key(axes: Axes) -> None:
    for marker, size, shade, name in (("o", 2.5, "#b5bac2", "known entity"), ("^", 5, "#555555", "indicator"),
                                      ("*", 11, "#555555", "novel entity as inserted")):  # fmt: skip
        axes.plot([], [], ls="", marker=marker, ms=size, color=shade, label=name)
    axes.plot([], [], color="#555555", lw=1.4, label="to where training takes it")


def _name(traces: Traces, names: pd.Series) -> str:
    return str(names[int(traces["entity"][0])])


SECTION = Section("approach", "One entity followed (Figure 1)", contents)
