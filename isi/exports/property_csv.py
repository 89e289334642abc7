"""CSV for property graphs: nodes and edges with the headers that Neo4j's importer takes."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from isi.exports import Outgoing, form

NODES = {"entity": ":ID", "phrase": "phrase", "kind": ":LABEL"}
ENDS = {"head": ":START_ID", "tail": ":END_ID", "relation": ":TYPE"}
VALUES = {"count": "count:int", "score": "score:float", "rank": "rank:int"}


@form("property_csv")
def property_csv(out: Outgoing, path: Path) -> dict[Path, str | None]:
    """A folder: ``nodes.csv``, ``edges.csv`` and, where there are any, ``predictions.csv``."""
    return {
        path / "nodes.csv": _csv(out.entities, NODES),
        path / "edges.csv": _csv(out.triples, ENDS | VALUES),
        path / "predictions.csv": _csv(out.predictions, ENDS | VALUES) if len(out.predictions) else None,
    }


def _csv(table: pd.DataFrame, headers: dict[str, str]) -> str:
    there = {column: header for column, header in headers.items() if column in table.columns}
    return str(table[list(there)].rename(columns=there).to_csv(index=False, lineterminator="\n"))
