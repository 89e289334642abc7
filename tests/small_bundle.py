"""A small bundle, its folder, and the same tables in formats of other tools."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from isi.formats.plain import write
from isi.home.bundle import MANIFEST, MODEL, Bundle, Manifest, WordSource
from isi.home.folder import create
from isi.home.loaded import LoadedEmbedding
from tests.small_graphs import random_embedding, random_graph

NAMES = ["kitchen", "bedroom", "kettle", "bed", "turn on", "lie on"]
KINDS = ["room", "room", "object", "object", "affordance", "affordance"]
BETWEEN = ["atLocation", "hasAffordance"]
#: DistMult: f(h, r, t) = Σ h · r · t; coordinates 0, 1 are of atLocation, coordinates 2, 3 of
#: hasAffordance.
VECTORS = [[1, 0, 0, 0], [0, 1, 0, 0], [3, 1, 2, 0], [1, 2, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]]
RELATIONS = [[1, 1, 0, 0], [0, 0, 1, 1]]
TRIPLES = [(2, 0, 0), (3, 0, 1), (2, 1, 4), (3, 1, 5)]
#: Unit word vectors; the rooms have none (zeros).
WORDS = [[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0.8, 0, 0.6], [0, 0.8, 0.6]]


def small(**changed: Any) -> Bundle:
    """The small bundle, with four triples about a kettle and a bed, or with changed fields."""
    manifest = Manifest(
        model_name="distmult",
        model_options={},
        words=WordSource(source="shipped", text="definition", model=MODEL),
        made={"by": "a test"},
    )
    given: dict[str, Any] = {
        "manifest": manifest,
        "entities": np.array(VECTORS, np.float32),
        "relations": np.array(RELATIONS, np.float32),
        "entity_names": list(NAMES),
        "kinds": list(KINDS),
        "phrases": list(NAMES),
        "relation_names": list(BETWEEN),
        "triples": np.array(TRIPLES),
        "words": np.array(WORDS, np.float32),
    }
    return Bundle(**{**given, **changed})


def random_bundle(triples: int) -> Bundle:
    """A bundle of random vectors of 30 entities and two relations,
    with this number of known triples.
    """
    graph, stack = random_graph(30, 2, triples), random_embedding(1, 30, 2, 8)
    names = [f"e{number}" for number in range(30)]
    manifest = Manifest(model_name="analogy", model_options={}, words=None, made={})
    return Bundle(
        manifest,
        stack.entity[0].numpy(),
        stack.relation[0].numpy(),
        names,
        [""] * 30,
        names,
        ["in", "on"],
        graph.triples.numpy(),
        np.random.default_rng(0).standard_normal((30, 4)).astype(np.float32),
    )


def opened(bundle: Bundle | None = None, **changed: Any) -> LoadedEmbedding:
    """A bundle (default: the small one) opened for queries."""
    return LoadedEmbedding(**vars(bundle or small(**changed)))


def word_file(path: Path, vectors: Mapping[str, Sequence[float]]) -> Path:
    """Write a file of word vectors by phrase; returns its path."""
    rows = [
        " ".join([phrase.replace(" ", "_"), *map(repr, map(float, row))])
        for phrase, row in vectors.items()
    ]
    path.write_text("\n".join([f"{len(rows)} {rows[0].count(' ')}", *rows, ""]), encoding="utf-8")
    return path


def worded(folder: Path, bundle: Bundle | None = None, **further: Sequence[float]) -> Bundle:
    """A bundle (default: the small one) whose word vectors are from a file in a folder,
    which has further phrases.
    """
    bundle = bundle or small()
    assert bundle.words is not None
    vectors = {
        phrase: row
        for phrase, row in zip(bundle.phrases, bundle.words.tolist(), strict=True)
        if any(row)
    }
    source = WordSource(
        source=str(word_file(folder / "words.txt", vectors | further)), text="phrase", model=None
    )
    return replace(bundle, manifest=bundle.manifest.model_copy(update={"words": source}))


def written(path: Path, bundle: Bundle | None = None) -> Path:
    """Write a bundle (default: the small one) as plain files; returns their folder."""
    path.mkdir(parents=True, exist_ok=True)
    write(path, bundle or small())
    return path


def home_of(path: Path, bundle: Bundle | None = None) -> Path:
    """Make a bundle (default: the small one) the home of a folder; returns the folder."""
    create(bundle or small(), path).close()
    return path


def without_words() -> Bundle:
    """The small bundle without word vectors."""
    bundle = small(words=None)
    return replace(bundle, manifest=bundle.manifest.model_copy(update={"words": None}))


def files(path: Path) -> dict[str, bytes]:
    """Bytes of the files in a folder, by name."""
    return {file.name: file.read_bytes() for file in path.iterdir()}


def edit(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change the manifest of a folder in place."""
    manifest = json.loads((path / MANIFEST).read_text(encoding="utf-8"))
    change(manifest)
    (path / MANIFEST).write_text(json.dumps(manifest), encoding="utf-8")


def tamper(path: Path, name: str, content: bytes) -> None:
    """Replace the bytes of a file, and its SHA-256 in the manifest."""
    (path / name).write_bytes(content)
    edit(
        path, lambda manifest: manifest["files"].update({name: hashlib.sha256(content).hexdigest()})
    )


ENTITIES, LABELS = np.array(VECTORS, np.float32), np.array(RELATIONS, np.float32)


def write_lists(folder: Path = Path("mine"), **tensors: Any) -> Path:
    """Write names (one per line), triples and, if given,
    tensors (``.npz``) of the small bundle into a folder.
    """
    folder.mkdir(exist_ok=True)
    (folder / "entities.txt").write_text("\n".join(NAMES) + "\n", encoding="utf-8")
    (folder / "relations.txt").write_text("\n".join(BETWEEN) + "\n", encoding="utf-8")
    named = [
        f"{NAMES[head]}\t{BETWEEN[relation]}\t{NAMES[tail]}\n" for head, relation, tail in TRIPLES
    ]
    (folder / "triples.tsv").write_text("".join(named), encoding="utf-8")
    if tensors:
        np.savez(folder / "tables.npz", **tensors)
    return folder


def write_openke(folder: Path = Path("theirs")) -> Path:
    """Write the small bundle's names and triples (head, tail, relation) in OpenKE's format."""
    folder.mkdir()
    for file, names in (("entity2id.txt", NAMES), ("relation2id.txt", BETWEEN)):
        rows = "".join(f"{name}\t{number}\n" for number, name in enumerate(names))
        (folder / file).write_text(f"{len(names)}\n{rows}", encoding="utf-8")
    rows = "".join(f"{head} {tail} {relation}\n" for head, relation, tail in TRIPLES)
    (folder / "train2id.txt").write_text(f"{len(TRIPLES)}\n{rows}", encoding="utf-8")
    return folder
