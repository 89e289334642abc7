"""What the tables and tensors of one experiment must agree on: ids, splits, novel entities, insert triples, shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from isi.errors import InputError, short
from isi.experiment.grid import StackedVectors
from isi.graph.graph import HEAD, RELATION, TAIL, Graph
from isi.graph.sampling import triples_without
from isi.graph.sessions import OUT, SPLITS, TRAIN, Session
from isi.tables.rules import place_of

GRID_POINT = ["size", "seed"]


def ids_below(path: Path, table: pd.DataFrame, column: str, number: int, of: str) -> None:
    """Ids are those of the graph."""
    _refuse(path, table, table[column].to_numpy() >= number, [column], f"expected ids below {number}, the {of}")


def rows_are_entities(path: Path, table: pd.DataFrame, entities: pd.DataFrame) -> None:
    """A table about entities has them in the graph's order."""
    if len(table) != len(entities):
        raise InputError(path, "", f"expected {len(entities)} rows, the entities of the graph, got {len(table)}")
    differs = table["entity"].to_numpy(str) != entities["entity"].to_numpy(str)
    _refuse(path, table, differs, ["entity"], "expected the entities of the graph, in its order")


def splits_are_whole(
    path: Path, splits: Mapping[int, np.ndarray], graph: Graph, sources: np.ndarray, novel: pd.DataFrame
) -> None:
    """Every triple has a split, but those of entities that another source adds and the seed does not draw.

    Each split has triples, and each entity and relation with triples has one to train on.

    Args:
        splits: of each triple, by seed; shapes: (T,).
        sources: of the entities; shape: (E,).
        novel: ``NOVEL``.
    """
    added, triples = np.flatnonzero(sources != sources[0]), graph.triples.numpy()
    for seed, split in splits.items():
        drawn = novel.loc[novel["seed"] == seed, "entity"].to_numpy()
        takes_part = np.zeros(len(split), dtype=bool)
        takes_part[triples_without(graph, np.setdiff1d(added, drawn))] = True
        for wrong, expected in (
            (takes_part & (split == OUT), "has no split: expected one for each triple that takes part"),
            (~takes_part & (split != OUT), "has a split: expected none where an added entity is not drawn"),
        ):
            if wrong.any():
                raise InputError(path, f"seed {seed}, triple {wrong.argmax()}", expected)
        for code, name in enumerate(SPLITS):
            if not (split == code).any():
                raise InputError(path, f"seed {seed}", f"expected triples in {name}, as in every split")
        for slots, names in (([HEAD, TAIL], graph.entities), ([RELATION], graph.relations)):
            untrained = np.setdiff1d(triples[split != OUT][:, slots], triples[split == TRAIN][:, slots])
            if len(untrained):
                expected = f"expected a triple of {names[untrained[0]]!r} in train, as of every entity and relation"
                raise InputError(path, f"seed {seed}", expected)


def novel_sets_are_whole(path: Path, novel: pd.DataFrame, splits: Mapping[int, np.ndarray]) -> None:
    """Every session has as many entities as its size; each size has the same seeds, which have splits, and sessions."""
    if novel.empty:
        raise InputError(path, "", "expected at least one set of novel entities")
    columns = [*GRID_POINT, "session"]
    drawn = novel.groupby(columns)["entity"].transform("size").to_numpy()
    expected = "expected as many rows of each size, seed and session as the size"
    _refuse(path, novel, drawn != novel["size"].to_numpy(), columns, expected)
    if (
        len(novel[columns].drop_duplicates())
        != novel["size"].nunique() * novel["seed"].nunique() * novel["session"].max()
    ):
        raise InputError(path, "", "expected the same seeds, and the same sessions from 1 on, of every size")
    if not set(novel["seed"]) <= set(splits):
        raise InputError(path, "column 'seed'", "expected seeds that have splits")


def insert_triples_fit(path: Path, given: pd.DataFrame, novel: pd.DataFrame, graph: Graph) -> None:
    """Insert triples are of an entity that their session inserts, and their other end is known by then.

    Args:
        given: ``INSERT_TRIPLES``.
        novel: ``NOVEL``.
    """
    inserted_in = novel.set_index([*GRID_POINT, "entity"])["session"]
    shown = ["size", "seed", "entity", "triple"]

    def session_of(entities: np.ndarray) -> np.ndarray:
        """In which each is inserted, at the grid point of its row; 0: it is known from the start."""
        index = pd.MultiIndex.from_arrays([given["size"], given["seed"], entities])
        return inserted_in.reindex(index, fill_value=0).to_numpy()

    entity, session = given["entity"].to_numpy(), given["session"].to_numpy()
    ends = graph.triples.numpy()[given["triple"].to_numpy()][:, [HEAD, TAIL]]
    _refuse(path, given, session_of(entity) != session, shown, "expected an entity that the session inserts")
    at_one_end = (ends == entity[:, None]).sum(1) == 1
    _refuse(path, given, ~at_one_end, shown, "expected the entity at one end of the triple")
    other = np.where(ends[:, 0] == entity, ends[:, 1], ends[:, 0])
    _refuse(path, given, session_of(other) >= session, shown, "expected the other end to be known by then")


def insert_triples_train(path: Path, given: pd.DataFrame, splits: Mapping[int, np.ndarray]) -> None:
    """No validation or test triple is an insert triple.

    Args:
        given: ``INSERT_TRIPLES``.
        splits: of each triple, by seed; shapes: (T,).
    """
    wrong = np.ones(len(given), dtype=bool)
    for seed, split in splits.items():
        rows = (given["seed"] == seed).to_numpy()
        wrong[rows] = split[given["triple"].to_numpy()[rows]] != TRAIN
    _refuse(path, given, wrong, ["size", "seed", "triple"], "expected a triple of the seed's train split")


def vectors_fit(path: Path, theta: StackedVectors, known: np.ndarray, session: Session) -> None:
    """Embeddings know the entities of their session and no others, and have the shapes of graph and model.

    Args:
        known: entities that they say they know; shape: (M, E), bool.
        session: in which they were trained.
    """
    models, entities = session.entities.shape
    relations, dimension = len(session.graph.relations), theta.entity.shape[-1]
    has_shape(path, "entity", theta.entity, (models, entities, dimension))
    has_shape(path, "relation", theta.relation, (models, relations, theta.model.width(dimension)))
    has_shape(path, "known", known, (models, entities), np.bool_)
    for name, wrong, expected in (
        ("known", known != session.entities.numpy(), "expected the entities of the session, and no novel entity"),
        ("entity", theta.entity.any(-1) & ~known, "expected zeros for an entity that is not known"),
    ):
        if wrong.any():
            model, entity = np.argwhere(wrong)[0].tolist()
            raise InputError(path, f"tensor {name!r}, model {model} of these seeds, entity {entity}", expected)


def seeds_are(path: Path, seed: np.ndarray, expected: Sequence[int], *tensors: np.ndarray) -> None:
    """Models are of the sessions' seeds, in their order, and each tensor has a row for each."""
    if seed.tolist() != list(expected):
        raise InputError(path, "tensor 'seed'", f"expected the sessions' seeds, {short(expected)}, got {short(seed)}")
    if any(tensor.shape[:1] != seed.shape for tensor in tensors):
        raise InputError(path, "", f"expected {len(seed)} rows in every tensor, one for each seed")


def has_shape(
    path: Path, name: str, tensor: np.ndarray, shape: tuple[int, ...], kind: type[np.generic] = np.float32
) -> None:
    """A tensor has the shape that graph, sessions and model give it."""
    if tensor.shape != shape or tensor.dtype != kind:
        got = f"{tensor.dtype} of shape {list(tensor.shape)}"
        raise InputError(path, f"tensor {name!r}", f"expected {kind.__name__} of shape {list(shape)}, got {got}")


def _refuse(path: Path, table: pd.DataFrame, wrong: np.ndarray, columns: Sequence[str], expected: str) -> None:
    """Name the first row that is wrong."""
    if wrong.any():
        raise InputError(path, place_of(table, int(wrong.argmax()), columns), expected)
