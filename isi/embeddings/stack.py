"""A stack of embeddings: the unit of training, ranking and insertion."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, TypeVar

import torch
from torch import Tensor

from isi.graph import Graph
from isi.streams import stream

T = TypeVar("T")


@dataclass(frozen=True)
class Embedding:
    """Vectors of entities and relations of M models."""

    #: shape: (M, E, d)
    entity: Tensor
    #: shape: (M, R, d)
    relation: Tensor


def select(stacked: T, models: Tensor) -> T:
    """The same value for some of its models only, by a mask or ids.

    Takes tensors, whose first dimension is the stack, and mappings and data classes of them. A graph,
    which the models share, stays whole.
    """
    value: Any = stacked
    if isinstance(value, Tensor):
        value = value[models]
    elif isinstance(value, dict):
        value = {key: select(part, models) for key, part in value.items()}
    elif is_dataclass(value) and not isinstance(value, Graph):
        value = replace(value, **{f.name: select(getattr(value, f.name), models) for f in fields(value)})  # type: ignore[type-var]
    return value  # type: ignore[no-any-return]


def uniform(entities: Tensor, relations: int, dimension: int, half_range: float, root: int, keys: Tensor) -> Embedding:
    """Tables uniform in ± half_range; entities that take no part are zero.

    Args:
        entities: which take part; shape (M, E), bool.
        keys: what each model's random stream depends on beside the root seed; shape (M, ...).
    """
    rows = entities.shape[1] + relations
    tables = []
    for key in keys.tolist():
        tables.append(stream(root, "embedding", *key).uniform(-half_range, half_range, (rows, dimension)))
    table = torch.stack([torch.as_tensor(t, dtype=torch.float32) for t in tables])
    return Embedding(table[:, :-relations] * entities[..., None], table[:, -relations:].contiguous())
