"""Three valid rows of tables of every kind, and ways to change a file on disk."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import torch

from isi.tables.table import Table
from stages.breakdown import QUERY_BREAKDOWN
from stages.files import ENTITIES, OBSERVATIONS, TRIPLES
from stages.mine import MINED
from stages.store import RUNS, TRAINING_LOG

#: Measures of three runs, the second without queries.
MEASURED: dict[str, Any] = {
    "mrr_star": [0.5, None, 0.75],
    "mrr_star_entity": [0.25, None, 1 / 2],
    "mrr_star_relation": [0.75, None, 1.0],
    "mrr": [1 / 3, None, 0.1],
    "mrr_entity": [1 / 3, None, 0.2],
    "mrr_relation": [1 / 3, None, 0.0],
    "queries": [4, 0, 7],
}
CELLS: dict[str, Any] = {"size": [1, 1, 2], "seed": [0, 1, 0]}
#: Tables that have every type of column, with and without nulls, keys in and out of order.
ROWS: dict[Table, dict[str, Any]] = {
    OBSERVATIONS: {"scene": ["one", None, "one"], "room": ["kitchen", None, "kitchen"],
                   "relation": "atLocation", "instance": ["m|1", None, "m|2"],
                   "head": ["mug", "bed", "mug"], "tail": ["room", "bed", "mug"],
                   "count": [1, 7, 10**9 - 8]},
    MINED: {"step": ["all", "some", "few"], "instances": [2**40, 10, 0]},
    ENTITIES: {"entity": ["bed", "mug", "café"], "kind": "object",
               "source": ["home", "home", "shop"], "phrase": ["bed", "mug", "a bar"]},
    TRIPLES: {"head": ["bed", "mug", "fan"], "relation": ["in", "in", "at"],
              "tail": ["mug", "bed", "bed"], "count": [1, 2, 3],
              "source": ["home", "home", "shop"]},
    TRAINING_LOG: {"size": 0, "seed": [0, 0, 1], "epoch": [5, 10, 5], "mrr_star": 0.5,
                   "mrr_star_entity": 0.25, "mrr_star_relation": [0.5, 0.25, 0.75], "mrr": 1 / 3,
                   "mrr_entity": 1 / 3, "mrr_relation": 1 / 3, "kept": [True, False, True]},
    RUNS: {**CELLS, **MEASURED, "epoch": [0, 0, 3], "scope": ["held_out", "novel", "known"]},
    QUERY_BREAKDOWN: {**CELLS, "model": ["es", "joint", "es"], "scope": "novel",
                      "relation": "atLocation", "hidden": ["tail", "head", "relation"],
                      "novel": ["given", "answer", "none"],
                      "queries": [3, 1, 2], "mrr_star": [0.5, 1 / 3, 1.0],
                      "mrr": [0.0, 1.0, 0.25], "observations": [3, 2**40, 7]},
}  # fmt: skip


def rows_of(table: Table) -> pd.DataFrame:
    """Three valid rows of a table."""
    return pd.DataFrame(ROWS[table], index=range(3))[list(table.columns)]


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
