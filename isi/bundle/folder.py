"""A bundle on disk: written whole or not at all, checked against itself when it is read.

``embedding.json`` is the manifest, ``vectors.safetensors`` has the tensors (``entities``, ``relations`` and, if there
are any, ``words``), ``entities.tsv`` names, kinds and phrases in the order of ids, ``relations.tsv`` names,
``triples.tsv`` the known triples by name. Equal bundles are equal bytes.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from isi.bundle.manifest import Bundle, Manifest, ManifestFile, name_fault, text_fault
from isi.config import check
from isi.errors import InputError, unwritable

MANIFEST, VECTORS = "embedding.json", "vectors.safetensors"
ENTITIES, RELATIONS, TRIPLES = "entities.tsv", "relations.tsv", "triples.tsv"
ENTITY_COLUMNS, RELATION_COLUMNS, TRIPLE_COLUMNS = (
    ("entity", "kind", "phrase"),
    ("relation",),
    ("head", "relation", "tail"),
)


def write(folder: Path, bundle: Bundle) -> None:
    """Write a bundle as a folder, which replaces an earlier bundle at once: it is whole or it is not there.

    Raises:
        InputError: where a name does not fit into a table, or the folder holds other files.
    """
    files = _files(folder, bundle)
    _refuse_to_replace(folder)
    try:
        with _replacing(folder) as temporary:
            for name, content in files.items():
                (temporary / name).write_bytes(content)
    except OSError as error:
        raise unwritable(folder, error) from error


def _files(folder: Path, bundle: Bundle) -> dict[str, bytes]:
    """The bytes of each file."""
    from safetensors.numpy import save

    for path, names in ((folder / ENTITIES, bundle.entity_names), (folder / RELATIONS, bundle.relation_names)):
        distinct_names(path, names)
    entities = zip(bundle.entity_names, bundle.kinds, bundle.phrases, strict=True)
    names_by_slot = bundle.entity_names, bundle.relation_names, bundle.entity_names
    triples = [
        [names[row] for names, row in zip(names_by_slot, triple, strict=True)] for triple in bundle.triples.tolist()
    ]
    tensors = {"entities": bundle.entities, "relations": bundle.relations}
    if bundle.words is not None:
        tensors["words"] = bundle.words
    files = {
        VECTORS: save({name: np.ascontiguousarray(values) for name, values in tensors.items()}),
        ENTITIES: _tsv(ENTITY_COLUMNS, entities),
        RELATIONS: _tsv(RELATION_COLUMNS, ([name] for name in bundle.relation_names)),
        TRIPLES: _tsv(TRIPLE_COLUMNS, triples),
    }
    _rows(folder / ENTITIES, files[ENTITIES], ENTITY_COLUMNS)  # kinds and phrases must fit into the table, too
    manifest = {"format": "isi embedding", "version": 1} | bundle.manifest.model_dump(by_alias=True) | {
        "entities": len(bundle.entities), "relations": len(bundle.relations), "dimension": bundle.entities.shape[1],
        "triples": len(bundle.triples), "files": {name: _sha256(content) for name, content in files.items()},
    }  # fmt: skip
    text = json.dumps(manifest, indent=2, ensure_ascii=False, allow_nan=False)
    return files | {MANIFEST: f"{text}\n".encode()}


def _tsv(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> bytes:
    return "".join("\t".join(row) + "\n" for row in [columns, *rows]).encode()


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _refuse_to_replace(folder: Path) -> None:
    """Refuse a folder that holds other files than those of a bundle.

    Raises:
        InputError: naming what is there.
    """
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise InputError(folder, "", "not a folder: choose a new name, or the folder of a bundle")
    names = sorted(path.name for path in folder.iterdir()) if folder.exists() else []
    for name in names:
        if name not in (MANIFEST, VECTORS, ENTITIES, RELATIONS, TRIPLES):
            raise InputError(folder, name, "not a file of a bundle: expected an empty folder or a bundle alone")


@contextmanager
def _replacing(folder: Path) -> Iterator[Path]:
    """A temporary folder that replaces a folder at the end, and is removed if the work fails."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    stale = re.compile(rf"\.{re.escape(folder.name)}\.\d+(\.old)?\.tmp")  # of a process that was killed
    for path in [path for path in folder.parent.iterdir() if stale.fullmatch(path.name)]:
        shutil.rmtree(path)
    temporary = folder.with_name(f".{folder.name}.{os.getpid()}.tmp")
    old = folder.with_name(f".{folder.name}.{os.getpid()}.old.tmp")
    temporary.mkdir()
    try:
        yield temporary
        if folder.exists():
            folder.rename(old)
        temporary.rename(folder)
    finally:
        for path in (temporary, old):
            shutil.rmtree(path, ignore_errors=True)


def read(folder: Path) -> Bundle:
    """Read a bundle.

    Raises:
        InputError: naming the file and the place that is missing or broken, or does not fit the others.
    """
    manifest = _manifest(folder / MANIFEST)
    contents = {name: _content(folder / name) for name in (VECTORS, ENTITIES, RELATIONS, TRIPLES)}
    tensors = _tensors(folder / VECTORS, contents[VECTORS], manifest)
    columns = list(zip(*_rows(folder / ENTITIES, contents[ENTITIES], ENTITY_COLUMNS), strict=True))
    names, kinds, phrases = map(list, columns or ([], [], []))
    relations = [name for (name,) in _rows(folder / RELATIONS, contents[RELATIONS], RELATION_COLUMNS)]
    entity_ids, relation_ids = distinct_names(folder / ENTITIES, names), distinct_names(folder / RELATIONS, relations)
    _check_rows(folder / ENTITIES, names, manifest.entities)
    _check_rows(folder / RELATIONS, relations, manifest.relations)
    rows = _rows(folder / TRIPLES, contents[TRIPLES], TRIPLE_COLUMNS)
    triples = triple_ids(folder / TRIPLES, rows, entity_ids, relation_ids, first=2)
    _check_rows(folder / TRIPLES, rows, manifest.triples)
    _check_inserted(folder / MANIFEST, manifest, names, relation_ids)
    for name, content in contents.items():
        if manifest.files.get(name) != _sha256(content):
            raise InputError(folder / name, "", f"was changed: its SHA-256 is not the one in {MANIFEST}")
    about = Manifest(**{name: getattr(manifest, name) for name in Manifest.model_fields})
    return Bundle(
        about,
        tensors["entities"],
        tensors["relations"],
        names,
        kinds,
        phrases,
        relations,
        triples,
        tensors.get("words"),
    )


def _check_rows(path: Path, rows: Sequence[object], expected: int) -> None:
    if len(rows) != expected:
        raise InputError(path, "", f"expected {expected} rows, as {MANIFEST} says, got {len(rows)}")


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(path, "", f"cannot be read ({error.strerror})") from error


def _manifest(path: Path) -> ManifestFile:
    if not path.parent.is_dir():
        raise InputError(path.parent, "", "no such folder: expected the folder of an embedding")
    try:
        raw = json.loads(_content(path))
    except (ValueError, RecursionError) as error:
        raise InputError(path, "", f"expected JSON ({error})") from error
    for key, expected in (("format", "isi embedding"), ("version", 1)):
        value = raw.get(key) if isinstance(raw, dict) else None
        if value != expected:
            raise InputError(path, key, f"expected {expected!r}, got {value!r:.80}")
    return check(raw, ManifestFile, "", path)


def _rows(path: Path, content: bytes, columns: Sequence[str]) -> list[list[str]]:
    """Rows of a table without its header; nothing is quoted, so a name holds no tab and no line break.

    Raises:
        InputError: naming the line that is broken.
    """
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(path, f"line {line}", "expected UTF-8 text") from error
    header, *rows = [line.split("\t") for line in text.removesuffix("\n").split("\n")]
    if header != list(columns):
        raise InputError(path, "line 1", f"expected the columns {', '.join(columns)}, got {' '.join(header)[:80]!r}")
    for number, row in enumerate(rows, 2):
        if len(row) != len(columns):
            raise InputError(path, f"line {number}", f"expected {len(columns)} columns, got {len(row)}")
        if fault := next(filter(None, map(text_fault, row)), None):
            raise InputError(path, f"line {number}", fault)
    return rows


def distinct_names(path: Path, names: Sequence[str], first: int = 2) -> dict[str, int]:
    """Ids by name.

    Args:
        first: line of the first name.

    Raises:
        InputError: naming the line of a name that is empty, has control characters, or repeats.
    """
    ids: dict[str, int] = {}
    for row, name in enumerate(names):
        repeated = f"expected names that do not repeat, got {name!r:.80}" if ids.setdefault(name, row) != row else None
        if fault := name_fault(name) or repeated:
            raise InputError(path, f"line {row + first}", fault)
    return ids


def triple_ids(
    path: Path, rows: Iterable[Sequence[str]], entities: Mapping[str, int], relations: Mapping[str, int], first: int = 1
) -> np.ndarray:
    """Triples of names as ids; shape (T, 3), int64.

    Args:
        first: line of the first triple.

    Raises:
        InputError: naming the line of a name that no row of the embedding has.
    """
    ids = []
    for line, row in enumerate(rows, first):
        for slot, name, known in zip(TRIPLE_COLUMNS, row, (entities, relations, entities), strict=True):
            if name not in known:
                raise InputError(path, f"line {line}", f"expected a known name as {slot}, got {name!r:.80}")
            ids.append(known[name])
    return np.array(ids, dtype=np.int64).reshape(-1, 3)


def _tensors(path: Path, content: bytes, manifest: ManifestFile) -> dict[str, np.ndarray]:
    """The tensors, of the shapes that the manifest says, and finite."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        tensors: dict[str, np.ndarray] = load(content)
    except (SafetensorError, KeyError, TypeError, ValueError, OverflowError, MemoryError) as error:
        raise InputError(path, "", f"expected a safetensors file ({error})") from error
    shapes: dict[str, tuple[int, Any]] = {
        "entities": (manifest.entities, manifest.dimension), "relations": (manifest.relations, None),
        "words": (manifest.entities, None),
    }  # fmt: skip
    if extra := set(tensors) - set(shapes):
        raise InputError(path, f"tensor {min(extra)!r:.80}", "expected no tensor of this name")
    for name, (rows, width) in shapes.items():
        place, values = f"tensor {name!r}", tensors.get(name)
        if values is None:
            if name == "words":
                continue
            raise InputError(path, place, "missing")
        fits = values.ndim == 2 and len(values) == rows and width in (None, values.shape[1]) and values.size
        if not fits or values.dtype not in (np.float32, np.float64):
            expected = f"expected float32 or float64 of shape ({rows}, {width or 'any'})"
            raise InputError(path, place, f"{expected}, got {values.dtype} {values.shape}")
        if not (finite := np.isfinite(values).all(1)).all():
            raise InputError(path, f"{place}: row {finite.argmin()}", "expected finite numbers, got NaN or infinity")
    return tensors


def _check_inserted(path: Path, manifest: Manifest, names: list[str], relations: Mapping[str, int]) -> None:
    """Check that inserted entities have the last rows, and insert triples are of known names."""
    inserted = [record.entity for record in manifest.inserted]
    if inserted != names[len(names) - len(inserted) :]:
        raise InputError(path, "inserted", "expected the entities of the last rows, in their order")
    entities = set(names)
    for number, record in enumerate(manifest.inserted):
        for head, relation, tail in record.insert_triples:
            if not {head, tail} <= entities or relation not in relations or record.entity not in (head, tail):
                place = f"inserted.{number}.told"
                raise InputError(path, place, f"expected known names, one of them {record.entity!r:.80}")
