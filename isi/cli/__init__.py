"""The command ``isi``: parses the command line, imports only the module of the chosen command,
and runs it.
"""

import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain, takewhile
from pathlib import Path
from typing import Annotated, Any

from cyclopts import (
    App,
    CycloptsError,
    MissingArgumentError,
    Parameter,
    UnusedCliTokensError,
    ValidationError,
)

from isi.errors import InputError, cut, short
from isi.process import errors_in_one_line

HOME = Path("home")  #: The folder that commands use by default.
MOST = 200  #: Longest message about the command line, in characters.
#: By command: its module and function, and the description that ``--help`` shows.
COMMANDS = {
    "train": ("train:train", "Train a home on your triples or scenes, or a home again."),
    "check": ("check:check", "Check that a home is whole: pages, keys, trained vectors."),
    "import": ("import_:import_", "Make a home of an embedding that another tool trained."),
    "tell": ("entity:tell", "Tell facts; what is not known yet is inserted."),
    "move": ("entity:move", "Replace facts by one: what was moved is in one place."),
    "remove": ("entity:remove", "Take inserted entities or facts back."),
    "undo": ("entity:undo", "Take a change back: the last one, or that of a source."),
    "ask": (
        "entity:ask",
        "Rank answers: (HEAD, RELATION, ?), (?, RELATION, TAIL), (HEAD, ?, TAIL).",
    ),
    "facts": ("entity:facts", "List what is known of a thing, or all facts."),
    "nearest": ("entity:nearest", "List the entities with the most similar vectors."),
    "explain": ("entity:explain", "Explain an insertion: its facts, its words, its indicators."),
    "history": ("entity:history", "List changes, those that were undone included."),
    "stale": ("entity:stale", "List facts that were not seen for long."),
    "forget": ("entity:forget", "Drop old changes from the history; what holds stays."),
    "save": ("entity:save", "Write a copy of a home into another folder."),
    "live": ("live:live", "Answer facts and questions in JSON lines, at once."),
}


def settings(texts: Sequence[str]) -> dict[str, Any]:
    """Parse texts ``KEY=VALUE`` into YAML values by key.
    A ``ValueError`` refuses other text and a repeated key.
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
        # by a tag
        except (
            YAMLError,
            ValueError,
            LookupError,
            TypeError,
            AttributeError,
            RecursionError,
        ) as error:
            raise ValueError(f"expected KEY=VALUE, the value in YAML, got {short(text)}") from error
    return values


def _check_folder(_: object, path: Path | None) -> None:
    if path is not None and path.name in ("", ".."):
        raise ValueError("expected the name of a folder, not . or ..")


#: Parameters that several commands have.
HomeFolder = Annotated[
    Path,
    Parameter(
        name="--home",
        env_var="ISI_HOME",
        help="folder of a home, as isi train or isi import writes it",
    ),
]
Json = Annotated[bool, Parameter(help="print JSON, for programs")]
Settings = Annotated[
    tuple[str, ...], Parameter(validator=lambda _, texts: settings(texts), show_default=False)
]
NewFolder = Annotated[Path, Parameter(validator=_check_folder, help="folder to write")]


def main(argv: Sequence[str] | None = None) -> None:
    """Run a command. An error prints one line;
    the exit status is 2 if the command line cannot be parsed, else 1.
    """
    # what takes 0.1 s to start: threads of NumPy, and a search for plug-ins of pydantic
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    with errors_in_one_line("isi"):
        tokens = with_paths(sys.argv[1:] if argv is None else argv)
        app = App(
            name="isi",
            help="Insert entities into knowledge-graph embeddings, and query them.",
            help_formatter="plain",
            version_flags=[],
            default_parameter=Parameter(negative=()),
        )
        for command, (function, about) in COMMANDS.items():
            app.command(f"{__name__}.{function}", name=command, help=about)
        name = f"isi {tokens[0]}" if tokens and tokens[0] in COMMANDS else "isi"
        with errors_in_one_line(name):
            try:
                if not tokens:
                    raise CycloptsError(f"expected a COMMAND: {', '.join(COMMANDS)}")
                run, arguments, _ = app.parse_args(
                    with_facts(tokens), print_error=False, exit_on_error=False
                )
            except CycloptsError as error:
                message = " ".join(str(error).split()) + _hint(error)
                # it repeats a value
                if isinstance(error, ValidationError) and error.argument and len(message) > MOST:
                    message = f"{error.argument.name}: {error.exception_message}"
                print(f"{name}: {cut(message, MOST)}; see --help", file=sys.stderr)
                sys.exit(2)
            run(*arguments.args, **arguments.kwargs)


def with_paths(tokens: Sequence[str]) -> list[str]:
    """A command line with the path of standard input in place of each file ``-``, and that of the
    user's folder in place of ``~``, which a shell leaves behind an equals sign.
    """
    reads_files = bool(tokens) and tokens[0] == "train"
    paths = list[str]()
    for before, part in zip(["", *tokens], tokens, strict=False):
        option, _, path = part.rpartition("=")
        if part == "-" and (reads_files or before == "--from"):
            paths.append("/dev/stdin")
        elif path.startswith("~/"):
            paths.append(f"{option}{'=' * bool(option)}{Path(path).expanduser()}")
        else:
            paths.append(part)
    return paths


def with_facts(tokens: Sequence[str]) -> list[str]:
    """A command line in which each fact of ``isi tell`` stands behind ``--fact``."""
    command, *rest = tokens
    parts = list(takewhile(_is_no_option, rest))
    if command != "tell" or len(parts) % 3:
        return list(tokens)
    facts = (["--fact", *parts[place : place + 3]] for place in range(0, len(parts), 3))
    return [command, *chain.from_iterable(facts), *rest[len(parts) :]]


def _is_no_option(token: str) -> bool:
    return not token.startswith("--")


def _hint(error: CycloptsError) -> str:
    """What a command line that cannot be parsed may lack."""
    if isinstance(error, MissingArgumentError) and error.argument:
        has_parts = error.argument.token_count()[0] > 1
        return f" Expected {error.argument.parameter.help}" if has_parts else ""
    several = isinstance(error, UnusedCliTokensError)
    return " A name of several words stands in quotes." if several else ""


def show(answer: Mapping[str, Any], as_json: bool = False) -> None:
    """Print an answer: as JSON in ASCII, or as lines of text."""
    print(json.dumps(answer, indent=2, allow_nan=False) if as_json else "\n".join(lines(answer)))


def lines(answer: Mapping[str, Any], indent: str = "", are_names: bool = False) -> Iterator[str]:
    """Format an answer as text, a line per key. Mappings are indented;
    a list of flat mappings becomes a table.

    ``are_names``: keys are the user's names, as in each mapping inside, and stay as they are.
    """
    from tabulate import tabulate  # type: ignore[import-untyped]

    for key, value in answer.items():
        shown = key if are_names else key.replace("_", " ")
        label, rows = f"{indent}{shown}:", value if isinstance(value, list) else []
        inner = indent + "  "
        if isinstance(value, Mapping) and value:
            yield from (label, *lines(value, inner, are_names=True))
        elif not (rows and isinstance(rows[0], Mapping)):
            yield f"{label} {text_of(value)}"
        elif any(
            isinstance(cell, list) and cell[:1] and isinstance(cell[0], Mapping)
            for cell in rows[0].values()
        ):
            yield from (label, *(line for row in rows for line in lines(row, inner)))
        else:
            names = [
                name for name in rows[0] if any(row[name] not in (None, [], "") for row in rows)
            ]
            cells = [
                [name.replace("_", " ") for name in names],
                *([text_of(row[name]) for name in names] for row in rows),
            ]
            text = tabulate(cells, tablefmt="plain", disable_numparse=True)
            yield from (label, *((inner + line).rstrip() for line in text.splitlines()))


def text_of(value: Any) -> str:
    """Format a value for a line of text: floats with 3 digits, None as a dash,
    a tuple (a triple) with spaces.
    """
    match value:
        case tuple():
            return " ".join(map(str, value))
        case list():
            return ", ".join(map(text_of, value)) or "none"
        case bool():
            return "yes" if value else "no"
    return "–" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)


@contextmanager
def flags(**places: object) -> Iterator[None]:
    """In an ``InputError``, replace the library's argument by the option or file in
    ``places`` that the user typed.
    """
    try:
        yield
    except InputError as error:
        name = error.file.removeprefix("argument ").strip("'")
        if name not in places:
            raise
        raise InputError(places[name], error.place, error.message) from error
