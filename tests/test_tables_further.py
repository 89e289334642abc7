"""Tables beyond the paper: a few runs and answers by hand, and the files that git keeps."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from isi.report.tables.data import Experiment, Models
from isi.report.tables.further import Further, VariantRuns
from isi.report.tables.registry import frames_of

ROOT = Path(__file__).parent.parent
TABLES = ROOT / "reports/beyond/tables"
PAPER = yaml.safe_load((ROOT / "data/raw/paper/values.yaml").read_text("utf-8"))
LABELS = {
    "xavier": "Xavier",
    "mean": "Mean",
    "kind_mean": "Kind mean",
    "es": "ES",
    "rs": "RS",
    "ers": "ERS",
    "soft_hybrid": "Soft hybrid",
    "map": "MAP",
    "joint": "Joint",
}
MODELS = Models(LABELS, dict.fromkeys(("es", "rs", "ers"), "isi"))
ENTITIES = pd.DataFrame(
    [
        ("mug", "object", "mug"),
        ("cup board", "object", "cupboard"),
        ("kitchen", "room", "kitchen"),
        ("open", "affordance", "open"),
    ],
    columns=["entity", "kind", "phrase"],
)
TRIPLES = pd.DataFrame(
    [
        ("mug", "atLocation", "kitchen", 3),
        ("mug", "atLocation", "cup board", 2),
        ("mug", "nextTo", "cup board", 4),
        ("cup board", "hasAffordance", "open", 1),
    ],
    columns=["head", "relation", "tail", "count"],
)
#: By model: a value for each seed.
Values = Mapping[str, Sequence[float]]
GIVEN = {"xavier": (0.1, 0.1), "es": (0.5, 0.5), "ers": (0.4, 0.6), "joint": (0.95, 0.95)}


def runs_of(now: Values, later: Values, size: int = 5) -> pd.DataFrame:
    """MRR* right after insertion by seed, and by epoch from 0 on for the first seed."""
    rows = [
        (model, scope, seed, 0, value)
        for model, values in now.items()
        for seed, value in enumerate(values)
        for scope in ("all", "novel")
    ]
    rows += [
        (model, "novel_heldout", 0, epoch, value)
        for model, values in later.items()
        for epoch, value in enumerate(values)
    ]
    frame = pd.DataFrame(rows, columns=["model", "scope", "seed", "epoch", "mrr_star"])
    halves = {"mrr_star_entity": frame["mrr_star"] / 2, "mrr_star_relation": frame["mrr_star"]}
    return frame.assign(size=size, session=1, queries=4, **halves)


def queries_of(given: Values, size: int = 5) -> pd.DataFrame:
    """Queries that give the novel entity, with all true triples left out a tenth more; others have
    another value.
    """
    rows = [
        (model, seed, hidden, novel, scope, name, value + more)
        for model, values in given.items()
        for seed, value in enumerate(values)
        for hidden, novel, scope, name, more in (
            ("tail", "given", "novel", "learned", 0.0),
            ("head", "answer", "novel", "learned", 0.2),
            ("relation", "given", "novel", "learned", 0.3),
            ("tail", "given", "all", "true", 0.1),
            ("relation", "given", "all", "true", 0.1),
        )
    ]
    columns = ["model", "seed", "hidden", "novel", "scope", "filter", "mrr_star"]
    frame = pd.DataFrame(rows, columns=columns)
    return frame.assign(size=size, relation="on", queries=2, observations=1)


def variant(
    group: str,
    given: Values,
    *,
    now: Values | None = None,
    later: Values | None = None,
    name: str = "home",
    **entry: Any,
) -> VariantRuns:
    usual = {"title": group, "group": group, "size": 5, "finetuned": True}
    settings = SimpleNamespace(**usual | {"max_insert_triples": None} | entry)
    settings.initializers = [model for model in given if model != "joint"]
    return VariantRuns(
        name=name,
        title=f"the {name} graph",
        models=MODELS,
        initializers=settings.initializers,
        runs=runs_of(now or given, later or {}),
        queries=queries_of(given),
        margin=0.08,
        max_epochs=9,
        variant=settings,
        key=group,
        entities=ENTITIES,
        triples=TRIPLES,
    )


def experiment(
    name: str, now: Values, size: int = 5, runs: pd.DataFrame | None = None
) -> Experiment:
    names = [model for model in now if model != "joint"]
    sessions = SimpleNamespace(sizes=[5, 9])
    settings = SimpleNamespace(sessions=sessions, full_curves=SimpleNamespace(sizes=[5]))
    made = Experiment(
        name=name,
        title=f"the {name} graph",
        models=MODELS,
        initializers=names,
        runs=runs_of(now, {}, size) if runs is None else runs,
        queries=queries_of(now, size),
        margin=0.08,
        max_epochs=9,
        finetuned=names,
        params=SimpleNamespace(experiments={name: settings}),
    )
    made.__dict__.update(entities=ENTITIES, triples=TRIPLES)  # in place of the cached properties
    return made


def tables_of(*variants: VariantRuns, **fields: Any) -> dict[str, pd.DataFrame]:
    made = {"experiments": [experiment("home", GIVEN)], "graphs": []} | fields
    return frames_of("beyond", Further(PAPER, variants=list(variants), **made))


def header(name: str) -> list[str]:
    return list(pd.read_csv(TABLES / f"{name}.csv", nrows=0))


def test_stronger_initializers_are_sorted_and_compared_with_ers_seed_by_seed() -> None:
    now = {"xavier": (0.2, 0.2), "es": (0.3, 0.3), "ers": (0.4, 0.4), "joint": (0.8, 0.8)}
    given = GIVEN | {"map": (0.6, 0.9)}
    frame = tables_of(variant("baselines", given, now=now | {"map": (0.6, 0.6)}))["strong_home"]
    assert list(frame) == header("strong_ai2thor")
    rows = frame.set_index("model")
    assert rows.index.tolist() == ["Joint", "MAP", "ES", "ERS", "Xavier"]
    assert rows["novel entity given"].tolist() == pytest.approx([95, 75, 50, 50, 10])
    assert rows["all"].tolist() == rows["novel"].tolist() == pytest.approx([80, 60, 30, 40, 20])
    minus = "novel entity given, minus ERS"
    assert rows[minus].tolist() == pytest.approx([45, 25, 0, 0, -40])
    # Student's t of two seeds, 20 and 30
    assert rows.loc["MAP", f"{minus} high"] == pytest.approx(25 + 12.7062 * 5)


def test_insert_triples_and_words_have_a_row_for_each_variant() -> None:
    fewer = [
        variant("insert_triples", {"ers": (value, value + 0.2)}, max_insert_triples=number)
        for number, value in ((0, 0.1), (2, 0.3), (None, 0.5))
    ]
    other = variant("insert_triples", {"ers": (0.9, 0.9)}, name="away")
    words = [variant("words", {"es": (0.4, 0.4)}, title=title) for title in ("one", "other")]
    made = tables_of(*fewer, other, *words)
    frame = made["n_insert_triples"]
    assert frame["insert triples"].tolist() == ["0", "2", "all"]
    assert frame["ERS"].tolist() == pytest.approx([20, 40, 60])
    assert made["other_words"][["words", "ES"]].to_numpy().tolist() == [
        ["one", pytest.approx(40)],
        ["other", pytest.approx(40)],
    ]


def test_embedding_models_have_a_row_for_each_graph_that_they_ran_on() -> None:
    given = {"xavier": (0.1, 0.1), "es": (0.2, 0.4), "mean": (0.2, 0.2), "joint": (0.9, 0.9)}
    made = tables_of(
        variant("embeddings", given, title="ANALOGY"),
        variant("embeddings", given, title="ANALOGY", name="away"),
        variant("embeddings", given, title="TransE"),
    )
    frame = made["embeddings_novel_given"]
    rows = frame[["graph", "embedding"]].agg(", ".join, axis=1).tolist()
    assert rows == [
        f"the {name}"
        for name in ("home graph, ANALOGY", "home graph, TransE", "away graph, ANALOGY")
    ]
    assert frame["ES"].tolist() == pytest.approx([30] * 3)


def test_each_cause_has_its_gain_over_xavier_and_its_epochs() -> None:
    main = {"xavier": [0.4], "es": [0.5], "rs": [0.6], "ers": [0.7], "joint": [0.9]}
    larger = runs_of(main | {"xavier": [0.2]}, {}, 9)
    first = experiment("home", main, runs=pd.concat([runs_of(main, {}), larger]))
    second = experiment("away", dict.fromkeys(main, (0.5,)))
    now = {"xavier": [0.25], "es": [0.5], "rs": [0.25], "ers": [0.75], "joint": [0.9]}
    decay = variant("causes", now, title="another decay", finetuned=False)
    later = {"xavier": [0.1, 0.5, 0.9], "es": [0.9, 0.9, 0.9], "joint": [0.9]}
    curves = variant("causes", now, later=later, title="their way")
    made = tables_of(decay, curves, experiments=[first, second])
    frame = made["causes"]
    assert list(frame) == header("causes")
    nan = np.nan
    paper = [nan, nan, nan, (41.4 + 37.6 + 42.1) / 3, 112.6, (16.6 + 27.1 + 29.9) / 3]
    expected = {
        "this run, 5 novel entities": [90, 40, 60, 50, 9, 9],
        "9 novel entities, 225 % of all": [90, 20, 60, 200, 9, 9],
        "entity prediction alone": [45, 20, 30, 50, nan, nan],
        "all true triples left out of the candidates": [100, 50, 70, 40, nan, nan],
        "another decay (the home graph)": [90, 25, 50, 100, nan, nan],
        "their way (the home graph)": [90, 25, 50, 100, 9, 9],
        "the away graph, 5 novel entities": [50, 50, 50, 0, 0, 0],
        "the paper": paper,
    }
    assert frame["row"].tolist() == list(expected)
    for values, row in zip(expected.values(), frame.to_numpy()[:, 1:], strict=True):
        assert row.tolist() == pytest.approx(values, nan_ok=True)


def test_nothing_is_compared_without_isi_or_xavier() -> None:
    only = experiment("home", {"xavier": [0.5], "joint": [0.5]})
    assert tables_of(variant("causes", GIVEN), experiments=[only]) == {}


def test_graphs_stand_side_by_side() -> None:
    given = GIVEN | {"kind_mean": (0.5, 0.5), "map": (0.6, 0.6), "soft_hybrid": (0.5, 0.5)}
    main = experiment("home", {"es": (0.2, 0.4), "ers": (0.6, 0.6), "joint": (0.9, 0.9)})
    main.__dict__.update(entities=ENTITIES.head(2))
    of_other_size = experiment("away", GIVEN, size=9)
    lab = variant("graphs", given, later={"es": [0.5, 0.9], "joint": [0.9]}, name="lab")
    made = tables_of(experiments=[main, of_other_size], graphs=[lab])
    for name in ("graphs_novel_given", "graphs_gains"):
        assert made[name]["graph"].tolist() == ["the home graph", "the lab graph"], name
    assert made["graphs_novel_given"]["ES"].tolist() == pytest.approx([30, 50])
    gains = made["graphs_gains"].set_index("graph").loc["the lab graph"]
    assert gains["ERS minus Xavier"] == pytest.approx(40)
    assert gains["ERS minus Xavier low"] == pytest.approx(40 - 12.7062 * 10)
    assert gains["MAP minus Soft hybrid"] == pytest.approx(10)
    sizes = made["graphs"]
    assert list(sizes) == header("graphs")
    row = sizes.set_index("graph").loc["the lab graph"].tolist()
    # of the two triples to a cup board, one is predicted
    assert row == [10, 4, 3, 4, "2 object, 1 room, 1 affordance", 75]
