"""Embeddings that others have trained, in the form that is kept."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from isi.asking.finding import plain
from isi.base.errors import InputError
from isi.base.params import Option
from isi.families import FAMILIES
from isi.importing.names import Named
from isi.importing.tensors import tables
from isi.inserting.given import family_of, stack_of_one, table
from isi.inserting.margins import middle
from isi.inserting.taxicab import TransEL1
from isi.keeping.kept import About, Kept

if TYPE_CHECKING:
    from isi.embeddings.family import Family
    from isi.embeddings.stack import Embedding

#: Families whose options are of distances.
DISTANCES = {"transe": ("margin", "squared"), "rotate": ("margin", "squared"), "transe_l1": ("margin",)}
NAMES = ("analogy", "complex", "distmult", "rotate", "transe", "transe_l1")


@dataclass(frozen=True)
class Origin:
    """Where an embedding comes from."""

    #: of what form
    form: str
    #: that were read
    files: Sequence[Path]

    def made(self) -> dict[str, Any]:
        """As it is kept: the SHA-256 of each file."""
        return {"imported": self.form, "files": {path.name: _digest(path) for path in self.files}}


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def of_tensors(
    tensors: Mapping[str, np.ndarray], named: Named, family: str, options: Mapping[str, Option], origin: Origin
) -> Kept:
    """Tables as the folder that keeps them.

    The margin of distances, where none is given, lies halfway between known triples and corrupted ones.

    Raises:
        InputError: where tables and names do not fit, or the tables are not of the family.
    """
    place = origin.files[0]
    entities, relations = tables(tensors, family, place)
    if family in DISTANCES:
        options = {"squared": False} | dict(options) if "squared" in DISTANCES[family] else dict(options)
        if "margin" not in options:
            options = _with_margin(family, options, entities, relations, named.triples, place)
    return kept(family, options, entities, relations, named, origin)


def kept(
    family: str, options: Mapping[str, Option], entities: np.ndarray, relations: np.ndarray, named: Named,
    origin: Origin,
) -> Kept:  # fmt: skip
    """Tables and names, checked against each other and against the family.

    Raises:
        InputError: where they do not fit.
    """
    place = origin.files[0]
    kind = _family(family, options, entities)
    try:
        table(entities, "entities")
        table(relations, "relations", kind.width(entities.shape[1]))
    except InputError as error:
        what, *rest = error.args
        raise InputError(place, what.removeprefix("argument ").strip("'"), ": ".join(filter(None, rest))) from error
    for values, names, what in ((entities, named.entities, "entities"), (relations, named.relations, "relations")):
        if len(values) != len(names):
            raise InputError(place, what, f"expected a row for each of {len(names)} names, got {len(values)}")
    about = About(family=family, family_options=dict(options), words=None, made=origin.made(), inserted=[])
    phrases = [plain(name) for name in named.entities]
    triples = np.unique(named.triples, axis=0) if len(named.triples) else named.triples
    return Kept(about, entities, relations, named.entities, [""] * len(phrases), phrases, named.relations, triples)


def of_pykeen_model(embedding: Embedding, named: Named, origin: Origin) -> Kept:
    """A model of PyKEEN's as ``isi.pykeen`` reads it.

    Raises:
        InputError: where its family has no closed form, so that no folder says what it is.
    """
    family = embedding.family
    name = next((one for one in NAMES if type(family) is _class(one)), None)
    if name is None:
        expected = "expected TransE, DistMult, ComplEx or RotatE: others are inserted into by isi.pykeen.insert"
        raise InputError(origin.files[0], "", expected)
    return kept(name, vars(family), embedding.entity[0].numpy(), embedding.relation[0].numpy(), named, origin)


def _class(name: str) -> type[Family]:
    return TransEL1 if name == "transe_l1" else FAMILIES.get(name, "family")


def _family(name: str, options: Mapping[str, Option], entities: np.ndarray) -> Family:
    try:
        return family_of(name, options, entities)
    except InputError as error:
        raise InputError("--family", name, ": ".join(filter(None, error.args[1:]))) from error


def _with_margin(
    family: str, options: Mapping[str, Option], entities: np.ndarray, relations: np.ndarray, triples: np.ndarray,
    place: Path,
) -> dict[str, Option]:  # fmt: skip
    """The options with a margin: from distances above 0 on; a family takes none of 0, so the score is shifted."""
    if not len(triples):
        raise InputError("--set", "margin", "expected margin=NUMBER: there are no triples to read it off")
    some = _family(family, {**options, "margin": 1.0}, entities)
    try:
        fits = table(relations, "relations", some.width(entities.shape[1]))
        embedding = stack_of_one(table(entities, "entities"), fits, some)
    except InputError as error:
        what, *rest = error.args
        raise InputError(place, what.removeprefix("argument ").strip("'"), ": ".join(filter(None, rest))) from error
    limits = [len(entities), len(relations), len(entities)]
    if (triples >= limits).any():
        raise InputError(place, "", f"expected rows for all names, got {limits[0]} entities and {limits[1]} relations")
    margin = 1.0 + middle(embedding, torch.from_numpy(triples), None)
    return {**options, "margin": max(margin, 1e-6)}
