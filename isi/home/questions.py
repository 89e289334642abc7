"""What a home is asked."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from datetime import datetime, timedelta
from functools import partial, wraps
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

import numpy as np

from isi.config import Count, Seed, check
from isi.errors import InputError
from isi.graph.graph import HEAD, TAIL
from isi.home.answers import Answers, answer, answer_relation
from isi.home.changes import Change, changes_of
from isi.home.choices import NotChosen
from isi.home.connection import patiently
from isi.home.database import Database
from isi.home.derived import Derived
from isi.home.facts import StoredFact
from isi.home.inserted import InsertedEntity
from isi.home.loaded import LoadedEmbedding, Query
from isi.home.times import time_before
from isi.home.verbs import History, KnownFacts, NameList, Stale, checked

if TYPE_CHECKING:  # PyTorch takes a second to import, and most questions do without
    from isi.home.explain import Explanation
    from isi.insertion.interference import Interference

FIRST_TRAINING = 1  #: Number of the change that made a home.
P = ParamSpec("P")
R = TypeVar("R")


def one_at_a_time(
    begin: Callable[[Any], AbstractContextManager[Any]],
) -> Callable[[Callable[Concatenate[Any, P], R]], Callable[Concatenate[Any, P], R]]:
    """Decorates methods of which one thread runs one at a time; ``begin``: what it sees or writes
    is of one moment, after what other processes have changed is taken over. While another program
    writes, others run. Where a choice is missing, it is made while nothing is locked, and the
    method begins again.
    """

    def decorate(method: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[Any, P], R]:
        def once(self: Any, /, *args: P.args, **kwargs: P.kwargs) -> R:
            with self._lock:
                if self._is_inside:
                    return method(self, *args, **kwargs)
                self._is_inside = True
                try:
                    with begin(self):
                        return method(self, *args, **kwargs)
                finally:
                    self._is_inside = False

        @wraps(method)
        def locked(self: Any, /, *args: P.args, **kwargs: P.kwargs) -> R:
            listed: Any = [_whole(value) for value in args]
            named: Any = {name: _whole(value) for name, value in kwargs.items()}
            while True:
                try:
                    return patiently(partial(once, self, *listed, **named))
                except NotChosen as missing:
                    missing.make()

        return locked

    return decorate


def _whole(value: object) -> object:
    """What can be read a second time."""
    return list(value) if isinstance(value, Iterator) else value


@contextmanager
def _question(home: Questions) -> Iterator[None]:
    with home.database.snapshot():
        home.derived = home.derived.current()
        yield


reads = one_at_a_time(_question)


class Questions:
    """What is asked of a home, and changes nothing."""

    def __init__(self, database: Database, base: LoadedEmbedding) -> None:
        """``base``: the trained embedding of the database."""
        self._lock, self._is_inside = RLock(), False
        self.database = database
        with database.snapshot():
            self.derived = Derived(database, base)

    # -- answers -----------------------------------------------------------------------------------

    @reads
    def ask(
        self,
        head: str | None = None,
        relation: str | None = None,
        tail: str | None = None,
        top: int = 10,
        *,
        new: bool = False,
        among: Sequence[str] | None = None,
    ) -> Answers:
        """The best answers to a query with one missing part: tail, head or relation.
        Facts stand first.

        An answer has a calibrated probability where known entities allow it; ``Answers.sure`` is
        false where the best one is below ``LIKELY``. Of a name that is not known, the only known
        one that differs in case, or in spaces and hyphens between letters, is meant; then
        ``Answers.notes`` says so.

        Args:
            top: number of answers.
            new: leave out what is known: where else could it be?
            among: rank these entities alone.

        Example:
            >>> first = home.ask("cup", "in").answers[0]
            >>> first.entity, first.rank, first.known
            ('kitchen', 1, True)
            >>> home.ask("cup", "in", new=True, among=["kitchen", "bedroom"]).answers[0].entity
            'bedroom'
            >>> home.ask(head="cup", tail="kitchen").answers[0].entity
            'in'
        """
        check(top, Count, "", "argument 'top'")
        if (head is None) + (relation is None) + (tail is None) != 1:
            expected = "expected two of head, relation and tail: the third one is the answer"
            raise InputError("ask", "", expected)
        now, notes = self.now, list[str]()
        first, last = (
            None if name is None else now.names.ids[self._queried(name, notes)]
            for name in (head, tail)
        )
        if relation is None:
            if among is not None:
                raise InputError("argument 'among'", "", "expected a query for entities")
            # of an inserted entity if there is one
            ends = first or 0, last or 0
            curve_of = partial(self.derived.curve, max(ends), slot=TAIL)
            return replace(answer_relation(now, *ends, top, curve_of, new), notes=notes)
        label = now.labels.ids[now.labels.queried(relation, notes.append)]
        entity, slot = (last or 0, HEAD) if first is None else (first, TAIL)
        query = Query(entity, label, slot)
        ids = None
        if among is not None:
            ids = [now.names.ids[self._queried(name, notes)] for name in among]
        curve = self.derived.curve(*query)
        return replace(answer(now, query, top, curve, new=new, among=ids), notes=notes)

    @reads
    def nearest(self, entity: str, top: int = 10) -> list[tuple[str, float]]:
        """The ``top`` other entities with the highest cosine to an entity, and these cosines.

        Example:
            >>> [entity for entity, cosine in home.nearest("cup", 2)]
            ['pan', 'fork']
        """
        check(top, Count, "", "argument 'top'")
        names = self.now.entity_names
        row = self.now.names.ids[self._queried(entity)]
        return [(names[other], cosine) for other, cosine in self.now.nearest(row, top)]

    @reads
    def explain(self, entity: str) -> Explanation:
        """Why an inserted entity is where it is: its facts, its words and its indicators.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen")], initializer="rs", options={"k": 3})
            >>> explanation = home.explain("mug")
            >>> sorted(indicator.entity for indicator in explanation.indicators)
            ['cup', 'fork', 'pan']
        """
        from isi.home.explain import explain

        notes = list[str]()
        name = self.derived.inserted(self._queried(entity, notes))
        explanation = explain(self.derived, name)
        return replace(explanation, notes=[*notes, *explanation.notes])

    @reads
    def interference(
        self, entities: str | Sequence[str] = (), most: int = 256, show: int = 5
    ) -> Interference | None:
        """How far inserted entities push known answers down: all of them, or those named;
        None without known triples.

        ``isi.insertion.interference`` defines the measures. The queries are of triples of training
        that hold.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen")], initializer="mean")
            >>> measured = home.interference(["mug"])
            >>> measured.queries, measured.h_cur <= measured.h_old
            (12, True)
        """
        from isi.insertion.interference import interference_of
        from isi.models.stack import usual_torch

        most = check(most, Count, "", "argument 'most'")
        show = check(show, Seed, "", "argument 'show'")
        known = len(self.base.entities)
        if not len(self.known_triples) or not self.derived.rows:
            return None
        queried = map(self._queried, check(entities, NameList, "", "argument 'entities'"))
        names = dict.fromkeys(map(self.derived.inserted, queried))
        part = self.derived.with_inserted(names) if names else self.now
        with usual_torch():
            return interference_of(
                part.embedding,
                part.names,
                part.labels,
                self.known_triples,
                [part.triples],
                known,
                most,
                0,
                show,
            )

    # -- state -------------------------------------------------------------------------------------

    @property
    def base(self) -> LoadedEmbedding:
        """The trained entities, with the triples of training.

        Example:
            >>> home.base.entity_names[:2], home.base.manifest.model_name
            (['bed', 'bedroom'], 'complex')
        """
        return self.derived.base

    @property
    def folder(self) -> Path | None:
        """Of the home; None in memory."""
        return self.database.folder

    @property
    @reads
    def inserted(self) -> dict[str, InsertedEntity]:
        """The inserted entities by name, in order.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen")])
            >>> list(home.inserted)
            ['mug']
        """
        return dict(self.derived.rows)

    @reads
    def facts(self, entity: str | None = None) -> list[StoredFact]:
        """The facts that hold, of an entity or all: those of training, then those that were told,
        with count, confidence, times and source.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen")], source="camera", confidence=0.8)
            >>> (row,) = home.facts("mug")
            >>> row.fact, row.status, row.confidence, row.source
            (('mug', 'in', 'kitchen'), 'added', 0.8, 'camera')
        """
        verb = checked(KnownFacts, locals())
        if verb.entity is None:
            return self.database.facts()
        return self.database.facts_of(self._queried(verb.entity))

    @property
    @reads
    def known_triples(self) -> np.ndarray:
        """The triples of training that hold; ids, shape (T, 3).

        Example:
            >>> home.known_triples.shape
            (6, 3)
        """
        return self.derived.known_triples

    @property
    @reads
    def now(self) -> LoadedEmbedding:
        """The bundle with all inserted entities in its last rows, and all facts that hold."""
        return self.derived.now

    @reads
    def history(self, last: int | None = None) -> list[Change]:
        """The changes since the first training, those that were undone included; ``last``: so many
        alone.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen")])
            >>> [(change.verb, change.added) for change in home.history()]
            [('tell', [('mug', 'in', 'kitchen')])]
        """
        verb = checked(History, locals())
        changes = changes_of(self.database, FIRST_TRAINING + 1)
        return changes if verb.last is None else changes[-verb.last :]

    @reads
    def stale(
        self, age: timedelta | str, since: datetime | str | float | None = None
    ) -> list[StoredFact]:
        """The facts that hold and were not seen for some time before ``since`` (None: now), the
        oldest first. One that was not seen since training counts as seen then.

        ``age``: such as ``30d``, ``12h``.

        Example:
            >>> [row.fact for row in home.stale("30d")]
            []
        """
        verb = checked(Stale, locals())
        return self.database.facts_not_seen_since(time_before(verb.age, verb.since))

    def __repr__(self) -> str:
        sizes = self.base.sizes()
        if self.database.is_closed:
            return f"Home({self.folder or ''}: closed)"
        added = len(self.database.facts_with("added"))
        return (
            f"Home({self.folder or ''}: {sizes['entities']:,} known entities,"
            f" {len(self.derived.rows):,} inserted, {added:,} facts added to"
            f" {sizes['triples']:,}, {self.base.manifest.model_name})"
        )

    def _queried(self, name: str, notes: list[str] | None = None) -> str:
        """The known entity that a question is about; without ``notes``, a warning says which."""
        note = partial(warnings.warn, stacklevel=4) if notes is None else notes.append
        return self.derived.now.names.queried(name, note)
