"""Run a stage of the pipelines: arguments, params, one-line errors. Find the stage that writes a file."""

from __future__ import annotations

import argparse
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isi import config
from isi.errors import InputError, suggestion
from isi.process import Parser, errors_in_one_line
from isi.tables import paths

if TYPE_CHECKING:
    from isi.params import Beyond, Params

#: Pipeline file → params file, which lists the values of the pipeline's matrices.
PIPELINES = {paths.PIPELINE: paths.PARAMS, paths.BEYOND_PIPELINE: paths.BEYOND_PARAMS}


@dataclass(frozen=True)
class StageContext:
    """Input of a stage: its name, for the metadata of the files it writes, and the params of both pipelines."""

    stage: str
    params: Params
    beyond: Beyond  #: empty for stages of the first pipeline


def stage(body: Callable[..., None]) -> Callable[[], None]:
    """Turn ``body(context, **names)`` into the command of its DVC stage; the docstring of its module is the help."""
    name, arguments = body.__name__, list(inspect.signature(body).parameters)[1:]
    description, form = body.__globals__["__doc__"], argparse.RawDescriptionHelpFormatter

    def main() -> None:
        parser = Parser(prog=f"python -m stages.{name}", description=description, formatter_class=form)
        for argument in arguments:
            parser.add_argument(argument)
        names = vars(parser.parse_args())
        with errors_in_one_line(name, "`dvc repro` goes on from here"):
            body(context_of(name, names), **names)

    return main


def context_of(name: str, names: Mapping[str, str]) -> StageContext:
    """The context of a stage; InputError if params are invalid, or the mapping of its DVC matrix lacks an argument."""
    from isi import params  # imported here: it loads all packages, and a stage needs a few

    pipeline, entry = _entry(name)
    values = _read(PIPELINES[pipeline])
    for argument, key in _matrix(entry).items():
        known = config.value_of(values, key) or ()
        if isinstance(known, dict) and names[argument] not in known:
            close = suggestion(names[argument], known)
            expected = f"expected the {argument} to be one of {', '.join(known)}{close}"
            raise InputError(PIPELINES[pipeline], f"{key}.{names[argument]}", expected)
    main, beyond = params.load(), paths.BEYOND_PARAMS if pipeline == paths.BEYOND_PIPELINE else None
    return StageContext(name, main, params.load_beyond(main, beyond))


def missing(path: Path) -> InputError:
    """An ``InputError`` for a missing file, with the command that makes the file, if a stage does."""
    with suppress(InputError):
        for name in () if path.is_absolute() else makers(path):
            return InputError(path, "", f"missing: run `dvc repro {name}`, which makes it")
    return InputError(path, "", "no such file")


def makers(path: Path) -> Iterator[str]:
    """Arguments for ``dvc repro``: the stages that write a file, or a folder above it, under the current params."""
    for pipeline in filter(Path.exists, PIPELINES):
        values, before = _read(PIPELINES[pipeline]), "" if pipeline == paths.PIPELINE else f"{pipeline}:"
        for name, entry in _stages(pipeline).items():
            for out in [*entry.get("outs", []), *entry.get("metrics", [])]:
                template = re.escape(next(iter(out)) if isinstance(out, dict) else str(out))
                pattern = re.sub(r"\\\$\\\{item\\?\.(\w+)\\\}", r"(?P<\1>\\w+)", template)
                match = re.fullmatch(rf"{pattern}(/.*)?", path.as_posix())
                items = {item: key for item, key in _matrix(entry).items() if match and item in match.groupdict()}
                if match and all(match[item] in (config.value_of(values, key) or ()) for item, key in items.items()):
                    yield f"{before}{name}" + f"@{'-'.join(match[item] for item in items)}" * bool(items)


def _matrix(entry: Mapping[str, Any]) -> dict[str, str]:
    """By argument of a stage: the dotted key of params that lists its values."""
    return {item: str(values).strip("${}") for item, values in (entry.get("matrix") or {}).items()}


def _entry(name: str) -> tuple[Path, dict[str, Any]]:
    """The pipeline file that has a stage, and the stage's entry in it."""
    for pipeline in PIPELINES:
        if name in _stages(pipeline):
            return pipeline, _stages(pipeline)[name]
    raise InputError(paths.PIPELINE, "stages", f"expected a stage {name!r} here or in {paths.BEYOND_PIPELINE}")


def _stages(pipeline: Path) -> dict[str, Any]:
    stages = _read(pipeline).get("stages")
    if not isinstance(stages, dict):
        raise InputError(pipeline, "stages", "expected a mapping of stages: is this the folder of the project?")
    return stages


def _read(path: Path) -> dict[str, Any]:
    """The parsed content of a YAML file; cached until the file changes, since parsing is slow."""
    stat = path.stat() if path.exists() else None
    return _parsed(path.absolute(), path, stat and (stat.st_mtime_ns, stat.st_size))


@cache
def _parsed(_place: Path, path: Path, _changed: tuple[int, int] | None) -> dict[str, Any]:
    return config.read(path)
