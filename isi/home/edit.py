"""A change of a home while it is made: the names that are meant, and the rows that it writes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from datetime import datetime

from isi.config import check
from isi.errors import InputError, at
from isi.home.bundle import Fact
from isi.home.changes import Effect, changes_of, effect_of
from isi.home.database import Database
from isi.home.derived import Derived
from isi.home.times import as_text
from isi.home.verbs import Tell
from isi.names import clean
from isi.vocabulary import NewName, Vocabulary, loose


class Edit:
    """A change of a home while it is made, in a transaction."""

    def __init__(
        self,
        database: Database,
        derived: Derived,
        verb: str,
        time: datetime | None,
        source: str | None,
    ) -> None:
        """List the change; ``derived``: what stands before it."""
        self.database, self.derived = database, derived
        self.time = as_text(time) if time else database.next_time()
        self.source = source
        self.number = database.add_change(verb, self.time, source)
        self.new_entities = dict[str, str]()  #: names that are not known, by their loose form
        self.new_relations = dict[str, str]()
        self.notes = list[str]()

    # -- names -------------------------------------------------------------------------------------

    def entity(self, text: str) -> str:
        """The known name that a text is or may mean, or else a new one: of several spellings, the
        first.
        """
        return self._named(text, self.derived.names, self.new_entities)

    def relation(self, text: str) -> str:
        """As ``entity``, for a relation."""
        return self._named(text, self.derived.relations, self.new_relations)

    def _named(self, text: str, known: Vocabulary, new: dict[str, str]) -> str:
        name = known.taken_for(text, self.notes.append)
        if name is not None:
            return name
        check(clean(text), NewName, "", known.kind)
        return new.setdefault(loose(text), clean(text))

    def named(self, facts: Mapping[Fact, float | None]) -> dict[Fact, float | None]:
        """Facts by the names that are meant."""
        return {
            (self.entity(head), self.relation(relation), self.entity(tail)): confidence
            for (head, relation, tail), confidence in facts.items()
        }

    def refuse_new(self, entities: bool = True) -> None:
        """``InputError`` for a relation that is not known; and for such an entity, too, if asked
        for.
        """
        for name in self.new_entities.values() if entities else ():
            self.derived.names.find(name)
        for name in self.new_relations.values():
            self.derived.relations.find(name)

    # -- rows --------------------------------------------------------------------------------------

    def insert_entities(self, options: Tell) -> None:
        """Insert the entities that are not known."""
        kinds = Vocabulary("kind", self.derived.base.kind_numbers)
        definitions = self._by_name("definition", options.definition)
        kind_texts = self._by_name("kind", options.kind)
        for name in self.new_entities.values():
            kind = kind_texts.get(name)
            with at(repr(name)[:80]):
                kind = None if kind is None else kinds.find(kind)
            about = {
                "definition": definitions.get(name),
                "kind": kind,
                "initializer": options.initializer,
                "options": dict(options.options or {}),
                "seed": options.seed,
            }
            self.database.add_entity(self.number, name, about)

    def _by_name(self, argument: str, texts: str | Mapping[str, str] | None) -> Mapping[str, str]:
        """Texts by the names of new entities. ``InputError`` for a name that is neither new nor
        known.
        """
        if not isinstance(texts, Mapping):
            return {} if texts is None else dict.fromkeys(self.new_entities.values(), texts)
        named = dict[str, str]()
        for typed, text in texts.items():
            name = self.new_entities.get(loose(typed)) or self.derived.names.same(typed)
            if name is None:
                expected = f"expected names of entities that are told, got {typed!r:.80}"
                raise InputError(f"argument {argument!r}", "", expected)
            named[name] = text
        return named

    def add_relations(self, facts: Iterable[Fact]) -> None:
        """Insert the relations that two or more facts have and that are not known."""
        numbers = Counter(fact[1] for fact in facts)
        for name in self.new_relations.values():
            if numbers[name] < 2:
                expected = "expected a known relation, or two facts or more of a new one"
                hint = self.derived.relations.hint(name)
                raise InputError(repr(name)[:80], "", expected + hint)
            self.database.add_relation(self.number, name)

    def add_facts(self, facts: Mapping[Fact, float | None]) -> None:
        """Let facts hold. One of a functional relation takes the place of others with its head."""
        functional = self.derived.base.manifest.functional
        tails = dict[tuple[str, str], str]()
        for head, relation, tail in facts:
            if relation in functional and tails.setdefault((head, relation), tail) != tail:
                expected = f"expected one tail of {relation}, got {tails[head, relation]!r:.80}"
                raise InputError(f"{head!r:.80}", "", f"{expected} and {tail!r:.80}")
        for (head, relation), tail in tails.items():
            self.replace(head, relation, tail)
        for fact, confidence in facts.items():
            self.database.put_fact(self.number, fact, self.time, self.source, confidence)

    def replace(self, head: str, relation: str, tail: str) -> None:
        """Let the facts with a head and a relation hold no longer, but the one with a tail."""
        for row in self.database.facts_of(head):
            if row.fact[:2] == (head, relation) and row.tail != tail:
                self.database.take_fact(self.number, row.fact)

    # -- what follows ------------------------------------------------------------------------------

    def finish(self) -> tuple[Derived, Effect]:
        """Write the vectors that follow from what was done. What stands then, and what the change
        did; one without an effect is not listed.
        """
        (change,) = changes_of(self.database, self.number)
        if not change.has_effect:
            self.database.remove_change(self.number)
            return self.derived, Effect(notes=self.notes)
        derived, computed = self.derived.after(change)
        of_entities = [note for entity in computed.values() for note in entity.notes]
        notes = [*self.notes, *of_entities, *derived.choices.warnings()]
        return derived, effect_of(change, list(computed), notes)
