"""Single insertions: Figure 1, the path of one entity through fine-tuning, and the explorer of the page."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patheffects import withStroke

from isi.analyses.single_insertions import HIDDEN, SHOWN, SINGLE_ANSWERS, THETA0, TRUE, ExplorerParams
from isi.errors import InputError
from isi.report.data import Experiment, Results
from isi.report.figures import legend, panels
from isi.report.section import Content
from isi.report.words import JOINT, colour, isi, label

#: Arrays of ``TRAJECTORY``, by name: the path of one entity.
Traces = Mapping[str, np.ndarray]


def trajectory(results: Results) -> Iterator[Content]:
    """Figure 1, and a table of its distances in all dimensions."""
    for experiment, traces in results.analysis("trajectory"):
        names, rows, titles = experiment.entities["entity"], [], {}
        vectors = traces["theta0"][traces["known"]]  # [N, d]
        for model in (name.removesuffix(".path") for name in traces if name.endswith(".path")):
            path = traces[f"{model}.path"].astype(np.float64)  # in all dimensions
            away = float(np.linalg.norm(path[0] - vectors.mean(0, dtype=np.float64)))
            moved = float(np.linalg.norm(path[-1] - path[0]))
            titles[model] = f"{label(model)}: {away:.1f} from the centre, {moved:.1f} to its end"
            rows.append({"initializer": label(model), "from the centre": away, "from where training takes it": moved,
                         "indicators": ", ".join(names[traces[f"{model}.indicators"]])})  # fmt: skip
        numbers = {"share": 100 * plane(vectors)[2], "dimension": vectors.shape[1],
                   "name": str(names[int(traces["entity"][0])]),
                   "away": np.linalg.norm(vectors - vectors.mean(0), axis=1).mean()}  # fmt: skip
        drawn = _drawn(traces, vectors, titles, names)
        yield Content(numbers, {"trajectory": rows}, {"figure1_trajectory": drawn})


def plane(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """The mean (d) of vectors (N, d), two principal axes (2, d) with fixed signs, and their share of the variance."""
    centre = vectors.mean(0, dtype=np.float64)
    _, strength, axes = np.linalg.svd(vectors - centre, full_matrices=False)
    largest = np.abs(axes[:2]).argmax(1)
    turned = axes[:2] * np.sign(axes[[0, 1], largest])[:, None]
    return centre, turned, float((strength[:2] ** 2).sum() / (strength**2).sum())


def _drawn(traces: Traces, vectors: np.ndarray, titles: Mapping[str, str], names: pd.Series) -> Canvas:
    """A panel for each initializer of ISI, and one for the others; a star marks the entity's initial vector."""
    centre, axes, _ = plane(vectors)
    models, methods = list(titles), isi(titles)
    groups = [*([model] for model in methods), [model for model in models if model not in methods]]
    canvas, places = panels(len(groups), height=6.6)
    halo = [withStroke(linewidth=2.5, foreground="white")]
    arrow = {"arrowstyle": "-|>", "lw": 1.4, "shrinkA": 4, "shrinkB": 0}
    for panel, group in zip(places, groups, strict=True):
        panel.plot(*((vectors - centre) @ axes.T).T, ls="", marker="o", ms=2.5, color="#b5bac2", mew=0, zorder=1)
        for model in group:
            points, color = (traces[f"{model}.path"] - centre) @ axes.T, colour(model, models)
            panel.plot(*points.T, color=color, lw=0.8, alpha=0.7, zorder=4)
            panel.annotate(label(model) if len(group) > 1 else "", tuple(points[0]), (7, -10), fontsize=8, color=color,
                           textcoords="offset points", zorder=6, path_effects=halo)  # fmt: skip
            panel.plot(*points[0], ls="", marker="*", ms=11, color=color, mec="black", mew=0.5, zorder=5)
            panel.annotate("", tuple(points[-1]), tuple(points[0]), zorder=4, arrowprops=arrow | {"color": color})
        for model in isi(group):
            chosen = np.flatnonzero(traces[f"{model}.indicators"])
            points = (traces["theta0"][chosen] - centre) @ axes.T
            _indicators(panel, points, names[chosen].tolist(), colour(model, models))
        panel.set(xticks=[], yticks=[])
        panel.set_title("\n".join(titles[model] for model in group), fontsize=9)
    for marker, size, shade, name in (("o", 2.5, "#b5bac2", "known entity"), ("^", 5, "#555555", "indicator"),
                                      ("*", 11, "#555555", "novel entity as inserted")):  # fmt: skip
        places[0].plot([], [], ls="", marker=marker, ms=size, color=shade, label=name)
    places[0].plot([], [], color="#555555", lw=1.4, label="to where training takes it")
    legend(canvas, places)
    return canvas


def _indicators(axes: Axes, points: np.ndarray, names: Sequence[str], color: str) -> None:
    """Draw triangles with names in the right margin; call it last in a panel, since it reads the panel's limits."""
    axes.plot(*points.T, ls="", marker="^", ms=5, color=color, mec="white", mew=0.4, zorder=3)
    order = points[:, 1].argsort(kind="stable")
    low, high = axes.get_ylim()
    arrow = {"arrowstyle": "-", "lw": 0.4, "color": "#8a919c", "shrinkA": 1, "shrinkB": 2, "relpos": (0, 0.5)}
    for height, number in zip(spread((points[order, 1] - low) / (high - low), 0.055), order, strict=True):
        axes.annotate(names[number], tuple(points[number]), (1.03, height), fontsize=6.5, textcoords="axes fraction",
                      va="center", annotation_clip=False, arrowprops=arrow)  # fmt: skip


def spread(heights: np.ndarray, gap: float) -> np.ndarray:
    """Ascending heights in [0, 1], moved so that they are ``gap`` apart (less if there are many) and at most 1."""
    steps = min(gap, 1 / max(len(heights), 1)) * np.arange(len(heights))
    spread_out: np.ndarray = np.minimum(np.maximum.accumulate(heights - steps), 1 - steps[-1:].sum()) + steps
    return spread_out


#: A model and an epoch at which the explorer shows it.
Step = tuple[str, int]
#: Indicators with a weight below ``LEAST`` are omitted; entities in no novel set are listed if at most ``FEW``.
LEAST, FEW = 0.005, 12


def explorer(results: Results) -> Iterator[Content]:
    """The data of the explorer, which ``templates/explorer.js`` shows; ``InputError`` if tables disagree."""
    for experiment, tables in results.analysis("explorer"):
        absent = experiment.entities["entity"].drop(tables["entities"]["entity"]).tolist()
        if tables["entities"].empty:
            return
        try:
            data = _data(experiment, tables, results.params.explorer)
        except KeyError as error:
            expected = f"expected positions and answers of each entity by model and epoch, but {error} is missing"
            path = SINGLE_ANSWERS.path(experiment=experiment.name).with_name(f"{experiment.name}.*.parquet")
            raise InputError(path, "", expected) from error
        yield Content({"experiment": experiment, "data": data, "absent": absent if len(absent) <= FEW else []})


def _data(experiment: Experiment, tables: Mapping[str, pd.DataFrame], settings: ExplorerParams) -> dict[str, Any]:
    """The explorer's data as JSON values: entities by id; coordinates, cosines and weights times 100, or null."""
    models, relations = [*SHOWN, settings.best], sorted(set(tables["answers"]["relation"]))
    steps = [(JOINT, 0), *((model, epoch) for model in models for epoch in (0, settings.epochs))]
    rows, places = tables["entities"], tables["places"]
    indicators = indicators_of(tables["indicators"])
    queries = queries_of(tables["answers"], settings.answers, steps, relations)
    novel = places[places["model"] != THETA0]
    keys = novel[["entity", "model", "epoch"]].itertuples(index=False, name=None)
    place_of = dict(zip(keys, _points(novel), strict=True))
    return {
        "names": experiment.entities["entity"].tolist(), "kinds": experiment.entities["kind"].tolist(),
        "relations": relations,
        "models": [{"name": name, "label": label(name), "colour": colour(name, models)} for name in models],
        "joint": label(JOINT), "epochs": settings.epochs,
        "start": start(experiment, rows.set_index("entity")["told"]),
        "maps": maps_of(places[places["model"] == THETA0], rows),
        "entities": {
            str(entity): {
                "seed": seed, "places": [place_of[entity, *step] for step in steps],
                "indicators": [indicators.get((entity, model)) for model in models], "queries": queries[entity],
            }
            for entity, seed in zip(rows["entity"].tolist(), rows["seed"].tolist(), strict=True)
        },
    }  # fmt: skip


def start(experiment: Experiment, insert_triples: pd.Series) -> int:
    """The entity shown first: the one with most insert triples, of the graph's most common kind if one is shown."""
    kinds = experiment.entities["kind"]
    common = (kinds[insert_triples.index] == kinds.mode()[0]).to_numpy()
    return int(insert_triples[common | ~common.any()].idxmax())


def maps_of(known: pd.DataFrame, rows: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """For each seed: ids of the known entities, their places, and columns ``shown`` and ``fitted`` in per cent."""
    shares = rows.drop_duplicates("seed").set_index("seed")
    return {
        str(seed): {"known": places["entity"].tolist(), "at": _points(places)}
        | {share: round(100 * shares[share][seed]) for share in ("shown", "fitted")}
        for seed, places in known.groupby("seed")
    }


def indicators_of(rows: pd.DataFrame) -> dict[tuple[int, str], dict[str, Any]]:
    """Fallback and indicators (ids, weights, cosines) by (entity, model); weights are None if all are equal."""
    groups: dict[Any, pd.DataFrame] = dict(list(rows[rows["weight"] >= LEAST].groupby(["entity", "model"], sort=False)))
    return {
        place: {
            "fallback": next(iter(group["fallback"].dropna()), None), "ids": group["indicator"].tolist(),
            "weight": _hundredths(group["weight"]) if len(set(group["weight"])) > 1 else None,
            "words": _hundredths(group["by_words"]), "relations": _hundredths(group["by_relations"]),
        }
        for place, group in groups.items()
    }  # fmt: skip


def queries_of(answers: pd.DataFrame, first: int, steps: Sequence[Step], relations: list[str]) -> dict[int, list[Any]]:
    """Queries by entity, those with true answers first; by step, the ``first`` best answers and true answers' ranks."""
    ranked: dict[Any, dict[Step, list[tuple[int, int, Any]]]] = defaultdict(lambda: defaultdict(list))
    columns = ["entity", "relation", "hidden", "model", "epoch", "answer", "rank", "true"]
    for entity, relation, hidden, model, epoch, *answer in answers[columns].itertuples(index=False, name=None):
        ranked[entity, relation, hidden][model, epoch].append(tuple(answer))
    queries = defaultdict(list)
    for (entity, relation, hidden), by_step in ranked.items():
        status = {answer: TRUE.index(true) for answer, _, true in sorted(by_step[JOINT, 0]) if isinstance(true, str)}
        ranks = [{answer: rank for answer, rank, _ in by_step[step]} for step in steps]
        queries[entity].append({
            "relation": relations.index(relation), "hidden": list(HIDDEN).index(hidden),
            "true": list(status), "status": list(status.values()),
            "first": [[answer for answer, rank in of_step.items() if rank <= first] for of_step in ranks],
            "ranks": [[of_step[answer] for answer in status] for of_step in ranks],
        })  # fmt: skip
    return {entity: sorted(group, key=lambda query: not query["true"]) for entity, group in queries.items()}


def _points(places: pd.DataFrame) -> list[list[int]]:
    points: list[list[int]] = (100 * places[["x", "y"]]).round().astype(int).to_numpy().tolist()
    return points


def _hundredths(values: pd.Series) -> list[int | None]:
    return [None if pd.isna(value) else round(100 * value) for value in values]
