"""A trained embedding as plain files, a folder of equal bytes for equal content: what the pipeline
writes, and what ``isi import`` reads.

``embedding.json`` describes it, ``vectors.safetensors`` has its tables (``entities``,
``relations`` and, if there are any, ``words``), ``entities.tsv`` names, kinds and phrases in the
order of ids, ``relations.tsv`` names, ``triples.tsv`` the known triples by name.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import TypeAdapter
from safetensors import SafetensorError
from safetensors.numpy import load, save

from isi.config import check_keys
from isi.errors import InputError, at, short
from isi.home.bundle import MANIFEST, Bundle, Manifest, Text, check_numbers
from isi.names import name_fault
from isi.tables.io import atomically
from isi.vocabulary import Vocabulary, ids_by_name

VECTORS = "vectors.safetensors"
ENTITIES, RELATIONS, TRIPLES = "entities.tsv", "relations.tsv", "triples.tsv"
COLUMNS = {
    ENTITIES: ("entity", "kind", "phrase"),
    RELATIONS: ("relation",),
    TRIPLES: ("head", "relation", "tail"),
}
TEXTS = TypeAdapter(list[Text])


class ManifestFile(Manifest):
    """``embedding.json``: the manifest, the sizes, and the SHA-256 of each other file."""

    format: Literal["isi embedding"]
    version: Literal[2]
    entities: int
    relations: int
    dimension: int
    triples: int
    files: dict[str, str]


def write(folder: Path, bundle: Bundle) -> None:
    """Write a bundle as plain files; the one that describes the others comes last."""
    tensors = {"entities": bundle.entities, "relations": bundle.relations}
    if bundle.words is not None:
        tensors["words"] = bundle.words
    rows = {
        ENTITIES: zip(bundle.entity_names, bundle.kinds, bundle.phrases, strict=True),
        RELATIONS: [(name,) for name in bundle.relation_names],
        TRIPLES: bundle.named_triples(),
    }
    files = {VECTORS: save({name: np.ascontiguousarray(each) for name, each in tensors.items()})}
    for name, table in rows.items():
        files[name] = "".join("\t".join(row) + "\n" for row in (COLUMNS[name], *table)).encode()
    # keys that have the usual value are left out
    manifest = {"format": "isi embedding", "version": 2}
    manifest |= bundle.manifest.model_dump(exclude_defaults=True)
    manifest |= bundle.sizes()
    manifest["files"] = {name: sha256(content).hexdigest() for name, content in files.items()}
    text = json.dumps(manifest, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    files[MANIFEST] = text.encode()
    for name, content in files.items():
        atomically(folder / name, partial(Path.write_bytes, data=content))


def read(folder: Path) -> Bundle:
    """Read a bundle. An ``InputError`` names the missing or broken file and the place in it."""
    files = {}
    for name in (MANIFEST, VECTORS, *COLUMNS):
        with at(folder / name):
            files[name] = (folder / name).read_bytes()
    with at(folder / MANIFEST):
        check_keys(files[MANIFEST].decode())
        manifest = ManifestFile.model_validate_json(files[MANIFEST])
    for name in (VECTORS, *COLUMNS):
        if manifest.files.get(name) != sha256(files[name]).hexdigest():
            message = f"its SHA-256 is not the one in {MANIFEST}: one of the two was changed"
            raise InputError(folder / name, "", message)
    rows = {}
    for name, columns in COLUMNS.items():
        with at(folder / name):
            header, *rows[name] = split_rows(files[name].decode(), columns)
            if header != list(columns):
                expected = f"expected the columns {', '.join(columns)}, got {short(header)}"
                raise InputError("", "line 1", expected)
    names, kinds, phrases = ([row[place] for row in rows[ENTITIES]] for place in range(3))
    labels = [name for (name,) in rows[RELATIONS]]
    known = checked_names(folder / ENTITIES, "entity", names, first=2)
    known_relations = checked_names(folder / RELATIONS, "relation", labels, first=2)
    triples = triple_ids(folder / TRIPLES, rows[TRIPLES], known, known_relations, first=2)
    try:
        tensors: dict[str, np.ndarray] = load(files[VECTORS])
        vectors = tensors["entities"], tensors["relations"]
    except (SafetensorError, KeyError) as error:
        expected = f"expected a safetensors file with entities and relations ({error})"
        raise InputError(folder / VECTORS, "", expected) from error
    numbers = {"entities": len(names), "relations": len(labels), "words": len(names)}
    for name, table in tensors.items():
        with at(folder / VECTORS, f"tensor {name!r:.80}"):
            check_numbers(table, numbers[name])
    about = Manifest(**{name: getattr(manifest, name) for name in Manifest.model_fields})
    words = tensors.get("words")
    return Bundle(about, *vectors, names, kinds, phrases, labels, triples, words)


def split_rows(text: str, columns: Sequence[str]) -> list[list[str]]:
    """The rows of a tab-separated table, header included. There is no quoting:
    fields hold no tab or line break.
    """
    rows = [line.split("\t") for line in text.removesuffix("\n").split("\n")]
    for number, row in enumerate(rows, 1):
        with at("", f"line {number}"):
            if len(row) != len(columns):
                raise InputError(
                    "", "", f"expected the columns {', '.join(columns)}, got {short(row)}"
                )
            TEXTS.validate_python(row)
    return rows


def checked_names(path: Path, kind: str, names: Sequence[str], first: int) -> Vocabulary:
    """The names in a file of entities or relations, ``kind``. An ``InputError`` names the line,
    counted from ``first``, of a blank or repeated name.
    """
    seen = set[str]()
    for line, name in enumerate(names, first):
        fault = name_fault(name)
        if name in seen:
            fault = f"expected each name once, got {short(name)}"
        if fault:
            raise InputError(path, f"line {line}", fault)
        seen.add(name)
    return Vocabulary(kind, names)


def triple_ids(
    path: Path,
    rows: Collection[Sequence[str]],
    entities: Vocabulary,
    relations: Vocabulary,
    first: int,
) -> np.ndarray:
    """The triples of names in a file as ids, shape (T, 3), int64. An ``InputError`` names the line,
    counted from ``first``, of an unknown name.
    """
    columns = entities, relations, entities
    for line, triple in enumerate(rows, first):
        for slot, name, known in zip(COLUMNS[TRIPLES], triple, columns, strict=True):
            if name not in known.ids:
                expected = f"expected a known name as {slot}, got {short(name)}{known.hint(name)}"
                raise InputError(path, f"line {line}", expected)
    return ids_by_name(rows, entities.ids, relations.ids)
