"""A live embedding: a bundle to which entities and facts are added, from which they are removed,
and that answers.

The rows of known entities never change. The vector of an inserted entity is a function of its
facts: it is computed again from all of them whenever one comes or goes, in whatever order they
came. Inserted entities are no indicators of each other. Those that share a fact are inserted
together (``isi.insertion.engine``).
"""

from __future__ import annotations

import warnings
from collections import ChainMap
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
import torch

from isi.config import plain_number, plain_numbers
from isi.errors import InputError, at, short
from isi.graph.graph import HEAD, TAIL
from isi.insertion.arguments import TripleForms, is_whole
from isi.insertion.interference import Interference, measure
from isi.live import folder as folders
from isi.live import journal as journals
from isi.live import stored
from isi.live.answers import Answers, Curve, answer, answer_relation, fit_curve
from isi.live.explain import Explanation, Report, Snapshot, explain, report
from isi.live.folder import Bundle
from isi.live.groups import EntityGroups, InsertedEntity, with_rows
from isi.live.journal import (
    Alteration,
    Change,
    Effect,
    Journal,
    Line,
    NewEntity,
    Selected,
)
from isi.live.loaded import Fact, LoadedEmbedding, Query, as_facts, open_bundle
from isi.live.names import KnownNames, check_new
from isi.live.phrases import SAME, phrase_vectors
from isi.live.stored import StoredVector
from isi.models.stack import usual_torch
from isi.names import clean, loose, plain

#: Changes, after which the computed vectors are written, in case the process is killed.
STORED_EVERY = 100


class LiveEmbedding:
    """An embedding that lives with a robot. ``isi.open``, ``isi.train`` and
    ``isi.from_pykeen`` make one.

    Facts are triples of names in any form that ``isi.insert`` accepts. An ``InputError`` refuses an
    unknown name, suggests similar ones, and changes nothing. In questions, case counts little, and
    so do spaces, hyphens and underscores between letters: if one known name alone differs in
    nothing else, the answer is about it, and a warning says so.

    Example:
        >>> import isi
        >>> facts = [(name, "in", "kitchen") for name in ("cup", "pan", "fork")]
        >>> facts += [(name, "in", "bedroom") for name in ("bed", "lamp", "desk")]
        >>> home = isi.train(facts, model="distmult", dimension=4)
        >>> home.insert("mug", {"in": "kitchen"}).inserted
        ['mug']
        >>> home.ask("mug", "in").answers[0].entity
        'kitchen'
        >>> home.undo().removed
        ['mug']
    """

    @usual_torch()
    def __init__(
        self,
        bundle: Bundle,
        lines: Sequence[Line] | None = None,
        folder: Path | None = None,
        vectors: Path | None = None,
        journal: Journal | None = None,
    ) -> None:
        """Use ``isi.open``. ``lines``: those of the journal;
        None: the bundle's own records of insertions.
        """
        #: takes the sentence that says which name a question was understood to have
        self.note: Callable[[str], object] = partial(warnings.warn, stacklevel=4)
        opened = bundle if isinstance(bundle, LoadedEmbedding) else LoadedEmbedding(**vars(bundle))
        records = opened.manifest.inserted
        listed = list(journals.from_records(opened)) if lines is None else list(lines)
        numbered = [
            (line, number) for number, line in enumerate(listed, 1) if isinstance(line, Change)
        ]
        self.folder, self.changes = folder, [change for change, _ in numbered]
        known = opened.part(np.arange(len(opened.entities) - len(records)))
        added = _added_later(self.changes, known)
        #: what the folder's other files have and the embedding was not trained on
        self._written_facts = (
            [fact for fact in known.named_triples() if fact in added] if added else []
        )
        self._written_entities = len(records)
        known = replace(known, triples=known.triples_without(added))
        phrases = phrase_vectors(known, vectors)
        self._words = known.words  #: as ``save`` writes them
        if phrases and vectors:
            manifest = known.manifest.model_copy(update={"words": phrases.origin})
            known, self._words = replace(known, manifest=manifest), phrases.known
        #: the known entities, with the triples that the embedding was trained on
        self.base: LoadedEmbedding = (
            known if phrases is None else replace(known, words=phrases.known)
        )
        chosen = {(line.facts, line.words): line for line in listed if isinstance(line, Selected)}
        self._listed = len(chosen)  # choices that are in the journal, or pending
        self.groups = EntityGroups(self.base, phrases, chosen)
        self._known_curves = dict[tuple[int, int], Curve | None]()  # by relation and slot
        self.groups.stored = stored.read(folder) if folder else {}
        file = folder / folders.JOURNAL if folder and lines is not None else None
        self.additions = journals.replayed(
            self.changes, self.base, file, [number for _, number in numbered]
        )
        self._rows = self.groups.insert_groups(self.additions, self.additions.entities.keys())
        self._rows = {name: self._rows[name] for name in self.additions.entities}
        self._fact_ids = self._ids_now(self.additions.facts)
        self._journal, self._pending, self._on_disk = journal, list[Line](), len(lines or ())
        self._unchanged = len(self.changes)
        self._append(self.changes if lines is None else [])

    # -- changes -----------------------------------------------------------------------------------

    def insert(
        self,
        entities: str | Sequence[str],
        facts: Any = (),
        *,
        definition: str | Mapping[str, str] | None = None,
        kind: str | Mapping[str, str] | None = None,
        initializer: str | None = None,
        options: Mapping[str, Any] | None = None,
        seed: int = 0,
        new: bool = False,
        upsert: bool = False,
        time: datetime | None = None,
        source: str | None = None,
    ) -> Effect:
        """Insert one or more new entities with their facts.

        Args:
            entities: a name, or several.
            facts: triples; for one entity also its tails by relation,
                ``{"atLocation": "kitchen"}``; for several, these by name.
            definition: a sentence for the word vector; by name for several entities. So is
                ``kind``; without it, the kind follows from the facts, or else from the most similar
                words.
            initializer: None: the best for hidden known entities with as many facts. ``options``
                replace its defaults.
            seed: of a random initializer.
            new: insert a name that looks like a known one ("Forks" beside "fork").
            upsert: of an entity that is known already, only the facts are added.
            time: when it was observed; None: now. ``source``: what reported it.

        Example:
            >>> facts = [("mug", "in", "kitchen"), ("sofa", "in", "bedroom")]
            >>> effect = home.insert(["mug", "sofa"], facts)
            >>> effect.inserted, effect.facts
            (['mug', 'sofa'], 2)
        """
        names = [entities] if isinstance(entities, str) else list(entities)
        for argument, each in {"definition": definition, "kind": kind}.items():
            if isinstance(each, Mapping) and (others := each.keys() - set(names)):
                raise InputError(
                    argument,
                    "",
                    f"expected names of the entities to insert, got {min(others)!r:.80}",
                )
        if isinstance(facts, Mapping) and not any(
            isinstance(tails, Mapping) for tails in facts.values()
        ):
            if facts and len(names) != 1:
                expected = f"expected triples, or tails by relation for each of {len(names)} names"
                raise InputError("argument 'facts'", "", expected)
            facts = dict.fromkeys(names, facts)
        known = self._known_entities
        present = {name for name in names if upsert and known.same(name) is not None}
        kinds = KnownNames(dict.fromkeys(filter(None, self.base.kinds)))
        about, first_of = dict[str, NewEntity](), dict[str, str]()
        for name in [name for name in names if name not in present]:
            first = first_of.setdefault(loose(name), clean(name))
            if first != clean(name) and not new:
                expected = (
                    f"expected new entities that differ in more from {first!r:.80}, or new=True"
                )
                raise InputError(repr(name)[:80], "", expected)
            check_new(name, known, None if new else self._same_words(name), new)
            text, named = (
                each.get(name) if isinstance(each, Mapping) else each for each in (definition, kind)
            )
            of_kind = named and kinds.find(named, "kind", "a kind")
            with at(repr(name)[:80]):
                about[clean(name)] = NewEntity(
                    definition=text,
                    kind=of_kind,
                    initializer=initializer,
                    options=plain_numbers(dict(options or {})),
                    seed=plain_number(seed),
                )
        listed = self.now.facts(facts, list(about))
        added = self.now.unknown(listed)
        do: Literal["insert", "observe"] = "insert" if about else "observe"
        change = _checked_change(do, entities=about, facts=added, time=time, source=source)
        notes = [f"{name} is known: its facts alone are added" for name in present]
        return self._change(change, len(listed) - len(added), notes)

    def observe(
        self,
        facts: TripleForms,
        *,
        upsert: bool = False,
        time: datetime | None = None,
        source: str | None = None,
    ) -> Effect:
        """Add facts between known or inserted entities.
        Inserted ones get a new vector from all their facts.

        ``upsert``: insert entities that are not known yet. ``time`` and ``source`` are as in
        ``insert``.

        Example:
            >>> home.observe([("lamp", "in", "kitchen")]).facts
            1
            >>> home.observe([("mug", "in", "kitchen")], upsert=True).inserted
            ['mug']
        """
        if upsert:
            ends = [end for fact in as_facts(facts) for end in (fact[0], fact[2])]
            known = self._known_entities
            unknown = [end for end in dict.fromkeys(map(clean, ends)) if known.same(end) is None]
            return self.insert(unknown, facts, time=time, source=source)
        listed = self.now.facts(facts)
        added = self.now.unknown(listed)
        change = _checked_change("observe", facts=added, time=time, source=source)
        return self._change(change, len(listed) - len(added))

    def move(
        self,
        head: str,
        relation: str,
        tail: str,
        *,
        instead_of: str | None = None,
        time: datetime | None = None,
        source: str | None = None,
    ) -> Effect:
        """Replace the facts with this head and relation by one fact:
        ``move("mug", "atLocation", "desk")``.

        ``instead_of``: replace the fact with this tail alone. An ``InputError`` refuses one that
        does not hold.

        Example:
            >>> home.move("lamp", "in", "kitchen").lost
            [('lamp', 'in', 'bedroom')]
        """
        ((head, relation, tail),) = self.now.facts([(head, relation, tail)])
        ids = self.now.entity_ids
        query = Query(ids[head], self.now.relation_ids[relation], TAIL)
        tails = [self.now.entity_names[row] for row in sorted(self.now.answers(query))]
        if instead_of is not None:
            old = self._entity(instead_of)
            if old not in tails:
                place = f"{head} {relation} {old}"
                raise InputError("", place, "expected a fact that holds, which is to be replaced")
            gone = [old]
        else:
            gone = tails
        replaced = [(head, relation, old) for old in gone if old != tail]
        facts = [] if tail in tails else [(head, relation, tail)]
        change = _checked_change("move", facts=facts, replaced=replaced, time=time, source=source)
        return self._change(change, int(tail in tails))

    def remove(
        self,
        entities: str | Sequence[str] = (),
        facts: TripleForms = (),
        *,
        time: datetime | None = None,
        source: str | None = None,
    ) -> Effect:
        """Take inserted entities back with all their facts, or single facts.

        A fact that the embedding was trained on is retracted: it is no answer any more, and vectors
        of inserted entities are computed without it. ``undo`` brings it back, and so does
        ``observe``.

        Example:
            >>> home.remove(facts=[("lamp", "in", "bedroom")]).lost
            [('lamp', 'in', 'bedroom')]
        """
        names = [
            self._inserted(name) for name in ([entities] if isinstance(entities, str) else entities)
        ]
        listed = self.now.facts(facts)
        for fact in self.now.unknown(listed):
            raise InputError("", " ".join(fact), "expected a fact that holds")
        about = dict.fromkeys(names, NewEntity())
        return self._change(
            _checked_change("remove", entities=about, facts=listed, time=time, source=source)
        )

    def undo(self, *, time: datetime | None = None, source: str | None = None) -> Effect:
        """Take the last change back, a second time the one before;
        an ``InputError`` if there is none.

        Example:
            >>> effect = home.insert("mug", {"in": "kitchen"})
            >>> home.undo().removed
            ['mug']
        """
        if not self.additions.done:
            raise InputError("undo", "", "there is no change to take back")
        return self._change(_checked_change("undo", time=time, source=source))

    @property
    def history(self) -> list[Change]:
        """All changes since training, those that were undone included.

        Example:
            >>> effect = home.insert("mug", {"in": "kitchen"})
            >>> [(change.do, change.added) for change in home.history]
            [('insert', [('mug', 'in', 'kitchen')])]
        """
        return list(self.changes)

    def compact(self) -> int:
        """Leave out of the journal what later changes have taken back;
        the number of lines that are gone.

        The state stays, with the time and source of each fact. ``undo`` then reaches the changes
        that remain.

        Example:
            >>> effect = home.insert("mug", {"in": "kitchen"})
            >>> effect = home.undo()
            >>> home.compact(), home.history
            (2, [])
        """
        if self.folder and not self._journal:
            raise InputError(
                "compact", "", "expected an embedding that was opened with journal=True"
            )
        changes = journals.compacted(self.changes, self._written_facts)
        lines: list[Line] = [*self.groups.selected.values(), *changes]
        gone = len(self.changes) - len(changes)
        # without lines, the entities in the folder count
        is_unread = self._written_entities and not lines
        if gone < 0 or is_unread or changes == self.changes:
            return 0
        if self._journal:
            self._journal.replace(lines)
            self._listed = len(self.groups.selected)
        self.changes, self.additions = changes, journals.additions_of(changes)
        self._number_facts()
        return gone

    @usual_torch()
    def prepare(self) -> None:
        """Choose initializers and fit curves now, in some seconds,
        so that no later call waits for that.

        Without it, the first insertion with a number of facts makes the choice for this number.
        ``save`` keeps the choices.
        """
        for step in self.groups.preparation():
            step()

    # -- answers -----------------------------------------------------------------------------------

    @usual_torch()
    def ask(
        self,
        head: str | None = None,
        relation: str | None = None,
        tail: str | None = None,
        top: int = 10,
    ) -> Answers:
        """The best answers to a query with one missing part: tail, head or relation.
        Facts stand first.

        An answer has a calibrated probability where known entities allow it; ``Answers.sure`` is
        false where the best one is below ``LIKELY``.

        Example:
            >>> first = home.ask("cup", "in").answers[0]
            >>> first.entity, first.rank, first.known
            ('kitchen', 1, True)
            >>> home.ask(head="cup", tail="kitchen").answers[0].entity
            'in'
        """
        _check_count(top, "top")
        if (head is None) + (relation is None) + (tail is None) != 1:
            raise InputError(
                "ask", "", "expected two of head, relation and tail: the third one is the answer"
            )
        now, given = self.now, self.additions.facts
        first, last = (
            None if name is None else now.entity_ids[self._queried(name)] for name in (head, tail)
        )
        if relation is None:
            ends = first or 0, last or 0
            # of an inserted entity if there is one
            curve_of = partial(self._curve, max(ends), slot=TAIL)
            return answer_relation(now, *ends, top, curve_of, given)
        known_relation = now.known_relations.queried(relation, "relation", "a relation", self.note)
        label = now.relation_ids[known_relation]
        query = Query(first, label, TAIL) if first is not None else Query(last, label, HEAD)  # type: ignore[arg-type]
        return self.ask_query(query, top)

    @usual_torch()
    def ask_query(
        self, query: Query, top: int, indicators: Collection[int] | None = None
    ) -> Answers:
        """The answers to a query by ids; with ``Answer.shared_by`` if ``indicators`` are given."""
        return answer(self.now, query, top, self._curve(*query), self.additions.facts, indicators)

    @usual_torch()
    def nearest(self, entity: str, number: int = 10) -> list[tuple[str, float]]:
        """The ``number`` other entities with the highest cosine to an entity, and these cosines.

        Example:
            >>> [entity for entity, cosine in home.nearest("cup", 2)]
            ['pan', 'fork']
        """
        _check_count(number, "number")
        row = self.now.entity_ids[self._queried(entity)]
        return [
            (self.now.entity_names[other], cosine)
            for other, cosine in self.now.nearest(row, number)
        ]

    @usual_torch()
    def explain(self, entity: str, top: int = 5) -> Explanation:
        """Why an inserted entity is where it is: its indicators,
        and the effect of each part of its input.

        Example:
            >>> effect = home.insert("mug", {"in": "kitchen"}, initializer="rs", options={"k": 3})
            >>> explanation = home.explain("mug")
            >>> sorted(indicator.entity for indicator in explanation.indicators)
            ['cup', 'fork', 'pan']
        """
        _check_count(top, "top")
        return explain(self._snapshot(), self._rows[self._inserted(self._queried(entity))], top)

    @usual_torch()
    def report(self, entity: str, top: int = 5) -> Report:
        """What is known and predicted about an inserted entity,
        with the ``top`` best answers to each query.

        Example:
            >>> effect = home.insert("mug", {"in": "kitchen"}, initializer="mean")
            >>> report = home.report("mug")
            >>> report.facts, report.initializer, report.why
            ([('mug', 'in', 'kitchen')], 'mean', 'as named')
        """
        _check_count(top, "top")
        name = self._inserted(self._queried(entity))
        return report(
            self._snapshot(),
            self._rows[name],
            top,
            self.ask_query,
            interference=self.interference([name], show=top),
            interference_of_all=self.interference(show=top),
        )

    def _snapshot(self) -> Snapshot:
        return Snapshot(self.now, self.groups, self.additions)

    @usual_torch()
    def interference(
        self, entities: Sequence[str] = (), most: int = 256, show: int = 5
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
        now, known = self.now, len(self.base.entities)
        if not len(self.known_triples) or not self._rows:
            return None
        chosen = [now.entity_ids[self._inserted(self._queried(name))] for name in entities]
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
    def inserted(self) -> dict[str, InsertedEntity]:
        """The inserted entities by name, in order.

        Example:
            >>> effect = home.insert("mug", {"in": "kitchen"})
            >>> list(home.inserted)
            ['mug']
        """
        return dict(self._rows)

    @cached_property
    def known_triples(self) -> np.ndarray:
        """The triples of training that hold; ids, shape (T, 3).

        Example:
            >>> home.known_triples.shape
            (6, 3)
        """
        return self.groups.known_triples(self.additions)

    @cached_property
    def now(self) -> LoadedEmbedding:
        """The bundle with all inserted entities in its last rows, and all facts that hold."""
        base, rows = self.base, list(self._rows.values())
        names, words = [row.record.entity for row in rows], base.words
        return replace(
            base,
            manifest=base.manifest.model_copy(update={"inserted": [row.record for row in rows]}),
            entities=np.concatenate([base.entities, *(row.vector[None] for row in rows)]),
            entity_names=base.entity_names + names,
            kinds=base.kinds + [row.kind for row in rows],
            phrases=base.phrases + [plain(name) for name in names],
            words=None if words is None else with_rows(words, [row.words.vector for row in rows]),
            triples=np.concatenate([self.known_triples, self._fact_ids]),
            retracted=base.ids_of(self.additions.retracted),
        )

    def save(self, folder: str | Path | None = None) -> None:
        """Append the changes, and the choices of initializers, to the journal of the folder that
        was opened, or write all into another folder.

        Example:
            >>> effect = home.insert("mug", {"in": "kitchen"})
            >>> home.save("a home")
            >>> list(isi.open("a home").inserted)
            ['mug']
        """
        path = Path(folder) if folder is not None else self.folder
        if path is None:
            raise InputError(
                "save", "", "expected a folder: this embedding was not opened from one"
            )
        if self.base.scoring is not None:
            expected = (
                "expected a model that isi has: DistMult, ComplEx, "
                "TransE or RotatE without inverse triples"
            )
            raise InputError("save", "", expected)
        if self.folder is None or path.resolve() != self.folder.resolve():
            words = self._words  # inserted entities have none: their names give them again
            words = None if words is None else np.pad(words, ((0, len(self._rows)), (0, 0)))
            # the journal retracts
            trained_too = np.concatenate([self.base.triples, self._fact_ids])
            lines: list[Line] = [*self.groups.selected.values(), *self.changes]
            folders.write(
                path, replace(self.now, words=words, triples=trained_too), journals.text_of(lines)
            )
            return
        self._append([])  # the choices since the last change, such as those of ``prepare``
        if self._pending:
            journal = Journal(path)
            try:
                if len(journals.read(path) or ()) != self._on_disk:
                    raise InputError(
                        path, "", "another process has changed this embedding: open it again"
                    )
                journal.append(self._pending)
            finally:
                journal.close()
            self._on_disk += len(self._pending)
            self._pending = []

    def close(self) -> None:
        """Let other processes change the folder."""
        if self._journal:
            if len(self.changes) != self._unchanged:
                self._store()
            self._journal.close()

    def _store(self) -> None:
        """Write the vectors into the folder, so that the next process need not compute them."""
        vectors = dict[str, StoredVector]()
        for row in self._rows.values():
            vectors[row.key] = StoredVector(row.vector, row.record.fallback)
        if self.folder and vectors and vectors.keys() != self.groups.stored.keys():
            stored.write(self.folder, vectors)
            self.groups.stored = vectors

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        sizes = self.base.sizes()
        return (
            f"LiveEmbedding({self.folder or ''}: {sizes['entities']:,} known entities,"
            f" {len(self._rows):,} inserted, {len(self.additions.facts):,} facts added to"
            f" {sizes['triples']:,}, {self.base.manifest.model_name})"
        )

    # -- inside ------------------------------------------------------------------------------------

    @usual_torch()
    def _change(self, change: Change, known: int = 0, notes: Sequence[str] = ()) -> Effect:
        """Compute what a change alters, write it to an open journal, and only then accept it."""
        if change.is_empty:
            return Effect(known=known, notes=list(notes))
        stamped = change if change.time else change.model_copy(update={"time": journals.now()})
        altered = self.additions.apply(stamped)
        try:
            computed = self.groups.insert_groups(self.additions, self._touched(altered))
            self._append([stamped])
        except BaseException:
            self.additions.revert(stamped, altered)
            raise
        old = self._rows
        self._rows = {name: computed.get(name) or old[name] for name in self.additions.entities}
        self.changes.append(stamped)
        self._accept(altered)
        if self._journal and len(self.changes) % STORED_EVERY == 0:
            self._store()
        said = [note for name in self._rows if name in computed for note in self._rows[name].notes]
        return Effect(
            inserted=[name for name in self._rows if name not in old],
            updated=[name for name in computed if name in old],
            removed=[name for name in old if name not in self._rows],
            facts=len(altered.holding),
            lost=altered.lost,
            known=known,
            notes=list(dict.fromkeys([*notes, *said])),
        )

    def _touched(self, altered: Alteration) -> set[str]:
        """The inserted entities whose input a difference alters:
        all, if it alters facts of training.
        """
        if altered.retracted or altered.restored:
            return set(self.additions.entities)
        facts = altered.added + altered.dropped
        ends = {end for fact in facts for end in (fact[0], fact[2])}
        return (ends | altered.inserted.keys()) & self.additions.entities.keys()

    def _accept(self, altered: Alteration) -> None:
        """Bring what is derived from the additions up to date,
        in a time that hardly grows with their number.
        """
        before = self.now
        self.__dict__.pop("now")
        if altered.retracted or altered.restored:
            self.__dict__.pop("known_triples", None)
        if altered.removed or altered.order:  # entities behind them have other ids
            self._number_facts()
            return
        dropped = before.keys_of(before.ids_of(altered.dropped))
        left = self._fact_ids[~np.isin(before.keys_of(self._fact_ids), dropped)]
        self._fact_ids = np.concatenate([left, self._ids_now(altered.added)])

    def _number_facts(self) -> None:
        """Compute the ids of all added facts again."""
        self.__dict__.pop("now", None)
        self._fact_ids = self._ids_now(self.additions.facts)

    def _ids_now(self, facts: Iterable[Fact]) -> np.ndarray:
        """Facts as ids, with the present inserted entities; shape (F, 3), int64."""
        first = len(self.base.entities)
        inserted = {name: row for row, name in enumerate(self._rows, first)}
        ids, labels = ChainMap(inserted, self.base.entity_ids), self.base.relation_ids
        rows = [(ids[head], labels[relation], ids[tail]) for head, relation, tail in facts]
        return np.array(rows, np.int64).reshape(-1, 3)

    def _append(self, changes: Sequence[Change]) -> None:
        """List choices that are new, and changes, in the journal if it is open."""
        choices = list(self.groups.selected.values())
        lines: list[Change | Selected] = [*choices[self._listed :], *changes]
        if self._journal and lines:
            self._journal.append(lines)
        elif not self._journal:
            self._pending += lines
        self._listed = len(choices)

    @property
    def _known_entities(self) -> KnownNames:
        """The names of all entities."""
        return KnownNames(self._rows, self.base.known_entities)

    def _entity(self, name: str) -> str:
        return self._known_entities.find(name, "entity", "an entity")

    def _queried(self, name: str) -> str:
        """The known entity that a question is about."""
        return self._known_entities.queried(name, "entity", "an entity", self.note)

    def _same_words(self, name: str) -> str | None:
        """The known entity with the words of a new one, if there is one."""
        words = self.groups.words(name, NewEntity())
        if words.nearest is None or (words.cosine or 0.0) <= SAME:
            return None
        return self.base.entity_names[words.nearest]

    def _inserted(self, name: str) -> str:
        """The name of an inserted entity; InputError for another one."""
        known = self._entity(name)
        if known not in self._rows:
            there = ", ".join(self._rows)[:120] or "none"
            raise InputError(
                repr(known)[:80],
                "",
                f"expected an entity that was inserted ({there}): known ones stay",
            )
        return known

    def _curve(self, entity: int, relation: int, slot: int) -> Curve | None:
        """What turns scores of answers to a query about an entity into probabilities."""
        if entity < len(self.base.entities):
            if (relation, slot) not in self._known_curves:
                self._known_curves[relation, slot] = fit_curve(self.base, relation, slot)
            return self._known_curves[relation, slot]
        curves = self.groups.curves(self._rows[self.now.entity_names[entity]])
        return (
            None
            if curves is None
            else lambda scores: curves(scores, torch.full(scores.shape, relation))
        )


def open_live(
    folder: str | Path, *, vectors: str | Path | None = None, journal: bool = False
) -> LiveEmbedding:
    """Open the folder of a bundle, as ``isi train``, ``isi import`` or the pipeline writes it.

    Args:
        vectors: a word2vec or GloVe file, whose word vectors replace those of the bundle.
        journal: write each change to the folder's journal before it counts, and refuse other
            processes meanwhile.

    Raises:
        InputError: the folder or its journal is missing or broken, or open in another process.

    Example:
        >>> home.save("the home")
        >>> with isi.open("the home", journal=True) as opened:
        ...     opened.insert("mug", {"in": "kitchen"}).inserted
        ['mug']
        >>> isi.open("the home").ask("mug", "in").answers[0].entity
        'kitchen'
    """
    path, opened = Path(folder), open_bundle(Path(folder))
    words = Path(vectors) if vectors else None
    lock = Journal(path) if journal else None  # then the journal is complete
    try:
        return LiveEmbedding(opened, journals.read(path), path, words, lock)
    except BaseException:
        if lock:
            lock.close()
        raise


def _check_count(value: int, name: str) -> None:
    if not is_whole(value) or value < 1:
        expected = "expected a whole number from 1"
        raise InputError(f"argument {name!r}", "", f"{expected}, got {short(value)}")


def _checked_change(do: str, **fields: Any) -> Change:
    """A change; an ``InputError`` refuses a time or a source that is none."""
    with at(do):
        return Change.model_validate({"do": do, **fields})


def _added_later(changes: Sequence[Change], known: LoadedEmbedding) -> set[Fact]:
    """The triples of a bundle that changes have added:
    those that a change adds before any removes them.
    """
    first = dict[Fact, bool]()
    for change in changes:
        for fact in change.removed:
            first.setdefault(fact, False)
        for fact in change.added:
            first.setdefault(fact, True)
    names = known.entity_ids.keys()
    return {
        fact
        for fact, is_added in first.items()
        if is_added and {fact[0], fact[2]} <= names and fact[1] in known.relation_ids
    }
