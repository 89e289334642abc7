"""Folders that ``isi import`` reads: the small bundle as lists of names, and as OpenKE writes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.small_bundle import BETWEEN, NAMES, RELATIONS, TRIPLES, VECTORS

ENTITIES, LABELS = np.array(VECTORS, np.float32), np.array(RELATIONS, np.float32)


def write_lists(folder: Path = Path("mine"), **tensors: Any) -> Path:
    """Names, a line each, triples, and tensors as ``.npz`` if there are any."""
    folder.mkdir(exist_ok=True)
    (folder / "entities.txt").write_text("\n".join(NAMES) + "\n", encoding="utf-8")
    (folder / "relations.txt").write_text("\n".join(BETWEEN) + "\n", encoding="utf-8")
    named = [f"{NAMES[head]}\t{BETWEEN[relation]}\t{NAMES[tail]}\n" for head, relation, tail in TRIPLES]
    (folder / "triples.tsv").write_text("".join(named), encoding="utf-8")
    if tensors:
        np.savez(folder / "tables.npz", **tensors)
    return folder


def write_openke(folder: Path = Path("theirs")) -> Path:
    """OpenKE's files: triples are head, tail, relation."""
    folder.mkdir()
    for file, names in (("entity2id.txt", NAMES), ("relation2id.txt", BETWEEN)):
        rows = "".join(f"{name}\t{number}\n" for number, name in enumerate(names))
        (folder / file).write_text(f"{len(names)}\n{rows}", encoding="utf-8")
    rows = "".join(f"{head} {tail} {relation}\n" for head, relation, tail in TRIPLES)
    (folder / "train2id.txt").write_text(f"{len(TRIPLES)}\n{rows}", encoding="utf-8")
    return folder
