"""One insertion: Figure 1, the path of an entity through fine-tuning,
and the explorer of the page.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patheffects import withStroke

from isi.report import charts
from isi.report import picture as pictures
from isi.report.charts import FONT, INK, LINE, MUTE, PAPER, FigureLayout, spread
from isi.report.data import Results
from isi.report.explorer import payload, plane, script
from isi.report.figures import Chart
from isi.report.section import Content, Contents
from isi.report.words import Names, isi, label

#: Arrays of ``TRAJECTORY``, by name: the path of one entity.
Traces = Mapping[str, np.ndarray]


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
                f"{label(model)}: starts {away:.1f} from the centre, is moved {moved:.1f}"
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
        drawn = _drawn(traces, vectors, titles, names.tolist())
        yield Content(numbers, {"trajectory": rows}, {"figure1_trajectory": drawn})


def _drawn(
    traces: Traces, vectors: np.ndarray, titles: Mapping[str, str], entities: Names
) -> Chart:
    """A panel for each initializer of ISI, and one for the others;
    a dot with a rim marks the entity's initial vector.
    """
    centre, axes, _ = plane(vectors)
    starts = {name: (traces[f"{name}.path"] - centre) @ axes.T for name in titles}
    flat, known = (traces["theta0"] - centre) @ axes.T, (vectors - centre) @ axes.T
    methods = isi(titles)
    groups = [[model] for model in methods]
    groups.append([model for model in titles if model not in methods])
    height = 360

    def draw(layout: FigureLayout) -> tuple[Canvas, str]:
        canvas, places = charts.panels(layout, len(groups), height)
        for panel, group in zip(places, groups, strict=True):
            charts.dots(panel, known, 4, MUTE, alpha=0.5, zorder=1)
            for model in group:
                color = charts.style_of(model, list(titles))["color"]
                chosen = np.flatnonzero(traces[f"{model}.indicators"] * bool(isi([model])))
                _insertion(panel, starts[model], flat[chosen], color)
                if isi([model]):
                    listed = [entities[place] for place in chosen.tolist()]
                    _indicators(panel, flat[chosen], listed, height - 80)
                else:
                    _beside(panel, starts[model][0], label(model), color)
            charts.framed(panel, "\n".join(titles[model] for model in group))
            panel.grid(visible=False)
            panel.set(xticks=[], yticks=[])
            panel.spines["bottom"].set_color(LINE)
        shown = [panel.get_title(loc="left").replace("\n", "; ") for panel in places]
        return canvas, f"{'. '.join(shown)}."

    return charts.drawn(draw)


def _insertion(panel: Axes, path: np.ndarray, indicators: np.ndarray, color: str) -> None:
    """Draw the lines from the indicators to the initial vector, and the entity's path."""
    for point in indicators:
        panel.plot(*np.stack([point, path[0]]).T, color=color, lw=0.7, alpha=0.6, zorder=2)
    charts.dots(panel, indicators, 6.5, color, zorder=3)
    arrow = {"arrowstyle": "-|>", "lw": 1.6, "shrinkA": 5, "shrinkB": 0, "color": INK}
    panel.plot(*path.T, color=INK, lw=0.8, alpha=0.6, zorder=4)
    panel.annotate("", tuple(path[-1]), tuple(path[0]), zorder=4, arrowprops=arrow)
    charts.dots(panel, path[:1], 13, INK, zorder=5)
    charts.dots(panel, path[:1], 9, color, zorder=6)


def _beside(panel: Axes, point: np.ndarray, text: str, color: str) -> None:
    halo = [withStroke(linewidth=3, foreground=PAPER)]
    place: dict[str, Any] = {"textcoords": "offset points", "path_effects": halo, "zorder": 7}
    panel.annotate(text, tuple(point), (9, -16), color=color, fontsize=FONT, **place)


def _indicators(axes: Axes, points: np.ndarray, listed: Names, height: int) -> None:
    """Name points in the right margin of a panel of about ``height`` pixels;
    call it last in a panel, since it reads the panel's limits.
    """
    order = points[:, 1].argsort(kind="stable")
    low, high = axes.get_ylim()
    arrow = {"arrowstyle": "-", "lw": 0.5, "color": MUTE, "shrinkA": 1, "shrinkB": 2}
    places = spread((points[order, 1] - low) / (high - low), 15 / height)
    for place, number in zip(places, order, strict=True):
        axes.annotate(
            listed[number],
            tuple(points[number]),
            (1.03, place),
            fontsize=FONT - 0.9,
            color=INK,
            textcoords="axes fraction",
            va="center_baseline",
            annotation_clip=False,
            arrowprops=arrow | {"relpos": (0, 0.5)},
        )


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
