"""Checks the arguments of ``isi.insert``. An ``InputError`` names the argument."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np

from isi.columns import TRIPLE, triple_columns
from isi.config import as_list, check, is_whole
from isi.errors import InputError, extra, short
from isi.tables import paths
from isi.vocabulary import Vocabulary, ids_by_name

if TYPE_CHECKING:  # what tells a fact of known entities needs neither
    import pandas as pd
    import torch

    from isi.models.model import Model

#: Embeds texts: a function from a list of texts to their vectors.
Embedder = Callable[[Sequence[str]], Any]


class ArrowTable(Protocol):
    """A table by Arrow's C stream: pyarrow's, DuckDB's, polars' and others."""

    def __arrow_c_stream__(self, requested_schema: object = None) -> object: ...


#: Triples in the forms that ``listed_triples`` describes.
TripleForms: TypeAlias = (
    "Sequence[Sequence[str | int]] | np.ndarray | torch.Tensor | pd.DataFrame | ArrowTable"
    " | Mapping[str, Mapping[str, Any]]"
)


@contextmanager
def naming_argument(name: str) -> Iterator[None]:
    """Name the argument in an ``InputError`` raised inside that names no other file than
    ``params.yaml``. One of a subclass stays as it is.

    Example:
        >>> from isi.errors import InputError
        >>> from isi.insertion.arguments import naming_argument
        >>> with naming_argument("new"):
        ...     raise InputError("", "", "expected at least one entity")
        Traceback (most recent call last):
        isi.errors.InputError: argument 'new': expected at least one entity
    """
    try:
        yield
    except InputError as error:
        if error.file not in ("", str(paths.PARAMS)) or type(error) is not InputError:
            raise
        raise InputError(
            f"argument {name!r}", re.sub(rf"^{name}s?(\.|$)", "", error.place), error.message
        ) from error


def options_by_name(values: Any, name: str) -> dict[str, Any]:
    """An argument that maps names to options, as a dict; empty for None."""
    return dict(
        check({} if values is None else values, Mapping[str, Any], "", f"argument {name!r}")  # type: ignore[type-abstract]
    )


def is_tensor(values: Any) -> bool:
    """Whether values are a tensor, without an import of PyTorch."""
    return hasattr(values, "detach")


def array_of(tensor: torch.Tensor) -> np.ndarray:
    """A tensor of any device, with or without gradient, as an array;
    types that NumPy lacks (bfloat16) as float32.
    """
    try:
        return tensor.numpy(force=True)
    except TypeError:
        import torch

        return tensor.to(torch.complex64 if tensor.is_complex() else torch.float32).numpy(
            force=True
        )


def table(
    values: Any, name: str, width: int | None = None, dtype: type[np.floating[Any]] | None = None
) -> np.ndarray:
    """An argument as an array, (rows, width), of finite floats;
    ``InputError`` names the argument and the row.
    """
    with naming_argument(name), np.errstate(over="ignore", invalid="ignore"):
        try:
            rows = array_of(values) if is_tensor(values) else values
            numbers = np.asarray(rows, dtype)
        # RuntimeError: by a tensor within
        except (TypeError, ValueError, RuntimeError, OverflowError) as error:
            raise InputError(
                "", "", f"expected a table of floats (rows, numbers) ({error})"
            ) from error
        if np.iscomplexobj(numbers):
            expected = (
                "expected real numbers: of complex vectors, the real half, then the imaginary half"
            )
            raise InputError("", "", expected)
        if numbers.ndim != 2 or numbers.dtype.kind != "f" or not numbers.size:
            got = f"{numbers.dtype} {numbers.shape}"
            raise InputError("", "", f"expected a table of floats (rows, numbers), got {got}")
        if width is not None and numbers.shape[1] != width:
            expected = f"expected rows of {width} numbers, got rows of {numbers.shape[1]}"
            raise InputError("", "", expected)
        if not np.isfinite(numbers.sum()) and not (sound := np.isfinite(numbers).all(1)).all():
            row = f"row {int(np.argmin(sound))}"
            raise InputError("", row, "expected finite numbers, got NaN or infinity")
    return numbers


def checked_model(model: Any, options: Any, dimension: int) -> Model:
    """A given ``Model`` (options ignored), or one made by name;
    InputError for a wrong name, option or dimension.
    """
    from isi.models.model import Model, make_model

    by_name = options_by_name(options, "model_options")
    with naming_argument("model"):
        if not isinstance(model, str | Model):
            expected = f"expected the name of a model, or a model, got {short(model)}"
            raise InputError("", "", expected)
        checked = model if isinstance(model, Model) else make_model(model, by_name, "model")
        checked.width(dimension)
    return checked


def listed_triples(triples: Any) -> np.ndarray | list[Any]:
    """Triples in any accepted form as an array, (T, 3), or a list.
    The triples themselves are not checked.

    Forms: a list, an array, a tensor, a DataFrame or an Arrow table (columns by name,
    ``triple_columns``; those of a DataFrame without names in order; None is missing), or the
    tails of each head and relation, ``{"smart pill": {"isa": ["medical_device"]}}``, where a single
    tail needs no list.
    """
    triples = of_arrow(triples)
    if isinstance(triples, Mapping):
        rows = []
        for head, facts in triples.items():
            if not isinstance(facts, Mapping):
                expected = f"expected tails by relation, got {short(facts)}"
                raise InputError("", f"{head!r:.80}", expected)
            for relation, tails in facts.items():
                is_single = isinstance(tails, str) or is_whole(tails)
                for tail in [tails] if is_single else as_list(tails):
                    rows.append((head, relation, tail))
        return rows
    if hasattr(triples, "isna"):
        if names := column_names(triples):
            triples = triples[[names[column] for column in triple_columns(names)]]
        if (missing := triples.isna()).any(axis=None):
            triples = triples.astype(object).where(~missing, None)  # for NaN, NaT and NA
        triples = triples.to_numpy()
    elif is_tensor(triples):
        triples = array_of(triples)
    elif isinstance(triples, np.ndarray) and triples.dtype.names:
        raise InputError("", "", "expected rows of triples: pandas.DataFrame(array) makes a table")
    return triples if isinstance(triples, np.ndarray) and triples.ndim else as_list(triples)


def named_triples(triples: Any) -> np.ndarray:
    """Triples of names in any accepted form as an array, (T, 3), object; a whole number is the name
    of its digits. InputError names the triple.
    """
    rows = []
    for row, triple in enumerate(listed_triples(triples)):
        check_triple(triple, row)
        for slot, name in zip(TRIPLE, triple, strict=True):
            if not is_whole(name) and not (isinstance(name, str) and name.strip()):
                raise InputError("", f"triple {row}: {slot}", f"expected a name, got {short(name)}")
        rows.append([str(name) for name in triple])
    return np.array(rows, object).reshape(-1, len(TRIPLE))


def of_arrow(triples: Any) -> Any:
    """An Arrow table as a DataFrame; other forms as they are."""
    if not hasattr(triples, "__arrow_c_stream__") or hasattr(triples, "isna"):
        return triples
    with extra("pipeline"):
        import pandas as pd
        import pyarrow as pa

    # other types would turn whole numbers beside a missing one into floats
    return pa.table(triples).to_pandas(types_mapper=pd.ArrowDtype)


def column_names(triples: Any) -> list[str]:
    """The names of the columns of a DataFrame; empty for other forms, and for numbers."""
    names = list(getattr(triples, "columns", ()))
    return [] if all(map(is_whole, names)) else names


def ids_of(triples: Any, name: str, entities: Vocabulary, relations: Vocabulary) -> np.ndarray:
    """Triples as ids, in the given order; shape (T, 3), int64."""
    columns = (entities, relations, entities)
    with naming_argument(name):
        triples = listed_triples(triples)
        if (
            isinstance(triples, np.ndarray)
            and triples.dtype.kind in "iu"
            and triples.shape[1:] == (3,)
        ):
            ids = triples.astype(np.int64)
            limits = [rows.number for rows in columns]
            wrong = (ids < 0) | (ids >= limits)
            for slot, rows in enumerate(columns):
                if np.isin(ids[:, slot], list(rows.ambiguous)).any():
                    # an array of numbers holds ids, and what is no array is refused
                    note = f"argument {name!r}: its numbers count as ids, though names are numbers"
                    warnings.warn(f"{note}, too; write names to be sure", stacklevel=2)
            for row, slot in np.argwhere(wrong)[:1].tolist():
                columns[slot].id(triples[row, slot], f"triple {row}: {TRIPLE[slot]}")
        else:
            ids = _listed_ids(
                triples.tolist() if isinstance(triples, np.ndarray) else triples, columns
            )
    return ids


def triples_of(triples: Any, name: str, entities: Vocabulary, relations: Vocabulary) -> np.ndarray:
    """Triples as ids, without duplicates, in the given order; shape (T, 3), int64."""
    ids = ids_of(triples, name, entities, relations)
    head, relation, tail = ids.T
    # distinct modulo 2⁶⁴ while R · E² < 2⁶⁴
    key = (head * relations.number + relation) * entities.number + tail
    ordered = np.sort(key)  # faster than ``np.unique`` of all triples
    repeated = np.flatnonzero(np.isin(key, ordered[1:][ordered[1:] == ordered[:-1]]))
    return np.delete(ids, np.delete(repeated, np.unique(key[repeated], return_index=True)[1]), 0)


def _listed_ids(triples: list[Any], columns: Sequence[Vocabulary]) -> np.ndarray:
    """Triples of names or ids as ids, (T, 3), int64. Known names alone take a tenth of the time."""
    if {*map(type, triples)} <= {list, tuple} and {*map(len, triples)} == {3}:
        with suppress(KeyError, TypeError):  # an id, an unknown name, or what cannot be a name
            entities, relations, _ = columns
            return ids_by_name(triples, entities.ids, relations.ids)
    rows = []
    for row, triple in enumerate(triples):
        check_triple(triple, row)
        slots = zip(columns, triple, TRIPLE, strict=True)
        rows.append([names.id(value, f"triple {row}: {slot}") for names, value, slot in slots])
    return np.array(rows, dtype=np.int64).reshape(-1, 3)


def check_triple(triple: Any, row: int) -> None:
    """InputError, which names the row, for a value that has not three ordered parts."""
    is_sized = hasattr(triple, "__len__") and not isinstance(triple, str | bytes | Set | Mapping)
    if not is_sized or len(triple) != len(TRIPLE):
        expected = f"expected head, relation and tail, got {triple!r:.80}"
        raise InputError("", f"triple {row}", expected)


def kinds_of(kinds: Any, entities: Vocabulary) -> np.ndarray | None:
    """The kind of each entity as a number, (E,), int64; -1 without a kind.
    None if ``kinds`` is None.
    """
    if kinds is None:
        return None
    with naming_argument("kinds"):
        if isinstance(kinds, Mapping):
            kind_of = {entities.id(name, ""): kind for name, kind in kinds.items()}
            kinds = [kind_of.get(row, "") for row in range(entities.number)]
        numbers = isinstance(kinds, np.ndarray) and kinds.dtype.kind == "i"
        if not numbers:
            every = as_list(kinds, object, "a list of kinds")
            kinds = ["" if kind is None else str(kind) for kind in every]
        labels = np.array(kinds)
        if len(labels) != entities.number:
            expected = (
                f"expected {entities.number} kinds, one for each entity (new ones too), "
                f"got {len(labels)}"
            )
            raise InputError("", "", expected)
    missing = labels < 0 if numbers else labels == ""
    return np.where(missing, -1, np.unique(labels, return_inverse=True)[1])


def word_table(words: Any, embedder: Embedder | None, entities: Vocabulary) -> np.ndarray | None:
    """Word vectors, (E, v), float32: a table, or vectors or texts by entity (missing: zero);
    None without words.
    """
    if words is None or (isinstance(words, Mapping) and not words):
        return None
    if not isinstance(words, Mapping):
        with np.errstate(over="ignore"):
            rows = table(table(words, "words").astype(np.float32), "words")
        if len(rows) != entities.number:
            expected = (
                f"expected {entities.number} rows, one for each entity (new ones too), "
                f"got {len(rows)}"
            )
            raise InputError("argument 'words'", "", expected)
        return rows
    with naming_argument("words"):
        by_id = {entities.id(name, ""): value for name, value in words.items()}
        texts = {row: value for row, value in by_id.items() if isinstance(value, str)}
        if texts:
            by_id |= dict(zip(texts, _vectors_of(list(texts.values()), embedder), strict=True))
        width, vectors = None, list[np.ndarray]()
        for row, value in by_id.items():
            try:
                vectors.append(table([value], "words", width, np.float32))
            except InputError as error:
                raise InputError("", f"{entities.of(row)!r:.80}", error.message) from error
            width = vectors[0].shape[1]
    rows = np.zeros((entities.number, vectors[0].shape[1]), dtype=np.float32)
    rows[list(by_id)] = np.concatenate(vectors)
    return rows


def _vectors_of(texts: Sequence[str], embedder: Any) -> np.ndarray:
    """The vectors of texts, (T, v), float32."""
    if embedder is None:
        expected = "expected vectors: texts need the argument 'embedder', which embeds them"
        raise InputError("", "", expected)
    if not callable(embedder):
        expected = f"expected a function from texts to vectors, got {short(embedder)}"
        raise InputError("argument 'embedder'", "", expected)
    vectors = table(embedder(list(texts)), "embedder", dtype=np.float32)
    if len(vectors) != len(texts):
        expected = f"expected {len(texts)} vectors, got {len(vectors)}"
        raise InputError("argument 'embedder'", "", expected)
    return vectors
