"""What an initializer sees: the input of all initializers, and how it is made of a session."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.random import Generator
from torch import Tensor

from isi.graph.graph import Graph
from isi.graph.sessions import TRAIN, Session
from isi.initializers.scale import LOGISTIC, Scale
from isi.models.stack import Embedding
from isi.random import stream


@dataclass(frozen=True)
class NewRows:
    """What an initializer needs that trains all new rows of a call together, such as fold-in."""

    #: vectors from which training starts; shape: (M, n, d); None: the initializer computes them
    start: Tensor | None = None
    #: number of the last relations, whose rows are new and are trained, too
    relations: int = 0
    #: triples of new relations between known entities; ids, (B, 3); None: none
    triples: Tensor | None = field(default=None, metadata={"shared": True})
    #: whether facts ask for tails alone, since each stands there with its inverse relation, too
    tails_only: bool = False


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
    training: NewRows = NewRows()

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


def context_in_session(
    theta: Embedding,
    before: Session,
    novel: Tensor,
    insert_triples: Tensor,
    words: Tensor,
    root: int,
    keys: Tensor,
    triples: Tensor | None = None,
    confidence: Tensor | None = None,
) -> InitContext:
    """What an initializer sees of the novel entities, (M, n), of a stack of sessions.

    Args:
        theta: Θ of the session ``before``.
        insert_triples: place in the stack, place in ``novel`` and triple, (I, 3), sorted.
        words: word vectors, (E, v).
        root: seed of the random streams; ``keys``: of each model's streams, (M, K).
        triples: those that ``insert_triples`` name, (T, 3); None: the graph's.
        confidence: of these triples, (T,), float64; None: each is believed fully.
    """
    model, place, triple = insert_triples.T
    slot = model * novel.shape[1] + place
    number = torch.arange(len(slot)) - torch.searchsorted(slot, slot)  # within its entity
    longest = int(number.max()) + 1 if len(number) else 1
    head, relation, tail = (before.graph.triples if triples is None else triples)[triple].T
    is_tail = tail == novel[model, place]

    def padded(values: Tensor) -> Tensor:
        table = torch.zeros(*novel.shape, longest, dtype=values.dtype)
        table[model, place, number] = values
        return table

    return InitContext(
        theta0=theta,
        known=before.entities,
        eligible=before.trained(),
        novel=novel,
        words=words,
        kinds=before.graph.kinds,
        other=padded(torch.where(is_tail, head, tail)),
        relation=padded(relation),
        novel_is_tail=padded(is_tail),
        observed=padded(torch.ones_like(is_tail)),
        triples=before.graph.triples,
        trained=before.members(TRAIN),
        root=root,
        keys=keys,
        confidence=None if confidence is None else padded(confidence[triple]),
    )


def trained_session(
    triples: np.ndarray, theta: Embedding, kinds: np.ndarray | None = None
) -> Session:
    """A session of all entities of an embedding, with ``triples``, (T, 3),
    as training triples of count 1.
    """
    entities, relations = theta.entity.shape[1], theta.relation.shape[1]
    kind = torch.zeros(entities, dtype=torch.int64) if kinds is None else torch.from_numpy(kinds)
    counts = torch.ones(1, dtype=torch.int64).expand(len(triples))
    graph = Graph([""] * entities, [""] * relations, torch.from_numpy(triples), counts, kind)
    everyone = torch.ones(1, entities, dtype=torch.bool)
    return Session(graph, everyone, torch.full((1, len(triples)), TRAIN, dtype=torch.int8))
