"""Arguments of ``isi.insert`` and ``isi.fit_new``, checked: tables, names, triples, kinds, the model."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ParamSpec, TypeVar

import numpy as np
import torch

from isi.errors import InputError, meant, short
from isi.graph.graph import HEAD, TAIL, Graph
from isi.models.model import Model, make_model
from isi.models.stack import Embedding, NotFinite
from isi.tables import paths

P = ParamSpec("P")
R = TypeVar("R")
#: A triple by names or by ids: head, relation, tail.
Triple = Sequence[str | int]
SLOTS = ("head", "relation", "tail")


@contextmanager
def argument(name: str) -> Iterator[None]:
    """Say of an argument what a mistake within says of nothing yet, or of ``params.yaml``."""
    try:
        yield
    except InputError as error:
        if error.file not in ("", str(paths.PARAMS)) or isinstance(error, NotFinite):
            raise
        within = re.sub(rf"^{name}s?(\.|$)", "", error.place) if error.file else error.place
        raise InputError(f"argument {name!r}", within, error.message) from error


def renamed(**names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """A function that names the new name where it is called with an old name of an argument."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def called(*args: P.args, **kwargs: P.kwargs) -> R:
            for old in names.keys() & kwargs.keys():
                raise InputError(f"argument {old!r}", "", f"expected its new name, {names[old]!r}")
            return function(*args, **kwargs)

        return called

    return decorate


def as_list(values: Any, name: str, of: str) -> list[Any]:
    """The items of an argument.

    Raises:
        InputError: where it is no list, or one text, whose letters nobody means.
    """
    if isinstance(values, str | bytes):
        raise InputError(f"argument {name!r}", "", f"expected a list of {of}, got one text")
    try:
        return list(values)
    except TypeError as error:
        raise InputError(f"argument {name!r}", "", f"expected a list of {of}, got {short(values)}") from error


def texts(values: Any, name: str) -> list[str]:
    """The texts that an argument lists.

    Raises:
        InputError: where an item is no text.
    """
    items = as_list(values, name, "names")
    for item in items:
        if not isinstance(item, str):
            raise InputError(f"argument {name!r}", "", f"expected texts, got {short(item)}")
    return items


def mapping(values: Any, name: str) -> dict[str, Any]:
    """What an argument gives by name; nothing where it is null.

    Raises:
        InputError: where it is no mapping.
    """
    if values is not None and not isinstance(values, Mapping):
        raise InputError(f"argument {name!r}", "", f"expected a mapping of names to values, got {short(values)}")
    return dict(values or {})


def array(values: Any, place: str, expected: str, dtype: type[np.floating[Any]] | None = None) -> np.ndarray:
    """Values as an array.

    Raises:
        InputError: where they are none: texts, rows of several lengths, a tensor with gradient or on a GPU.
    """
    try:
        return np.asarray(values, dtype)
    except (TypeError, ValueError, RuntimeError, OverflowError) as error:  # RuntimeError: of a tensor
        raise InputError(place, "", f"{expected} ({error})") from error


def table(values: Any, name: str, width: int | None = None) -> np.ndarray:
    """A table of finite real numbers, of a width if one is given.

    Raises:
        InputError: where it is none.
    """
    place, expected = f"argument {name!r}", "expected a table of floats (rows, numbers)"
    numbers = array(values, place, expected)
    if np.iscomplexobj(numbers):
        expected = "expected real numbers: of complex vectors the real halves, then the imaginary ones"
        raise InputError(place, "", expected)
    if numbers.ndim != 2 or not np.issubdtype(numbers.dtype, np.floating) or not numbers.size:
        raise InputError(place, "", f"{expected}, got {numbers.dtype} {numbers.shape}")
    if width is not None and numbers.shape[1] != width:
        raise InputError(place, "", f"expected rows of {width} numbers, got rows of {numbers.shape[1]}")
    with np.errstate(over="ignore", invalid="ignore"):
        finite = np.isfinite(numbers.sum())  # quick, but sums of finite numbers may overflow
    if not finite and not (rows := np.isfinite(numbers).all(1)).all():
        raise InputError(place, f"row {int(np.argmin(rows))}", "expected finite numbers, got NaN or infinity")
    return numbers


@dataclass(frozen=True)
class Names:
    """Names of the rows of a table: known ones, then new ones; without names, rows go by id alone."""

    #: ``entity_names`` or ``relation_names``
    argument: str
    number: int
    names: Sequence[str] | None

    @cached_property
    def ids(self) -> dict[str, int]:
        """Ids by name.

        Raises:
            InputError: where there is not one name for each row, or one repeats.
        """
        names = self.names if self.names is not None else ()
        ids = {name: row for row, name in enumerate(names)}
        if self.names is not None and len(names) != self.number:
            raise InputError(f"argument {self.argument!r}", "", f"expected {self.number} names, got {len(names)}")
        if len(ids) < len(names):
            twice = next(name for row, name in enumerate(names) if ids[name] != row)
            raise InputError(f"argument {self.argument!r}", repr(twice)[:80], "expected names that do not repeat")
        return ids

    def of(self, row: int) -> str | int:
        """The name of a row, or its id."""
        return self.names[row] if self.names is not None else row

    def id(self, value: object, place: str) -> int:
        """The id of a name or of an id.

        Raises:
            InputError: where there is none; ``place`` is where it stands.
        """
        if isinstance(value, str):
            if value in self.ids:
                return self.ids[value]
            if self.names is None:
                raise InputError("", place, f"expected an id, as there are no {self.argument!r}, got {value[:80]!r}")
            expected = "a known entity, or a new one" if self.argument == "entity_names" else "a known relation"
            raise InputError("", place, f"expected {expected}, got {value[:80]!r}{meant(value, self.ids)}")
        if isinstance(value, int | np.integer) and not isinstance(value, bool):
            if 0 <= value < self.number:
                return int(value)
            raise InputError("", place, f"expected an id from 0 to {self.number - 1}, got {value}")
        raise InputError("", place, f"expected a name or an id, got {value!r:.80}")


def names_of(argument: str, number: int, names: Sequence[str] | None) -> Names:
    """Names of so many rows.

    Raises:
        InputError: where an argument lists no texts.
    """
    return Names(argument, number, None if names is None else texts(names, argument))


def all_names(known: int, entity_names: Sequence[str] | None, new: int | Sequence[str]) -> Names:
    """Names of known and new entities.

    Raises:
        InputError: where known ones have names and new ones do not, or the other way round, or names repeat.
    """
    number = int(new) if isinstance(new, int | np.integer) and not isinstance(new, bool) else None
    if (number is None) != (entity_names is not None):
        raise InputError("argument 'new'", "", "expected names where 'entity_names' are given, else a number")
    known_names = names_of("entity_names", known, entity_names)
    new_names = [] if number is not None else texts(new, "new")
    if not new_names and (number is None or number < 1):
        raise InputError("argument 'new'", "", "expected at least one new entity")
    if known_names.names is None:
        return Names("entity_names", known + (number or 0), None)
    if len(known_names.names) != known:
        known_names.ids  # noqa: B018  # which says so
    names = Names("entity_names", known + len(new_names), [*known_names.names, *new_names])
    names.ids  # noqa: B018  # which refuses those that repeat
    return names


def checked_model(model: str | Model, options: Mapping[str, Any] | None, dimension: int) -> Model:
    """A model by its name and options, whose vectors may have a dimension.

    Raises:
        InputError: where there is no such model, or it has no such options or no vectors of this dimension.
    """
    given = mapping(options, "model_options")
    if not isinstance(model, str | Model):
        raise InputError("argument 'model'", "", f"expected the name of a model, or a model, got {short(model)}")
    with argument("model"):
        checked = model if isinstance(model, Model) else make_model(model, given, "model")
        checked.width(dimension)
    return checked


@dataclass(frozen=True)
class Arguments:
    """What ``isi.insert`` and ``isi.fit_new`` are both given, checked."""

    #: of known entities, and for ``fit_new`` of new ones
    entities: np.ndarray
    relations: np.ndarray
    model: Model
    names: Names
    relation_names: Names
    #: number of known entities, whose ids come first
    known: int
    #: of new entities, and of known ones; ids, shapes: (T, 3), (K, 3)
    triples: np.ndarray
    known_triples: np.ndarray


def checked_arguments(
    entities: np.ndarray, relations: Any, model: str | Model, model_options: Mapping[str, Any] | None, names: Names,
    relation_names: Sequence[str] | None, known: int, triples: Any, known_triples: Any,
) -> Arguments:  # fmt: skip
    """The arguments of a call; ``entities`` and ``names`` are checked already.

    Raises:
        InputError: naming the argument: also where a triple has no new entity, or a known triple has one.
    """
    checked = checked_model(model, model_options, entities.shape[1])
    rows = table(relations, "relations", checked.width(entities.shape[1]))
    labels = names_of("relation_names", len(rows), relation_names)
    new = triples_of(triples, "triples", names, labels)
    old = triples_of(known_triples if known_triples is not None else [], "known_triples", names, labels)
    for name, wrong, expected in (
        ("triples", (new[:, [HEAD, TAIL]] < known).all(1), "a new entity: triples of known ones are 'known_triples'"),
        ("known_triples", (old[:, [HEAD, TAIL]] >= known).any(1), "known entities alone"),
    ):
        if wrong.any():
            head, relation, tail = (new if name == "triples" else old)[np.argmax(wrong)].tolist()
            triple = f"({names.of(head)}, {labels.of(relation)}, {names.of(tail)})"[:200]
            raise InputError(f"argument {name!r}", triple, f"expected {expected}")
    return Arguments(entities, rows, checked, names, labels, known, new, old)


def stack_of_one(entities: np.ndarray, relations: np.ndarray, model: Model) -> Embedding:
    """Tables as a stack of one embedding in single precision, which shares memory with entities that are."""
    with np.errstate(over="ignore"):  # what is too large is refused later
        entity = torch.from_numpy(np.ascontiguousarray(entities, np.float32))
    return Embedding(entity[None], torch.from_numpy(np.array(relations, np.float32))[None], model)


def graph_of(triples: np.ndarray, theta: Embedding, kinds: np.ndarray | None = None) -> Graph:
    """Triples over the ids of an embedding, each seen once."""
    _, entities, _ = theta.entity.shape
    kind = torch.zeros(entities, dtype=torch.int64) if kinds is None else torch.from_numpy(kinds)
    seen = torch.ones(len(triples), dtype=torch.int64)
    return Graph([""] * entities, [""] * theta.relation.shape[1], torch.from_numpy(triples), seen, kind)


def triples_of(triples: Any, name: str, entities: Names, relations: Names) -> np.ndarray:
    """Unique triples as ids, in the order in which they come; shape (T, 3), int64.

    Raises:
        InputError: naming the triple of which a name or an id is unknown.
    """
    with argument(name):
        if isinstance(triples, np.ndarray) and np.issubdtype(triples.dtype, np.integer) and triples.ndim == 2:
            ids = _in_range(triples, entities.number, relations.number)
        else:
            rows = enumerate(as_list(triples, name, "triples"))
            ids = np.array([_ids(triple, f"triple {row}", entities, relations) for row, triple in rows], dtype=np.int64)
    ids = ids.reshape(-1, 3)
    return ids[np.sort(np.unique(ids, axis=0, return_index=True)[1])] if len(ids) > 1 else ids


def _in_range(triples: np.ndarray, entities: int, relations: int) -> np.ndarray:
    """Triples of ids, checked together."""
    if triples.shape[1] != 3:
        raise InputError("", "", f"expected three columns, got {triples.shape[1]}")
    most = np.array([entities, relations, entities])
    wrong = (triples < 0) | (triples >= most)
    if wrong.any():
        row, slot = np.argwhere(wrong)[0].tolist()
        expected = f"expected an id from 0 to {most[slot] - 1}, got {triples[row, slot]}"
        raise InputError("", f"triple {row}: {SLOTS[slot]}", expected)
    return triples.astype(np.int64)


def _ids(triple: Any, place: str, entities: Names, relations: Names) -> list[int]:
    if isinstance(triple, str | bytes | Set | Mapping) or not hasattr(triple, "__len__") or len(triple) != 3:
        raise InputError("", place, f"expected head, relation and tail, got {triple!r:.80}")
    names = zip(triple, SLOTS, (entities, relations, entities), strict=True)
    return [rows.id(value, f"{place}: {slot}") for value, slot, rows in names]


def kinds_of(kinds: Any, entities: Names) -> np.ndarray:
    """A number for the kind of each entity, the same one where there are no kinds; shape (E,), int64.

    Args:
        kinds: of known and new entities, in order, or by name (those that it lacks are of one more kind).

    Raises:
        InputError: where there is not one for each entity, or one is of an unknown entity.
    """
    if kinds is None:
        return np.zeros(entities.number, dtype=np.int64)
    if isinstance(kinds, Mapping):
        labels = [""] * entities.number
        with argument("kinds"):
            for name, kind in kinds.items():
                labels[entities.id(name, "")] = str(kind)
    else:
        labels = [str(kind) for kind in as_list(kinds, "kinds", "kinds")]
    if len(labels) != entities.number:
        expected = f"expected {entities.number} kinds, of known and new entities, got {len(labels)}"
        raise InputError("argument 'kinds'", "", expected)
    return np.unique(np.array(labels), return_inverse=True)[1].astype(np.int64)
