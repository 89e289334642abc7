"""A home: a trained embedding that is told of entities and facts, and answers.

The rows of trained entities never change. The vector of an inserted entity is a function of its
facts: it is computed again from all of them whenever one comes or goes, in whatever order they
came. Inserted entities are no indicators of each other. Those that share a fact are inserted
together (``isi.insertion.engine``). What holds is what the tables of the home say
(``isi.home.database``); this object is what is derived from them.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from functools import partial, wraps
from pathlib import Path
from threading import RLock
from typing import Any, Concatenate, ParamSpec, Self, TypedDict, TypeVar, Unpack

import numpy as np
import torch
from tqdm import tqdm

from isi.config import Count, Seed, as_list, check
from isi.errors import InputError, at
from isi.graph.graph import HEAD, TAIL
from isi.graph.vocabulary import Vocabulary
from isi.home.answers import Answers, Curve, answer, answer_relation, fit_curve
from isi.home.bundle import Bundle, Fact
from isi.home.changes import Change, Effect, Stamp, TellOptions, changes_of, checked_facts, names_in
from isi.home.database import Database, Durability, StoredFact, as_text, now
from isi.home.explain import Explanation, Report, Snapshot, explain, report
from isi.home.groups import Computed, EntityGroups, EntityInput, InsertedEntity, stored
from isi.home.loaded import LoadedEmbedding, Query
from isi.home.names import NewName, check_new
from isi.home.phrases import SAME, phrase_vectors, with_words
from isi.insertion.arguments import naming_argument
from isi.insertion.interference import Interference, measure
from isi.models.stack import usual_torch
from isi.names import clean, plain

FIRST_TRAINING = 1  #: Number of the change that made a home.
P = ParamSpec("P")
R = TypeVar("R")


class When(TypedDict, total=False):
    """When a change was made, and what reported it (``Stamp``)."""

    time: datetime | str | float | None
    source: str | None


class About(When, total=False):
    """What may be told beside facts (``TellOptions``)."""

    definition: str | Mapping[str, str] | None
    kind: str | Mapping[str, str] | None
    initializer: str | None
    options: Mapping[str, Any] | None
    seed: int
    confidence: float | None
    new: bool


@dataclass
class Pending:
    """A change while it is made."""

    number: int
    time: str
    source: str | None
    result: Effect = field(default_factory=Effect)  #: when it is made


def _one_at_a_time(
    begin: Callable[[Any], AbstractContextManager[Any]],
) -> Callable[[Callable[Concatenate[Any, P], R]], Callable[Concatenate[Any, P], R]]:
    """Decorates methods of which one thread runs one at a time, under PyTorch's usual settings,
    after what other processes have changed is taken over; ``begin``: what it sees or writes is of
    one moment.
    """

    def decorate(method: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[Any, P], R]:
        @wraps(method)
        def locked(self: Any, /, *args: P.args, **kwargs: P.kwargs) -> R:
            with self._lock:
                if self._is_inside:
                    return method(self, *args, **kwargs)
                self._is_inside = True
                try:
                    with usual_torch(), begin(self):
                        self._take_over()
                        return method(self, *args, **kwargs)
                finally:
                    self._is_inside = False

        return locked

    return decorate


def _question(home: Home) -> AbstractContextManager[None]:
    return home.database.snapshot()


@contextmanager
def _change(home: Home) -> Iterator[None]:
    with home._or_as_before(), home.database.transaction():
        yield


reads = _one_at_a_time(_question)
changes = _one_at_a_time(_change)


class Home:
    """An embedding that lives with a robot. ``isi.open``, ``isi.train`` and
    ``isi.from_pykeen`` make one.

    Facts are triples of names in any form that ``isi.insert`` accepts, perhaps with a fourth part,
    their confidence. An ``InputError`` refuses what cannot be done, and changes nothing; a change
    that returns is durable. Threads may share the object.

    Example:
        >>> import isi
        >>> facts = [(name, "in", "kitchen") for name in ("cup", "pan", "fork")]
        >>> facts += [(name, "in", "bedroom") for name in ("bed", "lamp", "desk")]
        >>> home = isi.train(facts, model="distmult", dimension=4)
        >>> home.tell([("mug", "in", "kitchen")]).inserted
        ['mug']
        >>> home.ask("mug", "in").answers[0].entity
        'kitchen'
        >>> home.undo().removed
        ['mug']
    """

    def __init__(self, bundle: Bundle, database: Database | None = None) -> None:
        """Use ``isi.open``, ``isi.train`` or ``isi.from_pykeen``.

        ``home``: of the bundle; None: one in memory.
        """
        self._lock, self._is_inside = RLock(), False
        loaded = bundle if isinstance(bundle, LoadedEmbedding) else LoadedEmbedding(**vars(bundle))
        loaded = with_words(loaded) if database is None else _with_own_words(loaded)
        self.database = database or Database.create(loaded)
        self._now: LoadedEmbedding | None = None
        self._known_triples: np.ndarray | None = None
        self._known_names: Vocabulary | None = None
        self._known_relations: Vocabulary | None = None
        with usual_torch(), self.database.snapshot():
            self._load(loaded)

    def _load(self, base: LoadedEmbedding) -> None:
        """Derive everything from the tables."""
        self.base = base  #: the trained entities, with the triples of training
        self.groups = EntityGroups(base, phrase_vectors(base), self.database)
        self._known_curves = dict[tuple[int, int], Curve | None]()  # by relation and slot
        self._last = self._last_change()
        self._rows = dict[str, InsertedEntity]()
        self._read_rows(0)
        self._version = self.database.version()

    # -- changes -----------------------------------------------------------------------------------

    @changes
    def tell(
        self,
        facts: Any = (),
        *,
        entities: str | Sequence[str] = (),
        **about: Unpack[About],
    ) -> Effect:
        """Tell facts: what is not known yet is inserted, and what is known is seen once more.

        A relation that is not known is new if two or more of the facts have it.

        Args:
            facts: triples by name; a fourth part is a confidence.
            entities: further new entities, which are inserted by their words alone.
            **about: ``definition``: a sentence for the word vector; by name for several entities.
                So is ``kind``; without it, the kind follows from the facts, or else from the most
                similar words.
                ``initializer``: None: the best for hidden known entities with as many facts.
                ``options`` replace its defaults. ``seed``: of a random initializer.
                ``confidence``: how far the facts are believed, above 0 and at most 1; MAP weighs
                them by it. ``new``: insert names that look like known ones ("Forks" beside
                "fork"), too. ``time``: when it was seen; None: now. Without a zone, it is local
                time. ``source``: what reported it.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen"), ("lamp", "in", "bedroom")])
            >>> effect.inserted, effect.facts, effect.known
            (['mug'], 1, 1)
        """
        told = check(about, TellOptions, "", "tell")
        names, listed = _names(entities), self._as_known(checked_facts(facts, told.confidence))
        named = names_in(listed, names)
        for argument, texts in (("definition", told.definition), ("kind", told.kind)):
            for name in texts if isinstance(texts, Mapping) else ():
                if clean(name) not in named and self._known.same(name) is None:
                    expected = f"expected names of entities that are told, got {name!r:.80}"
                    raise InputError(f"argument {argument!r}", "", expected)
        with self._changing("tell", told) as change:
            unknown = [each for each in named if self._known.same(each) is None]
            self._insert_entities(change, unknown, told)
            self._add_relations(change, listed)
            self._add_facts(change, listed)
        return change.result

    @changes
    def insert(
        self,
        entities: str | Sequence[str],
        facts: Any = (),
        *,
        upsert: bool = False,
        **about: Unpack[About],
    ) -> Effect:
        """``tell`` that names the new entities, so that no other unknown name is accepted; the
        other arguments are those of ``tell``.

        Args:
            entities: a name, or several.
            facts: triples; for one entity also its tails by relation,
                ``{"atLocation": "kitchen"}``.
            upsert: of an entity that is known already, only the facts are added.

        Example:
            >>> facts = [("mug", "in", "kitchen"), ("sofa", "in", "bedroom")]
            >>> effect = home.insert(["mug", "sofa"], facts)
            >>> effect.inserted, effect.facts
            (['mug', 'sofa'], 2)
        """
        names, facts = _names(entities), _whole(facts)
        if isinstance(facts, Mapping) and not any(map(_is_mapping, facts.values())):
            if len(names) != 1 and facts:
                expected = "expected facts by name: tails by relation are of one entity"
                raise InputError("facts", "", expected)
            facts = dict.fromkeys(names, facts)
        present = [name for name in names if self._known.same(name) is not None]
        if present and not upsert:
            refused = f"expected a new name: {present[0]!r:.80} is known; use tell"
            raise InputError(repr(present[0])[:80], "", refused)
        self._refuse_unknown(self._as_known(checked_facts(facts)), names)
        return self.tell(facts, entities=names, **about)

    @changes
    def observe(self, facts: Any, *, upsert: bool = False, **about: Unpack[About]) -> Effect:
        """``tell`` of entities that are known, unless ``upsert``.

        Example:
            >>> home.observe([("lamp", "in", "kitchen")]).facts
            1
        """
        facts = _whole(facts)
        if not upsert:
            self._refuse_unknown(self._as_known(checked_facts(facts)), ())
        return self.tell(facts, **about)

    @changes
    def move(
        self,
        head: str,
        relation: str,
        tail: str,
        *,
        instead_of: str | None = None,
        **stamp: Unpack[When],
    ) -> Effect:
        """Replace the facts with this head and relation by one fact:
        ``move("mug", "atLocation", "desk")``.

        ``instead_of``: replace the fact with this tail alone. An ``InputError`` refuses one that
        does not hold.

        Example:
            >>> home.move("lamp", "in", "kitchen").lost
            [('lamp', 'in', 'bedroom')]
        """
        (fact,) = listed = self._as_known({(head, relation, tail): None})
        with self._changing("move", stamp) as change:
            self._refuse_unknown(listed, ())
            old = [row.fact for row in self.database.facts_of(fact[0]) if row.fact[:2] == fact[:2]]
            if instead_of is not None:
                old = [(*fact[:2], self._known.same(instead_of) or clean(instead_of))]
            for each in old:
                if each != fact:
                    self.database.take_fact(change.number, each)
            self._add_facts(change, listed)
        return change.result

    @changes
    def remove(
        self,
        entities: str | Sequence[str] = (),
        facts: Any = (),
        **stamp: Unpack[When],
    ) -> Effect:
        """Take inserted entities back with all their facts, or single facts.

        A fact that the embedding was trained on is retracted: it is no answer any more, and vectors
        of inserted entities are computed without it. ``undo`` brings it back, and so does
        ``tell``.

        Example:
            >>> home.remove(facts=[("lamp", "in", "bedroom")]).lost
            [('lamp', 'in', 'bedroom')]
        """
        names, listed = _names(entities), self._as_known(checked_facts(facts))
        with self._changing("remove", stamp) as change:
            self._refuse_unknown(listed, ())
            for fact in listed:
                self.database.take_fact(change.number, fact)
            for name in names:
                known = self._known.find(name)
                self.database.remove_entity(change.number, self._inserted(known))
        return change.result

    @changes
    def undo(self, **stamp: Unpack[When]) -> Effect:
        """Take the last change back, a second time the one before;
        an ``InputError`` if there is none since training.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen")])
            >>> home.undo().removed
            ['mug']
        """
        with self._changing("undo", stamp) as change:
            self.database.put_back(change.number)
        return change.result

    @property
    def history(self) -> list[Change]:
        """All changes since the first training, those that were undone included.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen")])
            >>> [(change.verb, change.added) for change in home.history]
            [('tell', [('mug', 'in', 'kitchen')])]
        """
        with self._lock:
            return changes_of(self.database, FIRST_TRAINING + 1)

    @reads
    def stale(self, age: timedelta, since: datetime | None = None) -> list[StoredFact]:
        """The facts that hold and were not seen for some time before ``since`` (None: now), the
        oldest first. One that was not seen since training counts as seen then.

        Example:
            >>> from datetime import timedelta
            >>> [row.fact for row in home.stale(timedelta(days=30))]
            []
        """
        ((trained,),) = self.database.read("SELECT max(time) FROM change WHERE verb = 'train'")
        try:
            before = as_text((since or now()) - age)
        except OverflowError as error:
            raise InputError("argument 'age'", "", f"expected fewer years, got {age}") from error
        last = "coalesce(last_seen, ?)"
        rows = self.database.facts(f"status <> 'retracted' AND {last} < ?", trained, before)
        return sorted(rows, key=lambda row: row.last_seen or trained)

    def prepare(self, progress: bool = False) -> None:
        """Choose initializers and fit the curves of probabilities now, in some seconds, so that no
        later insertion waits for that. The choices are stored.

        Without it, the first insertion with a number of facts makes the choice for this number.
        """
        with self._lock:
            self._take_over()
            waiting = self.groups.preparation()
        bar = tqdm(waiting, "initializers", leave=False, disable=None if progress else True)
        for conditions in bar:
            with self._lock:
                self._take_over()
                self.groups.choice(conditions)

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
            raise InputError(
                "ask", "", "expected two of head, relation and tail: the third one is the answer"
            )
        now, notes = self.now, list[str]()
        first, last = (
            None if name is None else now.names.ids[self._queried(name, notes)]
            for name in (head, tail)
        )
        if relation is None:
            if among is not None:
                raise InputError("argument 'among'", "", "expected a query for entities")
            ends = first or 0, last or 0
            # of an inserted entity if there is one
            curve_of = partial(self._curve, max(ends), slot=TAIL)
            return replace(answer_relation(now, *ends, top, curve_of, new), notes=notes)
        known = now.labels.queried(relation, notes.append)
        label = now.labels.ids[known]
        query = Query(first, label, TAIL) if first is not None else Query(last, label, HEAD)  # type: ignore[arg-type]
        ids = None
        if among is not None:
            ids = [now.names.ids[self._queried(name, notes)] for name in among]
        best = answer(now, query, top, self._curve(*query), new=new, among=ids)
        return replace(best, notes=notes)

    def _ask_query(self, query: Query, top: int, indicators: Collection[int]) -> Answers:
        """The answers to a query by ids, with ``Answer.shared_by``."""
        return answer(self.now, query, top, self._curve(*query), indicators=indicators)

    @reads
    def nearest(self, entity: str, number: int = 10) -> list[tuple[str, float]]:
        """The ``number`` other entities with the highest cosine to an entity, and these cosines.

        Example:
            >>> [entity for entity, cosine in home.nearest("cup", 2)]
            ['pan', 'fork']
        """
        check(number, Count, "", "argument 'number'")
        names = self.now.entity_names
        row = self.now.names.ids[self._queried(entity)]
        return [(names[other], cosine) for other, cosine in self.now.nearest(row, number)]

    @reads
    def explain(self, entity: str) -> Explanation:
        """Why an inserted entity is where it is: its facts, its words and its indicators.

        Example:
            >>> effect = home.insert("mug", {"in": "kitchen"}, initializer="rs", options={"k": 3})
            >>> explanation = home.explain("mug")
            >>> sorted(indicator.entity for indicator in explanation.indicators)
            ['cup', 'fork', 'pan']
        """
        notes = list[str]()
        explained = explain(self._snapshot(entity, notes))
        return replace(explained, notes=[*notes, *explained.notes])

    @reads
    def report(self, entity: str, top: int = 5) -> Report:
        """What is known and predicted about an inserted entity,
        with the ``top`` best answers to each query.

        Example:
            >>> effect = home.insert("mug", {"in": "kitchen"}, initializer="mean")
            >>> report = home.report("mug")
            >>> report.facts, report.initializer, report.why
            ([('mug', 'in', 'kitchen')], 'mean', 'as named')
        """
        check(top, Count, "", "argument 'top'")
        notes = list[str]()
        reported = report(self._snapshot(entity, notes), top, self._ask_query)
        return replace(reported, notes=[*notes, *reported.notes])

    def _snapshot(self, entity: str, notes: list[str]) -> Snapshot:
        name = self._inserted(self._queried(entity, notes))
        given = self._inputs_of([name])
        return Snapshot(self.now, self.groups, self.known_triples, given, self._rows[name])

    @reads
    def interference(
        self, entities: str | Sequence[str] = (), most: int = 256, show: int = 5
    ) -> Interference | None:
        """How far inserted entities push known answers down: all of them, or those named;
        None without known triples.

        ``isi.insertion.interference`` defines the measures. The queries are of triples of training
        that hold.

        Example:
            >>> effect = home.insert("mug", {"in": "kitchen"}, initializer="mean")
            >>> measured = home.interference(["mug"])
            >>> measured.queries, measured.h_cur <= measured.h_old
            (12, True)
        """
        most = check(most, Count, "", "argument 'most'")
        show = check(show, Seed, "", "argument 'show'")
        now, known = self.now, len(self.base.entities)
        if not len(self.known_triples) or not self._rows:
            return None
        names = dict.fromkeys(self._inserted(self._queried(name)) for name in _names(entities))
        chosen = [now.names.ids[name] for name in names]
        part = now.part(np.array([*range(known), *chosen])) if chosen else now
        return measure(
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
    def folder(self) -> Path | None:
        """Of the home; None in memory."""
        return self.database.folder

    @property
    @reads
    def inserted(self) -> dict[str, InsertedEntity]:
        """The inserted entities by name, in order.

        Example:
            >>> effect = home.insert("mug", {"in": "kitchen"})
            >>> list(home.inserted)
            ['mug']
        """
        return dict(self._rows)

    @property
    def facts(self) -> list[StoredFact]:
        """The facts that hold: those of training, then those that were added, with count,
        confidence, times and source.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen")], source="camera", confidence=0.8)
            >>> row = home.facts[-1]
            >>> row.fact, row.status, row.confidence, row.source
            (('mug', 'in', 'kitchen'), 'added', 0.8, 'camera')
        """
        with self._lock:
            return self.database.facts("status <> 'retracted'")

    @property
    @reads
    def known_triples(self) -> np.ndarray:
        """The triples of training that hold; ids, shape (T, 3).

        Example:
            >>> home.known_triples.shape
            (6, 3)
        """
        if self._known_triples is None:
            retracted = self.database.facts("status = 'retracted'")
            self._known_triples = self.base.triples_without([row.fact for row in retracted])
        return self._known_triples

    @property
    @reads
    def now(self) -> LoadedEmbedding:
        """The bundle with all inserted entities in its last rows, and all facts that hold."""
        if self._now is None:
            self._now = self._as_it_is(self._rows)
        return self._now

    def _as_it_is(self, rows: Mapping[str, InsertedEntity]) -> LoadedEmbedding:
        """The bundle with inserted entities, and what the tables say holds."""
        base = self.base
        new = self.database.read(
            "SELECT name, vector FROM relation WHERE vector IS NOT NULL ORDER BY id"
        )
        vectors = [np.frombuffer(each, base.relations.dtype)[None] for _, each in new]
        larger = replace(
            base,
            entities=np.concatenate([base.entities, *(row.vector[None] for row in rows.values())]),
            relations=np.concatenate([base.relations, *vectors]),
            entity_names=[*base.entity_names, *rows],
            relation_names=[*base.relation_names, *(name for name, _ in new)],
            kinds=[*base.kinds, *(row.kind for row in rows.values())],
            phrases=[*base.phrases, *map(plain, rows)],
            # those of inserted entities are looked up where they are needed
            words=None if base.words is None else np.pad(base.words, ((0, len(rows)), (0, 0))),
            inserted=len(rows),
            counts=None,
        )
        labels = larger.labels.ids
        query = "SELECT head, relation, tail FROM fact WHERE status = ? ORDER BY id"
        usable = {
            status: [fact for fact in self.database.read(query, status) if fact[1] in labels]
            for status in ("added", "retracted")
        }
        added, retracted = larger.ids_of(usable["added"]), larger.ids_of(usable["retracted"])
        triples = np.concatenate([self.known_triples, added])
        return replace(larger, triples=triples, added=len(added), retracted=retracted)

    @property
    def _known(self) -> Vocabulary:
        if self._known_names is None:
            self._known_names = self.base.names.with_new(self._rows, "entities")
        return self._known_names

    @property
    def _relations(self) -> Vocabulary:
        if self._known_relations is None:
            names = [name for (name,) in self.database.read("SELECT name FROM relation")]
            self._known_relations = Vocabulary("relation", names)
        return self._known_relations

    @reads
    def save(self, folder: str | Path | None = None) -> None:
        """Write a copy of the home into another folder, where ``isi.open`` finds it.

        None: of a home in a folder, all is there already.

        Example:
            >>> effect = home.insert("mug", {"in": "kitchen"})
            >>> home.save("a home")
            >>> list(isi.open("a home").inserted)
            ['mug']
        """
        if self.base.scoring is not None:
            expected = (
                "expected a model that isi has: DistMult, ComplEx, "
                "TransE or RotatE without inverse triples"
            )
            raise InputError("save", "", expected)
        if folder is None and self.folder is None:
            raise InputError("save", "", "expected a folder: this home is in memory")
        if folder is not None:
            self.database.write_to(Path(folder), self.base)

    def train_again(self, bundle: Bundle) -> None:
        """Make a newly trained embedding that of this home; ``isi.train(home)`` calls it."""
        loaded = with_words(LoadedEmbedding(**vars(bundle)))
        training = self.database.training(loaded, keep=True)
        with self._lock, usual_torch(), self._or_as_before(), training as number:
            self._load(loaded)
            if names := self.database.inserted():  # they came while this was trained
                computed = self.groups.insert(self._inputs_of(names), self.known_triples)
                added = [row.fact for row in self.database.facts("status = 'added'")]
                self._rows = {name: computed[name].entity for name in names}
                self._write(number, computed, added)

    def close(self) -> None:
        """Close the home. What is done with it afterwards is an ``InputError``."""
        with self._lock:
            self.database.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        sizes = self.base.sizes()
        if self.database.is_closed:
            return f"Home({self.folder or ''}: closed)"
        added = self.database.read("SELECT count(*) FROM fact WHERE status = 'added'")[0][0]
        return (
            f"Home({self.folder or ''}: {sizes['entities']:,} known entities,"
            f" {len(self._rows):,} inserted, {added:,} facts added to"
            f" {sizes['triples']:,}, {self.base.manifest.model_name})"
        )

    # -- inside ------------------------------------------------------------------------------------

    @contextmanager
    def _changing(self, verb: str, stamp: Stamp | When) -> Iterator[Pending]:
        """A change: what is done inside is written together with the vectors that follow from it,
        or not at all.
        """
        stamp = stamp if isinstance(stamp, Stamp) else check(stamp, Stamp, "", verb)
        when = as_text(stamp.time or now())
        number = self.database.add_change(verb, when, stamp.source)
        change = Pending(number, when, stamp.source)
        yield change
        (made,) = changes_of(self.database, number)
        lists = made.inserted, made.removed, made.added, made.seen, made.lost, made.unseen
        if not any(lists):
            self.database.read("DELETE FROM change WHERE id = ?", number)
            return
        computed = self._computed(made)
        self._write(number, computed, [*made.added, *made.lost])
        has_names = bool(made.inserted or made.removed)
        present = self.database.inserted() if has_names else list(self._rows)
        self._last = number
        rows = self._rows | {name: each.entity for name, each in computed.items()}
        self._rows = {name: rows[name] for name in present}
        if has_names or made.relations or verb == "undo":
            self._forget()
        elif computed or made.added or made.lost:
            self._now = None
        notes = [note for each in computed.values() for note in each.entity.notes]
        notes += [f"{' '.join(fact)} counts as seen once less" for fact in made.unseen]
        change.result = Effect(
            inserted=made.inserted,
            updated=[name for name in computed if name not in made.inserted],
            removed=made.removed,
            relations=made.relations,
            facts=len(made.added),
            lost=made.lost,
            known=len(made.seen),
            notes=list(dict.fromkeys([*notes, *self.groups.warnings()])),
        )

    def _insert_entities(self, change: Pending, names: Sequence[str], told: TellOptions) -> None:
        """Insert entities that are not known."""
        kinds = Vocabulary("kind", self.base.kind_numbers)
        together = Vocabulary("entity", names)
        for name in names:
            if not told.new and together.meant(name) is None:
                expected = "expected one spelling of a new name, or new=True for several"
                raise InputError(repr(name)[:80], "", expected)
            check_new(name, self._known, None if told.new else self._same_words(name), told.new)
            with at(repr(name)[:80]):
                each = told.about(name)
            if each.kind is not None:
                each = each.model_copy(update={"kind": kinds.find(each.kind)})
            self.database.add_entity(change.number, name, each)

    def _add_relations(self, change: Pending, facts: Iterable[Fact]) -> None:
        """Insert the relations that two or more facts have and that are not known."""
        known = self._relations
        for name, number in Counter(fact[1] for fact in facts).items():
            if known.same(name) is not None:
                continue
            check(name, NewName, "", "relation")
            if number < 2:
                expected = "expected a known relation, or two facts or more of a new one"
                raise InputError(repr(name)[:80], "", expected + known.hint(name))
            self.database.add_relation(change.number, name)

    def _add_facts(self, change: Pending, facts: Mapping[Fact, float | None]) -> None:
        for fact, confidence in facts.items():
            self.database.put_fact(change.number, fact, change.time, change.source, confidence)

    def _computed(self, made: Change) -> dict[str, Computed]:
        """The inserted entities whose vectors follow from a change, with those that share facts
        with them.
        """
        inserted = (self._rows.keys() | set(made.inserted)) - set(made.removed)
        touched = {*made.inserted, *names_in([*made.added, *made.lost, *made.believed])}
        if made.training:
            self._known_triples = None
            touched = inserted
        if names := touched & inserted:
            return self.groups.insert(self._inputs_of(names), self.known_triples)
        return {}

    def _inputs_of(self, names: Collection[str]) -> dict[str, EntityInput]:
        """What is given about inserted entities, and about all that a chain of facts joins to
        them.
        """
        trained, inserted = self.base.labels.ids, set(self.database.inserted())
        given, waiting = dict[str, EntityInput](), sorted(names)
        while waiting:
            name = waiting.pop()
            if name in given:
                continue
            rows = [row for row in self.database.facts_of(name) if row.relation in trained]
            facts = {row.fact: row.confidence or 1.0 for row in sorted(rows, key=_fact_of)}
            given[name] = EntityInput(self.database.about(name), facts)
            waiting += [end for end in names_in(facts) if end in inserted and end not in given]
        return given

    def _write(
        self, change: int, computed: Mapping[str, Computed], changed: Iterable[Fact]
    ) -> None:
        """Write computed vectors, and the rows of the relations that are not trained and that these
        vectors, or facts that came or went, determine.
        """
        for each in computed.values():
            each.entity.store(self.database, change)
        new = {
            name for (name,) in self.database.read("SELECT name FROM relation WHERE NOT trained")
        }
        if not new or not (computed or new & {fact[1] for fact in changed}):
            return
        rows = self._rows | {name: each.entity for name, each in computed.items()}
        present = self._as_it_is({name: rows[name] for name in self.database.inserted()})
        for name in sorted(new):
            if facts := [row.fact for row in self.database.facts("relation = ?", name)]:
                row = self.groups.relation_row(facts, present)
                update = "UPDATE relation SET vector = ? WHERE name = ?"
                self.database.read(update, row.tobytes(), name)

    def _take_over(self) -> None:
        """Take over what other processes have changed, in a time that grows with that."""
        version = self.database.version()
        if version == self._version:
            return
        with self._or_as_before():
            if self.database.last_training() != self.database.read_training:
                self._load(_with_own_words(LoadedEmbedding(**vars(self.database.bundle()))))
                return
            last = self._last_change()
            if last != self._last:
                self._read_rows(self._last)
                self._last = last
            self._version = version

    @contextmanager
    def _or_as_before(self) -> Iterator[None]:
        """After a failure inside, everything is as it was. What others changed, and what was done
        if it is written nevertheless, is taken over when it is needed.
        """
        before, training = vars(self).copy(), self.database.read_training
        try:
            yield
        except BaseException:
            vars(self).update(before)
            self.database.read_training = training
            self.groups.forget()
            self._forget()
            self._version = -1
            raise

    def _read_rows(self, after: int) -> None:
        """Read the vectors of changes after one."""
        rows = self._rows | stored(self.database, after, self.base.entities.dtype)
        present = self.database.inserted()
        self._rows = {name: rows[name] for name in present if name in rows}
        self._forget()

    def _last_change(self) -> int:
        return int(self.database.read("SELECT max(id) FROM change")[0][0])

    def _forget(self) -> None:
        """Derive again, when it is needed, what the tables say."""
        self._now = self._known_triples = self._known_names = self._known_relations = None

    def _as_known(self, facts: Mapping[Fact, float | None]) -> dict[Fact, float | None]:
        """Facts by the names that are known, or else in the form in which names are compared."""
        named = dict[Fact, float | None]()
        for (head, relation, tail), confidence in facts.items():
            label = self._relations.same(relation) or clean(relation)
            first, last = (self._known.same(end) or clean(end) for end in (head, tail))
            named[first, label, last] = confidence
        return named

    def _refuse_unknown(self, facts: Iterable[Fact], new: Collection[str]) -> None:
        """``InputError`` for a fact with an unknown name that is not among the new ones."""
        for fact in facts:
            place = " ".join(fact)[:80]
            for end in (fact[0], fact[2]):
                if end not in new:
                    self._known.find(end, place)
            self._relations.find(fact[1], place)

    def _queried(self, name: str, notes: list[str] | None = None) -> str:
        """The known entity that a question is about; without ``notes``, a warning says which."""
        note = partial(warnings.warn, stacklevel=4) if notes is None else notes.append
        return self.now.names.queried(name, note)

    def _same_words(self, name: str) -> str | None:
        """The known entity with the words of a new one, if there is one."""
        words = self.groups.words(name, None)
        if words.nearest is None or (words.cosine or 0.0) <= SAME:
            return None
        return self.base.entity_names[words.nearest]

    def _inserted(self, name: str) -> str:
        """The name of an inserted entity; InputError for another one."""
        if name not in self._rows:
            there = ", ".join(self._rows)[:120] or "none"
            raise InputError(
                repr(name)[:80],
                "",
                f"expected an entity that was inserted ({there}): known ones stay",
            )
        return name

    def _curve(self, entity: int, relation: int, slot: int) -> Curve | None:
        """What turns scores of answers to a query about an entity into probabilities."""
        if entity < len(self.base.entities):
            if relation >= len(self.base.relations):
                return None
            if (relation, slot) not in self._known_curves:
                self._known_curves[relation, slot] = fit_curve(self.base, relation, slot)
            return self._known_curves[relation, slot]
        row = self._rows[self.now.entity_names[entity]]
        curves = self.groups.choice(row.conditions).curves
        return (
            None
            if curves is None
            else lambda scores: curves(scores, torch.full(scores.shape, relation))
        )


def open_home(folder: str | Path, durability: Durability = "full") -> Home:
    """Open the home of a folder, as ``isi train``, ``isi import`` or ``save`` writes it.

    Several processes and threads may use a home at once, to read and to write.

    Args:
        durability: ``full``: a change is on the disk when it returns; ``memory``: changes stay in
            this object.

    Raises:
        InputError: the home is missing or broken.

    Example:
        >>> home.save("the home")
        >>> with isi.open("the home") as opened:
        ...     opened.tell([("mug", "in", "kitchen")]).inserted
        ['mug']
        >>> isi.open("the home").ask("mug", "in").answers[0].entity
        'kitchen'
    """
    path = Path(folder)
    check(durability, Durability, "", "argument 'durability'")  # type: ignore[arg-type]
    database = Database.opened(path, durability)
    try:
        with database.snapshot():
            return Home(database.bundle(), database)
    except BaseException:
        database.close()
        raise


def _with_own_words(loaded: LoadedEmbedding) -> LoadedEmbedding:
    """What a home has, with words that can be had here; one without was found to have none."""
    return loaded if loaded.words is None else with_words(loaded)


def _whole(facts: Any) -> Any:
    """Facts that can be read twice."""
    return list(facts) if isinstance(facts, Iterator) else facts


def _is_mapping(value: object) -> bool:
    return isinstance(value, Mapping)


def _fact_of(row: StoredFact) -> Fact:
    return row.fact


def _names(entities: str | Sequence[str]) -> list[str]:
    """Names, cleaned, once each."""
    if isinstance(entities, str):
        return [clean(entities)]
    with naming_argument("entities"):
        listed: list[str] = as_list(entities, str, "a list of names")
    return list(dict.fromkeys(clean(name) for name in listed))
