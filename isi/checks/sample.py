"""A small random graph with a stack of sessions, in which each model has its own new entities."""

import numpy as np
import torch

from isi.errors import InputError
from isi.graph.graph import HEAD, TAIL, Graph
from isi.graph.sessions import OUT, TEST, TRAIN, VALID, Session, touches
from isi.initializers.context import InitContext, context_in_session
from isi.models.model import Model
from isi.models.stack import uniform

ENTITIES, RELATIONS, TRIPLES, NOVEL, WORDS, KINDS = 40, 3, 150, 3, 6, 4
WORDLESS = 3  #: A known entity without a word vector.
OTHERS = np.delete(np.arange(ENTITIES), WORDLESS)  #: Those that may be new.
DIMENSIONS = range(12, 400, 4)  #: The first that a model can have is used.


def dimension_of(model: Model) -> int:
    """The length of the vectors of a sample; ``InputError`` if the model refuses all."""
    for dimension in DIMENSIONS:
        try:
            model.width(dimension)
        except InputError:
            continue
        return dimension
    raise InputError("", "", "expected a multiple of 4 from 12 to 396 to be a possible dimension")


def sample_graph() -> Graph:
    """A ring of all entities, with relations in turn, and random triples."""
    rng = np.random.default_rng(0)
    ring = [(e, e % RELATIONS, (e + 1) % ENTITIES) for e in range(ENTITIES)]
    others = rng.integers((ENTITIES, RELATIONS, ENTITIES), size=(TRIPLES - ENTITIES, 3))
    triples = np.unique(np.concatenate([ring, others]), axis=0)
    counts = torch.from_numpy(rng.integers(1, 4, len(triples)))
    kinds = torch.arange(ENTITIES) % KINDS
    names = [""] * ENTITIES, [""] * RELATIONS
    return Graph(*names, torch.from_numpy(triples), counts, kinds)


def sample_context(model: Model, models: int = 3) -> InitContext:
    """The input of initializers, with new entities of each model. All of these have words and
    insert triples; a known entity has no words.
    """
    rng, graph = np.random.default_rng(2), sample_graph()
    novel = torch.from_numpy(rng.permuted(np.tile(OTHERS, (models, 1)), axis=1)[:, :NOVEL].copy())
    drawn = rng.choice([TRAIN, VALID, TEST], (models, len(graph.triples)), p=[0.8, 0.1, 0.1])
    splits, known = torch.from_numpy(drawn), torch.ones(models, ENTITIES, dtype=torch.bool)
    known.scatter_(1, novel, False)
    ends = graph.triples[:, [HEAD, TAIL]]
    usable = (known[:, ends].sum(-1) == 1) & (splits == TRAIN)
    is_end = (novel[..., None, None] == ends).any(-1)
    before = Session(graph, known, splits.masked_fill(touches(graph, ~known), OUT))
    keys = torch.arange(2 * models).view(models, 2)
    words = torch.from_numpy(rng.standard_normal((ENTITIES, WORDS))).float()
    words[WORDLESS] = 0
    theta0 = uniform(known, RELATIONS, model, dimension_of(model), 1.0, 0, keys)
    insert_triples = (is_end & usable[:, None]).nonzero()
    return context_in_session(theta0, before, novel, insert_triples, words, 0, keys)
