"""Convergence of fine-tuning: when Θ¹ is about as good as the joint model (section 6.2)."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

#: Query sets in which a run has to converge.
SCOPES = ("all", "novel_heldout")


def epochs_to_convergence(
    runs: pd.DataFrame, joint: pd.DataFrame, margin: float, max_epochs: int, by: Sequence[str]
) -> pd.DataFrame:
    """The first epoch at which each run is within the margin of the joint model of the same scope, size and seed.

    Args:
        runs: in the columns of ``catalogue.RUNS`` and those of ``by``, which distinguish runs of one grid point.
        joint: the joint models' MRR*, likewise.
        max_epochs: the epochs of runs that do not converge.

    Returns:
        columns of ``by``, scope, size, seed, epochs, converged, queries; grid points without queries are left out.
    """
    keys = ["scope", "size", "seed"]
    target = joint[joint["scope"].isin(SCOPES)].set_index(keys)["mrr_star"] - margin
    measured = runs[runs["scope"].isin(SCOPES)].join(target.rename("target"), on=keys).dropna(subset=["mrr_star"])
    groups = [*by, *keys]
    reached = measured[measured["mrr_star"] >= measured["target"]].groupby(groups, observed=True)["epoch"].min()
    table = measured.groupby(groups, observed=True)["queries"].first().to_frame()
    table["converged"] = table.index.isin(reached.index)
    table["epochs"] = reached.reindex(table.index).fillna(max_epochs)
    return table.reset_index()
