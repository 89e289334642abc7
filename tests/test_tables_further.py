"""Tables beyond the paper: a few runs and answers by hand, and the files that git keeps."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from stages.report.tables.data import Experiment, ModelLabels
from stages.report.tables.estimates import ENDS
from stages.report.tables.further import Further, VariantRuns
from stages.report.tables.registry import frames_of

ROOT = Path(__file__).parent.parent
TABLES = ROOT / "reports/beyond/tables"
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
MODELS = ModelLabels(LABELS, dict.fromkeys(("es", "rs", "ers"), "isi"))
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


def runs_of(now: Values, size: int = 5) -> pd.DataFrame:
    """MRR right after insertion by seed."""
    rows = [
        (model, scope, seed, value)
        for model, values in now.items()
        for seed, value in enumerate(values)
        for scope in ("held_out", "novel")
    ]
    frame = pd.DataFrame(rows, columns=["model", "scope", "seed", "mrr"])
    return frame.assign(mrr_entity=frame["mrr"] / 2, epoch=0, size=size, queries=4)


def queries_of(given: Values, size: int = 5) -> pd.DataFrame:
    """Queries that give the novel entity; others have another value."""
    rows = [
        (model, seed, hidden, novel, value + more)
        for model, values in given.items()
        for seed, value in enumerate(values)
        for hidden, novel, more in (
            ("tail", "given", 0.0),
            ("head", "answer", 0.2),
            ("relation", "given", 0.3),
        )
    ]
    frame = pd.DataFrame(rows, columns=["model", "seed", "hidden", "novel", "mrr"])
    return frame.assign(scope="novel", size=size, relation="on", queries=2, observations=1)


def variant(
    group: str,
    given: Values,
    *,
    now: Values | None = None,
    name: str = "home",
    **entry: Any,
) -> VariantRuns:
    usual = {"title": group, "group": group, "size": 5, "seeds": 2, "max_insert_triples": None}
    settings = SimpleNamespace(**usual | entry)
    settings.initializers = [model for model in given if model != "joint"]
    return VariantRuns(
        name=name,
        title=f"the {name} graph",
        models=MODELS,
        initializers=settings.initializers,
        runs=runs_of(now or given),
        queries=queries_of(given),
        margin=0.08,
        max_epochs=9,
        variant=settings,
        key=group,
        entities=ENTITIES,
        triples=TRIPLES,
    )


def experiment(name: str, now: Values, size: int = 5) -> Experiment:
    made = Experiment(
        name=name,
        title=f"the {name} graph",
        models=MODELS,
        initializers=[model for model in now if model != "joint"],
        runs=runs_of(now, size),
        queries=queries_of(now, size),
        margin=0.08,
        max_epochs=9,
    )
    made.__dict__.update(entities=ENTITIES, triples=TRIPLES)  # in place of the cached properties
    return made


def tables_of(*variants: VariantRuns, **fields: Any) -> dict[str, pd.DataFrame]:
    made = {"experiments": [experiment("home", GIVEN)], "graphs": []} | fields
    return frames_of("beyond", Further(variants=list(variants), **made))


def header(name: str) -> list[str]:
    return list(pd.read_csv(TABLES / f"{name}.csv", nrows=0))


def test_stronger_initializers_are_sorted_and_compared_with_ers_seed_by_seed() -> None:
    now = {"xavier": (0.2, 0.2), "es": (0.3, 0.3), "ers": (0.4, 0.4), "joint": (0.8, 0.8)}
    given = GIVEN | {"map": (0.6, 0.9)}
    frame = tables_of(variant("baselines", given, now=now | {"map": (0.6, 0.6)}))["strong_home"]
    titles = ["held_out", "novel", "novel entity given", "novel entity given, minus ERS"]
    assert list(frame) == ["model", *(f"{name}{end}" for name in titles for end in ENDS)]
    rows = frame.set_index("model")
    assert rows.index.tolist() == ["Joint", "MAP", "ES", "ERS", "Xavier"]
    assert rows["novel entity given"].tolist() == pytest.approx([95, 75, 50, 50, 10])
    assert (
        rows["held_out"].tolist() == rows["novel"].tolist() == pytest.approx([80, 60, 30, 40, 20])
    )
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


def test_graphs_stand_side_by_side() -> None:
    given = GIVEN | {"kind_mean": (0.5, 0.5), "map": (0.6, 0.6), "soft_hybrid": (0.5, 0.5)}
    main = experiment("home", {"es": (0.2, 0.4), "ers": (0.6, 0.6), "joint": (0.9, 0.9)})
    main.__dict__.update(entities=ENTITIES.head(2))
    of_other_size = experiment("away", GIVEN, size=9)
    lab = variant("graphs", given, name="lab")
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
