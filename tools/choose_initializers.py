"""Compare options of initializers by inserting hidden known entities;
the options in params.yaml were chosen so.

Some entities of each D⁰ are hidden, and an embedding is trained without them, since the vectors of
their neighbours in Θ⁰ depend on them. A share of their training triples are insert triples; their
other training triples and their validation triples are queries (scope novel). The novel entities of
the grid point are not used; test triples enter only the counts from which true ranks are computed.
Writes the tables of the documentation.
"""

from dataclasses import replace
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import torch
from matplotlib.figure import Figure
from torch import Tensor

from isi.evaluation.query_sets import query_sets
from isi.evaluation.ranking import Queries, evaluate, make_queries, padded_ids
from isi.graph.sessions import OUT, TRAIN, VALID, Session, membership, touches
from isi.initializers.api import INITIALIZERS, options_of
from isi.models.stack import Embedding
from isi.random import stream
from stages.check_params import Params, load
from stages.grid import GridPoints
from stages.insert import init_context, with_vectors
from stages.make_sessions import sample_insert_triples
from stages.params import StageParams
from stages.report.charts import style_of
from stages.runner import run
from stages.store import Store
from stages.train_theta0 import train_config, train_stack
from tools.choose_models import combinations
from tools.docs import BENCHMARKS, write_table
from tools.figures import STYLE, rendered

Setting = tuple[str, dict[str, Any]]
SIZE, SEEDS = 5, 10  #: |ξ| and number of the grid points.
HIDDEN = 5  #: Hidden entities at each grid point.
STACK = 5
#: MRR* in scope novel; entity MRR* of its queries that give a novel entity; loss of MRR* of earlier
#: validation triples by the novel entities among the candidates.
MEASURES = ("MRR*", "novel entity given", "loss of earlier")
TOLERANCE = 1.0  #: Largest loss of MRR* of earlier triples, in points, of a setting that is chosen.


def measured(
    points: GridPoints, theta0: Embedding, words: np.ndarray, root: int, settings: list[Setting]
) -> np.ndarray:
    """The ``MEASURES`` of hidden entities that are inserted with each setting;
    shape (settings, M, measures).
    """
    novel, session, context = (
        points.novel_ids,
        points.session(1),
        init_context(points, theta0, words, root),
    )
    of_novel = query_sets(session, novel, points.insert_mask)["novel"]
    asked = {"novel": of_novel, "about": about(of_novel, novel)}, earlier(session, novel)
    measures = []
    for name, options in settings:
        vectors = INITIALIZERS.get(name, name).initialize(context, options).vectors
        inserted = with_vectors(theta0, novel, vectors)
        results = {name: r for queries in asked for name, r in evaluate(inserted, queries).items()}
        result = {name: r.measures.numpy().T for name, r in results.items()}
        loss = result["known_closed"][0] - result["known"][0]
        measures.append([result["novel"][0], result["about"][1], loss])
    return np.array(measures).transpose(0, 2, 1)


def earlier(session: Session, novel: Tensor) -> dict[str, Queries]:
    """Query sets of known entities' validation triples:
    all entities are candidates, or the known ones.
    """
    valid, filtered = session.members(VALID), session.members(TRAIN, VALID)
    is_novel = membership(novel, session.entities.shape[1])
    queried = valid & ~touches(session.graph, is_novel)
    candidates = {"known": session.entities, "known_closed": session.entities & ~is_novel}
    return {
        name: make_queries(session, padded_ids(queried), queried, filtered, filtered, entities)
        for name, entities in candidates.items()
    }


def about(queries: Queries, novel: Tensor) -> Queries:
    """The queries, with entity weight only where a novel entity is given, rescaled to sum 1;
    ``novel``: (M, n).
    """
    rows, is_novel = queries.rows, membership(novel, queries.candidates.shape[1])
    head, _, tail = rows.ids
    weight = rows.entity_weight * torch.cat([is_novel.gather(1, end) for end in (tail, head)], 1)
    shares = weight / weight.sum(1, keepdim=True)
    return replace(queries, rows=replace(rows, entity_weight=shares))


def hide(points: GridPoints, number: int, draw: int, root: int, fraction: float) -> GridPoints:
    """Grid points whose novel entities are ``number`` entities trained in D⁰ (sample ``draw``);
    no test triples.
    """
    before = points.session(0)
    splits = before.splits.masked_fill(~before.members(TRAIN, VALID), OUT).numpy()
    novel = np.stack(
        [
            np.sort(
                stream(root, "hidden", seed, draw).choice(
                    np.flatnonzero(trained), number, replace=False
                )
            )
            for seed, trained in zip(points.seeds, before.trained().numpy(), strict=True)
        ]
    )
    rows = [
        (model, novel[model].tolist().index(entity), triple)
        for model, seed in enumerate(points.seeds)
        for entity, triple in sample_insert_triples(
            points.graph, splits[model], novel[model], root, 1000 * draw + seed, fraction
        )
    ]
    insert_triples = np.array(rows, dtype=np.int64)
    return replace(points, size=number, splits=splits, novel=novel, insert_triples=insert_triples)


def tasks_of(
    params: Params, experiment: str, settings: list[Setting]
) -> list[tuple[GridPoints, Embedding, np.ndarray, int, list[Setting]]]:
    """Arguments of ``measured`` for hidden entities at grid points; trains the embeddings."""
    store, config = Store(experiment), train_config(StageParams.load())
    fraction = params.sessions.insert_fraction
    hidden = [
        hide(points, HIDDEN, 0, params.seed, fraction) for points in store.grid(STACK, SIZE, SEEDS)
    ]
    trained = run(
        train_stack, [(points, config) for points in hidden], params.compute, f"{experiment}: theta"
    )
    words = store.words()
    return [
        (points, result.theta, words, params.seed, settings)
        for points, result in zip(hidden, trained, strict=True)
    ]


def settings_of(names: list[str], listed: dict[str, dict[str, Any]]) -> list[Setting]:
    """The settings to compare: for each initializer its options in params, then those of its grid;
    no duplicates.
    """
    settings = []
    for name in names:
        chosen = [listed[name]] if name in listed else []
        every = chosen + combinations(INITIALIZERS.get(name, name).grid or {})
        once = {tuple(setting.items()): setting for setting in every}
        settings += [
            (name, options_of(name, setting, f"initializers.{name}")) for setting in once.values()
        ]
    return settings


def main() -> None:
    params = load()
    names = [name for name in INITIALIZERS.names() if INITIALIZERS.get(name, name).grid is not None]
    settings, results = settings_of(names, params.initializers), {}
    for experiment, entry in params.experiments.items():
        if SIZE in entry.sessions.sizes:
            tasks = tasks_of(params, experiment, settings)
            measures = run(measured, tasks, params.compute, experiment)
            results[experiment] = 100 * np.concatenate(measures, 1)
    table = table_of(settings, results)
    table.to_csv(BENCHMARKS / "initializer_options.csv", index=False)
    (BENCHMARKS / "initializers.svg").write_bytes(rendered(frontier(table), "svg"))
    of_params = [shown(params.initializers.get(name, {})) for name in table["initializer"]]
    is_best = ~table["initializer"].duplicated()
    write_table("initializers", table[is_best | (table["options"] == of_params)])


def table_of(settings: list[Setting], results: dict[str, np.ndarray]) -> pd.DataFrame:
    """Rows by initializer, best setting first: means, overall and by experiment;
    arrays: (settings, sets, measures).
    """
    means = {experiment: np.nanmean(values, 1) for experiment, values in results.items()}
    means = {"": np.mean(list(means.values()), 0)} | (means if len(means) > 1 else {})
    columns = {
        f"{experiment}: {name}".removeprefix(": "): values[:, measure].round(2)
        for experiment, values in means.items()
        for measure, name in enumerate(MEASURES)
    }
    names, options = zip(*settings, strict=True)
    table = pd.DataFrame({"initializer": names, "options": list(map(shown, options))} | columns)
    # within the tolerance all are equal
    harm = (table["loss of earlier"] - TOLERANCE).clip(lower=0)
    ordered = table.assign(harm=harm).sort_values(["harm", "MRR*"], ascending=[True, False])
    by_name = ordered.drop(columns="harm").groupby("initializer", sort=False)
    parts = [by_name.get_group((name,)) for name in dict.fromkeys(names)]
    return pd.concat([part.assign(**{"±": deviations(part.index, results)}) for part in parts])


def deviations(rows: pd.Index, results: dict[str, np.ndarray]) -> np.ndarray:
    """Standard error over hidden sets of each setting's MRR* minus that of the first of ``rows``;
    shape (rows,).
    """
    variance = [
        np.nanvar(v[rows, :, 0] - v[rows[0], :, 0], 1) / (v.shape[1] - 1) for v in results.values()
    ]
    return (np.sqrt(np.sum(variance, 0)) / len(results)).round(2)


def frontier(table: pd.DataFrame) -> Figure:
    """Gain about hidden entities against loss of earlier triples for every setting that
    loses at most three points.
    """
    gain, _, loss = MEASURES
    shown = table[table[loss].between(-0.1, 3) & (table[gain] >= 50)]
    with mpl.rc_context(STYLE):
        canvas = Figure(figsize=(8, 5.5), layout="constrained")
        axes = canvas.subplots()
        for name, rows in shown.groupby("initializer", sort=False):
            registered = INITIALIZERS.get(str(name), str(name))
            style = style_of(registered.label)
            look = {"color": style["color"], "marker": style["marker"], "label": registered.label}
            axes.scatter(rows[loss], rows[gain], s=14, **look)
        axes.axvline(TOLERANCE, color="#999999", linewidth=0.8, linestyle="--")
        axes.set(xlabel=f"{loss} triples, MRR* points", ylabel="MRR* about hidden entities")
        axes.set(xlim=(-0.1, 3), ylim=(50, None))
        canvas.legend(loc="outside lower center", ncols=4)
    return canvas


def shown(options: dict[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in options.items()) or "–"


if __name__ == "__main__":
    main()
