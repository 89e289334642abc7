"""The interface of initializers, which give novel entities vectors before fine-tuning,
and their registry.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np
import torch
from numpy.random import Generator
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as checked_dataclass
from torch import Tensor

from isi.config import Name, Plugins, keywords
from isi.errors import InputError, at
from isi.initializers.scale import LOGISTIC, Scale
from isi.models.model import Model
from isi.models.stack import Embedding, check_finite
from isi.random import stream
from isi.tables import paths

FALLBACKS = (None, "es", "rs", "centroid")  #: Methods that replace an initializer for lack of data.
NONE, ES, RS, CENTROID = range(4)


class NoRelationMap(Exception):
    """The model is not invertible, so an insert triple has no α:
    no expected vector of its novel end.
    """


@dataclass(frozen=True)
class InitContext:
    """Input of an initializer, for M models and n novel entities each;
    it has no validation or test triple.
    """

    #: Θ⁰; rows of novel entities are zero, or those of the last round if they have triples with
    #: each other (``isi.insertion.engine``)
    theta0: Embedding
    known: Tensor  #: entities of D⁰; shape: (M, E), bool
    #: known entities with a training triple in D⁰: candidates for indicators; shape: (M, E), bool
    eligible: Tensor
    novel: Tensor  #: ids; shape: (M, n)
    #: word vectors, zero where there is none; shape: (E, v)
    words: Tensor = field(metadata={"shared": True})
    #: the kind of each entity; ids, -1 without one; shape: (E,)
    kinds: Tensor = field(metadata={"shared": True})
    #: the other end of each insert triple, known or of an earlier round, padded to I; (M, n, I)
    other: Tensor
    relation: Tensor  #: relation of each insert triple; shape: (M, n, I)
    novel_is_tail: Tensor  #: whether the triple's tail is the novel entity; shape: (M, n, I), bool
    observed: Tensor  #: true for an insert triple, false for padding; shape: (M, n, I), bool
    #: unique triples of the graph; ids, shape: (T, 3)
    triples: Tensor = field(metadata={"shared": True})
    trained: Tensor  #: training triples of D⁰; shape: (M, T), bool
    root: int  #: root seed of the random streams
    keys: Tensor  #: other keys of each model's random streams; shape: (M, K)
    #: whether indicators are of a novel entity's kind: in ``isi.insert``, not in the experiments
    by_kind: bool = False
    #: log odds of a triple, by its score
    scale: Scale = field(default=LOGISTIC, metadata={"shared": True})
    #: a further key for each novel entity, which then draws from a stream of its own; None: all
    #: novel entities of a model draw from one; shape: (M, n)
    entity_keys: Tensor | None = None
    #: vectors of the round before, near which an optimum lies; shape: (M, n, d); None: first round
    start: Tensor | None = None
    #: how far each insert triple is believed, from 0 to 1; (M, n, I), float64; None: fully
    confidence: Tensor | None = None
    #: whether queries ask for tails alone, as with inverse relations
    tails_only: bool = False
    #: number of the last relations whose rows are new, and may move with the vectors
    new_relations: int = 0
    #: triples of new relations between known entities; ids, (B, 3)
    further: Tensor | None = field(default=None, metadata={"shared": True})

    @property
    def weight(self) -> Tensor:
        """How much each insert triple counts: its confidence, 0 for padding; (M, n, I), float64."""
        observed = self.observed.double()
        return observed if self.confidence is None else observed * self.confidence

    @property
    def worded(self) -> Tensor:
        """Mask of the entities with a word vector; shape (E,), bool."""
        return (self.words != 0).any(-1)

    @property
    def candidates(self) -> Tensor:
        """Eligible entities that may be indicators of each novel one;
        shape (M, n, E), or (M, 1, E) if all may.
        """
        return self.of_kind(self.eligible)

    def of_kind(self, entities: Tensor) -> Tensor:
        """Those of a mask, (M, E), that have the kind of each novel entity, if ``by_kind``;
        shape as ``candidates``.

        All of them for a novel entity without a kind, or if no eligible entity has its kind.
        """
        if not self.by_kind:
            return entities[:, None]
        kind = self.kinds[self.novel][..., None]
        alike = (self.kinds == kind) & (kind >= 0)
        alone = ~(alike & self.eligible[:, None]).any(-1, keepdim=True)
        return entities[:, None] & (alike | alone)

    def draw(
        self, purpose: str, distribution: Callable[[Generator, tuple[int, int]], np.ndarray]
    ) -> Tensor:
        """Random numbers, (M, n, d), from one stream per model and purpose,
        or per novel entity and purpose with ``entity_keys``.
        """
        (models, new), dimension = self.novel.shape, self.theta0.entity.shape[-1]
        numbers = np.empty((models, new, dimension))
        for model, key in enumerate(self.keys.tolist()):
            if self.entity_keys is None:
                rng = stream(self.root, purpose, *key)
                numbers[model] = distribution(rng, (new, dimension))
                continue
            for place, entity_key in enumerate(self.entity_keys[model].tolist()):
                rng = stream(self.root, purpose, *key, entity_key)
                numbers[model, place] = distribution(rng, (1, dimension))
        return torch.as_tensor(numbers, dtype=torch.float32)


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
    #: of its curves, ``#rrggbb``; None: the report chooses one
    colour: Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$")] | None = None
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


INITIALIZERS: Plugins[Registered] = Plugins("isi.initializers")


def initializer(
    name: str, *, label: str | None = None, **about: Any
) -> Callable[[Initializer], Initializer]:
    """Register a function whose parameters after the context are its options;
    ``about``: fields of ``Registered``, which ``InputError`` names where one is wrong.

    Example:
        >>> from isi.initializers.api import InitContext, InitResult, initializer, without_weights
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


def options_of(name: str, given: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Validated options of an initializer, as keyword arguments;
    ``InputError`` at the key if they do not fit.
    """
    return keywords(INITIALIZERS.get(name, key).function, given, key)
