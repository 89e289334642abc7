"""A stack of embeddings, scored by one model: the unit of training, ranking and insertion."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor

from isi.config import LARGEST
from isi.errors import InputError
from isi.models.model import Model
from isi.process import Shared
from isi.random import stream

T = TypeVar("T")

DENORMAL = 1e-40  #: A float32 below the smallest number of full precision.
MARGIN_TRIPLES = 1000  #: Maximum number of triples from which a margin is estimated.


@contextmanager
def _usual_numbers() -> Iterator[None]:
    """The process's default type and its precision of products, as usual."""
    with ExitStack() as settings:
        settings.callback(torch.set_default_dtype, torch.get_default_dtype())
        torch.set_default_dtype(torch.float32)
        products = getattr(torch.backends.mkldnn, "matmul", None)  # from PyTorch 2.9 on
        if products is not None:
            settings.callback(setattr, products, "fp32_precision", products.fp32_precision)
            products.fp32_precision = "ieee"
        yield


_of_process = Shared(_usual_numbers)


@contextmanager
def usual_torch() -> Iterator[None]:
    """Compute under PyTorch's usual settings, whatever those of the caller: float32 with products
    of full precision, on the CPU, no autocast, no inference mode, gradients where they are asked
    for. And with zero in place of denormal numbers, which are slow (dead coordinates have many).
    Then as before.

    The default type and the precision of products are the process's: they are the usual ones while
    any thread is inside, and the caller's again when the last one leaves.
    """
    with ExitStack() as settings:
        settings.enter_context(_of_process)
        if torch.get_default_device().type != "cpu":
            settings.enter_context(torch.device("cpu"))
        settings.enter_context(torch.autocast("cpu", enabled=False))
        settings.enter_context(torch.inference_mode(False))
        settings.enter_context(torch.enable_grad())
        are_flushed = not (torch.full((1,), DENORMAL) * 1).any()
        settings.callback(torch.set_flush_denormal, are_flushed)
        torch.set_flush_denormal(True)
        yield


@dataclass(frozen=True)
class Embedding:
    """Vectors of entities and relations of a stack of M embeddings,
    and the model that scores their triples.
    """

    entity: Tensor  #: shape: (M, E, d)
    relation: Tensor  #: shape: (M, R, w), with w = ``model.width(d)``
    model: Model = field(metadata={"shared": True})

    def score(self, head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
        """f(h, r, t) of triples (section 2); ids and result of shape (M, Q)."""
        return self.model.score(
            rows(self.entity, head), rows(self.relation, relation), rows(self.entity, tail)
        )

    def score_tails(self, head: Tensor, relation: Tensor) -> Tensor:
        """Scores of all entities as tail of (h, r, ?); ids of shape (M, Q), result (M, Q, E)."""
        return self.model.score_tails(
            rows(self.entity, head), rows(self.relation, relation), self.entity
        )

    def score_heads(self, relation: Tensor, tail: Tensor) -> Tensor:
        """Scores of all entities as head of (?, r, t); ids of shape (M, Q), result (M, Q, E)."""
        return self.model.score_heads(
            rows(self.entity, tail), rows(self.relation, relation), self.entity
        )

    def score_relations(self, head: Tensor, tail: Tensor) -> Tensor:
        """Scores of all relations of (h, ?, t); ids of shape (M, Q), result (M, Q, R)."""
        heads, tails = rows(self.entity, head), rows(self.entity, tail)
        return self.model.score(heads[:, :, None], self.relation[:, None], tails[:, :, None])


def rows(table: Tensor, ids: Tensor) -> Tensor:
    """Rows of each model's table; shapes (M, N, d) and (M, Q), result (M, Q, d)."""
    return table.gather(1, ids[..., None].expand(-1, -1, table.shape[-1]))


def select(stacked: T, models: Tensor) -> T:
    """Index the tensors, (M, ...), of a value (see ``mapped``) by a mask or ids of models;
    not in ``shared`` fields.
    """
    return mapped(stacked, lambda tensor: tensor[models], shared=False)


def mapped(value: T, function: Callable[[Tensor], Tensor], shared: bool = True) -> T:
    """Apply a function to tensors in nested data classes (``shared`` fields if ``shared``), dicts,
    lists and tuples.
    """
    result: Any = value
    if isinstance(result, Tensor):
        result = function(result)
    elif isinstance(result, dict):
        result = {key: mapped(part, function, shared) for key, part in result.items()}
    elif isinstance(result, list | tuple):
        result = type(result)(mapped(part, function, shared) for part in result)
    elif is_dataclass(result):
        names = [part.name for part in fields(result) if shared or not part.metadata.get("shared")]
        result = replace(
            result, **{name: mapped(getattr(result, name), function, shared) for name in names}
        )  # type: ignore[type-var]
    return result  # type: ignore[no-any-return]


def uniform(
    entities: Tensor,
    relations: int,
    model: Model,
    dimension: int,
    half_range: float,
    root: int,
    keys: Tensor,
) -> Embedding:
    """Uniform tables in ±``half_range`` (relations: ``Model.half_range``),
    zero outside ``entities``, (M, E).
    """
    bound, of_relations = half_range, model.half_range(half_range)
    shape, relation_shape = (entities.shape[1], dimension), (relations, model.width(dimension))
    streams = [stream(root, "embedding", *key) for key in keys.tolist()]
    # drawn before relations from each stream
    entity = np.stack([rng.uniform(-bound, bound, shape) for rng in streams])
    relation = np.stack(
        [rng.uniform(-of_relations, of_relations, relation_shape) for rng in streams]
    )
    vectors = torch.as_tensor(entity, dtype=torch.float32) * entities[..., None]
    return Embedding(vectors, torch.as_tensor(relation, dtype=torch.float32), model)


class NotFinite(InputError):
    """Some models of a stack have no finite result, for example because training diverged."""

    def __init__(self, models: list[int], message: str) -> None:
        super().__init__("", "", message)
        self.models = models  #: their places in the stack

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.models, self.message)


def check_finite(tables: tuple[Tensor, ...], name: str, largest: float = LARGEST) -> None:
    """Raise ``NotFinite`` with the models that have NaN or |x| > ``largest`` in one of the tables,
    each (M, ...).
    """
    # NaN is not
    sound = torch.stack([table.flatten(1).abs().amax(1) <= largest for table in tables]).all(0)
    if not sound.all():
        raise NotFinite((~sound).nonzero()[:, 0].tolist(), f"NaN or huge numbers in {name}")


def margin_of(embedding: Embedding, triples: Tensor, margin: float | None) -> float:
    """The given margin; None: −(mean score of triples, (T, 3), + mean of corrupted ones) / 2;
    0 if linear or T = 0.
    """
    if margin is not None or embedding.model.linear or not len(triples):
        return margin or 0.0
    head, relation, tail = triples[:: -(-len(triples) // MARGIN_TRIPLES)].T[:, None]
    with torch.no_grad():
        right = embedding.score(head, relation, tail).mean()
        other_heads = embedding.score(head.roll(1, 1), relation, tail).mean()
        other_tails = embedding.score(head, relation, tail.roll(1, 1)).mean()
    return -(right / 2 + (other_heads + other_tails) / 4).item()
