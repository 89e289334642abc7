"""Sample splits, novel (OOKB) entities and insert triples for every size and seed
(sections 5.2, 5.3).
"""

from __future__ import annotations

import math
from itertools import product
from typing import Annotated, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from isi.config import Count, EachOnce, Fraction, Section
from isi.errors import InputError
from isi.graph.graph import Graph, build_graph
from isi.graph.sessions import OUT, TEST, TRAIN, VALID, split
from isi.random import stream
from isi.tables import paths
from isi.tables.table import Table
from stages.files import ENTITIES, INSERT_TRIPLES, NOVEL, SPLIT_NAMES, SPLITS, TRIPLES
from stages.stage import StageContext, stage

PUBLISHED_FOLDS = paths.RAW / "published" / "folds.csv"  #: The splits of the paper's authors.


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


class Split(Section):
    """``sessions.split`` of an experiment: a published fold, whose triples keep their split."""

    from_: Literal["published"] = Field(alias="from")
    fold: Annotated[int, Field(ge=0, lt=5)]


class SessionsOf(Section):
    """``sessions`` of one experiment: candidates for novel entities, set sizes, and number of
    seeds; how triples are split, and from which splits insert triples are drawn.
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
    novel: Literal["any", "added"]
    sizes: Annotated[list[Count], Field(min_length=1), EachOnce]
    seeds: Count
    split: Split | None = None  #: None: drawn for each seed
    insert_from: Literal["train", "all"] = "train"


@stage
def make_sessions(context: StageContext, experiment: str) -> None:
    params, key = context.params, f"experiments.{experiment}.sessions"
    sessions: SessionsOf = params.read(key, SessionsOf)
    shares: Shares = params.read("sessions", Shares)
    entities = ENTITIES.read(experiment=experiment)
    graph = build_graph(
        entities, TRIPLES.read(experiment=experiment), TRIPLES.path(experiment=experiment)
    )
    drawn = session_tables(graph, entities, sessions, shares, params.seed, key)
    for table, rows in drawn.items():
        table.write(rows, context.stage, experiment=experiment)


def published_split(
    graph: Graph, fold: int, root: int, seed: int, valid: float, test: float
) -> np.ndarray:
    """The split of the paper's authors; triples that are not among theirs, those of another source,
    are split at random with the given shares; (T,), int8.
    """
    phrases = pd.read_csv(paths.PUBLISHED_PHRASES, dtype=str, keep_default_na=False)
    folds = pd.read_csv(PUBLISHED_FOLDS, dtype=str, keep_default_na=False)
    names = phrases.set_index("synset")["entity"]
    ends = [folds[end].map(names) for end in ("head", "tail")]
    codes = folds[f"fold_{fold}"].map(SPLIT_NAMES.index)
    code_of = dict(zip(zip(ends[0], folds["relation"], ends[1], strict=True), codes, strict=True))
    splits = np.full(len(graph.triples), OUT, dtype=np.int8)
    for row, (head, relation, tail) in enumerate(graph.triples.tolist()):
        triple = (graph.entities[head], graph.relations[relation], graph.entities[tail])
        splits[row] = code_of.get(triple, OUT)
    others = np.flatnonzero(splits == OUT)
    if not len(others) < len(splits):
        expected = "expected split: {from: published} with the graph of source published alone"
        raise InputError(paths.PARAMS, "sessions.split", expected)
    if len(others):
        splits[others] = split(graph.part(others), root, seed, valid, test)
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


def sample_novel(candidates: np.ndarray, root: int, size: int, seed: int) -> np.ndarray:
    """Draw the novel entities of a (size, seed) uniformly, sorted; shape (size,)."""
    drawn = stream(root, "novel", size, seed).choice(len(candidates), size, replace=False)
    return np.sort(candidates[drawn])


def sample_insert_triples(
    graph: Graph,
    splits: np.ndarray,
    novel: np.ndarray,
    root: int,
    seed: int,
    fraction: float,
    insert_from: Literal["train", "all"] = "train",
) -> list[tuple[int, int]]:
    """Draw the insert triples of novel entities, (size,), as pairs of ids (entity, triple).

    Of the n > 0 unique triples of an entity whose other end is known, training triples or those of
    all splits, it gets max(1, ⌊fraction · n⌋); with n = 0, none.
    """
    triples = graph.triples.numpy()
    heads, tails = (np.isin(triples[:, slot], novel) for slot in (0, 2))
    usable = heads ^ tails
    if insert_from == "train":
        usable &= splits == TRAIN
    rng = stream(root, "insert triples", len(novel), seed)
    pairs: list[tuple[int, int]] = []
    for entity in novel:
        of_entity = np.flatnonzero(usable & (triples[:, [0, 2]] == entity).any(1))
        count = max(1, math.floor(fraction * len(of_entity))) if len(of_entity) else 0
        pairs.extend(
            (int(entity), int(triple))
            for triple in np.sort(rng.choice(of_entity, count, replace=False))
        )
    return pairs


def session_tables(
    graph: Graph, entities: pd.DataFrame, settings: SessionsOf, shares: Shares, root: int, key: str
) -> dict[Table, pd.DataFrame]:
    """Draw a graph's tables; InputError if params do not fit.
    Triples of added, not novel entities have no split.
    """
    if not len(graph.triples):
        raise InputError(paths.PARAMS, key, "expected a graph with triples")
    added = np.flatnonzero(entities["source"].astype(str) != str(entities["source"].iloc[0]))
    is_added = settings.novel == "added"
    candidates = added if is_added else np.arange(len(entities))
    if max(settings.sizes) > len(candidates) - (not is_added):
        few = (
            f"expected a smaller size: {len(candidates)} candidates; "
            "one must stay known unless novel: added"
        )
        raise InputError(paths.PARAMS, f"{key}.sizes", few)
    splits = list[pd.DataFrame]()
    novel_rows = list[tuple[int, int, int]]()
    insert_rows = list[tuple[int, int, int, int]]()
    for size, seed in product(sorted(settings.sizes), range(settings.seeds)):
        novel = sample_novel(candidates, root, size, seed)
        absent = np.setdiff1d(added, novel) if is_added else added[:0]
        triples = np.flatnonzero(~np.isin(graph.triples[:, [0, 2]].numpy(), absent).any(1))
        part = graph.part(triples)
        codes = _codes(part, settings, shares, root, seed)
        if size == min(settings.sizes):  # once for each seed
            columns = {"seed": seed, "triple": triples, "split": np.array(SPLIT_NAMES)[codes]}
            splits.append(pd.DataFrame(columns))
        novel_rows += [(size, seed, entity) for entity in novel]
        pairs = sample_insert_triples(
            part, codes, novel, root, seed, shares.insert_fraction, settings.insert_from
        )
        insert_rows += [(size, seed, entity, int(triples[row])) for entity, row in pairs]
    return {
        SPLITS: pd.concat(splits),
        NOVEL: pd.DataFrame(novel_rows, columns=list(NOVEL.columns)),
        INSERT_TRIPLES: pd.DataFrame(insert_rows, columns=list(INSERT_TRIPLES.columns)),
    }


def _codes(graph: Graph, settings: SessionsOf, shares: Shares, root: int, seed: int) -> np.ndarray:
    """The split of each triple of a seed's D¹; shape (T,), int8."""
    if settings.split:
        fold = settings.split.fold
        return published_split(graph, fold, root, seed, shares.valid, shares.test)
    codes = split(graph, root, seed, shares.valid, shares.test)
    check_held_out(codes, shares.valid, shares.test)
    return codes


if __name__ == "__main__":
    make_sessions()
