"""A bundle: an embedding as a folder, with names, known triples and a record of each insertion into it.

``embedding.json`` is the manifest, ``vectors.safetensors`` has the tensors (``entities``, ``relations`` and, if there
are any, ``words``), ``entities.tsv`` names, kinds and phrases in the order of ids, ``relations.tsv`` names,
``triples.tsv`` the known triples by name. Equal bundles are equal bytes. A folder is checked against itself when it is
read, and before it is written, whole or not at all.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter, model_validator
from safetensors import SafetensorError
from safetensors.numpy import load, save

from isi.config import Count, Name, Option, Section, Seed
from isi.errors import InputError, at, unwritable
from isi.models.stack import LARGEST

MANIFEST, VECTORS = "embedding.json", "vectors.safetensors"
ENTITIES, RELATIONS, TRIPLES = "entities.tsv", "relations.tsv", "triples.tsv"
TRIPLE = "head", "relation", "tail"
COLUMNS = {ENTITIES: ("entity", "kind", "phrase"), RELATIONS: ("relation",), TRIPLES: TRIPLE}
MODEL = "all-MiniLM-L6-v2"  #: The sentence model whose vectors ship with the product (all but ``glove``).
#: What version 1 of the format calls some fields.
KEYS = {
    "model_name": "family", "model_options": "family_options", "insert_triples": "told",
    "requested_initializer": "asked",
}  # fmt: skip
#: Categories of characters that break lines or cells, move a terminal's cursor, or are no text.
CONTROL = frozenset({"Cc", "Cs", "Zl", "Zp"})


def check_text(text: str) -> str:
    """A text that may be printed or stand in a cell of a table; else a ``ValueError``."""
    if not text.isprintable() and any(unicodedata.category(character) in CONTROL for character in text):
        raise ValueError(f"expected text without tabs, line breaks or other control characters, got {text[:80]!r}")
    return text


Text = Annotated[str, AfterValidator(check_text)]
TEXTS = TypeAdapter(list[Text])
NamedTriple = Annotated[tuple[str, str, str], Field(strict=False)]  #: Head, relation and tail by name; a list in JSON.


class ManifestSection(Section):
    """A part of ``embedding.json``."""

    model_config = ConfigDict(alias_generator=lambda name: KEYS.get(name, name))

    @model_validator(mode="before")
    @classmethod
    def _by_key(cls, values: Any) -> Any:
        return {KEYS.get(name, name): value for name, value in values.items()} if isinstance(values, dict) else values


class WordSource(ManifestSection):
    """Where word vectors come from, so that a new phrase can have one of the same kind."""

    source: Text  #: a file's name or path, ``shipped``, or a description
    text: Text  #: what was embedded: definition, phrase, wordnet (phrases with a definition), glove (means of words)
    model: Text | None  #: the sentence model that made them; null where it is unknown


class InsertionRequest(ManifestSection):
    """What is given about a new entity, beside its kind and its words."""

    entity: Text
    insert_triples: list[NamedTriple]
    definition: Text | None
    requested_initializer: Text | None  #: null: the best for what is given
    options: dict[str, Option]
    seed: Seed


class InsertionRecord(InsertionRequest):
    """How an entity was inserted: enough to insert it again, and which initializer was used, and why."""

    initializer: Text
    why: Text
    fallback: Text | None


class Manifest(ManifestSection):
    """What an embedding is."""

    model_name: Name
    model_options: dict[str, Option]
    words: WordSource | None
    made: dict[str, Any]  #: how it was trained or where it was imported from, in its maker's terms
    inserted: list[InsertionRecord]  #: of the last rows, in their order


class ManifestFile(Manifest):
    """``embedding.json``: the manifest, the sizes, and the SHA-256 of each other file."""

    format: Literal["isi embedding"]
    version: Literal[1]
    entities: Count
    relations: Count
    dimension: Count
    triples: Seed
    files: dict[str, str]


@dataclass(frozen=True, eq=False)
class Bundle:
    """An embedding and what is known about its entities."""

    manifest: Manifest
    entities: np.ndarray  #: float32 or float64; shape: (E, d)
    relations: np.ndarray  #: shape: (R, w)
    entity_names: list[str]
    kinds: list[str]  #: empty where there is none
    phrases: list[str]  #: what each is called in words
    relation_names: list[str]
    triples: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))  #: ids; shape: (T, 3), int64
    words: np.ndarray | None = None  #: zero where there is none; shape: (E, v), float32; null where no entity has one

    def insertions(self) -> dict[str, InsertionRecord]:
        """Records by the name of the inserted entity."""
        return {record.entity: record for record in self.manifest.inserted}

    def named_triples(self) -> list[tuple[str, str, str]]:
        """The known triples by name."""
        names, labels = self.entity_names, self.relation_names
        return [(names[head], labels[relation], names[tail]) for head, relation, tail in self.triples.tolist()]


def write(folder: Path, bundle: Bundle) -> None:
    """Write a bundle as a folder, which replaces an earlier bundle, and nothing else, at once."""
    tensors = {"entities": bundle.entities, "relations": bundle.relations, "words": bundle.words}
    rows = {
        ENTITIES: zip(bundle.entity_names, bundle.kinds, bundle.phrases, strict=True),
        RELATIONS: [(name,) for name in bundle.relation_names], TRIPLES: bundle.named_triples(),
    }  # fmt: skip
    files = {VECTORS: save({name: np.ascontiguousarray(table) for name, table in tensors.items() if table is not None})}
    for name, table in rows.items():
        files[name] = "".join("\t".join(row) + "\n" for row in (COLUMNS[name], *table)).encode()
    manifest = {"format": "isi embedding", "version": 1} | bundle.manifest.model_dump(by_alias=True) | {
        "entities": len(bundle.entities), "relations": len(bundle.relations), "dimension": bundle.entities.shape[1],
        "triples": len(bundle.triples), "files": {name: sha256(content).hexdigest() for name, content in files.items()},
    }  # fmt: skip
    files[MANIFEST] = (json.dumps(manifest, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()
    _checked(folder, files)
    with at(folder):
        _refuse_to_replace(folder, bundle.entity_names)
    temporary, old = (folder.with_name(f".{folder.name}.{os.getpid()}.{end}") for end in ("tmp", "old.tmp"))
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        for path in list(folder.parent.iterdir()):
            if re.fullmatch(rf"\.{re.escape(folder.name)}\.\d+(\.old)?\.tmp", path.name):  # of one that was killed
                shutil.rmtree(path)
        temporary.mkdir()
        for name, content in files.items():
            (temporary / name).write_bytes(content)
        if folder.exists():
            folder.rename(old)
        temporary.rename(folder)
    except OSError as error:
        raise unwritable(folder, error) from error
    finally:
        for path in (temporary, old):
            shutil.rmtree(path, ignore_errors=True)


def _refuse_to_replace(folder: Path, names: Sequence[str]) -> None:
    """Refuse a folder with files that are no bundle's, or with an inserted entity that is not among these names."""
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise InputError("", "", "not a folder: choose a new name, or the folder of a bundle")
    present = sorted(path.name for path in folder.iterdir()) if folder.exists() else []
    for name in (name for name in present if name not in (MANIFEST, VECTORS, *COLUMNS)):
        raise InputError("", name, "not a file of a bundle: expected an empty folder or a bundle alone")
    if MANIFEST not in present:
        return
    try:
        inserted = [record["entity"] for record in json.loads((folder / MANIFEST).read_bytes())["inserted"]]
    except (ValueError, LookupError, TypeError, RecursionError) as error:
        raise InputError("", "", "already holds a bundle that cannot be read; choose another folder") from error
    if lost := ", ".join(str(name) for name in inserted if name not in names):
        expected = f"already holds a bundle with {lost}: add to it with --embedding, or choose another folder"
        raise InputError("", "", expected)


def read(folder: Path) -> Bundle:
    """Read a bundle; an ``InputError`` names the file and the place that is missing or broken, or fits no others."""
    files = {}
    for name in (MANIFEST, VECTORS, *COLUMNS):
        with at(folder / name if folder.is_dir() else folder):
            files[name] = (folder / name).read_bytes()
    return _checked(folder, files)


def _checked(folder: Path, files: Mapping[str, bytes]) -> Bundle:
    """The bundle of the bytes of its files."""
    with at(folder / MANIFEST):
        manifest = ManifestFile.model_validate_json(files[MANIFEST])
    entities, relations, rows = (_rows(folder / name, files[name], COLUMNS[name]) for name in COLUMNS)
    names, kinds, phrases = (list(column) for column in zip(*entities, strict=True)) if entities else ([], [], [])
    labels = [name for (name,) in relations]
    ids = ids_of(folder / ENTITIES, names), ids_of(folder / RELATIONS, labels)
    triples = triple_ids(folder / TRIPLES, rows, *ids, first=2)
    tensors = _tensors(folder / VECTORS, files[VECTORS], {"entities": names, "relations": labels, "words": names})
    numbers = {"entities": len(names), "relations": len(labels), "triples": len(triples),
               "dimension": tensors["entities"].shape[1]}  # fmt: skip
    with at(folder / MANIFEST):
        for key, number in numbers.items():
            if (got := getattr(manifest, key)) != number:
                raise InputError("", key, f"expected {number}, as the other files have, got {got}")
        if [record.entity for record in manifest.inserted] != names[len(names) - len(manifest.inserted) :]:
            raise InputError("", "inserted", "expected the entities of the last rows, in their order")
        for number, record in enumerate(manifest.inserted):
            for head, relation, tail in record.insert_triples:
                if not {head, tail} <= ids[0].keys() or relation not in ids[1] or record.entity not in (head, tail):
                    expected = f"expected known names, one of them {record.entity!r:.80}"
                    raise InputError("", f"inserted.{number}.told", expected)
    for name in (VECTORS, *COLUMNS):
        if manifest.files.get(name) != sha256(files[name]).hexdigest():
            raise InputError(folder / name, "", f"was changed: its SHA-256 is not the one in {MANIFEST}")
    about = Manifest(**{name: getattr(manifest, name) for name in Manifest.model_fields})
    vectors = tensors["entities"], tensors["relations"]
    return Bundle(about, *vectors, names, kinds, phrases, labels, triples, tensors.get("words"))


def _rows(path: Path, content: bytes, columns: Sequence[str]) -> list[list[str]]:
    """Rows of a table without its header; nothing is quoted, so a name holds no tab and no line break."""
    with at(path):
        rows = [line.split("\t") for line in content.decode().removesuffix("\n").split("\n")]
    for number, row in enumerate(rows, 1):
        with at(path, f"line {number}"):
            if row != list(columns) if number == 1 else len(row) != len(columns):
                raise InputError("", "", f"expected the columns {', '.join(columns)}, got {' '.join(row)[:80]!r}")
            TEXTS.validate_python(row)
    return rows[1:]


def ids_of(path: Path, names: Sequence[str], first: int = 2) -> dict[str, int]:
    """Ids by name, the first from line ``first``; an ``InputError`` names the line of one that is none or repeats."""
    ids: dict[str, int] = {}
    for row, name in enumerate(names):
        with at(path, f"line {row + first}"):
            TEXTS.validate_python([name])
            if not name.strip() or ids.setdefault(name, row) != row:
                raise InputError("", "", f"expected a name that does not repeat, got {name!r:.80}")
    return ids


def triple_ids(
    path: Path, rows: Iterable[Sequence[str]], entities: Mapping[str, int], relations: Mapping[str, int], first: int = 1
) -> np.ndarray:
    """Triples of names as ids, shape (T, 3), int64; an ``InputError`` for a name that is unknown names its line."""
    ids = []
    for line, row in enumerate(rows, first):
        for slot, name, known in zip(TRIPLE, row, (entities, relations, entities), strict=True):
            if name not in known:
                raise InputError(path, f"line {line}", f"expected a known name as {slot}, got {name!r:.80}")
            ids.append(known[name])
    return np.array(ids, dtype=np.int64).reshape(-1, 3)


def _tensors(path: Path, content: bytes, names: Mapping[str, Sequence[str]]) -> dict[str, np.ndarray]:
    """The tensors, with a row for each name, and sound numbers."""
    try:
        tensors: dict[str, np.ndarray] = load(content)
    except (SafetensorError, KeyError, TypeError, ValueError, OverflowError, MemoryError) as error:
        raise InputError(path, "", f"expected a safetensors file ({error})") from error
    for name in {"entities", "relations"} | tensors.keys():
        with at(path, f"tensor {name!r:.80}"):
            if name not in names or name not in tensors:
                raise InputError("", "", "missing" if name in names else "expected no tensor of this name")
            check_numbers(tensors[name], len(names[name]))
    return tensors


def check_numbers(table: np.ndarray, rows: int) -> None:
    """Refuse a table of other rows, or with numbers of which a score would overflow in single precision."""
    if table.ndim != 2 or len(table) != rows or not table.size or table.dtype not in (np.float32, np.float64):
        raise InputError("", "", f"expected float32 or float64 of shape ({rows}, any), got {table.dtype} {table.shape}")
    largest = np.abs(table).max(1)
    if not (sound := largest <= LARGEST).all():  # NaN is not
        row = int(sound.argmin())
        raise InputError("", f"row {row}", f"expected finite numbers up to {LARGEST:g}, got {largest[row]:.3g}")
