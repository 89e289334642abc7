"""Vectors of known entities that the workers of a Dask cluster read, each a part of the rows,
for ``insert_rows``.

Initializers use a large table of entities in three ways: rows by id, lengths of all rows, and
products with it from the left. Each worker calls the same function of PyTorch for its part; results
are joined, or added where rows are summed. So the client holds a few numbers per known entity and
new entity, and the table only if it is small (``WHOLE``).
"""

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import accumulate, cycle, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor
from torch.linalg import vector_norm
from torch.nn.functional import embedding, linear

from isi.errors import InputError, at, extra, short
from isi.initializers.similarity import WHOLE
from isi.insertion.arguments import argument, as_list, table

if TYPE_CHECKING:
    from distributed import Client


@dataclass(frozen=True)
class Part:
    """Rows ``first`` to ``last`` - 1 of a file,
    and the address of the worker that reads them while it is there.
    """

    file: Path
    first: int
    last: int
    worker: str


@dataclass(frozen=True)
class EntityParts:
    """A table of known entities in parts on workers, in place of a tensor of shape (1, E, d)."""

    client: "Client"
    parts: Sequence[Part]
    dimension: int
    dtype = torch.float32

    @property
    def numbers(self) -> list[int]:
        """The number of rows of each part."""
        return [part.last - part.first for part in self.parts]

    @property
    def shape(self) -> torch.Size:
        return torch.Size((1, sum(self.numbers), self.dimension))

    @cached_property
    def lengths(self) -> Tensor:
        """The length of each row; shape (1, E)."""
        return torch.cat(self.on_each(partial(vector_norm, dim=-1)))[None]

    @property
    def mT(self) -> "Transposed":
        return Transposed(self)

    def __getitem__(self, index: tuple[Tensor, Tensor]) -> Tensor:
        """Rows by models, all 0, and ids, of shape (...) if broadcast; shape (..., d)."""
        ids, place = torch.unique(index[1], return_inverse=True)
        starts = list(accumulate(self.numbers, initial=0))
        ends = torch.searchsorted(ids, torch.tensor(starts))
        wanted = [ids[a:b] - start for (a, b), start in zip(pairwise(ends), starts, strict=False)]
        return torch.cat(self.on_each(embedding, wanted))[place + index[0]]

    def gather(self, _: int, index: Tensor) -> Tensor:
        """``torch.gather`` along dimension 1 of rows, whose ids ``index``, (1, Q, d), repeats."""
        return self[torch.zeros(1, 1, dtype=index.dtype), index[..., 0]]

    @classmethod
    def __torch_function__(
        cls,
        function: Callable[..., Any],
        _: Any,
        given: tuple[Any, ...] = (),
        options: dict[str, Any] | None = None,
    ) -> Any:
        """What PyTorch calls in place of its function of such a table."""
        parts, options = (
            next((value for value in given if isinstance(value, cls)), None),
            options or {},
        )
        match function, given:
            case _ if parts is None:  # it is in a list
                return NotImplemented
            case Tensor.matmul, (left, cls()):
                return sum(parts.on_each(torch.matmul, left.split(parts.numbers, -1)))
            case torch.linalg.vector_norm, _ if options == {"dim": -1}:
                return parts.lengths
        return function(
            *(parts._whole() if value is parts else value for value in given), **options
        )

    def __getattr__(self, name: str) -> Any:
        """What a tensor has and this class lacks."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._whole(), name)

    def _whole(self) -> Tensor:
        """The vectors of few entities, on the client; ``InputError`` where there are more."""
        entities = self.shape[1]
        if entities**2 > WHOLE:
            expected = (
                "expected one that needs rows, lengths and products of known vectors alone, "
                "such as map"
            )
            raise InputError("", "", f"{expected}, since the {entities:,} vectors are on workers")
        return self[torch.zeros(1, 1, dtype=torch.int64), torch.arange(entities)[None]]

    def on_each(
        self, function: Callable[..., Tensor], values: Iterable[Tensor] = ()
    ) -> list[Tensor]:
        """The function's results for a value of each part, if any, and the part's rows,
        on its worker or another.
        """
        arrays = [[value.numpy()] for value in values] or [[]] * len(self.parts)
        # of Dask: large arrays
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            futures = [
                self.client.submit(
                    of_rows,
                    function,
                    part,
                    *given,
                    workers=[part.worker],
                    allow_other_workers=True,
                    pure=False,
                )
                for part, given in zip(self.parts, arrays, strict=True)
            ]
        return list(map(torch.from_numpy, self.client.gather(futures)))


@dataclass(frozen=True)
class Transposed:
    """A table of shape (1, d, E), for products alone."""

    entities: EntityParts

    def __rmatmul__(self, left: Tensor) -> Tensor:
        return torch.cat(self.entities.on_each(linear, [left] * len(self.entities.parts)), -1)


def on_workers(client: "Client", files: Sequence[str | Path]) -> EntityParts:
    """Vectors of known entities for ``insert_rows``,
    of which each worker of a Dask cluster reads a part.

    Args:
        client: of a cluster whose workers have this package.
        files: tables of floats, (rows, d), in NumPy's format ``.npy``, in the order of ids. Every
            worker can open them. If there are fewer files than workers, each file is split into
            ranges of rows.

    Raises:
        InputError: names the argument or file, and the expected value.
    """
    with extra("cluster"):
        from distributed import Client
    if not isinstance(client, Client) or not (workers := sorted(client.nthreads())):
        expected = f"expected a distributed.Client of a cluster with workers, got {short(client)}"
        raise InputError("argument 'client'", "", expected)
    with argument("files"):
        paths = [Path(file).absolute() for file in as_list(files, str | Path, "a list of files")]
        if not paths:
            raise InputError("", "", "expected at least one file")
    shapes, next_worker, parts = (
        client.gather(client.map(shape_of, paths, pure=False)),
        cycle(workers),
        list[Part](),
    )
    width, share = shapes[0][1], -(-len(workers) // len(paths))
    for file, shape in zip(paths, shapes, strict=True):
        if shape[1] != width:
            raise InputError(
                file, "", f"expected rows of {width} numbers as in {paths[0].name}, got {shape[1]}"
            )
        ends = np.linspace(0, shape[0], min(share, shape[0]) + 1, dtype=int).tolist()
        parts += [
            Part(file, *rows, worker)
            for rows, worker in zip(pairwise(ends), next_worker, strict=False)
        ]
    entities = EntityParts(client, parts, width)
    if not (finite := entities.lengths.isfinite()[0]).all():
        expected = "expected finite numbers, got NaN, infinity or huge numbers"
        raise InputError("argument 'files'", f"row {finite.int().argmin()} of all", expected)
    return entities


def shape_of(file: Path) -> tuple[int, ...]:
    """The shape of a table; ``InputError`` if a file is no table of floats in NumPy's format."""
    with at(file):
        try:
            rows = np.lib.format.open_memmap(file, mode="r")
        except ValueError as error:
            raise InputError(
                "", "", f"expected a table of floats in NumPy's format ({error})"
            ) from error
        table(rows[:1] if rows.ndim else rows, "files")
    return rows.shape


def of_rows(function: Callable[..., Tensor], part: Part, *values: np.ndarray) -> np.ndarray:
    """A function of values and a part's vectors as float32."""
    rows = np.lib.format.open_memmap(part.file, mode="r")[part.first : part.last]
    # of torch: the arrays are not writable
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        arrays = map(torch.from_numpy, (*values, np.ascontiguousarray(rows, np.float32)))
        result: np.ndarray = function(*arrays).numpy()
    return result
