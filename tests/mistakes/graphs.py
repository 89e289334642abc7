"""Mistakes in command lines about graphs (``isi train --describe``)."""

import pandas as pd

from tests.mistakes.calls import Typed, put


def texts() -> None:
    columns = {"head": ["a"], "relation": ["b"], "tail": ["c"], "count": ["two"]}
    pd.DataFrame(columns).to_parquet("log.parquet")


GRAPH_CASES = [
    Typed(
        "a setting that is nested too deep",
        f"train --describe log.csv --set kinds={'[' * 3000}",
        "--set",
        status=2,
    ),
    Typed(
        "JSON in another encoding",
        "train --describe a.json",
        "a.json",
        before=put({"a.json": b"\xff"}),
    ),
    Typed(
        "lists in lists, 200,000 deep",
        "train --describe a.json",
        "a.json",
        before=put({"a.json": "[" * 200_000}),
    ),
]
