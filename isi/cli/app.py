"""The command ``isi``: reads the command line, imports the module of one command alone, and prints its answer."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Parameter, ValidationError
from cyclopts.validators import Number

from isi.errors import InputError, cut, short
from isi.process import one_line
from isi.tables import paths

#: The embedding that the pipeline trains for the commands.
DEFAULT = paths.final_model("ai2thor")
#: Characters of a message about the command line, at most.
MOST = 200
#: Commands: where their function is, and what they do.
COMMANDS = {
    "insert": ("entity:insert", "Give a new entity a vector from what is known of it, and report the consequences."),
    "ask": ("entity:ask", "Predict the answers of (ENTITY, RELATION, ?) or (?, RELATION, TAIL)."),
    "nearest": ("entity:nearest", "List the entities of nearest vectors."),
    "explain": ("entity:explain", "Explain the vector of an inserted entity by leaving out what it was inserted by."),
    "import": ("import_:import_", "Make a bundle of an embedding that another tool has trained."),
    "export": ("export:export", "Write a graph and predictions in a format that other tools read."),
    "graph": ("graph:graph", "Make a graph of scenes or triples of your own, and describe it."),
    "check": ("check:check", "Check the tables under data/."),
}


def settings(texts: Sequence[str]) -> dict[str, Any]:
    """The keys and values of ``KEY=VALUE``, values in YAML.

    Raises:
        ValueError: where one is none, or a key repeats.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    values = {}
    for text in texts:
        key, separator, value = text.partition("=")
        if not (key and separator) or key in values:
            raise ValueError(f"expected KEY=VALUE, each key once, got {short(text)}")
        try:
            values[key] = YAML(typ="safe", pure=True).load(value)
        except (YAMLError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:  # of a tag
            raise ValueError(f"expected KEY=VALUE, the value in YAML, got {short(text)}") from error
    return values


def _check_settings(_: object, texts: Sequence[str]) -> None:
    settings(texts)


def check_out(_: object, path: Path | None) -> None:
    if path is not None and path.name in ("", ".."):
        raise ValueError("expected a folder by its name")


FROM_ONE, FROM_ZERO = Number(gte=1, lt=10**9), Number(gte=0, lt=10**9)
#: Parameters that several commands have.
Embedding = Annotated[Path, Parameter(help="folder of a bundle, as --out, isi import and the pipeline write it")]
Top = Annotated[int, Parameter(validator=FROM_ONE, help="answers, at most")]
Json = Annotated[bool, Parameter(help="print JSON, for programs")]
Settings = Annotated[tuple[str, ...], Parameter(validator=_check_settings, show_default=False)]
Out = Annotated[Path | None, Parameter(validator=check_out, help="write the enlarged bundle there")]


def make_app() -> App:
    """The command with all its subcommands, of which none is imported."""
    app = App(
        name="isi", help="New entities in knowledge-graph embeddings, queries about them, and graphs of your own.",
        help_formatter="plain", version_flags=[], default_parameter=Parameter(negative=()),
    )  # fmt: skip
    for name, (function, about) in COMMANDS.items():
        app.command(f"{__package__}.{function}", name=name, help=about)
    return app


def main(argv: Sequence[str] | None = None) -> None:
    """Run a command; a mistake on the command line ends it with status 2, another one with status 1, in one line."""
    with one_line("isi"):
        tokens = list(sys.argv[1:] if argv is None else argv)
        name = f"isi {tokens[0]}" if tokens and tokens[0] in COMMANDS else "isi"
        with one_line(name):
            try:
                if not tokens:
                    raise CycloptsError(f"expected a COMMAND: {', '.join(COMMANDS)}")
                command, arguments, _ = make_app().parse_args(tokens, print_error=False, exit_on_error=False)
            except CycloptsError as error:
                message = " ".join(str(error).split())
                if isinstance(error, ValidationError) and error.argument and len(message) > MOST:  # it repeats a value
                    message = f"{error.argument.name}: {error.exception_message}"
                print(f"{name}: {cut(message, MOST)}; see --help", file=sys.stderr)
                sys.exit(2)
            command(*arguments.args, **arguments.kwargs)


def show(answer: Mapping[str, Any], as_json: bool, text: Callable[[Mapping[str, Any]], Iterable[str]]) -> None:
    """Print an answer: as JSON in ASCII, or as lines of text."""
    print(json.dumps(answer, indent=2, allow_nan=False) if as_json else "\n".join(text(answer)))


@contextmanager
def flags(requested: str | None = None, /, **places: object) -> Iterator[None]:
    """Errors of the library's arguments as errors of what they were given by on the command line.

    Args:
        requested: the initializer of the command line, whose options come by ``--set``.
        places: flag or file, by argument.
    """
    try:
        yield
    except InputError as error:
        argument, within, expected = error.args
        name = argument.removeprefix("argument ").strip("'")
        if requested is not None and name == "initializer" and within not in ("", requested):
            raise InputError(f"--set {within}", "", expected) from error
        if name not in places:
            raise
        place = places[name]
        raise InputError(place, ": ".join(filter(None, [name * isinstance(place, Path), within])), expected) from error
