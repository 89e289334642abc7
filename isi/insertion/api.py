"""``isi.insert``: vectors for new entities in an embedding that is trained, and stays as it is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch

from isi.config import Seed, check
from isi.errors import InputError
from isi.graph.graph import HEAD, TAIL
from isi.graph.sessions import OUT, TRAIN, Session
from isi.initializers.api import FALLBACKS, INITIALIZERS, InitResult, NoRelationMap, NovelEntities, context_of
from isi.insertion.arguments import (
    Names,
    Triple,
    all_names,
    argument,
    family_of,
    graph_of,
    kinds_of,
    names_of,
    stack_of_one,
    table,
    triples_of,
)
from isi.insertion.choose import Choice, Sizes, at_once, choose
from isi.insertion.result import Inserted
from isi.insertion.words import Source, word_table
from isi.models.finite import NotFinite
from isi.models.model import Model
from isi.models.stack import Embedding

#: Numbers in the table of weights that is kept, at most.
MOST_WEIGHTS = 2**24


@dataclass(frozen=True)
class InsertionTask:
    """An insertion, checked."""

    #: known vectors, then zeros; shape: (E + n, d)
    entities: np.ndarray
    relations: np.ndarray
    family: Model
    names: Names
    relation_names: Names
    #: entities that are known
    known: int
    #: shapes: (T, 3), (K, 3)
    triples: np.ndarray
    known_triples: np.ndarray
    words: np.ndarray | None
    kinds: np.ndarray
    seed: int

    @cached_property
    def is_new(self) -> np.ndarray:
        """Of each triple, whether its head and its tail are new; shape (T, 2), bool."""
        found: np.ndarray = self.triples[:, [HEAD, TAIL]] >= self.known
        return found

    @cached_property
    def told(self) -> np.ndarray:
        """The triples that have one new end."""
        return self.triples[self.is_new.any(1) & ~self.is_new.all(1)]

    @cached_property
    def between(self) -> np.ndarray:
        """The triples between new entities."""
        return self.triples[self.is_new.all(1)]

    @cached_property
    def has_insert_triple(self) -> np.ndarray:
        """Which new entities are an end of an insert triple; shape (n,), bool."""
        served = np.zeros(len(self.entities), dtype=bool)
        served[self.told[:, [HEAD, TAIL]]] = True
        return served[self.known :]

    @cached_property
    def has_words(self) -> np.ndarray:
        """Which new entities have a word vector; shape (n,), bool."""
        has_words = np.zeros(len(self.entities) - self.known, dtype=bool)
        if self.words is not None:
            has_words |= self.words[self.known :].any(1)
        return has_words

    @property
    def words_serve(self) -> bool:
        """Whether a new entity and a known one have word vectors."""
        return self.words is not None and bool(self.words[: self.known].any() and self.has_words.any())

    @property
    def sizes(self) -> Sizes:
        return Sizes(len(self.entities), len(self.relations), self.entities.shape[1])


def insert(
    entities: np.ndarray, relations: np.ndarray, triples: Sequence[Triple] | np.ndarray, *, new: int | Sequence[str],
    family: str | Model, family_options: Mapping[str, Any] | None = None,
    entity_names: Sequence[str] | None = None, relation_names: Sequence[str] | None = None,
    known_triples: Sequence[Triple] | np.ndarray | None = None,
    words: Any = None, word_source: Source | None = None, kinds: Any = None,
    initializer: str | None = None, options: Mapping[str, Any] | None = None, seed: int = 0,
) -> Inserted:  # fmt: skip
    """Vectors for new entities, from what is told of them; nothing that is known changes.

    Args:
        entities: vectors of the known entities, shape (E, d). Complex ones are real halves, then imaginary halves.
        relations: rows of the relations, shape (R, w).
        triples: of the new entities: head, relation, tail, by names or ids. Those with a known end are told to the
            initializer; those between two new ones are counted (``fit_new`` learns from them). New entities have the
            ids E, E + 1, ... in the order of ``new``.
        new: names of the new entities; or how many they are, where entities have no names.
        family: how a triple is scored: a module of ``isi.families`` (analogy, distmult, complex, transe, rotate),
            ``transe_l1`` (the norm of city blocks), or a family of one's own (with ``invertible = False`` if its
            ``transform`` and ``inverse`` are not known).
        family_options: ``margin`` and, but for ``transe_l1``, ``squared`` of distances.
        entity_names: of the known ones, as ``relation_names`` of relations.
        known_triples: of known entities: who has none is no indicator, and ``interference`` asks about them.
        words: word vectors of known and new entities, shape (E + n, w), zero where there is none; or, by name or id, a
            vector or a text.
        word_source: what makes vectors of texts: a function, gensim's ``KeyedVectors``, or a file of such.
        kinds: of known and new entities; or by name or id.
        initializer: its name; the best that the knowledge at hand allows where there is none.
        options: of the initializer, in place of its usual ones.
        seed: of whatever is drawn at random.

    Returns:
        the enlarged tables, and what became of each new entity.

    Raises:
        InputError: naming the argument that is wrong, and what was expected.
    """
    with argument("seed"):
        check(seed, Seed, "seed")
    known = table(entities, "entities")
    kind = family_of(family, family_options, known)
    relation_table = table(relations, "relations", kind.width(known.shape[1]))
    names = all_names(len(known), entity_names, new)
    labels = names_of("relation_names", len(relation_table), relation_names)
    found = triples_of(triples, "triples", names, labels)
    before = triples_of(known_triples if known_triples is not None else [], "known_triples", names, labels)
    task = InsertionTask(
        np.concatenate([known, np.zeros((names.number - len(known), known.shape[1]), known.dtype)]),
        relation_table, kind, names, labels, len(known), found, before, word_table(words, word_source, names),
        kinds_of(kinds, names), seed,
    )  # fmt: skip
    _check(task, initializer)
    choice = choose(initializer, options, task.sizes, len(task.told) > 0, task.words_serve, task.family)
    return _inserted(task, choice)


def _check(task: InsertionTask, initializer: str | None) -> None:
    """Refuse triples without a new entity, and, where no initializer is named, entities of which nothing is known.

    Raises:
        InputError: naming the triple, or the entity.
    """
    old = np.flatnonzero(~task.is_new.any(1))
    if len(old):
        expected = "expected a new entity in it: triples of known ones are 'known_triples'"
        raise InputError(f"argument 'triples': {_novel_entities(task, task.triples[old[0]])}", "", expected)
    late = np.flatnonzero((task.known_triples[:, [HEAD, TAIL]] >= task.known).any(1))
    if len(late):
        place = f"argument 'known_triples': {_novel_entities(task, task.known_triples[late[0]])}"
        raise InputError(place, "", "expected known entities alone")
    bare = np.flatnonzero(~(task.has_insert_triple | (task.has_words & task.words_serve)))
    if len(bare) and initializer is None:
        name = task.names.of(task.known + int(bare[0]))
        expected = "expected a triple with a known entity, or a word vector, or an initializer that needs neither"
        raise InputError(f"new entity {name!r:.80}", "", expected)


def _novel_entities(task: InsertionTask, triple: np.ndarray) -> str:
    head, relation, tail = triple.tolist()
    return f"({task.names.of(head)}, {task.relation_names.of(relation)}, {task.names.of(tail)})"[:200]


def _inserted(task: InsertionTask, choice: Choice) -> Inserted:
    try:
        results = list(_results(task, choice))
    except NotFinite as error:
        expected = f"expected known vectors that differ, whose covariance {choice.initializer} goes by"
        raise InputError("argument 'entities'", "", expected) from error
    except NoRelationMap as error:
        wordless = np.flatnonzero(task.has_insert_triple & ~task.has_words)
        name = task.names.of(task.known + int(wordless[0]))
        raise InputError(
            f"new entity {name!r:.80}", "", f"expected a word vector, which {choice.initializer} goes by"
        ) from error
    vectors = torch.cat([result.vectors[0] for result in results]).numpy()
    with np.errstate(over="ignore"):
        task.entities[task.known :] = vectors
    if not np.isfinite(task.entities[task.known :]).all():
        expected = f"expected smaller numbers: of these, {choice.initializer} makes NaN or infinity"
        raise InputError("argument 'entities'", "", expected)
    weights = [result.weights[0, :, : task.known].float() for result in results if result.weights is not None]
    few = len(weights) == len(results) and len(vectors) * task.known <= MOST_WEIGHTS
    return Inserted(
        entities=task.entities, relations=task.relations, family=task.family,
        entity_names=task.names.given, relation_names=task.relation_names.given,
        new=list(range(task.known, len(task.entities))), told=task.told, between=task.between,
        known_triples=task.known_triples, initializer=choice.initializer, options=choice.options, why=choice.why,
        fallback=[FALLBACKS[code] for result in results for code in result.fallback[0].tolist()],
        weights=torch.cat(weights).numpy() if few else None, indicators=_indicators(results),
    )  # fmt: skip


def _indicators(results: Sequence[InitResult]) -> list[list[int]] | None:
    """Ids of the indicators of each new entity; null where the initializer takes no centroid."""
    masks = [result.indicators[0] for result in results if result.indicators is not None]
    return [row.nonzero()[:, 0].tolist() for mask in masks for row in mask] if len(masks) == len(results) else None


def _results(task: InsertionTask, choice: Choice) -> Iterator[InitResult]:
    """What the initializer gives, for as many new entities at once as fit into memory."""
    theta0, number = stack_of_one(task.entities, task.relations, task.family), len(task.entities) - task.known
    session = _session(task, theta0)
    words = torch.zeros(len(task.entities), 1) if task.words is None else torch.from_numpy(task.words)
    triples = torch.from_numpy(task.told)
    place = torch.where(triples[:, HEAD] >= task.known, triples[:, HEAD], triples[:, TAIL]) - task.known
    order = torch.argsort(place, stable=True)
    registered = INITIALIZERS.get(choice.initializer, "initializer")
    for part in torch.split(torch.arange(number), at_once(registered.cost, task.sizes, task.family.linear)):
        rows = order[(place[order] >= part[0]) & (place[order] <= part[-1])]
        insert_triples = torch.stack([torch.zeros_like(rows), place[rows] - part[0], rows], 1)
        given = NovelEntities(part[None] + task.known, insert_triples, words)
        context = context_of(theta0, session, given, task.seed, part[None, :1])
        if not len(task.known_triples):  # which would say what has been trained
            context = replace(context, eligible=context.known)
        with argument("initializer"):
            yield registered.initialize(context, choice.options)


def _session(task: InsertionTask, theta0: Embedding) -> Session:
    """Of the known entities; its graph has the insert triples first, then the known triples."""
    graph = graph_of(np.concatenate([task.told, task.known_triples]), theta0, task.kinds)
    splits = torch.full((1, len(graph.triples)), TRAIN, dtype=torch.int8)
    splits[:, : len(task.told)] = OUT
    return Session(graph, torch.arange(len(task.entities))[None] < task.known, splits)
