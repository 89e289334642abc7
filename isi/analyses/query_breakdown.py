"""What every model answers right after insertion, by what is asked: the slot, the relation, the novel entity's part."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import pyarrow as pa
import torch
from torch import Tensor

from isi.config import Study
from isi.evaluation.query_sets import epoch_query_sets, novel_query_set
from isi.evaluation.ranking import Queries, RankedQueries, Ranks, make_queries, observations, rank_queries
from isi.experiment.grid import JOINT_MODEL, GridPoints, StackedVectors
from isi.experiment.insert import with_vectors
from isi.experiment.tables import SCOPES, SESSION_CHECKS, SIZE_AND_SEED
from isi.graph.sessions import TEST, TRAIN, VALID, Session, membership
from isi.models.bilinear import BlockModel
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.tables.rules import at_least, not_above, one_of, within
from isi.tables.table import INT, LONG, NAME, REAL, Table, concat

#: Where a query has a novel entity, by 1 for among what is given and 2 for as the answer.
NOVEL = ("none", "given", "answer", "both")
#: Magnitude above which a coordinate of a relation counts as used.
USED = 1e-3

#: Name of a scope, and of a filter: ``learned``, the scope's own, or ``true``, all true triples.
QueryCounts = tuple[str, str]


def breakdown_table(template: str, by: Mapping[str, pa.DataType] | None = None) -> Table:
    """Means of MRR* and MRR over queries, grouped by what is given and what is hidden.

    ``filter``: ``learned``, the scope's own, or ``true``, all true triples. ``hidden``: the slot that is predicted.
    ``novel``: where a novel entity is. ``observations``: of the relation in D¹, its weight in equation 7.
    """
    return Table(
        template,
        {**(by or {}), **SIZE_AND_SEED, "session": INT, "model": NAME, "scope": NAME, "filter": NAME,
         "relation": NAME, "hidden": NAME, "novel": NAME, "queries": INT, "mrr_star": REAL, "mrr": REAL,
         "observations": LONG},
        key=[*(by or {}), "size", "seed", "session", "model", "scope", "filter", "relation", "hidden", "novel"],
        checks=[*SESSION_CHECKS, *one_of("scope", SCOPES), *one_of("filter", ("learned", "true")),
                *one_of("hidden", ("head", "relation", "tail")), *one_of("novel", NOVEL),
                *at_least(1, "queries", "observations"), *within(0, 1, "mrr_star", "mrr")],
    )  # fmt: skip


#: Of every model, right after insertion.
QUERY_BREAKDOWN = breakdown_table("data/analyses/query_breakdown/{experiment}.parquet")
#: Coordinates of relations that are not zero: of each relation, and (null) of any of them.
USED_COORDINATES = Table(
    "data/analyses/query_breakdown/{experiment}.used.parquet",
    {"seed": INT, "model": NAME, "relation": NAME, "part": NAME, "used": INT, "of": INT},
    key=["seed", "model", "relation", "part"],
    checks=[*at_least(0, "seed", "used"), *not_above("used", "of")],
    nullable=["relation"],
)


class QueryBreakdown(Study):
    """``query_breakdown`` in params."""


@dataclass(frozen=True)
class QueryBreakdownTask:
    """Ask every model of a stack of grid points, as the first session inserted its entities."""

    points: GridPoints
    theta0: StackedVectors
    joint: StackedVectors
    #: by initializer; shapes: (M, n, d)
    inserted: Mapping[str, np.ndarray]
    #: (session, model, place in ``novel``, triple) of the insert triples, in this order; shape: (I, 4)
    insert_triples: np.ndarray


def break_down(task: QueryBreakdownTask) -> pd.DataFrame:
    """Means over the queries of each group (``QUERY_BREAKDOWN``), model by model."""
    points, session, novel = task.points, task.points.session(1), task.points.novel_in(1)
    is_novel = membership(novel, len(points.graph.entities))
    scopes = query_sets_with_filters(session, novel, points.insert_triples_in(1, task.insert_triples))
    groups = pd.concat(
        means(queries).assign(model=name, scope=scope, filter=which)
        for name, embedding in _models(task, novel)
        for together in scopes
        for (scope, which), queries in every_query(embedding, together, is_novel).items()
    )
    place, relation = groups["place"].to_numpy(), groups["relation"].to_numpy()
    return groups.assign(
        size=points.size,
        seed=np.array(points.seeds)[place],
        session=1,
        relation=np.array(points.graph.relations)[relation],
        novel=np.array(NOVEL)[groups["novel"]],
        observations=observations(session).cpu().numpy()[place, relation],
    )


def _models(task: QueryBreakdownTask, novel: Tensor) -> Iterator[tuple[str, Embedding]]:
    for name, vectors in task.inserted.items():
        yield name, with_vectors(task.theta0.stack, novel, torch.as_tensor(vectors))
    yield JOINT_MODEL, task.joint.stack


def query_sets_with_filters(session: Session, novel: Tensor, told: Tensor) -> list[dict[QueryCounts, Queries]]:
    """The queries of scopes all, novel_heldout and novel with either filter; those of one mapping share their rows.

    Args:
        session: D¹.
        novel: shape (M, n).
        told: the insert triples; shape (M, T), bool.
    """
    followed, true = epoch_query_sets(session, novel), session.members(TRAIN, VALID, TEST)
    shared = {name: followed[name] for name in ("all", "novel_heldout")}, novel_query_set(session, novel, told)
    return [
        {(name, "learned"): queries for name, queries in scopes.items()}
        | {(name, "true"): make_queries(session, queries.triples, queries.queried, true, queries.candidates)
           for name, queries in scopes.items()}
        for scopes in shared
    ]  # fmt: skip


def every_query(
    embedding: Embedding, scopes: Mapping[QueryCounts, Queries], is_novel: Tensor
) -> dict[QueryCounts, pd.DataFrame]:
    """The queries of scopes that share their rows, one a row (see ``by_query``)."""
    parts: dict[QueryCounts, list[pd.DataFrame]] = {key: [] for key in scopes}
    for piece in rank_queries(embedding, scopes):
        for key, answered in piece.items():
            parts[key].append(by_query(answered, is_novel))
    return {key: pd.concat(frames) for key, frames in parts.items()}


def by_query(answered: RankedQueries, is_novel: Tensor) -> pd.DataFrame:
    """A row for each query: its model's place in the stack, the relation's id, what is hidden, its terms.

    Args:
        is_novel: shape (M, E), bool.
    """
    rows, number = answered.rows, answered.rows.head.shape[1]
    head, tail = (is_novel.gather(1, ends).long() for ends in (rows.head, rows.tail))
    asked = (
        ("head", _sliced(answered.entity, slice(number)), tail + 2 * head),
        ("tail", _sliced(answered.entity, slice(number, None)), head + 2 * tail),
        ("relation", answered.relations, head | tail),
    )
    model, query = (rows.relation_weight > 0).nonzero(as_tuple=True)  # but for padding

    def column(values: Tensor) -> np.ndarray:
        return values[model, query].cpu().numpy()

    return pd.concat(
        pd.DataFrame({
            "place": model.cpu().numpy(), "relation": column(rows.relation), "hidden": hidden, "novel": column(novel),
            "mrr_star": column(terms.closeness.double()), "mrr": column(1 / terms.rank.double()),
        })
        for hidden, terms, novel in asked
    )  # fmt: skip


def _sliced(terms: Ranks, queries: slice) -> Ranks:
    return Ranks(*(values[:, queries] for values in (terms.closeness, terms.rank, terms.tied)))


def means(queries: pd.DataFrame) -> pd.DataFrame:
    """Mean terms of the queries of each group, and how many they are."""
    groups = queries.groupby(["place", "relation", "hidden", "novel"])
    return groups.mean().assign(queries=groups.size()).reset_index()


def used(family: Model, relation: np.ndarray, seeds: Sequence[int], names: Sequence[str]) -> pd.DataFrame:
    """Coordinates that the relations of joint models use (``USED_COORDINATES``); none of families without blocks.

    Args:
        relation: shape (M, R, w).
        seeds: of the models.
        names: of the relations.
    """
    parts = []
    if isinstance(family, BlockModel):
        for part, magnitude in family.magnitudes(torch.as_tensor(relation)).items():
            uses = magnitude > USED  # (M, R, parts)
            counts = torch.cat([uses.sum(-1), uses.any(1).sum(-1, keepdim=True)], 1)
            every = pd.MultiIndex.from_product([seeds, [*names, None]], names=["seed", "relation"])
            frame = every.to_frame(index=False).assign(
                model=JOINT_MODEL, part=part, used=counts.flatten().cpu().numpy()
            )
            parts.append(frame.assign(of=uses.shape[-1]))
    found = concat(parts, USED_COORDINATES)
    return found[found["of"] > 0]
