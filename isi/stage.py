"""What every stage does around its work: read the params, and answer mistakes in one line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable

from isi import params as params_module
from isi import paths
from isi.errors import InputError
from isi.params import Params
from isi.tables import Provenance


def stage(*keys: str, argument: str | None = None) -> Callable[[Callable[..., None]], Callable[[], None]]:
    """Make a function of (params, provenance[, argument]) the command of a DVC stage.

    Args:
        keys: the params that shape its outputs, dotted, as in ``dvc.yaml``; ``{argument}`` in a key
            stands for the stage's argument.
        argument: name of the one positional argument, if the stage takes one.
    """

    def decorate(body: Callable[..., None]) -> Callable[[], None]:
        def main() -> None:
            parser = argparse.ArgumentParser(prog=f"python -m stages.{body.__name__}", description=body.__doc__)
            if argument:
                parser.add_argument(argument)
            given = vars(parser.parse_args())
            try:
                params = params_module.load(paths.PARAMS)
                picked = params.pick(tuple(key.format(**given) for key in keys))
                body(params, Provenance(body.__name__, picked), *given.values())
            except InputError as error:
                sys.exit(f"{body.__name__}: {error}")

        main.keys = keys  # type: ignore[attr-defined]
        return main

    return decorate


__all__ = ["Params", "Provenance", "stage"]
