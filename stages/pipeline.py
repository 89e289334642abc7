"""What the pipelines' files say: the stages, the keys of their matrices,
and the stage that makes a file.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from isi import config
from isi.errors import NO_SUCH_FILE, InputError
from isi.tables import paths

PIPELINE = Path("dvc.yaml")
BEYOND_PARAMS = Path("beyond") / "params.yaml"  #: params of the second pipeline, beyond the paper
BEYOND_PIPELINE = Path("beyond") / "dvc.yaml"
#: Pipeline file → params file, which lists the values of the pipeline's matrices.
PIPELINES = {
    PIPELINE: paths.PARAMS,
    BEYOND_PIPELINE: BEYOND_PARAMS,
}


def missing(path: Path) -> InputError:
    """An ``InputError`` for a missing file, with the command that makes the file,
    if a stage does.
    """
    with suppress(InputError):
        for name in () if path.is_absolute() else makers(path):
            return InputError(path, "", f"missing: run `dvc repro {name}`, which makes it")
    return InputError(path, "", "no such file")


def makers(path: Path) -> Iterator[str]:
    """Arguments for ``dvc repro``: the stages that write a file, or a folder above it,
    under the current params.
    """
    for pipeline in filter(Path.exists, PIPELINES):
        values = read(PIPELINES[pipeline])
        before = "" if pipeline == PIPELINE else f"{pipeline}:"
        for name, entry in _stages(pipeline).items():
            for out in [*entry.get("outs", []), *entry.get("metrics", [])]:
                template = re.escape(next(iter(out)) if isinstance(out, dict) else str(out))
                pattern = re.sub(r"\\\$\\\{item\\?\.(\w+)\\\}", r"(?P<\1>\\w+)", template)
                match = re.fullmatch(rf"{pattern}(/.*)?", path.as_posix())
                items = {
                    item: key
                    for item, key in matrix_of(entry).items()
                    if match and item in match.groupdict()
                }
                if match and all(
                    match[item] in (config.value_of(values, key) or ())
                    for item, key in items.items()
                ):
                    yield f"{before}{name}" + f"@{'-'.join(match[item] for item in items)}" * bool(
                        items
                    )


def matrix_of(entry: Mapping[str, Any]) -> dict[str, str]:
    """By argument of a stage: the dotted key of params that lists its values."""
    return {item: str(values).strip("${}") for item, values in (entry.get("matrix") or {}).items()}


def find(name: str) -> tuple[Path, dict[str, Any]]:
    """The pipeline file that has a stage, and the stage's entry in it."""
    first, *others = PIPELINES
    for pipeline in (first, *filter(Path.exists, others)):
        if name in _stages(pipeline):
            return pipeline, _stages(pipeline)[name]
    expected = f"expected a stage {name!r} here or in {' or '.join(map(str, others))}"
    raise InputError(PIPELINE, "stages", expected)


def _stages(pipeline: Path) -> dict[str, Any]:
    stages = read(pipeline).get("stages")
    if not isinstance(stages, dict):
        raise InputError(
            pipeline, "stages", "expected a mapping of stages: is this the folder of the project?"
        )
    return stages


def read(path: Path) -> dict[str, Any]:
    """The parsed content of a YAML file; cached until the file changes, since parsing is slow."""
    if path == PIPELINE and not path.exists():
        expected = f"{NO_SUCH_FILE} in {Path.cwd()}: run this in the folder of the project"
        raise InputError(path, "", expected)
    stat = path.stat() if path.exists() else None
    return _parsed(path.absolute(), path, stat and (stat.st_mtime_ns, stat.st_size))


@cache
def _parsed(_place: Path, path: Path, _changed: tuple[int, int] | None) -> dict[str, Any]:
    return config.read(path)
