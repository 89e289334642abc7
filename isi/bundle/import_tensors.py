"""Tables of numbers from files: NumPy's, safetensors, JSON, and PyTorch's as far as they hold tensors alone."""

from __future__ import annotations

import json
import pickle
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from isi.errors import InputError

#: Files that may hold tensors, by the ends of their names.
SUFFIXES = (".npy", ".npz", ".safetensors", ".json", ".pt", ".pth")
#: What tools call the tables of entities and relations; of two, the halves of complex vectors: real, then imaginary.
ENTITIES = (
    ("entities",), ("entity",), ("ent_emb",), ("ent_embeddings.weight",), ("ent_emb.weight",),
    ("ent_re_embeddings.weight", "ent_im_embeddings.weight"), ("re_ent_emb.weight", "im_ent_emb.weight"),
)  # fmt: skip
RELATIONS = (
    ("relations",), ("relation",), ("rel_emb",), ("rel_embeddings.weight",), ("rel_emb.weight",),
    ("rel_re_embeddings.weight", "rel_im_embeddings.weight"), ("re_rel_emb.weight", "im_rel_emb.weight"),
)  # fmt: skip
#: What PyKEEN calls them: rows of complex numbers have real and imaginary parts in turn.
OF_PYKEEN = ("entity_representations.0._embeddings.weight", "relation_representations.0._embeddings.weight")
#: What checkpoints call the tensors among other things.
WITHIN = ("state_dict", "model_state_dict")


def read_tensors(path: Path) -> dict[str, np.ndarray]:
    """The tables of a file, by name; the one of ``.npy`` goes by the file's name.

    Raises:
        InputError: where the file is missing, broken, or of another form, or would run code when it is read.
    """
    readers = {".npy": _npy, ".npz": _npz, ".safetensors": _safetensors, ".json": _json, ".pt": _torch, ".pth": _torch}
    if path.suffix not in readers:
        raise InputError(path, "", f"expected a file of tensors: {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise InputError(path, "", "expected a file of tensors, but there is no such file")
    try:
        return readers[path.suffix](path)
    except Exception as error:  # what a broken file does to NumPy and PyTorch has many names
        raise InputError(path, "", f"expected tensors ({_one_line(error)})") from error


def _npy(path: Path) -> dict[str, np.ndarray]:
    return {path.stem: np.load(path, allow_pickle=False)}


def _npz(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as found:
        return {name: found[name] for name in found.files}


def _safetensors(path: Path) -> dict[str, np.ndarray]:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    try:
        return {name: _array(tensor) for name, tensor in load_file(path).items()}
    except SafetensorError as error:
        raise ValueError(error) from error


def _json(path: Path) -> dict[str, np.ndarray]:
    """A mapping from names to lists of rows, as OpenKE writes it."""
    found = json.loads(path.read_bytes())
    if not isinstance(found, dict):
        raise ValueError("a mapping from names to lists of rows")
    return {name: np.array(rows, np.float32) for name, rows in found.items() if isinstance(rows, list)}


def _torch(path: Path) -> dict[str, np.ndarray]:
    """A state dict, read without running what a pickle may hold."""
    import torch

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found: Any = torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError) as error:
        raise ValueError("as torch.save(model.state_dict(), FILE) writes them; other pickles are not read") from error
    while isinstance(found, Mapping) and (key := next((name for name in WITHIN if name in found), None)):
        found = found[key]
    if not isinstance(found, Mapping):
        raise ValueError(f"a state dict, got {type(found).__name__}")
    return {str(name): _array(value) for name, value in found.items() if isinstance(value, torch.Tensor)}


def _array(tensor: Any) -> np.ndarray:
    """A tensor as an array that can hold it."""
    whole = tensor.detach().cpu()
    array: np.ndarray = (whole.float() if whole.dtype.itemsize < 4 and whole.is_floating_point() else whole).numpy()
    return array


def tables(tensors: Mapping[str, np.ndarray], family: str, place: object) -> tuple[np.ndarray, np.ndarray]:
    """The tables of entities and of relations, in this project's terms: real halves before imaginary ones; of RotatE,
    angles as relations.

    Raises:
        InputError: where a table is not among the tensors, more than one could be it, or it is no table of numbers.
    """
    if all(name in tensors for name in OF_PYKEEN):
        entities, relations = (_table(tensors, name, place) for name in OF_PYKEEN)
        if family in ("complex", "rotate"):
            entities, relations = (_paired(table, place) for table in (entities, relations))
    else:
        entities, relations = (_named(tensors, names, what, place)
                               for names, what in ((ENTITIES, "entities"), (RELATIONS, "relations")))  # fmt: skip
    if family == "rotate" and np.iscomplexobj(relations):
        relations = np.angle(relations)
    return _real(entities), _real(relations)


def _named(
    tensors: Mapping[str, np.ndarray], names: tuple[tuple[str, ...], ...], what: str, place: object
) -> np.ndarray:
    found = [parts for parts in names if all(part in tensors for part in parts)]
    if len(found) != 1:
        listed = ", ".join(sorted(tensors)[:8]) or "none"
        raise InputError(place, "", f"expected one tensor {what!r}, or as other tools call it, among {listed:.200}")
    parts = [_table(tensors, part, place) for part in found[0]]
    if len({part.shape for part in parts}) > 1:
        raise InputError(place, found[0][1], f"expected the shape of {found[0][0]}")
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)


def _table(tensors: Mapping[str, np.ndarray], name: str, place: object) -> np.ndarray:
    found = tensors[name]
    if found.ndim != 2 or found.dtype.kind not in "biufc":
        raise InputError(place, name, f"expected a table of numbers, got {found.dtype} of shape {found.shape}")
    return found


def _paired(table: np.ndarray, place: object) -> np.ndarray:
    """Numbers whose real and imaginary parts stand in turn, as complex ones."""
    if table.shape[1] % 2:
        raise InputError(place, "", f"expected real and imaginary parts in turn, got rows of {table.shape[1]} numbers")
    pairs = table.reshape(len(table), -1, 2)
    paired: np.ndarray = pairs[..., 0] + 1j * pairs[..., 1]
    return paired


def _real(table: np.ndarray) -> np.ndarray:
    whole = np.concatenate([table.real, table.imag], axis=1) if np.iscomplexobj(table) else table
    return np.ascontiguousarray(whole, np.float64 if whole.dtype == np.float64 else np.float32)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
