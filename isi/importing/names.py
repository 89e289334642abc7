"""Names and triples from files: PyKEEN's ``training_triples``, OpenKE's ``entity2id.txt``, or a name a line."""

from __future__ import annotations

import csv
import gzip
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from isi.base.errors import InputError
from isi.keeping.rows import distinct_names
from isi.sources.triples_with_ids import _names, read_ids

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
