"""What tables and tensors of one experiment must agree on, each rule once: ids, splits, who is novel, what is told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from isi.errors import InputError
from isi.experiment.grid import StackedVectors
from isi.graph.graph import HEAD, RELATION, TAIL, Graph
from isi.graph.sampling import triples_without
from isi.graph.sessions import OUT, SPLITS, TRAIN, Session
from isi.tables.rules import place_of

CELL = ["size", "seed"]


def ids_below(path: Path, table: pd.DataFrame, column: str, number: int, of: str) -> None:
    """Ids are those of the graph."""
    _refuse(path, table, table[column].to_numpy() >= number, (column,), f"expected ids below {number}, the {of}")


def rows_are_entities(path: Path, table: pd.DataFrame, entities: pd.DataFrame) -> None:
    """A table about entities has them in the graph's order."""
    names = entities["entity"].to_numpy(str)
    own = table["entity"].to_numpy(str)
    if len(own) != len(names):
        raise InputError(path, "", f"expected {len(names)} rows, the entities of the graph, got {len(own)}")
    _refuse(path, table, own != names, ("entity",), "expected the entities of the graph, in its order")


def splits_are_whole(
    path: Path, splits: Mapping[int, np.ndarray], graph: Graph, sources: np.ndarray, novel: pd.DataFrame
) -> None:
    """Every triple has a split, but those of entities that another source adds and the seed does not draw.

    Args:
        splits: of each triple, by seed; shapes: (T,).
        sources: of the entities; shape: (E,).
        novel: who is drawn (``tables.NOVEL``).
    """
    added = np.flatnonzero(sources != sources[0])
    for seed, own in splits.items():
        drawn = novel.loc[novel["seed"] == seed, "entity"].to_numpy()
        taking_part = np.zeros(len(own), dtype=bool)
        taking_part[triples_without(graph, np.setdiff1d(added, drawn))] = True
        for wrong, says in (
            (taking_part & (own == OUT), "has no split: expected one for each triple that takes part"),
            (~taking_part & (own != OUT), "has a split: expected none where an added entity is not drawn"),
        ):
            if wrong.any():
                raise InputError(path, f"seed {seed}, triple {wrong.argmax()}", says)


def every_split_is_there(path: Path, splits: Mapping[int, np.ndarray]) -> None:
    """Every seed has triples to train on, to validate, and to test."""
    for seed, own in splits.items():
        for code, name in enumerate(SPLITS):
            if not (own == code).any():
                raise InputError(path, f"seed {seed}", f"expected triples in {name}, as in every split")


def everyone_is_trained(path: Path, splits: Mapping[int, np.ndarray], graph: Graph) -> None:
    """Every entity and relation that takes part in a seed's triples has a training triple there."""
    triples = graph.triples.numpy()
    for seed, own in splits.items():
        for slot, names in ((HEAD, graph.entities), (RELATION, graph.relations)):
            slots = (HEAD, TAIL) if slot == HEAD else (RELATION,)
            there, trained = (_counts(triples, rows, slots, len(names)) for rows in (own != OUT, own == TRAIN))
            missing = np.flatnonzero((there > 0) & (trained == 0))
            if len(missing):
                expected = f"expected a triple of {names[missing[0]]!r} in train, as of every entity and relation"
                raise InputError(path, f"seed {seed}", expected)


def _counts(triples: np.ndarray, rows: np.ndarray, slots: Sequence[int], number: int) -> np.ndarray:
    return np.bincount(triples[rows][:, slots].ravel(), minlength=number)


def sets_are_whole(path: Path, novel: pd.DataFrame) -> None:
    """Every session of each size and seed has as many entities as its size, and each size the same seeds and sessions.

    Args:
        novel: ``tables.NOVEL``.
    """
    if novel.empty:
        raise InputError(path, "", "expected at least one set of novel entities")
    drawn = novel.groupby([*CELL, "session"])["entity"].transform("size").to_numpy()
    says = "expected as many rows of each size, seed and session as the size"
    _refuse(path, novel, drawn != novel["size"].to_numpy(), (*CELL, "session"), says)
    cells = novel[[*CELL, "session"]].drop_duplicates()
    grid = cells["size"].nunique() * cells["seed"].nunique() * (cells["session"].max() if len(cells) else 0)
    if len(cells) != grid:
        raise InputError(path, "", "expected the same seeds, and the same sessions from 1 on, of every size")


def told_of_their_entity(path: Path, told: pd.DataFrame, novel: pd.DataFrame, graph: Graph) -> None:
    """Insert triples are of an entity that their session inserts, and their other end is known by then.

    Args:
        told: ``tables.INSERT_TRIPLES``.
        novel: ``tables.NOVEL``.
    """
    inserted_in = novel.set_index([*CELL, "entity"])["session"]
    shown = ("size", "seed", "entity", "triple")

    def session_of(entities: np.ndarray) -> np.ndarray:
        """In which each is inserted, in the cell of its row; 0: it is known from the start."""
        index = pd.MultiIndex.from_arrays([told["size"], told["seed"], entities])
        return inserted_in.reindex(index, fill_value=0).to_numpy()

    entity, session = told["entity"].to_numpy(), told["session"].to_numpy()
    own = graph.triples.numpy()[told["triple"].to_numpy()][:, [HEAD, TAIL]]
    _refuse(path, told, session_of(entity) != session, shown, "expected an entity that the session inserts")
    _refuse(path, told, (own == entity[:, None]).sum(1) != 1, shown, "expected the entity at one end of the triple")
    other = np.where(own[:, 0] == entity, own[:, 1], own[:, 0])
    _refuse(path, told, session_of(other) >= session, shown, "expected the other end to be known by then")


def told_from_train(path: Path, told: pd.DataFrame, splits: Mapping[int, np.ndarray]) -> None:
    """No validation or test triple is told.

    Args:
        told: ``tables.INSERT_TRIPLES``.
        splits: of each triple, by seed; shapes: (T,).
    """
    wrong = np.zeros(len(told), dtype=bool)
    for seed, rows in told.groupby("seed").indices.items():
        split = splits.get(int(str(seed)))
        wrong[rows] = True if split is None else split[told["triple"].to_numpy()[rows]] != TRAIN
    _refuse(path, told, wrong, ("size", "seed", "triple"), "expected a triple of the seed's train split")


def vectors_fit(path: Path, theta: StackedVectors, known: np.ndarray, session: Session) -> None:
    """Embeddings know who takes part in their session and nobody else, and have the shapes of graph and family.

    Args:
        known: whom they say they know; shape: (M, E), bool.
        session: in which they were trained.
    """
    models, entities = session.entities.shape
    relations, dimension = len(session.graph.relations), theta.entity.shape[-1]
    has_shape(path, "entity", theta.entity, (models, entities, dimension))
    has_shape(path, "relation", theta.relation, (models, relations, theta.model.width(dimension)))
    has_shape(path, "known", known, (models, entities), np.bool_)
    for name, wrong, says in (
        ("known", known != session.entities.numpy(), "expected it to be who takes part then, and no novel entity"),
        ("entity", theta.entity.any(-1) & ~known, "expected zeros for who is not known"),
    ):
        if wrong.any():
            model, entity = np.argwhere(wrong)[0].tolist()
            raise InputError(path, f"tensor {name!r}, seed's row {model} of these, entity {entity}", says)


def seeds_are(path: Path, seed: np.ndarray, expected: Sequence[int], *tensors: np.ndarray) -> None:
    """Models are of the sessions' seeds, in their order, and each tensor has a row for each."""
    if seed.tolist() != list(expected):
        raise InputError(path, "tensor 'seed'", f"expected the sessions' seeds, {_few(expected)}, got {_few(seed)}")
    if any(tensor.shape[:1] != seed.shape for tensor in tensors):
        raise InputError(path, "", f"expected {len(seed)} rows in every tensor, one for each seed")


def has_shape(
    path: Path, name: str, tensor: np.ndarray, shape: tuple[int, ...], kind: type[np.generic] = np.float32
) -> None:
    """A tensor has the shape that graph, sessions and family give it."""
    if tensor.shape != shape or tensor.dtype != kind:
        got = f"{tensor.dtype} of shape {list(tensor.shape)}"
        raise InputError(path, f"tensor {name!r}", f"expected {kind.__name__} of shape {list(shape)}, got {got}")


def _few(values: Sequence[int] | np.ndarray) -> str:
    listed = [str(value) for value in np.ravel(values)[:6]]
    return ", ".join([*listed, "…"] if np.size(values) > len(listed) else listed) or "none"


def _refuse(path: Path, table: pd.DataFrame, wrong: np.ndarray, columns: Sequence[str], says: str) -> None:
    """Name the first row that is wrong."""
    if wrong.any():
        raise InputError(path, place_of(table, int(wrong.argmax()), columns), says)
