"""Checkpoints of two trainers of large graphs, PyTorch-BigGraph and dicee: their folders say which
model they hold.

Sources of files and scores: ``checkpoint_storage.py``, ``operators.py`` and ``model.py`` in
``torchbiggraph/`` of facebookresearch/PyTorch-BigGraph; ``models/`` and
``read_preprocess_save_load_kg/save_load_disk.py`` in ``dicee/`` of dice-group/dice-embeddings.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import torch
from pydantic import BaseModel, Field, PositiveInt

from isi.config import Option, Positive
from isi.errors import InputError, at, cut, extra, short
from isi.insertion.inverses import both_ways
from isi.live.bundle import COLUMNS, TEXTS, TRIPLES, Bundle, checked_names, triple_ids
from isi.live.importer import (
    CONFIGURATION,
    OF_NAMES,
    VERSION,
    Labels,
    check_ids,
    names_by_id,
    of_tables,
    read_columns,
    read_tensors,
    rows_of,
    table_of,
)
from isi.models.losses import Loss

#: The model here that has the score of an operator and a comparator of PyTorch-BigGraph.
SCORES = {
    ("none", "dot"): "distmult",
    ("diagonal", "dot"): "distmult",
    ("complex_diagonal", "dot"): "complex",
    ("none", "l2"): "transe",
    ("none", "squared_l2"): "transe",
    ("translation", "l2"): "transe",
    ("translation", "squared_l2"): "transe",
}
LOSSES: dict[str, Loss] = {"ranking": "margin", "logistic": "logistic", "softmax": "softmax"}
#: An operator of dynamic relations maps the head of a triple, another one the tail.
SIDES = ("lhs", "rhs")
INVERSE = "_inverse"  #: End of the names of inverse relations, as in dicee.
#: The model here that has the score of one of dicee's; of Keci and CMult by their algebra Cl(p, q).
#: Keci(0, 1) is not ComplEx: a coefficient scales second halves of heads and relations alone.
OF_DICEE = {
    "DistMult": "distmult",
    "Keci(0, 0)": "distmult",
    "CMult(0, 0)": "distmult",
    "ComplEx": "complex",
    "CMult(0, 1)": "complex",
    "TransE": "transe",
}
DICEE_MARGIN = 4.0  #: of its TransE, a constant
DICEE_TENSORS = ["entity_embeddings.weight", "relation_embeddings.weight"]

Options = Mapping[str, Option]
Arrays = dict[str, np.ndarray]


class TypeConfig(BaseModel):
    """A type of entities in PyTorch-BigGraph's ``config.json``; featurized ones have no vectors."""

    num_partitions: PositiveInt
    featurized: Literal[False]


class OperatorConfig(BaseModel):
    """A relation, or all dynamic ones, in PyTorch-BigGraph's ``config.json``."""

    name: str
    operator: Literal["none", "diagonal", "complex_diagonal", "translation"]


class BigGraphConfig(BaseModel):
    """What determines files and scores in PyTorch-BigGraph's ``config.json``."""

    entities: Annotated[dict[str, TypeConfig], Field(min_length=1)]
    relations: Annotated[list[OperatorConfig], Field(min_length=1)]
    dimension: PositiveInt
    comparator: Literal["dot", "l2", "squared_l2"]
    bias: Literal[False]  #: Biases of entities; no model here has them.
    global_emb: bool  #: Whether each type of entities has a vector that is added to theirs.
    max_norm: Positive | None
    dynamic_relations: bool
    loss_fn: str


class DiceeConfig(BaseModel):
    """What determines score and loss in dicee's ``configuration.json``."""

    model: str
    p: int | None = None
    q: int | None = None
    loss_fn: str | None = None
    adversarial_temperature: float | None = None


def checkpoint_reader(folder: Path) -> Callable[[Path, Options, Loss | None], Bundle] | None:
    """The reader of a folder of one of these trainers; None for other folders."""
    readers = {VERSION: read_biggraph, CONFIGURATION: read_dicee}
    return next((reader for name, reader in readers.items() if (folder / name).exists()), None)


def read_biggraph(folder: Path, options: Options, loss: Loss | None) -> Bundle:
    """Read the last checkpoint in a folder that also has the names of PyTorch-BigGraph's
    preprocessing and, optionally, ``triples.tsv``.

    A score is c(x, g(y)) of comparator c and operator g. Dynamic relations have two operators, for
    c(g(x), y) and c(x, h(y)); h becomes that of an inverse relation. ``options`` and ``loss`` go
    before those of the folder. InputError: a file does not fit, or no model here has the score.
    """
    path = folder / "config.json"
    with at(path):
        config = BigGraphConfig.model_validate_json(path.read_bytes())
        model = _same_model(config)
    with at(folder / VERSION):
        version = (folder / VERSION).read_text(encoding="utf-8").strip()
        if not version.isdecimal() or not int(version):
            raise InputError("", "", f"expected the number of a checkpoint, got {short(version)}")
    files = [folder / f"model.v{version}.h5"]
    parameters = read_hdf5(files[0], "model")
    names, kinds, tables = list[str](), list[str](), list[np.ndarray]()
    for kind, settings in config.entities.items():
        for part in range(settings.num_partitions):
            listed = _names(folder / f"entity_names_{kind}_{part}.json")
            files.append(folder / f"embeddings_{kind}_{part}.v{version}.h5")
            rows = _part_rows(files[-1], len(listed), config)
            if config.global_emb:
                added = f"model/entities/{kind}/global_embedding"
                rows = rows + _array(files[0], parameters, added, rows.shape[1:])
            tables.append(rows)
            names += listed
            kinds += [kind] * len(listed)
    if config.dynamic_relations:
        relation_names = _names(folder / "dynamic_rel_names.json")
    else:
        relation_names = [relation.name for relation in config.relations]
    relations = _relation_rows(files[0], parameters, config, model, len(relation_names))
    triples = _named_triples(folder, names, relation_names)
    if config.dynamic_relations:
        relation_names = [name + end for name in relation_names for end in ("", INVERSE)]
        triples = both_ways(torch.from_numpy(triples)).numpy()
    trained_with = LOSSES.get(config.loss_fn)
    if model == "transe":
        options = {"squared": config.comparator == "squared_l2", **options}
        # log odds of a distance need a border, which is fitted
        trained_with = "margin" if trained_with == "logistic" else trained_with
    if len(config.entities) == 1:
        kinds = []
    labels = Labels("PyTorch-BigGraph", names, relation_names, triples, kinds)
    both = [np.concatenate(tables), relations]
    return of_tables(labels, model, options, both, files, loss or trained_with)


def _part_rows(path: Path, number: int, config: BigGraphConfig) -> np.ndarray:
    """The vectors of a part of the entities, as they are when they are looked up."""
    shape = (number, config.dimension)
    rows = _array(path, read_hdf5(path, "embeddings"), "embeddings", shape)
    if not config.max_norm:
        return rows
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    scaled: np.ndarray = rows * (config.max_norm / np.maximum(lengths, config.max_norm))
    return scaled


def read_hdf5(path: Path, name: str) -> Arrays:
    """The array ``name`` of an HDF5 file, or all arrays in the group ``name``, by full name."""
    with extra("hdf5"):
        import h5py  # here, since HDF5 files alone need it
    arrays = Arrays()

    def read(full_name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and f"{full_name}/".startswith(f"{name}/"):
            arrays[full_name] = item[...]

    try:
        with h5py.File(path, "r") as file:
            file.visititems(read)
    except Exception as error:  # a broken file makes HDF5 raise many types
        raise InputError(path, "", f"expected an HDF5 file ({cut(str(error), 120)})") from error
    return arrays


def _array(path: Path, arrays: Arrays, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """The array of a name; ``InputError`` if it is missing or has another shape."""
    if name not in arrays or arrays[name].shape != shape:
        got = arrays[name].shape if name in arrays else "none"
        raise InputError(path, name, f"expected an array of shape {shape}, got {got}")
    return arrays[name]


def _same_model(config: BigGraphConfig) -> str:
    """The model here that has the scores; ``InputError`` if none has."""
    models = set()
    for place, relation in enumerate(config.relations):
        score = (relation.operator, config.comparator)
        if score not in SCORES:
            known = ", ".join(" with ".join(pair) for pair in SCORES)
            raise InputError(
                "", f"relations.{place}.operator", f"expected {known}; got {' with '.join(score)}"
            )
        models.add(SCORES[score])
    if len(models) > 1:
        got = " and ".join(sorted(models))
        raise InputError("", "relations", f"expected operators of one model, got {got}")
    return models.pop()


def _names(path: Path) -> list[str]:
    with at(path):
        return TEXTS.validate_json(path.read_bytes())


def _relation_rows(
    path: Path, parameters: Arrays, config: BigGraphConfig, model: str, number: int
) -> np.ndarray:
    """The rows of relations, which map heads. Shape: (R, d), or (2R, d) with dynamic relations,
    each before its inverse.
    """
    if config.dynamic_relations:
        sides = [_operator_rows(path, parameters, config, 0, side, number) for side in SIDES]
        return np.stack(sides, 1).reshape(2 * number, -1)
    rows = np.concatenate(
        [_operator_rows(path, parameters, config, place, "rhs", 1) for place in range(number)]
    )
    # the trainer maps tails; to map heads with the same scores, a translation turns round, and a
    # factor is conjugated
    if model == "transe":
        return -rows
    if model == "complex":
        rows[:, config.dimension // 2 :] *= -1
    return rows


def _operator_rows(
    path: Path, parameters: Arrays, config: BigGraphConfig, place: int, side: str, number: int
) -> np.ndarray:
    """The parameters of an operator that maps one side, as rows, (number, d); ``number`` is 1
    unless relations are dynamic.
    """
    operator, is_dynamic = config.relations[place].operator, config.dynamic_relations
    if operator == "none":
        identity = 1.0 if config.comparator == "dot" else 0.0
        return np.full((number, config.dimension), identity, np.float32)
    names = [operator + "s" * is_dynamic]
    if operator == "complex_diagonal":
        names = ["real", "imag"]
    width = config.dimension // len(names)
    shape = (number, width) if is_dynamic else (width,)
    under = f"model/relations/{place}/operator/{side}"
    rows = [_array(path, parameters, f"{under}/{name}", shape) for name in names]
    return np.concatenate(rows, -1).reshape(number, -1)


def _named_triples(folder: Path, names: list[str], relation_names: list[str]) -> np.ndarray:
    path = folder / TRIPLES
    rows = rows_of(path, COLUMNS[TRIPLES]) if path.exists() else []
    entities = checked_names(folder / "entity_names_*.json", "entity", names, first=1)
    relations = checked_names(
        folder / "dynamic_rel_names.json", "relation", relation_names, first=1
    )
    return triple_ids(path, rows, entities, relations, first=1)


def read_dicee(folder: Path, options: Options, loss: Loss | None) -> Bundle:
    """Read the folder of an experiment of dicee; ``options`` and ``loss`` go before its own.

    InputError: a file does not fit, or no model here has the score. No code of pickles is run.
    """
    path = folder / CONFIGURATION
    with at(path):
        config = DiceeConfig.model_validate_json(path.read_bytes())
        name = config.model
        if name in ("Keci", "CMult"):
            name += f"({config.p or 0}, {config.q or 0})"
        if name not in OF_DICEE:
            raise InputError("", "model", f"expected {', '.join(OF_DICEE)}, got {short(name)}")
    entities = _names_by_id(folder / "entity_to_idx.csv")
    relations = _names_by_id(folder / "relation_to_idx.csv")
    triples = _id_triples(folder / "train_set.npy", len(entities), len(relations))
    labels = Labels("dicee", entities, relations, triples)
    model, file = OF_DICEE[name], folder / "model.pt"
    state = read_tensors(file)
    if sorted(state) != DICEE_TENSORS:
        got = ", ".join(sorted(state))[:100]
        raise InputError(file, "", f"expected {' and '.join(DICEE_TENSORS)} alone, got {got}")
    with at(file):
        tables = [table_of(state[slot], slot, model) for slot in DICEE_TENSORS]
    if model == "transe":
        options = {"margin": DICEE_MARGIN, "squared": False, **options}
    if config.loss_fn in (None, "BCELoss") and config.adversarial_temperature is None:
        loss = loss or "logistic"
    return of_tables(labels, model, options, tables, [file], loss)


def _names_by_id(path: Path) -> list[str]:
    """The names in a table of id and name, in order, as pandas and polars write it."""
    pickled, kind = path.with_suffix(".p"), path.stem.partition("_")[0]
    if pickled.exists() and not path.exists():
        write = f"pandas.DataFrame({{'{kind}': list(pickle.load(open('{pickled.name}', 'rb')))}})"
        because = "a pickle can run any program; only where you trust it, write"
        raise InputError(pickled, "", f"{because} {write}.to_csv('{path.name}')")
    names = names_by_id(read_columns(path, OF_NAMES, ",", header=False), path)
    checked_names(path, kind, names, first=2)
    return names


def _id_triples(path: Path, entities: int, relations: int) -> np.ndarray:
    """Known triples of ids, shape (T, 3), int64; none without a file."""
    if not path.exists():
        return np.empty((0, 3), np.int64)
    triples = read_tensors(path)[path.stem]
    if triples.ndim != 2 or triples.shape[1] != 3 or triples.dtype.kind not in "iu":
        got = f"{triples.dtype} of shape {triples.shape}"
        raise InputError(path, "", f"expected whole numbers of shape (any, 3), got {got}")
    ids = triples.astype(np.int64)
    check_ids(ids, entities, relations, path)
    return ids
