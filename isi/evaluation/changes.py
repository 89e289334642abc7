"""Changes of the paper's measure, one at a time: what each part of its definition decides.

Counts come with a filter that leaves true answers among the candidates: where every other true
triple is left out, there is nothing that they could order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from torch import Tensor

from isi.evaluation.query_sets import times_observed, triples_of_groups, with_weighted
from isi.evaluation.ranking import Queries, make_queries, padded_ids
from isi.evaluation.scopes import GROUPS
from isi.graph.sessions import TEST, TRAIN, VALID, Session

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class MeasureChange:
    """A change of the measure: query sets by group, and the measure that is taken of them."""

    title: str
    measure: str
    suffix: str = ""  #: of the groups' names in ``changed_query_sets``

    @property
    def query_sets(self) -> dict[str, str]:
        """The query set of each group; the whole of D¹ is one group, as good as ``weighted``."""
        if self.suffix == ALL:
            return {"weighted": ALL}
        return {group: f"{group}{self.suffix}" for group in GROUPS}


ALL = "d1"  #: The query set of all triples of D¹.
#: Query sets with the filter of the paper's words alone, and those whose triples weigh alike.
LEARNED, ALIKE = "_learned", "_alike"

CHANGES = {
    "none": MeasureChange("the measure", "mrr"),
    "counts": MeasureChange(
        "counts for truth values, and the paper's filter (equation 7)", "mrr_star"
    ),
    "filter": MeasureChange("the paper's filter alone", "mrr", LEARNED),
    "one_group": MeasureChange("all of D¹ in place of the two groups", "mrr", ALL),
    "triples_alike": MeasureChange("triples alike, whatever their relation", "mrr", ALIKE),
    "entities_alone": MeasureChange("entity prediction alone", "mrr_entity"),
}


def changed_query_sets(session: Session, novel: Tensor, inserted: Tensor) -> dict[str, Queries]:
    """Query sets of ``CHANGES`` besides those of scopes; arguments: those of ``query_sets``."""
    known, new = triples_of_groups(session, novel)
    true, learned = session.members(TRAIN, VALID, TEST), session.members(TRAIN, VALID) & ~new
    triples, everyone = padded_ids(true), session.entities
    times = times_observed(session) * ~inserted
    queried = {"known": known, "novel": times * new}
    sets = {ALL: make_queries(session, triples, times * true, true, true, everyone)}
    for group, asked in queried.items():
        of_group = session, triples, asked
        sets[f"{group}{LEARNED}"] = make_queries(*of_group, learned, learned, everyone)
        sets[f"{group}{ALIKE}"] = make_queries(*of_group, true, true, everyone, alike=True)
    return sets


def change_rows(measured: pd.DataFrame) -> pd.DataFrame:
    """Rows by change of the measure, with the columns change, scope and value in place of the
    measures, from measures of the scopes and of ``changed_query_sets``.
    """
    import pandas as pd

    parts = list[pd.DataFrame]()
    keys = [name for name in ("size", "seed", "epoch", "place") if name in measured]
    for name, change in CHANGES.items():
        for scope, query_set in change.query_sets.items():
            rows = measured[measured["scope"] == query_set]
            values = rows[keys].assign(change=name, scope=scope, value=rows[change.measure])
            parts.append(values)
    return pd.concat(parts, ignore_index=True)


def with_weighted_changes(rows: pd.DataFrame, shares: Mapping[int, float]) -> pd.DataFrame:
    """``change_rows`` with rows of scope ``weighted``."""
    return with_weighted(rows, shares, ["value"])
