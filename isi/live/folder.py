"""A bundle: an embedding as a folder, with names, known triples,
and a record of each inserted entity.

``embedding.json`` is the manifest, ``vectors.safetensors`` has the tensors (``entities``,
``relations`` and, if there are any, ``words``), ``entities.tsv`` has names, kinds and phrases in
the order of ids, ``relations.tsv`` names, ``triples.tsv`` the known triples by name. Equal bundles
give equal bytes. The files of a folder are checked against each other when it is read and before it
is written. It is written completely or not at all.
"""

import json
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter
from safetensors import SafetensorError
from safetensors.numpy import load, save

from isi.config import LARGEST, Name, Option, Seed
from isi.errors import InputError, at, short, unwritable
from isi.models.losses import Loss
from isi.names import check_text, name_fault

MANIFEST, VECTORS, JOURNAL = "embedding.json", "vectors.safetensors", "journal.jsonl"
STORED = "inserted.safetensors"  #: Computed from the others (``isi.live.stored``).
ENTITIES, RELATIONS, TRIPLES = "entities.tsv", "relations.tsv", "triples.tsv"
COLUMNS = {
    ENTITIES: ("entity", "kind", "phrase"),
    RELATIONS: ("relation",),
    TRIPLES: ("head", "relation", "tail"),
}
MODEL = "all-MiniLM-L6-v2"  #: The sentence model of the shipped word vectors, except ``glove``.
#: Keys of fields in version 1 of the format, where they differ from the names here.
KEYS = {
    "model_name": "family",
    "model_options": "family_options",
    "insert_triples": "told",
    "requested_initializer": "asked",
}
Text = Annotated[str, AfterValidator(check_text)]
TEXTS = TypeAdapter(list[Text])
#: Head, relation and tail by name; a list in JSON.
NamedTriple = Annotated[tuple[str, str, str], Field(strict=False)]


class ManifestSection(BaseModel):
    """Base of the objects in ``embedding.json``."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        populate_by_name=True,
        alias_generator=lambda name: KEYS.get(name, name),
    )


class WordSource(ManifestSection):
    """The source of word vectors, from which a new phrase gets a comparable vector."""

    source: Text  #: a file's name or path, ``shipped``, or a description
    #: the embedded text: definition, phrase, wordnet (phrase and definition), glove (mean of words)
    text: Text
    #: the sentence model that made them; null if there was none or it is unknown
    model: Text | None


class EntityRecord(ManifestSection):
    """The input of an insertion, from which it can be repeated: ``initializer`` with ``options``;
    and the reason.
    """

    entity: Text
    insert_triples: list[NamedTriple]
    definition: Text | None
    requested_initializer: Text | None  #: null: the default for the given data
    options: dict[str, Option]
    seed: Seed
    initializer: Text
    why: Text
    fallback: Text | None


class Manifest(ManifestSection):
    """Description of an embedding: model, source of words, origin, insertions."""

    model_name: Name
    model_options: dict[str, Option]
    words: WordSource | None
    #: the loss that it was trained with; None: unknown
    trained_with: Loss | None = "logistic"
    made: dict[str, Any]  #: how it was trained, or the files that it was imported from; free form
    #: one per inserted entity; these have the last rows, in this order
    inserted: list[EntityRecord]


def _usual(manifest: Manifest) -> set[str]:
    """Keys that are left out of ``embedding.json``, since they have the usual value."""
    return {"trained_with"} if manifest.trained_with == "logistic" else set()


class ManifestFile(Manifest):
    """``embedding.json``: the manifest, the sizes, and the SHA-256 of each other file."""

    format: Literal["isi embedding"]
    version: Literal[1]
    entities: int
    relations: int
    dimension: int
    triples: int
    files: dict[str, str]


@dataclass(frozen=True, eq=False)
class Bundle:
    """An embedding with names, kinds, phrases, word vectors and known triples of its entities."""

    manifest: Manifest
    entities: np.ndarray  #: float32 or float64; shape: (E, d)
    relations: np.ndarray  #: shape: (R, w)
    entity_names: list[str]
    kinds: list[str]  #: of each entity; empty text if unknown
    phrases: list[str]  #: the words of each entity's name, for its word vector
    relation_names: list[str]
    triples: np.ndarray  #: ids; shape: (T, 3), int64
    #: shape: (E, v), float32; zero rows if missing; None if all are missing
    words: np.ndarray | None = None

    def insertions(self) -> dict[str, EntityRecord]:
        """Records of insertions by entity name."""
        return {record.entity: record for record in self.manifest.inserted}

    def named_triples(self) -> list[tuple[str, str, str]]:
        """The known triples by name."""
        names, labels = self.entity_names, self.relation_names
        return [
            (names[head], labels[relation], names[tail])
            for head, relation, tail in self.triples.tolist()
        ]

    def sizes(self) -> dict[str, int]:
        """The sizes that ``embedding.json`` lists too."""
        return {
            "entities": len(self.entities),
            "relations": len(self.relations),
            "dimension": self.entities.shape[1],
            "triples": len(self.triples),
        }


def write(folder: Path, bundle: Bundle, journal: str = "") -> None:
    """Write a bundle, completely or not at all.
    It may replace an empty folder, or a bundle if no change is lost.

    ``journal``: the changes that led to the bundle (``isi.live.journal``).
    """
    tensors = {"entities": bundle.entities, "relations": bundle.relations, "words": bundle.words}
    rows = {
        ENTITIES: zip(bundle.entity_names, bundle.kinds, bundle.phrases, strict=True),
        RELATIONS: [(name,) for name in bundle.relation_names],
        TRIPLES: bundle.named_triples(),
    }
    files = {
        VECTORS: save(
            {
                name: np.ascontiguousarray(table)
                for name, table in tensors.items()
                if table is not None
            }
        )
    }
    for name, table in rows.items():
        files[name] = "".join("\t".join(row) + "\n" for row in (COLUMNS[name], *table)).encode()
    manifest = (
        {"format": "isi embedding", "version": 1}
        | bundle.manifest.model_dump(by_alias=True, exclude=_usual(bundle.manifest))
        | bundle.sizes()
    )
    manifest["files"] = {name: sha256(content).hexdigest() for name, content in files.items()}
    files[MANIFEST] = (
        json.dumps(manifest, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    ).encode()
    _checked(folder, files)
    if journal:
        files[JOURNAL] = journal.encode()
    with at(folder):
        _refuse_to_replace(folder, files.get(JOURNAL, b""))
    temporary, old = (
        folder.with_name(f".{folder.name}.{os.getpid()}.{end}") for end in ("tmp", "old.tmp")
    )
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        for path in list(folder.parent.iterdir()):
            # of a killed process
            if re.fullmatch(rf"\.{re.escape(folder.name)}\.\d+(\.old)?\.tmp", path.name):
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


def _refuse_to_replace(folder: Path, journal: bytes) -> None:
    """InputError for a file, a link, files of no bundle, or a change that would be lost."""
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise InputError("", "", "a file or a link: choose a new name, or the folder of a bundle")
    present = {path.name for path in folder.iterdir()} if folder.exists() else set()
    of_bundle = {MANIFEST, VECTORS, JOURNAL, STORED, *COLUMNS} if MANIFEST in present else set()
    for name in sorted(present - of_bundle):
        raise InputError(
            "",
            name,
            "not a file of a bundle: expected an empty folder, or a bundle without other files",
        )
    if JOURNAL in present and set((folder / JOURNAL).read_bytes().splitlines()) - set(
        journal.splitlines()
    ):
        raise InputError(
            "", JOURNAL, "already holds a bundle with other changes: choose another folder"
        )


def read(folder: Path) -> Bundle:
    """Read a bundle. An ``InputError`` names the missing or broken file and the place in it."""
    files = {}
    for name in (MANIFEST, VECTORS, *COLUMNS):
        with at(folder / name if folder.is_dir() else folder):
            files[name] = (folder / name).read_bytes()
    return _checked(folder, files)


def _checked(folder: Path, files: Mapping[str, bytes]) -> Bundle:
    """Parse and check a bundle (InputError); ``files``: bytes by file name;
    ``folder``: for messages alone.
    """
    with at(folder / MANIFEST):
        manifest = ManifestFile.model_validate_json(files[MANIFEST])
    rows = {}
    for name, columns in COLUMNS.items():
        with at(folder / name):
            header, *rows[name] = split_rows(files[name].decode(), columns)
            if header != list(columns):
                raise InputError(
                    "", "line 1", f"expected the columns {', '.join(columns)}, got {short(header)}"
                )
    names, kinds, phrases = ([row[place] for row in rows[ENTITIES]] for place in range(3))
    labels = [name for (name,) in rows[RELATIONS]]
    triples = triple_ids([folder / name for name in COLUMNS], names, labels, rows[TRIPLES], first=2)
    path, numbers = (
        folder / VECTORS,
        {"entities": len(names), "relations": len(labels), "words": len(names)},
    )
    try:
        tensors: dict[str, np.ndarray] = load(files[VECTORS])
    except (SafetensorError, KeyError, TypeError, ValueError, OverflowError, MemoryError) as error:
        raise InputError(path, "", f"expected a safetensors file ({error})") from error
    for name in {"entities", "relations"} | tensors.keys():
        with at(path, f"tensor {name!r:.80}"):
            if name not in numbers or name not in tensors:
                raise InputError(
                    "", "", "missing" if name in numbers else "expected no tensor of this name"
                )
            check_numbers(tensors[name], numbers[name])
    about = Manifest(**{name: getattr(manifest, name) for name in Manifest.model_fields})
    vectors = tensors["entities"], tensors["relations"]
    bundle = Bundle(about, *vectors, names, kinds, phrases, labels, triples, tensors.get("words"))
    with at(folder / MANIFEST):
        for key, number in bundle.sizes().items():
            if (got := getattr(manifest, key)) != number:
                raise InputError(
                    "", key, f"expected {number}, the number in the other files, got {got}"
                )
        if list(bundle.insertions()) != names[len(names) - len(manifest.inserted) :]:
            raise InputError(
                "", "inserted", f"expected the names in the last rows of {ENTITIES}, in order"
            )
        known = set(names)
        for number, record in enumerate(manifest.inserted):
            for head, relation, tail in record.insert_triples:
                if (
                    not {head, tail} <= known
                    or relation not in labels
                    or record.entity not in (head, tail)
                ):
                    expected = f"expected triples of known names, each with {record.entity!r:.80}"
                    raise InputError("", f"inserted.{number}.told", expected)
    for name in (VECTORS, *COLUMNS):
        if manifest.files.get(name) != sha256(files[name]).hexdigest():
            raise InputError(
                folder / name,
                "",
                f"its SHA-256 is not the one in {MANIFEST}: one of the two was changed",
            )
    return bundle


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


def triple_ids(
    paths: Sequence[Path],
    names: Sequence[str],
    labels: Sequence[str],
    rows: Sequence[Sequence[str]],
    first: int,
) -> np.ndarray:
    """Convert triples of names to ids, shape (T, 3), int64.

    ``paths``: the files of entities, relations and triples. An ``InputError`` names the line,
    counted from ``first``, of a blank, repeated or unknown name.
    """
    entities, relations = dict[str, int](), dict[str, int]()
    for path, listed, ids in zip(paths, (names, labels), (entities, relations), strict=False):
        for row, name in enumerate(listed):
            fault = name_fault(name)
            if not fault and ids.setdefault(name, row) != row:
                fault = f"expected each name once, got {short(name)}"
            if fault:
                raise InputError(path, f"line {row + first}", fault)
    triples = []
    for line, triple in enumerate(rows, first):
        for slot, name, known in zip(
            COLUMNS[TRIPLES], triple, (entities, relations, entities), strict=True
        ):
            if name not in known:
                raise InputError(
                    paths[2], f"line {line}", f"expected a known name as {slot}, got {short(name)}"
                )
            triples.append(known[name])
    return np.array(triples, np.int64).reshape(-1, 3)


def check_numbers(table: np.ndarray, rows: int) -> None:
    """InputError unless a table is (rows, any) floats with |x| ≤ ``LARGEST``,
    so that float32 scores are finite.
    """
    if (
        table.ndim != 2
        or len(table) != rows
        or not table.size
        or table.dtype not in (np.float32, np.float64)
    ):
        raise InputError(
            "",
            "",
            f"expected float32 or float64 of shape ({rows}, any), got {table.dtype} {table.shape}",
        )
    largest = np.abs(table).max(1)
    if not (sound := largest <= LARGEST).all():  # false for NaN
        row = int(sound.argmin())
        raise InputError(
            "", f"row {row}", f"expected finite |x| up to {LARGEST:g}, got {largest[row]:.3g}"
        )
