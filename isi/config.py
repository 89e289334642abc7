"""Read ``params.yaml``: each section has a pydantic model in the module that uses it;
plug-ins register by name.
"""

import importlib
import inspect
import json
import pkgutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from json.decoder import JSONObject  # type: ignore[attr-defined]
from json.scanner import py_make_scanner  # type: ignore[attr-defined]
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, ClassVar, Generic, Self, TypeVar, cast, get_type_hints

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    TypeAdapter,
    create_model,
    model_validator,
)
from pydantic_core import PydanticCustomError

from isi.errors import InputError, at, short, suggestion
from isi.tables import paths

Count = Annotated[int, Field(ge=1, lt=2**31)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Fraction = Annotated[float, Field(gt=0, lt=1)]
Positive = Annotated[float, Field(gt=0, le=1e30)]  #: Within the range of single precision.
#: Largest |x| of a vector: a score sums products of three coordinates, and could overflow float32.
LARGEST = 1e11
NotNegative = Annotated[float, Field(ge=0, le=1e30)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
#: Name of an experiment, source or initializer; names of files and stages contain it.
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
Option = int | float | bool | str

T = TypeVar("T")
#: The validator of a type, cached because building it takes 1 ms; annotated because ``cache`` loses
#: the type.
adapter: Callable[[type[T]], TypeAdapter[T]] = cache(TypeAdapter)  # type: ignore[assignment]


def distinct(values: Iterable[Any]) -> bool:
    """Whether no value repeats."""
    items = list(values)
    return len(set(items)) == len(items)


def ensure(hold: Callable[[Any], bool], expected: str) -> AfterValidator:
    """A pydantic validator that raises the error "expected {expected}" if
    ``hold(value)`` is false.
    """

    def checked(value: Any) -> Any:
        if not hold(value):
            raise ValueError(f"expected {expected}")
        return value

    return AfterValidator(checked)


EachOnce = ensure(distinct, "each value once")
Names = Annotated[list[Name], EachOnce]


class Section(BaseModel):
    """A mapping of ``params.yaml``: no unknown keys, no silent conversions."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        defer_build=True,  # a command needs few of them, and each takes a millisecond to build
    )
    rules: ClassVar[Sequence[tuple[Callable[[Any], bool], str]]] = ()  #: condition, message

    @model_validator(mode="before")
    @classmethod
    def _keys_are_known(cls, values: Any) -> Any:
        known = [field.alias or name for name, field in cls.model_fields.items()]
        for key in values if isinstance(values, dict) else ():
            if key not in known:
                message = f"unknown key{suggestion(key, known)}"
                raise PydanticCustomError(
                    "unknown_key", "{message}", {"key": key, "message": message}
                )
        return values

    @model_validator(mode="after")
    def _rules_hold(self) -> Self:
        for holds, expected in self.rules:
            if not holds(self):
                raise ValueError(expected)
        return self


class Study(Section):
    """A study in addition to the main pipeline, on the experiments that it lists."""

    experiments: Names


def read(path: Path) -> dict[str, Any]:
    """Read a YAML file that holds a mapping; InputError where it is
    missing or holds something else.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    if path == paths.PARAMS and not path.exists():
        raise InputError(
            path, "", f"no such file in {Path.cwd()}: run this in the folder of the project"
        )
    with at(path):
        text = path.read_text(encoding="utf-8-sig")
    try:
        raw = YAML(typ="safe", pure=True).load(text)  # YAML 1.2, as DVC reads it
    except RecursionError as error:
        raise InputError(path, "", "expected YAML with fewer nested levels") from error
    # from a malformed value
    except (YAMLError, ValueError, LookupError, TypeError, AttributeError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f"line {mark.line + 1}" if mark else ""
        raise InputError(
            path, place, f"expected YAML: {getattr(error, 'problem', None) or error}"
        ) from error
    if not isinstance(raw, dict):
        raise InputError(path, "", "expected a mapping of keys to values")
    return raw


def check_keys(text: str) -> None:
    """``InputError`` for JSON with a key that stands twice in an object, with the line in which the
    object begins: parsers keep the last of its values. Other text passes.

    Example:
        >>> from isi.config import check_keys
        >>> check_keys('{"rooms": [], "rooms": []}')
        Traceback (most recent call last):
        isi.errors.InputError: line 1: expected each key once, got 'rooms' twice
    """
    try:
        json.loads(text, object_pairs_hook=_keys_once)
    except InputError:
        _PlacedDecoder().decode(text)
        raise
    except (ValueError, RecursionError):
        return


def _keys_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict[str, Any]()
    for key, value in pairs:
        if key in result:
            raise InputError("", "", f"expected each key once, got {short(key)} twice")
        result[key] = value
    return result


class _PlacedDecoder(json.JSONDecoder):
    """``_keys_once`` with the line; Python's own scanner is slower than that of C, which knows no
    place.
    """

    def __init__(self) -> None:
        super().__init__(object_pairs_hook=_keys_once)
        self.parse_object = self._object_at
        self.scan_once = py_make_scanner(self)

    def _object_at(self, place: tuple[str, int], *rest: Any) -> Any:
        text, start = place
        try:
            return JSONObject(place, *rest)
        except InputError as error:
            line = error.place or f"line {1 + text.count(chr(10), 0, start)}"
            raise InputError("", line, error.message) from error


def check(value: Any, kind: type[T], key: str, path: Path | str = paths.PARAMS) -> T:
    """Validate a value as a type; InputError names the key, below ``key``, that is unknown,
    missing or wrong.
    """
    with at(path, key):
        return adapter(kind).validate_python(plain_numbers(value), strict=True)


def plain_number(value: Any) -> Any:
    """A number of NumPy's or PyTorch's, an array of dimension 0 included, as one of Python's; any
    other value as it is.
    """
    return value.item() if getattr(value, "ndim", None) == 0 and hasattr(value, "item") else value


def plain_numbers(value: Any) -> Any:
    """``plain_number`` of a value, or of the values of a dict."""
    if isinstance(value, dict):
        return {key: plain_number(each) for key, each in value.items()}
    return plain_number(value)


def as_list(values: Any, item: type | UnionType = object, expected: str = "a list") -> list[Any]:
    """An argument as a list of ``item``. An ``InputError`` refuses a text,
    and items of other types.
    """
    try:
        items = list(values)
    except TypeError as error:
        raise InputError("", "", f"expected {expected}, got {short(values)}") from error
    wrong = (
        [values]
        if isinstance(values, str | bytes)
        else [value for value in items if not isinstance(value, item)]
    )
    if wrong:
        raise InputError("", "", f"expected {expected}, got {short(wrong[0])}")
    return items


def is_whole(value: object) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


@cache
def options(function: Callable[..., Any]) -> type[Section]:
    """The params section of a function: a key for each parameter but the first;
    ``from_`` is the key ``from``.
    """
    hints, fields = get_type_hints(function, include_extras=True), dict[str, Any]()
    for name, parameter in list(inspect.signature(function).parameters.items())[1:]:
        if name not in hints:
            raise InputError(
                function.__module__,
                function.__name__,
                f"expected a type hint for its option {name!r}",
            )
        default = ... if parameter.default is parameter.empty else parameter.default
        fields[name] = (hints[name], Field(default, alias=name.removesuffix("_")))
    return cast("type[Section]", create_model(function.__name__, __base__=Section, **fields))


def keywords(function: Callable[..., Any], values: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Validated keyword arguments of a function;
    InputError names the key that is unknown, missing or wrong.
    """
    checked = check(dict(values) if isinstance(values, Mapping) else values, options(function), key)
    return {name: getattr(checked, name) for name in type(checked).model_fields}


def value_of(values: Any, key: str) -> Any:
    """The value at a dotted key of nested mappings; None if a key is missing."""
    for part in key.split("."):
        values = values.get(part) if isinstance(values, dict) else None
    return values


def check_names(names: Iterable[str], known: Iterable[str], key: str) -> None:
    """InputError at a key for the first listed name that is not known."""
    for name in names:
        if name not in known:
            raise InputError(
                "",
                key,
                f"expected names among {', '.join(known)}, got {name!r}{suggestion(name, known)}",
            )


class Plugins(Generic[T]):
    """Objects that the modules of a package register by name, except private modules.

    ``definition_of`` gives the function or class that defines an object; by default, the object
    itself.
    """

    def __init__(self, package: str, definition_of: Callable[[T], object] | None = None) -> None:
        self.package = package
        self._definition_of = definition_of
        self._registered: dict[str, T] = {}

    def register(self, name: str, thing: T) -> None:
        """Register an object. The definition that has the name may come again, since modules are
        loaded again; an ``InputError`` refuses another one.
        """
        if name in self._registered:
            first, second = self._place_of(self._registered[name]), self._place_of(thing)
            if first != second:
                message = f"expected another name, since {first} has it, got that of {second}"
                raise InputError(self.package, repr(name), message)
        self._registered[name] = thing

    def _place_of(self, thing: T) -> str:
        """The module of an object's definition, and its name there."""
        definition = thing if self._definition_of is None else self._definition_of(thing)
        module = getattr(definition, "__module__", "")
        return f"{module}.{getattr(definition, '__qualname__', repr(definition))}"

    def get(self, name: str, key: str = "") -> T:
        """The object registered under a name; for an unknown name,
        an InputError at ``key`` of ``params.yaml``.
        """
        if name not in self._registered and name not in (known := self.names()):
            expected = (
                f"expected one of {', '.join(known)}, got {short(name)}{suggestion(name, known)}"
            )
            raise InputError(paths.PARAMS, key, expected)
        return self._registered[name]

    def names(self) -> list[str]:
        """Import all modules, and return all registered names, sorted."""
        for module in pkgutil.iter_modules(importlib.import_module(self.package).__path__):
            if not module.name.startswith("_"):
                importlib.import_module(f"{self.package}.{module.name}")
        return sorted(self._registered)
