"""What every stage does around its work: read the params that are its own, and answer mistakes in one line."""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeVar

from isi import config
from isi.errors import InputError
from isi.pipeline import declared, described, value_at
from isi.process import Parser, one_line, only_one
from isi.tables import paths

T = TypeVar("T")

#: What changes no result: every stage may read it, and none lists it.
COMPUTE = "compute"


@dataclass(frozen=True)
class StageContext:
    """What a stage was given: its params and no others, and its name."""

    #: by dotted key, as ``dvc.yaml`` lists them
    values: Mapping[str, Any]
    stage: str

    def section(self, key: str, kind: type[T]) -> T:
        """The checked value at a dotted key: one of the stage's own, below one, or above some.

        Raises:
            InputError: where ``params.yaml`` has there what it must not.
            LookupError: where ``dvc.yaml`` does not list the key: a fault of the stage.
        """
        return config.check(self.raw(key), kind, key)

    def raw(self, key: str) -> Any:
        """The same, unchecked; of a mapping that is not listed whole, what is listed of it."""
        for own, value in self.values.items():
            if key == own:
                return value
            if key.startswith(f"{own}."):
                return config.value_of(value, key.removeprefix(f"{own}."))
        below = [own.removeprefix(f"{key}.").partition(".")[0] for own in self.values if own.startswith(f"{key}.")]
        if below:
            return {name: self.raw(f"{key}.{name}") for name in dict.fromkeys(below)}
        raise LookupError(f"{self.stage} reads {key}, which dvc.yaml does not list for it")

    @property
    def seed(self) -> int:
        """Root of every random stream."""
        return self.section("seed", config.Seed)


def stage(body: Callable[..., None]) -> Callable[[], None]:
    """Make a function of ``Given`` and names the command of the DVC stage of its own name."""
    name, arguments = body.__name__, list(inspect.signature(body).parameters)[1:]

    def main() -> None:
        form = argparse.RawDescriptionHelpFormatter
        parser = _StageParser(prog=f"python -m stages.{name}", description=inspect.getdoc(body), formatter_class=form)
        for argument in arguments:
            parser.add_argument(argument)
        named = vars(parser.parse_args())
        with one_line(name, "`dvc repro` goes on from here"):
            everything = config.read(paths.PARAMS)
            picked = declared(name, named, everything)
            compute = {COMPUTE: value_at(paths.PARAMS, everything, COMPUTE)}
            with only_one("@".join(filter(None, [name, "-".join(named.values())]))):
                body(StageContext(picked | compute, name), **named)

    return main


class _StageParser(Parser):
    """Its help tells what the pipeline says of the stage, where there is one."""

    def format_help(self) -> str:
        with suppress(InputError):
            self.epilog = described(self.prog.rpartition(".")[2])
        return super().format_help()
