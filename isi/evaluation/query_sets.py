"""The paper's measure: which triples are queried about known and about novel entities, with which
filter and candidates, and when fine-tuning has converged.

Its words are those of section 6.1, "the weighted average MRR* across all queries in D¹"; how the
groups are made, weighed and filtered is what the program of its authors does (docs/method.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from isi.evaluation.ranking import MEASURES, Queries, make_queries, padded_ids
from isi.evaluation.scopes import GROUPS
from isi.graph.sessions import TEST, TRAIN, VALID, Session, membership, touches

if TYPE_CHECKING:
    import pandas as pd

MEASURE = "mrr"  #: The measure that decides: every other true triple is left out.


def validation(session: Session) -> dict[str, Queries]:
    """Query set ``valid`` of early stopping: the validation triples,
    filtered by train and valid.
    """
    valid, seen = session.members(VALID), session.members(TRAIN, VALID)
    triples = padded_ids(valid)
    return {"valid": make_queries(session, triples, valid, seen, seen, session.entities)}


def query_sets(session: Session, novel: Tensor, inserted: Tensor) -> dict[str, Queries]:
    """The query sets of D¹ by scope, all but ``weighted``.

    Args:
        session: D¹ of each model.
        novel: ids of the novel entities, (M, n).
        inserted: mask of the insert triples, (M, T), which no query asks for.
    """
    known, new = triples_of_groups(session, novel)
    everyone, true = session.entities, session.members(TRAIN, VALID, TEST)
    triples = padded_ids(known | new)
    train, learned = session.members(TRAIN), session.members(TRAIN, VALID)
    learned_before = learned & ~new
    asked = session.members(TEST) & ~inserted
    asked_of_novel = session.members(VALID, TEST) & new & ~inserted
    of_known = session, triples, known, learned_before, true
    times = times_observed(session) * (new & ~inserted)
    closed = everyone & ~membership(novel, everyone.shape[1])
    return {
        "known": make_queries(*of_known, everyone),
        "novel": make_queries(session, triples, times, learned_before, true, everyone),
        "held_out": make_queries(session, triples, asked, learned, true, everyone),
        "novel_held_out": make_queries(session, triples, asked_of_novel, train, true, everyone),
        "known_closed": make_queries(*of_known, closed),
    }


def triples_of_groups(session: Session, novel: Tensor) -> tuple[Tensor, Tensor]:
    """The unique triples of the groups of D¹: test triples between known entities, and every triple
    with a novel entity; two masks, (M, T). ``novel``: ids, (M, n).
    """
    new = touches(session.graph, membership(novel, session.entities.shape[1]))
    return session.members(TEST) & ~new, session.members(TRAIN, VALID, TEST) & new


def times_observed(session: Session) -> Tensor:
    """How often the files of splits hold each triple: a training triple as often as it was
    observed, any other one once; shape (M, T), int64.
    """
    once = session.members(VALID, TEST).long()
    return torch.where(session.splits == TRAIN, session.graph.counts, once)


def with_weighted(
    rows: pd.DataFrame, shares: Mapping[int, float], measures: Sequence[str] = MEASURES
) -> pd.DataFrame:
    """Rows with those of scope ``weighted``: w · known + (1 - w) · novel, with w by size.

    A row has no queries, if they are counted, and no value where one of the groups has none.
    """
    import pandas as pd

    keys = [name for name in rows if name not in (*measures, "queries", "scope")]
    known, novel = (rows[rows["scope"] == group].set_index(keys) for group in GROUPS)
    novel = novel.reindex(known.index)
    share = known.index.get_level_values("size").map(shares).to_numpy()[:, None]
    weighted = share * known[list(measures)] + (1 - share) * novel[list(measures)]
    if "queries" in rows:
        both = (known["queries"] > 0) & (novel["queries"] > 0)
        weighted["queries"] = (known["queries"] + novel["queries"]).where(both, 0)
    weighted = weighted.assign(scope="weighted").reset_index()
    joined: pd.DataFrame = pd.concat([rows, weighted[list(rows)]], ignore_index=True)
    return joined


def epochs_to_convergence(
    runs: pd.DataFrame,
    joint: pd.DataFrame,
    margin: float,
    max_epochs: int,
    by: Sequence[str],
    measure: str = MEASURE,
) -> pd.DataFrame:
    """The first epoch at which both groups of each run are within the margin of the joint model,
    of the same size and seed.

    Both tables: measures by size, seed, epoch and scope, from epoch 0; columns ``by`` distinguish
    runs of one grid point. ``ConvergenceWatch`` stops training by the same rule.
    Runs that do not converge have ``max_epochs``; a group without queries decides nothing. Columns:
    ``by``, size, seed, epochs, converged.
    """
    target = joint.set_index(["scope", "size", "seed"])[measure] - margin
    groups = runs[runs["scope"].isin(GROUPS)].dropna(subset=[measure])
    groups = groups.join(target.rename("target"), on=["scope", "size", "seed"])
    within = groups[measure] >= groups["target"]
    run = [*by, "size", "seed"]
    at_once = within.groupby([groups[name] for name in [*run, "epoch"]], observed=True).all()
    reached = at_once[at_once].reset_index().groupby(run, observed=True)["epoch"].min()
    table = groups.groupby(run, observed=True).size().to_frame("epochs")
    table["epochs"] = reached.reindex(table.index).fillna(max_epochs)
    table["converged"] = table.index.isin(reached.index)
    return table.reset_index()
