"""Mistakes in command lines about graphs (``isi graph``)."""

import pandas as pd

from tests.mistakes.calls import Typed, params, put


def texts() -> None:
    columns = {"head": ["a"], "relation": ["b"], "tail": ["c"], "count": ["two"]}
    pd.DataFrame(columns).to_parquet("log.parquet")


GRAPH_CASES = [
    Typed(
        "a setting that is nested too deep",
        f"graph log.csv --set kinds={'[' * 3000}",
        "--set",
        status=2,
    ),
    Typed("JSON in another encoding", "graph a.json", "a.json", before=put({"a.json": b"\xff"})),
    Typed(
        "lists in lists, 200,000 deep",
        "graph a.json",
        "a.json",
        before=put({"a.json": "[" * 200_000}),
    ),
    Typed(
        "a source of words whose name is too long",
        "graph log.csv",
        "'xxxxxxxxxxxxxxxxxxxxxxxxxxx...xxxxxxxxxxxxxxxxxxxxxxxxxxxx'",
        before=params({"words.source": "x" * 300}),
    ),
]
