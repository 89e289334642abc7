"""``isi.insert``: vectors for new entities in an embedding that is trained, and stays as it is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch

from isi.config import Seed, check
from isi.errors import InputError
from isi.graph.graph import HEAD, TAIL
from isi.graph.sessions import OUT, TRAIN, Session
from isi.initializers.api import FALLBACKS, INITIALIZERS, InitResult, NoRelationMap, NovelEntities, context_of
from isi.insertion.arguments import (
    Arguments,
    Triple,
    all_names,
    argument,
    checked_arguments,
    graph_of,
    kinds_of,
    renamed,
    stack_of_one,
    table,
)
from isi.insertion.choose import Choice, Sizes, choose, most_together
from isi.insertion.result import Inserted
from isi.insertion.words import Source, word_table
from isi.models.model import Model
from isi.models.stack import NotFinite

#: Numbers in the table of weights that a result keeps, at most.
MOST_WEIGHTS = 2**24


@dataclass(frozen=True)
class InsertionTask:
    """An insertion: its arguments, checked."""

    #: whose table of entities has a row of zeros for each new one
    given: Arguments
    #: word vectors of known and new entities, zero where there is none; shape: (E + n, w)
    words: np.ndarray | None
    kinds: np.ndarray
    seed: int

    @cached_property
    def is_insert_triple(self) -> np.ndarray:
        """Which triples have one new end, and a known one; shape (T,), bool."""
        is_new: np.ndarray = self.given.triples[:, [HEAD, TAIL]] >= self.given.known
        one_end: np.ndarray = is_new[:, 0] ^ is_new[:, 1]
        return one_end

    @cached_property
    def insert_triples(self) -> np.ndarray:
        triples: np.ndarray = self.given.triples[self.is_insert_triple]
        return triples

    @cached_property
    def has_insert_triple(self) -> np.ndarray:
        """Which new entities are an end of an insert triple; shape (n,), bool."""
        is_end = np.zeros(len(self.given.entities), dtype=bool)
        is_end[self.insert_triples[:, [HEAD, TAIL]]] = True
        return is_end[self.given.known :]

    @cached_property
    def has_words(self) -> np.ndarray:
        """Which new entities have a word vector; shape (n,), bool."""
        nobody = np.zeros(len(self.has_insert_triple), dtype=bool)
        return nobody if self.words is None else nobody | self.words[self.given.known :].any(1)

    @property
    def words_serve(self) -> bool:
        """Whether a new entity and a known one have word vectors."""
        return self.words is not None and bool(self.words[: self.given.known].any() and self.has_words.any())

    def refused(self, entities: np.ndarray, expected: str) -> InputError:
        """A mistake that names the first of some new entities, a mask of shape (n,)."""
        name = self.given.names.of(self.given.known + int(np.argmax(entities)))
        return InputError(f"new entity {name!r:.80}", "", expected)


@renamed(family="model", family_options="model_options")
def insert(
    entities: np.ndarray, relations: np.ndarray, triples: Sequence[Triple] | np.ndarray, *, new: int | Sequence[str],
    model: str | Model, model_options: Mapping[str, Any] | None = None,
    entity_names: Sequence[str] | None = None, relation_names: Sequence[str] | None = None,
    known_triples: Sequence[Triple] | np.ndarray | None = None,
    words: Any = None, word_source: Source | None = None, kinds: Any = None,
    initializer: str | None = None, options: Mapping[str, Any] | None = None, seed: int = 0,
) -> Inserted:  # fmt: skip
    """Vectors for new entities, from what is known of them; the known entities stay as they are.

    Args:
        entities: vectors of the known entities, shape (E, d). Complex ones are real halves, then imaginary halves.
        relations: rows of the relations, shape (R, w).
        triples: of the new entities: head, relation, tail, by names or ids. Those with a known end are insert triples,
            which the initializer sees; those between two new ones are counted (``fit_new`` learns from them). New
            entities have the ids E, E + 1, ... in the order of ``new``.
        new: names of the new entities; or how many they are, where entities have no names.
        model: how a triple is scored: analogy, distmult, complex, transe, transe_l1 (the L1 norm) or rotate, or a
            ``Model`` of your own (with ``invertible = False`` where its ``transform`` and ``inverse`` are not known).
        model_options: ``margin`` and, but for ``transe_l1``, ``squared`` of distances.
        entity_names: of the known ones, as ``relation_names`` of relations.
        known_triples: of known entities: one that has none is no indicator; ``interference`` takes its queries here.
        words: word vectors of known and new entities, shape (E + n, w), zero where there is none; or, by name or id, a
            vector or a text.
        word_source: what makes vectors of texts: a function, gensim's ``KeyedVectors``, or a file of such.
        kinds: of known and new entities; or by name or id.
        initializer: its name; without one, the best for what is known (``choose.BEST``).
        options: of the initializer, in place of its defaults.
        seed: of random numbers.

    Returns:
        the enlarged tables, and a report of each new entity.

    Raises:
        InputError: naming the argument that is wrong, and what was expected.
    """
    check(seed, Seed, "", Path("argument 'seed'"))
    known = table(entities, "entities")
    names = all_names(len(known), entity_names, new)
    rows = np.concatenate([known, np.zeros((names.number - len(known), known.shape[1]), known.dtype)])
    given = checked_arguments(
        rows, relations, model, model_options, names, relation_names, len(known), triples, known_triples
    )
    task = InsertionTask(given, word_table(words, word_source, names), kinds_of(kinds, names), seed)
    bare = ~(task.has_insert_triple | (task.has_words & task.words_serve))
    if initializer is None and bare.any():
        expected = "expected a triple with a known entity, or a word vector, or an initializer that needs neither"
        raise task.refused(bare, expected)
    sizes = Sizes(len(rows), len(given.relations), rows.shape[1])
    choice = choose(initializer, options, sizes, len(task.insert_triples) > 0, task.words_serve, given.model)
    return _inserted(task, choice, most_together(choice.initializer, sizes, given.model.linear))


def _inserted(task: InsertionTask, choice: Choice, together: int) -> Inserted:
    given, name = task.given, choice.initializer
    try:
        results = list(_results(task, choice, together))
    except NoRelationMap as error:
        wordless = task.has_insert_triple & ~task.has_words
        raise task.refused(wordless, f"expected a word vector, which {name} goes by") from error
    with np.errstate(over="ignore"):
        given.entities[given.known :] = torch.cat([result.vectors[0] for result in results]).numpy()
    if not np.isfinite(given.entities[given.known :]).all():
        expected = f"expected smaller numbers: of these, {name} makes NaN or infinity"
        raise InputError("argument 'entities'", "", expected)
    weights = [result.weights[0, :, : given.known].float() for result in results if result.weights is not None]
    few = len(weights) == len(results) and len(task.has_words) * given.known <= MOST_WEIGHTS
    masks = [result.indicators[0] for result in results if result.indicators is not None]
    return Inserted(
        entities=given.entities, relations=given.relations, model=given.model,
        entity_names=given.names.names, relation_names=given.relation_names.names,
        new=list(range(given.known, len(given.entities))), insert_triples=task.insert_triples,
        between=given.triples[~task.is_insert_triple], known_triples=given.known_triples,
        initializer=name, options=choice.options, why=choice.why,
        fallback=[FALLBACKS[code] for result in results for code in result.fallback[0].tolist()],
        weights=torch.cat(weights).numpy() if few else None,
        indicators=[row.nonzero()[:, 0].tolist() for mask in masks for row in mask] if masks else None,
    )  # fmt: skip


def _results(task: InsertionTask, choice: Choice, together: int) -> Iterator[InitResult]:
    """What the initializer gives, for so many new entities at a time."""
    given, insert_triples = task.given, task.insert_triples
    theta0 = stack_of_one(given.entities, given.relations, given.model)
    graph = graph_of(np.concatenate([insert_triples, given.known_triples]), theta0, task.kinds)
    splits = torch.full((1, len(graph.triples)), TRAIN, dtype=torch.int8)
    splits[:, : len(insert_triples)] = OUT
    session = Session(graph, torch.arange(len(given.entities))[None] < given.known, splits)
    words = torch.zeros(len(given.entities), 1) if task.words is None else torch.from_numpy(task.words)
    place = torch.from_numpy(insert_triples[:, [HEAD, TAIL]].max(1)) - given.known  # new ids are the larger
    order = torch.argsort(place, stable=True)
    registered = INITIALIZERS.get(choice.initializer, "initializer")
    for part in torch.split(torch.arange(len(task.has_words)), together):
        rows = order[(place[order] >= part[0]) & (place[order] <= part[-1])]
        of_part = torch.stack([torch.zeros_like(rows), place[rows] - part[0], rows], 1)
        novel = NovelEntities(part[None] + given.known, of_part, words)
        context = context_of(theta0, session, novel, task.seed, part[None, :1])
        if not len(given.known_triples):  # which would say what has been trained
            context = replace(context, eligible=context.known)
        try:
            with argument("initializer"):
                yield registered.initialize(context, choice.options)
        except NotFinite as error:
            expected = f"expected known vectors that differ, whose covariance {choice.initializer} goes by"
            raise InputError("argument 'entities'", "", expected) from error
