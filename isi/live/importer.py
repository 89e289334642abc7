"""Import of embeddings from other tools as bundles:
names, triples and tensors of PyKEEN, OpenKE or plain files.

Tensors are NumPy, safetensors, or PyTorch files of tensors only; only ``isi.pykeen.pickled``
runs pickled code.
"""

import hashlib
import pickle
import re
import warnings
import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from safetensors.torch import load_file

from isi.columns import TRIPLE
from isi.config import Option
from isi.errors import InputError, at, cut
from isi.insertion.arguments import array_of, checked_model, naming_argument
from isi.live.bundle import (
    Bundle,
    Manifest,
    check_numbers,
    checked_names,
    split_rows,
    stored_loss,
    triple_ids,
)
from isi.live.loaded import LoadedEmbedding
from isi.models.losses import Loss, TrainingLoss
from isi.models.model import MODELS
from isi.models.stack import margin_of
from isi.names import plain
from isi.sources.triples import read_id_names, read_ids

#: PyKEEN's folder, OpenKE's files, plain files; the first of each form, if it exists, identifies
#: the form.
PYKEEN, ENTITY2ID, RELATION2ID, TRAIN2ID = (
    "training_triples",
    "entity2id.txt",
    "relation2id.txt",
    "train2id.txt",
)
ENTITY_NAMES, RELATION_NAMES, TRIPLES = "entities.txt", "relations.txt", "triples.tsv"
#: PyKEEN's tables of names and of triples.
OF_TRIPLES = ("entity_to_id", "relation_to_id", "numeric_triples")
OF_NAMES: dict[str, type] = {"id": np.int64, "label": str}  #: Columns of a table of names.
#: The files that identify PyTorch-BigGraph's folder and dicee's (``isi.live.checkpoints``).
VERSION, CONFIGURATION = "checkpoint_version.txt", "configuration.json"
PICKLE = "trained_model.pkl"  #: PyKEEN's file of a pickled model.
#: Suffixes of tensor files.
FORMS = (".npy", ".npz", ".safetensors", ".pt", ".pth", ".ckpt")
#: End of PyKEEN's tensor names. In rows of these tensors, real and imaginary parts of complex
#: numbers alternate.
OF_PYKEEN = "_representations.0._embeddings.weight"
SLOTS = ("entities", "relations")  #: The two tables; a tensor of such a name is that table.
#: PyKEEN's name of the table of each slot.
PYKEEN_NAMES = {"entities": f"entity{OF_PYKEEN}", "relations": f"relation{OF_PYKEEN}"}
#: Keys of an optimizer's state, in lower case.
OPTIMIZER = re.compile(r"opt(im(izers?)?)?(_|$)")
LISTED = 8  #: Maximum number of tensors that a message names.
OTHERS = "for other models, use isi.pykeen.insert"


@dataclass(frozen=True, eq=False)
class Labels:
    """Names of an embedding's rows, and its known triples."""

    form: str  #: of the folder: PyKEEN, entity2id (OpenKE), arrays (plain files)
    entities: list[str]
    relations: list[str]
    triples: np.ndarray  #: ids; shape: (T, 3), int64
    kinds: list[str] = field(default_factory=list)  #: of the entities; empty if unknown


def of_tables(
    labels: Labels,
    model: str,
    options: Mapping[str, Option],
    tables: Sequence[np.ndarray],
    files: Sequence[Path],
    loss: Loss | TrainingLoss | None = None,
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
    loss: Loss | TrainingLoss | None = None,
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
        raise InputError(files[0], "relations", f"{expected}: {OTHERS}")
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
    kinds = labels.kinds or [""] * len(entities)
    phrases = [plain(name) for name in labels.entities]
    bundle = LoadedEmbedding(
        manifest, entities, relations, names[0], kinds, phrases, names[1], triples
    )
    with at(files[0]):
        bundle.embedding  # noqa: B018  # checks the width of relations
    return bundle


def tensors_in(folder: Path, form: str) -> list[Path]:
    """The tensor files in a folder; ``InputError`` if there are none."""
    others = ("results.json", "metadata.json") if form == "PyKEEN" else ()
    files = sorted(
        path for path in folder.iterdir() if path.suffix in FORMS and path.name not in others
    )
    if not files:
        pickled = (
            f" ({PICKLE} is a pickle, which is read with --trust-pickle alone)"
            * (folder / PICKLE).exists()
        )
        raise InputError(
            folder,
            "",
            f"expected a file of tensors{pickled}: {', '.join(FORMS)}, or --tensors FILE",
        )
    return files


def read_tensors(path: Path) -> dict[str, np.ndarray]:
    """The tensors of a file by name (``.npy``: the file's name; in a checkpoint, keys joined by
    dots); ``InputError`` refuses pickled code.
    """
    if path.suffix not in FORMS or not path.is_file():
        raise InputError(
            path,
            "",
            f"expected an existing file of tensors, with a suffix among {', '.join(FORMS)}",
        )
    try:
        if path.suffix == ".npy":
            return {path.stem: np.load(path, allow_pickle=False)}
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                return dict(arrays)
        state = load_file(path) if path.suffix == ".safetensors" else _state_dict(path)
        return {name: array_of(value) for name, value in _nested(state)}
    except Exception as error:  # a broken file makes NumPy and PyTorch raise many types
        message = cut(" ".join(str(error).split()), 120) or type(error).__name__
        raise InputError(path, "", f"expected tensors by name ({message})") from error


def _state_dict(path: Path) -> Mapping[str, Any]:
    """Read a PyTorch state dict without running pickled code."""
    try:
        with warnings.catch_warnings(action="ignore"):
            state: Any = torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError) as error:
        raise ValueError(
            "as torch.save(model.state_dict(), FILE) writes them; other pickles are not read"
        ) from error
    if not isinstance(state, Mapping):
        raise ValueError(f"a state dict, got {type(state).__name__}")
    return state


def _nested(state: Mapping[Any, Any], prefix: str = "") -> Iterator[tuple[str, torch.Tensor]]:
    """Names and tensors in mappings and lists, but not those of an optimizer, which has tensors of
    the same shapes.
    """
    for key, value in state.items():
        name = f"{prefix}{key}"
        if isinstance(value, torch.Tensor):
            yield name, value
        elif isinstance(value, Mapping | list | tuple) and not OPTIMIZER.match(str(key).lower()):
            inner = value if isinstance(value, Mapping) else dict(enumerate(value))
            yield from _nested(inner, f"{name}.")


@dataclass(frozen=True, eq=False)
class FileTensor:
    """A tensor of a file."""

    file: Path
    name: str
    values: np.ndarray

    def has_rows(self, number: int) -> bool:
        """Whether it is a table of floats with this number of rows."""
        is_table = self.values.ndim == 2 and self.values.dtype.kind in "fc"
        return is_table and len(self.values) == number

    def __str__(self) -> str:
        return f"{self.name} ({' x '.join(map(str, self.values.shape))})"


def read_tables(
    files: Sequence[Path], model: str, labels: Labels, names: Mapping[str, str | None]
) -> list[np.ndarray]:
    """The tables of entities and of relations in files: the tensors of these ``names`` by slot;
    without one, that which is named as its slot, else the one table with a row for each label.

    InputError unless there is one of each in all files.
    """
    tensors = [
        FileTensor(file, name, values)
        for file in files
        for name, values in read_tensors(file).items()
    ]
    tables = []
    for slot, rows in zip(SLOTS, (len(labels.entities), len(labels.relations)), strict=True):
        with at(" ".join(map(str, files))):
            tensor = _chosen(tensors, slot, rows, names.get(slot))
        with at(tensor.file, tensor.name):
            of_pykeen = tensor.name.endswith(OF_PYKEEN)
            tables.append(table_of(tensor.values, slot, model, of_pykeen))
        tensors.remove(tensor)  # it would fit again where R equals E
    return tables


def _chosen(tensors: Sequence[FileTensor], slot: str, rows: int, name: str | None) -> FileTensor:
    """The tensor of a slot (``read_tables``)."""
    of_slot = (name,) if name else (slot, PYKEEN_NAMES[slot])
    fitting = [tensor for tensor in tensors if tensor.name in of_slot]
    if not name:
        # a model with inverse triples has twice as many relations, which is refused later
        for number in (rows, 2 * rows) if slot == "relations" else (rows,):
            fitting = fitting or [tensor for tensor in tensors if tensor.has_rows(number)]
    if len(fitting) == 1:
        return fitting[0]
    listed = ", ".join(map(str, (fitting or tensors)[:LISTED]))
    choice = f"--{slot} NAME" + " or --tensors FILE" * (len({each.file for each in fitting}) > 1)
    expected = f"expected one tensor {name or f'with a row for each of {rows} {slot}'}"
    raise InputError("", "", f"{expected}; choose with {choice}, got {listed or 'no tensor'}")


def table_of(values: np.ndarray, slot: str, model: str, of_pykeen: bool = False) -> np.ndarray:
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
    """Read names and known triples of a folder of PyKEEN, of OpenKE, or of plain files;
    no pickle is read.
    """
    rows: np.ndarray | Collection[Sequence[str]]
    if (folder / PYKEEN).is_dir():
        form, first = "PyKEEN", 2
        files = [folder / PYKEEN / f"{name}.tsv.gz" for name in OF_TRIPLES]
        tables = [read_columns(path, OF_NAMES, "\t", header=True) for path in files[:2]]
        names = list(map(names_by_id, tables, files))
        ids = read_columns(files[2], dict.fromkeys(TRIPLE, np.int64), "\t", header=True)
        rows = ids.to_numpy()
        check_ids(rows, len(names[0]), len(names[1]), files[2], first=2)
    elif (folder / ENTITY2ID).exists():
        form, first = "entity2id", 1
        files = [folder / name for name in (ENTITY2ID, RELATION2ID, TRAIN2ID)]
        names = [read_id_names(path) for path in files[:2]]
        rows = read_ids(folder, [TRAIN2ID]) if files[2].exists() else []
    elif (folder / ENTITY_NAMES).exists():
        form, first = "arrays", 1
        files = [folder / name for name in (ENTITY_NAMES, RELATION_NAMES, TRIPLES)]
        names = [[name for (name,) in rows_of(path, ["name"])] for path in files[:2]]
        rows = rows_of(files[2], TRIPLE) if files[2].exists() else []
    else:
        forms = (PYKEEN, ENTITY2ID, VERSION, CONFIGURATION)
        expected = f"expected a folder with {', '.join(forms)} or {ENTITY_NAMES}"
        raise InputError(folder, "", expected)
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


def check_ids(ids: np.ndarray, entities: int, relations: int, path: Path, first: int = 0) -> None:
    """``InputError`` for a triple of a file, (T, 3), with an id beyond the names; ``first``: the
    line of the first triple in a file of lines.
    """
    beyond = (ids < 0) | (ids >= [entities, relations, entities])
    for row in np.flatnonzero(beyond.any(1))[:1]:
        expected = f"expected ids of {entities} entities and {relations} relations"
        place = f"line {row + first}" if first else f"row {row}"
        raise InputError(path, place, f"{expected}, got {ids[row].tolist()}")


def read_columns(path: Path, kinds: Mapping[str, type], sep: str, header: bool) -> pd.DataFrame:
    """A table, perhaps compressed, of columns of these types; ``header``: the first line must have
    their names.
    """
    expected = f"expected a table of {', '.join(kinds)}"
    try:
        names = None if header else list(kinds)
        frame = pd.read_csv(
            path, sep=sep, names=names, header=0, dtype=kinds, keep_default_na=False
        )
    except (OSError, EOFError, zlib.error, ValueError, OverflowError) as error:
        raise InputError(path, "", f"{expected} ({cut(str(error), 120)})") from error
    if list(frame) != list(kinds) or not isinstance(frame.index, pd.RangeIndex):
        raise InputError(path, "line 1", expected)
    return frame.fillna("")
