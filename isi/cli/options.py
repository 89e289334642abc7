"""The options of a command about a home: those of its verb (``isi.home.verbs``)."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from operator import attrgetter
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from cyclopts import Parameter

from isi.cli import Settings, settings
from isi.config import check
from isi.errors import InputError
from isi.home.verbs import Verb

#: Options that are not named after their field.
NAMES = {"facts": "--fact", "entities": "--entity", "options": "--set"}
#: The types of fields that may repeat.
LISTS: dict[str, Any] = {
    "facts": tuple[tuple[str, str, str], ...],
    "entities": tuple[str, ...],
    "among": tuple[str, ...],
    "functional": tuple[str, ...],
    "options": Settings,
}


def command_of(function: Callable[..., None]) -> Callable[..., None]:
    """A command with an option for each field of the verb that is the first parameter of a
    function.
    """
    hints = get_type_hints(function, include_extras=True)
    first, *others = inspect.signature(function).parameters.values()
    kind: type[Verb] = hints[first.name]
    names = dict.fromkeys([*kind.places, *kind.model_fields])
    parameters = [_option(kind, name) for name in names]
    parameters += [each.replace(annotation=hints[each.name]) for each in others]
    positional = [each.name for each in others if each.kind is each.POSITIONAL_ONLY]
    signature = inspect.Signature(sorted(parameters, key=attrgetter("kind")))

    def command(*values: Any, **options: Any) -> None:
        arguments = signature.bind(*values, **options).arguments
        typed = {name: arguments.pop(name) for name in names if name in arguments}
        places = [arguments.pop(name) for name in positional]
        function(_checked(kind, typed), *places, **arguments)

    command.__signature__ = signature  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in parameters}
    return command


def _option(kind: type[Verb], name: str) -> inspect.Parameter:
    """The option for a field of a verb; one with a place needs no name."""
    field = kind.model_fields[name]
    default = inspect.Parameter.empty if field.is_required() else field.default
    parameter = Parameter(
        name=NAMES.get(name),
        help=field.description,
        consume_multiple=name == "among",
        show_default=name not in LISTS and bool(default),
    )
    return inspect.Parameter(
        name,
        inspect.Parameter.POSITIONAL_OR_KEYWORD
        if name in kind.places
        else inspect.Parameter.KEYWORD_ONLY,
        default=() if name in LISTS else default,
        annotation=Annotated[LISTS.get(name) or _type_of(field.annotation), parameter],
    )


def _type_of(annotation: Any) -> Any:
    """What an option is read as: a number, one of a few words, or a text that the verb checks."""
    if get_origin(annotation) is Literal or annotation in (bool, int):
        return annotation
    for part in get_args(annotation):
        plain = get_args(part)[0] if get_origin(part) is Annotated else part
        if plain in (int, float):
            return plain | None
    return str | None if type(None) in get_args(annotation) else str


def _checked(kind: type[Verb], typed: dict[str, Any]) -> Verb:
    """A verb of what was typed; an ``InputError`` names the option."""
    fields = {name: value for name, value in typed.items() if value not in (None, ())}
    if "options" in fields:
        fields["options"] = settings(fields["options"])
    try:
        return check(fields, kind, "", "")
    except InputError as error:
        name, _, place = (error.place or "options").partition(".")  # of options without their own
        option = NAMES.get(name) or f"--{name.replace('_', '-')}"
        shown = name.upper() if name in kind.places and name not in NAMES else option
        raise InputError(shown, place, error.message) from error
