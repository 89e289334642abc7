"""Run a stage of the pipelines: arguments, params, one-line errors."""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from isi import config
from isi.errors import NO_SUCH_FILE, InputError, suggestion
from isi.process import Parser, errors_in_one_line
from stages import pipeline
from stages.params import StageParams
from stages.pipeline import BEYOND_PARAMS, BEYOND_PIPELINE


@dataclass(frozen=True)
class StageContext:
    """Input of a stage: its name, for the metadata of the files it writes,
    and the params of the pipelines.
    """

    stage: str
    params: StageParams
    beyond: StageParams  #: of the second pipeline; empty for stages of the first


def stage(body: Callable[..., None]) -> Callable[[], None]:
    """Turn ``body(context, **names)`` into the command of its DVC stage; the docstring of its
    module is the help. A body without parameters reads no params.
    """
    parameters = list(inspect.signature(body).parameters)
    name, arguments = body.__name__, parameters[1:]
    description, form = body.__globals__["__doc__"], argparse.RawDescriptionHelpFormatter

    def main() -> None:
        parser = Parser(
            prog=f"python -m stages.{name}", description=description, formatter_class=form
        )
        for argument in arguments:
            parser.add_argument(argument)
        names = vars(parser.parse_args())
        with errors_in_one_line(name, "`dvc repro` goes on from here"), naming_the_maker():
            if parameters:
                body(context_of(name, names), **names)
            else:
                body()

    return main


@contextmanager
def naming_the_maker() -> Iterator[None]:
    """Add to an error about a missing file the command that makes it."""
    try:
        yield
    except FileNotFoundError as error:
        if not isinstance(error.filename, str):
            raise
        raise pipeline.missing(Path(error.filename)) from error
    except InputError as error:
        if error.message != NO_SUCH_FILE or error.place:
            raise
        raise pipeline.missing(Path(error.file)) from error


def context_of(name: str, names: Mapping[str, str]) -> StageContext:
    """The context of a stage; InputError if the mapping of its DVC matrix lacks an argument."""
    file, entry = pipeline.find(name)
    of_params = pipeline.PIPELINES[file]
    values = pipeline.read(of_params)
    for argument, key in pipeline.matrix_of(entry).items():
        known = config.value_of(values, key) or ()
        if isinstance(known, dict) and names[argument] not in known:
            close = suggestion(names[argument], known)
            expected = f"expected the {argument} to be one of {', '.join(known)}{close}"
            raise InputError(of_params, f"{key}.{names[argument]}", expected)
    beyond = StageParams({}, BEYOND_PARAMS)
    if file == BEYOND_PIPELINE:
        beyond = StageParams.load(BEYOND_PARAMS)
    return StageContext(name, StageParams.load(), beyond)
