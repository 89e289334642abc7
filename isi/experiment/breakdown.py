"""Measures right after insertion by relation, hidden slot and role of the novel entity."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.evaluation.query_sets import epoch_query_sets, novel_query_set
from isi.evaluation.ranking import Queries, RankedQueries, make_queries, observations, rank_queries
from isi.experiment.grid import JOINT_MODEL, GridPoints
from isi.experiment.store import SCOPES, SESSION, SIZE_AND_SEED
from isi.experiment.train import run_rows
from isi.graph.sessions import TEST, TRAIN, VALID, membership
from isi.models.bilinear import BlockModel
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.tables.rules import FROM_0, FROM_1, NAME, SHARE, ColumnType, at_least, one_of
from isi.tables.table import Table, concat

#: Slots with a novel entity; index: 1 if given, plus 2 if answer.
NOVEL_AT = ("none", "given", "answer", "both")
USED = 1e-3  #: Magnitude above which a coordinate of a relation counts as used.
GROUP = ["place", "relation", "hidden", "novel"]


def breakdown_table(template: str, by: Mapping[str, ColumnType] | None = None) -> Table:
    """A table of mean MRR* and MRR over the queries of each relation,
    hidden slot and role of the novel entity.

    ``filter``: ``learned`` is the scope's filter, ``true`` is all true triples. ``hidden``: the
    slot to predict. ``novel``: a value of ``NOVEL_AT``. ``observations``: count of the relation in
    D¹, its weight in equation 7.
    """
    return Table(
        template,
        {
            **(by or {}),
            **SIZE_AND_SEED,
            **SESSION,
            "model": NAME,
            "scope": one_of(*SCOPES),
            "filter": one_of("learned", "true"),
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
            "session",
            "model",
            "scope",
            "filter",
            "relation",
            "hidden",
            "novel",
        ],
    )


#: The query breakdown of an initializer right after insertion, or of the joint model.
QUERY_BREAKDOWN = breakdown_table("data/analyses/query_breakdown/{experiment}/{model}.parquet")
#: ``used``: number of the ``of`` coordinates (scalars or blocks) that ``relation`` uses (null: at
#: least one relation).
USED_COORDINATES = Table(
    "data/embeddings/{experiment}/joint.used.parquet",
    {
        "seed": FROM_0,
        "model": NAME,
        "relation": NAME.optional,
        "part": NAME,
        "used": FROM_0,
        "of": FROM_0,
    },
    key=["seed", "model", "relation", "part"],
)


def write_queries(queries: pd.DataFrame, stage: str, experiment: str, model: str) -> None:
    """Write the breakdown of a model, by size and seed."""
    rows = queries.sort_values(["size", "seed"], kind="stable")
    QUERY_BREAKDOWN.write(rows, stage, experiment=experiment, model=model)


def break_down(points: GridPoints, embedding: Embedding, model: str) -> pd.DataFrame:
    """Rows of ``QUERY_BREAKDOWN`` for an embedding of session 1, called ``model``."""
    session, novel, groups = points.session(1), points.novel_in(1), list[pd.DataFrame]()
    is_novel = membership(novel, len(points.graph.entities))
    for query_sets in query_sets_with_filters(points):
        pieces = [
            {key: query_terms(ranked, is_novel) for key, ranked in piece.items()}
            for piece in rank_queries(embedding, query_sets)
        ]
        for scope, which in query_sets:
            terms = pd.concat(piece[scope, which] for piece in pieces).groupby(GROUP)
            means = terms.mean().assign(queries=terms.size()).reset_index()
            groups.append(means.assign(model=model, scope=scope, filter=which))
    table = pd.concat(groups)
    columns = {
        "relation": np.array(points.graph.relations)[table["relation"]],
        "novel": np.array(NOVEL_AT)[table["novel"]],
        "observations": observations(session).cpu().numpy()[table["place"], table["relation"]],
    }
    return run_rows(points, 1, [table.assign(**columns)])


def query_sets_with_filters(points: GridPoints) -> list[dict[tuple[str, str], Queries]]:
    """Query sets of session 1 by (scope, filter);
    novel is apart, since each mapping shares ``Queries.triples``.
    """
    session, novel = points.session(1), points.novel_in(1)
    epochs, true = epoch_query_sets(session, novel), session.members(TRAIN, VALID, TEST)
    heldout = {name: epochs[name] for name in ("all", "novel_heldout")}
    return [
        {(name, "learned"): queries for name, queries in scopes.items()}
        | {
            (name, "true"): make_queries(
                session, queries.triples, queries.queried, true, queries.candidates
            )
            for name, queries in scopes.items()
        }
        for scopes in (heldout, novel_query_set(session, novel, points.insert_mask(1)))
    ]


def query_terms(ranked: RankedQueries, is_novel: Tensor) -> pd.DataFrame:
    """A row for each query: columns ``GROUP``, its term of MRR*, its reciprocal rank;
    ``is_novel``: (M, E), bool.
    """
    (heads, relation, tails), (by_head, by_relation, by_tail) = ranked.rows.ids, ranked.slots
    head, tail = (is_novel.gather(1, ends).long() for ends in (heads, tails))
    model, query = (ranked.rows.relation_weight > 0).nonzero(as_tuple=True)  # without padding

    def column(values: Tensor) -> np.ndarray:
        return values[model, query].cpu().numpy()

    return pd.concat(
        pd.DataFrame(
            {
                "place": model.cpu().numpy(),
                "relation": column(relation),
                "hidden": hidden,
                "novel": column(novel),
                "mrr_star": column(terms.closeness.double()),
                "mrr": column(1 / terms.rank.double()),
            }
        )
        for hidden, terms, novel in (  # in a fixed order, which sets the last bits of the means
            ("head", by_head, tail + 2 * head),
            ("tail", by_tail, head + 2 * tail),
            ("relation", by_relation, head | tail),
        )
    )


def used_coordinates(
    model: Model, relation: Tensor, seeds: Sequence[int], names: Sequence[str]
) -> pd.DataFrame:
    """Rows of ``USED_COORDINATES`` for relation vectors (M, R, w);
    none unless ``model`` is a BlockModel.
    """
    parts, by = [], pd.MultiIndex.from_product([seeds, [*names, None]], names=["seed", "relation"])
    for part, magnitude in (
        model.magnitudes(relation).items() if isinstance(model, BlockModel) else ()
    ):
        uses = magnitude > USED  # (M, R, parts)
        used = torch.cat([uses.sum(-1), uses.any(1).sum(-1, keepdim=True)], 1).flatten().numpy()
        parts.append(
            by.to_frame(index=False).assign(
                model=JOINT_MODEL, part=part, used=used, of=uses.shape[-1]
            )
        )
    return concat(parts, USED_COORDINATES).query("of > 0")
