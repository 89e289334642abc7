"""Run a stage of the pipelines: arguments, params, one-line errors."""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from isi import config, pipeline
from isi.errors import InputError, suggestion
from isi.process import Parser, errors_in_one_line
from isi.tables import paths

if TYPE_CHECKING:
    from stages.params import Beyond, Params


@dataclass(frozen=True)
class StageContext:
    """Input of a stage: its name, for the metadata of the files it writes,
    and the params of the pipelines.
    """

    stage: str
    params: Params
    beyond: Beyond  #: empty for stages of other pipelines than the second


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
        with errors_in_one_line(name, "`dvc repro` goes on from here"):
            if parameters:
                body(context_of(name, names), **names)
            else:
                body()

    return main


def context_of(name: str, names: Mapping[str, str]) -> StageContext:
    """The context of a stage; InputError if params are invalid,
    or the mapping of its DVC matrix lacks an argument.
    """
    from isi import params  # imported here: it loads all packages, and a stage needs a few

    file, entry = pipeline.find(name)
    of_params = pipeline.PIPELINES[file]
    values = pipeline.read(of_params)
    for argument, key in pipeline.matrix_of(entry).items():
        known = config.value_of(values, key) or ()
        if isinstance(known, dict) and names[argument] not in known:
            close = suggestion(names[argument], known)
            expected = f"expected the {argument} to be one of {', '.join(known)}{close}"
            raise InputError(of_params, f"{key}.{names[argument]}", expected)
    main = params.load()
    beyond = paths.BEYOND_PARAMS if file == paths.BEYOND_PIPELINE else None
    return StageContext(name, main, params.load_beyond(main, beyond))
