"""Import of arrays with names as bundles: a folder of plain files, or of a PyKEEN model.

Tensors are NumPy's, safetensors', or a state dict of PyTorch's; no pickled code is run.
"""

import hashlib
import pickle
import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from safetensors.torch import load_file

from isi.columns import TRIPLE
from isi.config import Option
from isi.errors import InputError, at, cut
from isi.formats.plain import checked_names, split_rows, triple_ids
from isi.home.bundle import Bundle, Manifest, check_numbers, stored_loss
from isi.home.loaded import LoadedEmbedding
from isi.insertion.arguments import array_of, checked_model, naming_argument
from isi.models.losses import Loss
from isi.models.model import MODELS
from isi.models.stack import margin_of
from isi.names import plain
from isi.process import quiet

#: PyKEEN's folder, plain files; the first of each form, if it exists, identifies the form.
PYKEEN = "training_triples"
ENTITY_NAMES, RELATION_NAMES, TRIPLES = "entities.txt", "relations.txt", "triples.tsv"
#: PyKEEN's tables of names and of triples.
OF_TRIPLES = ("entity_to_id", "relation_to_id", "numeric_triples")
OF_NAMES: dict[str, type] = {"id": np.int64, "label": str}  #: Columns of a table of names.
#: Suffixes of tensor files.
FORMS = (".npy", ".npz", ".safetensors", ".pt")
#: End of PyKEEN's tensor names. In rows of these tensors, real and imaginary parts of complex
#: numbers alternate.
OF_PYKEEN = "_representations.0._embeddings.weight"
SLOTS = ("entities", "relations")  #: The two tables, and the names of their tensors.
#: PyKEEN's name of the table of each slot.
PYKEEN_NAMES = {"entities": f"entity{OF_PYKEEN}", "relations": f"relation{OF_PYKEEN}"}


@dataclass(frozen=True, eq=False)
class Labels:
    """Names of an embedding's rows, and its known triples."""

    form: str  #: of the folder: PyKEEN, arrays (plain files)
    entities: list[str]
    relations: list[str]
    triples: np.ndarray  #: ids; shape: (T, 3), int64


def of_tables(
    labels: Labels,
    model: str,
    options: Mapping[str, Option],
    tables: Sequence[np.ndarray],
    files: Sequence[Path],
    loss: Loss | None = None,
) -> Bundle:
    """Make a bundle of labels and the two tables of tensor files;
    InputError if they do not fit, or if no margin can be estimated.

    The margin of a distance model, if not given, lies midway between mean distances of known and
    corrupted triples.
    """
    with naming_argument("model"):
        fields = getattr(MODELS.get(model, "model"), "__dataclass_fields__", {})
    estimated = "margin" in fields and "margin" not in options
    if estimated and not len(labels.triples):
        raise InputError(
            "--set",
            "margin",
            "expected margin=NUMBER: without known triples it cannot be estimated",
        )
    # for the scores from which the margin is estimated
    defaults = {"squared": False, "margin": 1.0}
    options = {name: value for name, value in defaults.items() if name in fields} | dict(options)
    bundle = bundle_of(model, options, tables, labels, files, loss)
    if estimated:
        margin = max(
            1.0 + margin_of(bundle.embedding, torch.from_numpy(labels.triples), None), 1e-6
        )
        bundle.manifest.model_options["margin"] = margin
    return bundle


def bundle_of(
    model: str,
    options: Mapping[str, Option],
    tables: Sequence[np.ndarray],
    labels: Labels,
    files: Sequence[Path],
    loss: Loss | None = None,
) -> LoadedEmbedding:
    """Make a bundle of the two tables, checked against each other, the model and the labels;
    ``loss``: of training, None if it is unknown.
    """
    entities, relations = tables
    checked = checked_model(model, options, entities.shape[1])
    names = (labels.entities, labels.relations)
    if len(relations) == 2 * len(labels.relations):
        expected = (
            f"expected {len(labels.relations)} rows, got twice as many, "
            "as a model with inverse triples has"
        )
        expected += ": for other models, use isi.pykeen.insert"
        raise InputError(files[0], "relations", expected)
    for slot, rows, listed in zip(SLOTS, tables, names, strict=True):
        with at(files[0], slot):
            check_numbers(rows, len(listed))
    digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    manifest = Manifest(
        model_name=model,
        model_options={name: vars(checked)[name] for name in options},
        words=None,
        trained_with=stored_loss(loss),
        made={"imported": labels.form, "files": digests},
    )
    triples = np.unique(labels.triples, axis=0) if len(labels.triples) else labels.triples
    kinds = [""] * len(entities)
    phrases = [plain(name) for name in labels.entities]
    bundle = LoadedEmbedding(
        manifest, entities, relations, names[0], kinds, phrases, names[1], triples
    )
    with at(files[0]):
        bundle.embedding  # noqa: B018  # checks the width of relations
    return bundle


def read_tables(folder: Path, model: str) -> tuple[list[Path], list[np.ndarray]]:
    """The files in a folder that hold the tensors ``entities`` and ``relations``, or those of
    PyKEEN's names, and these two tables.

    InputError unless there is one of each.
    """
    tables_of: dict[str, list[tuple[Path, str, np.ndarray]]] = {slot: [] for slot in SLOTS}
    for path in sorted(path for path in folder.iterdir() if path.suffix in FORMS):
        for name, values in read_tensors(path).items():
            for slot in SLOTS:
                if name in (slot, PYKEEN_NAMES[slot]):
                    tables_of[slot].append((path, name, values))
    files, tables = list[Path](), list[np.ndarray]()
    for slot in SLOTS:
        if len(tables_of[slot]) != 1:
            places = ", ".join(path.name for path, *_ in tables_of[slot]) or "none"
            expected = f"expected one tensor {slot} in files of {', '.join(FORMS)}, got {places}"
            raise InputError(folder, "", expected)
        ((path, name, values),) = tables_of[slot]
        with at(path, name):
            tables.append(table_of(values, slot, model, name != slot))
        files.append(path)
    return list(dict.fromkeys(files)), tables


def read_tensors(path: Path) -> dict[str, np.ndarray]:
    """The tensors of a file by name (``.npy``: the file's name);
    ``InputError`` refuses pickled code.
    """
    try:
        if path.suffix == ".npy":
            return {path.stem: np.load(path, allow_pickle=False)}
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                return dict(arrays)
        state = load_file(path) if path.suffix == ".safetensors" else _state_dict(path)
        return {name: array_of(value) for name, value in state.items()}
    except Exception as error:  # a broken file makes NumPy and PyTorch raise many types
        message = cut(" ".join(str(error).split()), 120) or type(error).__name__
        raise InputError(path, "", f"expected tensors by name ({message})") from error


def _state_dict(path: Path) -> dict[str, torch.Tensor]:
    """Read a PyTorch state dict without running pickled code."""
    try:
        with quiet:
            state: Any = torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError) as error:
        raise ValueError(
            "as torch.save(model.state_dict(), FILE) writes them; other pickles are not read"
        ) from error
    if not isinstance(state, Mapping):
        raise ValueError(f"a state dict, got {type(state).__name__}")
    return {name: value for name, value in state.items() if isinstance(value, torch.Tensor)}


def table_of(values: np.ndarray, slot: str, model: str, of_pykeen: bool) -> np.ndarray:
    """A slot's real table. Complex rows become real and imaginary halves,
    or angles if they are RotatE's relations.
    """
    if values.ndim != 2 or values.dtype.kind not in "biufc":
        got = f"{values.dtype} of shape {values.shape}"
        raise InputError("", "", f"expected a table of numbers, got {got}")
    if of_pykeen and model in ("complex", "rotate"):
        if values.shape[1] % 2:
            expected = "expected rows that alternate real and imaginary parts"
            raise InputError("", "", f"{expected}, got rows of {values.shape[1]} numbers")
        values = values[:, ::2] + 1j * values[:, 1::2]
    if np.iscomplexobj(values):
        angles = MODELS.get(model).angles and slot == "relations"
        halves = [values.real, values.imag]
        values = np.angle(values) if angles else np.concatenate(halves, axis=1)
    kind = np.float64 if values.dtype == np.float64 else np.float32
    return np.ascontiguousarray(values, kind)


def read_labels(folder: Path) -> Labels:
    """Read names and known triples of a folder of PyKEEN or of plain files."""
    rows: np.ndarray | Collection[Sequence[str]]
    if (folder / PYKEEN).is_dir():
        form, first = "PyKEEN", 2
        files = [folder / PYKEEN / f"{name}.tsv.gz" for name in OF_TRIPLES]
        tables = [read_columns(path, OF_NAMES) for path in files[:2]]
        names = list(map(names_by_id, tables, files))
        rows = read_columns(files[2], dict.fromkeys(TRIPLE, np.int64)).to_numpy()
        check_ids(rows, len(names[0]), len(names[1]), files[2])
    elif (folder / ENTITY_NAMES).exists():
        form, first = "arrays", 1
        files = [folder / name for name in (ENTITY_NAMES, RELATION_NAMES, TRIPLES)]
        names = [[name for (name,) in rows_of(path, ["name"])] for path in files[:2]]
        rows = rows_of(files[2], TRIPLE) if files[2].exists() else []
    else:
        raise InputError(folder, "", f"expected a folder with {PYKEEN} or {ENTITY_NAMES}")
    entities = checked_names(files[0], "entity", names[0], first)
    relations = checked_names(files[1], "relation", names[1], first)
    if not isinstance(rows, np.ndarray):
        rows = triple_ids(files[2], rows, entities, relations, first)
    return Labels(form, names[0], names[1], rows)


def rows_of(path: Path, columns: Sequence[str]) -> list[list[str]]:
    """The rows of a tab-separated file without a header."""
    with at(path):
        text = path.read_text(encoding="utf-8-sig")
        return split_rows(text, columns) if text.strip("\n") else []


def names_by_id(table: pd.DataFrame, path: Path) -> list[str]:
    """The names of a file's table of ``id`` and ``label``, by id."""
    table = table.sort_values("id")
    ids, lines = table["id"].to_numpy(), table.index.to_numpy() + 2
    for place in np.flatnonzero(ids != np.arange(len(ids)))[:1]:
        expected = f"expected the id {place}, got {ids[place]}"
        raise InputError(path, f"line {lines[place]}", expected)
    return list(table["label"])


def check_ids(ids: np.ndarray, entities: int, relations: int, path: Path) -> None:
    """``InputError`` for a triple of a file, (T, 3), with an id beyond the names."""
    beyond = (ids < 0) | (ids >= [entities, relations, entities])
    for row in np.flatnonzero(beyond.any(1))[:1]:
        expected = f"expected ids of {entities} entities and {relations} relations"
        raise InputError(path, f"line {row + 2}", f"{expected}, got {ids[row].tolist()}")


def read_columns(path: Path, kinds: Mapping[str, type]) -> pd.DataFrame:
    """A table of columns of these names and types, parted by tabs, perhaps compressed."""
    expected = f"expected a table of {', '.join(kinds)}"
    try:
        frame = pd.read_csv(path, sep="\t", dtype=kinds, keep_default_na=False)
    except (OSError, EOFError, zlib.error, ValueError, OverflowError) as error:
        raise InputError(path, "", f"{expected} ({cut(str(error), 120)})") from error
    if list(frame) != list(kinds) or not isinstance(frame.index, pd.RangeIndex):
        raise InputError(path, "line 1", expected)
    return frame.fillna("")
