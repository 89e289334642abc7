"""Tensors of an embedding from files: NumPy's, safetensors, JSON, and PyTorch's as far as they hold tensors alone."""

from __future__ import annotations

import json
import pickle
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from isi.errors import InputError

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
#: Under which keys checkpoints hold a state dict.
WITHIN = ("state_dict", "model_state_dict")


def read_tensors(path: Path) -> dict[str, np.ndarray]:
    """The tables of a file, by name; that of ``.npy`` has the file's name.

    Raises:
        InputError: where the file is missing, broken, or of another form, or would run code when it is read.
    """
    if path.suffix not in FORMS:
        raise InputError(path, "", f"expected a file of tensors: {', '.join(FORMS)}")
    if not path.is_file():
        raise InputError(path, "", "no such file: expected a file of tensors")
    try:
        return FORMS[path.suffix](path)
    except Exception as error:  # a broken file makes NumPy and PyTorch raise many types
        message = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(path, "", f"expected tensors ({message})") from error


def _npy(path: Path) -> dict[str, np.ndarray]:
    return {path.stem: np.load(path, allow_pickle=False)}


def _npz(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as arrays:
        return dict(arrays)


def _safetensors(path: Path) -> dict[str, np.ndarray]:
    from safetensors.torch import load_file

    return {name: _array(tensor) for name, tensor in load_file(path).items()}


def _json(path: Path) -> dict[str, np.ndarray]:
    """A mapping from names to lists of rows, as OpenKE writes it."""
    tensors = json.loads(path.read_bytes())
    if not isinstance(tensors, dict):
        raise ValueError("a mapping from names to lists of rows")
    return {name: np.array(rows, np.float32) for name, rows in tensors.items() if isinstance(rows, list)}


def _torch(path: Path) -> dict[str, np.ndarray]:
    """A state dict, read without running what a pickle may hold."""
    import torch

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            state: Any = torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError) as error:
        raise ValueError("as torch.save(model.state_dict(), FILE) writes them; other pickles are not read") from error
    while isinstance(state, Mapping) and (key := next((name for name in WITHIN if name in state), None)):
        state = state[key]
    if not isinstance(state, Mapping):
        raise ValueError(f"a state dict, got {type(state).__name__}")
    return {str(name): _array(value) for name, value in state.items() if isinstance(value, torch.Tensor)}


def _array(tensor: Any) -> np.ndarray:
    """A tensor as an array; NumPy has no half precision of every kind."""
    whole = tensor.detach().cpu()
    array: np.ndarray = (whole.float() if whole.dtype.itemsize < 4 and whole.is_floating_point() else whole).numpy()
    return array


#: Readers by suffix.
FORMS = {".npy": _npy, ".npz": _npz, ".safetensors": _safetensors, ".json": _json, ".pt": _torch, ".pth": _torch}


def tables(tensors: Mapping[str, np.ndarray], model: str, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """The tables of entities and of relations as this project has them: real halves before imaginary ones; of RotatE,
    relations as angles.

    Raises:
        InputError: naming the file, where a table is missing, several could be it, or it is no table of numbers.
    """
    if all(name in tensors for name in OF_PYKEEN):
        entities, relations = (_table(tensors, name, path) for name in OF_PYKEEN)
        if model in ("complex", "rotate"):
            entities, relations = _as_complex(entities, path), _as_complex(relations, path)
    else:
        entities, relations = _named(tensors, ENTITIES, path), _named(tensors, RELATIONS, path)
    if model == "rotate" and np.iscomplexobj(relations):
        relations = np.angle(relations)
    return _real(entities), _real(relations)


def _named(tensors: Mapping[str, np.ndarray], names: tuple[tuple[str, ...], ...], path: Path) -> np.ndarray:
    """The table that goes by one of several names."""
    present = [parts for parts in names if all(part in tensors for part in parts)]
    if len(present) != 1:
        listed = ", ".join(sorted(tensors)[:8]) or "none"
        raise InputError(path, "", f"expected one tensor {names[0][0]!r}, or a name of other tools, got {listed:.200}")
    parts = [_table(tensors, part, path) for part in present[0]]
    if len({part.shape for part in parts}) > 1:
        raise InputError(path, present[0][1], f"expected the shape of {present[0][0]}")
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)


def _table(tensors: Mapping[str, np.ndarray], name: str, path: Path) -> np.ndarray:
    values = tensors[name]
    if values.ndim != 2 or values.dtype.kind not in "biufc":
        raise InputError(path, name, f"expected a table of numbers, got {values.dtype} of shape {values.shape}")
    return values


def _as_complex(table: np.ndarray, path: Path) -> np.ndarray:
    """Numbers whose real and imaginary parts stand in turn, as complex ones; shape (E, 2d), result (E, d)."""
    if table.shape[1] % 2:
        raise InputError(path, "", f"expected real and imaginary parts in turn, got rows of {table.shape[1]} numbers")
    pairs = table.reshape(len(table), -1, 2)
    numbers: np.ndarray = pairs[..., 0] + 1j * pairs[..., 1]
    return numbers


def _real(table: np.ndarray) -> np.ndarray:
    """Floats, real halves before imaginary ones; shape (E, d) of complex numbers, result (E, 2d)."""
    whole = np.concatenate([table.real, table.imag], axis=1) if np.iscomplexobj(table) else table
    return np.ascontiguousarray(whole, np.float64 if whole.dtype == np.float64 else np.float32)
