"""Embeddings that other tools have trained, as bundles: names, triples and tensors of PyKEEN, OpenKE or plain lists."""

from __future__ import annotations

import csv
import gzip
import hashlib
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from isi.bundle.folder import distinct_names, triple_ids
from isi.bundle.import_tensors import tables
from isi.bundle.manifest import Bundle, Manifest
from isi.bundle.names import plain
from isi.config import Option
from isi.errors import InputError
from isi.insertion.arguments import checked_model, stack_of_one, table
from isi.insertion.choose import margin_of
from isi.models.model import MODELS
from isi.models.stack import Embedding
from isi.sources.triples_with_ids import read_id_names, read_ids

#: PyKEEN's folder and OpenKE's files; files of names, one a line, where there is neither.
PYKEEN, ENTITY2ID, RELATION2ID, TRAIN2ID = "training_triples", "entity2id.txt", "relation2id.txt", "train2id.txt"
ENTITY_NAMES, RELATION_NAMES, TRIPLES = "entities.txt", "relations.txt", "triples.tsv"


@dataclass(frozen=True, eq=False)
class Labels:
    """Names of an embedding's rows, and its known triples."""

    #: where they were read: PyKEEN, entity2id, arrays
    form: str
    entities: list[str]
    relations: list[str]
    #: ids; shape: (T, 3), int64
    triples: np.ndarray


def of_tensors(
    tensors: Mapping[str, np.ndarray], labels: Labels, model: str, options: Mapping[str, Option], files: Sequence[Path]
) -> Bundle:
    """A bundle of tensors and labels.

    A distance model without a margin gets one halfway between the mean scores of known and of corrupted triples.

    Raises:
        InputError: naming the argument, or the first of ``files``, that does not fit the others.
    """
    entities, relations = tables(tensors, model, files[0])
    fields = getattr(MODELS.get(model, "--family"), "__dataclass_fields__", {})
    options = ({"squared": False} if "squared" in fields else {}) | dict(options)
    if "margin" in fields and "margin" not in options:
        options |= {"margin": _margin(model, options, entities, relations, labels.triples, files[0])}
    return as_bundle(model, options, entities, relations, labels, files)


def as_bundle(
    model: str, options: Mapping[str, Option], entities: np.ndarray, relations: np.ndarray, labels: Labels,
    files: Sequence[Path],
) -> Bundle:  # fmt: skip
    """Tables and labels as a bundle, checked against each other and against the model.

    Raises:
        InputError: where they do not fit.
    """
    table(entities, "entities")
    table(relations, "relations", checked_model(model, options, entities.shape[1]).width(entities.shape[1]))
    for values, names, what in ((entities, labels.entities, "entities"), (relations, labels.relations, "relations")):
        if len(values) != len(names):
            raise InputError(files[0], what, f"expected a row for each of {len(names)} names, got {len(values)}")
    options = {key: vars(checked_model(model, options, entities.shape[1]))[key] for key in options}
    made = {"imported": labels.form, "files": {path.name: _sha256(path) for path in files}}
    manifest = Manifest(model_name=model, model_options=options, words=None, made=made, inserted=[])
    phrases = [plain(name) for name in labels.entities]
    triples = np.unique(labels.triples, axis=0) if len(labels.triples) else labels.triples
    return Bundle(
        manifest, entities, relations, labels.entities, [""] * len(phrases), phrases, labels.relations, triples
    )


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def of_pykeen_model(embedding: Embedding, labels: Labels, path: Path) -> Bundle:
    """A bundle of a PyKEEN model as ``isi.pykeen`` reads it.

    Raises:
        InputError: where its scoring function has no closed form, which a manifest could not describe.
    """
    model = embedding.model
    name = next((name for name in MODELS.names() if type(model) is MODELS.get(name, "")), None)
    if name is None:
        expected = "expected TransE, DistMult, ComplEx or RotatE: isi.pykeen.insert takes other models"
        raise InputError(path, "", expected)
    return as_bundle(name, vars(model), embedding.entity[0].numpy(), embedding.relation[0].numpy(), labels, [path])


def _margin(
    model: str, options: Mapping[str, Option], entities: np.ndarray, relations: np.ndarray, triples: np.ndarray,
    path: Path,
) -> float:  # fmt: skip
    """The margin that puts 0 halfway between known and corrupted triples; it is measured with a margin of 1."""
    if not len(triples):
        raise InputError("--set", "margin", "expected margin=NUMBER: without known triples it cannot be estimated")
    distance = checked_model(model, {**options, "margin": 1.0}, entities.shape[1])
    rows = table(relations, "relations", distance.width(entities.shape[1]))
    embedding = stack_of_one(table(entities, "entities"), rows, distance)
    if (triples >= [len(entities), len(relations), len(entities)]).any():
        expected = f"expected rows for all names, got {len(entities)} entities and {len(relations)} relations"
        raise InputError(path, "", expected)
    return max(1.0 + margin_of(embedding, torch.from_numpy(triples), None), 1e-6)


def read_labels(folder: Path) -> Labels:
    """Names and known triples of a folder of PyKEEN's, of OpenKE's, or with lists of names.

    Raises:
        InputError: where it is none of these, or a file is missing or broken.
    """
    if (folder / PYKEEN).is_dir():
        return _pykeen_labels(folder / PYKEEN)
    if (folder / ENTITY2ID).exists():
        return _openke_labels(folder)
    if (folder / ENTITY_NAMES).exists():
        return _listed_labels(folder)
    raise InputError(folder, "", f"expected a folder with {PYKEEN}, {ENTITY2ID} or {ENTITY_NAMES}")


def _pykeen_labels(folder: Path) -> Labels:
    """PyKEEN's tables of labels and training triples; its pickle of metadata is not read."""
    names = []
    for what in ("entity", "relation"):
        path = folder / f"{what}_to_id.tsv.gz"
        rows = _pykeen_table(path, ["id", "label"])
        by_id: dict[str, str] = dict(rows)
        if set(by_id) != {str(number) for number in range(len(rows))}:
            raise InputError(path, "", f"expected the ids from 0 to {len(rows) - 1}")
        names.append([by_id[str(number)] for number in range(len(rows))])
        distinct_names(path, names[-1])
    entities, relations = names
    path = folder / "numeric_triples.tsv.gz"
    expected = f"expected ids of {len(entities)} entities, {len(relations)} relations"
    try:
        triples = np.array(_pykeen_table(path, ["head", "relation", "tail"]), dtype=np.int64).reshape(-1, 3)
    except (ValueError, OverflowError) as error:
        raise InputError(path, "", expected) from error
    wrong = ((triples < 0) | (triples >= [len(entities), len(relations), len(entities)])).any(1)
    if wrong.any():
        raise InputError(path, f"line {wrong.argmax() + 2}", expected)
    return Labels("PyKEEN", entities, relations, triples)


def _pykeen_table(path: Path, columns: list[str]) -> list[list[str]]:
    try:
        with gzip.open(path, "rt", encoding="utf-8", newline="") as file:
            header, *rows = csv.reader(file, delimiter="\t")
    except (OSError, EOFError, zlib.error, UnicodeDecodeError, csv.Error, ValueError) as error:
        raise InputError(path, "", f"expected a compressed table of {', '.join(columns)} ({error})") from error
    if header != columns or any(len(row) != len(columns) for row in rows):
        raise InputError(path, "line 1", f"expected the columns {', '.join(columns)}")
    return rows


def _openke_labels(folder: Path) -> Labels:
    """OpenKE's names and training triples; without ``train2id.txt``, no triples."""
    entities, relations = read_id_names(folder / ENTITY2ID), read_id_names(folder / RELATION2ID)
    triples = list(read_ids(folder, [TRAIN2ID])) if (folder / TRAIN2ID).exists() else []
    entity_ids, relation_ids = ({name: row for row, name in enumerate(names)} for names in (entities, relations))
    return Labels("entity2id", entities, relations, triple_ids(folder / TRAIN2ID, triples, entity_ids, relation_ids))


def _listed_labels(folder: Path) -> Labels:
    """Names, one a line in the order of rows, and triples as tab-separated names, if there is such a file."""
    entities, relations = _lines(folder / ENTITY_NAMES), _lines(folder / RELATION_NAMES)
    entity_ids = distinct_names(folder / ENTITY_NAMES, entities, first=1)
    relation_ids = distinct_names(folder / RELATION_NAMES, relations, first=1)
    path = folder / TRIPLES
    lines = _lines(path) if path.exists() else []
    rows = [line.split("\t") for line in lines if lines != [""]]
    for number, row in enumerate(rows, 1):
        if len(row) != 3:
            raise InputError(path, f"line {number}", f"expected head, relation and tail, got {len(row)} columns")
    return Labels("arrays", entities, relations, triple_ids(path, rows, entity_ids, relation_ids))


def _lines(path: Path) -> list[str]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, "", f"expected text, a name a line ({error})") from error
    return [line.removesuffix("\r") for line in text.removesuffix("\n").split("\n")]
