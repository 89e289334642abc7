"""The interface of initializers, which give novel entities vectors before fine-tuning,
and their registry.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any, Literal

import torch
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass as checked_dataclass
from torch import Tensor

from isi.config import Name, Plugins, keywords
from isi.errors import InputError, at
from isi.initializers.context import InitContext
from isi.models.model import Model
from isi.models.stack import check_finite
from isi.tables import paths

FALLBACKS = (None, "es", "rs", "centroid")  #: Methods that replace an initializer for lack of data.
NONE, ES, RS, CENTROID = range(4)


class NoRelationMap(Exception):
    """The model is not invertible, so an insert triple has no α:
    no expected vector of its novel end.
    """


@dataclass(frozen=True)
class InitResult:
    """Vectors of novel entities as inserted."""

    vectors: Tensor  #: shape: (M, n, d)
    fallback: Tensor  #: index into ``FALLBACKS``; shape: (M, n)
    #: known entities' weights in the mean (MAP: prior mean), sum 1; (M, n, E)
    weights: Tensor | None = None
    #: whether each vector is the centroid of its indicators: entities of weight > 0
    is_centroid: bool = False
    #: rows of new relations, if they moved, too; shape: (M, q, w)
    relations: Tensor | None = None

    @property
    def indicators(self) -> Tensor | None:
        """Mask of the indicators, (M, n, E), if vectors are centroids, else None."""
        return self.weights > 0 if self.weights is not None and self.is_centroid else None


def without_weights(vectors: Tensor) -> InitResult:
    """The result of vectors, (M, n, d), that are not a mean of known
    vectors and needed no fallback.
    """
    return InitResult(vectors, torch.full(vectors.shape[:2], NONE))


Initializer = Callable[..., InitResult]  #: A function of an ``InitContext`` and its own options.
#: The paper's baselines; ISI; controls (ISI with one part left out or replaced, or random vectors);
#: baselines beyond the paper; a user's own.
Role = Literal["paper", "isi", "control", "baseline", "own"]
#: Required data or property of the model.
Need = Literal["words", "insert_triples", "inverse"]
#: Memory grows with the number of entities, or of their pairs; ``newton``: an optimum for each
#: novel entity; ``trained``: by steps of training.
Cost = Literal["entities", "pairs", "newton", "trained"]


@checked_dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Registered:
    """An initializer and its metadata for params, report and commands."""

    name: Name
    function: Initializer
    label: str  #: title in tables and figures
    role: Role = "own"
    #: one sentence; by default the first paragraph of the function's docstring
    description: str = ""
    #: options that a caller of ``isi.insert`` may omit
    defaults: Mapping[str, Any] = field(default_factory=dict)
    needs: tuple[Need, ...] = ()
    cost: Cost = "entities"
    #: the option that names the initializer from whose vectors this one starts; it then trains all
    #: new rows of a call together
    starts_from: str | None = None
    #: options that ``tools/choose_initializers`` compares
    grid: Mapping[str, Sequence[Any]] | None = None
    #: settings that ``isi.insert`` compares on hidden entities beside ``defaults``, of which each
    #: changes some options
    calibration: Sequence[Mapping[str, Any]] = ()

    def misses(self, model: Model) -> str | None:
        """The property that the initializer needs and the model lacks, in words, or None."""
        lacks = "inverse" in self.needs and not model.invertible
        return "the inverse of a relation" if lacks else None

    def check(self, model: Model) -> None:
        """InputError, with the initializers that fit the model,
        if the model lacks a property that this one needs.
        """
        if lacking := self.misses(model):
            others = [
                name
                for name in INITIALIZERS.names()
                if not INITIALIZERS.get(name, name).misses(model)
            ]
            message = f"{type(model).__name__} lacks {lacking}: expected one of {', '.join(others)}"
            raise InputError(paths.PARAMS, f"initializers.{self.name}", message)

    def initialize(self, context: InitContext, options: Mapping[str, Any]) -> InitResult:
        """The vectors of the novel entities (equation 8), under the model's constraint;
        ``InputError`` if the result is not as in ``InitResult``.
        """
        self.check(context.theta0.model)
        result: Any = self.function(context, **options)
        name, (models, new) = f"initializer {self.name!r}", context.novel.shape
        if not isinstance(result, InitResult):
            raise InputError(name, "", f"expected an InitResult, got {type(result).__name__}")
        width, entities = context.theta0.entity.shape[-1], context.known.shape[-1]
        shapes = {
            "vectors": (models, new, width),
            "fallback": (models, new),
            "weights": (models, new, entities),
        }
        for part, shape in shapes.items():
            tensor = getattr(result, part)
            got = tuple(tensor.shape) if isinstance(tensor, Tensor) else type(tensor).__name__
            if got != shape and not (part == "weights" and tensor is None):
                raise InputError(name, "", f"expected {part} of shape {shape}, got {got}")
        vectors = context.theta0.model.constrain(result.vectors.to(context.theta0.relation))
        check_finite((vectors,), f"the vectors of {name}", torch.finfo(vectors.dtype).max)
        return replace(result, vectors=vectors, fallback=result.fallback.long())


INITIALIZERS: Plugins[Registered] = Plugins("isi.initializers", attrgetter("function"))


def initializer(
    name: str, *, label: str | None = None, **about: Any
) -> Callable[[Initializer], Initializer]:
    """Register a function whose parameters after the context are its options;
    ``about``: fields of ``Registered``, which ``InputError`` names where one is wrong.

    Example:
        >>> from isi.initializers.api import InitResult, initializer, without_weights
        >>> from isi.initializers.context import InitContext
        >>> @initializer("origin", label="Origin")
        ... def origin(context: InitContext) -> InitResult:
        ...     models, new = context.novel.shape
        ...     return without_weights(context.theta0.entity.new_zeros(models, new, 2))
        >>> INITIALIZERS.get("origin").label
        'Origin'
    """

    def register(function: Initializer) -> Initializer:
        summary = (inspect.getdoc(function) or "").partition("\n\n")[0]
        described = {"description": summary.replace("\n", " "), **about}
        with at(f"initializer {name!r}"):
            registered = Registered(name=name, function=function, label=label or name, **described)
        INITIALIZERS.register(name, registered)
        return function

    return register


def options_of(name: str, options: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Validated options of an initializer, as keyword arguments;
    ``InputError`` at the key if they do not fit.
    """
    return keywords(INITIALIZERS.get(name, key).function, options, key)
