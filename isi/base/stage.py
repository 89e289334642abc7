"""What every stage does around its work: read the params that are its own, and answer mistakes in one line."""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from isi.base import params, paths
from isi.base.errors import InputError
from isi.base.tables import Provenance

T = TypeVar("T")

#: What changes no result: every stage may read it, and none lists it.
COMPUTE = "compute"


@dataclass(frozen=True)
class Given:
    """What a stage was given: its params and no others, and the provenance of what it writes."""

    #: by dotted key, as ``dvc.yaml`` lists them
    values: Mapping[str, Any]
    provenance: Provenance

    def section(self, key: str, kind: type[T]) -> T:
        """The checked value at a dotted key: one of the stage's own, below one, or above some.

        Raises:
            InputError: where ``params.yaml`` has there what it must not.
            LookupError: where ``dvc.yaml`` does not list the key: a fault of the stage.
        """
        return params.check(self.raw(key), kind, key)

    def raw(self, key: str) -> Any:
        """The same, unchecked; of a mapping that is not listed whole, what is listed of it."""
        for own, value in self.values.items():
            if key == own:
                return value
            if key.startswith(f"{own}."):
                return params.at(value, key.removeprefix(f"{own}."))
        below = [own.removeprefix(f"{key}.").partition(".")[0] for own in self.values if own.startswith(f"{key}.")]
        if below:
            return {name: self.raw(f"{key}.{name}") for name in dict.fromkeys(below)}
        raise LookupError(f"{self.provenance.stage} reads {key}, which dvc.yaml does not list for it")

    @property
    def seed(self) -> int:
        """Root of every random stream."""
        return self.section("seed", params.Seed)


def stage(body: Callable[..., None]) -> Callable[[], None]:
    """Make a function of ``Given`` and names the command of the DVC stage of its own name."""
    arguments = list(inspect.signature(body).parameters)[1:]

    def main() -> None:
        parser = argparse.ArgumentParser(prog=f"python -m stages.{body.__name__}", description=body.__doc__)
        for argument in arguments:
            parser.add_argument(argument)
        named = vars(parser.parse_args())
        try:
            everything = params.read(paths.PARAMS)
            picked = declared(body.__name__, named, everything)
            provenance = Provenance(body.__name__, picked)
            body(Given(picked | {COMPUTE: everything.get(COMPUTE)}, provenance), **named)
        except InputError as error:
            sys.exit(f"{body.__name__}: {error}")

    return main


def declared(name: str, arguments: Mapping[str, str], everything: Mapping[str, Any]) -> dict[str, Any]:
    """The values that a pipeline lists for a stage, by dotted key; what keys leave open is filled in as DVC does.

    Args:
        everything: what ``params.yaml`` holds; other files of params are read where a pipeline names them.
    """

    def fill(open_part: re.Match[str]) -> str:
        matrix, _, item = open_part[1].partition(".")
        return str(arguments[item] if matrix == "item" else params.at(everything, open_part[1]))

    found: dict[str, Any] = {}
    for listed in _stage(name).get("params", []):
        for file, keys in (listed if isinstance(listed, dict) else {str(paths.PARAMS): [listed]}).items():
            values = everything if file == str(paths.PARAMS) else params.read(Path(file))
            filled = [re.sub(r"\$\{([^}]+)\}", fill, key) for key in keys]
            found |= {key: params.at(values, key) for key in filled}
    return found


def _stage(name: str) -> dict[str, Any]:
    """What the pipeline that has a stage says of it."""
    first: dict[str, Any] = params.read(paths.PIPELINE)["stages"]
    stages = first if name in first else params.read(paths.BEYOND_PIPELINE)["stages"]
    return dict(stages[name])


__all__ = ["COMPUTE", "Given", "Provenance", "stage"]
