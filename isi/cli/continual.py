"""``isi continual``: describes a graph that grows, and what published protocols count wrongly."""

from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from cyclopts import Parameter

from isi.cli import Json, flags, show
from isi.continual.faults import fault_shares
from isi.continual.timeline import Timeline


def continual(
    name: Annotated[
        str, Parameter(name="NAME", help="ENTITY, FACT, GraphEqual, FBinc-S, ..., or a folder")
    ],
    /,
    *,
    json: Json = False,
) -> None:
    """Read a benchmark that ships with the checkout, or a folder of snapshots as LKGE writes it:
    ``0``, ``1``, ..., each with ``train.txt``, ``valid.txt`` and ``test.txt``.
    """
    with flags(name="NAME"):
        is_folder = Path(name).is_dir()
        timeline = Timeline.from_folder(name) if is_folder else Timeline.benchmark(name)
    shown = {
        "snapshots": timeline.table().to_dict("records"),
        "percent_of_queries_that_a_fault_touches": percentages(fault_shares(timeline)),
    }
    show(shown, json)


def percentages(faults: pd.DataFrame) -> list[dict[Any, Any]]:
    """A row for each fault: its percent of the queries of each test set, None without queries."""
    by_test = (100 * faults.pivot(index="fault", columns="test", values="share")).round(1)
    by_test = by_test.add_prefix("test ")
    table = by_test.loc[faults["fault"].unique()].reset_index().astype(object)
    return table.where(table.notna(), None).to_dict("records")
