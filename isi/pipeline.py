"""What the pipelines say of their stages: the params that each is given, what it reads and writes, who makes a file."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from isi import config
from isi.errors import InputError, meant
from isi.tables import paths

#: Each pipeline with the params that its matrices run over.
PIPELINES = {paths.PIPELINE: paths.PARAMS, paths.BEYOND_PIPELINE: paths.BEYOND_PARAMS}
_OPEN = re.compile(r"\$\{([^}]+)\}")
_ITEM = re.compile(r"\\\$\\\{item\\?\.(\w+)\\\}")


def declared(name: str, arguments: Mapping[str, str], everything: Mapping[str, Any]) -> dict[str, Any]:
    """The values that a pipeline lists for a stage, by dotted key; what keys leave open is filled in as DVC does.

    Args:
        everything: what ``params.yaml`` holds; other files of params are read where a pipeline names them.

    Raises:
        InputError: where no pipeline has the stage, or params have nothing under the name of an argument.
    """
    pipeline, entry = _stage(name)
    _check_arguments(pipeline, entry, arguments, everything)

    def fill(open_part: re.Match[str]) -> str:
        matrix, _, item = open_part[1].partition(".")
        return str(arguments[item] if matrix == "item" else config.value_of(everything, open_part[1]))

    found: dict[str, Any] = {}
    for listed in entry.get("params", []):
        for file, keys in (listed if isinstance(listed, dict) else {str(paths.PARAMS): [listed]}).items():
            values = everything if file == str(paths.PARAMS) else _read(Path(file))
            filled = [_OPEN.sub(fill, key) for key in keys]
            found |= {key: value_at(Path(file), values, key) for key in filled}
    return found


def value_at(file: Path, values: Mapping[str, Any], key: str) -> Any:
    """The value at a dotted key, null where there is none.

    Raises:
        InputError: where there is none, but something beside it, or beside what it is in, has a name that is like it.
    """
    there: Any = values
    for number, name in enumerate(parts := key.split("."), 1):
        if not isinstance(there, Mapping) or name in there:
            there = there.get(name) if isinstance(there, Mapping) else None
            continue
        if close := meant(name, there):
            raise InputError(file, ".".join(parts[:number]), f"missing{close}")
        return None
    return there


def _check_arguments(
    pipeline: Path, entry: Mapping[str, Any], arguments: Mapping[str, str], everything: Mapping[str, Any]
) -> None:
    """Refuse an argument that is no key of the mapping that the stage's matrix runs over.

    A name that a list lacks is none of the pipeline's runs, but may be run.
    """
    for argument, key in _matrix(entry).items():
        there = config.value_of(_values(pipeline, everything), key)
        name = arguments[argument]
        if isinstance(there, dict) and name not in there:
            expected = f"there is no {argument} {name!r} there, but {', '.join(map(str, there))}{meant(name, there)}"
            raise InputError(PIPELINES[pipeline], f"{key}.{name}", expected)


def _values(pipeline: Path, everything: Mapping[str, Any]) -> Mapping[str, Any]:
    """The params that a pipeline's matrices run over."""
    return everything if pipeline == paths.PIPELINE else _read(PIPELINES[pipeline])


def _matrix(entry: Mapping[str, Any]) -> dict[str, str]:
    """Which keys of params the arguments of a stage run over."""
    found = {item: _OPEN.fullmatch(str(values)) for item, values in (entry.get("matrix") or {}).items()}
    return {item: key[1] for item, key in found.items() if key}


def _listed(values: Mapping[str, Any], key: str) -> Collection[Any]:
    """What a matrix runs over: the keys of a mapping, or a list; none where params have there what they must not."""
    there = config.value_of(values, key)
    return there if isinstance(there, dict | list) else []


def described(name: str) -> str:
    """The choices of a stage's arguments, what it reads, and what it writes."""
    pipeline, entry = _stage(name)
    values = _read(PIPELINES[pipeline])
    lines = [f"{item}: {', '.join(map(str, _listed(values, key)))}" for item, key in _matrix(entry).items()]
    data = [path for path in _paths(entry, "deps") if Path(path).parts[0] == str(paths.DATA)]
    lines += [f"reads: {', '.join(data)}", f"writes: {', '.join(_outputs(entry))}"]
    return "\n".join(re.sub(r"\$\{item\.(\w+)\}", lambda item: item[1].upper(), line) for line in lines)


@dataclass(frozen=True)
class Maker:
    """A stage with the arguments by which it makes some file."""

    pipeline: Path
    stage: str
    arguments: Mapping[str, str]

    def __str__(self) -> str:
        """As ``dvc repro`` names it."""
        before = "" if self.pipeline == paths.PIPELINE else f"{self.pipeline}:"
        return f"{before}{self.stage}" + f"@{'-'.join(self.arguments.values())}" * bool(self.arguments)


def maker(path: Path) -> Maker | None:
    """The stage that writes a file, or what is in it; null where none does."""
    for pipeline in PIPELINES:
        if pipeline.exists() and PIPELINES[pipeline].exists():
            for name, entry in _stages(pipeline).items():
                found = _made(path, _outputs(entry))
                if found is not None:
                    items = {item: found[item] for item in entry.get("matrix") or {} if item in found}
                    return Maker(pipeline, name, items)
    return None


def maker_now(path: Path, everything: Mapping[str, Any]) -> Maker | None:
    """The same, but null where params do not list its arguments: no run of the pipelines writes the file any more.

    Args:
        everything: what ``params.yaml`` holds.
    """
    made = maker(path)
    if made is None:
        return None
    values = _values(made.pipeline, everything)
    listed = _matrix(_stages(made.pipeline)[made.stage]).items()
    now = all(made.arguments.get(item, "") in _listed(values, key) for item, key in listed)
    return made if now else None


def made_files(everything: Mapping[str, Any]) -> Iterator[tuple[Path, Maker]]:
    """Every file under ``data`` that a run of the pipelines writes, and which."""
    for path in sorted(paths.DATA.rglob("*")):
        if path.is_file() and not path.is_relative_to(paths.RAW) and (made := maker_now(path, everything)):
            yield path, made


def called(stage: str, arguments: Mapping[str, str]) -> Maker:
    """A stage as it is called.

    Raises:
        InputError: where no pipeline has it.
    """
    return Maker(_stage(stage)[0], stage, arguments)


def dependencies(made: Maker) -> list[str]:
    """What a stage reads, as far as its arguments fill it in."""
    return _filled(made, _paths(_stages(made.pipeline)[made.stage], "deps"))


def outputs(made: Maker) -> list[str]:
    """What a stage writes, in the same way."""
    return _filled(made, _outputs(_stages(made.pipeline)[made.stage]))


def _filled(made: Maker, listed: list[str]) -> list[str]:
    for item, value in made.arguments.items():
        listed = [path.replace(f"${{item.{item}}}", value) for path in listed]
    return [path for path in listed if not _OPEN.search(path)]


def _made(path: Path, outputs: Iterable[str]) -> dict[str, str] | None:
    """The items with which one of a stage's outputs is a path or a folder above it."""
    for out in outputs:
        pattern = _ITEM.sub(r"(?P<\1>\\w+)", re.escape(out))
        found = re.fullmatch(rf"{pattern}(/.*)?", str(path))
        if found:
            return found.groupdict()
    return None


def absent(path: Path) -> InputError:
    """A file that a command reads and that is not there: which stage makes it."""
    try:
        stage = None if path.is_absolute() else maker(path)
    except InputError:
        stage = None
    return InputError(path, "", f"missing: run `dvc repro {stage}`, which makes it" if stage else "no such file")


def _outputs(entry: Mapping[str, Any]) -> list[str]:
    return _paths(entry, "outs") + _paths(entry, "metrics")


def _paths(entry: Mapping[str, Any], kind: str) -> list[str]:
    """Paths under ``deps``, ``outs`` or ``metrics``, without their options."""
    return [next(iter(one)) if isinstance(one, dict) else str(one) for one in entry.get(kind) or []]


def _stage(name: str) -> tuple[Path, dict[str, Any]]:
    """The pipeline that has a stage, and what it says of it."""
    listed: list[str] = []
    for pipeline in PIPELINES:
        stages = _stages(pipeline)
        if name in stages:
            return pipeline, dict(stages[name])
        listed += stages
    raise InputError(paths.PIPELINE, "stages", f"expected a stage {name!r}, got {', '.join(listed)}")


def _stages(pipeline: Path) -> dict[str, Any]:
    stages = _read(pipeline).get("stages")
    if not isinstance(stages, dict):
        raise InputError(pipeline, "stages", "expected a mapping of stages: is this the folder of the project?")
    return stages


def _read(path: Path) -> dict[str, Any]:
    """What a file of params or a pipeline holds by now, parsed once: that takes longer than all that is asked of it."""
    stat = path.stat() if path.exists() else None
    return _parsed(path.absolute(), path, stat and (stat.st_mtime_ns, stat.st_size))


@cache
def _parsed(_place: Path, path: Path, _stamp: tuple[int, int] | None) -> dict[str, Any]:
    return config.read(path)
