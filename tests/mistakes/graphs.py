"""Mistakes in command lines about graphs (``isi graph``, ``export``)."""

import pandas as pd

from isi.graph import graph as tables
from tests.example_tables import change_table
from tests.mistakes.calls import Typed, params, put
from tests.mistakes.commands import anew
from tests.small_bundle import NAMES, small
from tests.small_experiment import write_experiment


def misnamed() -> None:
    write_experiment()
    change_table(
        tables.ENTITIES,
        tables.ENTITIES.path(experiment="home"),
        lambda rows: rows.replace("fill", "fi\tll"),
    )


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
    Typed(
        "a name that no XML can hold",
        "export --home home --format graphml --out x",
        "x|uffff|turtle",
        before=lambda: anew(small(entity_names=["a\uffff", *NAMES[1:]])),
    ),
]
