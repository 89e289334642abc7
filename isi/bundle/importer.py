"""Embeddings that others have trained, in the form that is kept.

Names and triples from files: PyKEEN's ``training_triples``, OpenKE's ``entity2id.txt``, or a name a line.
"""

from __future__ import annotations

import csv
import gzip
import hashlib
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from isi.bundle.folder import distinct_names
from isi.bundle.import_tensors import tables
from isi.bundle.manifest import Bundle, Manifest
from isi.bundle.query import plain
from isi.config import Option
from isi.errors import InputError
from isi.insertion.arguments import checked_model, stack_of_one, table
from isi.insertion.choose import margin_of
from isi.models.model import MODELS
from isi.sources.triples_with_ids import _names, read_ids

if TYPE_CHECKING:
    from isi.models.model import Model
    from isi.models.stack import Embedding


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
) -> Bundle:
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
    return as_bundle(family, options, entities, relations, named, origin)


def as_bundle(
    family: str, options: Mapping[str, Option], entities: np.ndarray, relations: np.ndarray, named: Named,
    origin: Origin,
) -> Bundle:  # fmt: skip
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
    about = Manifest(family=family, family_options=dict(options), words=None, made=origin.made(), inserted=[])
    phrases = [plain(name) for name in named.entities]
    triples = np.unique(named.triples, axis=0) if len(named.triples) else named.triples
    return Bundle(about, entities, relations, named.entities, [""] * len(phrases), phrases, named.relations, triples)


def of_pykeen_model(embedding: Embedding, named: Named, origin: Origin) -> Bundle:
    """A model of PyKEEN's as ``isi.pykeen`` reads it.

    Raises:
        InputError: where its family has no closed form, so that no folder says what it is.
    """
    family = embedding.model
    name = next((one for one in NAMES if type(family) is _class(one)), None)
    if name is None:
        expected = "expected TransE, DistMult, ComplEx or RotatE: others are inserted into by isi.pykeen.insert"
        raise InputError(origin.files[0], "", expected)
    return as_bundle(name, vars(family), embedding.entity[0].numpy(), embedding.relation[0].numpy(), named, origin)


def _class(name: str) -> type[Model]:
    return MODELS.get(name, "family")


def _family(name: str, options: Mapping[str, Option], entities: np.ndarray) -> Model:
    try:
        return checked_model(name, options, entities.shape[1])
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
    margin = 1.0 + margin_of(embedding, torch.from_numpy(triples), None)
    return {**options, "margin": max(margin, 1e-6)}


#: OpenKE's files, and PyKEEN's folder.
ENTITY2ID, RELATION2ID, TRAIN2ID, PYKEEN = "entity2id.txt", "relation2id.txt", "train2id.txt", "training_triples"
#: Files of names where there is neither.
ENTITY_NAMES, RELATION_NAMES, TRIPLES = "entities.txt", "relations.txt", "triples.tsv"


@dataclass(frozen=True, eq=False)
class Named:
    """What rows are called, and what is known of them."""

    entities: list[str]
    relations: list[str]
    #: ids; shape: (T, 3), int64
    triples: np.ndarray


def of_pykeen(folder: Path) -> Named:
    """Labels and training triples as PyKEEN saves them (its tables; not its pickle of metadata).

    Raises:
        InputError: where a file is missing or broken.
    """
    entities, relations = (_labels(folder / f"{what}_to_id.tsv.gz") for what in ("entity", "relation"))
    path = folder / "numeric_triples.tsv.gz"
    rows = _rows(path, ["head", "relation", "tail"])
    try:
        triples = np.array(rows, dtype=np.int64).reshape(-1, 3)
    except (ValueError, OverflowError) as error:
        raise InputError(path, "", "expected ids") from error
    wrong = (triples < 0) | (triples >= [len(entities), len(relations), len(entities)])
    if wrong.any():
        row = int(np.argmax(wrong.any(1)))
        raise InputError(
            path, f"line {row + 2}", f"expected ids of {len(entities)} entities, {len(relations)} relations"
        )
    return Named(entities, relations, triples)


def _labels(path: Path) -> list[str]:
    """Labels in the order of ids."""
    rows = _rows(path, ["id", "label"])
    by_id: dict[str, str] = dict(rows)
    if set(by_id) != {str(number) for number in range(len(rows))}:
        raise InputError(path, "", f"expected the ids from 0 to {len(rows) - 1}")
    labels = [by_id[str(number)] for number in range(len(rows))]
    distinct_names(path, labels)
    return labels


def _rows(path: Path, columns: list[str]) -> list[list[str]]:
    try:
        with gzip.open(path, "rt", encoding="utf-8", newline="") as file:
            header, *rows = csv.reader(file, delimiter="\t")
    except (OSError, EOFError, zlib.error, UnicodeDecodeError, csv.Error, ValueError) as error:
        raise InputError(path, "", f"expected a compressed table of {', '.join(columns)} ({error})") from error
    if header != columns or any(len(row) != len(columns) for row in rows):
        raise InputError(path, "line 1", f"expected the columns {', '.join(columns)}")
    return rows


def of_openke(folder: Path) -> Named:
    """Names and training triples as OpenKE has them; without ``train2id.txt``, no triples.

    Raises:
        InputError: where a file is missing or broken.
    """
    entities, relations = _names(folder / ENTITY2ID), _names(folder / RELATION2ID)
    known = list(read_ids(folder, [TRAIN2ID])) if (folder / TRAIN2ID).exists() else []
    by_name = tuple({name: row for row, name in enumerate(names)} for names in (entities, relations))
    return Named(entities, relations, _as_ids(folder / TRAIN2ID, known, *by_name))


def of_lists(entities: Path, relations: Path, triples: Path | None) -> Named:
    """Names, one a line in the order of rows, and triples as tab-separated names.

    Raises:
        InputError: where a file is missing or broken, or names a triple of which no row is.
    """
    names, labels = _listed(entities), _listed(relations)
    by_name = distinct_names(entities, names, first=1), distinct_names(relations, labels, first=1)
    lines = [] if triples is None else _listed(triples)
    rows = [line.split("\t") for line in lines if lines != [""]]
    for number, row in enumerate(rows, 1):
        if len(row) != 3:
            raise InputError(triples, f"line {number}", f"expected head, relation and tail, got {len(row)} columns")
    return Named(names, labels, _as_ids(triples, rows, *by_name))


def _listed(path: Path) -> list[str]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, "", f"expected text, a name a line ({error})") from error
    return [line.removesuffix("\r") for line in text.removesuffix("\n").split("\n")]


def _as_ids(
    path: Path | None, rows: Sequence[Sequence[str]], entities: Mapping[str, int], relations: Mapping[str, int]
) -> np.ndarray:
    found = np.zeros((len(rows), 3), dtype=np.int64)
    for number, row in enumerate(rows):
        for slot, ids in enumerate((entities, relations, entities)):
            if row[slot] not in ids:
                raise InputError(path, f"line {number + 1}", f"expected a known name, got {row[slot]!r:.80}")
            found[number, slot] = ids[row[slot]]
    return found
