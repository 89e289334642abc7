"""A home: a trained embedding that is told of entities and facts, and answers.

The rows of trained entities never change. The vector of an inserted entity is a function of its
facts: it is computed again from all of them whenever one comes or goes, in whatever order they
came. Inserted entities are no indicators of each other. Those that share a fact are inserted
together (``isi.insertion.engine``).

What holds is what the tables of the database say (``isi.home.database``). A verb writes there;
``isi.home.derived`` follows, and questions are about that.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self, Unpack

from tqdm import tqdm

from isi.config import check
from isi.errors import InputError
from isi.home import folder as folders
from isi.home.bundle import Bundle
from isi.home.changes import About, Effect, Stamp, TellOptions, When, checked_facts, names_in
from isi.home.database import Database
from isi.home.derived import Derived, Edit, with_own_words
from isi.home.folder import Durability
from isi.home.loaded import LoadedEmbedding
from isi.home.phrases import with_words
from isi.home.questions import Questions, names_of, one_at_a_time, reads
from isi.names import clean


@contextmanager
def _change(home: Home) -> Iterator[None]:
    before = home.derived
    try:
        with home.database.transaction():
            yield
    except BaseException:
        home.derived = before.outdated()
        raise


changes = one_at_a_time(_change)


class Home(Questions):
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

        ``database``: of the bundle; None: one in memory.
        """
        loaded = bundle if isinstance(bundle, LoadedEmbedding) else LoadedEmbedding(**vars(bundle))
        loaded = with_words(loaded) if database is None else with_own_words(loaded)
        super().__init__(database or folders.create(loaded), loaded)

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
        options = check(about, TellOptions, "", "tell")
        names = names_of(entities)
        told = self.derived.as_known(checked_facts(facts, options.confidence))
        named = names_in(told, names)
        self._refuse_texts_of_others(options, named)
        edit = self._edit("tell", options)
        new = [name for name in named if self.derived.names.same(name) is None]
        edit.insert_entities(new, options)
        edit.add_relations(told)
        edit.add_facts(told)
        return self._finished(edit)

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
        names, facts = names_of(entities), _whole(facts)
        if isinstance(facts, Mapping) and not any(map(_is_mapping, facts.values())):
            if len(names) != 1 and facts:
                expected = "expected facts by name: tails by relation are of one entity"
                raise InputError("facts", "", expected)
            facts = dict.fromkeys(names, facts)
        present = [name for name in names if self.derived.names.same(name) is not None]
        if present and not upsert:
            refused = f"expected a new name: {present[0]!r:.80} is known; use tell"
            raise InputError(repr(present[0])[:80], "", refused)
        self.derived.refuse_unknown(self.derived.as_known(checked_facts(facts)), names)
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
            self.derived.refuse_unknown(self.derived.as_known(checked_facts(facts)))
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
        told = self.derived.as_known({(head, relation, tail): None})
        (fact,) = told
        edit = self._edit("move", stamp)
        self.derived.refuse_unknown(told)
        replaced = [row.fact for row in self.database.facts_of(fact[0])]
        replaced = [other for other in replaced if other[:2] == fact[:2]]
        if instead_of is not None:
            replaced = [(*fact[:2], self.derived.names.same(instead_of) or clean(instead_of))]
        for other in replaced:
            if other != fact:
                self.database.take_fact(edit.number, other)
        edit.add_facts(told)
        return self._finished(edit)

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
        names, lost = names_of(entities), self.derived.as_known(checked_facts(facts))
        edit = self._edit("remove", stamp)
        self.derived.refuse_unknown(lost)
        for fact in lost:
            self.database.take_fact(edit.number, fact)
        for name in names:
            known = self.derived.names.find(name)
            self.database.remove_entity(edit.number, self.derived.inserted(known))
        return self._finished(edit)

    @changes
    def undo(self, **stamp: Unpack[When]) -> Effect:
        """Take the last change back, a second time the one before;
        an ``InputError`` if there is none since training.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen")])
            >>> home.undo().removed
            ['mug']
        """
        edit = self._edit("undo", stamp)
        self.database.put_back(edit.number)
        return self._finished(edit)

    def _edit(self, verb: str, stamp: Stamp | When) -> Edit:
        return Edit(self.database, self.derived, verb, stamp)

    def _finished(self, edit: Edit) -> Effect:
        self.derived, effect = edit.finish()
        return effect

    def prepare(self, progress: bool = False) -> None:
        """Choose initializers and fit the curves of probabilities now, in some seconds, so that no
        later insertion waits for that. The choices are stored.

        Without it, the first insertion with a number of facts makes the choice for this number.
        """
        with self._lock:
            self.derived = self.derived.current()
            waiting = self.derived.choices.preparation()
        bar = tqdm(waiting, "initializers", leave=False, disable=None if progress else True)
        for conditions in bar:
            with self._lock:
                self.derived = self.derived.current()
                self.derived.choices.choice(conditions)

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
            folders.write_to(Path(folder), self.database, self.base)

    def train_again(self, bundle: Bundle) -> None:
        """Make a newly trained embedding that of this home; ``isi.train(home)`` calls it."""
        loaded, before = with_words(LoadedEmbedding(**vars(bundle))), self.derived
        training = folders.training(self.database, loaded, keep=True)
        with self._lock:
            try:
                with training as change:
                    self.derived = Derived(self.database, loaded).with_all_inserted(change)
            except BaseException:
                self.derived = before.outdated()
                raise

    def close(self) -> None:
        """Close the home. What is done with it afterwards is an ``InputError``."""
        with self._lock:
            self.database.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _refuse_texts_of_others(self, options: TellOptions, named: Collection[str]) -> None:
        """``InputError`` for a definition or a kind by a name that is neither told nor known."""
        for argument, texts in (("definition", options.definition), ("kind", options.kind)):
            for name in texts if isinstance(texts, Mapping) else ():
                if clean(name) not in named and self.derived.names.same(name) is None:
                    expected = f"expected names of entities that are told, got {name!r:.80}"
                    raise InputError(f"argument {argument!r}", "", expected)


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
    database = folders.opened(path, durability)
    try:
        with database.snapshot():
            return Home(folders.trained(database), database)
    except BaseException:
        database.close()
        raise


def _whole(facts: Any) -> Any:
    """Facts that can be read twice."""
    return list(facts) if isinstance(facts, Iterator) else facts


def _is_mapping(value: object) -> bool:
    return isinstance(value, Mapping)
