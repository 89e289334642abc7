"""Checks across the files of an experiment: each raises InputError for ids, splits, sets or shapes that disagree."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from isi.errors import InputError, short
from isi.graph.graph import Graph
from isi.graph.sessions import OUT, SPLIT_NAMES, TRAIN
from isi.tables.rules import refuse

ENDS = [0, 2]


def ids_below(path: Path, table: pd.DataFrame, column: str, number: int, of: str) -> None:
    """Check that ids in a column are below ``number``."""
    refuse(path, table, table[column].to_numpy() >= number, [column], f"expected ids below {number} (number of {of})")


def rows_are_entities(path: Path, table: pd.DataFrame, entities: pd.DataFrame) -> None:
    """Check that a table lists the entities in the graph's order."""
    if len(table) != len(entities):
        raise InputError(path, "", f"expected {len(entities)} rows, one per entity of the graph, got {len(table)}")
    differs = table["entity"].to_numpy(str) != entities["entity"].to_numpy(str)
    refuse(path, table, differs, ["entity"], "expected the entities of the graph, in its order")


def splits_are_whole(
    path: Path, splits: Mapping[int, np.ndarray], graph: Graph, sources: np.ndarray, novel: pd.DataFrame
) -> None:
    """Check: a triple has no split if and only if an added end is not novel; no split is empty; train has all names."""
    triples = graph.triples.numpy()
    for seed, split in splits.items():
        absent = np.setdiff1d(np.flatnonzero(sources != sources[0]), novel.loc[novel["seed"] == seed, "entity"])
        is_absent = np.isin(triples[:, ENDS], absent).any(axis=1)
        for wrong in np.flatnonzero(is_absent != (split == OUT))[:1].tolist():
            has = "has no split" if split[wrong] == OUT else "has a split"
            expected = "expected a split for each triple, except those with an added entity that is not novel"
            raise InputError(path, f"seed {seed}, triple {wrong}", f"{has}: {expected}")
        for code, name in enumerate(SPLIT_NAMES):
            if not (split == code).any():
                raise InputError(path, f"seed {seed}", f"expected at least one triple in {name}")
        for slots, named in ((ENDS, graph.entities), ([1], graph.relations)):
            untrained = np.setdiff1d(triples[split != OUT][:, slots], triples[split == TRAIN][:, slots])
            if len(untrained):
                expected = f"expected a triple of {named[untrained[0]]!r} in train: every entity and relation needs one"
                raise InputError(path, f"seed {seed}", expected)


def novel_sets_are_whole(path: Path, novel: pd.DataFrame, seeds: Sequence[int]) -> None:
    """Check that each session has ``size`` entities, and that all sizes have the same seeds and sessions."""
    if novel.empty:
        raise InputError(path, "", "expected at least one set of novel entities")
    columns = ["size", "seed", "session"]
    of_set = novel.groupby(columns)["entity"]
    expected = "expected the number of novel entities to equal size, in each session of each seed"
    refuse(path, novel, of_set.transform("size") != novel["size"], columns, expected)
    if of_set.ngroups != novel["size"].nunique() * novel["seed"].nunique() * novel["session"].max():
        raise InputError(path, "", "expected the same seeds, and the same sessions from 1 on, for every size")
    if not set(novel["seed"]) <= set(seeds):
        raise InputError(path, "column 'seed'", "expected only seeds that have splits")


def insert_triples_fit(
    path: Path, given: pd.DataFrame, novel: pd.DataFrame, splits: Mapping[int, np.ndarray], graph: Graph
) -> None:
    """Check that insert triples are training triples of an entity of their session with a known other end."""
    point = ["size", "seed"]
    inserted_in = novel.set_index([*point, "entity"])["session"]

    def session_of(entities: np.ndarray) -> np.ndarray:
        """The session in which each entity is inserted, at the grid point of its row; 0: known from the start."""
        index = pd.MultiIndex.from_arrays([given["size"], given["seed"], entities])
        return inserted_in.reindex(index, fill_value=0).to_numpy()

    entity, session, triple = (given[name].to_numpy(np.int64) for name in ("entity", "session", "triple"))
    ends, none = graph.triples.numpy()[triple][:, ENDS], np.full(len(graph.triples), OUT)
    split = [splits.get(seed, none)[row] for seed, row in zip(given["seed"], triple, strict=True)]
    for wrong, expected in (
        (session_of(entity) != session, "expected an entity that the session inserts"),
        ((ends == entity[:, None]).sum(1) != 1, "expected the entity at one end of the triple"),
        (session_of(ends.sum(1) - entity) >= session, "expected the other end to be known before the session"),
        (np.array(split) != TRAIN, "expected a triple of the seed's train split"),
    ):
        refuse(path, given, wrong, [*point, "entity", "triple"], expected)


def seeds_are(path: Path, seed: np.ndarray, expected: Sequence[int], *tensors: np.ndarray) -> None:
    """Check that ``seed`` equals the sessions' seeds, in order, and that each tensor has a row for each seed."""
    if seed.tolist() != list(expected):
        raise InputError(path, "tensor 'seed'", f"expected the sessions' seeds, {short(expected)}, got {short(seed)}")
    if any(tensor.shape[:1] != seed.shape for tensor in tensors):
        raise InputError(path, "", f"expected {len(seed)} rows in every tensor, one for each seed")


def known_are(path: Path, seeds: Sequence[int], known: np.ndarray, expected: np.ndarray, entity: np.ndarray) -> None:
    """Check ``known``, (M, E), against the session's entities; other rows of ``entity``, (M, E, d), must be zero."""
    for name, wrong, says in (
        ("known", known != expected, "expected the entities of the session, and no others"),
        ("entity", entity.any(-1) & ~known, "expected zeros for an entity that is not known"),
    ):
        if wrong.any():
            model, row = np.argwhere(wrong)[0].tolist()
            raise InputError(path, f"tensor {name!r}, seed {seeds[model]}, entity {row}", says)


def has_shape(
    path: Path, name: str, tensor: np.ndarray, shape: tuple[int, ...], kind: type[np.generic] = np.float32
) -> None:
    """InputError unless a tensor has the given shape and dtype (``kind``)."""
    if tensor.shape != shape or tensor.dtype != kind:
        got = f"{tensor.dtype} of shape {list(tensor.shape)}"
        raise InputError(path, f"tensor {name!r}", f"expected {kind.__name__} of shape {list(shape)}, got {got}")
