"""Families of embeddings, one module each, registered under the name of its file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from isi.base.params import Count, Name, Positive, Section, keywords
from isi.base.plugins import Plugins
from isi.embeddings.family import Family

F = TypeVar("F", bound=type[Family])

FAMILIES: Plugins[type[Family]] = Plugins(__name__)


class EmbeddingParams(Section):
    """Of what family embeddings are, and how their tables start."""

    family: Name
    dimension: Count
    init_range: Positive


def family(name: str) -> Callable[[F], F]:
    """Register a dataclass as the family of a name; its fields are its options."""

    def register(kind: F) -> F:
        FAMILIES.register(name, kind)
        return kind

    return register


def make(name: str, options: Mapping[str, Any], key: str) -> Family:
    """The family of a name, with its options.

    Raises:
        InputError: where there is none, or it does not take these options; ``key`` is where they stand.
    """
    kind = FAMILIES.get(name, key)
    return kind(**keywords(kind.__init__, options, key))
