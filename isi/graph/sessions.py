"""Sessions of incremental learning: splits, folds,
novel (OOKB) entities and insert triples (sections 5.2, 5.3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from isi.config import Count, EachOnce, Fraction, Names, Section
from isi.errors import InputError
from isi.graph.graph import Graph
from isi.random import stream
from isi.tables import paths
from isi.tables.rules import FROM_0, FROM_1, one_of, unique
from isi.tables.table import Table

if TYPE_CHECKING:
    import pandas as pd

#: Split of a triple in a session; ``OUT`` where it takes no part.
OUT, TRAIN, VALID, TEST = -1, 0, 1, 2
SPLIT_NAMES = ("train", "valid", "test")
NEVER = 2**31 - 1  #: Arrival of an entity that takes part in no session.

SPLITS = Table(
    "data/sessions/{experiment}/splits.parquet",
    {"seed": FROM_0, "triple": FROM_0, "split": one_of(*SPLIT_NAMES)},
    key=["seed", "triple"],
    ordered=True,
)
#: ``session``: number of the session that inserts the entity, from 1; Θ⁰ is trained in session 0.
NOVEL = Table(
    "data/sessions/{experiment}/novel.parquet",
    {"size": FROM_1, "seed": FROM_0, "entity": FROM_0, "session": FROM_1},
    key=["size", "seed", "session", "entity"],
    ordered=True,
    checks=[unique("size", "seed", "entity")],
)
INSERT_TRIPLES = Table(
    "data/sessions/{experiment}/insert_triples.parquet",
    {"size": FROM_1, "seed": FROM_0, "entity": FROM_0, "triple": FROM_0, "session": FROM_1},
    key=["size", "seed", "session", "entity", "triple"],
    ordered=True,
)


@dataclass(frozen=True)
class Session:
    """A stack of M learning sessions over one graph: which entities and triples take part."""

    graph: Graph = field(metadata={"shared": True})  #: shared by all M sessions
    entities: Tensor  #: shape: (M, E), bool
    splits: Tensor  #: TRAIN, VALID, TEST or OUT; shape: (M, T), int8

    def members(self, *splits: int) -> Tensor:
        """Mask of the unique triples whose split is among ``splits``; shape: (M, T), bool."""
        return torch.stack([self.splits == split for split in splits]).any(0)

    def trained(self) -> Tensor:
        """Mask of the session's entities with at least one training triple; shape: (M, E), bool."""
        return self.entities & ends(self.graph, self.members(TRAIN))


def session_at(graph: Graph, splits: Tensor, novel: Tensor, number: int) -> Session:
    """The graph D of session ``number``: entities and triples that have arrived by then
    (section 5.2); 0 gives D⁰.

    A novel entity arrives in its session, any other in session 0, a triple with its later end. An
    entity without triples in ``splits``, (M, T), never arrives. ``novel``: ids of the n entities of
    each session, (M, S, n).
    """
    arrival = torch.zeros(len(splits), len(graph.entities), dtype=torch.int64)
    for session in range(novel.shape[1]):
        arrival.scatter_(1, novel[:, session], session + 1)
    arrival.masked_fill_(~ends(graph, splits != OUT), NEVER)
    later = torch.maximum(arrival[:, graph.triples[:, 0]], arrival[:, graph.triples[:, 2]])
    return Session(graph, arrival <= number, splits.masked_fill(later > number, OUT))


def session_of(graph: Graph, splits: Tensor) -> Session:
    """The session of all triples with a split, and of their ends;
    ``splits``: shape (M, T), ``OUT`` for no split.
    """
    return Session(graph, ends(graph, splits != OUT), splits)


def touches(graph: Graph, entities: Tensor) -> Tensor:
    """Mask, (M, T), of the unique triples with an end in ``entities``, a mask of shape (M, E)."""
    return entities[:, graph.triples[:, 0]] | entities[:, graph.triples[:, 2]]


def ends(graph: Graph, triples: Tensor) -> Tensor:
    """Mask, (M, E), of the heads and tails of ``triples``, a mask of shape (M, T)."""
    entities = len(graph.entities)
    # the last column is of no entity
    reached = torch.zeros(len(triples), entities + 1, dtype=torch.bool)
    for slot in (0, 2):
        reached.scatter_(1, torch.where(triples, graph.triples[:, slot], entities), True)
    return reached[:, :-1]


def membership(ids: Tensor, entities: int) -> Tensor:
    """Ids, shape (M, n), as a mask of shape (M, E)."""
    return torch.zeros(len(ids), entities, dtype=torch.bool).scatter_(1, ids, True)


class Shares(Section):
    """``sessions`` in params: shares of triples held out,
    and of a novel entity's training triples to insert.
    """

    rules = (
        (
            lambda shares: shares.valid + shares.test < 1,
            "expected valid and test to sum to less than 1, to leave triples for training",
        ),
    )
    valid: Fraction
    test: Fraction
    insert_fraction: Annotated[float, Field(gt=0, le=1)]


class SessionsOf(Section):
    """``sessions`` of one experiment: candidates for novel entities, set sizes,
    numbers of seeds and of sessions.
    """

    rules = (
        (
            lambda sessions: sessions.novel != "added" or len(sessions.sizes) == 1,
            (
                "sizes: expected one size with novel: added, as a seed's "
                "triples depend on the novel set"
            ),
        ),
    )
    novel: Annotated[Names, Field(min_length=1)] | Literal["any", "added"]
    sizes: Annotated[list[Count], Field(min_length=1), EachOnce]
    seeds: Count
    steps: Count = 1


def split(graph: Graph, root: int, seed: int, valid: float, test: float) -> np.ndarray:
    """Split unique triples at random into train, valid and test;
    every entity and relation is in train; (T,), int8.
    """
    free = _free(graph, stream(root, "splits", seed))
    tests, valids = round(test * len(graph.triples)), round(valid * len(graph.triples))
    splits = np.full(len(graph.triples), TRAIN, dtype=np.int8)
    splits[free[:tests]] = TEST
    splits[free[tests : tests + valids]] = VALID
    return splits


def check_held_out(splits: np.ndarray, valid: float, test: float) -> None:
    """InputError if valid or test of a split, (T,),
    is below its share because too many triples must stay in train.
    """
    for code, share in ((VALID, valid), (TEST, test)):
        if (splits == code).sum() < max(1, round(share * len(splits))):
            expected = (
                "expected at least one triple in each, and a triple of every "
                "entity and relation left for train"
            )
            raise InputError(paths.PARAMS, "sessions.valid, sessions.test", expected)


def folds(graph: Graph, root: int, number: int) -> np.ndarray:
    """Folds, (number, T), int8: in row i, fold i is in valid, all else in train,
    which has each entity and relation.
    """
    splits = np.full((number, len(graph.triples)), TRAIN, dtype=np.int8)
    for row, fold in zip(
        splits, np.array_split(_free(graph, stream(root, "folds")), number), strict=True
    ):
        row[fold] = VALID
    return splits


def _free(graph: Graph, rng: np.random.Generator) -> np.ndarray:
    """Ids of triples that may leave train, in random order:
    all but the first triple of each entity and relation.
    """
    triples = graph.triples.numpy()
    order = rng.permutation(len(triples))
    ends = triples[order][:, [0, 2]].ravel()
    first_of_entity = np.unique(ends, return_index=True)[1] // 2
    first_of_relation = np.unique(triples[order, 1], return_index=True)[1]
    return np.delete(order, np.union1d(first_of_entity, first_of_relation))


def sample_novel(
    candidates: np.ndarray, root: int, size: int, seed: int, steps: int = 1
) -> np.ndarray:
    """Draw the novel entities of a (size, seed) uniformly, sorted within each session;
    shape (steps, size).
    """
    drawn = stream(root, "novel", size, seed).choice(len(candidates), steps * size, replace=False)
    return np.sort(candidates[drawn.reshape(steps, size)], axis=1)


def sample_insert_triples(
    graph: Graph,
    splits: np.ndarray,
    novel: np.ndarray,
    session: int,
    root: int,
    seed: int,
    fraction: float,
) -> list[tuple[int, int]]:
    """Draw the insert triples of a session's novel entities, as pairs of ids (entity, triple);
    sessions count from 1.

    An entity with n > 0 unique training triples to known entities gets max(1, ⌊fraction · n⌋) of
    them; with n = 0, none. ``novel``: ids of the novel entities of all sessions; shape
    (steps, size).
    """
    triples, inserted = graph.triples.numpy(), novel[session - 1]
    heads, tails = (np.isin(triples[:, slot], novel[session - 1 :]) for slot in (0, 2))
    usable = (splits == TRAIN) & (heads ^ tails)
    rng = stream(root, "insert triples", len(inserted), seed, *later_key(session))
    pairs: list[tuple[int, int]] = []
    for entity in inserted:
        of_entity = np.flatnonzero(usable & (triples[:, [0, 2]] == entity).any(1))
        count = max(1, math.floor(fraction * len(of_entity))) if len(of_entity) else 0
        pairs.extend(
            (int(entity), int(triple))
            for triple in np.sort(rng.choice(of_entity, count, replace=False))
        )
    return pairs


def later_key(session: int) -> tuple[int, ...]:
    """Key that a session adds to the keys of its random streams:
    none for session 1, else its number.
    """
    return (session,) if session > 1 else ()


def session_tables(
    graph: Graph, entities: pd.DataFrame, settings: SessionsOf, shares: Shares, root: int, key: str
) -> dict[Table, pd.DataFrame]:
    """Draw a graph's tables; InputError if params do not fit.
    Triples of added, not novel entities have no split.
    """
    import pandas as pd

    if not len(graph.triples):
        raise InputError(paths.PARAMS, key, "expected a graph with triples")
    added = np.flatnonzero(entities["source"].astype(str) != str(entities["source"].iloc[0]))
    of_kinds = np.flatnonzero(entities["kind"].isin(list(settings.novel)))
    candidates = {"any": np.arange(len(entities)), "added": added}.get(
        str(settings.novel), of_kinds
    )
    if settings.steps * max(settings.sizes) > len(candidates) - (settings.novel != "added"):
        few = (
            f"expected a lower size · steps: {len(candidates)} candidates; "
            "one must stay known unless novel: added"
        )
        raise InputError(paths.PARAMS, f"{key}.sizes", few)
    splits = list[pd.DataFrame]()
    drawn_rows: dict[Table, list[tuple[int, ...]]] = {NOVEL: [], INSERT_TRIPLES: []}
    for size, seed in product(sorted(settings.sizes), range(settings.seeds)):
        drawn = sample_novel(candidates, root, size, seed, settings.steps)
        absent = np.setdiff1d(added, drawn) if settings.novel == "added" else added[:0]
        triples = np.flatnonzero(~np.isin(graph.triples[:, [0, 2]].numpy(), absent).any(1))
        part = graph.part(triples)
        codes = split(part, root, seed, shares.valid, shares.test)
        check_held_out(codes, shares.valid, shares.test)
        if size == min(settings.sizes):  # once for each seed
            splits.append(
                pd.DataFrame(
                    {"seed": seed, "triple": triples, "split": np.array(SPLIT_NAMES)[codes]}
                )
            )
        for session, inserted in enumerate(drawn, 1):
            drawn_rows[NOVEL] += [(size, seed, entity, session) for entity in inserted]
            pairs = sample_insert_triples(
                part, codes, drawn, session, root, seed, shares.insert_fraction
            )
            drawn_rows[INSERT_TRIPLES] += [
                (size, seed, entity, int(triples[row]), session) for entity, row in pairs
            ]
    rows = {
        table: pd.DataFrame(listed, columns=list(table.columns))
        for table, listed in drawn_rows.items()
    }
    return {SPLITS: pd.concat(splits), **rows}
