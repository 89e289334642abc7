"""A home: a trained embedding that is told of entities and facts, and answers.

The rows of trained entities never change. The vector of an inserted entity is a function of its
facts: it is computed again from all of them whenever one comes or goes, in whatever order they
came. Inserted entities are no indicators of each other. Those that share a fact are inserted
together (``isi.insertion.engine``).

What holds is what the tables of the database say (``isi.home.database``). A verb writes there;
``isi.home.derived`` follows, and questions are about that.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

from isi.config import check
from isi.errors import InputError, at
from isi.home import folder as folders
from isi.home.bundle import Bundle, with_functional
from isi.home.changes import Effect, changes_of, checked_facts, effect_of
from isi.home.choices import Choices
from isi.home.connection import DatabaseFailure, patiently
from isi.home.database import Database
from isi.home.derived import Derived, with_own_words
from isi.home.edit import Edit
from isi.home.folder import Durability
from isi.home.inserted import Key
from isi.home.loaded import LoadedEmbedding
from isi.home.phrases import with_words
from isi.home.questions import Questions, one_at_a_time, reads
from isi.home.times import time_before
from isi.home.undo import forget, last_change_of, put_back
from isi.home.verbs import Forget, Move, Remove, Tell, Train, Undo, Verb, checked

if TYPE_CHECKING:  # what trains needs PyTorch
    from isi.insertion.arguments import TripleForms
    from isi.training.recipe import TrainingSummary


@contextmanager
def _change(home: Home) -> Iterator[None]:
    before = home.derived
    try:
        with home.database.transaction(waiting=0):
            home.derived = before = before.current()
            yield
    except DatabaseFailure as error:
        if not error.is_locked:
            home.derived = before.outdated()
        raise
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
        >>> home = isi.train(facts, dimension=4)
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
        new: Literal["insert", "refuse"] = "insert",
        definition: str | Mapping[str, str] | None = None,
        kind: str | Mapping[str, str] | None = None,
        confidence: float | None = None,
        initializer: str | None = None,
        options: Mapping[str, Any] | None = None,
        seed: int = 0,
        time: datetime | str | float | None = None,
        source: str | None = None,
    ) -> Effect:
        """Tell facts: what is not known yet is inserted, and what is known is seen once more.

        A name means the known one that differs in case, or in spaces, hyphens and underscores
        between letters, alone (``CoffeeMachine``: coffee machine); ``Effect.notes`` say so. A
        relation that is not known is new if two or more of the facts have it. A fact of a
        functional relation takes the place of the others with its head.

        Args:
            facts: triples by name; a fourth part is a confidence.
            entities: further new entities, which are inserted by their words alone.
            new: ``refuse``: names that are not known are an error.
            definition: a sentence for the word vector; by name for several entities.
            kind: so is this; None: it follows from the facts, or else from the most similar words.
            confidence: how far the facts are believed, above 0 and at most 1; MAP weighs them by
                it.
            initializer: None: the best for hidden known entities with as many facts.
            options: replace its defaults.
            seed: of a random initializer.
            time: when it was seen; None: now. Without a zone, it is local time.
            source: what reported it.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen"), ("lamp", "in", "bedroom")])
            >>> effect.inserted, effect.facts, effect.seen
            (['mug'], 1, 1)
            >>> home.tell([("Mug", "in", "bedroom")]).notes[0]
            "'Mug' is taken for 'mug'"
        """
        verb = checked(Tell, locals())
        edit = self._edit(verb)
        for name in verb.entities:
            edit.entity(name)
        named = edit.named(checked_facts(facts, verb.confidence))
        if verb.new == "refuse":
            edit.refuse_new()
        edit.insert_entities(verb)
        edit.add_relations(named)
        edit.add_facts(named)
        return self._finished(edit)

    @changes
    def move(
        self,
        head: str,
        relation: str,
        tail: str,
        *,
        instead_of: str | None = None,
        time: datetime | str | float | None = None,
        source: str | None = None,
    ) -> Effect:
        """Replace the facts with this head and relation by one fact:
        ``move("mug", "atLocation", "desk")``. A tail that is not known yet is inserted.

        ``instead_of``: replace the fact with this tail alone. An ``InputError`` refuses one that
        does not hold.

        Example:
            >>> home.move("lamp", "in", "kitchen").lost
            [('lamp', 'in', 'bedroom')]
        """
        verb = checked(Move, locals())
        edit = self._edit(verb)
        named = edit.named({(verb.head, verb.relation, verb.tail): None})
        ((head, relation, tail),) = named
        self.derived.names.find(head)
        edit.refuse_new(entities=False)
        edit.insert_entities(checked(Tell, {}))
        if verb.instead_of is None:
            edit.replace(head, relation, tail)
        else:
            replaced = head, relation, edit.entity(verb.instead_of)
            if replaced[2] != tail:
                self.database.take_fact(edit.number, replaced)
        edit.add_facts(named)
        return self._finished(edit)

    @changes
    def remove(
        self,
        entities: str | Sequence[str] = (),
        facts: Any = (),
        *,
        time: datetime | str | float | None = None,
        source: str | None = None,
    ) -> Effect:
        """Take inserted entities back with all their facts, or single facts.

        A fact that the embedding was trained on is retracted: it is no answer any more, and vectors
        of inserted entities are computed without it. ``undo`` brings it back, and so does
        ``tell``.

        Example:
            >>> home.remove(facts=[("lamp", "in", "bedroom")]).lost
            [('lamp', 'in', 'bedroom')]
        """
        verb = checked(Remove, locals())
        edit = self._edit(verb)
        lost = edit.named(checked_facts(facts))
        names = dict.fromkeys(edit.entity(name) for name in verb.entities)
        edit.refuse_new()
        for fact in lost:
            self.database.take_fact(edit.number, fact)
        for name in names:
            self.database.remove_entity(edit.number, self.derived.inserted(name))
        return self._finished(edit)

    def undo(
        self,
        *,
        change: int | None = None,
        source: str | None = None,
        dry: bool = False,
        time: datetime | str | float | None = None,
    ) -> Effect:
        """Take the last change back, a second time the one before; an ``InputError`` if there is
        none since training.

        An older change is taken back as if it had not been made: what later changes told stays. An
        ``InputError`` names a later one that needs it.

        Args:
            change: the number of the change to take back, as ``history`` lists it.
            source: take back the last change that this has reported.
            dry: say what would be taken back, without new vectors, and change nothing.
            time: when it is done; None: now.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen")], source="camera")
            >>> effect = home.tell([("lamp", "in", "kitchen")], source="Ann")
            >>> home.undo(source="camera").removed
            ['mug']
        """
        verb = checked(Undo, locals())
        return self._would_undo(verb) if dry else self._undo(verb)

    @changes
    def _undo(self, verb: Undo) -> Effect:
        edit = self._edit(verb)
        put_back(self.database, edit.number, _target(self.database, verb))
        return self._finished(edit)

    @reads
    def _would_undo(self, verb: Undo) -> Effect:
        with Database() as copy:
            self.database.copy_into(copy)
            number = copy.add_change(verb.name(), copy.next_time())
            put_back(copy, number, _target(copy, verb))
            (change,) = changes_of(copy, number)
        return effect_of(change)

    def forget(self, older: timedelta | str) -> int:
        """Drop the changes from the history that are older than some time, such as ``7d``, and give
        their space back; their number. What holds stays as it is. They cannot be undone.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen")])
            >>> home.forget("30d"), len(home.history())
            (0, 1)
        """
        verb = checked(Forget, locals())
        return patiently(partial(self._forget, time_before(verb.older)))

    def _forget(self, time: str) -> int:
        with self._lock:
            return forget(self.database, time)

    def _edit(self, verb: Verb) -> Edit:
        fields = dict(verb)
        source = None if isinstance(verb, Undo) else fields["source"]
        return Edit(self.database, self.derived, verb.name(), fields["time"], source)

    def _finished(self, edit: Edit) -> Effect:
        self.derived, effect = edit.finish()
        return effect

    def prepare(self, progress: bool = False) -> None:
        """Choose initializers and fit the curves of probabilities now, in some seconds, so that no
        later insertion waits for that. The choices are stored.

        Without it, the first insertion with a number of facts makes the choice for this number.
        """
        from tqdm import tqdm

        waiting = self._preparation()
        bar = tqdm(waiting, "initializers", leave=False, disable=None if progress else True)
        for key in bar:
            self._choose(key)

    @reads
    def _preparation(self) -> list[Key]:
        return self.derived.choices.preparation()

    @changes
    def _choose(self, key: Key) -> None:
        self.derived.choices.needed(key)

    @reads
    def save(self, folder: str | Path | None = None) -> None:
        """Write a copy of the home into another folder, where ``isi.open`` finds it.

        None: of a home in a folder, all is there already.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen")])
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
            folders.write_to(Path(folder).expanduser(), self.database)

    def train(
        self,
        *,
        functional: str | Sequence[str] = (),
        vectors: str | Path | None = None,
        learning_rate: float | None = None,
        dimension: int = 100,
        seed: int = 0,
    ) -> TrainingSummary:
        """Train the home again on all facts that hold. Its kinds and its history stay, and what
        was inserted is trained from then on. The arguments are those of ``isi.train``.

        Example:
            >>> effect = home.tell([("mug", "in", "kitchen")])
            >>> home.train(dimension=4).entities, list(home.inserted)
            (9, [])
        """
        from isi.home.train import tables_of_home, train_bundle

        verb = checked(Train, locals())
        tables = tables_of_home(self.facts(), self.now)
        words, file = self.base.manifest.words, verb.vectors
        if file is None and words is not None and Path(words.source).is_file():
            file = words.source
        bundle, summary = train_bundle(
            tables,
            file,
            learning_rate=verb.learning_rate,
            dimension=verb.dimension,
            seed=verb.seed,
        )
        self.train_again(with_functional(bundle, verb.functional or self.base.manifest.functional))
        return summary

    def train_again(self, bundle: Bundle) -> None:
        """Make a newly trained embedding that of this home."""
        loaded = with_words(LoadedEmbedding(**vars(bundle)))
        self._take_training(loaded, Choices(loaded, self.database))

    @changes
    def _take_training(self, loaded: LoadedEmbedding, choices: Choices) -> None:
        change = self.database.put_training(loaded, None, keep=True)
        self.derived = Derived(self.database, loaded, choices).with_all_inserted(change)

    def close(self) -> None:
        """Close the home. What is done with it afterwards is an ``InputError``."""
        with self._lock:
            self.database.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _target(database: Database, verb: Undo) -> int:
    return verb.change or last_change_of(database, verb.source)


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
    path = Path(folder).expanduser()
    check(durability, Durability, "", "argument 'durability'")  # type: ignore[arg-type]
    database = folders.opened(path, durability)
    try:
        with database.snapshot(), at(database.path):
            return Home(folders.trained(database), database)
    except BaseException:
        database.close()
        raise


def train(
    triples: TripleForms | str | Path | Home,
    *,
    kinds: Mapping[str, str] | None = None,
    functional: str | Sequence[str] = (),
    vectors: str | Path | None = None,
    learning_rate: float | None = None,
    dimension: int = 100,
    seed: int = 0,
) -> Home:
    """Train an embedding of triples by name (in any form of ``isi.insert``), of a file that
    ``isi train`` reads, or of what a home knows by now: it is then the same home (``Home.train``).

    ``base.manifest.made`` of the result has its measures. Warns of what the file's reader counts,
    such as lines without a header, if the model has learned nothing, of names in ``kinds`` that
    match no entity, and of entities without a kind.

    Args:
        triples: perhaps with a column ``count``.
        kinds: by entity.
        functional: relations of which an entity has one fact as a head: telling another one moves
            it.
        vectors: a word2vec or GloVe file, for the word vectors of names.
        learning_rate: of Adagrad; None: the better one of two for validation triples.
        dimension: d, the length of an entity's vector; even.
        seed: root seed of splits, initial vectors, batches and negatives.

    Example:
        >>> import isi
        >>> facts = [("cup", "in", "kitchen"), ("pan", "in", "kitchen"), ("bed", "in", "bedroom")]
        >>> home = isi.train(facts, dimension=4)
        >>> home.base.manifest.made["entities"], home.ask("cup", "in").answers[0].entity
        (5, 'kitchen')
    """
    from isi.home.train import tables_of, tables_of_file, train_bundle, with_kinds_of_call

    verb = checked(Train, locals())
    if isinstance(triples, str | Path) and folders.is_home(Path(triples).expanduser()):
        triples = open_home(triples)
    if isinstance(triples, Home):
        if kinds:
            raise InputError("argument 'kinds'", "", "expected none: a home has its kinds")
        _warn(triples.train(**dict(verb)))
        return triples
    tables = tables_of_file(triples) if isinstance(triples, str | Path) else tables_of(triples)
    if kinds:
        tables = with_kinds_of_call(tables, kinds)
    bundle, summary = train_bundle(
        tables,
        verb.vectors,
        learning_rate=verb.learning_rate,
        dimension=verb.dimension,
        seed=verb.seed,
    )
    _warn(summary)
    return Home(with_functional(bundle, verb.functional))


def _warn(summary: TrainingSummary) -> None:
    """Warn, in the name of a caller's caller, of what a training found wrong."""
    if summary.warning:
        warnings.warn(summary.warning, stacklevel=3)
