"""Check all of params.yaml and beyond/params.yaml: DVC looks only at the keys that its stages name."""

from __future__ import annotations

import sys

from isi.base import paths
from isi.base.errors import InputError
from isi.base.params import check, read
from isi.base.stage import Given, declared
from isi.base.tables import Provenance
from isi.insertion.registry import options_of
from isi.params import Params, load
from isi.studies import variants
from isi.studies.variants import Variant


def check_variants(params: Params) -> None:
    """See that variants are of experiments and initializers that there are, with options and params that these take.

    Raises:
        InputError: where one is not.
    """
    for name, variant in variants.load().items():
        known = dict.fromkeys([*params.initializers, *variant.options])
        for key, listed, there in (("experiments", variant.experiments, params.experiments),
                                   ("initializers", variant.initializers, known)):  # fmt: skip
            unknown = [one for one in listed if one not in there]
            if unknown:
                expected = f"expected names among {', '.join(there)}, got {unknown[0]!r}"
                raise InputError(paths.BEYOND_PARAMS, f"variants.{name}.{key}", expected)
        try:
            _check_values(variant, name)
        except InputError as error:  # which takes all params for those of the first pipeline
            raise InputError(paths.BEYOND_PARAMS, *error.args[1:]) from error


def _check_values(variant: Variant, name: str) -> None:
    for initializer, options in variant.options.items():
        options_of(initializer, options, f"variants.{name}.options.{initializer}")
    everything, key = read(paths.PARAMS), f"variants.{name}.changes"
    given = Given(declared("vary", {"variant": name}, everything), Provenance("vary", {}))
    changed = variants.changed(given, variant.changes, key).values
    check({section: changed.get(section, value) for section, value in everything.items()}, Params, key)


if __name__ == "__main__":
    try:
        check_variants(load())
    except InputError as error:
        sys.exit(str(error))
