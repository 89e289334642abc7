"""Arguments of the library as what they must be: lists, texts, mappings, arrays; a mistake is an ``InputError``.

What a user gives, as arrays that are checked: tables, names, triples, kinds. Every mistake is one ``InputError``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch

from isi.config import keywords
from isi.errors import InputError, meant, short
from isi.graph.graph import Graph
from isi.models.distance import TransEL1
from isi.models.model import Model, make_model
from isi.models.stack import Embedding
from isi.tables import paths


@contextmanager
def argument(name: str) -> Iterator[None]:
    """Mistakes that are said of ``params.yaml``, said of an argument."""
    try:
        yield
    except InputError as error:
        file, place, expected = error.args
        if file != str(paths.PARAMS):
            raise
        within = re.sub(rf"{name}s?(\.|$)", "", place, count=1) if place.startswith(name) else place
        raise InputError(f"argument {name!r}", within, expected) from error


def listed(values: Any, name: str, of: str) -> list[Any]:
    """What an argument lists.

    Raises:
        InputError: where it is no list, or a text, whose letters nobody means.
    """
    try:
        each = iter(values)
    except TypeError as error:
        raise InputError(f"argument {name!r}", "", f"expected a list of {of}, got {short(values)}") from error
    if isinstance(values, str | bytes):
        raise InputError(f"argument {name!r}", "", f"expected a list of {of}, got one text")
    return list(each)


def texts(values: Any, name: str) -> list[str]:
    """Names that an argument lists.

    Raises:
        InputError: where one is no text.
    """
    found = listed(values, name, "names")
    wrong = [value for value in found if not isinstance(value, str)]
    if wrong:
        raise InputError(f"argument {name!r}", "", f"expected texts, got {short(wrong[0])}")
    return found


def name_of(value: Any, name: str) -> str | None:
    """The name that an argument gives; null where it gives none.

    Raises:
        InputError: where it is no text.
    """
    if value is not None and not isinstance(value, str):
        raise InputError(f"argument {name!r}", "", f"expected a name, got {short(value)}")
    return value


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
        InputError: where they are none: texts, rows of several lengths, a tensor that learns or lies on a GPU.
    """
    try:
        return np.asarray(values, dtype)
    except (TypeError, ValueError, RuntimeError, OverflowError) as error:  # RuntimeError: of a tensor
        raise InputError(place, "", f"{expected} ({error})") from error


#: A triple by names or by ids: head, relation, tail.
Triple = Sequence[str | int]
#: What stands in a slot of a triple.
SLOTS = ("head", "relation", "tail")


@dataclass(frozen=True)
class Names:
    """What rows of a table are called: known ones, then new ones; without names, they go by id alone."""

    argument: str
    number: int
    given: Sequence[str] | None

    @property
    def of_what(self) -> str:
        """Entity or relation."""
        return self.argument.removesuffix("_names")

    @cached_property
    def ids(self) -> dict[str, int]:
        """Ids by name.

        Raises:
            InputError: where the names are not as many as the rows, or one is twice there.
        """
        given = self.given if self.given is not None else ()
        found = {name: row for row, name in enumerate(given)}
        if self.given is not None and len(given) != self.number:
            raise InputError(f"argument {self.argument!r}", "", f"expected {self.number} names, got {len(given)}")
        if len(found) < len(given):
            twice = next(name for row, name in enumerate(given) if found[name] != row)
            raise InputError(f"argument {self.argument!r}", repr(twice)[:80], "expected names that do not repeat")
        return found

    def of(self, row: int) -> str | int:
        """The name of a row, or its id."""
        return self.given[row] if self.given is not None else row

    def id(self, value: object, place: str) -> int:
        """The id of a name or of an id.

        Raises:
            InputError: where there is none; ``place`` is where it stands.
        """
        if isinstance(value, str):
            if value in self.ids:
                return self.ids[value]
            if self.given is None:
                raise InputError(place, "", f"expected an id, as there are no {self.argument!r}, got {value[:80]!r}")
            known = f"a known {self.of_what}" + (", or a new one" if self.of_what == "entity" else "")
            raise InputError(place, "", f"expected {known}, got {value[:80]!r}{meant(value, self.ids)}")
        if isinstance(value, int | np.integer) and not isinstance(value, bool):
            if 0 <= value < self.number:
                return int(value)
            raise InputError(place, "", f"expected an id from 0 to {self.number - 1}, got {value}")
        raise InputError(place, "", f"expected a name or an id, got {value!r:.80}")


def names_of(argument: str, number: int, given: Sequence[str] | None) -> Names:
    """What so many rows are called, as an argument says.

    Raises:
        InputError: where that lists no texts.
    """
    return Names(argument, number, None if given is None else texts(given, argument))


def all_names(known: int, entity_names: Sequence[str] | None, new: int | Sequence[str]) -> Names:
    """Names of known and new entities.

    Raises:
        InputError: where known ones have names and new ones do not, or the other way round, or names repeat.
    """
    number = int(new) if isinstance(new, int | np.integer) and not isinstance(new, bool) else None
    if (number is None) != (entity_names is not None):
        raise InputError("argument 'new'", "", "expected names where 'entity_names' are given, else a number")
    before = names_of("entity_names", known, entity_names).given
    own = [] if number is not None else texts(new, "new")
    if not own and (number is None or number < 1):
        raise InputError("argument 'new'", "", "expected at least one new entity")
    if before is not None and len(before) != known:
        raise InputError("argument 'entity_names'", "", f"expected {known} names, got {len(before)}")
    names = Names("entity_names", known + (number or len(own)), None if before is None else [*before, *own])
    names.ids  # noqa: B018  # which refuses those that repeat
    return names


def family_of(family: str | Model, options: Mapping[str, Any] | None, entities: np.ndarray) -> Model:
    """A family by its name and options, whose vectors may have the dimension of a table.

    Raises:
        InputError: where there is no such family, or it has no such options or no vectors of this dimension.
    """
    given = mapping(options, "family_options")
    if not isinstance(family, str | Model):
        raise InputError("argument 'family'", "", f"expected the name of a family, or a family, got {short(family)}")
    with argument("family"):
        if isinstance(family, Model):
            found = family
        elif family == "transe_l1":
            found = TransEL1(**keywords(TransEL1.__init__, given, "family"))
        else:
            found = make_model(family, given, "family")
        found.width(entities.shape[1])
    return found


def table(values: Any, name: str, width: int | None = None) -> np.ndarray:
    """A table of finite real numbers, of a width if one is given.

    Raises:
        InputError: where it is none.
    """
    place = f"argument {name!r}"
    found = array(values, place, "expected a table of floats (rows, numbers)")
    if np.iscomplexobj(found):
        expected = "expected real numbers: of complex vectors the real halves, then the imaginary ones"
        raise InputError(place, "", expected)
    if found.ndim != 2 or not np.issubdtype(found.dtype, np.floating) or not found.size:
        raise InputError(place, "", f"expected a table of floats (rows, numbers), got {found.dtype} {found.shape}")
    if width is not None and found.shape[1] != width:
        raise InputError(place, "", f"expected rows of {width} numbers, got rows of {found.shape[1]}")
    with np.errstate(over="ignore", invalid="ignore"):
        finite = np.isfinite(found.sum())  # quick, but sums of finite numbers may overflow
    if not finite and not (each := np.isfinite(found).all(1)).all():
        raise InputError(place, f"row {int(np.argmin(each))}", "expected finite numbers, got NaN or infinity")
    return found


def stack_of_one(entities: np.ndarray, relations: np.ndarray, family: Model) -> Embedding:
    """Tables as a stack of one embedding in single precision, which shares memory with entities that are."""
    with np.errstate(over="ignore"):  # what becomes of too large ones is looked at
        entity = torch.from_numpy(np.ascontiguousarray(entities, np.float32))
    return Embedding(entity[None], torch.from_numpy(np.array(relations, np.float32))[None], family)


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
    if isinstance(triples, np.ndarray) and np.issubdtype(triples.dtype, np.integer) and triples.ndim == 2:
        found = _in_range(triples, name, entities.number, relations.number)
    else:
        found = np.array(
            [_triple(triple, f"argument {name!r}: triple {row}", entities, relations)
             for row, triple in enumerate(listed(triples, name, "triples"))], dtype=np.int64,
        ).reshape(-1, 3)  # fmt: skip
    return found[np.sort(np.unique(found, axis=0, return_index=True)[1])] if len(found) > 1 else found


def _in_range(triples: np.ndarray, name: str, entities: int, relations: int) -> np.ndarray:
    """Triples of ids, checked at once."""
    if triples.shape[1] != 3:
        raise InputError(f"argument {name!r}", "", f"expected three columns, got {triples.shape[1]}")
    most = np.array([entities, relations, entities])
    wrong = (triples < 0) | (triples >= most)
    if wrong.any():
        row, slot = np.argwhere(wrong)[0].tolist()
        place = f"argument {name!r}: triple {row}: {SLOTS[slot]}"
        raise InputError(place, "", f"expected an id from 0 to {most[slot] - 1}, got {triples[row, slot]}")
    return triples.astype(np.int64)


def _triple(triple: Any, place: str, entities: Names, relations: Names) -> tuple[int, int, int]:
    if isinstance(triple, str | bytes | Set | Mapping) or not hasattr(triple, "__len__") or len(triple) != 3:
        raise InputError(place, "", f"expected head, relation and tail, got {triple!r:.80}")
    head, relation, tail = triple
    return (
        entities.id(head, f"{place}: head"), relations.id(relation, f"{place}: relation"),
        entities.id(tail, f"{place}: tail"),
    )  # fmt: skip


def kinds_of(kinds: Any, entities: Names) -> np.ndarray:
    """A number for the kind of each entity, the same one where there are no kinds; shape (E,), int64.

    Args:
        kinds: of known and new entities, in order, or by name (those that are not there are of one kind more).

    Raises:
        InputError: where they are not as many as the entities, or of one that is unknown.
    """
    if kinds is None:
        return np.zeros(entities.number, dtype=np.int64)
    by_name = isinstance(kinds, Mapping)
    found = [""] * entities.number if by_name else [str(kind) for kind in listed(kinds, "kinds", "kinds")]
    if by_name:
        for name, kind in kinds.items():
            found[entities.id(name, "argument 'kinds'")] = str(kind)
    if len(found) != entities.number:
        expected = f"expected {entities.number} kinds, of known and new entities, got {len(found)}"
        raise InputError("argument 'kinds'", "", expected)
    return np.unique(np.array(found), return_inverse=True)[1].astype(np.int64)
