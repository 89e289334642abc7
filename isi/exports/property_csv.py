"""CSV for property graphs: nodes and edges with the headers that Neo4j's importer takes."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from isi.exports import Outgoing, form

NODES = {"entity": ":ID", "phrase": "phrase", "kind": ":LABEL"}
ENDS = {"head": ":START_ID", "tail": ":END_ID", "relation": ":TYPE"}
VALUES = {"count": "count:int", "score": "score:float", "rank": "rank:int"}


@form("property_csv")
def property_csv(out: Outgoing, path: Path) -> dict[Path, str]:
    """A folder: ``nodes.csv``, ``edges.csv`` and, where there are any, ``predictions.csv``."""
    files = {"nodes": (out.entities, NODES), "edges": (out.triples, ENDS | VALUES)}
    if len(out.predictions):
        files["predictions"] = (out.predictions, ENDS | VALUES)
    return {path / f"{name}.csv": _csv(table, headers) for name, (table, headers) in files.items()}


def _csv(table: pd.DataFrame, headers: dict[str, str]) -> str:
    there = {column: header for column, header in headers.items() if column in table.columns}
    return str(table[list(there)].rename(columns=there).to_csv(index=False, lineterminator="\n"))
