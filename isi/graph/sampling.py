"""Drawing sessions: splits, folds, novel (OOKB) entities and insert triples (sections 5.2 and 5.3).

The sessions of a graph as tables: who has which split, who is novel, what is told.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
import pandas as pd
from pydantic import Field, model_validator

from isi.config import Count, Fraction, Names, Section, distinct
from isi.errors import InputError
from isi.graph.graph import Graph
from isi.graph.sessions import SPLITS, TEST, TRAIN, VALID
from isi.graph.tables import INSERT_TRIPLES, NOVEL
from isi.random import stream
from isi.tables import paths


class Shares(Section):
    """``sessions`` in params: what every experiment holds out, and tells."""

    valid: Fraction
    test: Fraction
    insert_fraction: Annotated[float, Field(gt=0, le=1)]

    @model_validator(mode="after")
    def _leave_something(self) -> Self:
        if self.valid + self.test >= 1:
            raise ValueError("valid and test together must leave something to train on (below 1)")
        return self


class SessionsOf(Section):
    """``sessions`` of one experiment: who is novel, how many, how often."""

    novel: Annotated[Names, Field(min_length=1)] | Literal["any", "added"]
    sizes: Annotated[list[Count], Field(min_length=1)]
    seeds: Count
    steps: Count = 1

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not distinct(self.sizes):
            raise ValueError("sizes must not repeat")
        if self.novel == "added" and len(self.sizes) > 1:
            raise ValueError("sizes: one alone where novel is added, since a seed's triples depend on who is drawn")
        return self


@dataclass(frozen=True)
class SampledSessions:
    """The learning sessions of one size and seed."""

    size: int
    seed: int
    #: unique triples that take part, and their splits; shapes: (T',)
    triples: np.ndarray
    splits: np.ndarray
    #: ids, by the session that inserts them; shape: (steps, size)
    novel: np.ndarray
    #: (session, entity, triple), sessions counted from 1
    insert_triples: list[tuple[int, int, int]]


def novel_candidates(how: SessionsOf, kinds: np.ndarray, added: np.ndarray) -> np.ndarray:
    """Ids of the entities that may be novel.

    Args:
        kinds: of all entities; shape (E,).
        added: ids of those of another source.
    """
    if how.novel == "any":
        return np.arange(len(kinds))
    if how.novel == "added":
        return added
    return np.flatnonzero(np.isin(kinds, how.novel))


def sample_sessions(
    graph: Graph, candidates: np.ndarray, replaceable: np.ndarray, how: SessionsOf, shares: Shares, root: int
) -> Iterator[SampledSessions]:
    """Draw the sessions of every size and seed.

    Args:
        candidates: who may be novel; ids.
        replaceable: those of them that take no part where they are not drawn; ids.

    Raises:
        InputError: where there are too few candidates, or a split would hold out less than its share.
    """
    for size in sorted(how.sizes):
        for seed in range(how.seeds):
            novel = sample_novel(candidates, root, size, seed, how.steps)
            triples = triples_without(graph, np.setdiff1d(replaceable, novel))
            part = graph.part(triples)
            splits = split(part, root, seed, shares.valid, shares.test)
            check_held_out(splits, shares.valid, shares.test)
            pairs = [
                (session, entity, int(triples[triple]))
                for session in range(1, how.steps + 1)
                for entity, triple in sample_insert_triples(
                    part, splits, novel, session, root, seed, shares.insert_fraction
                )
            ]
            yield SampledSessions(size, seed, triples, splits, novel, pairs)


def split(graph: Graph, root: int, seed: int, valid: float, test: float) -> np.ndarray:
    """Split unique triples at random into train, valid and test; shape (T,), int8.

    Every entity and relation appears in train.
    """
    free = _free(graph, stream(root, "splits", seed))
    tests, valids = round(test * len(graph.triples)), round(valid * len(graph.triples))
    splits = np.full(len(graph.triples), TRAIN, dtype=np.int8)
    splits[free[:tests]] = TEST
    splits[free[tests : tests + valids]] = VALID
    return splits


def check_held_out(splits: np.ndarray, valid: float, test: float) -> None:
    """See that a split, shape (T,), holds out the shares that it was to hold out.

    Raises:
        InputError: where it does not, because triples had to stay in train.
    """
    for code, share in ((VALID, valid), (TEST, test)):
        if (splits == code).sum() < max(1, round(share * len(splits))):
            expected = "expected shares that leave triples to each split (for every entity, one stays in train)"
            raise InputError(paths.PARAMS, "sessions.valid, sessions.test", expected)


def folds(graph: Graph, root: int, number: int) -> np.ndarray:
    """Splits for cross-validation: in each, one fold is valid and the rest is train; shape (number, T), int8.

    Every entity and relation appears in the train of every fold; the triples that see to it are in no fold.
    """
    splits = np.full((number, len(graph.triples)), TRAIN, dtype=np.int8)
    for own, fold in zip(splits, np.array_split(_free(graph, stream(root, "folds")), number), strict=True):
        own[fold] = VALID
    return splits


def _free(graph: Graph, rng: np.random.Generator) -> np.ndarray:
    """The triples that may leave train, in random order: not the first that holds an entity or relation."""
    triples = graph.triples.numpy()
    order = rng.permutation(len(triples))
    ends = triples[order][:, [0, 2]].ravel()
    first_of_entity = np.unique(ends, return_index=True)[1] // 2
    first_of_relation = np.unique(triples[order, 1], return_index=True)[1]
    return np.delete(order, np.union1d(first_of_entity, first_of_relation))


def sample_novel(candidates: np.ndarray, root: int, size: int, seed: int, steps: int = 1) -> np.ndarray:
    """Draw the novel entities of a (size, seed) uniformly, for each session in ascending order; (steps, size)."""
    drawn = stream(root, "novel", size, seed).choice(len(candidates), steps * size, replace=False)
    return np.sort(candidates[drawn.reshape(steps, size)], axis=1)


def triples_without(graph: Graph, entities: np.ndarray) -> np.ndarray:
    """Ids of the unique triples that have none of the entities as an end; shape (T',)."""
    return np.flatnonzero(~np.isin(graph.triples[:, [0, 2]].numpy(), entities).any(1))


def sample_insert_triples(
    graph: Graph, splits: np.ndarray, novel: np.ndarray, session: int, root: int, seed: int, fraction: float
) -> list[tuple[int, int]]:
    """The (entity, triple) pairs that a robot observes when it meets the novel entities of a session.

    Of an entity's n unique training triples whose other end is known by then, max(1, ⌊fraction · n⌋).

    Args:
        novel: of all sessions; shape (steps, size).
        session: from 1; the first one's random stream does not name it.
    """
    triples, own_novel = graph.triples.numpy(), novel[session - 1]
    heads, tails = (np.isin(triples[:, slot], novel[session - 1 :]) for slot in (0, 2))
    usable = (splits == TRAIN) & (heads ^ tails)
    rng = stream(root, "insert triples", len(own_novel), seed, *later_key(session))
    pairs: list[tuple[int, int]] = []
    for entity in own_novel:
        own = np.flatnonzero(usable & ((triples[:, 0] == entity) | (triples[:, 2] == entity)))
        count = max(1, math.floor(fraction * len(own))) if len(own) else 0
        pairs.extend((int(entity), int(triple)) for triple in np.sort(rng.choice(own, count, replace=False)))
    return pairs


def later_key(session: int) -> tuple[int, ...]:
    """What a session adds to the keys of its random streams: the first that inserts adds nothing."""
    return (session,) if session > 1 else ()


@dataclass(frozen=True)
class SessionTables:
    """The sessions of an experiment: ``tables.SPLITS``, ``tables.NOVEL`` and ``tables.INSERT_TRIPLES``."""

    splits: pd.DataFrame
    novel: pd.DataFrame
    insert_triples: pd.DataFrame


def session_tables(
    graph: Graph, entities: pd.DataFrame, how: SessionsOf, shares: Shares, root: int, key: str
) -> SessionTables:
    """The sessions of a graph, drawn for every size and seed.

    D of the last session is all that is not replaceable, and who is drawn; the triples of the others have no split.

    Args:
        entities: of the graph (``tables.ENTITIES``).
        root: of every random stream.
        key: where ``how`` stands in params.

    Raises:
        InputError: where there are too few that may be novel, or there is no triple.
    """
    if not len(graph.triples):
        raise InputError(paths.PARAMS, key, "expected a graph with triples")
    added = np.flatnonzero(entities["source"].astype(str) != str(entities["source"].iloc[0]))
    candidates = novel_candidates(how, entities["kind"].to_numpy(str), added)
    if how.steps * max(how.sizes) > len(candidates) - (how.novel != "added"):
        few = f"expected fewer novel entities than the {len(candidates)} that may be novel"
        raise InputError(paths.PARAMS, f"{key}.sizes", few)
    drawn = list(sample_sessions(graph, candidates, added if how.novel == "added" else added[:0], how, shares, root))
    splits = pd.concat(
        pd.DataFrame({"seed": one.seed, "triple": one.triples, "split": np.array(SPLITS)[one.splits]})
        for one in drawn
        if one.size == drawn[0].size  # once for each seed
    )
    novel = [
        (one.size, one.seed, entity, session)
        for one in drawn
        for session, entities_of in enumerate(one.novel, 1)
        for entity in entities_of
    ]
    told = [(o.size, o.seed, entity, triple, session) for o in drawn for session, entity, triple in o.insert_triples]
    return SessionTables(
        splits,
        pd.DataFrame(novel, columns=list(NOVEL.columns)),
        pd.DataFrame(told, columns=list(INSERT_TRIPLES.columns)),
    )
