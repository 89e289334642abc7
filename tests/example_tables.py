"""Three valid rows of every table, and ways to change a file on disk."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import torch

from isi.analyses.finetuning import INDICATOR_SWEEP, RATE_SWEEP
from isi.analyses.joint_models import CROSS_VALIDATION, MODEL_COMPARISON
from isi.analyses.query_breakdown import AFFORDANCES, QUERY_BREAKDOWN, USED_COORDINATES
from isi.analyses.readings import ANSWERS, RANKS, READINGS
from isi.analyses.variants import VARIANT_QUERIES, VARIANT_RUNS
from isi.experiment.store import INSERTED, RUNS, TIES, TRAINING_LOG
from isi.extras.hidden_entities import HIDDEN_ENTITIES
from isi.graph.graph import ENTITIES, TRIPLES
from isi.graph.sessions import INSERT_TRIPLES, NOVEL, SPLITS
from isi.graph.words import COVERAGE
from isi.sources import KINDS, MINED, OBSERVATIONS
from isi.tables.table import Table

#: Measures of three runs, the second without queries.
MEASURED: dict[str, Any] = {
    "mrr_star": [0.5, None, 0.75],
    "mrr_star_entity": [0.25, None, 1 / 2],
    "mrr_star_relation": [0.75, None, 1.0],
    "mrr": [1 / 3, None, 0.1],
    "queries": [4, 0, 7],
}
LOOKED: dict[str, Any] = {name: [0.5, 0.25, 0.75] for name in list(MEASURED)[:4]}
CELLS: dict[str, Any] = {"size": [1, 1, 2], "seed": [0, 1, 0], "session": 1}
MEASURED_RUNS: dict[str, Any] = {
    **CELLS,
    **MEASURED,
    "epoch": [0, 0, 3],
    "scope": ["all", "novel", "known"],
}
QUERIES: dict[str, Any] = {
    **CELLS,
    "model": ["es", "joint", "es"],
    "scope": "novel",
    "filter": ["learned", "true", "true"],
    "relation": "atLocation",
    "hidden": ["tail", "head", "relation"],
    "novel": ["given", "answer", "none"],
    "queries": [3, 1, 2],
    "mrr_star": [0.5, 1 / 3, 1.0],
    "mrr": [0.0, 1.0, 0.25],
    "observations": [3, 2**40, 7],
}
#: Models of a case of ``readings``, and choices of a reading.
INSERTED_MODELS: dict[str, Any] = {
    "model": ["es", "es", "joint"],
    "k": [0, 3, 0],
    "size": 2,
    "seed": [0, 0, 1],
}
CHOICES: dict[str, Any] = {
    "queries": "test",
    "about": ["any", "both", "any"],
    "weights": "triple",
    "slots": "halves",
    "filter": "none",
    "truth": "split",
}
ROWS: dict[Table, dict[str, Any]] = {
    OBSERVATIONS: {"scene": ["one", None, "one"], "room": ["kitchen", None, "kitchen"],
                   "relation": "atLocation", "instance": ["m|1", None, "m|2"],
                   "head": ["mug", "bed", "mug"], "tail": ["room", "bed", "mug"],
                   "count": [1, 7, 10**9 - 8]},
    KINDS: {"entity": ["mug", "bed", "café"], "kind": ["object", "object", "room"],
            "phrase": ["mug", "bed", "bar"]},
    MINED: {"step": ["all", "some", "few"], "instances": [2**40, 10, 0]},
    ENTITIES: {"entity": ["bed", "mug", "fan"], "kind": "object",
               "source": ["home", "home", "shop"], "phrase": ["bed", "mug", "a fan"]},
    TRIPLES: {"head": ["bed", "mug", "fan"], "relation": ["in", "in", "at"],
              "tail": ["mug", "bed", "bed"], "count": [1, 2, 3],
              "source": ["home", "home", "shop"]},
    COVERAGE: {"entity": ["bed", "mug", "fan"], "phrase": ["bed", "mug", "a fan"],
               "served_by": ["bed", None, "fan"]},
    SPLITS: {"seed": [0, 0, 1], "triple": [0, 2, 0], "split": ["train", "test", "valid"]},
    NOVEL: {"size": [1, 2, 2], "seed": 0, "entity": [4, 1, 3], "session": 1},
    INSERT_TRIPLES: {"size": [1, 2, 2], "seed": 0, "entity": [4, 1, 1], "triple": [0, 1, 3],
                     "session": 1},
    TRAINING_LOG: {"size": 0, "seed": [0, 0, 1], "epoch": [5, 10, 5], **LOOKED,
                   "kept": [True, False, True]},
    RUNS: MEASURED_RUNS,
    INSERTED: {**CELLS, **MEASURED, "entity": [4, 5, 1], "kind": ["object", "room", "object"],
               "fallback": [None, "es", "centroid"], "ties": [0, 1, 2]},
    INDICATOR_SWEEP: {**MEASURED_RUNS, "k": [1, 4, 4]},
    RATE_SWEEP: {**MEASURED_RUNS, "factor": [0.5, 2.0, 2.0]},
    CROSS_VALIDATION: {"dimension": [40, 40, 100], "ratio": 9, "learning_rate": [0.1, 0.2, 0.1],
                       "weight_decay": 0.001, "fold": [0, 0, 1], **LOOKED, "epoch": [5, 10, 15]},
    MODEL_COMPARISON: {**MEASURED, "seed": [0, 1, 2], "epochs": [20, 55, 5],
                       "valid_mrr_star": [0.5, 0.0, 1.0]},
    AFFORDANCES: {"initializer": ["rs", "rs", "es"], "seed": 0, "entity": 3, "answer": [0, 1, 0],
                  "rank": [2, 1, 2]},
    QUERY_BREAKDOWN: QUERIES,
    VARIANT_RUNS: {**MEASURED_RUNS, "experiment": ["away", "home", "home"],
                   "model": ["es", "es", "joint"]},
    VARIANT_QUERIES: {**QUERIES, "experiment": ["away", "home", "home"]},
    USED_COORDINATES: {"seed": [0, 0, 1], "model": "joint", "relation": ["in", None, "in"],
                       "part": "scalars", "used": [0, 2, 1], "of": 2},
    TIES: {**CELLS, "scope": ["all", "known", "all"], "ties": [0, 9, 2]},
    HIDDEN_ENTITIES: {"method": ["insert", "insert", "retrained"],
                      "initializer": ["es", "es", None], "told": [1, None, None], "seed": [0, 0, 1],
                      "asked": ["known", "hidden", "earlier"], "entities": 5, "queries": [4, 4, 9],
                      "mrr": [0.5, 1 / 3, 1.0], "hits_at_10": [0.0, 0.5, 1.0],
                      "trained_with": ["softmax", "logistic", None],
                      "estimated_loss": [None, None, 0.01]},
    RANKS: {**INSERTED_MODELS, "triple": 7, "hidden": ["head", "relation", "tail"],
            "relation": "in", "split": ["train", "valid", "test"], "novel": [0, 1, 1],
            "count": [1, 2**40, 3], **{f"closeness_{which}_{truth}": [0.5, 1.0, 1 / 3]
                                       for which in ("learned", "true", "none") for truth in ("all",
                                                                                              "split")},
            **{f"rank_{which}": [1.0, 2.5, 9.0] for which in ("learned", "true", "none")}},
    READINGS: {**INSERTED_MODELS, **CHOICES, "mrr_star": [0.5, None, 1.0],
               "epochs": [0.0, 50.0, None]},
    ANSWERS: {"model": "ers", "seed": 3, "entity": "bottle", "answer": ["put", "fill", "mug"],
              "kind": ["affordance", "affordance", "object"], "rank": [1, 2, 3]},
}  # fmt: skip


def rows_of(table: Table) -> pd.DataFrame:
    """Three valid rows of a table."""
    frame = pd.DataFrame(ROWS[table], index=range(3))[list(table.columns)]
    return frame.sort_values(["size", "seed", "session"]) if table is INSERTED else frame


Change = Callable[[pd.DataFrame], pd.DataFrame]


def change_table(table: Table, path: Path, change: Change) -> None:
    """Rewrite a table with changed values, without checks."""
    whole = pa.Table.from_pandas(
        change(pd.read_parquet(path)), schema=table.schema, preserve_index=False
    )
    pq.write_table(whole, path)


def change_tensors(path: Path, change: Callable[[dict[str, torch.Tensor]], object]) -> None:
    """Rewrite a file of tensors; ``change`` changes the mapping or its tensors in place."""
    from safetensors.torch import load_file, save_file

    tensors = load_file(path)
    change(tensors)
    save_file({name: tensor.contiguous() for name, tensor in tensors.items()}, path)
