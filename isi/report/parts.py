"""MRR* of any part of what was asked (``tables.ASKED``), put together again."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from isi.report.statistics import HALVES

#: Where a query of scope novel has the novel entity.
DIRECTIONS = {"given": "asked about the novel entity", "answer": "the novel entity is the answer"}


def mrr_star(rows: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """MRR* of the queries of each group, with its halves, in [0, 1] (equation 7).

    The entity half is the mean over the head and tail queries of each relation, averaged over the relations
    with their observations as weights; the relation half is the mean over relation queries.

    Args:
        rows: some of ``tables.ASKED``.
        by: columns, those that tell cells apart (size and seed) among them.

    Returns:
        columns of ``by`` and ``HALVES``; a half without queries is null, and MRR* where one is.
    """
    weighted = rows.assign(total=rows["mrr_star"] * rows["queries"])
    of_relations = rows["hidden"] == "relation"
    each = weighted[~of_relations].groupby(list(dict.fromkeys([*by, "relation"])), observed=True)
    sums, weight = each[["total", "queries"]].sum(), each["observations"].first()
    shares = pd.DataFrame({"mean": weight * sums["total"] / sums["queries"], "weight": weight})
    shares = shares.groupby(level=list(by)).sum()
    asked = weighted[of_relations].groupby(list(by), observed=True)[["total", "queries"]].sum()
    halves = pd.DataFrame(
        {"mrr_star_entity": shares["mean"] / shares["weight"], "mrr_star_relation": asked["total"] / asked["queries"]}
    )
    halves["mrr_star"] = halves.mean(axis=1, skipna=False)
    return halves[list(HALVES)].reset_index()


def directed(rows: pd.DataFrame, cell: Sequence[str]) -> pd.DataFrame:
    """The entity half in scope novel by the scope's own filter, with the direction as ``scope``.

    Args:
        rows: some of ``tables.ASKED``.
        cell: columns that tell cells apart.
    """
    own = rows[(rows["scope"] == "novel") & (rows["filter"] == "learned") & (rows["hidden"] != "relation")]
    by_direction = own[own["novel"].isin(list(DIRECTIONS))].drop(columns="scope").rename(columns={"novel": "scope"})
    return mrr_star(by_direction, ["scope", *cell]).drop(columns=["mrr_star", "mrr_star_relation"])
