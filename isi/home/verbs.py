"""The verbs of a home, each a class with what goes with it.

A verb is a method of ``Home``, a command, and a request in JSON. Its fields are the keyword
arguments of the method, the options of the command, and the keys of the request.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Protocol, Self, TypeVar

from pydantic import BeforeValidator, Field, model_validator

from isi.config import Count, Option, Positive, Section, Seed, check, plain_numbers
from isi.errors import InputError, short
from isi.home.bundle import Text

#: Seconds of each unit of an age: ``30d``, ``12h``.
UNITS = {"s": 1, "m": 60, "h": 3600, "d": 86400, "w": 604800}


# -- types of fields -------------------------------------------------------------------------------


def as_time(value: Any) -> Any:
    """A time with its zone, of a text in ISO 8601, of a datetime (both without a zone: local time,
    as Python has it) or of seconds since 1970.
    """
    typed = value
    try:
        if isinstance(value, str):
            value = datetime.fromisoformat(value)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            value = datetime.fromtimestamp(value, UTC)
        return value.astimezone(UTC) if isinstance(value, datetime) else value
    except (ValueError, OverflowError, OSError) as error:
        expected = "expected a time such as 2026-11-25T09:30:00Z, or seconds since 1970"
        raise ValueError(f"{expected}, got {short(typed)}") from error


def as_age(value: Any) -> Any:
    """A duration of a text such as ``30d``, ``12h``, ``90m``."""
    if not isinstance(value, str):
        return value
    number, unit = value[:-1], value[-1:]
    if not (number.isdecimal() and len(number) < 5 and unit in UNITS):
        raise ValueError(f"expected a number and one of {', '.join(UNITS)}, as in 30d")
    return timedelta(seconds=int(number) * UNITS[unit])


def as_names(value: Any) -> Any:
    """NameList as a list; a text is a single name."""
    if isinstance(value, str):
        return [value]
    is_listed = hasattr(value, "__iter__") and not isinstance(value, bytes | Mapping)
    return list(value) if is_listed else value


Time = Annotated[datetime, BeforeValidator(as_time)]
Age = Annotated[timedelta, BeforeValidator(as_age)]
NameList = Annotated[list[Text], BeforeValidator(as_names)]
Confidence = Annotated[float, Field(gt=0, le=1)]
EachText = Text | Mapping[Text, Text] | None  #: For each new entity, or by name.
InitializerOptions = Mapping[str, Option] | None  #: Of an initializer.
#: Triples by name in any form of ``isi.insert``, perhaps with a fourth part, their confidence.
FactForms = Any


# -- verbs -----------------------------------------------------------------------------------------


class Verb(Section):
    """A verb with what goes with it."""

    #: the fields that a command takes by their place, and the value of the verb's key in a request
    places: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def name(cls) -> str:
        """Of the method, of the command, and of the key of a request."""
        return cls.__name__.removeprefix("Known").lower()

    def of(self, home: HasVerbs) -> Any:
        """Do it; what the method gives."""
        return getattr(home, self.name())(**dict(self))


class HasVerbs(Protocol):
    """A home."""


class Stamp(Verb):
    """A change: when it was made, and what reported it."""

    time: Time | None = Field(None, description="when it was seen, as 2026-11-25T09:30")
    source: Text | None = Field(None, description="what reported it")


class Tell(Stamp):
    """Tell facts; what is not known yet is inserted."""

    places = ("facts",)

    facts: FactForms = Field((), description="HEAD RELATION TAIL: a fact; may repeat")
    entities: NameList = Field([], description="a new entity by its words alone; may repeat")
    new: Literal["insert", "refuse"] = Field("insert", description="for names that are not known")
    definition: EachText = Field(None, description="a sentence, for the word vector")
    kind: EachText = Field(None, description="default: what the facts, else the words suggest")
    confidence: Confidence | None = Field(None, description="how far the facts are believed")
    initializer: Text | None = Field(None, description="default: the best for hidden entities")
    options: InitializerOptions = Field(None, description="KEY=VALUE: an option of the initializer")
    seed: Seed = Field(0, description="seed of a random initializer")

    @model_validator(mode="after")
    def _options_are_of_an_initializer(self) -> Self:
        if self.options and self.initializer is None:
            raise ValueError("expected an initializer: options are of one")
        return self


class Move(Stamp):
    """Replace the facts with a head and a relation by one: what was moved is in one place."""

    places = ("head", "relation", "tail")

    head: Text = Field(description="head of the fact")
    relation: Text = Field(description="relation of the fact")
    tail: Text = Field(description="its new tail; what is not known yet is inserted")
    instead_of: Text | None = Field(None, description="replace the fact with this tail alone")


class Remove(Stamp):
    """Take back inserted entities with all their facts, or single facts."""

    places = ("entities",)

    entities: NameList = Field([], description="an inserted entity; may repeat")
    facts: FactForms = Field((), description="HEAD RELATION TAIL: a fact; may repeat")


class Undo(Verb):
    """Take a change back: the last one, that of a source, or one by its number."""

    change: Count | None = Field(None, description="number of the change; default: the last one")
    source: Text | None = Field(None, description="the last change that this has reported")
    dry: bool = Field(False, description="say what would be taken back, and change nothing")
    time: Time | None = Field(None, description="when it was made, as 2026-11-25T09:30")


class Ask(Verb):
    """Rank answers: (HEAD, RELATION, ?), (?, RELATION, TAIL), (HEAD, ?, TAIL)."""

    places = ("head", "relation", "tail")

    head: Text | None = Field(None, description="head of the query")
    relation: Text | None = Field(None, description="relation of the query")
    tail: Text | None = Field(None, description="tail of the query")
    top: Count = Field(10, description="maximum number of answers")
    new: bool = Field(False, description="leave out what is known")
    among: NameList | None = Field(None, description="rank these entities alone")


class Nearest(Verb):
    """List the entities with the most similar vectors."""

    places = ("entity",)

    entity: Text = Field(description="a known or inserted entity")
    top: Count = Field(10, description="maximum number of neighbours")


class Explain(Verb):
    """Explain an insertion: its facts, its words, its indicators."""

    places = ("entity",)

    entity: Text = Field(description="an inserted entity")


class KnownFacts(Verb):
    """List what is known of a thing: confidence, counts, times and sources."""

    places = ("entity",)

    entity: Text | None = Field(None, description="an entity; default: all facts")


class History(Verb):
    """List changes, those that were undone included."""

    last: Count | None = Field(None, description="the last ones alone")


class Stale(Verb):
    """List facts that were not seen for long."""

    places = ("age",)

    age: Age = Field(description="for how long: 30d, 12h")
    since: Time | None = Field(None, description="before when, as 2026-11-25T09:30; default: now")


class Forget(Verb):
    """Drop old changes from the history; what holds stays, and they cannot be undone."""

    places = ("older",)

    older: Age = Field(description="older than this: 7d, 12h")


class Save(Verb):
    """Write a copy into another folder."""

    places = ("folder",)

    folder: Text = Field(description="folder to write")


class Train(Verb):
    """Train again on all that holds."""

    functional: NameList = Field([], description="relation of which a thing has one fact")
    vectors: Path | Text | None = Field(None, description="word2vec or GloVe file, for words")
    learning_rate: Positive | None = Field(
        None, description="of Adagrad; default: the better of two on held-out triples"
    )
    dimension: Count = Field(100, description="numbers in an entity's vector")
    seed: Seed = Field(0, description="seed of everything random")


V = TypeVar("V", bound=Verb)


def checked(verb: type[V], arguments: Mapping[str, Any]) -> V:
    """A verb of the arguments of its method, by name; an ``InputError`` names a wrong one."""
    fields = {
        name: plain_numbers(arguments[name]) for name in verb.model_fields if name in arguments
    }
    try:
        return check(fields, verb, "", "")
    except InputError as error:
        name, _, place = error.place.partition(".")
        raise InputError(f"argument {name!r}", place, error.message) from error


VERBS: dict[str, type[Verb]] = {
    verb.name(): verb
    for verb in (
        Tell,
        Move,
        Remove,
        Undo,
        Ask,
        Nearest,
        Explain,
        KnownFacts,
        History,
        Stale,
        Forget,
        Save,
        Train,
    )
}
