"""Measures right after insertion by relation, hidden slot and role of the novel entity."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from torch import Tensor

from isi.evaluation.query_sets import query_sets
from isi.evaluation.ranking import RankedQueries, observations, rank_queries
from isi.graph.sessions import membership
from isi.models.stack import Embedding
from isi.tables.rules import FROM_1, NAME, SHARE, ColumnType, at_least, one_of
from isi.tables.table import Table
from stages.grid import GridPoints
from stages.store import SIZE_AND_SEED

#: Slots with a novel entity; index: 1 if given, plus 2 if answer.
NOVEL_AT = ("none", "given", "answer", "both")
BROKEN_DOWN = ("novel", "held_out")  #: Scopes.
GROUP = ["place", "relation", "hidden", "novel"]


def breakdown_table(template: str, by: Mapping[str, ColumnType] | None = None) -> Table:
    """A table of mean MRR* and MRR over the queries of each relation,
    hidden slot and role of the novel entity.

    ``hidden``: the slot to predict. ``novel``: a value of ``NOVEL_AT``. ``queries``: how often one
    of them is asked. ``observations``: count of the relation in D¹, its weight.
    """
    return Table(
        template,
        {
            **(by or {}),
            **SIZE_AND_SEED,
            "model": NAME,
            "scope": one_of(*BROKEN_DOWN),
            "relation": NAME,
            "hidden": one_of("head", "relation", "tail"),
            "novel": one_of(*NOVEL_AT),
            "queries": FROM_1,
            "mrr_star": SHARE,
            "mrr": SHARE,
            "observations": at_least(1, "int64"),
        },
        key=[
            *(by or {}),
            "size",
            "seed",
            "model",
            "scope",
            "relation",
            "hidden",
            "novel",
        ],
    )


#: The query breakdown of an initializer right after insertion, or of the joint model.
QUERY_BREAKDOWN = breakdown_table("data/analyses/query_breakdown/{experiment}/{model}.parquet")


def write_queries(queries: pd.DataFrame, stage: str, experiment: str, model: str) -> None:
    """Write the breakdown of a model, by size and seed."""
    rows = queries.sort_values(["size", "seed"], kind="stable")
    QUERY_BREAKDOWN.write(rows, stage, experiment=experiment, model=model)


def break_down(points: GridPoints, embedding: Embedding, model: str) -> pd.DataFrame:
    """Rows of ``QUERY_BREAKDOWN`` for an embedding of D¹, called ``model``."""
    session, novel = points.session(1), points.novel_ids
    is_novel = membership(novel, len(points.graph.entities))
    query_sets_of_all = query_sets(session, novel, points.insert_mask)
    asked = {scope: query_sets_of_all[scope] for scope in BROKEN_DOWN}
    terms = dict[str, list[pd.DataFrame]]()
    for piece in rank_queries(embedding, asked):
        for scope, ranked in piece.items():
            terms.setdefault(scope, []).append(query_terms(ranked, is_novel))
    groups = list[pd.DataFrame]()
    for scope, parts in terms.items():
        sums = pd.concat(parts).groupby(GROUP)[["queries", "mrr_star", "mrr"]].sum()
        means = sums[["mrr_star", "mrr"]].div(sums["queries"], axis=0)
        groups.append(means.assign(queries=sums["queries"], scope=scope).reset_index())
    table = pd.concat(groups, ignore_index=True)
    columns = {
        "relation": np.array(points.graph.relations)[table["relation"]],
        "novel": np.array(NOVEL_AT)[table["novel"]],
        "observations": observations(session).cpu().numpy()[table["place"], table["relation"]],
    }
    return points.run_rows([table.assign(**columns, model=model)])


def query_terms(ranked: RankedQueries, is_novel: Tensor) -> pd.DataFrame:
    """A row for each query: columns ``GROUP``; how often it is asked, ``queries``; its term of
    MRR* and its reciprocal rank, times that; ``is_novel``: (M, E), bool.
    """
    (heads, relation, tails), (by_head, by_relation, by_tail) = ranked.rows.ids, ranked.slots
    head, tail = (is_novel.gather(1, ends).long() for ends in (heads, tails))
    times = ranked.rows.times
    model, query = (times > 0).nonzero(as_tuple=True)  # without padding

    def column(values: Tensor) -> np.ndarray:
        return values[model, query].cpu().numpy()

    asked = column(times)
    parts = list[pd.DataFrame]()
    for hidden, terms, novel in (  # in a fixed order, which sets the last bits of the means
        ("head", by_head, tail + 2 * head),
        ("tail", by_tail, head + 2 * tail),
        ("relation", by_relation, head | tail),
    ):
        columns = {
            "place": model.cpu().numpy(),
            "relation": column(relation),
            "hidden": hidden,
            "novel": column(novel),
            "queries": asked,
            "mrr_star": asked * column(terms.closeness.double()),
            "mrr": asked * column(1 / terms.rank.double()),
        }
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts)
