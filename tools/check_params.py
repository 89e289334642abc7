"""Check all of params.yaml and beyond/params.yaml: DVC looks only at the keys that its stages name."""

from __future__ import annotations

import sys

from isi.base import paths
from isi.base.errors import InputError
from isi.params import Params, load
from isi.studies import variants


def check_variants(params: Params) -> None:
    """See that variants are of experiments and initializers that there are.

    Raises:
        InputError: where one is not.
    """
    for name, variant in variants.load().items():
        known = {*params.initializers, *variant.options}
        for key, listed, there in (("experiments", variant.experiments, params.experiments),
                                   ("initializers", variant.initializers, known)):  # fmt: skip
            unknown = [one for one in listed if one not in there]
            if unknown:
                expected = f"expected names among {', '.join(there)}, got {unknown[0]!r}"
                raise InputError(paths.BEYOND_PARAMS, f"variants.{name}.{key}", expected)


if __name__ == "__main__":
    try:
        check_variants(load())
    except InputError as error:
        sys.exit(str(error))
