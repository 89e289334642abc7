"""One insertion: Figure 1, the path of an entity through fine-tuning,
and the explorer of the page.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patheffects import withStroke

from isi.report import picture as pictures
from isi.report.data import Results
from isi.report.explorer import payload, plane, script
from isi.report.figures import legend, panels
from isi.report.section import Content, Contents
from isi.report.words import Names, colour, isi, label

#: Arrays of ``TRAJECTORY``, by name: the path of one entity.
Traces = Mapping[str, np.ndarray]
#: Marker, size, colour and name of what Figure 1 shows.
_LEGEND = (
    ("o", 2.5, "#b5bac2", "known entity"),
    ("^", 5, "#555555", "indicator"),
    ("*", 11, "#555555", "novel entity as inserted"),
)


def trajectory(results: Results) -> Contents:
    """Figure 1, and a table of its distances in all dimensions."""
    for experiment, traces in results.analysis("trajectory"):
        names, rows, titles = experiment.entities["entity"], [], {}
        vectors = traces["theta0"][traces["known"]]  # [N, d]
        for model in (name.removesuffix(".path") for name in traces if name.endswith(".path")):
            path = traces[f"{model}.path"].astype(np.float64)  # in all dimensions
            away = float(np.linalg.norm(path[0] - vectors.mean(0, dtype=np.float64)))
            moved = float(np.linalg.norm(path[-1] - path[0]))
            titles[model] = (
                f"{label(model)}: starts {away:.1f} from the centre; training moves it {moved:.1f}"
            )
            rows.append(
                {
                    "initializer": label(model),
                    "from the centre": away,
                    "from where training takes it": moved,
                    "indicators": ", ".join(names[traces[f"{model}.indicators"]]),
                }
            )
        numbers = {
            "share": 100 * plane(vectors)[2],
            "dimension": vectors.shape[1],
            "name": str(names[int(traces["entity"][0])]),
            "away": np.linalg.norm(vectors - vectors.mean(0), axis=1).mean(),
        }
        drawn = _drawn(traces, vectors, titles, names)
        yield Content(numbers, {"trajectory": rows}, {"figure1_trajectory": drawn})


def _drawn(
    traces: Traces, vectors: np.ndarray, titles: Mapping[str, str], names: pd.Series
) -> Canvas:
    """A panel for each initializer of ISI, and one for the others;
    a star marks the entity's initial vector.
    """
    centre, axes, _ = plane(vectors)
    drawn = {name: (traces[f"{name}.path"] - centre) @ axes.T for name in titles}
    entities, known = (traces["theta0"] - centre) @ axes.T, (vectors - centre) @ axes.T
    models, methods = list(titles), isi(titles)
    groups = [*([model] for model in methods), [model for model in models if model not in methods]]
    canvas, places = panels(len(groups), height=6.6)
    for panel, group in zip(places, groups, strict=True):
        panel.plot(*known.T, ls="", marker="o", ms=2.5, color="#b5bac2", mew=0, zorder=1)
        for model in group:
            title = label(model) if len(group) > 1 else ""
            _path(panel, drawn[model], title, colour(model, models))
        for model in isi(group):
            chosen = np.flatnonzero(traces[f"{model}.indicators"])
            points, color = entities[chosen], colour(model, models)
            for point in points:
                ends = np.stack([point, drawn[model][0]])
                panel.plot(*ends.T, color=color, lw=0.4, alpha=0.5, zorder=2)
            _indicators(panel, points, names[chosen].tolist(), color)
        panel.set(xticks=[], yticks=[])
        panel.set_title("\n".join(titles[model] for model in group), fontsize=9)
    for marker, size, shade, name in _LEGEND:
        places[0].plot([], [], ls="", marker=marker, ms=size, color=shade, label=name)
    places[0].plot([], [], color="#555555", lw=1.4, label="to where training takes it")
    legend(canvas, places)
    return canvas


def _path(panel: Axes, points: np.ndarray, title: str, color: str) -> None:
    """Draw the path of an entity, an arrow along it, and a star with a title at its start."""
    start, end = tuple(points[0]), tuple(points[-1])
    halo = [withStroke(linewidth=2.5, foreground="white")]
    text: dict[str, Any] = {"fontsize": 8, "textcoords": "offset points", "path_effects": halo}
    arrow = {"arrowstyle": "-|>", "lw": 1.4, "shrinkA": 4, "shrinkB": 0, "color": color}
    panel.plot(*points.T, color=color, lw=0.8, alpha=0.7, zorder=4)
    panel.annotate(title, start, (7, -10), color=color, zorder=6, **text)
    panel.plot(*start, ls="", marker="*", ms=11, color=color, mec="black", mew=0.5, zorder=5)
    panel.annotate("", end, start, zorder=4, arrowprops=arrow)


def _indicators(axes: Axes, points: np.ndarray, names: Names, color: str) -> None:
    """Draw triangles with names in the right margin;
    call it last in a panel, since it reads the panel's limits.
    """
    axes.plot(*points.T, ls="", marker="^", ms=5, color=color, mec="white", mew=0.4, zorder=3)
    order = points[:, 1].argsort(kind="stable")
    low, high = axes.get_ylim()
    arrow = {
        "arrowstyle": "-",
        "lw": 0.4,
        "color": "#8a919c",
        "shrinkA": 1,
        "shrinkB": 2,
        "relpos": (0, 0.5),
    }
    for height, number in zip(
        spread((points[order, 1] - low) / (high - low), 0.055), order, strict=True
    ):
        axes.annotate(
            names[number],
            tuple(points[number]),
            (1.03, height),
            fontsize=6.5,
            textcoords="axes fraction",
            va="center",
            annotation_clip=False,
            arrowprops=arrow,
        )


def spread(heights: np.ndarray, gap: float) -> np.ndarray:
    """Ascending heights in [0, 1], moved so that they are ``gap`` apart
    (less if there are many) and at most 1.
    """
    steps = min(gap, 1 / max(len(heights), 1)) * np.arange(len(heights))
    spread_out: np.ndarray = (
        np.minimum(np.maximum.accumulate(heights - steps), 1 - steps[-1:].sum()) + steps
    )
    return spread_out


def picture(results: Results) -> Contents:
    """One insertion that explains the method; nothing without what it needs."""
    for experiment, single in results.analysis("explorer"):
        drawn = single and pictures.picture(single, results.params.initializers)
        if drawn:
            yield Content({"experiment": experiment, "picture": drawn})
            return


def explorer(results: Results) -> Contents:
    """The data and the script of the explorer;
    without data if Θ⁰ is of another model than it computes.
    """
    for experiment, single in results.analysis("explorer"):
        data = payload(single, experiment.entities["kind"], results.params) if single else None
        parts = {"data": data, "script": script()} if data else None
        yield Content({"experiment": experiment, "parts": parts, "data": data})
