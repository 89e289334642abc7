"""Checks across the files of an experiment:
each raises InputError for ids, splits, sets or shapes that disagree.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from isi.errors import InputError
from isi.graph.graph import HEAD, TAIL, Graph
from isi.graph.sessions import OUT, SPLIT_NAMES, TRAIN
from isi.tables.rules import refuse


def ids_below(path: Path, table: pd.DataFrame, column: str, number: int, of: str) -> None:
    """Check that ids in a column are below ``number``."""
    refuse(
        path,
        table,
        table[column].to_numpy() >= number,
        [column],
        f"expected ids below {number} (number of {of})",
    )


def splits_are_whole(path: Path, splits: Mapping[int, np.ndarray]) -> None:
    """Check that train, valid and test of each seed have triples."""
    for seed, split in splits.items():
        if empty := [name for code, name in enumerate(SPLIT_NAMES) if code not in split]:
            raise InputError(path, f"seed {seed}", f"expected at least one triple in {empty[0]}")


def novel_sets_are_whole(path: Path, novel: pd.DataFrame, seeds: Sequence[int]) -> None:
    """Check that each session has ``size`` entities,
    and that all sizes have the same seeds and sessions.
    """
    if novel.empty:
        raise InputError(path, "", "expected at least one set of novel entities")
    columns = ["size", "seed", "session"]
    of_set = novel.groupby(columns)["entity"]
    expected = "expected the number of novel entities to equal size, in each session of each seed"
    refuse(path, novel, of_set.transform("size") != novel["size"], columns, expected)
    if of_set.ngroups != novel["size"].nunique() * novel["seed"].nunique() * novel["session"].max():
        raise InputError(
            path, "", "expected the same seeds, and the same sessions from 1 on, for every size"
        )
    if not set(novel["seed"]) <= set(seeds):
        raise InputError(path, "column 'seed'", "expected only seeds that have splits")


def insert_triples_fit(
    path: Path,
    given: pd.DataFrame,
    novel: pd.DataFrame,
    splits: Mapping[int, np.ndarray],
    graph: Graph,
) -> None:
    """Check that insert triples are training triples of an entity of their
    session with a known other end.
    """
    point = ["size", "seed"]
    inserted_in = novel.set_index([*point, "entity"])["session"]

    def session_of(entities: np.ndarray) -> np.ndarray:
        """The session in which each entity is inserted, at the grid point of its row;
        0: known from the start.
        """
        index = pd.MultiIndex.from_arrays([given["size"], given["seed"], entities])
        return inserted_in.reindex(index, fill_value=0).to_numpy()

    entity, session, triple = (
        given[name].to_numpy(np.int64) for name in ("entity", "session", "triple")
    )
    ends, none = graph.triples.numpy()[triple][:, [HEAD, TAIL]], np.full(len(graph.triples), OUT)
    split = [splits.get(seed, none)[row] for seed, row in zip(given["seed"], triple, strict=True)]
    for wrong, expected in (
        (session_of(entity) != session, "expected an entity that the session inserts"),
        ((ends == entity[:, None]).sum(1) != 1, "expected the entity at one end of the triple"),
        (
            session_of(ends.sum(1) - entity) >= session,
            "expected the other end to be known before the session",
        ),
        (np.array(split) != TRAIN, "expected a triple of the seed's train split"),
    ):
        refuse(path, given, wrong, [*point, "entity", "triple"], expected)


def known_are(
    path: Path, seeds: Sequence[int], known: np.ndarray, expected: np.ndarray, entity: np.ndarray
) -> None:
    """Check that ``known``, (M, E), marks the session's entities;
    other rows of ``entity``, (M, E, d), must be 0.
    """
    for model, row in np.argwhere((known != expected) | (entity.any(-1) & ~known))[:1].tolist():
        place = f"seed {seeds[model]}, entity {row}"
        raise InputError(
            path,
            place,
            "expected known entities to be those of the session, and zeros for all others",
        )


def has_shape(
    path: Path,
    name: str,
    tensor: np.ndarray,
    shape: tuple[int, ...],
    kind: type[np.generic] = np.float32,
) -> None:
    """InputError unless a tensor has the given shape and dtype (``kind``)."""
    if tensor.shape != shape or tensor.dtype != kind:
        got = f"{tensor.dtype} of shape {list(tensor.shape)}"
        raise InputError(
            path, f"tensor {name!r}", f"expected {kind.__name__} of shape {list(shape)}, got {got}"
        )
