"""Small results of experiments and analyses for tests of the report."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
import yaml

from isi.config import check
from isi.experiment.grid import GridPoints
from isi.graph.graph import MinedSource, build_graph
from isi.models.stack import Embedding
from isi.params import Params
from isi.report import page
from isi.report.data import Experiment, Results
from isi.report.explorer import Explored
from isi.report.figures import Figure, rendered
from isi.report.page import Page
from isi.report.section import FilledSection
from isi.report.tables import ReportTable
from isi.report.words import JOINT
from isi.tables import paths
from tests.small_graphs import ANALOGY

ROOT = Path(__file__).parent.parent
SCOPES = ("all", "known", "known_closed", "novel", "novel_heldout")
EPOCHS = 3
#: All sections of both pages.
SECTIONS = [*Page.of("report").sections, *Page.of("beyond").sections]
#: Graphs of the small results: two of one source each, and one that is extended by a second source.
GRAPHS = {
    "home": {"source": "home", "min_count": 1},
    "away": {"source": "away", "min_count": 1},
    "moved": {
        "source": "home",
        "min_count": 1,
        "extend": {"source": "shop", "min_observations": 2, "candidates": 2, "always": ["fan"]},
    },
}
INITIALIZERS = ["xavier", "iu", "es", "rs", "ers", "mean", "es_permuted"]


def runs(rows: Sequence[tuple[str, str, int, int, int, float]]) -> pd.DataFrame:
    """Runs of (model, scope, size, seed, epoch, MRR*) in one session, four queries each."""
    columns = ["model", "scope", "size", "seed", "epoch", "mrr_star"]
    return pd.DataFrame(rows, columns=columns).assign(queries=4, session=1)


def frame_of(rows: Any) -> pd.DataFrame:
    """The frame of a report's table from its rows, as in its CSV file."""
    return ReportTable.of("table", rows).frame


def small_params(experiments: Sequence[str], **changes: Any) -> Params:
    """The params of this repository with small experiments; ``changes``: by dotted key."""
    values = yaml.safe_load((ROOT / "params.yaml").read_text(encoding="utf-8"))
    values["sources"] = {name: {"reader": "published"} for name in ("home", "away", "shop")}
    sessions = {"novel": "any", "sizes": [1, 2], "seeds": 2, "steps": 1}
    values["experiments"] = {
        name: {
            "title": f"the {name} graph",
            "graph": GRAPHS[name],
            "full_curves": {"sizes": [2]},
            "initializers": "all",
            "immediate_only": [],
            "sessions": sessions | ({"novel": "added", "sizes": [2]} if name == "moved" else {}),
        }
        for name in experiments
    }
    studies: dict[str, dict[str, Any]] = {
        "sweep": {"size": 2, "seeds": 2, "k": [1, 2, 4]},
        "rate_sweep": {"size": 2},
        "trajectory": {"size": 2},
        "cross_validation": {},
        "compare_models": {"seeds": 2},
        "affordances": {"entities": ["fan"]},
        "query_breakdown": {},
        "finetune_only": {},
        "final_model": {},
        "explorer": {"size": 2, "seed": 0},
    }
    for name, changed in studies.items():
        values[name] |= changed | {"experiments": []}
    values["finetuning"]["max_epochs"] = EPOCHS
    values["initializers"] = {name: values["initializers"][name] for name in INITIALIZERS}
    values["plots"] = {"initializers": ["es"]}
    for key, value in changes.items():
        place, _, last = key.rpartition(".")
        (values[place] if place else values)[last] = value
    return check(values, Params, "")


@cache
def paper() -> tuple[Any, Any]:
    """The paper's numbers and its vocabulary."""
    folder = ROOT / paths.PAPER.parent
    return tuple(
        yaml.safe_load((folder / f"{name}.yaml").read_text("utf-8"))
        for name in ("values", "vocabulary")
    )  # type: ignore[return-value]


def small_results(
    names: Sequence[str] = tuple(GRAPHS), studies: bool = True, **changes: Any
) -> Results:
    """Results of experiments with random measures, and, with ``studies``, of all analyses.

    The analyses belong to the first experiment, except affordances (the last one) and query
    breakdown (all).
    """
    params = small_params(names, **changes)
    experiments = {name: _experiment(params, name) for name in names}
    if studies:
        queries = {name: _query_breakdown(experiment) for name, experiment in experiments.items()}
        analyses = {name: {"query_breakdown": _used()} for name in names}
        analyses[names[0]] |= _analyses(params, experiments[names[0]])
        analyses[names[-1]] |= {"affordances": _affordances(experiments[names[-1]])}
        experiments = {
            name: replace(experiment, queries=queries[name], analyses=analyses[name])
            for name, experiment in experiments.items()
        }
    values, vocabulary = paper()
    definitions = pd.DataFrame(
        {"phrase": ["cup", "fan"], "definition": ["it breaks", "cools the kitchen"]}
    )
    return Results(
        params=params,
        run={"Versions": {"python": "3"}},
        paper=values,
        vocabulary=vocabulary,
        definitions=definitions,
        experiments=experiments,
        observed=_observed(),
        mined=_mined(),
    )


def of_experiment(results: Results, name: str, **changes: Any) -> Results:
    """Results with changed fields of one experiment."""
    changed = replace(results.experiments[name], **changes)
    return replace(results, experiments={**results.experiments, name: changed})


def with_settings(results: Results, name: str, **changes: Any) -> Results:
    """Results with changed params of one experiment."""
    experiments = results.params.experiments
    entry = experiments[name].model_copy(update=changes)
    params = results.params.model_copy(update={"experiments": experiments | {name: entry}})
    return of_experiment(replace(results, params=params), name, params=params)


def _numbers(rows: list[dict[str, Any]], key: str) -> pd.DataFrame:
    """Rows with random measures, seeded by ``key``; MRR* is the mean of its halves."""
    frame = pd.DataFrame(rows)
    rng = np.random.default_rng(sum(map(ord, key)))
    halves = rng.uniform(0.2, 0.9, (2, len(frame)))
    return frame.assign(
        mrr_star_entity=halves[0],
        mrr_star_relation=halves[1],
        mrr_star=halves.mean(0),
        mrr=halves[0],
    )


def _cells(
    models: Sequence[str], sizes: Sequence[int], epochs: int = EPOCHS, **more: Any
) -> list[dict[str, Any]]:
    return [
        {
            "model": model,
            "scope": scope,
            "size": size,
            "seed": seed,
            "epoch": epoch,
            "queries": 4,
            "session": 1,
        }
        | more
        for model, scope, size, seed in product(models, SCOPES, sizes, (0, 1))
        for epoch in range(1 if model == JOINT or scope == "novel" else epochs + 1)
    ]


def _experiment(params: Params, name: str) -> Experiment:
    initializers, entry, source = (
        params.initializers_of(name),
        params.experiments[name],
        GRAPHS[name]["source"],
    )
    sizes = entry.sessions.sizes
    kinds = {"cup": "object", "kitchen": "room", "break": "affordance", "table": "object"}
    entities = pd.DataFrame({"entity": list(kinds), "kind": list(kinds.values())}).assign(
        source=source
    )
    triples = [
        ("cup", "atLocation", "kitchen", 3),
        ("cup", "hasAffordance", "break", 2),
        ("table", "atLocation", "kitchen", 1),
    ]
    frame = pd.DataFrame(triples, columns=["head", "relation", "tail", "count"]).assign(
        source=source
    )
    if name == "moved":
        entities.loc[len(entities)] = ["fan", "object", "shop"]
        frame.loc[len(frame)] = ["fan", "atLocation", "kitchen", 2, "shop"]
    novel = pd.DataFrame(
        [
            {"size": size, "seed": seed, "entity": entity, "session": 1}
            for size, seed in product(sizes, (0, 1))
            for entity in range(size)
        ]
    )
    inserted = [
        row | {"kind": "object", "fallback": None, "queries": 4, "ties": 0, "model": model}
        for model in initializers
        for row in novel.to_dict("records")
    ]
    inserted[0]["fallback"] = "es"
    log = [
        {"size": 1, "seed": seed, "epoch": epoch, "kept": epoch == 5}
        for seed in (0, 1)
        for epoch in (5, 10)
    ]
    splits = pd.DataFrame(
        [
            {"seed": seed, "triple": triple, "split": "train"}
            for seed in (0, 1)
            for triple in range(len(frame))
        ]
    )
    return Experiment(
        name=name,
        title=entry.title,
        suffix="" if name == next(iter(params.experiments)) else f"_{name}",
        params=params,
        initializers=initializers,
        entities=entities.assign(phrase=entities["entity"]),
        triples=frame,
        coverage=entities.assign(served_by=["file"] * (len(entities) - 1) + [None]),
        splits=splits,
        novel=novel,
        insert_triples=novel.assign(triple=0),
        theta0_log=_numbers(log, name),
        joint_log=_numbers(log, f"{name} joint"),
        runs=_numbers(_cells([*initializers, JOINT], sizes), name),
        queries=None,
        inserted=_numbers(inserted, name),
        ties=pd.DataFrame(_cells([*initializers, JOINT], sizes, epochs=0)).assign(ties=1),
    )


def _observed() -> dict[str, MinedSource]:
    columns = ["scene", "room", "instance", "head", "relation", "tail", "count"]
    home = [
        ("one", "kitchen", "c", "cup", "atLocation", "kitchen", 1),
        ("one", "kitchen", "c", "cup", "hasAffordance", "break", 1),
    ]
    shop = [
        (None, "kitchen", None, "fan", "atLocation", "kitchen", 2),
        (None, "kitchen", None, "cup", "atLocation", "kitchen", 5),
    ]
    kinds = pd.DataFrame(
        {"entity": ["cup", "fan", "kitchen"], "kind": ["object", "object", "room"]}
    )
    return {
        "home": MinedSource("home", pd.DataFrame(home, columns=columns), kinds),
        "away": MinedSource("away", pd.DataFrame(home, columns=columns).assign(scene=None), kinds),
        "shop": MinedSource("shop", pd.DataFrame(shop, columns=columns), kinds),
    }


def _mined() -> dict[str, pd.DataFrame]:
    nothing = pd.DataFrame({"step": pd.Series(dtype=str), "instances": pd.Series(dtype=int)})
    return {
        "home": nothing,
        "away": nothing,
        "shop": pd.DataFrame({"step": ["instances"], "instances": [7]}),
    }


def _query_breakdown(experiment: Experiment) -> pd.DataFrame:
    sizes, filters = experiment.settings.sessions.sizes, ("learned", "true")
    cells = product(experiment.models, sizes, (0, 1), ("all", "novel"), filters)
    queries = product(
        ("atLocation", "hasAffordance"), ("head", "tail", "relation"), ("given", "answer")
    )
    rows = [
        (*cell, *of)
        for cell, of in product(cells, list(queries))
        if of[1:] != ("relation", "answer")
    ]
    columns = ["model", "size", "seed", "scope", "filter", "relation", "hidden", "novel"]
    numbers = np.random.default_rng(3).uniform(0.2, 0.9, len(rows))
    frame = pd.DataFrame(rows, columns=columns).assign(
        session=1, queries=2, observations=3, mrr_star=numbers
    )
    return frame.assign(mrr=numbers)


def _used() -> pd.DataFrame:
    cells = product((0, 1), ("atLocation", None), ("scalars", "blocks"))
    return pd.DataFrame(cells, columns=["seed", "relation", "part"]).assign(
        model=JOINT, used=2, of=4
    )


def _affordances(experiment: Experiment) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {
                "model": model,
                "seed": 0,
                "entity": len(experiment.entities) - 1,
                "answer": answer,
                "rank": answer + 1,
            }
            for model in experiment.initializers
            for answer in range(len(experiment.entities))
        ]
    )


def _analyses(params: Params, experiment: Experiment) -> dict[str, Any]:
    swept = [
        row for k in params.sweep.k for row in _cells(list(params.sweep.initializers), [2], k=k)
    ]
    rates = [
        row for factor in (0.5, 2.0) for row in _cells(experiment.initializers, [2], factor=factor)
    ]
    folds = [
        setting.model_dump() | {"fold": fold, "epoch": 20}
        for setting in params.settings
        for fold in (0, 1)
    ]
    compared = [
        {"model": name, "seed": seed, "epochs": 50, "valid_mrr_star": 0.5, "queries": 4}
        for name in params.compare_models.models
        for seed in (0, 1)
    ]
    rng, number = np.random.default_rng(7), len(experiment.entities)
    traces: dict[str, np.ndarray] = {"entity": np.array([0]), "known": np.arange(number) > 0}
    traces["theta0"] = rng.normal(size=(number, 4))
    for model in ("xavier", "iu", "es", "rs", "ers"):
        traces[f"{model}.path"] = rng.normal(size=(3, 4))
        traces[f"{model}.indicators"] = np.arange(number) > (
            1 if model in ("es", "rs", "ers") else number
        )
    return {
        "sweep": _numbers(swept, "sweep"),
        "rate_sweep": _numbers(rates, "rates"),
        "cross_validation": _numbers(folds, "folds"),
        "compare_models": _numbers(compared, "compared"),
        "trajectory": traces,
        "explorer": explored(experiment),
    }


def explored(experiment: Experiment, dimension: int = 8) -> Explored:
    """The explorer's data of an experiment: its first entity is new to a random Θ⁰,
    in which others are trained.
    """
    graph = build_graph(experiment.entities, experiment.triples)
    splits = np.zeros((1, len(graph.triples)), np.int8)
    points = GridPoints(
        experiment.name, graph, 1, [0], splits, np.array([[[0]]]), np.array([[1, 0, 0, 0]])
    )
    rng = np.random.default_rng(3)
    entity, relation = (
        torch.as_tensor(rng.normal(size=(1, number, dimension)), dtype=torch.float32)
        for number in (len(graph.entities), len(graph.relations))
    )
    theta0 = Embedding(entity * points.session(0).entities[..., None], relation, ANALOGY)
    words = rng.normal(size=(len(graph.entities), 5)).astype(np.float32)
    return Explored(points, theta0, Embedding(entity + 0.1, relation, ANALOGY), words)


@contextmanager
def svg_alone() -> Iterator[None]:
    """Leave PNG files empty, since drawing them takes a quarter of a report's time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            page, "rendered", lambda canvas, form: rendered(canvas, form) if form == "svg" else b""
        )
        yield


def part_of(name: str, results: Results) -> FilledSection | None:
    """A section of either page by its name."""
    return next(section for section in SECTIONS if section.name == name).filled(results)


def shown(name: str, results: Results) -> tuple[str, dict[str, pd.DataFrame], list[Figure]]:
    """Prose of a section, its tables as in CSV files, its figures;
    checks that all can be rendered.
    """
    part = part_of(name, results)
    blocks = part.blocks if part else []
    tables = [block.content for block in blocks if isinstance(block.content, ReportTable)]
    figures = [block.content for block in blocks if isinstance(block.content, Figure)]
    assert all(table.files["md"] for table in tables)
    assert all(rendered(figure.canvas, "svg") for figure in figures)
    text = [block.text.removeprefix("- ") for block in blocks if block.kind == "prose"]
    return "\n".join(text), {table.name: table.frame for table in tables}, figures
