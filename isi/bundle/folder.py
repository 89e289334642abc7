"""Tables of names as TSV: a header, then a row a line; nothing is quoted, so that no name may break lines or cells.

Reading and writing an embedding's folder.

``embedding.json`` says what it is, ``vectors.safetensors`` has the tensors (``entities``, ``relations`` and, if there
are any, ``words``), ``entities.tsv`` names, kinds and phrases in the order of ids, ``relations.tsv`` names,
``triples.tsv`` the known triples by name. Equal embeddings are equal bytes.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from isi.bundle.manifest import Bundle, EntityInfo, Manifest
from isi.config import check
from isi.errors import InputError, unwritable

#: Categories of characters that break lines or cells, do something to a terminal, or are no text.
HOSTILE = frozenset({"Cc", "Cs", "Zl", "Zp"})


def fault(name: str) -> str | None:
    """What is wrong with a name; null where nothing is."""
    if not name.strip():
        return "expected a name, got none"
    return cell_fault(name)


def cell_fault(text: str) -> str | None:
    """What is wrong with a cell; null where nothing is."""
    if not text.isprintable() and any(unicodedata.category(character) in HOSTILE for character in text):
        return f"expected text without tabs, line breaks or other control characters, got {text[:80]!r}"
    return None


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> bytes:
    """A table as TSV in UTF-8."""
    return "".join("\t".join(row) + "\n" for row in [columns, *rows]).encode()


def read_rows(path: Path, content: bytes, columns: Sequence[str]) -> list[list[str]]:
    """Rows of a table, without its header.

    Raises:
        InputError: naming the line that is broken.
    """
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(path, f"line {line}", "expected UTF-8 text") from error
    header, *lines = (text.removesuffix("\n")).split("\n")
    if header.split("\t") != list(columns):
        raise InputError(path, "line 1", f"expected the columns {', '.join(columns)}, got {header[:80]!r}")
    rows = [line.split("\t") for line in lines]
    for number, row in enumerate(rows, 2):
        if len(row) != len(columns):
            raise InputError(path, f"line {number}", f"expected {len(columns)} columns, got {len(row)}")
        wrong = next(filter(None, map(cell_fault, row)), None)
        if wrong:
            raise InputError(path, f"line {number}", wrong)
    return rows


def distinct_names(path: Path, names: Sequence[str], first: int = 2) -> dict[str, int]:
    """Rows by name.

    Args:
        first: line of the first.

    Raises:
        InputError: naming the line of a name that is none, or is there for the second time.
    """
    found: dict[str, int] = {}
    for row, name in enumerate(names):
        wrong = fault(name)
        if wrong or found.setdefault(name, row) != row:
            raise InputError(
                path, f"line {row + first}", wrong or f"expected names that do not repeat, got {name!r:.80}"
            )
    return found


ABOUT, VECTORS, ENTITIES, RELATIONS, TRIPLES = (
    "embedding.json", "vectors.safetensors", "entities.tsv", "relations.tsv", "triples.tsv"
)  # fmt: skip
ENTITY_COLUMNS, TRIPLE_COLUMNS = ("entity", "kind", "phrase"), ("head", "relation", "tail")


def write(folder: Path, kept: Bundle) -> None:
    """Write an embedding as a folder, in the place of one that is there: it is whole or it is not there.

    Raises:
        InputError: where a name does not fit into a table, or something else is in the folder.
    """
    files = _files(folder, kept)
    _refuse_to_replace(folder)
    try:
        with _beside(folder) as temporary:
            for name, content in files.items():
                (temporary / name).write_bytes(content)
    except OSError as error:
        raise unwritable(folder, error) from error


def _files(folder: Path, kept: Bundle) -> dict[str, bytes]:
    """The bytes of each file."""
    from safetensors.numpy import save

    for path, names in ((folder / ENTITIES, kept.entity_names), (folder / RELATIONS, kept.relation_names)):
        distinct_names(path, names)
    of_entities = list(zip(kept.entity_names, kept.kinds, kept.phrases, strict=True))
    of_triples = [
        (kept.entity_names[head], kept.relation_names[relation], kept.entity_names[tail])
        for head, relation, tail in kept.triples.tolist()
    ]
    tensors = {"entities": kept.entities, "relations": kept.relations}
    if kept.words is not None:
        tensors["words"] = kept.words
    files = {
        VECTORS: save({name: np.ascontiguousarray(values) for name, values in tensors.items()}),
        ENTITIES: table(ENTITY_COLUMNS, of_entities),
        RELATIONS: table(("relation",), [[name] for name in kept.relation_names]),
        TRIPLES: table(TRIPLE_COLUMNS, of_triples),
    }
    read_rows(folder / ENTITIES, files[ENTITIES], ENTITY_COLUMNS)  # kinds and phrases, too
    described = EntityInfo(
        format="isi embedding", version=1, **kept.about.model_dump(), entities=len(kept.entities),
        relations=len(kept.relations), dimension=kept.entities.shape[1], triples=len(kept.triples),
        files={name: hashlib.sha256(content).hexdigest() for name, content in files.items()},
    )  # fmt: skip
    first = {"format": described.format, "version": described.version}
    text = json.dumps(first | described.model_dump(), indent=2, ensure_ascii=False, allow_nan=False)
    return files | {ABOUT: f"{text}\n".encode()}


def _refuse_to_replace(folder: Path) -> None:
    """Refuse a folder that has something else in it than an embedding.

    Raises:
        InputError: naming what is there.
    """
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise InputError(folder, "", "expected a folder, or a name that nothing has")
    there = sorted(path.name for path in folder.iterdir()) if folder.exists() else []
    foreign = [name for name in there if name not in (ABOUT, VECTORS, ENTITIES, RELATIONS, TRIPLES)]
    if foreign:
        raise InputError(folder, foreign[0], "expected an empty folder, or one with an embedding alone")


@contextmanager
def _beside(folder: Path) -> Iterator[Path]:
    """A temporary folder that takes the place of a folder at the end, and is gone if it does not get there."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    stale = re.compile(rf"\.{re.escape(folder.name)}\.\d+(\.old)?\.tmp")  # of a process that was killed
    for left in [path for path in folder.parent.iterdir() if stale.fullmatch(path.name)]:
        shutil.rmtree(left)
    temporary = folder.with_name(f".{folder.name}.{os.getpid()}.tmp")
    old = folder.with_name(f".{folder.name}.{os.getpid()}.old.tmp")
    temporary.mkdir()
    try:
        yield temporary
        if folder.exists():
            folder.rename(old)
        temporary.rename(folder)
    finally:
        for left in (temporary, old):
            shutil.rmtree(left, ignore_errors=True)


def read(folder: Path) -> Bundle:
    """Read an embedding's folder.

    Raises:
        InputError: naming the file and the place that is missing or broken, or does not fit the others.
    """
    described = _described(folder / ABOUT)
    contents = {name: _content(folder / name) for name in (VECTORS, ENTITIES, RELATIONS, TRIPLES)}
    tensors = _tensors(folder / VECTORS, contents[VECTORS], described)
    columns = list(zip(*read_rows(folder / ENTITIES, contents[ENTITIES], ENTITY_COLUMNS), strict=True))
    names, kinds, phrases = map(list, columns or ([], [], []))
    relations = [name for (name,) in read_rows(folder / RELATIONS, contents[RELATIONS], ("relation",))]
    ids = distinct_names(folder / ENTITIES, names), distinct_names(folder / RELATIONS, relations)
    _same(folder / ENTITIES, "rows", len(names), described.entities)
    _same(folder / RELATIONS, "rows", len(relations), described.relations)
    triples = _triples(folder / TRIPLES, contents[TRIPLES], *ids)
    _same(folder / TRIPLES, "rows", len(triples), described.triples)
    _check_inserted(folder / ABOUT, described, names, ids[1])
    for name, content in contents.items():
        if described.files.get(name) != hashlib.sha256(content).hexdigest():
            raise InputError(folder / name, "", f"expected the bytes whose SHA-256 is in {ABOUT}: it was changed")
    about = Manifest(**{name: getattr(described, name) for name in Manifest.model_fields})
    found = Bundle(about, tensors["entities"], tensors["relations"], names, kinds, phrases, relations, triples)
    return found if "words" not in tensors else Bundle(**{**vars(found), "words": tensors["words"]})


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(path, "", f"cannot be read ({error.strerror})") from error


def _described(path: Path) -> EntityInfo:
    if not path.parent.is_dir():
        raise InputError(path.parent, "", "expected the folder of an embedding, but there is no such folder")
    try:
        raw = json.loads(_content(path))
    except (ValueError, RecursionError) as error:
        raise InputError(path, "", f"expected JSON ({error})") from error
    for key, known in (("format", "isi embedding"), ("version", 1)):
        got = raw.get(key) if isinstance(raw, dict) else None
        if got != known:
            raise InputError(path, key, f"expected {known!r}, got {got!r:.80}")
    for insertion in raw.get("inserted", []) if isinstance(raw.get("inserted"), list) else []:
        if isinstance(insertion, dict) and isinstance(insertion.get("told"), list):
            insertion["told"] = [tuple(triple) if isinstance(triple, list) else triple for triple in insertion["told"]]
    return check(raw, EntityInfo, "", path)


def _tensors(path: Path, content: bytes, described: EntityInfo) -> dict[str, np.ndarray]:
    """The tensors, of the shapes that they must have, and finite."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        found: dict[str, np.ndarray] = load(content)
    except (SafetensorError, KeyError, TypeError, ValueError, OverflowError, MemoryError) as error:
        raise InputError(path, "", f"expected a safetensors file ({error})") from error
    shapes: Mapping[str, tuple[int, Any]] = {
        "entities": (described.entities, described.dimension), "relations": (described.relations, None),
    } | ({"words": (described.entities, None)} if "words" in found else {})  # fmt: skip
    for name, shape in shapes.items():
        if name not in found:
            raise InputError(path, f"tensor {name!r}", "missing")
        values = found[name]
        fits = values.ndim == 2 and len(values) == shape[0] and shape[1] in (None, values.shape[1]) and values.size
        if not fits or values.dtype not in (np.float32, np.float64):
            expected = f"expected float32 or float64 of shape ({shape[0]}, {shape[1] or 'numbers of a row'})"
            raise InputError(path, f"tensor {name!r}", f"{expected}, got {values.dtype} {values.shape}")
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values).all(1)))
            raise InputError(path, f"tensor {name!r}: row {row}", "expected finite numbers, got NaN or infinity")
    if set(found) - set(shapes):
        raise InputError(path, f"tensor {min(set(found) - set(shapes))!r:.80}", "expected no tensor of this name")
    return found


def _triples(path: Path, content: bytes, entities: Mapping[str, int], relations: Mapping[str, int]) -> np.ndarray:
    rows = read_rows(path, content, TRIPLE_COLUMNS)
    found = np.empty((len(rows), 3), dtype=np.int64)
    for number, row in enumerate(rows):
        for slot, (name, ids) in enumerate(zip(row, (entities, relations, entities), strict=True)):
            if name not in ids:
                what = TRIPLE_COLUMNS[slot]
                raise InputError(path, f"line {number + 2}", f"expected a known name as {what}, got {name!r:.80}")
            found[number, slot] = ids[name]
    return found


def _same(path: Path, what: str, got: int, expected: int) -> None:
    if got != expected:
        raise InputError(path, "", f"expected {expected} {what}, as {ABOUT} says, got {got}")


def _check_inserted(path: Path, described: EntityInfo, names: list[str], relations: Mapping[str, int]) -> None:
    """See that what was inserted has the last rows, and was told what there is."""
    inserted = [one.entity for one in described.inserted]
    if inserted != names[len(names) - len(inserted) :]:
        raise InputError(path, "inserted", "expected the entities of the last rows, in their order")
    known = set(names)
    for number, one in enumerate(described.inserted):
        for head, relation, tail in one.told:
            if not {head, tail} <= known or relation not in relations or one.entity not in (head, tail):
                place = f"inserted.{number}.told"
                raise InputError(path, place, f"expected known names, one of them {one.entity!r:.80}")
