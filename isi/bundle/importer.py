"""Embeddings that other tools have trained, as bundles: names, triples and tensors of PyKEEN, OpenKE or plain files.

Tensors are NumPy's, safetensors, JSON, and PyTorch's as far as they hold tensors alone: no pickle is run.
"""

from __future__ import annotations

import hashlib
import json
import pickle
import warnings
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from safetensors.torch import load_file

from isi.bundle.folder import Bundle, Manifest, check_numbers, ids_of, triple_ids
from isi.bundle.query import plain
from isi.config import Option
from isi.errors import InputError, at, cut
from isi.insertion.api import margin_of
from isi.insertion.arguments import argument, checked_model, stack_of_one, table
from isi.models.model import MODELS
from isi.sources.triples import read_id_names, read_ids

#: PyKEEN's folder and OpenKE's files; files of names, one a line, where there is neither.
PYKEEN, ENTITY2ID, RELATION2ID, TRAIN2ID = "training_triples", "entity2id.txt", "relation2id.txt", "train2id.txt"
ENTITY_NAMES, RELATION_NAMES, TRIPLES = "entities.txt", "relations.txt", "triples.tsv"
PICKLE = "trained_model.pkl"  #: What PyKEEN pickles a model as.
FORMS = (".npy", ".npz", ".safetensors", ".json", ".pt", ".pth")  #: Suffixes of files of tensors.
#: What tools call the tables of entities and relations; of two, the halves of complex vectors: real, then imaginary.
NAMES = {
    slot: [
        (slot,), (single,), (f"{short}_emb",), (f"{short}_embeddings.weight",), (f"{short}_emb.weight",),
        (f"{short}_re_embeddings.weight", f"{short}_im_embeddings.weight"),
        (f"re_{short}_emb.weight", f"im_{short}_emb.weight"),
    ]
    for slot, single, short in (("entities", "entity", "ent"), ("relations", "relation", "rel"))
}  # fmt: skip
#: What PyKEEN calls them: rows of complex numbers have real and imaginary parts in turn.
OF_PYKEEN = ("entity_representations.0._embeddings.weight", "relation_representations.0._embeddings.weight")
WITHIN = ("state_dict", "model_state_dict")  #: Under which keys checkpoints hold a state dict.


@dataclass(frozen=True, eq=False)
class Labels:
    """Names of an embedding's rows, and its known triples."""

    form: str  #: where they were read: PyKEEN, entity2id, arrays
    entities: list[str]
    relations: list[str]
    triples: np.ndarray  #: ids; shape: (T, 3), int64


def of_tensors(labels: Labels, model: str, options: Mapping[str, Option], files: Sequence[Path]) -> Bundle:
    """A bundle of labels and files of tensors.

    A distance model without a margin gets one halfway between the mean scores of known and of corrupted triples.
    """
    tensors = {name: values for file in files for name, values in read_tensors(file).items()}
    with argument("model"):
        fields = getattr(MODELS.get(model, "model"), "__dataclass_fields__", {})
    options = ({"squared": False} if "squared" in fields else {}) | dict(options)
    if unknown_margin := "margin" in fields and "margin" not in options:
        options["margin"] = 1.0  # with which it is measured
        if not len(labels.triples):
            raise InputError("--set", "margin", "expected margin=NUMBER: without known triples it cannot be estimated")
    with at(files[0]):
        entities, relations = _tables(tensors, model)
    bundle = _bundle(model, options, entities, relations, labels, files)
    if unknown_margin:
        embedding = stack_of_one(entities, relations, checked_model(model, options, entities.shape[1]))
        margin = max(1.0 + margin_of(embedding, torch.from_numpy(labels.triples), None), 1e-6)
        bundle.manifest.model_options["margin"] = margin
    return bundle


def of_pickle(path: Path, labels: Labels) -> Bundle:
    """A bundle of PyKEEN's model, unpickled; an ``InputError`` where it has no closed form for a manifest."""
    if not path.is_file():
        raise InputError(path, "", "no such file: expected PyKEEN's pickle of a model")
    try:
        from isi.pykeen import read_model
    except ImportError as error:
        raise InputError(path, "", "needs PyKEEN to be read: pip install pykeen") from error
    try:
        pickled = torch.load(path, map_location="cpu", weights_only=False)  # as its user has asked for
    except Exception as error:  # whatever a pickle does
        raise InputError(path, "", f"expected a model of PyKEEN's ({type(error).__name__})") from error
    embedding = read_model(pickled, torch.from_numpy(labels.triples), None)
    entities, relations, model = embedding.entity[0].numpy(), embedding.relation[0].numpy(), embedding.model
    for name in MODELS.names():
        if type(model) is MODELS.get(name, ""):
            return _bundle(name, vars(model), entities, relations, labels, [path])
    raise InputError(path, "", "expected TransE, DistMult, ComplEx or RotatE: isi.pykeen.insert takes other models")


def _bundle(
    name: str, options: Mapping[str, Option], entities: np.ndarray, relations: np.ndarray, labels: Labels,
    files: Sequence[Path],
) -> Bundle:  # fmt: skip
    model = checked_model(name, options, entities.shape[1])
    for slot, rows, names in (("entities", entities, labels.entities), ("relations", relations, labels.relations)):
        with at(files[0], slot):
            check_numbers(rows, len(names))
            table(rows, slot, model.width(entities.shape[1]) if slot == "relations" else None)
    digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    manifest = Manifest(
        model_name=name, model_options={key: vars(model)[key] for key in options}, words=None,
        made={"imported": labels.form, "files": digests}, inserted=[],
    )  # fmt: skip
    triples = np.unique(labels.triples, axis=0) if len(labels.triples) else labels.triples
    kinds, phrases = [""] * len(entities), [plain(name) for name in labels.entities]
    return Bundle(manifest, entities, relations, labels.entities, kinds, phrases, labels.relations, triples)


def tensors_in(folder: Path, form: str) -> list[Path]:
    """The files of tensors in a folder; an ``InputError`` where there are none."""
    others = ("results.json", "metadata.json") if form == "PyKEEN" else ()
    files = sorted(path for path in folder.iterdir() if path.suffix in FORMS and path.name not in others)
    if not files:
        pickled = f" ({PICKLE} is a pickle, which is read with --trust-pickle alone)" * (folder / PICKLE).exists()
        raise InputError(folder, "", f"expected a file of tensors{pickled}: {', '.join(FORMS)}, or --tensors FILE")
    return files


def read_tensors(path: Path) -> dict[str, np.ndarray]:
    """The tables of a file, by name (of ``.npy``, the file's); what would run code is refused by an ``InputError``."""
    if path.suffix not in FORMS or not path.is_file():
        raise InputError(path, "", f"no such file of tensors: expected one of {', '.join(FORMS)}")
    try:
        if path.suffix == ".npy":
            return {path.stem: np.load(path, allow_pickle=False)}
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                return dict(arrays)
        if path.suffix == ".json":  # as OpenKE writes it
            tables = json.loads(path.read_bytes())
            return {name: np.array(rows, np.float32) for name, rows in tables.items() if isinstance(rows, list)}
        state = load_file(path) if path.suffix == ".safetensors" else _state_dict(path)
        tensors = {name: value.detach().cpu() for name, value in state.items() if isinstance(value, torch.Tensor)}
        halves = {name for name, value in tensors.items() if value.is_floating_point() and value.dtype.itemsize < 4}
        return {name: (value.float() if name in halves else value).numpy() for name, value in tensors.items()}
    except Exception as error:  # a broken file makes NumPy and PyTorch raise many types
        message = cut(" ".join(str(error).split()), 120) or type(error).__name__
        raise InputError(path, "", f"expected tensors by name ({message})") from error


def _state_dict(path: Path) -> Mapping[str, Any]:
    """PyTorch's, read without running what a pickle may hold."""
    try:
        with warnings.catch_warnings(action="ignore"):
            state: Any = torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError) as error:
        raise ValueError("as torch.save(model.state_dict(), FILE) writes them; other pickles are not read") from error
    while isinstance(state, Mapping) and (key := next((name for name in WITHIN if name in state), None)):
        state = state[key]
    if not isinstance(state, Mapping):
        raise ValueError(f"a state dict, got {type(state).__name__}")
    return state


def _tables(tensors: Mapping[str, np.ndarray], model: str) -> tuple[np.ndarray, np.ndarray]:
    """The tables of entities and of relations as this project has them, real halves before imaginary ones."""
    of_pykeen = all(name in tensors for name in OF_PYKEEN)
    tables = list[np.ndarray]()
    for slot, names in NAMES.items():
        present = [parts for parts in names if all(part in tensors for part in parts)]
        parts = (OF_PYKEEN[len(tables)],) if of_pykeen else present[0] if len(present) == 1 else ()
        if not parts:
            listed = ", ".join(sorted(tensors)[:8]) or "none"
            raise InputError("", "", f"expected one tensor {slot!r}, or a name of other tools, got {listed:.200}")
        for part in parts:
            values = tensors[part]
            if values.ndim != 2 or values.dtype.kind not in "biufc" or values.shape != tensors[parts[0]].shape:
                expected = f"expected a table of numbers{f', of the shape of {parts[0]}' * (part != parts[0])}"
                raise InputError("", part, f"{expected}, got {values.dtype} of shape {values.shape}")
        whole = np.concatenate([tensors[part] for part in parts], axis=1)
        if of_pykeen and model in ("complex", "rotate"):  # real and imaginary parts in turn
            if whole.shape[1] % 2:
                expected = f"expected real and imaginary parts in turn, got rows of {whole.shape[1]} numbers"
                raise InputError("", "", expected)
            whole = whole[:, ::2] + 1j * whole[:, 1::2]
        if np.iscomplexobj(whole):
            angles = model == "rotate" and slot == "relations"
            whole = np.angle(whole) if angles else np.concatenate([whole.real, whole.imag], axis=1)
        tables.append(np.ascontiguousarray(whole, np.float64 if whole.dtype == np.float64 else np.float32))
    return tables[0], tables[1]


def read_labels(folder: Path) -> Labels:
    """Names and known triples of a folder of PyKEEN's, of OpenKE's, or with lists of names; no pickle is read."""
    if (folder / PYKEEN).is_dir():
        return _pykeen_labels(folder / PYKEEN)
    if (folder / ENTITY2ID).exists():
        entities, relations = read_id_names(folder / ENTITY2ID), read_id_names(folder / RELATION2ID)
        path, form = folder / TRAIN2ID, "entity2id"
        rows: list[Any] = list(read_ids(folder, [TRAIN2ID])) if path.exists() else []
    elif (folder / ENTITY_NAMES).exists():
        files = folder / ENTITY_NAMES, folder / RELATION_NAMES
        entities, relations = ([name for (name,) in _split_lines(path, 1)] for path in files)
        path, form = folder / TRIPLES, "arrays"
        rows = _split_lines(path, 3) if path.exists() else []
    else:
        raise InputError(folder, "", f"expected a folder with {PYKEEN}, {ENTITY2ID} or {ENTITY_NAMES}")
    ids = ids_of(folder / ENTITY_NAMES, entities, 1), ids_of(folder / RELATION_NAMES, relations, 1)
    return Labels(form, entities, relations, triple_ids(path, rows, *ids))


def _pykeen_labels(folder: Path) -> Labels:
    names = dict[str, list[str]]()
    for slot in ("entity", "relation"):
        path = folder / f"{slot}_to_id.tsv.gz"
        listed = _pykeen_table(path, {"id": np.int64, "label": str}).sort_values("id")
        if listed["id"].tolist() != list(range(len(listed))):
            raise InputError(path, "", f"expected the ids from 0 to {len(listed) - 1}")
        ids_of(path, names.setdefault(slot, listed["label"].tolist()))
    path, most = folder / "numeric_triples.tsv.gz", [len(names[slot]) for slot in ("entity", "relation", "entity")]
    triples = _pykeen_table(path, dict.fromkeys(["head", "relation", "tail"], np.int64)).to_numpy()
    for row in np.flatnonzero(((triples < 0) | (triples >= most)).any(1))[:1]:
        raise InputError(path, f"line {row + 2}", f"expected ids below {most}")
    return Labels("PyKEEN", names["entity"], names["relation"], triples)


def _pykeen_table(path: Path, kinds: Mapping[str, type]) -> pd.DataFrame:
    expected = f"expected a compressed table of {', '.join(kinds)}"
    try:
        frame = pd.read_csv(path, sep="\t", dtype=kinds, keep_default_na=False)
    except (OSError, EOFError, zlib.error, ValueError, OverflowError) as error:
        raise InputError(path, "", f"{expected} ({cut(str(error), 120)})") from error
    if list(frame) != list(kinds) or not isinstance(frame.index, pd.RangeIndex):
        raise InputError(path, "line 1", expected)
    return frame


def _split_lines(path: Path, columns: int) -> list[list[str]]:
    """Rows of a text file of so many columns, separated by tabs."""
    with at(path):
        lines = path.read_text(encoding="utf-8-sig").removesuffix("\n").split("\n")
    rows = [line.removesuffix("\r").split("\t") for line in lines if lines != [""]]
    for number, row in enumerate(rows, 1):
        if len(row) != columns:
            raise InputError(path, f"line {number}", f"expected {columns} columns, got {len(row)}")
    return rows
