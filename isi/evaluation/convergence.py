"""Convergence of fine-tuning: when Θ¹ is about as good as the joint model (section 6.2)."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

#: Scopes in which convergence is asked for.
SCOPES = ("all", "novel_heldout")


def epochs_to_convergence(
    runs: pd.DataFrame, joint: pd.DataFrame, margin: float, max_epochs: int, by: Sequence[str]
) -> pd.DataFrame:
    """The first epoch at which each run is within the margin of the joint model of the same scope, size and seed.

    Args:
        runs: in the columns of ``tables.RUNS`` and those of ``by``, which tell runs of one cell apart.
        joint: the joint models' MRR*, likewise.
        max_epochs: what runs that never get there count as.

    Returns:
        columns of ``by``, scope, size, seed, epochs, converged, queries; cells without queries are left out.
    """
    cell = ["scope", "size", "seed"]
    target = joint[joint["scope"].isin(SCOPES)].set_index(cell)["mrr_star"] - margin
    tried = runs[runs["scope"].isin(SCOPES)].join(target.rename("target"), on=cell).dropna(subset=["mrr_star"])
    reached = tried[tried["mrr_star"] >= tried["target"]].groupby([*by, *cell], observed=True)["epoch"].min()
    found = tried.groupby([*by, *cell], observed=True)["queries"].first().to_frame()
    found["converged"] = found.index.isin(reached.index)
    found["epochs"] = reached.reindex(found.index).fillna(max_epochs)
    return found.reset_index()
